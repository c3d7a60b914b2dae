"""A subscriber: a port on a shared bus for one thread or task, with the frames that it receives.

        put -->  [ frame | frame | frame | ... room ]  --> pull       one thread or task takes them
                                              12 lost                 counted, and reported as FramesLost

A bounded queue. Its consumer is woken only while it waits, so a burst of frames wakes it once.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self, TypeAlias

from barewire.canopen.frame import CanFrame, ErrorFrame, FdFrame
from barewire.errors import BarewireError, EncodeError, PortError, shown

if TYPE_CHECKING:
    from asyncio import AbstractEventLoop

SUBSCRIBER_ROOM = 4096
"""Frames that a subscriber holds: 32 blocks of an SDO transfer, or a third of a second of a full bus."""
LONGEST_PULL = 86400.0
"""Seconds of the longest single wait."""

Key: TypeAlias = tuple[int, bool]
"""The sender of a frame: (identifier, extended)."""


def _locked() -> threading.Lock:
    """Return a lock that is held: a thread waits for its release, which is twice as quick as an event."""
    lock = threading.Lock()
    lock.acquire()
    return lock


def check_key(key: object) -> Key:
    """Return the key. Raises EncodeError if it is not an identifier with a bool."""
    match key:
        case (int(number), bool(extended)) if 0 <= number <= (0x1FFFFFFF if extended else 0x7FF):
            return number, extended
    example = f"({key}, False)" if isinstance(key, int) else "(0x185, False)"
    raise EncodeError(f"{shown(key)}: expected (identifier, extended), such as {example}")


class FramesLost(NamedTuple):
    """The number of frames that were lost, because the queue was full."""

    frames: int


class BusDown(NamedTuple):
    """The port of the bus failed. Nothing is received or sent until `BusUp`."""

    why: str


class BusUp(NamedTuple):
    """The bus is open again, `after` seconds."""

    after: float


BusItem: TypeAlias = CanFrame | ErrorFrame | FdFrame | FramesLost | BusDown | BusUp


class Arrived(NamedTuple):
    """A received item and its time."""

    item: BusItem
    at: float


class FrameBus(Protocol):
    """The operations of a bus that a subscriber uses."""

    name: str
    subscribers: set[Subscriber]

    def add(self, subscriber: Subscriber, /) -> None: ...

    def remove(self, subscriber: Subscriber, /) -> None: ...

    def send(self, frame: CanFrame, sender: Any = None, /) -> None: ...

    def try_send(self, frame: CanFrame, sender: Any = None, /, *, again: bool = False) -> bool: ...

    def try_send_all(self, frames: Sequence[CanFrame], sender: Any = None, /) -> int: ...

    def read_in_loop(self, loop: AbstractEventLoop, /) -> bool: ...

    def keep_times(self) -> None: ...

    def reads_alone(self, subscriber: Subscriber, /) -> bool: ...

    def read_alone(self, subscriber: Subscriber, timeout: float, /) -> CanFrame | None: ...


def send_each(bus: FrameBus, frames: Sequence[CanFrame], sender: object) -> None:
    """Send frames one after the other, each when the controller has room. Raises PortError."""
    for frame in frames[bus.try_send_all(frames, sender) :]:
        bus.send(frame, sender)


class Subscriber:
    """The port of one thread on a shared bus.

    keys        the (identifier, extended) of the frames that it receives, None for all
    room        how many frames it holds; `lost` counts those for which it had no room
    reports     it also receives `FramesLost` and reports of the controller, and continues when the bus is opened again;
                without, it fails with the bus
    node        its frames are those of a node, not of a client
    alone       the thread that takes its frames may read the bus itself while nobody else listens; frames then wait in
                the port until they are taken, and have the time at which they were taken
    """

    loop: AbstractEventLoop | None = None
    """The event loop in which its frames are taken; None for a thread."""
    machine: object = None
    """The machine that runs on the bus by this subscriber."""

    def __init__(
        self,
        bus: FrameBus,
        keys: Iterable[Key] | None,
        *,
        room: int = SUBSCRIBER_ROOM,
        reports: bool = False,
        node: bool = False,
        alone: bool = False,
    ) -> None:
        self.bus = bus
        self.alone = alone
        self.node = node
        self.keys = None if keys is None else frozenset(keys)
        self.room = room
        self.reports = reports
        self.lost = 0
        self.gap = 0  # how many frames were lost after the last one in the queue
        self.queue: deque[Arrived] = deque()
        self._why: str | None = None
        self._lock = threading.Lock()
        self._waiting = False
        self._woken = _locked()
        bus.add(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # From the bus

    def put(self, item: BusItem, at: float) -> None:
        """Add an item to the queue, or count it as lost."""
        with self._lock:
            if len(self.queue) >= self.room:
                self.lost += 1
                self.gap += 1
                return
            if self.gap and self.reports:
                self.queue.append(Arrived(FramesLost(self.gap), at))
            self.gap = 0
            self.queue.append(Arrived(item, at))
            if not self._waiting:
                return
            self._waiting = False
        self._wake()

    def fail(self, why: str) -> None:
        """End the queue: after its items, `take` raises PortError(why)."""
        with self._lock:
            self._why = self._why or why
            if not self._waiting:
                return
            self._waiting = False
        self._wake()

    def fail_in_child(self, why: str) -> None:
        """The same in a forked process: a thread of the parent may hold the lock, and no thread waits here."""
        self._lock, self._woken = threading.Lock(), _locked()
        self._waiting = False  # to wake a task of the parent's event loop from here would disturb the parent
        self._why = self._why or why

    def _wake(self) -> None:
        self._woken.release()

    # To the consumer

    def take(self, *, wait: bool = False) -> Arrived | None:
        """Return the next item of the queue, or None. Raises PortError if it is empty and the bus failed.

        With `wait`, the next item wakes the consumer.
        """
        with self._lock:
            if self.queue:
                return self.queue.popleft()
            if self.gap and self.reports:
                lost, self.gap = FramesLost(self.gap), 0
                return Arrived(lost, time.monotonic())
            if self._why is not None:
                raise PortError(self._why)
            if wait:
                self._woken.acquire(blocking=False)  # it was released after the last time-out
            self._waiting = wait
            return None

    def pull(self, timeout: float) -> Arrived | None:
        """Return the next item, or None after `timeout` seconds."""
        if self.alone and self.bus.reads_alone(self):
            clock = time.monotonic
            until = clock() + timeout
            while True:
                arrived = self.take()
                if arrived is not None:
                    return arrived
                frame = self.bus.read_alone(self, timeout)
                if frame is not None:
                    return Arrived(frame, clock())
                timeout = until - clock()
                if timeout <= 0.0 or not self.bus.reads_alone(self):
                    break
        arrived = self.take(wait=timeout > 0)
        if arrived is not None or timeout <= 0:
            return arrived
        self._woken.acquire(timeout=min(timeout, LONGEST_PULL))
        return self.take()

    def receive(self, timeout: float) -> CanFrame | None:
        """Return the next frame, or None after `timeout` seconds. A conversation calls it."""
        arrived = self.pull(timeout)
        return None if arrived is None else arrived.item  # type: ignore[return-value]  # without reports only frames

    def send(self, item: CanFrame) -> None:
        """Send a frame. This subscriber does not receive it."""
        self.bus.send(item, self)

    def send_all(self, items: Sequence[CanFrame]) -> None:
        """Send frames one after the other."""
        send_each(self.bus, items, self)

    @property
    def has_failed(self) -> bool:
        """Whether the bus failed, or this was closed."""
        return self._why is not None

    def note_losses(self, error: BarewireError) -> None:
        """Add a note about dropped frames to the error of a conversation."""
        if self.lost:
            error.add_note(f"{self.lost} frames were lost here: they arrived faster than they were taken")

    def close(self) -> None:
        """Leave the bus. `take` raises PortError after the items in the queue."""
        self.bus.remove(self)
        self.fail("this was closed")


class SubscriberTable:
    """The subscribers of a bus, by the identifiers that they receive."""

    def __init__(self) -> None:
        self.subscribers: set[Subscriber] = set()
        # The tuples are replaced, never changed in place: who delivers takes no lock.
        self._by_id: dict[bool, dict[int, tuple[Subscriber, ...]]] = {False: {}, True: {}}
        self._of_all: tuple[Subscriber, ...] = ()

    def register(self, subscriber: Subscriber) -> None:
        """Add a subscriber."""
        self.subscribers.add(subscriber)
        if subscriber.keys is None:
            self._of_all = (*self._of_all, subscriber)
            return
        for identifier, extended in subscriber.keys:
            table = self._by_id[extended]
            table[identifier] = (*table.get(identifier, ()), subscriber)

    def fail_all_in_child(self, why: str) -> None:
        """End the queues of all subscribers in a forked process."""
        for subscriber in tuple(self.subscribers):
            subscriber.fail_in_child(why)

    def unregister(self, subscriber: Subscriber) -> None:
        """Remove a subscriber."""
        self.subscribers.discard(subscriber)
        self._of_all = tuple(other for other in self._of_all if other is not subscriber)
        for identifier, extended in subscriber.keys or ():
            table = self._by_id[extended]
            others = tuple(other for other in table.get(identifier, ()) if other is not subscriber)
            if others:
                table[identifier] = others
            else:
                table.pop(identifier, None)

    def put(self, frame: CanFrame, at: float, sender: object) -> None:
        """Deliver a frame to all subscribers of its identifier but `sender`."""
        for subscriber in self._by_id[frame.extended].get(frame.id, ()):
            if subscriber is not sender:
                subscriber.put(frame, at)
        for subscriber in self._of_all:
            if subscriber is not sender:
                subscriber.put(frame, at)
