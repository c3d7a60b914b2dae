"""A tap: what one hearer has of a bus that many share, as a port of its own.

        put -->  [ frame | frame | frame | ... room ]  --> pull       one thread or task takes
                                              12 lost                 counted, and told to those who want to know

A bounded queue with a bell. The bell rings only where somebody waits, so a burst wakes its hearer once.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterable
from types import TracebackType
from typing import TYPE_CHECKING, NamedTuple, Self, TypeAlias

from barewire.canopen.frame import CanFrame, ErrorFrame, FdFrame
from barewire.errors import BarewireError, EncodeError, PortError

if TYPE_CHECKING:
    from barewire.io.canopen.shared_bus import CanBus

ROOM = 4096
"""Frames that a tap holds: 32 blocks of an SDO transfer, or a third of a second of a full bus."""
LONGEST = 86400.0
"""Seconds of the longest wait in one piece."""

Key: TypeAlias = tuple[int, bool]
"""Who speaks: (identifier, extended)."""


def seconds(timeout: float | None) -> None:
    """EncodeError for a time-out that would never be over (nan), or was over before it began."""
    if timeout is not None and not timeout >= 0:
        raise EncodeError(f"time-out {timeout} s: expected 0 or more")


class FramesLost(NamedTuple):
    """So many frames came here that nobody took in time; they are gone."""

    frames: int


class BusDown(NamedTuple):
    """The port of the bus failed: nothing comes and nothing goes until `BusUp`."""

    why: str


class BusUp(NamedTuple):
    """The bus is there again, after so many seconds."""

    after: float


Item: TypeAlias = CanFrame | ErrorFrame | FdFrame | FramesLost | BusDown | BusUp


class Arrived(NamedTuple):
    """What came, and when."""

    item: Item
    at: float


_arrived = tuple.__new__  # what Arrived(...) comes to, without the function around it: once for each frame


class Subscriber:
    """What one hearer has of a bus: a port of its own. One thread takes from it.

    `keys` are the identifiers it hears, None for all. `lost` counts what it had no room for. With `reports` it hears
    of losses and of the controller too, and outlasts a bus that is opened anew; without, it fails with it. `node` says
    that a node speaks here, and not somebody who asks nodes.
    """

    def __init__(
        self,
        bus: CanBus,
        keys: Iterable[Key] | None,
        *,
        room: int = ROOM,
        reports: bool = False,
        node: bool = False,
    ) -> None:
        self.bus = bus
        self.node = node
        self.keys = None if keys is None else frozenset(keys)
        self.room = room
        self.reports = reports
        self.lost = 0
        self._gap = 0  # of the lost ones, those behind the last that is held
        self._held: deque[Arrived] = deque()
        self._why: str | None = None
        self._lock = threading.Lock()
        self._waiting = False
        self._bell = threading.Lock()
        self._bell.acquire()
        bus.add(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    # From the bus

    def put(self, item: Item, at: float) -> None:
        """Something came."""
        with self._lock:
            if len(self._held) >= self.room:
                self.lost += 1
                self._gap += 1
                return
            if self._gap and self.reports:
                self._held.append(Arrived(FramesLost(self._gap), at))
            self._gap = 0
            self._held.append(_arrived(Arrived, (item, at)))
            if not self._waiting:
                return
            self._waiting = False
        self._ring()

    def fail(self, why: str) -> None:
        """Nothing will come any more: told after what came before."""
        with self._lock:
            self._why = self._why or why
            if not self._waiting:
                return
            self._waiting = False
        self._ring()

    def _ring(self) -> None:
        self._bell.release()

    # To the hearer

    def take(self, *, wait: bool = False) -> Arrived | None:
        """What is here already. PortError if nothing is and nothing will come. `wait`: ring when something comes."""
        with self._lock:
            if self._held:
                return self._held.popleft()
            if self._gap and self.reports:
                lost, self._gap = FramesLost(self._gap), 0
                return Arrived(lost, time.monotonic())
            if self._why is not None:
                raise PortError(self._why)
            self._waiting = wait
            return None

    def pull(self, timeout: float) -> Arrived | None:
        """What came within `timeout` seconds, or None."""
        arrived = self.take(wait=timeout > 0)
        if arrived is not None or timeout <= 0:
            return arrived
        try:
            rang = self._bell.acquire(timeout=min(timeout, LONGEST))
        except BaseException:
            rang = False
            raise
        finally:
            with self._lock:
                if not rang and not self._waiting:
                    self._bell.acquire()  # it rang at the last moment
                self._waiting = False
        return self.take()

    def receive(self, timeout: float) -> CanFrame | None:
        """The port of a conversation: a frame that came within `timeout` seconds, or None."""
        arrived = self.pull(timeout)
        return None if arrived is None else arrived.item  # type: ignore[return-value]  # without reports only frames

    def send(self, item: CanFrame) -> None:
        """Hand a frame to the bus. It is not heard here again."""
        self.bus.send(item, self)

    def tell(self, error: BarewireError) -> None:
        """Add to an error that a conversation raised here what it could not know: that not all came to it."""
        if self.lost:
            error.add_note(f"{self.lost} frames had come that nobody took in time, and were lost")

    def close(self) -> None:
        """Hear no more."""
        self.bus.remove(self)
        self.fail("this was closed")
