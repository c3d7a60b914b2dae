"""An exception at any line of an SDO transfer: no wrong value follows, and no lock stays.

A signal handler, Ctrl-C and a lack of memory raise anywhere. Here an exception is raised before each line of barewire
that a transfer executes, at its first and at its last execution (`tests.interrupts`), in virtual time. Then three
further transfers are made with a server that answers late and in order; from another thread, which would hang if a
lock were kept.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import Any

import pytest

from barewire import CanopenClient
from barewire.errors import BarewireError
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
        lines = interrupt(lambda: quietly(lambda: transfers.make(client, X)), at, error=error, skips=is_left_out)

    with suppress(error):
        interrupted()

    def use_on() -> None:
        for index in AFTERWARDS:
            quietly(lambda index=index: transfers.make(client, index))  # type: ignore[misc]
        transfers.can.delay()
        if client.bus.failure is None:  # an Exception while it reads the port ends the bus, with a message
            transfers.make(client, X)

    in_a_thread(use_on)
    if client.bus.failure is None:
        transfers.make(client, Y)
    client.close()
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


def chosen_lines(run: Callable[[None], int]) -> list[int]:
    """Return the numbers of the first and of the last execution of every line of a transfer."""
    EXECUTED.clear()
    run(None)
    first = {line: number for number, line in reversed(list(enumerate(EXECUTED)))}
    latest = {line: number for number, line in enumerate(EXECUTED)}
    return sorted({*first.values(), *latest.values()})


@pytest.mark.long
@pytest.mark.parametrize("delays", DELAYS)
@pytest.mark.parametrize("mode", LENGTHS)
@pytest.mark.parametrize("verb", ["upload", "download"])
def test_an_exception_at_any_line(verb: str, mode: str, delays: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def run(at: int | None) -> int:
        with monkeypatch.context() as patch:
            return blocking_run(Transfers(verb, mode, DELAYS[delays], patch), at, KeyboardInterrupt)

    run(None)  # imports what is loaded when it is needed
    failures: dict[int, str] = {}
    chosen = chosen_lines(run)
    assert len(chosen) > 50
    for at in chosen:
        try:
            run(at)
        except Exception as failure:
            failures[at] = repr(failure)[:200]
    assert not failures, (len(failures), len(chosen), failures)
