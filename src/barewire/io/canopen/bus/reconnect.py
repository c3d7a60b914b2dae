"""Opens the port of a CAN bus again after it failed, with pauses that grow.

        port fails                     conversations raise PortError, streams get BusDown(why)
        closed, pause, opened ...      0.125 s, 0.25 s ... 30 s, each a little different (`engine.backoff`)
        one receive without error      streams get BusUp(seconds); new requests are sent

A bus has frames without requests, so unlike a Modbus connection its port is not opened by the next request but at once.
After an adapter was plugged in again, an interface was set up, or a server restarted, the bus continues by itself. Only
a port that lasted for some seconds resets the pauses; they grow further if it opens and fails at once.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TypeAlias

from barewire.canopen.frame import CanFrame, ErrorFrame, FdFrame
from barewire.errors import EncodeError, PortError, shown
from barewire.io.canopen.bus.subscriber import BusItem, FramesLost
from barewire.io.endpoint import PAUSES
from barewire.io.engine.connections import BackOff
from barewire.io.log import PortLog
from barewire.io.ports.base import Port

Dial: TypeAlias = Callable[[], Port[CanFrame]]
"""A function that opens a port."""

LASTED = 5.0
"""Seconds after which a port that was opened resets the pauses."""
_FIRST_RECEIVE = 0.05
"""Seconds of the first receive, which fails if the interface is down although it could be opened."""


def receiver(port: Port[CanFrame]) -> Callable[[float], BusItem | None]:
    """Return the method that receives from a port, with the reports of the controller if the port has them.

    A port that marks its own frames is read without them: a bus delivers what it sends when it sends it.
    The frames of a port that is not one of `io.ports` are checked: nothing above this checks them again.
    """
    receive: Callable[[float], BusItem | None] = getattr(port, "receive_any", port.receive)
    if leaves_out_own_frames(port):
        receive = port.receive_others  # type: ignore[attr-defined]
    if type(port).__module__.startswith("barewire.io."):
        return receive

    def checked(timeout: float) -> BusItem | None:
        item = receive(timeout)
        if item is None or isinstance(item, (FdFrame, ErrorFrame, FramesLost)):
            return item
        if not isinstance(item, CanFrame) or not isinstance(item.data, (bytes, bytearray)):
            raise PortError(f"{type(port).__name__}.receive returned {shown(item)}: expected a CanFrame, or None")
        try:
            id, data, extended, remote, requested = item
            return CanFrame.checked(id, data, extended=extended, remote=remote, requested=requested)
        except EncodeError as error:
            raise PortError(f"{type(port).__name__}.receive returned a frame that CAN cannot carry: {error}") from None

    return checked


def leaves_out_own_frames(port: Port[CanFrame]) -> bool:
    """Return whether a port returns its own frames, but marks them, so that `receiver` leaves them out."""
    return bool(getattr(port, "own_frames", None)) and hasattr(port, "receive_others")


class Reopening:
    """Opens the port of one bus again. `stop` ends the attempts at any time."""

    def __init__(
        self,
        dial: Dial,
        stop: threading.Event,
        *,
        pauses: tuple[float, float] = PAUSES,
        jitter: Callable[[], float] = random.random,
        log: PortLog | None = None,
    ) -> None:
        first, longest = pauses
        self.back_off = BackOff(jitter, first=first, longest=longest)
        self.stop = stop
        self._dial = dial
        self._log = log
        self._good_from = time.monotonic()

    def reopen(self, port: Port[CanFrame], why: str) -> tuple[Port[CanFrame], BusItem | None] | None:
        """Return a new port in place of this one, and the result of its first receive; None if `stop` was set."""
        clock, back_off = time.monotonic, self.back_off
        if clock() - self._good_from >= LASTED:
            back_off.reset()
        else:
            back_off.failed(clock(), why)
        since = clock()
        pause = back_off.wait(since)
        if self._log is not None:
            self._log.warning("down", f"down: {self._log.short(why)}; opened again after {pause:.2f} s")
        while True:
            with suppress(Exception):  # the port has failed already: an error of its `close` adds nothing
                port.close()
            if self.stop.wait(back_off.wait(clock())):
                return None
            try:
                port = self._dial()
                first = receiver(port)(_FIRST_RECEIVE)
            except Exception as error:
                failure = str(error) or type(error).__name__
                back_off.failed(clock(), failure)
                if self._log is not None:
                    pause = back_off.wait(clock())
                    self._log.info("not opened", f"not opened: {self._log.short(failure)}; next after {pause:.2f} s")
                continue
            if self._log is not None:
                self._log.warning("up", f"up again after {clock() - since:.2f} s")
            self._good_from = clock()
            return port, first


class AwaitedBus:
    """A bus for which others wait while it is being opened again. `failure` is why it is not open."""

    def __init__(self) -> None:
        self.failure: str | None = None
        self._has_ended = False  # failed or closed, and not opened again
        self._waiting: set[Callable[[], None]] = set()
        self._changing = threading.RLock()

    def _wake(self) -> None:
        with self._changing:
            waiting, self._waiting = self._waiting, set()
        for wake in waiting:
            wake()

    def when_open(self, wake: Callable[[], None]) -> bool:
        """Return whether the bus is open, or has ended. If it is neither, `wake` is called when it is."""
        with self._changing:
            if self.failure is None or self._has_ended:
                return True
            self._waiting.add(wake)
            return False

    def cancel_wake(self, wake: Callable[[], None]) -> None:
        """Cancel the `wake` of a call of `when_open`."""
        with self._changing:
            self._waiting.discard(wake)

    def wait_until_open(self, timeout: float) -> None:
        """If the bus is being opened again, wait for it, `timeout` seconds at most."""
        if self.failure is None:
            return
        is_open = threading.Event()
        if not self.when_open(is_open.set):
            is_open.wait(timeout)
            self.cancel_wake(is_open.set)
