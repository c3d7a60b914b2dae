"""Expedited transfers of the asyncio client without a conversation, on ports that a loop reads or a thread."""

from __future__ import annotations

import asyncio
import re
import socket
import struct
import threading
from collections.abc import Awaitable, Callable, Coroutine
from functools import partial
from typing import Any

import pytest

from barewire import AsyncCanopenClient
from barewire.canopen import CanFrame
from barewire.errors import BarewireError, NoAnswer, PortError
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.socketcan import SocketCanPort
from tests.io.canopen.test_direct import KeepingPort
from tests.io.canopen.test_fast_path import DONE, IRREGULAR, READ, VALUE, WRITE, ignore, note_sent

Answers = dict[CanFrame, list[CanFrame]]
Main = Callable[[AsyncCanopenClient, Any], Coroutine[Any, Any, None]]


class PairPort(SocketCanPort):
    """A port on one end of a socket pair. What it sends is answered at once."""

    def __init__(self, answers: Answers | None = None) -> None:
        ours, self.other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        super().__init__(Endpoint.parse("can://socketcan/pair"), opened=ours)
        self.answers = answers or {}
        self.attempts = 2  # without room are those before the second

    def arrive(self, *frames: CanFrame) -> None:
        for frame in frames:
            identifier = frame.id | frame.extended << 31
            self.other.send(struct.pack("=IB3x8s", identifier, len(frame.data), frame.data))

    def try_send(self, item: CanFrame) -> bool:
        self.attempts += 1
        if self.attempts > 2:
            self.arrive(*self.answers.get(item, ()))
        return self.attempts > 2

    def close(self) -> None:
        super().close()
        self.other.close()


@pytest.fixture(params=[PairPort, KeepingPort], ids=["read by the loop", "read by a thread"])
def port(request: pytest.FixtureRequest) -> Any:
    return request.param()


def run(port: Any, main: Main) -> None:
    """Run `main` with a client on a bus of this port."""

    async def with_client() -> None:
        with CanBus(port, lazy=isinstance(port, PairPort)) as bus:
            async with AsyncCanopenClient(bus, node=5, timeout=5.0) as client:
                await main(client, port)

    asyncio.run(with_client())


def test_expedited_transfers_need_no_conversation(port: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    async def refuse(*arguments: object) -> Any:
        raise AssertionError(f"a conversation: {arguments}")

    monkeypatch.setattr("barewire.io.canopen.async_client.run", refuse)
    port.answers = {READ: [CanFrame(0x185), CanFrame.parse("706#05"), VALUE], WRITE: [DONE]}

    async def main(client: AsyncCanopenClient, port: Any) -> None:
        sdo = client.node().sdo
        for _ in range(3):
            assert await sdo.upload(0x1000) == VALUE.data[4:]
            await sdo.download(0x1000, 0, b"\x0f\x00")
        assert client.channel().counters.responses == 1
        assert client.channel().total.responses == 5
        assert client.bus.monitor.count(0x706) == 3

    run(port, main)


async def outcome(coming: Awaitable[Any]) -> object:
    try:
        return await coming
    except BarewireError as error:
        return type(error), re.sub(r"[\d.]+ s ago", "some time ago", str(error))


@pytest.mark.parametrize("second", ["good", "nothing"])
@pytest.mark.parametrize("first", IRREGULAR)
@pytest.mark.parametrize("verb", ["upload", "download"])
@pytest.mark.parametrize("kind", [PairPort, KeepingPort])
def test_whatever_is_irregular_ends_as_in_the_conversation(
    kind: type[PairPort | KeepingPort], verb: str, first: str, second: str
) -> None:
    good = VALUE if verb == "upload" else DONE
    frames = [CanFrame.parse(IRREGULAR[first])] if IRREGULAR[first] else []
    frames += [good] if second == "good" else []
    found: list[object] = []

    async def main(client: AsyncCanopenClient, port: Any, progress: Any) -> None:
        sent = list[CanFrame]()
        client.bus._watch = partial(note_sent, sent)
        sdo = client.node(timeout=0.05).sdo
        read, write = partial(sdo.upload, 0x1000), partial(sdo.download, 0x1000, 0, b"\x0f\x00")
        result = await outcome((read if verb == "upload" else write)(progress=progress))
        channel = client.channel()
        counted = repr(channel.counters), channel.quiet_until is None, channel.abandoned, channel.busy
        found.append((result, sent, counted))

    for progress in (None, ignore):
        run(kind({READ: frames, WRITE: frames}), partial(main, progress=progress))
    assert found[0] == found[1]


def test_a_frame_that_waits_is_not_the_answer_of_a_later_request(port: Any) -> None:
    port.answers = {READ: [VALUE]}

    async def main(client: AsyncCanopenClient, port: Any) -> None:
        for _ in range(3):
            assert await client.node().sdo.upload(0x1000) == VALUE.data[4:]
            before = client.bus.monitor.frames
            port.arrive(CanFrame.parse("585#4300100000000000"), CanFrame.parse("705#05"))
            while isinstance(port, KeepingPort) and client.bus.monitor.frames < before + 2:
                await asyncio.sleep(0)

    run(port, main)


def test_a_device_that_is_slow_has_its_whole_time_out(port: Any) -> None:
    async def main(client: AsyncCanopenClient, port: Any) -> None:
        sdo = client.node().sdo
        with pytest.raises(NoAnswer):
            await sdo.upload(0x1001, timeout=0.01)
        client.channel().be_settled()
        asyncio.get_running_loop().call_later(0.1, port.arrive, VALUE)
        assert await sdo.upload(0x1000) == VALUE.data[4:]
        with pytest.raises(NoAnswer, match=r"within 0\.05 s.* nothing at all on the bus meanwhile"):
            await sdo.upload(0x1000, timeout=0.05)
        assert client.channel().quiet_until is not None

    run(port, main)


def test_a_cancelled_task_sends_an_abort_and_the_late_answer_is_discarded(port: Any) -> None:
    async def main(client: AsyncCanopenClient, port: Any) -> None:
        sent, asked = list[CanFrame](), asyncio.Event()

        def watch(way: str, frame: CanFrame) -> None:
            if way == "sent":
                sent.append(frame)
                asked.set()

        client.bus._watch = watch
        task = asyncio.create_task(client.node().sdo.upload(0x1000))
        await asked.wait()
        await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert sent == [READ, CanFrame.parse("605#8000100000000008")]
        assert client.channel().abandoned == (0x1000, 0)
        port.answers = {READ: [VALUE]}
        port.arrive(CanFrame.parse("585#4300100000000000"))
        assert await client.node().sdo.upload(0x1000) == VALUE.data[4:]

    run(port, main)


def test_a_request_waits_for_room() -> None:
    port = PairPort({READ: [VALUE]})
    port.attempts = 0

    async def main(client: AsyncCanopenClient, port: Any) -> None:
        assert await client.node().sdo.upload(0x1000) == VALUE.data[4:]

    run(port, main)


def test_tasks_share_channels_and_the_bus(port: Any) -> None:
    port.answers = {CanFrame(0x600 + n, READ.data): [CanFrame(0x580 + n, VALUE.data)] for n in range(1, 6)}

    async def main(client: AsyncCanopenClient, port: Any) -> None:
        nodes = [client.node(number) for number in range(1, 6)] * 20
        assert await asyncio.gather(*(node.sdo.upload(0x1000) for node in nodes)) == [VALUE.data[4:]] * 100

    run(port, main)


def test_a_bus_that_failed_ends_an_exchange_and_the_next_ones() -> None:
    port = KeepingPort({READ: [PortError("unplugged")]})  # type: ignore[list-item]

    async def main(client: AsyncCanopenClient, port: Any) -> None:
        for _ in range(2):
            with pytest.raises(PortError, match="unplugged"):
                await client.node().sdo.upload(0x1000)

    run(port, main)


def test_a_client_serves_one_loop_after_the_other_and_leaves_nothing_on_the_bus() -> None:
    with CanBus(KeepingPort({READ: [VALUE]})) as bus:

        async def read(client: AsyncCanopenClient) -> None:
            for _ in range(3):
                assert await client.node().sdo.upload(0x1000) == VALUE.data[4:]

        async def made() -> AsyncCanopenClient:
            return AsyncCanopenClient(bus, node=5, timeout=5.0)

        client = asyncio.run(made())
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

    async def main(client: AsyncCanopenClient, _: Any) -> None:
        sdo = client.node(5).sdo
        await sdo.upload(0x1000)
        looks[0] = reads[0] = 0
        for _ in range(count):
            await sdo.upload(0x1000)
        assert reads[0] == count
        assert looks[0] <= count + count // 8 + 1
        assert not [thread.name for thread in threading.enumerate() if thread.name.startswith("reader of")]

    run(PairPort({READ: [VALUE]}), main)
