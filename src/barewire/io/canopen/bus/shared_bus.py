"""A shared CAN bus: one thread reads the port and delivers each frame to the subscribers of its identifier.

                          +--> subscriber 585h              a transfer with node 5
        port --> reader --+--> subscriber 081h ... 0FFh     a stream of emergencies
                 (thread) +--> subscriber of all            a scan

A subscriber holds a limited number of frames; further ones are dropped and counted. A stream reports their number
(`FramesLost`); for a conversation they are like frames lost on the bus. Reports of the controller (`ErrorFrame`, such
as bus-off) go to every stream. After the port has failed, all calls raise PortError. If it can be opened again
(`dial`), streams report `BusDown` and `BusUp` instead and continue.

Frames sent by one subscriber are delivered to all others of this bus, so several nodes can run in one process.

Depends on: a port, the locks of SDO channels.  Used by: clients, `CanopenServer`, the text gateway.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Hashable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from barewire.canopen.bus.channel_locks import ChannelLock, ChannelLocks, LockKeys
from barewire.canopen.frame import CanFrame, ErrorFrame
from barewire.canopen.nmt.node_monitor import NodeMonitor
from barewire.canopen.sdo.client.channel import Channel
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.errors import PortError
from barewire.io.canopen.bus.reconnect import AwaitedBus, Dial, Reopening, receiver
from barewire.io.canopen.bus.subscriber import (
    BusDown,
    BusItem,
    BusUp,
    DirectPort,
    FramesLost,
    Key,
    Sender,
    Subscriber,
    SubscriberTable,
)
from barewire.io.endpoint import PAUSES, Endpoint
from barewire.io.engine.forking import OPENED_BEFORE_FORK, end_after_fork
from barewire.io.log import PortLog, watch_both
from barewire.io.ports.base import Port, send_when_room

if TYPE_CHECKING:
    from barewire.io.ports.trace import Direction

_RECEIVE_TIMEOUT = 0.05
"""Seconds that the reader waits for a frame before it checks whether the bus was closed."""

INSIDE_ONE_PROCESS = "can://virtual is inside one process"

WatchFrames: TypeAlias = "Callable[[Direction, CanFrame], Any]"


class CanBus(SubscriberTable, AwaitedBus):
    """A shared CAN bus. Closing it ends the reader thread; after that its subscribers raise PortError.

    port        what `can_port` returns, or any other port of frames
    watch       called as watch("sent" or "received", frame) with every frame
    dial        opens a new port after the port failed; until then `failure` is the reason. By default the bus ends
    pauses      the first and the longest pause, in seconds, after failed attempts to open it
    lazy        the reader thread starts with the second listener; until then the only one reads by itself (`direct`)
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
        SubscriberTable.__init__(self)
        AwaitedBus.__init__(self)
        self.port = port
        self.name: str = getattr(port, "name", "the bus")
        self.place = self.name if "/" not in self.name else f"can://{self.name}"
        """The URL of the bus, without options, in the lines of the log."""
        self._log = PortLog("barewire.canopen.bus", self.place)
        self.monitor = NodeMonitor(INSIDE_ONE_PROCESS if str(self.name).startswith("virtual/") else "")
        self._receive = receiver(port)
        self._try_send: Callable[[CanFrame], bool] | None = getattr(port, "try_send", None)
        self._watch: WatchFrames | None = watch_both(watch, self._log.watch())
        self._channels: dict[tuple[int, SdoDialect], Channel] = {}
        self._locks = ChannelLocks()
        self._new_locks()
        self._lost = 0  # of the port
        self._closed = self._is_inherited = False  # inherited by a forked process, which must not close the port
        self._reopening = None if dial is None else Reopening(dial, threading.Event(), pauses=pauses, log=self._log)
        self._reader: threading.Thread | None = None
        self._direct: DirectPort | None = None
        self._log.info("opened", "opened")
        if not (lazy and getattr(port, "keeps_frames", False)):
            self._start_reader(None)
        end_after_fork(self)

    def _new_locks(self) -> None:
        self._changing = threading.RLock()
        self._sending = threading.Lock()
        self._locking = threading.Lock()
        self._reading = threading.Lock()  # held by the only thread that reads the port

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

    # Frames in

    def _start_reader(self, failure: str | None) -> None:
        """Start the reader thread, unless it runs. `failure`: why the port failed for a conversation that read it."""
        if self._reader is None and not self._closed:
            name = f"reader of {self.name}"
            self._reader = threading.Thread(target=self._read, args=(failure,), name=name, daemon=True)
            self._reader.start()

    def _read(self, failure: str | None) -> None:
        with self._reading:  # not while a conversation reads by itself
            if failure is not None and not self._reopen(failure):
                return
            while not self._closed:
                self._report_losses()
                try:
                    item = self.read_now(_RECEIVE_TIMEOUT)
                except PortError as error:
                    if not self._reopen(str(error)):
                        return
                    continue
                if item is not None and not self._deliver(item):
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
        """Return a port for a conversation that reads the bus itself; None if a thread reads it."""
        if self._reader is not None or self.failure is not None:
            return None
        with self._changing:
            if self._direct is not None or self._reader is not None or self._closed:
                return None
            self._direct = direct = DirectPort(self, self._reading, keys, patience)
        return direct

    def take(self, item: BusItem) -> bool:
        """Deliver an item that a conversation read to all others. Return whether it is a frame."""
        if not isinstance(item, CanFrame):
            self._report(item, time.monotonic())
            return False
        if self._watch is not None:
            self._watch("received", item)
        now = time.monotonic()
        self.monitor.feed(item, now)
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
        """Start the reader, which opens the port again: a read of the conversation failed."""
        with self._changing:
            self._direct = None
            self.failure = self.failure or why
            self._start_reader(why)

    def end_direct(self, direct: DirectPort) -> None:
        """Let others read, at the end of a conversation."""
        with self._changing:
            if self._direct is direct:
                self._direct = None

    def _report_losses(self) -> None:
        """Report the frames that the system dropped, because they were not read in time."""
        lost = getattr(self.port, "lost", 0)
        if lost != self._lost:
            frames, self._lost = lost - self._lost, lost
            if frames > 0:  # a new port counts from 0 again
                self._report(FramesLost(frames), time.monotonic())

    def _deliver(self, item: BusItem) -> bool:
        try:
            if isinstance(item, CanFrame):
                if self._watch is not None:
                    self._watch("received", item)
                self._distribute(item, time.monotonic(), None)
            else:
                self._report(item, time.monotonic())
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
        with self._changing:
            if self._has_ended:
                return False  # closed meanwhile: `close` waits for this thread, then closes the port
            self.failure = None
        self._report(BusUp(time.monotonic() - since), time.monotonic())
        self._wake()
        return first is None or self._deliver(first)

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
            if self._try_send is None:
                self.port.send(frame)
            elif not self._try_send(frame):
                return False
        self._distribute(frame, time.monotonic(), sender)
        return True

    # Subscribers, channels and their locks

    def add(self, subscriber: Subscriber) -> None:
        """Add a subscriber. Raises PortError if the bus failed and the subscriber cannot wait for it."""
        if self._reader is None:
            self._discard_old()
        with self._changing:
            if self.failure is not None and (self._has_ended or not subscriber.reports):
                raise PortError(self.failure)
            if self.failure is not None:
                subscriber.put(BusDown(self.failure), time.monotonic())
            self.register(subscriber)
            self._start_reader(None)

    def _discard_old(self) -> None:
        """Read the frames that arrived while nobody listened, for the node monitor only."""
        if not self._reading.acquire(blocking=False):
            return  # a conversation reads
        try:
            until = time.monotonic() + _RECEIVE_TIMEOUT
            while time.monotonic() < until and (item := self.read_now(0.0)) is not None:
                self._deliver(item)
        except PortError as error:
            with self._changing:
                self._start_reader(str(error))
        finally:
            self._lost = getattr(self.port, "lost", 0)
            self._reading.release()

    def remove(self, subscriber: Subscriber) -> None:
        """Remove a subscriber."""
        with self._changing:
            self.unregister(subscriber)

    def channel(self, node: int, dialect: SdoDialect) -> Channel:
        """Return the default SDO channel to a node, the same for all clients of the bus."""
        with self._locking:
            channel = self._channels.get((node, dialect))
            if channel is None:
                own = getattr(self.port, "own_frames", None)
                channel = Channel(node, dialect, node_monitor=self.monitor, own_frames=own)
                self._channels[node, dialect] = channel
            return channel

    def request_lock(self, keys: LockKeys | None, owner: Hashable, wake: Callable[[], None]) -> ChannelLock:
        """Enter the queue for the locks of these channels; see `ChannelLocks`."""
        with self._locking:
            return self._locks.request(keys, owner, wake)

    def release_lock(self, lock: ChannelLock) -> None:
        """Release the locks, or leave the queue."""
        with self._locking:
            self._locks.release(lock)

    def close(self) -> None:
        """End the reader thread and close the port."""
        if self._is_inherited:
            return
        self._closed = True
        if self._reopening is not None:
            self._reopening.stop.set()
        self._fail(f"{self.name}: the bus was closed")
        if self._reader is None:
            direct = self._direct
            if direct is not None and direct.thread != threading.get_ident() and self._reading.acquire(timeout=1.0):
                self._reading.release()  # the conversation that read has noticed the end
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
