"""One reader, many subscribers: the frames that they get, losses, errors, the end."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest

from barewire import CanopenClient
from barewire.canopen import CanFrame, ErrorFrame, FdFrame, upload
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.io.canopen.async_client import AsyncCanopenClient
from barewire.io.canopen.bus.async_bus import AsyncStream, AsyncSubscriber
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import FrameListener, FramesLost, Stream, Subscriber
from tests.io.canopen.memory_bus import MemoryPort, device, memory_bus

BUS_OFF = ErrorFrame(0x40, bytes(8))


def frame(text: str) -> CanFrame:
    return CanFrame.parse(text)


def test_frames_go_to_the_subscribers_of_their_identifier() -> None:
    port = MemoryPort()
    with CanBus(port) as bus, Subscriber(bus, {(0x585, False)}) as ours, Subscriber(bus, {(0x585, True)}) as foreign:
        with Subscriber(bus, None) as everything:
            texts = ["585#01", "00000585#02", "586#03", "585#R1"]
            port.deliver(*map(frame, texts))
            assert [str(everything.receive(30.0)) for _ in texts] == texts
        assert [str(ours.receive(30.0)), str(ours.receive(30.0)), ours.receive(0.0)] == ["585#01", "585#R1", None]
        assert [str(foreign.receive(30.0)), foreign.receive(0.0)] == ["00000585#02", None]
        assert (bus.monitor.frames, bus.monitor.count(0x585)) == (4, 1)


def test_frames_of_one_subscriber_go_to_all_others() -> None:
    with memory_bus() as bus, Subscriber(bus, None) as one, Subscriber(bus, {(0x80, False)}) as other:
        one.send(frame("080#"))
        assert (one.receive(0.0), other.receive(30.0)) == (None, frame("080#"))


def test_a_slow_stream_reports_lost_frames_in_their_place() -> None:
    with memory_bus() as bus, Stream(bus, FrameListener(), {(0x100, False)}, room=3) as stream:
        for number in range(5):
            bus.send(CanFrame(0x100, bytes([number])))
        assert stream.get(30.0) == CanFrame(0x100, b"\0")
        bus.send(CanFrame(0x100, b"\x09"))
        rest = [stream.get(30.0) for _ in range(4)]
        assert rest == [CanFrame(0x100, b"\1"), CanFrame(0x100, b"\2"), FramesLost(2), CanFrame(0x100, b"\x09")]
        for number in range(4):
            bus.send(CanFrame(0x100, bytes([number])))
        assert [stream.get(30.0) for _ in range(4)][3] == FramesLost(1)
        assert (stream.get(0.0), stream.lost) == (None, 3)


def test_frames_that_the_system_dropped_are_reported_to_streams() -> None:
    port = MemoryPort()
    port.lost = 0  # type: ignore[attr-defined]
    with CanBus(port) as bus, Stream(bus, FrameListener(), {(0x100, False)}) as stream:
        port.lost = 7  # type: ignore[attr-defined]
        assert stream.get(30.0) == FramesLost(7)
        port.lost = 9  # type: ignore[attr-defined]
        assert stream.get(30.0) == FramesLost(2)


def test_a_full_subscriber_counts_lost_frames() -> None:
    with memory_bus() as bus, Subscriber(bus, None, room=2) as subscriber:
        for number in range(5):
            bus.send(CanFrame(0x100, bytes([number])))
        assert [subscriber.receive(0.0) for _ in range(3)] == [CanFrame(0x100, b"\0"), CanFrame(0x100, b"\1"), None]
        assert subscriber.lost == 3


def test_an_error_gets_a_note_of_the_frames_that_were_lost() -> None:
    port = MemoryPort()
    with CanBus(port) as bus, Subscriber(bus, {(0x585, False)}, room=1) as subscriber:
        for _ in range(3):
            bus.send(frame("585#80"))
        error = NoAnswer("no answer")
        subscriber.note_losses(error)
        assert error.__notes__ == ["2 frames were lost here: they arrived faster than they were taken"]


def test_reports_of_the_controller_reach_every_stream_and_no_conversation() -> None:
    port = MemoryPort()
    with (
        CanBus(port) as bus,
        Stream(bus, FrameListener(), {(0x1, False)}) as one,
        Stream(bus, FrameListener(), None) as two,
    ):
        with Subscriber(bus, None) as conversation:
            fd = FdFrame(0x585, bytes(12))
            port.deliver(BUS_OFF, fd, frame("001#"))
            assert [one.get(30.0), one.get(30.0), one.get(30.0)] == [BUS_OFF, fd, frame("001#")]
            assert [two.get(30.0), two.get(30.0)] == [BUS_OFF, fd]
            assert conversation.receive(30.0) == frame("001#")
        with pytest.raises(NoAnswer, match="the controller reported bus off"):
            CanopenClient(bus, timeout=0.01).node(5).sdo.upload(0x1000)


def test_a_failed_port_is_an_error_for_all_now_and_later() -> None:
    port = MemoryPort()
    with CanBus(port) as bus, Stream(bus, FrameListener(), None) as stream:
        client = CanopenClient(bus, node=5, timeout=30.0)
        ends: list[str] = []

        def ask() -> None:
            with pytest.raises(PortError) as caught:
                client.node().sdo.upload(0x1000)
            ends.append(str(caught.value))

        threads = [threading.Thread(target=ask) for _ in range(3)]
        for thread in threads:
            thread.start()
        while not port.sent:
            stream.get(30.0)
        port.deliver(frame("080#"), PortError("the adapter was unplugged"))
        for thread in threads:
            thread.join(10.0)
        assert ends == ["the adapter was unplugged"] * 3
        while stream.get(30.0) != frame("080#"):  # the request before it may have been taken already
            pass
        for late in (lambda: stream.get(30.0), lambda: Subscriber(bus, None), lambda: bus.send(frame("080#"))):
            with pytest.raises(PortError, match="the adapter was unplugged"):
                late()


def test_closing_ends_the_reader_and_the_iteration_of_streams() -> None:
    before = threading.active_count()
    port = MemoryPort()
    bus = CanBus(port)
    stream = Stream(bus, FrameListener(), None)
    received: list[object] = []

    def iterate() -> None:
        received.extend(stream)

    thread = threading.Thread(target=iterate)
    thread.start()
    bus.send(frame("080#"))
    stream.close()
    thread.join(10.0)
    bus.close()
    assert (received, port.closed, threading.active_count()) == ([frame("080#")], True, before)
    bus.close()


def test_watch_is_called_for_both_directions() -> None:
    port, seen = MemoryPort(), []
    with (
        CanBus(port, watch=lambda direction, item: seen.append((direction, str(item)))) as bus,
        Subscriber(bus, None) as subscriber,
    ):
        subscriber.send(frame("605#4000100000000000"))
        port.deliver(frame("585#4300100092010200"))
        assert subscriber.receive(30.0) is not None
    assert seen == [("sent", "605#4000100000000000"), ("received", "585#4300100092010200")]


def test_an_error_of_watch_is_a_port_error() -> None:
    def watch(direction: str, item: object) -> None:
        raise ValueError("full")

    port = MemoryPort()
    with CanBus(port, watch=watch) as bus, Subscriber(bus, None) as subscriber:
        port.deliver(frame("080#"))
        with pytest.raises(PortError, match="reading memory ended: ValueError: full"):
            subscriber.receive(10.0)


def test_a_transfer_inside_another_on_one_channel_is_refused_and_does_not_hang() -> None:
    with memory_bus() as bus, CanopenClient(bus, node=5, timeout=30.0) as client, client.host(device()):
        client.node().sdo.download(0x2100, 0, bytes(100))

        def meanwhile(done: int, size: int | None) -> None:
            client.node().sdo.upload(0x1000)

        with pytest.raises(EncodeError, match="begun inside another one"):
            client.node().sdo.upload(0x2100, progress=meanwhile, timeout=0.5)
        assert client.node().sdo.upload(0x2001) == b"\x32"


def test_no_answer_reports_when_the_node_last_sent_a_frame() -> None:
    port = MemoryPort()
    with CanBus(port) as bus, CanopenClient(bus, node=5, timeout=0.02) as client, Subscriber(bus, None) as subscriber:
        port.deliver(frame("705#7F"))
        subscriber.receive(30.0)
        with pytest.raises(NoAnswer, match=r"node 5 last sent a frame 0.\S+ s ago, pre-operational, 0 frames on 585h"):
            client.node().sdo.upload(0x6041)


def test_an_asyncio_subscriber_gets_all_frames_of_a_burst() -> None:
    async def main(bus: CanBus, port: MemoryPort) -> None:
        with AsyncSubscriber(bus, None) as subscriber, AsyncStream(bus, FrameListener(), None) as stream:
            waiting = asyncio.create_task(subscriber.receive(10.0))
            await asyncio.sleep(0)
            port.deliver(*(CanFrame(number) for number in range(1, 100)))
            assert await waiting == CanFrame(1)
            assert [await subscriber.receive(30.0) for _ in range(98)] == [CanFrame(number) for number in range(2, 100)]
            assert await subscriber.receive(0.0) is None
            assert await subscriber.receive(0.001) is None
            assert await stream.get(0.0) == CanFrame(1)
            cancelled = asyncio.create_task(subscriber.receive(10.0))
            await asyncio.sleep(0)
            cancelled.cancel()
            with pytest.raises(asyncio.CancelledError):
                await cancelled
            port.deliver(BUS_OFF, PortError("unplugged"))
            with pytest.raises(PortError, match="unplugged"):
                await subscriber.receive(10.0)
            events: list[object] = []

            async def all_of_them() -> None:
                async for event in stream:
                    events.append(event)

            with pytest.raises(PortError, match="unplugged"):
                await all_of_them()
            assert events == [*(CanFrame(number) for number in range(2, 100)), BUS_OFF]

    port = MemoryPort()
    with CanBus(port) as bus:
        asyncio.run(main(bus, port))


def test_frames_for_a_full_controller_wait_for_room() -> None:
    class Full(MemoryPort):
        left = 3

        def try_send(self, item: CanFrame) -> bool:
            self.left -= 1
            if self.left >= 0:
                return False
            self.send(item)
            return True

    async def main(bus: CanBus) -> None:
        with AsyncSubscriber(bus, None) as subscriber:
            subscriber.write(frame("080#01"))
            subscriber.write(frame("080#02"))
            await subscriber.sent()

    port = Full()
    with CanBus(port) as bus:
        asyncio.run(main(bus))
    assert list(port.sent) == [frame("080#01"), frame("080#02")]


def test_a_port_with_a_full_buffer_tries_again(monkeypatch: pytest.MonkeyPatch) -> None:
    can = pytest.importorskip("can")
    from barewire.io.endpoint import Endpoint
    from barewire.io.ports import base
    from barewire.io.ports.can import python_can as can_bus

    port = can_bus.CanPort(Endpoint.parse("can://virtual/full"))
    other = can.Bus(interface="virtual", channel="full")
    send, left = port._bus.send, 3

    def full(message: Any) -> None:
        nonlocal left
        left -= 1
        if left >= 0:
            raise can.CanOperationError("Failed to transmit: no buffer space", 105)
        send(message)

    monkeypatch.setattr(port._bus, "send", full)
    port.send(frame("080#"))
    received = other.recv(30.0)
    assert received is not None
    assert received.arbitration_id == 0x80
    left = 1_000_000
    monkeypatch.setattr(base, "SEND_TIMEOUT", 0.01)
    with pytest.raises(PortError, match="no room for a frame"):
        port.send(frame("080#"))
    port.close()
    other.shutdown()


def test_each_receiver_on_the_virtual_bus_gets_its_own_message() -> None:
    can = pytest.importorskip("can")
    from barewire.io.endpoint import Endpoint
    from barewire.io.ports.can.python_can import CanPort

    port = CanPort(Endpoint.parse("can://virtual/copies?receive_own_messages=true"))
    others = [can.Bus(interface="virtual", channel="copies") for _ in range(2)]
    frames = [frame("585#0102030405060708"), frame("00000585#"), frame("705#R1")]
    for item in frames:
        port.send(item)
    for item in frames:
        one, two = (other.recv(30.0) for other in others)
        assert one is not two
        for message in (one, two):
            assert message is not None
            message.data.clear()
            assert (message.arbitration_id, message.is_extended_id) == item.key
            assert (message.is_remote_frame, message.dlc, message.is_rx) == (item.remote, item.dlc, True)
    assert [port.receive(30.0) for _ in frames] == frames  # although the others changed theirs
    port.close()
    for other in others:
        other.shutdown()


def test_a_port_given_to_a_client_is_closed_with_it() -> None:
    port = MemoryPort()
    with CanopenClient(port, node=5, timeout=0.01) as client, pytest.raises(NoAnswer):
        client.run(upload(5, 0x1000, timeout=0.01))
    assert port.closed
    with pytest.raises(EncodeError, match="SDO dialect 'french'"):
        CanopenClient(MemoryPort(), dialect="french")


def test_clients_of_both_kinds_share_a_bus_and_leave_it_open() -> None:
    async def main(bus: CanBus) -> None:
        async with AsyncCanopenClient(bus, node=5) as one, AsyncCanopenClient(bus, node=6) as two:
            assert await one.node().sdo.upload(0x6041) == await two.node().sdo.upload(0x6041)
            running = one.sync.start(60.0)
            stream = one.frames()
        await asyncio.sleep(0)
        assert running._task.done()
        with pytest.raises(PortError):
            await stream.get(0.0)

    with memory_bus() as bus, CanopenClient(bus, node=5) as client:
        threads = threading.active_count()
        with CanopenClient(bus, node=6) as other, client.host(device(5)):
            other.host(device(6))
            asyncio.run(main(bus))
            assert client.node().sdo.upload(0x6041) == other.node().sdo.upload(0x6041) == bytes.fromhex("3706")
            assert client.channel() is CanopenClient(bus, node=5).channel()
        assert threading.active_count() == threads
        assert bus.failure is None


def test_a_silent_node_does_not_keep_another_one_waiting() -> None:
    with memory_bus() as bus, CanopenClient(bus, node=6) as client, client.host(device(6)):
        silent = CanopenClient(bus, node=5, timeout=60.0)

        def ask() -> None:
            with pytest.raises(PortError, match="closed"):
                silent.node().sdo.upload(0x1000)

        waiting = threading.Thread(target=ask)
        with client.frames((0x605, False)) as requests:
            waiting.start()
            assert requests.get(10.0) is not None
        assert client.node().sdo.upload(0x6041) == bytes.fromhex("3706")

        async def main() -> bytes:
            asynchronous = AsyncCanopenClient(bus, node=6)
            blocked = asyncio.create_task(AsyncCanopenClient(bus).node(5).sdo.upload(0x1000))  # behind the thread
            await asyncio.sleep(0)
            value = await asynchronous.node().sdo.upload(0x6041)
            assert not blocked.done()
            blocked.cancel()
            return value

        assert asyncio.run(main()) == bytes.fromhex("3706")
        assert waiting.is_alive()
        bus.close()
        waiting.join(10.0)


@pytest.mark.parametrize(
    ("item", "text"),
    [
        (CanFrame(0x585, bytes(9)), "a frame that CAN cannot carry: 9 bytes of data"),
        (CanFrame(0x1585, bytes(8)), "a frame that CAN cannot carry: identifier 1585h"),
        (b"\x43", "expected a CanFrame, or None"),
        (CanFrame(0x585, "text"), "expected a CanFrame, or None"),  # type: ignore[arg-type]
    ],
)
def test_what_a_port_of_the_user_receives_is_checked(item: Any, text: str) -> None:
    """Nothing above checks a frame again: nine bytes of data would be an SDO response of eight."""

    class OwnPort:
        name = "own"

        def send(self, frame: CanFrame) -> None:
            pass

        def receive(self, timeout: float) -> CanFrame | None:
            return item  # type: ignore[no-any-return]

        def close(self) -> None:
            pass

    with CanopenClient(OwnPort(), node=5, timeout=30) as client, pytest.raises(PortError, match=text) as caught:
        client.node().sdo.upload(0x1000)
    assert "OwnPort.receive returned" in str(caught.value)
