"""Streams: the events of a machine that listens on a bus, taken one by one.

    with bus.emergencies() as stream:
        for event in stream:
            match event:
                case EmcyEvent(): ...           an event of the machine
                case FramesLost(frames): ...    so many frames were lost, because they were not taken in time
                case ErrorFrame(): ...          a report of the CAN controller
                case BusDown(why): ...          the port failed, and is being opened again
                case BusUp(after): ...          it is open again

The machine is fed in the thread or task that takes the events: no callback runs in the reader of the bus. Frames keep
the time at which they arrived, so only events of silence change if they are taken late.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Iterator
from typing import Generic, Protocol, Self, TypeAlias, TypeVar

from barewire.canopen.frame import CanFrame, ErrorFrame, FdFrame
from barewire.errors import PortError
from barewire.io.canopen.bus.subscriber import (
    LONGEST_PULL,
    Arrived,
    BusDown,
    BusUp,
    FrameBus,
    FramesLost,
    Key,
    Subscriber,
)
from barewire.io.endpoint import check_timeout

E_co = TypeVar("E_co", covariant=True)
E = TypeVar("E")

STREAM_ROOM = 1024
"""Frames that a stream holds until they are taken."""

Report: TypeAlias = FramesLost | ErrorFrame | FdFrame | BusDown | BusUp


class Listener(Protocol[E_co]):
    """A machine that listens."""

    @property
    def deadline(self) -> float | None: ...

    def feed(self, frame: CanFrame | None, now: float) -> Iterable[E_co]: ...


class FrameListener:
    """The machine whose events are the frames themselves."""

    deadline = None

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Return the frame."""
        return [] if frame is None else [frame]


class StreamBase(Generic[E]):
    """The base class of streams: a machine, its events that were not taken yet, and a subscriber."""

    def __init__(self, machine: Listener[E], subscriber: Subscriber) -> None:
        self.machine = machine
        self._ready: deque[E | Report] = deque()
        self._subscriber = subscriber
        self._open = True

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {type(self.machine).__name__} on {self._subscriber.bus.name}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def lost(self) -> int:
        """The number of frames that were lost here."""
        return self._subscriber.lost

    def close(self) -> None:
        """Receive no more."""
        self._open = False
        self._subscriber.close()

    def _wait_until(self, until: float) -> float:
        """Return when the machine has to be fed again, at the latest `until`."""
        deadline = self.machine.deadline
        return until if deadline is None else min(until, deadline)

    def _feed(self, arrived: Arrived | None, now: float) -> None:
        """Feed the machine with a frame, or with the time if nothing arrived."""
        if arrived is None:
            self._ready.extend(self.machine.feed(None, now))
        elif isinstance(arrived.item, CanFrame):
            self._ready.extend(self.machine.feed(arrived.item, arrived.at))
        else:
            self._ready.append(arrived.item)


class Stream(StreamBase[E]):
    """The events of a machine that listens on a bus, for one thread. Iteration ends when the stream is closed."""

    def __init__(
        self, bus: FrameBus, machine: Listener[E], keys: Iterable[Key] | None, *, room: int = STREAM_ROOM
    ) -> None:
        is_plain = isinstance(machine, FrameListener)  # frames without time, which are the events
        super().__init__(machine, Subscriber(bus, keys, room=room, reports=True, alone=is_plain))
        self._read_alone = bus.read_alone if is_plain else None

    def get(self, timeout: float | None = None) -> E | Report | None:
        """Return the next event, or None after `timeout` seconds. Without a time-out it waits for ever.

        Raises PortError if the bus is closed.
        """
        is_number = timeout is None or (timeout.__class__ is float and timeout >= 0.0)
        if is_number and self._read_alone is not None and not self._ready:
            frame = self._read_alone(self._subscriber, LONGEST_PULL if timeout is None else timeout)
            if frame is not None:
                return frame  # type: ignore[return-value]
        check_timeout(timeout)
        clock = time.monotonic
        until = float("inf") if timeout is None else clock() + timeout
        while not self._ready:
            now = clock()
            self._feed(self._subscriber.pull(self._wait_until(until) - now), clock())
            if not self._ready and clock() >= until:
                return None
        return self._ready.popleft()

    def __iter__(self) -> Iterator[E | Report]:
        while True:
            try:
                event = self.get()
            except PortError:
                if self._open:
                    raise
                return
            assert event is not None
            yield event
