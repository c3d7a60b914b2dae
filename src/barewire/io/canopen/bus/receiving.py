"""The receiving side of a shared CAN bus: who reads the port, what each received frame reaches, and a port that fails.

Who reads the port:

        nobody                  until somebody listens, if the system keeps frames meanwhile; only of a lazy bus
        one conversation        a blocking client that is alone reads by itself: `DirectPort`
        one subscriber          the stream of frames of a blocking client that is alone: `read_alone`
        one event loop          asyncio clients of this loop are alone, on a port with a descriptor: `LoopReader`
        the reader thread       as soon as others listen
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from barewire.canopen.frame import CanFrame, ErrorFrame
from barewire.canopen.nmt.node_monitor import NodeMonitor
from barewire.errors import EncodeError, PortError, shown
from barewire.io.canopen.bus.direct_port import DirectPort
from barewire.io.canopen.bus.reconnect import AwaitedBus, Dial, Reopening, receiver
from barewire.io.canopen.bus.subscriber import (
    BusDown,
    BusItem,
    BusUp,
    FramesLost,
    Key,
    Subscriber,
    SubscriberTable,
)
from barewire.io.log import PortLog, watch_both
from barewire.io.ports.base import Port

if TYPE_CHECKING:
    from asyncio import AbstractEventLoop

    from barewire.io.canopen.bus.loop_reader import LoopReader
    from barewire.io.ports.base import Direction

_RECEIVE_TIMEOUT = 0.05
"""Seconds that the reader waits for a frame before it checks whether the bus was closed."""


def inside_one_process(place: str) -> str:
    """Return a remark on a bus that other processes cannot reach; an empty text for any other bus."""
    interface = place.partition("/")[0]
    return f"can://{interface} is inside one process" if interface in ("memory", "virtual") else ""


Sender: TypeAlias = Subscriber | DirectPort
WatchFrames: TypeAlias = "Callable[[Direction, CanFrame], Any]"


def check_port(port: object, expected: str) -> None:
    """Raise EncodeError for an object that is not a port."""
    if isinstance(port, type) or not (hasattr(port, "send") and hasattr(port, "receive")):
        raise EncodeError(f"{shown(port)}: expected {expected}")


class ReceivingBus(SubscriberTable, AwaitedBus, ABC):
    """The base class of a shared bus. Its arguments are those of `CanBus`."""

    def __init__(
        self,
        port: Port[CanFrame],
        *,
        watch: WatchFrames | None = None,
        dial: Dial | None = None,
        pauses: tuple[float, float],
        lazy: bool,
    ) -> None:
        SubscriberTable.__init__(self)
        AwaitedBus.__init__(self)
        self.port = port
        self.name: str = getattr(port, "name", "the bus")
        self.place = self.name if "/" not in self.name else f"can://{self.name}"
        """The URL of the bus, without options, in the lines of the log."""
        self._log = PortLog("barewire.canopen.bus", self.place)
        self.monitor = NodeMonitor(inside_one_process(str(self.name)))
        self._receive = receiver(port)
        self._try_send: Callable[[CanFrame], bool] | None = getattr(port, "try_send", None)
        self.has_frames: Callable[[], bool] | None = getattr(port, "has_frames", None)
        """Whether a frame waits to be read; None: the port cannot tell."""
        self._watch: WatchFrames | None = watch_both(watch, self._log.watch())
        self._new_locks()
        self._lost = 0  # of the port
        self._closed = False
        self._reopening = None if dial is None else Reopening(dial, threading.Event(), pauses=pauses, log=self._log)
        self._reader: threading.Thread | None = None
        self._direct: DirectPort | None = None
        self.loop_reader: LoopReader | None = None
        self._alone: Subscriber | None = None  # the only listener, which reads by itself
        self._log.info("opened", "opened")
        if not (lazy and getattr(port, "keeps_frames", False)):
            self._start_reader(None)

    def _new_locks(self) -> None:
        self._changing = threading.RLock()
        self._sending = threading.Lock()
        self.reading = threading.Lock()  # held by the only thread that reads the port

    @abstractmethod
    def add(self, subscriber: Subscriber) -> None: ...

    @abstractmethod
    def remove(self, subscriber: Subscriber) -> None: ...

    @abstractmethod
    def send(self, frame: CanFrame, sender: Sender | None = None) -> None: ...

    @abstractmethod
    def try_send(self, frame: CanFrame, sender: Sender | None = None, *, again: bool = False) -> bool: ...

    @abstractmethod
    def try_send_all(self, frames: Sequence[CanFrame], sender: Sender | None = None) -> int: ...

    # Who reads

    def _start_reader(self, failure: str | None) -> None:
        """Start the reader thread, unless it runs. `failure`: why the port failed for a conversation that read it."""
        if self.loop_reader is not None:
            self.loop_reader.stop()
            self.loop_reader = None
        self._alone = None
        if self._reader is None and not self._closed:
            name = f"reader of {self.name}"
            self._reader = threading.Thread(target=self._read, args=(failure,), name=name, daemon=True)
            self._reader.start()

    def _read(self, failure: str | None) -> None:
        with self.reading:  # not while a conversation reads by itself
            if failure is not None and not self._reopen(failure):
                return
            while not self._closed:
                self.report_losses()
                try:
                    item = self.read_now(_RECEIVE_TIMEOUT)
                except PortError as error:
                    if not self._reopen(str(error)):
                        return
                    continue
                if item is not None and not self.deliver(item):
                    return

    def read_now(self, timeout: float) -> BusItem | None:
        """Read the port, which only the holder of the lock may do. Raises PortError, also for errors of python-can."""
        try:
            return self._receive(timeout)
        except PortError:
            raise
        except Exception as error:
            raise PortError(f"reading {self.name} ended: {type(error).__name__}: {error}") from error

    # One conversation that reads by itself, see `DirectPort`

    @property
    def has_reader(self) -> bool:
        """Whether the reader thread was started."""
        return self._reader is not None

    def direct(self, keys: frozenset[Key] | None, patience: float) -> DirectPort | None:
        """Return a port for a conversation that reads the bus itself; None if a thread or a loop reads it."""
        direct = DirectPort(self, self.reading, keys)
        return direct if self.begin_direct(direct, patience) else None

    def begin_direct(self, direct: DirectPort, patience: float) -> bool:
        """Let a new or closed port read the bus for a conversation. Return False if a thread or a loop reads it."""
        if self._reader is not None or self.failure is not None:
            return False
        with self._changing:
            others = self._direct or self.loop_reader or self._alone or self._reader
            if others is not None or self._closed:
                return False
            direct.begin(patience)
            self._direct = direct
        return True

    def take(self, item: BusItem) -> bool:
        """Deliver an item that a conversation read to all others. Return whether it is a frame."""
        if not isinstance(item, CanFrame):
            self._report(item, time.monotonic())
            return False
        if self._watch is not None:
            self._watch("received", item)
        now = time.monotonic()
        self.monitor.feed(item, now)
        if self.subscribers:
            self.put(item, now, None)
        return True

    def subscribe_instead(self, keys: frozenset[Key] | None) -> Subscriber:
        """Return a subscriber in place of the conversation that reads, so that the reader reads. Raises PortError."""
        with self._changing:  # the reader may read already: no frame comes between the two
            try:
                return Subscriber(self, keys)
            finally:
                self._direct = None

    def fail_directly(self, why: str) -> None:
        """Start the reader, which opens the port again: a read of the conversation, or in the loop, failed."""
        with self._changing:
            self._direct = None
            self.failure = self.failure or why
            self._start_reader(why)

    def end_direct(self, direct: DirectPort) -> None:
        """Let others read, at the end of a conversation."""
        with self._changing:
            if self._direct is direct:
                self._direct = None

    def _read_for(self, subscriber: Subscriber) -> None:
        """Let the frames for a new subscriber be read: by its event loop or by itself if only that listens, else by the
        thread."""
        if subscriber.alone and (self._reader or self._direct or self.loop_reader or self._alone) is None:
            self._alone = subscriber
            return
        loop, reader = subscriber.loop, self.loop_reader
        others = self._reader or self._direct or self._alone
        if loop is not None and others is None and (hasattr(self.port, "fileno") or hasattr(self.port, "notify")):
            if reader is not None and reader.loop is loop:
                return
            if reader is None or reader.loop.is_closed():
                if reader is not None:
                    reader.stop()
                from barewire.io.canopen.bus.loop_reader import LoopReader  # it imports asyncio

                try:
                    self.loop_reader = LoopReader(self)
                    return
                except (NotImplementedError, OSError):
                    self.loop_reader = None
        self._start_reader(None)

    def reads_alone(self, subscriber: Subscriber) -> bool:
        """Return whether a subscriber is the only listener, and reads by itself."""
        return self._alone is subscriber

    def read_alone(self, subscriber: Subscriber, timeout: float) -> CanFrame | None:
        """Read the port once for its only listener, for a fraction of a second. Return a frame that it receives; None
        if nothing arrived, or if something else did: an item is in its queue, or another reader has begun."""
        if self._alone is not subscriber:
            return None
        if timeout > _RECEIVE_TIMEOUT:
            timeout = _RECEIVE_TIMEOUT
        elif timeout < 0.0:
            timeout = 0.0
        if not (self.reading.acquire(False) or self.reading.acquire(timeout=timeout)):  # the first is quicker
            return None
        try:
            queue = subscriber.queue
            if self._alone is not subscriber or queue or subscriber.gap:
                return None
            item = self._receive(timeout)
            if getattr(self.port, "lost", 0) != self._lost:
                self.report_losses()
            if item.__class__ is CanFrame and self._alone is subscriber and not queue and self._watch is None:
                self.monitor.feed(item, time.monotonic())
                keys = subscriber.keys
                return item if keys is None or (item.id, item.extended) in keys else None
            if item is not None:
                self.deliver(item)
        except Exception as error:
            why = str(error) if isinstance(error, PortError) else f"{type(error).__name__}: {error}"
            self.fail_directly(why if isinstance(error, PortError) else f"reading {self.name} ended: {why}")
        finally:
            self.reading.release()
        return None

    def read_in_loop(self, loop: AbstractEventLoop) -> bool:
        """Deliver what has arrived, if this loop reads the port. Return whether it does."""
        reader = self.loop_reader
        if reader is None or reader.loop is not loop:
            return False
        reader.read()
        return True

    def keep_times(self) -> None:
        """Deliver frames with the time at which they arrived, although the loop that reads may be late."""
        if self.loop_reader is not None:
            self.loop_reader.keep_times()

    def _discard_old(self) -> None:
        """Read the frames that arrived before a new listener came: those that nobody gets are for the node monitor."""
        if not self.reading.acquire(blocking=False):
            return  # a conversation reads
        try:
            until = time.monotonic() + _RECEIVE_TIMEOUT
            while time.monotonic() < until and (item := self.read_now(0.0)) is not None:
                self.deliver(item)
        except PortError as error:
            with self._changing:
                self._start_reader(str(error))
        finally:
            self.report_losses()
            self.reading.release()

    # Delivery

    def report_losses(self) -> None:
        """Report the frames that the system dropped, because they were not read in time."""
        lost = getattr(self.port, "lost", 0)
        if lost != self._lost:
            frames, self._lost = lost - self._lost, lost
            if frames > 0:  # a new port counts from 0 again
                self._report(FramesLost(frames), time.monotonic())

    def deliver(self, item: BusItem, at: float | None = None) -> bool:
        """Deliver an item that arrived now, or at `at`, to all subscribers. Return False if the bus has ended."""
        at = time.monotonic() if at is None else at
        try:
            if isinstance(item, CanFrame):
                if self._watch is not None:
                    self._watch("received", item)
                self._distribute(item, at, None)
            else:
                self._report(item, at)
        except Exception as error:  # raised by `watch`
            self._fail(f"reading {self.name} ended: {type(error).__name__}: {error}")
            return False
        return True

    def _distribute(self, frame: CanFrame, at: float, sender: Sender | None) -> None:
        """Deliver a frame to all subscribers but its sender. The node monitor does not get the frames of clients."""
        if sender is None or sender.node:
            self.monitor.feed(frame, at)
        if self._direct is None or self._direct is sender:
            self.put(frame, at, sender)
            return
        with self._changing:  # `_direct` may become a subscriber now
            direct = self._direct
            if direct is not None and direct.wants(frame):
                direct.inbox.append(frame)
            self.put(frame, at, sender)

    def _report(self, item: BusItem, at: float) -> None:
        if isinstance(item, ErrorFrame):
            self.monitor.report(item, at)
            self._log.info("controller", f"controller: {item.text}")
        for subscriber in tuple(self.subscribers):
            if subscriber.reports:
                subscriber.put(item, at)

    # A port that fails

    def _fail(self, why: str) -> None:
        """End this bus: every subscriber raises PortError with this reason."""
        if not self._has_ended:
            if self._closed:
                self._log.info("closed", "closed")
            else:
                self._log.warning("failed", f"failed: {self._log.short(why)}")
            self._log.flush()
        with self._changing:
            self.failure = self.failure or why
            self._has_ended = True
            if self.loop_reader is not None:
                self.loop_reader.stop()
                self.loop_reader = None
            self._alone = None
            subscribers = tuple(self.subscribers)
        for subscriber in subscribers:
            subscriber.fail(why)
        self._wake()

    def _reopen(self, why: str) -> bool:
        """Replace the port that failed. Return False if it cannot be opened again, or if the bus was closed."""
        if self._reopening is None or self._closed:
            self._fail(why)
            return False
        since = time.monotonic()
        with self._changing:
            self.failure = why
            subscribers = tuple(self.subscribers)
        for subscriber in subscribers:
            if subscriber.reports:
                subscriber.put(BusDown(why), since)
            else:
                subscriber.fail(why)
        opened = self._reopening.reopen(self.port, why)
        if opened is None:
            return False
        with self._sending:
            self.port, first = opened
            self._receive, self._try_send = receiver(self.port), getattr(self.port, "try_send", None)
            self.has_frames = getattr(self.port, "has_frames", None)
        with self._changing:
            if self._has_ended:
                return False  # closed meanwhile: `close` waits for this thread, then closes the port
            self.failure = None
        self._report(BusUp(time.monotonic() - since), time.monotonic())
        self._wake()
        return first is None or self.deliver(first)
