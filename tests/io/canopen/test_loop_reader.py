"""asyncio on a port with a descriptor: the event loop reads it, without a thread, while only this loop listens."""

from __future__ import annotations

import asyncio
import os
import socket
import struct
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

import pytest

from barewire import AsyncCanopenClient, CanopenClient
from barewire.canopen import CanFrame, EmcyConsumer
from barewire.errors import PortError
from barewire.io.canopen.bus.async_bus import AsyncSubscriber
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import BusDown, BusUp, FramesLost, Subscriber
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.socketcan import SocketCanPort
from tests.io.canopen.memory_bus import numbered

PLACE = "socketcan/loop"
VALUE = bytes.fromhex("92010200")
REQUEST, ANSWER = bytes.fromhex("4000100000000000"), bytes.fromhex("4300100092010200")


def raw(identifier: int, data: bytes) -> bytes:
    return struct.pack("=IB3x8s", identifier, len(data), data)


class Wire:
    """A port on one end of a socket pair, and the other end."""

    def __init__(self) -> None:
        ours, self.other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.port = SocketCanPort(Endpoint.parse(f"can://{PLACE}"), opened=ours)

    def arrive(self, *frames: CanFrame) -> None:
        for frame in frames:
            self.other.send(raw(frame.id, frame.data))

    def serve(self, loop: asyncio.AbstractEventLoop) -> None:
        """Answer requests for object 1000h to any node, in the loop of the test."""

        def answer() -> None:
            identifier, _, data = struct.unpack("=IB3x8s", self.other.recv(16))
            if data == REQUEST:
                self.other.send(raw(identifier - 0x80, ANSWER))

        loop.add_reader(self.other, answer)

    def close(self) -> None:
        self.port.close()
        self.other.close()


@pytest.fixture
def wire() -> Iterator[Wire]:
    made = Wire()
    yield made
    made.close()


def reader_threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == f"reader of {PLACE}"]


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))


def test_the_loop_reads_without_a_thread_and_leaves_no_descriptor(wire: Wire) -> None:
    async def main() -> None:
        before = descriptors()
        wire.serve(asyncio.get_running_loop())
        async with AsyncCanopenClient(wire.port, timeout=30.0) as client:
            with client.frames() as stream:
                nodes = [client.node(number) for number in (5, 6, 7)]
                assert await asyncio.gather(*(node.sdo.upload(0x1000) for node in nodes)) == [VALUE] * 3
                assert await nodes[0].sdo.upload(0x1000) == VALUE
                heard = [await stream.get(30.0) for _ in range(8)]
                assert sum(isinstance(frame, CanFrame) and frame.data == ANSWER for frame in heard) == 4
                assert not reader_threads()
        await asyncio.sleep(0)
        assert descriptors() == before - 1  # the port is closed
        asyncio.get_running_loop().remove_reader(wire.other)

    asyncio.run(main())


def test_a_frame_that_arrived_before_a_request_is_not_its_answer(wire: Wire) -> None:
    async def main() -> None:
        async with AsyncCanopenClient(wire.port, timeout=30.0) as client:
            wire.serve(asyncio.get_running_loop())
            assert await client.node(5).sdo.upload(0x1000) == VALUE
            wire.arrive(CanFrame(0x585, bytes.fromhex("4300100000000000")), *numbered(100))
            assert await client.node(5).sdo.upload(0x1000) == VALUE
            assert client.bus.monitor.frames == 103

    asyncio.run(main())


def test_a_stream_gets_no_frame_from_before(wire: Wire) -> None:
    async def main() -> None:
        wire.arrive(*numbered(5))
        async with AsyncCanopenClient(wire.port) as client:
            with client.frames() as first:
                wire.arrive(CanFrame(0x80))
                with client.frames() as second:
                    wire.arrive(CanFrame(0x81))
                    assert [await first.get(30.0), await first.get(30.0)] == [CanFrame(0x80), CanFrame(0x81)]
                    assert await second.get(30.0) == CanFrame(0x81)

    asyncio.run(main())


def in_another_loop(bus: CanBus, found: list[Any]) -> Coroutine[Any, Any, None]:
    async def listen() -> None:
        with AsyncSubscriber(bus, None, reports=True) as other:
            found.append(other)
            while (arrived := await other.pull_async(30.0)) is not None and arrived.item != CanFrame(0x7FF):
                found.append(arrived.item)

    return listen()


@pytest.mark.parametrize("kind", ["blocking", "another loop"])
@pytest.mark.parametrize("at", range(0, 10, 3))
def test_a_listener_outside_of_the_loop_loses_and_doubles_no_frame(wire: Wire, kind: str, at: int) -> None:
    """Frames arrive one by one. After frame `at` a blocking listener, or one of another loop, joins."""

    async def main() -> None:
        frames, found, threads = numbered(10), list[Any](), list[threading.Thread]()
        async with AsyncCanopenClient(wire.port) as client:
            with client.frames() as stream:
                for number, frame in enumerate(frames):
                    if number == at and kind == "blocking":
                        found.append(Subscriber(client.bus, None))
                    elif number == at:
                        work = in_another_loop(client.bus, found)
                        threads.append(threading.Thread(target=lambda work=work: asyncio.run(work)))
                        threads[0].start()
                        while not found:
                            await asyncio.sleep(0)
                    wire.arrive(frame)
                    if number % 2:  # otherwise two frames wait together
                        assert [await stream.get(30.0), await stream.get(30.0)] == frames[number - 1 : number + 1]
                wire.arrive(CanFrame(0x7FF))
                assert await stream.get(30.0) == CanFrame(0x7FF)
                assert await stream.get(0.0) is None
                if kind == "blocking":
                    found += [found[0].receive(30.0) for _ in range(10 - at)]
                    assert found[0].receive(30.0) == CanFrame(0x7FF)
                    found[0].close()
                for thread in threads:
                    thread.join(30.0)
                # The frame before an odd `at` waits in the port when the listener joins. If the loop, which is another
                # thread, reads it just then, the listener may get it as well.
                before = frames[at - 1 : at] if at % 2 and kind != "blocking" else []
                assert found[1:] in (frames[at:], before + frames[at:])
                assert reader_threads()

    asyncio.run(main())


def test_a_blocking_client_of_the_same_bus_gets_its_answers(wire: Wire) -> None:
    async def main(bus: CanBus) -> None:
        wire.serve(asyncio.get_running_loop())
        async with AsyncCanopenClient(bus, timeout=30.0) as client:
            assert await client.node(5).sdo.upload(0x1000) == VALUE
            blocking = CanopenClient(bus, timeout=30.0)
            read = asyncio.to_thread(blocking.node(6).sdo.upload, 0x1000)
            assert tuple(await asyncio.gather(read, client.node(5).sdo.upload(0x1000))) == (VALUE, VALUE)
            assert reader_threads()

    with CanBus(wire.port, lazy=True) as bus:
        asyncio.run(main(bus))


def test_one_loop_after_another_on_one_bus_needs_no_thread(wire: Wire) -> None:
    async def main(bus: CanBus) -> None:
        wire.serve(asyncio.get_running_loop())
        assert await AsyncCanopenClient(bus, timeout=30.0).node(5).sdo.upload(0x1000) == VALUE
        asyncio.get_running_loop().remove_reader(wire.other)
        assert not reader_threads()

    with CanBus(wire.port, lazy=True) as bus:
        asyncio.run(main(bus))
        asyncio.run(main(bus))
        before = descriptors()
        assert CanopenClient(bus, timeout=0.01).receive(0.0) is None  # the thread takes over from a loop that is closed
        assert reader_threads()
        assert descriptors() == before - 1


def test_a_port_that_fails_is_opened_again(wire: Wire) -> None:
    second = Wire()

    async def main() -> None:
        bus = CanBus(wire.port, dial=lambda: second.port, pauses=(0.001, 0.001), lazy=True)
        async with AsyncCanopenClient(bus, timeout=30.0) as client:
            with client.frames() as stream:
                wire.other.close()
                assert isinstance(await stream.get(30.0), BusDown)
                assert isinstance(await stream.get(30.0), BusUp)
                second.arrive(CanFrame(0x80))
                assert await stream.get(30.0) == CanFrame(0x80)
        await asyncio.to_thread(bus.close)

    asyncio.run(main())
    second.close()


def test_a_port_that_fails_for_good_ends_what_waits(wire: Wire) -> None:
    async def main() -> None:
        async with AsyncCanopenClient(wire.port, timeout=30.0) as client:
            read = asyncio.ensure_future(client.node(5).sdo.upload(0x1000))
            await asyncio.sleep(0)
            wire.other.close()
            with pytest.raises(PortError, match="connection reset"):
                await read

    asyncio.run(main())


def test_closing_the_bus_from_another_thread_ends_what_waits(wire: Wire) -> None:
    async def main() -> None:
        before = descriptors()
        with CanBus(wire.port, lazy=True) as bus:
            client = AsyncCanopenClient(bus, timeout=30.0)
            read = asyncio.ensure_future(client.node(5).sdo.upload(0x1000))
            await asyncio.sleep(0)
            await asyncio.to_thread(bus.close)
            with pytest.raises(PortError, match="the bus was closed"):
                await read
        assert descriptors() == before - 1

    asyncio.run(main())


class Late:
    """A port whose frames arrived some time ago: `received_at` is when."""

    name = "test/late"
    keeps_frames = True
    received_at: float | None = None

    def __init__(self, *ages: float) -> None:
        self.ages = list(ages)
        self.keeps_times = False
        self.lost = 0
        self._bell, self.end = socket.socketpair()

    def keep_times(self) -> None:
        self.keeps_times = True

    def fileno(self) -> int:
        return self._bell.fileno()

    def receive(self, timeout: float) -> CanFrame | None:
        assert timeout == 0.0
        if not self.ages:
            return None
        age = self.ages.pop(0)
        self.received_at = time.time() - age if self.keeps_times else None
        return CanFrame(0x81, bytes.fromhex("1081010000000000"))

    def send(self, item: CanFrame) -> None: ...

    def close(self) -> None:
        self._bell.close()
        self.end.close()


def test_a_frame_has_the_time_at_which_it_arrived_also_if_the_loop_was_busy() -> None:
    class Times(EmcyConsumer):
        def __init__(self) -> None:
            super().__init__()
            self.times: list[float] = []

        def feed(self, frame: CanFrame | None, now: float) -> Any:
            if frame is not None:
                self.times.append(now)
            return super().feed(frame, now)

    async def main() -> None:
        port, machine = Late(), Times()
        async with AsyncCanopenClient(port) as client:
            stream = client.watch(machine)
            now = time.monotonic()
            port.ages = [7.0, 2.0, -5.0, 9.0]
            port.end.send(b"x")
            await stream.get(30.0)
            while len(machine.times) < 4:
                stream._feed(await stream._subscriber.pull_async(30.0), time.monotonic())
            port._bell.recv(1)
        end = time.monotonic()
        assert now - 7.1 <= machine.times[0] <= end - 7.0
        assert now - 2.1 <= machine.times[1] <= end - 2.0
        assert now <= machine.times[2] <= end  # the clock of the system was set: no frame comes from the future
        assert machine.times[2] == machine.times[3]  # nor earlier than the one before

    asyncio.run(main())


def test_lost_frames_are_reported() -> None:
    async def main() -> None:
        port = Late()
        async with AsyncCanopenClient(port) as client:
            with client.frames() as stream:
                port.lost, port.ages = 12, [0.0]
                port.end.send(b"x")
                got = [await stream.get(30.0), await stream.get(30.0)]
                assert got == [CanFrame(0x81, bytes.fromhex("1081010000000000")), FramesLost(12)]
                port._bell.recv(1)

    asyncio.run(main())


def test_a_busy_bus_leaves_time_for_other_tasks() -> None:
    async def main() -> None:
        port = Late()
        async with AsyncCanopenClient(port) as client:
            with client.frames() as stream:
                port.ages = [0.0] * 1000
                port.end.send(b"x")
                await stream.get(30.0)
                assert len(port.ages) > 500
                while port.ages:
                    await asyncio.sleep(0)
                port._bell.recv(1)

    asyncio.run(main())


def test_a_loop_that_cannot_watch_descriptors_leaves_reading_to_the_thread(
    wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        wire.serve(loop)

        def refuse(*_: Any) -> None:
            raise NotImplementedError

        monkeypatch.setattr(loop, "add_reader", refuse)
        async with AsyncCanopenClient(wire.port, timeout=30.0) as client:
            assert await client.node(5).sdo.upload(0x1000) == VALUE
            assert reader_threads()

    asyncio.run(main())


def test_frames_are_sent_without_a_thread(wire: Wire) -> None:
    async def awaited() -> None:
        async with AsyncCanopenClient(wire.port) as client:
            await client.send(CanFrame(0x80))
            assert not reader_threads()

    asyncio.run(awaited())
    assert wire.other.recv(16) == raw(0x80, b"")


def test_a_function_that_watches_and_fails_ends_the_bus(wire: Wire) -> None:
    def watch(*_: Any) -> None:
        raise ZeroDivisionError("watch")

    async def main(use: Callable[[CanBus], AsyncCanopenClient]) -> None:
        bus = CanBus(wire.port, watch=watch, lazy=True)
        with use(bus).frames() as stream:
            wire.arrive(CanFrame(0x80))
            with pytest.raises(PortError, match="ZeroDivisionError: watch"):
                await stream.get(30.0)
        bus.close()

    asyncio.run(main(AsyncCanopenClient))
