"""A shared CAN bus: frames come from one reader, and each reaches the subscribers of its identifier.

                          +--> subscriber 585h              a transfer with node 5
        port --> reader --+--> subscriber 081h ... 0FFh     a stream of emergencies
                          +--> subscriber of all            a scan

What reads the port:

        nothing                 until the first listener, if the system keeps frames meanwhile; only of a lazy bus
        one conversation        a blocking client that is alone reads by itself: `DirectPort`
        one subscriber          the stream of frames of a blocking client that is alone: `read_alone`
        one event loop          asyncio clients of this loop are alone, on a port with a descriptor: `LoopReader`
        the reader thread       as soon as others listen

A subscriber holds a limited number of frames; further ones are dropped and counted. A stream reports their number
(`FramesLost`); for a conversation they are like frames lost on the bus. Reports of the controller (`ErrorFrame`, such
as bus-off) go to every stream. After the port has failed, all calls raise PortError. If it can be opened again
(`dial`), streams report `BusDown` and `BusUp` instead and continue.

Frames sent by one subscriber are delivered to all others of this bus, so several nodes can run in one process.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Hashable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from barewire.canopen.channel_locks import ChannelLock, ChannelLocks
from barewire.canopen.frame import CanFrame, ErrorFrame
from barewire.canopen.nmt.node_monitor import NodeMonitor
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.errors import PortError
from barewire.io.canopen.bus.direct_port import DirectPort
from barewire.io.canopen.bus.port import (
    Dial,
    Reopening,
    check_port,
    inside_one_process,
    leaves_out_own_frames,
    receiver,
)
from barewire.io.canopen.bus.subscriber import (
    BusDown,
    BusItem,
    BusUp,
    FramesLost,
    Key,
    Subscriber,
    SubscriberTable,
)
from barewire.io.endpoint import PAUSES, Endpoint
from barewire.io.engine.connections import OPENED_BEFORE_FORK, end_after_fork
from barewire.io.log import PortLog, watch_both
from barewire.io.ports.base import Port, raise_port_error, send_when_room

if TYPE_CHECKING:
    from asyncio import AbstractEventLoop

    from barewire.io.canopen.bus.async_bus import LoopReader
    from barewire.io.ports.base import Direction

Sender: TypeAlias = Subscriber | DirectPort
WatchFrames: TypeAlias = "Callable[[Direction, CanFrame], Any]"

_NO_KEYS: frozenset[Key] = frozenset()
_RECEIVE_TIMEOUT = 0.05
"""Seconds that the reader waits for a frame before it checks whether the bus was closed."""


class CanBus(SubscriberTable):
    """A shared CAN bus. Closing it ends the reader thread; after that its subscribers raise PortError.

    port        what `can_port` returns, or any other port of frames
    watch       called as watch("sent" or "received", frame) with every frame
    dial        opens a new port after the port failed; until then `failure` is the reason. By default the bus ends
    pauses      the first and the longest pause, in seconds, after failed attempts to open it
    lazy        the reader thread starts when it is needed; until then the only listener, or event loop, reads
    """

    def __init__(
        self,
        port: Port[CanFrame],
        *,
        watch: WatchFrames | None = None,
        dial: Dial | None = None,
        pauses: tuple[float, float] = PAUSES,
        lazy: bool = False,
    ) -> None:
        check_port(port, "a port, such as can_port returns; CanBus.open takes a URL")
        super().__init__()
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
        self._channels: dict[tuple[int, SdoDialect], Channel] = {}
        self._locks = ChannelLocks()
        self._new_locks()
        self.failure: str | None = None
        """Why the bus is not open; None: it is."""
        self._has_ended = False  # failed or closed, and not opened again
        self._awaiting: set[Callable[[], None]] = set()  # called when the bus is open again, or has ended
        self._lost = 0  # of the port
        self._closed = False
        self._is_inherited = False  # by a forked process, which must not close the port
        self._ending = threading.Event()
        self._reopening = None if dial is None else Reopening(dial, self._ending.wait, pauses=pauses, log=self._log)
        self._reader: threading.Thread | None = None
        self._direct: DirectPort | None = None
        self.loop_reader: LoopReader | None = None
        self._alone: Subscriber | None = None  # the only listener, which reads by itself
        self._log.info("opened", "opened")
        if not (lazy and getattr(port, "keeps_frames", False)):
            self._start_reader(None)
        end_after_fork(self)

    def _new_locks(self) -> None:
        # `reading` is taken before `_changing` where both are held; the others are held alone.
        self.reading = threading.Lock()  # by the only thread that reads the port
        self._changing = threading.RLock()  # while readers, subscribers or `failure` change
        self._sending = threading.Lock()  # while a frame is sent
        self._locking = threading.Lock()  # while the channels, or the queue for their locks, change

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}>"

    @classmethod
    def open(cls, bus: str | Endpoint, *, watch: WatchFrames | None = None, lazy: bool = False, **options: Any) -> Self:
        """Open the bus of a can:// URL, whose options `options` override. If its port fails later, it is opened again.

        Raises EncodeError for a wrong URL or option, PortError for a bus that cannot be opened.
        """
        from barewire.io.ports.can.interfaces import can_endpoint, can_port

        endpoint = bus if isinstance(bus, Endpoint) else can_endpoint(bus, **options)
        return cls(can_port(endpoint), watch=watch, dial=lambda: can_port(endpoint), pauses=endpoint.pauses, lazy=lazy)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # Frames out

    def send(self, frame: CanFrame, sender: Sender | None = None) -> None:
        """Send a frame when the controller has room. All other subscribers receive it. Raises PortError."""
        if not self.try_send(frame, sender):
            send_when_room(lambda: self.try_send(frame, sender, again=True), self.name)

    def try_send(self, frame: CanFrame, sender: Sender | None = None, *, again: bool = False) -> bool:
        """Send a frame, or return False if the controller has no room now. Further attempts are made with `again`."""
        if self.failure is not None:
            raise PortError(self.failure)
        if self._watch is not None and not again:
            self._watch("sent", frame)
        with self._sending:
            try:
                if self._try_send is None:
                    self.port.send(frame)
                elif not self._try_send(frame):
                    return False
            except OSError as error:
                if self._direct is None and self.loop_reader is None:
                    self._start_reader(None)  # a reader notices whether the port has failed, and opens it again
                raise_port_error(self.port, error)
        if not self._is_alone(sender):
            self._distribute(frame, time.monotonic(), sender)
        return True

    def try_send_all(self, frames: Sequence[CanFrame], sender: Sender | None = None) -> int:
        """Send frames one after the other, if the port has a quick way for many. Return how many it took, 0 without."""
        if self.failure is not None:
            raise PortError(self.failure)
        send_many = getattr(self.port, "try_send_all", None)
        if send_many is None or self._watch is not None:
            return 0
        with self._sending:
            sent: int = send_many(frames)
        if not self._is_alone(sender):
            at = time.monotonic()
            for frame in frames[:sent]:
                self._distribute(frame, at, sender)
        return sent

    def _is_alone(self, sender: Sender | None) -> bool:
        """Return whether a frame of this sender, which is no node, reaches no other subscriber."""
        if sender is None or sender.node or not (self._direct is None or self._direct is sender):
            return False
        return not self.subscribers or self.subscribers == {sender}

    # Subscribers, channels and their locks

    def add(self, subscriber: Subscriber) -> None:
        """Add a subscriber. Raises PortError if the bus failed and the subscriber cannot wait for it."""
        listens = subscriber.reports or subscriber.keys != _NO_KEYS
        # What waits in the port came before the new listener, which must not take it for an answer. A loop that reads
        # leaves nothing there; but streams, and subscribers of all frames, would get what it has not read yet.
        if listens and self._reader is None and (self.loop_reader is None or subscriber.reports or not subscriber.keys):
            self._discard_old()
        with self._changing:
            if self.failure is not None and (self._has_ended or not subscriber.reports):
                raise PortError(self.failure)
            if self.failure is not None:
                subscriber.put(BusDown(self.failure), time.monotonic())
            self.register(subscriber)
            if listens:
                self._read_for(subscriber)

    def remove(self, subscriber: Subscriber) -> None:
        """Remove a subscriber."""
        with self._changing:
            self.unregister(subscriber)
            if self._alone is subscriber:
                self._alone = None

    def channel(self, node: int, dialect: SdoDialect, timeout: float = 0.0) -> Channel:
        """Return the default SDO channel to a node, the same for all clients of the bus. `timeout`: the seconds that
        this client gives the node for a response."""
        with self._locking:
            channel = self._channels.get((node, dialect))
            if channel is None:
                own = False if leaves_out_own_frames(self.port) else getattr(self.port, "own_frames", None)
                channel = Channel(node, dialect, node_monitor=self.monitor, own_frames=own)
                self._channels[node, dialect] = channel
            channel.timeout = max(channel.timeout, timeout)
            return channel

    def request_lock(self, lock: ChannelLock) -> None:
        """Enter the queue for the locks of these channels; see `ChannelLocks`."""
        with self._locking:
            self._locks.enter(lock)

    def lock_if_free(self, lock: ChannelLock, owner: Hashable) -> bool:
        """Take a lock if that needs no waiting. Return whether it was taken."""
        with self._locking:
            return self._locks.take_if_free(lock, owner)

    def release_lock(self, lock: ChannelLock) -> None:
        """Release the locks, or leave the queue."""
        with self._locking:
            self._locks.release(lock)

    # The reader thread

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
                from barewire.io.canopen.bus.async_bus import LoopReader  # it imports asyncio

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
        """Read the frames that came before a new listener. Those without a subscriber are for the node monitor."""
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
            self.put(frame, at, sender)  # the usual case, without a lock
            return
        with self._changing:  # `_direct` may become a subscriber now
            direct = self._direct
            if direct is not None and direct.receives(frame):
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
        with self._sending:  # a sender uses the port and its `try_send` together
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

    # Waiting for a bus that is opened again

    def _wake(self) -> None:
        """Wake the threads and tasks that wait until the bus is open."""
        with self._changing:
            awaiting, self._awaiting = self._awaiting, set()
        for wake in awaiting:
            wake()

    def when_open(self, wake: Callable[[], None]) -> bool:
        """Return whether the bus is open, or has ended. If it is neither, `wake` is called when it is."""
        with self._changing:
            if self.failure is None or self._has_ended:
                return True
            self._awaiting.add(wake)
            return False

    def cancel_wake(self, wake: Callable[[], None]) -> None:
        """Cancel the `wake` of a call of `when_open`."""
        with self._changing:
            self._awaiting.discard(wake)

    def wait_until_open(self, timeout: float) -> None:
        """If the bus is being opened again, wait for it, `timeout` seconds at most."""
        if self.failure is None:
            return
        is_open = threading.Event()
        if not self.when_open(is_open.set):
            is_open.wait(timeout)
            self.cancel_wake(is_open.set)

    # The end

    def close(self) -> None:
        """End the reader thread and close the port."""
        if self._is_inherited:
            return
        self._closed = True  # before `_fail`, which then does not log a failure
        self._ending.set()
        alone = self._alone
        # Subscribers are told first, so that the one that reads ends its read; only then the port is closed.
        self._fail(f"{self.name}: the bus was closed")
        if alone is not None and self._watch is None and self.reading.acquire(timeout=1.0):
            self.reading.release()  # the thread that read for itself has noticed the end
        elif self._reader is None:
            direct = self._direct
            if direct is not None and direct.thread != threading.get_ident() and self.reading.acquire(timeout=1.0):
                self.reading.release()  # the conversation that read has noticed the end
        elif self._reader is not threading.current_thread():
            self._reader.join()
        with suppress(PortError):
            self.port.close()

    def end_in_child(self) -> None:
        """Refuse to send and receive in a forked process: it has no reader thread. The port is left to its opener."""
        self._new_locks()  # those of threads that do not exist here
        self._is_inherited = self._closed = self._has_ended = True
        self.failure = f"{self.name}: the bus was {OPENED_BEFORE_FORK}"
        self.fail_all_in_child(self.failure)
