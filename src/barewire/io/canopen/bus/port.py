"""The port of a CAN bus: how it is read, how it is opened again after it failed, and how a live bus is listened to.

        port fails                     conversations raise PortError, streams get BusDown(why)
        closed, pause, opened ...      0.125 s, 0.25 s ... 30 s, each a little different (`engine.connections`)
        one receive without error      streams get BusUp(seconds); new requests are sent

A bus has frames without requests, so unlike a Modbus connection its port is not opened by the next request but at once.
After an adapter was plugged in again, an interface was set up, or a server restarted, the bus continues by itself. Only
a port that lasted for some seconds resets the pauses; they grow further if it opens and fails at once.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TypeAlias

from barewire.canopen.frame import AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.errors import EncodeError, PortError, shown
from barewire.io.canopen.bus.subscriber import BusItem, FramesLost
from barewire.io.endpoint import PAUSES, Endpoint
from barewire.io.engine.connections import BackOff
from barewire.io.log import PortLog
from barewire.io.ports.base import Port

Dial: TypeAlias = Callable[[], Port[CanFrame]]
"""A function that opens a port."""

LASTED = 5.0
"""Seconds after which a port that was opened resets the pauses."""
_FIRST_RECEIVE = 0.05
"""Seconds of the first receive, which fails if the interface is down although it could be opened."""
_CHECK_INTERVAL = 0.1
"""Seconds between two checks of `listen_can` whether to stop."""


def inside_one_process(place: str) -> str:
    """Return a remark on a bus that other processes cannot reach; an empty text for any other bus."""
    interface = place.partition("/")[0]
    return f"can://{interface} is inside one process" if interface in ("memory", "virtual") else ""


def check_port(port: object, expected: str) -> None:
    """Raise EncodeError for an object that is not a port."""
    if isinstance(port, type) or not (hasattr(port, "send") and hasattr(port, "receive")):
        raise EncodeError(f"{shown(port)}: expected {expected}")


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
    """Opens the port of one bus again. `stopped_in(seconds)` waits so long at most, and returns whether to give up."""

    def __init__(
        self,
        dial: Dial,
        stopped_in: Callable[[float], bool],
        *,
        pauses: tuple[float, float] = PAUSES,
        jitter: Callable[[], float] = random.random,
        log: PortLog | None = None,
    ) -> None:
        first, longest = pauses
        self.back_off = BackOff(jitter, first=first, longest=longest)
        self._stopped_in = stopped_in
        self._dial = dial
        self._log = log
        self._good_from = time.monotonic()

    def reopen(self, port: Port[CanFrame], why: str) -> tuple[Port[CanFrame], BusItem | None] | None:
        """Return a new port in place of this one, and the result of its first receive; None if it was given up."""
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
            if self._stopped_in(back_off.wait(clock())):
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


def listen_can(
    endpoint: Endpoint, stop: threading.Event, *, seconds: float | None = None
) -> Iterator[tuple[float, AnyFrame | None]]:
    """Yield the frames of a live bus with their times, in seconds since 1970; every 0.1 s without a frame a time and
    None. The port is read and never written to.

    A CAN controller acknowledges the frames that it receives, unless it is in listen-only mode. That makes a difference
    on a bus with a single other node. Interfaces that have this mode have an option for it in python-can.

    Raises PortError for a bus that cannot be opened, or fails.
    """
    from barewire.io.ports.can.interfaces import can_port

    port = can_port(endpoint, stamps=True)
    start = time.time() - time.monotonic()
    until = float("inf") if seconds is None else time.monotonic() + seconds
    try:
        while not stop.is_set() and (now := time.monotonic()) < until:
            frame = port.receive_any(min(_CHECK_INTERVAL, until - now))
            at = None if frame is None else getattr(port, "received_at", None)
            yield start + time.monotonic() if at is None else at, frame
    finally:
        port.close()
