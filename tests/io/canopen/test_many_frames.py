"""Many frames that are sent one after the other, such as the segments of a block: in order, once, to all listeners."""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import Iterator, Sequence

import pytest

from barewire import AsyncCanopenClient, CanopenClient
from barewire.canopen import CanFrame
from barewire.conversation import Conversation, SendAll
from barewire.errors import PortError
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import Subscriber
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.socketcan import SocketCanPort
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
