"""Many frames that are sent one after the other, such as the segments of a block: in order, once, to all listeners."""

from __future__ import annotations

import asyncio
import errno
import itertools
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import pytest

from barewire import AsyncCanopenClient, CanopenClient
from barewire.canopen import CanFrame, ErrorFrame, FdFrame
from barewire.conversation import Conversation, SendAll
from barewire.errors import PortError
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import FramesLost, Subscriber
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.socketcan import SocketCanPort
from tests.helpers import PATIENCE, until
from tests.io.canopen.memory_bus import MemoryPort, device, numbered
from tests.io.canopen.test_direct import KeepingPort

FRAMES = [CanFrame(0x605, bytes([number]) * 8) for number in range(100)]


class CountingPort(KeepingPort):
    """A port with room for some frames at a time."""

    def __init__(self, room: int = 1000) -> None:
        super().__init__()
        self.room = self.free = room
        self.sent: list[CanFrame] = []

    def try_send(self, item: CanFrame) -> bool:
        if not self.free:
            self.free = self.room
            return False
        self.free -= 1
        self.sent.append(item)
        return True

    def try_send_all(self, items: Sequence[CanFrame]) -> int:
        for count, item in enumerate(items):
            if not self.try_send(item):
                return count
        return len(items)


def send_all() -> Conversation[CanFrame, None]:
    yield SendAll(FRAMES)


@pytest.mark.parametrize("room", [1, 7, 1000])
@pytest.mark.parametrize("lazy", [True, False])
def test_a_client_sends_each_frame_once_and_in_order(lazy: bool, room: int) -> None:
    port = CountingPort(room)
    with CanBus(port, lazy=lazy) as bus, CanopenClient(bus) as client:
        client.run(send_all())
    assert port.sent == FRAMES


@pytest.mark.parametrize("room", [1, 7, 1000])
def test_a_task_sends_each_frame_once_and_in_order(room: int) -> None:
    port = CountingPort(room)

    async def main() -> None:
        with CanBus(port) as bus:
            async with AsyncCanopenClient(bus) as client:
                await client.run(send_all())

    asyncio.run(main())
    assert port.sent == FRAMES


@pytest.mark.parametrize("lazy", [True, False])
def test_other_listeners_and_watchers_get_each_frame(lazy: bool) -> None:
    watched: list[tuple[str, CanFrame]] = []
    for watch in (None, lambda way, frame: watched.append((way, frame))):
        with (
            CanBus(CountingPort(), lazy=lazy, watch=watch) as bus,
            CanopenClient(bus) as client,
            Subscriber(bus, None) as other,
        ):
            client.run(send_all())
            assert [other.receive(0.0) for _ in range(101)] == [*FRAMES, None]
    assert watched == [("sent", frame) for frame in FRAMES]


def test_a_conversation_that_reads_the_bus_itself_gets_the_frames_of_others() -> None:
    with CanBus(CountingPort(), lazy=True) as bus:
        direct = bus.direct(None, 0.0)
        assert direct is not None
        with direct:
            assert bus.try_send_all(FRAMES) == 100
            assert [direct.receive(0.0) for _ in range(101)] == [*FRAMES, None]
        assert bus.monitor.count(0x605) == 100


def test_a_bus_that_failed_sends_none() -> None:
    bus = CanBus(CountingPort())
    bus.close()
    with pytest.raises(PortError, match="closed"):
        bus.try_send_all(FRAMES)


@pytest.fixture
def ends() -> Iterator[tuple[SocketCanPort, socket.socket]]:
    ours, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    port = SocketCanPort(Endpoint.parse("can://socketcan/pair"), opened=ours)
    other.setblocking(False)
    yield port, other
    port.close()
    other.close()


def test_socketcan_takes_frames_until_it_is_full(ends: tuple[SocketCanPort, socket.socket]) -> None:
    port, other = ends
    sent = received = 0
    many = FRAMES * 100
    while received < len(many):
        sent += port.try_send_all(many[sent:])
        while received < sent:
            assert other.recv(16) == bytes([5, 6, 0, 0, 8, 0, 0, 0]) + many[received].data
            received += 1


def test_socketcan_leaves_frames_of_other_kinds_to_try_send(ends: tuple[SocketCanPort, socket.socket]) -> None:
    port, _ = ends
    for strange in (CanFrame(0x605, b"", True), CanFrame(0x605, remote=True)):
        assert port.try_send_all([FRAMES[0], strange, FRAMES[1]]) == 1
    with pytest.raises(PortError, match="no frame that CAN can carry"):
        port.try_send_all([FRAMES[0], CanFrame(-1)])


def test_socketcan_raises_the_failure_of_its_interface(ends: tuple[SocketCanPort, socket.socket]) -> None:
    port, _ = ends

    def fail(data: bytes, flags: int) -> int:
        raise OSError(errno.ENETDOWN, "Network is down")

    port._send = fail  # type: ignore[assignment]
    with pytest.raises(PortError, match="the interface is down"):
        port.try_send_all(FRAMES)


# A flood --------------------------------------------------------------------------------------------------------------

ANSWER = bytes.fromhex("4300100092010200")
OTHERS = (
    CanFrame(0x585, ANSWER, extended=True),
    CanFrame(0x605, bytes.fromhex("8000100000000008"), extended=True),
    CanFrame(0x585, b"", remote=True, requested=8),
    CanFrame(0x605, b"", remote=True, requested=8),
    CanFrame(0x586, ANSWER),
    CanFrame(0x18FF1234, bytes(8), extended=True),
    CanFrame(0x000, b"\x02\x07"),
    CanFrame(0x705, b"\x05"),
    FdFrame(0x585, bytes(64)),
    ErrorFrame(0x4, bytes(8)),
)
LATE = CanFrame(0x585, bytes.fromhex("4300300078563412"))  # the response for an object that is never requested


def test_a_node_in_a_task_takes_a_burst_in_few_turns_of_the_loop_and_leaves_turns_to_others() -> None:
    """A thread that reads the bus may delay each turn: with one frame a turn, a node on a full bus loses frames."""

    async def main(bus: CanBus) -> int:
        async with AsyncCanopenClient(bus) as client:
            with client.host(device()) as node:
                await asyncio.sleep(0)
                for frame in numbered(1000):
                    bus.send(frame)
                for turns in range(1000):
                    if node.statistics.received == 1000:
                        return turns
                    await asyncio.sleep(0)
        return 1000

    with CanBus(MemoryPort()) as bus:
        assert 10 <= asyncio.run(main(bus)) <= 30


@contextmanager
def flood(bus: CanBus, port: MemoryPort, *more: CanFrame) -> Iterator[None]:
    """Another node sends, as fast as the reader and the nodes of the bus receive. The block begins when 30 of its
    frames were received."""
    over, flooded = threading.Event(), threading.Event()

    def is_behind() -> bool:
        # A node of a busy machine that fell behind would lose requests, or answer after any time-out.
        return len(port._incoming) > 20 or any(len(other.queue) > 100 for other in tuple(bus.subscribers) if other.node)

    def send() -> None:
        for number, item in enumerate(itertools.cycle(OTHERS + more)):
            if over.is_set():
                return
            if number == 50:
                flooded.set()
            port.deliver(item)
            while is_behind() and not over.is_set():
                over.wait(0.0005)

    thread = threading.Thread(target=send)
    thread.start()
    try:
        assert flooded.wait(PATIENCE)
        yield
    finally:
        over.set()
        thread.join()


def test_transfers_on_a_full_bus_give_the_right_values() -> None:
    port, value = MemoryPort(), bytes(number % 253 for number in range(3000))
    node = device()
    node.sdo.timeout = PATIENCE
    with CanBus(port) as bus, CanopenClient(bus, node=5, timeout=PATIENCE) as client, client.host(node):
        slow = client.frames()
        with flood(bus, port, LATE):
            give_up = time.monotonic() + PATIENCE
            # Again, if the thread that floods had no turn during all transfers.
            while client.channel().total.late == 0 and time.monotonic() < give_up:
                for number in range(1, 100):
                    assert client.node().sdo.upload(0x3000 + number) == (number * 7919).to_bytes(4, "little")
        with flood(bus, port):
            for block in (False, True):
                client.node().sdo.download(0x2100, 0, value, block=block)
                assert client.node().sdo.upload(0x2100, block=block) == value
            until(lambda: slow.lost > 0)
        assert client.channel().total.garbled == 0
        assert client.channel().total.late > 0
        assert any(isinstance(slow.get(0.0), FramesLost) for _ in range(2000))
        assert node.sdo.counters.aborts_sent == 0


def test_transfers_of_tasks_on_a_full_bus_give_the_right_values() -> None:
    async def main(bus: CanBus, port: MemoryPort) -> None:
        async with AsyncCanopenClient(bus, node=5, timeout=PATIENCE) as client:
            with client.host(device()):
                await asyncio.sleep(0)
                with flood(bus, port, LATE):
                    sdo = client.node().sdo
                    values = await asyncio.gather(*(sdo.upload(0x3000 + number) for number in range(1, 50)))
        assert values == [(number * 7919).to_bytes(4, "little") for number in range(1, 50)]

    port = MemoryPort()
    with CanBus(port) as bus:
        asyncio.run(main(bus, port))
