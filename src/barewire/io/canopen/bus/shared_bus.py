"""A shared CAN bus: one thread reads the port and delivers each frame to the subscribers of its identifier.

                          +--> subscriber 585h              a transfer with node 5
        port --> reader --+--> subscriber 081h ... 0FFh     a stream of emergencies
                 (thread) +--> subscriber of all            a scan

A subscriber holds a limited number of frames; further ones are dropped and counted. A stream reports their number
(`FramesLost`); for a conversation they are like frames lost on the bus. Reports of the controller (`ErrorFrame`, such
as bus-off) go to every stream. After the port has failed, all calls raise PortError. If it can be opened again
(`dial`), streams report `BusDown` and `BusUp` instead and continue.

Frames sent by one subscriber are delivered to all others of this bus, so several nodes can run in one process.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Hashable, Sequence
from contextlib import suppress
from typing import Any, Self

from barewire.canopen.channel_locks import ChannelLock, ChannelLocks
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.errors import PortError
from barewire.io.canopen.bus.receiving import ReceivingBus, Sender, WatchFrames, check_port
from barewire.io.canopen.bus.reconnect import Dial, leaves_out_own_frames
from barewire.io.canopen.bus.subscriber import BusDown, Key, Subscriber
from barewire.io.endpoint import PAUSES, Endpoint
from barewire.io.engine.connections import OPENED_BEFORE_FORK, end_after_fork
from barewire.io.ports.base import Port, raise_port_error, send_when_room

_NO_KEYS: frozenset[Key] = frozenset()


class CanBus(ReceivingBus):
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
        self._channels: dict[tuple[int, SdoDialect], Channel] = {}
        self._locks = ChannelLocks()
        self._is_inherited = False  # by a forked process, which must not close the port
        super().__init__(port, watch=watch, dial=dial, pauses=pauses, lazy=lazy)
        end_after_fork(self)

    def _new_locks(self) -> None:
        super()._new_locks()
        self._locking = threading.Lock()

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
        """Return whether a frame of this sender, which is no node, reaches nobody else here."""
        if sender is None or sender.node or not (self._direct is None or self._direct is sender):
            return False
        return not self.subscribers or self.subscribers == {sender}

    # Subscribers, channels and their locks

    def add(self, subscriber: Subscriber) -> None:
        """Add a subscriber. Raises PortError if the bus failed and the subscriber cannot wait for it."""
        listens = subscriber.reports or subscriber.keys != _NO_KEYS
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

    def close(self) -> None:
        """End the reader thread and close the port."""
        if self._is_inherited:
            return
        self._closed = True
        if self._reopening is not None:
            self._reopening.stop.set()
        alone = self._alone
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
