"""`bus.sync` and `bus.time`: SYNC and TIME messages, sent, produced, and received.   [CiA 301, SYNC and TIME]

with bus.sync.start(0.01): ...                     a SYNC every 10 ms
with bus.sync.start(0.01, by="kernel"): ...        the same, sent by the kernel if the bus is can://socketcan
bus.time.send()                                    the time of this computer
"""

from __future__ import annotations

import time

from barewire import canopen
from barewire.canopen.cob_ids import SYNC_KEY, TIME_KEY
from barewire.io.canopen.bus.subscriber import Key, check_key
from barewire.io.canopen.methods.cyclic import SentBy, cyclic_task
from barewire.io.canopen.methods.operations import (
    NO_FRAMES,
    BackgroundTask,
    BusOperation,
    Methods,
    R,
    Subscription,
    background,
    operation,
    send_frame,
    subscription,
)


class SyncMethods(Methods[R]):
    """SYNC messages. `key` is their (identifier, extended) if object 1005h of the nodes has another one than 80h."""

    @operation
    def send(self, counter: int | None = None, *, key: Key = SYNC_KEY) -> BusOperation[None]:
        """Send one SYNC."""
        return send_frame(canopen.SyncMessage(counter).encode(check_key(key)))

    @background
    def start(self, period: float, *, overflow: int = 0, key: Key = SYNC_KEY, by: SentBy = "python") -> BackgroundTask:
        """Send a SYNC every `period` seconds, with a counter up to `overflow` if that is not 0, until it is stopped.

        by="kernel": the kernel sends them if the bus is can://socketcan, at more equal intervals, and the first one at
        once; `by_kernel` of the result is whether it does.
        """
        return cyclic_task(self.runner.bus, canopen.SyncProducer(period, overflow=overflow, key=check_key(key)), by)

    @subscription
    def events(
        self, period: float | None = None, *, overflow: int | None = None, key: Key = SYNC_KEY
    ) -> Subscription[canopen.SyncEvent]:
        """Return a stream of the SYNC messages of another producer, checked by `SyncMonitor`."""
        return Subscription(canopen.SyncMonitor(period, overflow=overflow, key=check_key(key)), frozenset({key}))


class TimeMethods(Methods[R]):
    """TIME messages. `key` is their (identifier, extended) if object 1012h of the nodes has another one than 100h."""

    @operation
    def send(self, unix: float | None = None, *, key: Key = TIME_KEY) -> BusOperation[None]:
        """Send one TIME message: the time of this computer, or `unix` in seconds since 1 January 1970."""
        stamp = canopen.TimeStamp.of_unix(time.time() if unix is None else unix)
        return send_frame(stamp.encode(check_key(key)))

    @background
    def start(self, period: float, *, key: Key = TIME_KEY) -> BackgroundTask:
        """Send the time of this computer at once and every `period` seconds, until it is stopped."""
        return BackgroundTask(
            canopen.TimeProducer(period, time.time() - time.monotonic(), key=check_key(key)), NO_FRAMES
        )

    @subscription
    def events(self, *, key: Key = TIME_KEY) -> Subscription[canopen.TimeReceived]:
        """Return a stream of the TIME messages of another producer."""
        return Subscription(canopen.TimeConsumer(key), frozenset({key}))
