"""An exception at any line of an SDO transfer: no wrong value follows, and no lock stays.

A signal handler, Ctrl-C and a lack of memory raise anywhere. Here an exception is raised before each line of barewire
that a transfer executes, at its first and at its last execution (`tests.interrupts`), in virtual time. Then three
further transfers are made with a server that answers late and in order; of the blocking client from another thread,
which would hang if a lock were kept. `make test` raises at every 24th of these lines, with asyncio each of two
exceptions at every 48th, `make proof` at each."""

from __future__ import annotations

import asyncio
import gc
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import Any

import pytest

from barewire import AsyncCanopenClient, CanopenClient
from barewire.canopen import CanFrame
from barewire.canopen.channel_locks import ChannelLock
from barewire.errors import BarewireError
from barewire.io.canopen.bus.async_bus import AsyncStream
from barewire.io.canopen.client import channels_locked
from tests.helpers import part_or_whole
from tests.interrupts import Interrupt, check_lines, in_a_thread, interrupt, leaves_lock
from tests.io.canopen.virtual_can import Coming, NumberedStore, VirtualCan, value_of

# An exception raised while a generator is freed is only reported.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")

TIMEOUT = 0.3
X, Y = 0x2100, 0x2101
LENGTHS = {"expedited": 4, "segments": 20, "blocks": 20}
DELAYS = {
    "a prompt server": (),
    "a late server": (0.2, 0.2, 0.25, 0.1),
    "one response after the time-out": (0.5, 0.2, 0.2),
}
"""The delays of requests (of downloads) or responses (of uploads), in their order."""
AFTERWARDS = (X, Y, X)


class Transfers:
    """The transfers of one run, and the check of each: its own object, and not before it began."""

    def __init__(self, verb: str, mode: str, delays: tuple[float, ...], patch: pytest.MonkeyPatch) -> None:
        self.verb, self.block, self.length = verb, mode == "blocks", LENGTHS[mode]
        self.store = NumberedStore(self.length)
        self.can = VirtualCan(self.store, holds_requests=verb == "download")
        self.can.set_clocks(patch)
        self._delays = delays
        self._number = 1000

    def late(self) -> None:
        """Delay the exchanges from now on."""
        self.can.delay(*self._delays)

    def begin(self, sdo: Any, index: int) -> tuple[Any, Callable[[Any], None]]:
        """Begin a transfer. Return what starts it, and its check."""
        if self.verb == "upload":
            before = self.store.reads

            def check_value(data: bytes) -> None:
                fresh = [value_of(index, number, self.length) for number in range(before + 1, self.store.reads + 1)]
                assert data in fresh, (data.hex(" "), before)

            return lambda: sdo.upload(index, block=self.block), check_value
        self._number += 1
        data = value_of(index, self._number, self.length)

        def check_written(_: None) -> None:
            assert self.store.objects[index, 0] == data, "confirmed, and not written"

        return lambda: sdo.download(index, 0, data, block=self.block), check_written

    def make(self, client: CanopenClient, index: int) -> None:
        """Make one transfer with the blocking client."""
        start, check = self.begin(client.node().sdo, index)
        check(start())


def blocking_run(transfers: Transfers, at: int | None, error: type[BaseException]) -> int:
    """Play one run, with an exception before the line with the number `at`. Return how many lines there were."""
    client = CanopenClient(transfers.can, node=5, timeout=TIMEOUT)
    transfers.make(client, X)
    transfers.late()
    lines = 0

    def interrupted() -> None:
        nonlocal lines
        lines = interrupt(lambda: quietly(lambda: transfers.make(client, X)), at, error=error, skips=is_left_out)

    with suppress(error):
        interrupted()

    def use_on() -> None:
        for index in AFTERWARDS:
            quietly(lambda index=index: transfers.make(client, index))  # type: ignore[misc]
        transfers.can.delay()
        if client.bus.failure is None:  # an Exception while it reads the port ends the bus, with a message
            transfers.make(client, X)

    in_a_thread(use_on, 10, "the channel")
    if client.bus.failure is None:
        transfers.make(client, Y)
    client.close()
    return lines


def asyncio_run(transfers: Transfers, at: int | None, error: type[BaseException]) -> int:
    """The same with an asyncio client: an exception ends the task, a callback or the event loop, which then runs on."""

    async def make(client: AsyncCanopenClient, index: int) -> None:
        start, check = transfers.begin(client.node().sdo, index)
        with suppress(BarewireError):
            check(await start())

    async def use_on(client: AsyncCanopenClient) -> None:
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            task.cancel()
            with suppress(asyncio.CancelledError, error):
                await task
        for index in AFTERWARDS:
            await asyncio.wait_for(make(client, index), 60)
        transfers.can.delay()
        if client.bus.failure is None:
            start, check = transfers.begin(client.node().sdo, Y)
            check(await asyncio.wait_for(start(), 60))

    async def new_client() -> AsyncCanopenClient:
        client = AsyncCanopenClient(transfers.can, node=5, timeout=TIMEOUT)
        await make(client, X)
        return client

    loop, lines = transfers.can.loop(), 0
    try:
        client = loop.run_until_complete(new_client())
        transfers.late()

        def transfer() -> None:
            task = loop.create_task(make(client, X))
            loop.run_until_complete(asyncio.wait({task}, timeout=60))

        def interrupted() -> None:
            nonlocal lines
            lines = interrupt(transfer, at, error=error, skips=is_left_out)

        with suppress(error):
            interrupted()
        loop.run_until_complete(use_on(client))
        client.bus.close()
    finally:
        loop.close()
    return lines


def quietly(make: Callable[[], None]) -> None:
    """Make a transfer that may fail."""
    with suppress(BarewireError):
        make()


EXECUTED: list[tuple[str, int]] = []
"""The lines of the last interrupted transfer."""


def is_left_out(frame: FrameType) -> bool:
    """Return whether no exception is raised at this line, see `leaves_lock`. Otherwise note the line."""
    code = frame.f_code
    if leaves_lock(code, frame.f_lasti, frame.f_lineno):
        return True
    EXECUTED.append((code.co_filename, frame.f_lineno))
    return False


def chosen_lines(run: Callable[[int | None], int]) -> list[int]:
    """Return the numbers of the first and of the last execution of every line of a transfer."""
    EXECUTED.clear()
    run(None)
    first = {line: number for number, line in reversed(list(enumerate(EXECUTED)))}
    latest = {line: number for number, line in enumerate(EXECUTED)}
    return sorted({*first.values(), *latest.values()})


def check_chosen_lines(run: Callable[[int | None], int], step: int, name: str, *, lines: int = 50) -> None:
    """Play a run with an exception at every `step`th of the chosen lines, of which there are more than `lines`."""
    run(None)  # imports what is loaded when it is needed
    chosen = chosen_lines(run)
    assert len(chosen) > lines
    check_lines(run, chosen, step, name)


@pytest.mark.parametrize("step", part_or_whole(24, 1))
@pytest.mark.parametrize("delays", DELAYS)
@pytest.mark.parametrize("mode", LENGTHS)
@pytest.mark.parametrize("verb", ["upload", "download"])
def test_an_exception_at_any_line(
    verb: str, mode: str, delays: str, step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(at: int | None) -> int:
        with monkeypatch.context() as patch:
            return blocking_run(Transfers(verb, mode, DELAYS[delays], patch), at, KeyboardInterrupt)

    check_chosen_lines(run, step, f"{verb} {mode} {delays}")


# An event loop reports an Exception of a callback and goes on, but Ctrl-C leaves it.
@pytest.mark.parametrize("step", part_or_whole(48, 1))
@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
@pytest.mark.parametrize("delays", DELAYS)
@pytest.mark.parametrize("mode", LENGTHS)
@pytest.mark.parametrize("verb", ["upload", "download"])
def test_an_exception_at_any_line_of_asyncio(
    verb: str, mode: str, delays: str, error: type[BaseException], step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(at: int | None) -> int:
        with monkeypatch.context() as patch:
            return asyncio_run(Transfers(verb, mode, DELAYS[delays], patch), at, error)

    check_chosen_lines(run, step, f"{verb} {mode} {delays} {error}")
    gc.collect()  # a coroutine that was not awaited is reported here, not in the next test


def test_a_stream_of_asyncio_goes_on_after_an_exception_while_a_frame_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """No later frame waits for a time-out: the port tells the event loop of it again."""

    def run(at: int | None) -> int:
        can = VirtualCan(NumberedStore(4))
        with monkeypatch.context() as patch:
            can.set_clocks(patch)
            loop, lines = can.loop(), 0

            async def frames() -> AsyncStream[CanFrame]:
                return AsyncCanopenClient(can).frames()

            def arrive(number: int) -> None:
                can.coming.append(Coming(can.now + 0.1, CanFrame(0x185, bytes((number,)))))

            def interrupted() -> None:
                nonlocal lines
                lines = interrupt(lambda: loop.run_until_complete(asyncio.sleep(0.2)), at, skips=is_left_out)

            try:
                stream = loop.run_until_complete(frames())
                arrive(1)
                with suppress(Interrupt):
                    interrupted()
                arrive(2)
                until = can.now + 0.2
                while loop.run_until_complete(stream.get(60.0)) != CanFrame(0x185, b"\2"):
                    assert can.now < until
                assert can.now < until, "it was found at the time-out"
            finally:
                loop.close()
        return lines

    check_chosen_lines(run, 1, "", lines=20)


class TwiceWaking:
    """The locks of a bus whose lock is free at once; an exception came after the first wake."""

    def request_lock(self, lock: ChannelLock) -> None:
        """Wake who waits, as a release does that is completed after an exception."""
        lock.wake()
        lock.wake()

    def release_lock(self, lock: ChannelLock) -> None:
        """Do nothing."""


def test_a_thread_that_waits_for_a_channel_may_be_woken_twice() -> None:
    with channels_locked(TwiceWaking(), None):  # type: ignore[arg-type]
        pass


# A response that comes after a scan has ended -------------------------------------------------------------------------

DEVICE_TYPE = 0x1000


@pytest.mark.parametrize("end", ["its time is over", "its progress function raises"])
@pytest.mark.parametrize("delay", [0.15, 0.35, 0.5])
def test_a_late_device_type(delay: float, end: str, monkeypatch: pytest.MonkeyPatch) -> None:
    can = VirtualCan(NumberedStore(4))
    can.set_clocks(monkeypatch)

    def progress(node: int, _: object) -> None:
        if node == 6 and end != "its time is over":
            raise KeyboardInterrupt

    with CanopenClient(can, node=5, timeout=0.3) as client:
        can.delay(delay)
        if end == "its time is over":
            assert list(client.scan([5], timeout=0.1, progress=progress).nodes) == []
        else:
            with pytest.raises(KeyboardInterrupt):
                client.scan([5, 6], timeout=0.1, progress=progress)
        assert client.node().sdo.upload(DEVICE_TYPE) == value_of(DEVICE_TYPE, 2, 4)
