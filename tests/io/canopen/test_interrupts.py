"""An exception at any line of an SDO transfer: no wrong value follows, and no lock stays.

A signal handler, Ctrl-C and a lack of memory raise anywhere. Here an exception is raised before each line of barewire
that a transfer executes, one after the other (`tests.interrupts`), in virtual time. Then three further transfers are
made with a server that answers late and in order; from another thread, which would hang if a lock were kept.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest

from barewire import AsyncCanopenClient, CanopenClient
from barewire.errors import BarewireError
from barewire.io.canopen.bus.shared_bus import CanBus
from tests.interrupts import interrupt, leaves_lock
from tests.io.canopen.virtual_can import NumberedStore, VirtualCan, value_of

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
        """Begin a transfer. Return its result, or the coroutine of it, and its check."""
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

    async def make_in_task(self, client: AsyncCanopenClient, index: int) -> None:
        """Make one transfer with the asyncio client."""
        start, check = self.begin(client.node().sdo, index)
        check(await start())


def in_a_thread(work: Callable[[], None]) -> None:
    """Run `work` in another thread, and raise its error."""
    errors: list[BaseException] = []

    def run() -> None:
        try:
            work()
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(10)
    assert not thread.is_alive(), "the channel is not given back"
    if errors:
        raise errors[0]


def blocking_run(transfers: Transfers, at: int | None, error: type[BaseException]) -> int:
    """Play one run, with an exception before the line with the number `at`. Return how many lines there were."""
    client = CanopenClient(transfers.can, node=5, timeout=TIMEOUT)
    transfers.make(client, X)
    transfers.late()
    lines = 0

    def interrupted() -> None:
        nonlocal lines
        lines = interrupt(lambda: quietly(lambda: transfers.make(client, X)), at, error=error, skips=leaves_lock)

    with suppress(error):
        interrupted()

    def use_on() -> None:
        for index in AFTERWARDS:
            quietly(lambda index=index: transfers.make(client, index))  # type: ignore[misc]
        transfers.can.delay()
        transfers.make(client, X)

    in_a_thread(use_on)
    transfers.make(client, Y)
    client.close()
    return lines


def quietly(make: Callable[[], None]) -> None:
    """Make a transfer that may fail."""
    with suppress(BarewireError):
        make()


def asyncio_run(transfers: Transfers, at: int | None, error: type[BaseException]) -> int:
    """The same with an asyncio client: an exception leaves the task, or the event loop, which then runs on."""
    loop = transfers.can.loop()
    client = AsyncCanopenClient(CanBus(transfers.can, lazy=True), node=5, timeout=TIMEOUT)  # closed without a thread

    async def prepare() -> None:
        await transfers.make_in_task(client, X)
        transfers.late()

    async def make(index: int) -> None:
        with suppress(BarewireError):
            await transfers.make_in_task(client, index)

    async def use_on() -> None:
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            task.cancel()
            with suppress(asyncio.CancelledError, error):
                await task
        for index in AFTERWARDS:
            await asyncio.wait_for(make(index), 60)
        transfers.can.delay()
        await asyncio.wait_for(transfers.make_in_task(client, X), 60)
        await client.close()
        client.bus.close()

    lines = 0
    try:
        loop.run_until_complete(prepare())
        with suppress(error):
            lines = interrupt(lambda: loop.run_until_complete(make(X)), at, error=error, skips=leaves_lock)
        loop.run_until_complete(use_on())
    finally:
        loop.close()
    return lines


RUNS = {"blocking": blocking_run, "asyncio": asyncio_run}


# An event loop reports an Exception of a callback and goes on, but Ctrl-C leaves it.
@pytest.mark.parametrize(
    ("world", "error"), [("blocking", KeyboardInterrupt), ("blocking", MemoryError), ("asyncio", KeyboardInterrupt)]
)
@pytest.mark.parametrize("delays", DELAYS)
@pytest.mark.parametrize("mode", LENGTHS)
@pytest.mark.parametrize("verb", ["upload", "download"])
def test_an_exception_at_any_line(
    world: str, verb: str, mode: str, delays: str, error: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(at: int | None) -> int:
        with monkeypatch.context() as patch:
            return RUNS[world](Transfers(verb, mode, DELAYS[delays], patch), at, error)

    run(None)  # imports what is loaded when it is needed
    lines = run(None)
    assert lines > 50
    failures: dict[int, str] = {}
    for at in range(lines):
        try:
            run(at)
        except Exception as failure:
            failures[at] = repr(failure)[:200]
    assert not failures, (len(failures), lines, failures)
