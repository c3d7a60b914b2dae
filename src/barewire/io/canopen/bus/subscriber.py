"""The receivers of the frames of a shared bus: subscribers, for one thread each, and streams of events.

        put -->  [ frame | frame | frame | ... room ]  --> pull       one thread or task takes them
                                              12 lost                 counted, and reported as FramesLost

A bounded queue. Its consumer is woken only while it waits, so a burst of frames wakes it once. A stream feeds a machine
with them, and its events are taken one by one:

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

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, Protocol, Self, TypeAlias, TypeVar

from barewire.canopen.frame import CanFrame, ErrorFrame, FdFrame
from barewire.errors import BarewireError, EncodeError, PortError, shown
from barewire.io.endpoint import check_wait
from barewire.io.ports.base import Port

if TYPE_CHECKING:
    from asyncio import AbstractEventLoop

E_co = TypeVar("E_co", covariant=True)
E = TypeVar("E")

SUBSCRIBER_ROOM = 4096
"""Frames that a subscriber holds: 32 blocks of an SDO transfer, or a third of a second of a full bus."""
STREAM_ROOM = 1024
"""Frames that a stream holds until they are taken."""
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
    """The operations of `CanBus` that subscribers and the other files here use."""

    name: str
    port: Port[CanFrame]
    subscribers: set[Subscriber]
    failure: str | None
    has_frames: Callable[[], bool] | None
    reading: threading.Lock

    @property
    def has_reader(self) -> bool: ...

    @property
    def loop_reader(self) -> object: ...

    def add(self, subscriber: Subscriber, /) -> None: ...
    def remove(self, subscriber: Subscriber, /) -> None: ...
    def subscribe_instead(self, keys: frozenset[Key] | None, /) -> Subscriber: ...
    def send(self, frame: CanFrame, sender: Any = None, /) -> None: ...
    def try_send(self, frame: CanFrame, sender: Any = None, /, *, again: bool = False) -> bool: ...
    def try_send_all(self, frames: Sequence[CanFrame], sender: Any = None, /) -> int: ...
    def read_now(self, timeout: float, /) -> BusItem | None: ...
    def take(self, item: BusItem, /) -> bool: ...
    def deliver(self, item: BusItem, at: float, /) -> bool: ...
    def report_losses(self) -> None: ...
    def read_in_loop(self, loop: AbstractEventLoop, /) -> bool: ...
    def keep_times(self) -> None: ...
    def reads_alone(self, subscriber: Subscriber, /) -> bool: ...
    def read_alone(self, subscriber: Subscriber, timeout: float, /) -> CanFrame | None: ...
    def fail_directly(self, why: str, /) -> None: ...
    def end_direct(self, direct: Any, /) -> None: ...
    def wait_until_open(self, timeout: float, /) -> None: ...
    def close(self) -> None: ...


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
    alone       the thread that takes its frames may read the bus itself while nothing else listens; frames then wait in
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
        self._wake()  # without the lock, which the consumer takes at once

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
        self._woken.acquire(timeout=min(timeout, LONGEST_PULL))  # without end is `inf`, which a lock does not take
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


class ChannelSubscriber(Subscriber):
    """The subscriber of one SDO channel for one thread at a time, which stays on the bus between exchanges."""

    def __init__(self, bus: FrameBus, keys: frozenset[Key]) -> None:
        self._frames: SimpleQueue[BusItem | None] = SimpleQueue()
        self.sent_at: float | None = None
        """When `exchange` sent the request; None: it did not."""
        super().__init__(bus, keys)

    def put(self, item: BusItem, at: float) -> None:
        """Add a frame, or count it as lost."""
        if self._frames.qsize() < self.room:
            self._frames.put(item)
        else:
            self.lost += 1

    def fail(self, why: str) -> None:
        """Let `receive` raise PortError(why) after the frames in the queue."""
        self._why = self._why or why
        self._frames.put(None)

    def fail_in_child(self, why: str) -> None:
        """The same in a forked process: a thread of the parent may hold the lock of the queue."""
        self._frames = SimpleQueue()
        self.fail(why)

    def exchange(self, request: CanFrame, timeout: float) -> CanFrame | None:
        """Send a request, and return the first frame after it, or None after `timeout` seconds. Raises PortError."""
        self.sent_at = None
        while not self._frames.empty() and self._why is None:
            self._frames.get()
        if self._why is not None:
            raise PortError(self._why)
        self.sent_at = time.monotonic()  # before it is sent: an exception may come between
        try:
            self.bus.send(request, self)
        except PortError:
            self.sent_at = None
            raise
        return self.receive(timeout)

    def receive(self, timeout: float) -> CanFrame | None:
        """Return the next frame, or None after `timeout` seconds. Raises PortError."""
        try:
            item = self._frames.get(timeout=min(timeout, LONGEST_PULL))
        except Empty:
            item = None
        if item is None and self._why is not None:
            raise PortError(self._why)
        return item  # type: ignore[return-value]  # without reports only frames


class SubscriberTable:
    """The subscribers of a bus, by the identifiers that they receive."""

    def __init__(self) -> None:
        self.subscribers: set[Subscriber] = set()
        # The tuples are replaced, never changed in place: delivery takes no lock.
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
        check_wait(timeout)
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
