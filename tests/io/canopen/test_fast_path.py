"""Expedited transfers without a conversation: what both clients do is what their conversation does, on any port."""

from __future__ import annotations

import asyncio
import re
import socket
import struct
import threading
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

import pytest

from barewire import AsyncCanopenClient, CanopenClient
from barewire.canopen import CanFrame, Entry, ErrorFrame, ObjectDictionary
from barewire.errors import BarewireError, DecodeError, NoAnswer, PortError
from barewire.io.canopen import client_base
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import ChannelSubscriber
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.socketcan import SocketCanPort
from tests.io.canopen.either_client import get, run_with
from tests.io.canopen.test_direct import KeepingPort

READ, WRITE = CanFrame.parse("605#4000100000000000"), CanFrame.parse("605#2B0010000F000000")
VALUE, DONE = CanFrame.parse("585#4300100092010200"), CanFrame.parse("585#6000100000000000")

IRREGULAR = {
    "abort": "585#8000100000000206",
    "abort of another object": "585#8001100000000206",
    "unsized": "585#4200100092010200",
    "of another object": "585#4301100092010200",
    "segments": "585#4100100004000000",
    "short": "585#43001000",
    "extended": "00000585#4300100092010200",
    "a request": "605#4008100000000000",
    "a heartbeat": "705#05",
    "nothing": "",
}


class PairPort(SocketCanPort):
    """A port on one end of a socket pair, which an event loop can read. What it sends is answered at once."""

    def __init__(self, answers: dict[CanFrame, list[Any]] | None = None) -> None:
        ours, self.other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        super().__init__(Endpoint.parse("can://socketcan/pair"), opened=ours)
        self.answers = answers or {}
        self.refusals = 0  # the next frames for which there is no room

    def arrive(self, *frames: CanFrame) -> None:
        for frame in frames:
            identifier = frame.id | frame.extended << 31
            self.other.send(struct.pack("=IB3x8s", identifier, len(frame.data), frame.data))

    def try_send(self, item: CanFrame) -> bool:
        self.refusals -= 1
        if self.refusals < 0:
            self.arrive(*self.answers.get(item, ()))
        return self.refusals < 0

    def close(self) -> None:
        super().close()
        self.other.close()


class FullPort(KeepingPort):
    """A port that can have no room."""

    refusals = 0

    def try_send(self, item: CanFrame) -> bool:
        self.refusals -= 1
        if self.refusals < 0:
            self.send(item)
        return self.refusals < 0


class World(NamedTuple):
    """A client and its port. A lazy bus is read by the client, or by its event loop; any other by a thread."""

    client: str
    port: Any
    lazy: bool


WORLDS = {
    "blocking, read by itself": World("blocking", FullPort, lazy=True),
    "blocking, read by a thread": World("blocking", FullPort, lazy=False),
    "asyncio, read by the loop": World("asyncio", PairPort, lazy=True),
    "asyncio, read by a thread": World("asyncio", FullPort, lazy=False),
}
Calls = Callable[[Any, Any], Coroutine[Any, Any, None]]


@pytest.fixture(params=WORLDS)
def world(request: pytest.FixtureRequest) -> World:
    return WORLDS[request.param]


def run(world: World, port: Any, calls: Calls, watch: Any = None) -> None:
    """Make the calls, which get the client and the port, with the client of a world."""

    with CanBus(port, lazy=world.lazy, watch=watch) as bus:
        run_with(lambda client: calls(client, port), world.client, bus, node=5, timeout=30.0)


def ignore(done: int, size: int | None) -> None:
    """A progress function: with it a transfer is a conversation."""


def note_sent(sent: list[CanFrame], way: str, frame: CanFrame) -> None:
    """Keep the frames that a client sends; bound to a list it is a `watch` function."""
    if way == "sent":
        sent.append(frame)


@pytest.fixture
def plain_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every conversation fail."""

    def refuse(*arguments: object) -> Any:
        raise AssertionError(f"a conversation: {arguments}")

    monkeypatch.setattr("barewire.io.canopen.client.run", refuse)
    monkeypatch.setattr("barewire.io.canopen.async_client.run", refuse)


@pytest.mark.usefixtures("plain_only")
def test_expedited_transfers_need_no_conversation(world: World) -> None:
    async def calls(client: Any, port: Any) -> None:
        sdo = client.node().sdo
        for _ in range(3):
            assert await get(sdo.upload(0x1000)) == VALUE.data[4:]
            assert await get(sdo.download(0x1000, 0, b"\x0f\x00")) is None
        assert client.channel().counters.responses == 1
        assert client.channel().total.responses == 5
        assert client.bus.monitor.count(0x706) == 3

    run(world, world.port({READ: [CanFrame(0x185), CanFrame.parse("706#05"), VALUE], WRITE: [DONE]}), calls)


@pytest.mark.usefixtures("plain_only")
def test_reads_and_writes_by_name_need_no_conversation_whatever_the_value(world: World) -> None:
    objects = ObjectDictionary([Entry(0x1000, 0, "on", "bool"), Entry(0x1001, 0, "speed", "i16")])

    async def calls(client: Any, port: Any) -> None:
        node = client.node(eds=objects)
        for _ in range(2):
            assert await get(node.read("on")) is False
            assert await get(node.read("speed")) == await get(node.sdo.read_object(objects, "speed")) == -2
            await get(node.write("speed", 3))
            await get(node.sdo.write_object(objects, "speed", 3))

    answers = {
        READ: [CanFrame.parse("585#4F00100000000000")],
        CanFrame.parse("605#4001100000000000"): [CanFrame.parse("585#4B011000FEFF0000")],
        CanFrame.parse("605#2B01100003000000"): [CanFrame.parse("585#6001100000000000")],
    }
    run(world, world.port(answers), calls)


def test_a_value_that_is_not_of_its_type_is_refused_as_in_the_conversation(world: World) -> None:
    objects = ObjectDictionary([Entry(0x1000, 0, "speed", "i16")])

    async def calls(client: Any, port: Any) -> None:
        for _ in range(2):
            with pytest.raises(DecodeError) as caught:
                await get(client.node(eds=objects).read("speed"))
            assert caught.value.__notes__ == ["speed is i16 in the dictionary, but the device sent this"]
            assert not client.channel().busy

    run(world, world.port({READ: [VALUE]}), calls)


async def outcome(transfer: Callable[[], Any]) -> object:
    try:
        return await get(transfer())
    except BarewireError as error:
        return type(error), re.sub(r"[\d.]+ s ago", "some time ago", str(error))


@pytest.mark.parametrize("second", ["good", "nothing"])
@pytest.mark.parametrize("first", IRREGULAR)
@pytest.mark.parametrize("verb", ["upload", "download"])
def test_whatever_is_irregular_ends_as_in_the_conversation(world: World, verb: str, first: str, second: str) -> None:
    good = VALUE if verb == "upload" else DONE
    frames = [CanFrame.parse(IRREGULAR[first])] if IRREGULAR[first] else []
    frames += [good] if second == "good" else []
    outcomes: list[object] = []

    async def calls(client: Any, port: Any, progress: Any, sent: list[CanFrame]) -> None:
        timeout = 0.08 if second == "nothing" else 5.0
        sdo = client.node(timeout=0.3 if first == "segments" else timeout).sdo  # the second segment never comes
        read, write = partial(sdo.upload, 0x1000), partial(sdo.download, 0x1000, 0, b"\x0f\x00")
        result = await outcome(partial(read if verb == "upload" else write, progress=progress))
        channel = client.channel()
        counted = repr(channel.counters), channel.quiet_until is None, channel.abandoned, channel.busy
        outcomes.append((result, sent, counted))

    for progress in (None, ignore):
        sent = list[CanFrame]()
        calls_so = partial(calls, progress=progress, sent=sent)
        run(world, world.port({READ: frames, WRITE: frames}), calls_so, partial(note_sent, sent))
    assert outcomes[0] == outcomes[1]


def test_a_frame_that_waits_is_not_the_answer_of_a_later_request(world: World) -> None:
    async def calls(client: Any, port: Any) -> None:
        for _ in range(3):
            assert await get(client.node().sdo.upload(0x1000)) == VALUE.data[4:]
            before = client.bus.monitor.frames
            port.arrive(CanFrame.parse("585#4300100000000000"), READ, VALUE)
            while not world.lazy and client.bus.monitor.frames < before + 3:
                await asyncio.sleep(0)

    run(world, world.port({READ: [VALUE]}), calls)


def test_a_device_that_is_slow_has_its_whole_time_out(world: World) -> None:
    async def calls(client: Any, port: Any) -> None:
        sdo = client.node().sdo
        with pytest.raises(NoAnswer):
            await get(sdo.upload(0x1001, timeout=0.01))
        client.channel().be_settled()
        answering = threading.Timer(0.12, port.arrive, [VALUE])
        answering.start()
        assert await get(sdo.upload(0x1000)) == VALUE.data[4:]
        answering.join()

    run(world, world.port(), calls)


def test_no_answer_says_what_was_on_the_bus_and_makes_the_channel_wait(world: World) -> None:
    async def calls(client: Any, port: Any) -> None:
        with pytest.raises(NoAnswer, match=r"within 0\.06 s.* 1 frame on the bus meanwhile"):
            await get(client.node().sdo.upload(0x1000, timeout=0.06))
        assert client.channel().quiet_until is not None

    run(world, world.port({READ: [CanFrame.parse("706#05")]}), calls)


def test_a_request_waits_for_room(world: World) -> None:
    port = world.port({READ: [VALUE]})
    port.refusals = 2

    async def calls(client: Any, port: Any) -> None:
        assert await get(client.node().sdo.upload(0x1000)) == VALUE.data[4:]
        assert client.channel().counters.responses == 1

    run(world, port, calls)


# A bus that fails -----------------------------------------------------------------------------------------------------

WITHOUT_SOCKET = [name for name in WORLDS if WORLDS[name].port is FullPort]


@pytest.mark.parametrize("name", WITHOUT_SOCKET)
def test_a_request_that_cannot_be_sent_leaves_the_channel_free(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    async def calls(client: Any, port: Any) -> None:
        sdo = client.node().sdo
        with monkeypatch.context() as patch:

            def fail(item: CanFrame) -> None:
                raise PortError("cannot send")

            patch.setattr(port, "send", fail)
            with pytest.raises(PortError, match="cannot send"):
                await get(sdo.upload(0x1000))
        assert client.channel().quiet_until is None
        assert await get(sdo.upload(0x1000)) == VALUE.data[4:]

    run(WORLDS[name], FullPort({READ: [VALUE]}), calls)


@pytest.mark.parametrize("name", WITHOUT_SOCKET)
def test_a_bus_that_failed_ends_an_exchange_and_the_next_ones(name: str) -> None:
    async def calls(client: Any, port: Any) -> None:
        for _ in range(2):
            with pytest.raises(PortError, match="unplugged"):
                await get(client.node().sdo.upload(0x1000))

    run(WORLDS[name], FullPort({READ: [PortError("unplugged")]}), calls)  # type: ignore[list-item]


@pytest.fixture(params=[True, False], ids=["read by itself", "read by a thread"])
def direct(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


@contextmanager
def client_on(port: KeepingPort, *, direct: bool, watch: Any = None) -> Iterator[CanopenClient]:
    with CanBus(port, lazy=direct, watch=watch) as bus, CanopenClient(bus, node=5, timeout=30.0) as client:
        yield client


def test_a_bus_that_failed_and_was_opened_again_is_used_again(direct: bool) -> None:
    old, new = KeepingPort({READ: [VALUE]}), KeepingPort({READ: [VALUE]})
    with CanBus(old, dial=lambda: new, pauses=(0.001, 0.001), lazy=direct) as bus:
        client = CanopenClient(bus, node=5, timeout=30.0)
        sdo = client.node().sdo
        assert sdo.upload(0x1000) == VALUE.data[4:]
        old.answers = {READ: [PortError("unplugged")]}  # type: ignore[list-item]
        with pytest.raises(PortError, match="unplugged"):
            sdo.upload(0x1000)
        bus.wait_until_open(30.0)
        client.channel().be_settled()
        assert [sdo.upload(0x1000) for _ in range(2)] == [VALUE.data[4:]] * 2


def test_reports_of_the_controller_come_between(direct: bool) -> None:
    port = KeepingPort({READ: [ErrorFrame(0x40, bytes(8)), VALUE]})  # type: ignore[list-item]
    with client_on(port, direct=direct) as client:
        assert client.node().sdo.upload(0x1000) == VALUE.data[4:]
        assert client.bus.monitor.error == ErrorFrame(0x40, bytes(8))


# Interrupted ----------------------------------------------------------------------------------------------------------

ABORT = CanFrame.parse("605#8000100000000008")


def test_an_interrupt_sends_an_abort_and_the_late_answer_is_discarded(direct: bool) -> None:
    port, sent = KeepingPort(), list[CanFrame]()
    with client_on(port, direct=direct, watch=partial(note_sent, sent)) as client:

        def interrupt(*arguments: object) -> None:
            raise KeyboardInterrupt

        with pytest.MonkeyPatch.context() as patch:
            if direct:
                port.hook = interrupt
            else:
                patch.setattr(ChannelSubscriber, "receive", interrupt)
            with pytest.raises(KeyboardInterrupt):
                client.node().sdo.upload(0x1000)
        port.hook = lambda: None
        assert sent == [READ, ABORT]
        assert client.channel().abandoned == (0x1000, 0)
        port.answers = {READ: [VALUE]}
        port.arrive(CanFrame.parse("585#4300100000000000"))
        assert client.node().sdo.upload(0x1000) == VALUE.data[4:]


@pytest.mark.parametrize("name", [name for name in WORLDS if WORLDS[name].client == "asyncio"])
def test_a_cancelled_task_sends_an_abort_and_the_late_answer_is_discarded(name: str) -> None:
    sent, was_sent = list[CanFrame](), asyncio.Event()

    def watch(way: str, frame: CanFrame) -> None:
        if way == "sent":
            sent.append(frame)
            was_sent.set()

    async def calls(client: Any, port: Any) -> None:
        task = asyncio.create_task(client.node().sdo.upload(0x1000))
        await was_sent.wait()
        await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert sent == [READ, ABORT]
        assert client.channel().abandoned == (0x1000, 0)
        port.answers = {READ: [VALUE]}
        port.arrive(CanFrame.parse("585#4300100000000000"))
        assert await client.node().sdo.upload(0x1000) == VALUE.data[4:]

    run(WORLDS[name], WORLDS[name].port(), calls, watch)


# Several at a time ----------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("plain_only")
def test_a_frame_that_another_client_sent_meanwhile_does_not_stay_for_the_next_exchange() -> None:
    port = KeepingPort({READ: [VALUE]})
    with client_on(port, direct=True) as client:
        sdo = client.node().sdo
        port.hook = lambda: client.bus.send(CanFrame.parse("585#4300100000000000"))
        assert [sdo.upload(0x1000) for _ in range(3)] == [VALUE.data[4:]] * 3


def test_an_exchange_inside_another_one_is_an_error(direct: bool) -> None:
    errors: list[BarewireError | None] = []

    def watch(way: str, frame: CanFrame) -> None:
        if way == "sent" and not errors:
            errors.append(None)
            with pytest.raises(BarewireError) as caught:
                client.node().sdo.upload(0x1000)
            errors.append(caught.value)

    with client_on(KeepingPort({READ: [VALUE]}), direct=direct, watch=watch) as client:
        assert client.node().sdo.upload(0x1000) == VALUE.data[4:]
        assert "begun inside another one" in str(errors[1])


def test_a_client_takes_its_subscribers_along(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_base, "_CHANNELS_MAX", 3)
    requests = {CanFrame(0x600 + node, READ.data): [CanFrame(0x580 + node, VALUE.data)] for node in range(1, 20)}
    with CanBus(KeepingPort(requests)) as bus:
        client = CanopenClient(bus)
        for _ in range(2):
            for node in range(1, 20):
                assert client.node(node).sdo.upload(0x1000) == VALUE.data[4:]
        assert 0 < len(bus.subscribers) <= 3
        client.close()
        assert not bus.subscribers


def test_a_subscriber_that_stays_holds_a_limited_number_of_frames() -> None:
    port = KeepingPort({READ: [VALUE]})
    with client_on(port, direct=False) as client:
        sdo = client.node().sdo
        assert sdo.upload(0x1000) == VALUE.data[4:]
        (subscriber,) = client.bus.subscribers
        for _ in range(subscriber.room + 10):
            subscriber.put(VALUE, 0.0)
        assert subscriber.lost == 10
        assert sdo.upload(0x1000) == VALUE.data[4:]


def test_threads_on_one_channel_wait_for_each_other(direct: bool) -> None:
    with client_on(KeepingPort({READ: [VALUE]}), direct=direct) as client:
        values: list[bytes] = []

        def read() -> None:
            for _ in range(100):
                values.append(client.node().sdo.upload(0x1000))

        threads = [threading.Thread(target=read) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60.0)
        assert values == [VALUE.data[4:]] * 400


@pytest.mark.parametrize("name", [name for name in WORLDS if WORLDS[name].client == "asyncio"])
def test_tasks_share_channels_and_the_bus(name: str) -> None:
    async def calls(client: Any, port: Any) -> None:
        reads = [client.node(number).sdo.upload(0x1000) for _ in range(20) for number in range(1, 6)]
        assert await asyncio.gather(*reads) == [VALUE.data[4:]] * 100

    answers = {CanFrame(0x600 + n, READ.data): [CanFrame(0x580 + n, VALUE.data)] for n in range(1, 6)}
    run(WORLDS[name], WORLDS[name].port(answers), calls)


def test_a_client_serves_one_loop_after_the_other_and_leaves_nothing_on_the_bus() -> None:
    with CanBus(KeepingPort({READ: [VALUE]})) as bus:

        async def read(client: AsyncCanopenClient) -> None:
            for _ in range(3):
                assert await client.node().sdo.upload(0x1000) == VALUE.data[4:]

        async def new_client() -> AsyncCanopenClient:
            return AsyncCanopenClient(bus, node=5, timeout=30.0)

        client = asyncio.run(new_client())
        asyncio.run(read(client))
        asyncio.run(read(client))
        assert len(bus.subscribers) == 1
        asyncio.run(client.close())
        assert not bus.subscribers


def test_a_read_asks_the_system_little_more_than_the_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    """A call of the system costs as much as all the rest. One look before a request, one read, and no thread."""
    looks, reads, count = [0], [0], 80
    has_frames, read = PairPort.has_frames, PairPort.receive_any

    def counted_look(self: PairPort) -> bool:
        looks[0] += 1
        return has_frames(self)

    def counted_read(self: PairPort, timeout: float) -> Any:
        reads[0] += 1
        return read(self, timeout)

    monkeypatch.setattr(PairPort, "has_frames", counted_look)
    monkeypatch.setattr(PairPort, "receive_any", counted_read)

    async def calls(client: Any, _: Any) -> None:
        sdo = client.node(5).sdo
        await sdo.upload(0x1000)
        looks[0] = reads[0] = 0
        for _ in range(count):
            await sdo.upload(0x1000)
        assert reads[0] == count
        assert looks[0] <= count + count // 8 + 1
        assert not [thread.name for thread in threading.enumerate() if thread.name.startswith("reader of")]

    run(WORLDS["asyncio, read by the loop"], PairPort({READ: [VALUE]}), calls)
