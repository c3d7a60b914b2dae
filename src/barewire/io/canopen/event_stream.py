"""Streams: what is heard on a bus, as events, taken when one wants them.

    with client.emergencies() as stream:
        for event in stream:
            match event:
                case EmcyEvent(): ...           what the stream is about
                case Lost(frames): ...          so many frames came while nobody took any, and are gone
                case ErrorFrame(): ...          the controller says something about the bus
            case Gone(why): ...             the port failed, and is being opened anew
            case Back(after): ...           it is there again

A machine listens, and is fed in the thread or task of whoever takes: no callback ever runs in the reader. Frames have
the time at which they came, so taking late changes no event but those of silence.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Generic, Protocol, Self, TypeAlias, TypeVar

from barewire.canopen.frame import CanFrame, ErrorFrame, FdFrame
from barewire.errors import PortError
from barewire.io.canopen.shared_bus import CanBus
from barewire.io.canopen.subscriber import Arrived, BusDown, BusUp, FramesLost, Key, Subscriber, seconds

EventOut = TypeVar("EventOut", covariant=True)
E = TypeVar("E")

ROOM = 1024
"""Frames that a stream holds for somebody who is busy with something else."""

Report: TypeAlias = FramesLost | ErrorFrame | FdFrame | BusDown | BusUp


class Listener(Protocol[EventOut]):
    """A machine that listens."""

    @property
    def deadline(self) -> float | None: ...

    def feed(self, frame: CanFrame | None, now: float) -> Iterable[EventOut]: ...


class Frames:
    """The machine that hears frames and makes nothing of them."""

    deadline = None

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """The frame itself."""
        return [] if frame is None else [frame]


class Events(Generic[E]):
    """What the streams, blocking and asyncio, do between two waits."""

    def __init__(self, machine: Listener[E]) -> None:
        self.machine = machine
        self.ready: deque[E | Report] = deque()

    def wait_until(self, until: float) -> float:
        """When somebody has to look again."""
        deadline = self.machine.deadline
        return until if deadline is None else min(until, deadline)

    def take(self, arrived: Arrived | None, now: float) -> None:
        """What came, or that time has passed."""
        if arrived is None:
            self.ready.extend(self.machine.feed(None, now))
        elif isinstance(arrived.item, CanFrame):
            self.ready.extend(self.machine.feed(arrived.item, arrived.at))
        else:
            self.ready.append(arrived.item)


class Hearing(Generic[E]):
    """What a stream is, for a thread or for a task: a machine, the events that nobody took yet, and a tap."""

    def __init__(self, machine: Listener[E], tap: Subscriber) -> None:
        self.machine = machine
        self._events: Events[E] = Events(machine)
        self._tap = tap
        self._open = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    @property
    def lost(self) -> int:
        """How many frames were lost here, all in all."""
        return self._tap.lost

    def close(self) -> None:
        """Hear no more."""
        self._open = False
        self._tap.close()


class Stream(Hearing[E]):
    """Events of a machine that listens on a bus. For one thread; iterating ends when the stream is closed."""

    def __init__(self, bus: CanBus, machine: Listener[E], keys: Iterable[Key] | None, *, room: int = ROOM) -> None:
        super().__init__(machine, Subscriber(bus, keys, room=room, reports=True))

    def get(self, timeout: float | None = None) -> E | Report | None:
        """The next event within `timeout` seconds, or None; without a time-out, whenever it comes.

        Raises PortError if the bus is gone.
        """
        seconds(timeout)
        events, clock = self._events, time.monotonic
        until = float("inf") if timeout is None else clock() + timeout
        while not events.ready:
            now = clock()
            events.take(self._tap.pull(events.wait_until(until) - now), clock())
            if not events.ready and clock() >= until:
                return None
        return events.ready.popleft()

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
