"""One reader for a bus, and everybody who wants to hear: frames are fanned out by identifier.

                          +--> tap 585h              a transfer with node 5
        port --> reader --+--> tap 081h ... 0FFh     a stream of emergencies
                 (thread) +--> tap, everything       a survey

A tap holds what nobody has taken yet, as much as it has room for. What is more is lost, and counted: a stream is told
so in its place (`Lost`), a conversation has it as if the bus had lost it. Reports of the controller (`ErrorFrame`,
bus-off among them) go to every stream. A port that fails is told to all by PortError, and to whoever comes later; where
it can be opened anew (`can_reopen`), streams hear `BusDown` and `BusUp` in its place and go on.

What one of us sends all others on the same bus object hear as well: nodes of one process are on one bus too.

I know: frames, identifiers, one thread.  I never know: what a frame means, python-can, which loop runs.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Hashable
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeAlias

from barewire.canopen.bus.channel_locks import ChannelLock, ChannelLocks, LockKeys
from barewire.canopen.bus.node_monitor import NodeMonitor
from barewire.canopen.frame import CanFrame, ErrorFrame
from barewire.canopen.sdo.client.channel import Channel
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.errors import EncodeError, PortError
from barewire.io.canopen.reconnect import Dial, Reopening, taker
from barewire.io.canopen.subscriber import BusDown, BusUp, Item, Subscriber
from barewire.io.endpoint import Endpoint
from barewire.io.ports.base import Port

if TYPE_CHECKING:
    from barewire.io.ports.trace import Direction

POLL = 0.05
"""How long the reader waits at most before it looks whether the bus was closed."""
PATIENCE = 1.0
"""Seconds that a frame waits for room in the controller's buffer: a full bus empties the longest one sooner."""
RETRY = 0.0005

Watch: TypeAlias = "Callable[[Direction, CanFrame], Any]"


class CanBus:
    """A bus that many share. Closing it ends its reader, and all who hear it are told.

    `port` is a `CanPort`, or anything else that sends and receives frames. `watch(direction, frame)` is told of
    everything that passes. With `dial`, a port that failed is replaced by another one that this opens; `failure` says
    what is wrong meanwhile.
    """

    def __init__(self, port: Port[CanFrame], *, watch: Watch | None = None, dial: Dial | None = None) -> None:
        self.port = port
        self.name: str = getattr(port, "name", "the bus")
        self.monitor = NodeMonitor()
        self.failure: str | None = None
        self._receive = taker(port)
        self._try_send: Callable[[CanFrame], bool] | None = getattr(port, "try_send", None)
        self._watch = watch
        self._taps: set[Subscriber] = set()
        # Replaced, never changed: the reader looks without a lock.
        self._by_id: dict[bool, dict[int, tuple[Subscriber, ...]]] = {False: {}, True: {}}
        self._all: tuple[Subscriber, ...] = ()
        self._changing = threading.Lock()
        self._sending = threading.Lock()
        self._channels: dict[tuple[int, SdoDialect], Channel] = {}
        self._locks = ChannelLocks()
        self._line = threading.Lock()
        self._closed = False
        self._over = False  # it failed, or was closed, and does not come back
        self._reopening = None if dial is None else Reopening(dial, threading.Event())
        self._waiting: set[Callable[[], None]] = set()
        self._reader = threading.Thread(target=self._read, name=f"reader of {self.name}", daemon=True)
        self._reader.start()

    @classmethod
    def open(cls, bus: str | Endpoint, *, watch: Watch | None = None, **options: Any) -> Self:
        """The bus of a can:// URL. A port that fails later is replaced by a new one. `options` are those of the URL,
        which they override. Raises EncodeError for a wrong URL or option, PortError for a bus that cannot be opened."""
        from barewire.io.ports.python_can import CanPort

        endpoint = bus if isinstance(bus, Endpoint) else can_endpoint(bus, **options)
        return cls(CanPort(endpoint), watch=watch, dial=lambda: CanPort(endpoint))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    # Frames in

    def _read(self) -> None:
        while not self._closed:
            try:
                item = self._receive(POLL)
            except Exception as error:
                # A PortError says what it is; the rest is python-can's, and whoever hears this bus must know of it too.
                name = "" if isinstance(error, PortError) else f"reading {self.name} ended: {type(error).__name__}: "
                if not self._renew(f"{name}{error}"):
                    return
                continue
            if item is not None and not self._take(item):
                return

    def _take(self, item: Item) -> bool:
        try:
            if isinstance(item, CanFrame):
                if self._watch is not None:
                    self._watch("received", item)
                self._hand_out(item, time.monotonic(), None)
            else:
                self._report(item, time.monotonic())
        except Exception as error:  # a watcher's
            self._fail(f"reading {self.name} ended: {type(error).__name__}: {error}")
            return False
        return True

    def _hand_out(self, frame: CanFrame, at: float, by: Subscriber | None) -> None:
        if by is None or by.node:
            self.monitor.feed(frame, at)
        for tap in self._by_id[frame.extended].get(frame.id, ()):
            if tap is not by:
                tap.put(frame, at)
        for tap in self._all:
            if tap is not by:
                tap.put(frame, at)

    def _report(self, item: Item, at: float) -> None:
        if isinstance(item, ErrorFrame):
            self.monitor.report(item, at)
        for tap in tuple(self._taps):
            if tap.reports:
                tap.put(item, at)

    def _fail(self, why: str) -> None:
        """The end."""
        with self._changing:
            self.failure = self.failure or why
            self._over = True
            taps = tuple(self._taps)
        for tap in taps:
            tap.fail(why)
        self._wake()

    def _renew(self, why: str) -> bool:
        """Another port in place of the one that failed; False if that is not wanted, or no longer."""
        if self._reopening is None or self._closed:
            self._fail(why)
            return False
        since = time.monotonic()
        with self._changing:
            self.failure = why
            taps = tuple(self._taps)
        for tap in taps:
            if tap.reports:
                tap.put(BusDown(why), since)
            else:
                tap.fail(why)
        opened = self._reopening.reopen(self.port, why)
        if opened is None:
            return False
        with self._sending:
            self.port, first = opened
            self._receive, self._try_send = taker(self.port), getattr(self.port, "try_send", None)
        with self._changing:
            if self._over:
                return False  # closed meanwhile: `close` waits for us, and closes the port
            self.failure = None
        self._report(BusUp(time.monotonic() - since), time.monotonic())
        self._wake()
        return first is None or self._take(first)

    def _wake(self) -> None:
        with self._changing:
            waiting, self._waiting = self._waiting, set()
        for wake in waiting:
            wake()

    def when_open(self, wake: Callable[[], None]) -> bool:
        """Whether the bus is there, or will never be again. Otherwise `wake` is called when one of the two is so."""
        with self._changing:
            if self.failure is None or self._over:
                return True
            self._waiting.add(wake)
            return False

    def wake_no_more(self, wake: Callable[[], None]) -> None:
        """Whoever waited for the bus does so no longer."""
        with self._changing:
            self._waiting.discard(wake)

    def wait_open(self, patience: float) -> None:
        """Where the bus is being opened anew, give it so many seconds."""
        if self.failure is None:
            return
        there = threading.Event()
        if not self.when_open(there.set):
            there.wait(patience)
            self.wake_no_more(there.set)

    # Frames out

    def send(self, frame: CanFrame, by: Subscriber | None = None) -> None:
        """Put a frame on the bus, as soon as the controller has room; all hear it but who said it. PortError if that
        fails."""
        if self.try_send(frame, by):
            return
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            time.sleep(RETRY)  # outside of the lock: meanwhile others may try
            if self.try_send(frame, by, again=True):
                return
        raise PortError(no_room(self.name))

    def try_send(self, frame: CanFrame, by: Subscriber | None = None, *, again: bool = False) -> bool:
        """The same without waiting: False if the controller has no room now, and then it is tried `again`."""
        if self.failure is not None:
            raise PortError(self.failure)
        if self._watch is not None and not again:
            self._watch("sent", frame)
        with self._sending:
            if self._try_send is None:
                self.port.send(frame)
            elif not self._try_send(frame):
                return False
        self._hand_out(frame, time.monotonic(), by)
        return True

    # Who hears, and who talks

    def add(self, tap: Subscriber) -> None:
        """One hearer more."""
        with self._changing:
            if self.failure is not None and (self._over or not tap.reports):
                raise PortError(self.failure)
            if self.failure is not None:
                tap.put(BusDown(self.failure), time.monotonic())
            self._taps.add(tap)
            if tap.keys is None:
                self._all = (*self._all, tap)
            else:
                for identifier, extended in tap.keys:
                    table = self._by_id[extended]
                    table[identifier] = (*table.get(identifier, ()), tap)

    def remove(self, tap: Subscriber) -> None:
        """One hearer less."""
        with self._changing:
            self._taps.discard(tap)
            self._all = tuple(other for other in self._all if other is not tap)
            for identifier, extended in tap.keys or ():
                table = self._by_id[extended]
                others = tuple(other for other in table.get(identifier, ()) if other is not tap)
                if others:
                    table[identifier] = others
                else:
                    table.pop(identifier, None)

    def channel(self, node: int, dialect: SdoDialect) -> Channel:
        """The default SDO channel to a node, the same for all who share the bus."""
        with self._line:
            channel = self._channels.get((node, dialect))
            if channel is None:
                channel = self._channels[node, dialect] = Channel(node, dialect, node_monitor=self.monitor)
            return channel

    def join(self, keys: LockKeys | None, owner: Hashable, wake: Callable[[], None]) -> ChannelLock:
        """A place in the line of those who want to talk; see `ChannelLocks`."""
        with self._line:
            return self._locks.request(keys, owner, wake)

    def leave(self, lock: ChannelLock) -> None:
        """The talk is over."""
        with self._line:
            self._locks.release(lock)

    def close(self) -> None:
        """End the reader and leave the bus."""
        self._closed = True
        if self._reopening is not None:
            self._reopening.stop.set()
        self._fail(f"{self.name}: the bus was closed")
        if self._reader is not threading.current_thread():
            self._reader.join()
        with suppress(PortError):
            self.port.close()


def no_room(name: str) -> str:
    """Why a frame was given up."""
    return f"{name}: the controller has had no room for a frame for {PATIENCE:g} s"


def can_endpoint(url: str, **options: Any) -> Endpoint:
    """The endpoint of a can:// URL, with these options in place of its own. EncodeError for any other URL."""
    endpoint = Endpoint.parse(url, options)
    if endpoint.scheme != "can":
        raise EncodeError(f"endpoint {str(url)!r}: CANopen needs can://INTERFACE/CHANNEL, such as can://socketcan/can0")
    return endpoint
