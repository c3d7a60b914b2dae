"""Reads a shared bus in callbacks of an event loop, so that asyncio clients need no reader thread.

        port  --readable-->  event loop  -->  LoopReader.read  -->  subscribers, all of this loop     [loop.add_reader]

A port can be read so if it has a `fileno`, which is readable while frames wait, or a `notify`, which registers a
function that it calls when frames arrive; and if frames are kept until they are read. A listener in a thread, or in
another loop, gets its frames from the reader thread of the bus: it starts when one comes, and this reader stops. Only
the holder of the bus's lock reads, and each frame is delivered to all subscribers, so none is lost or delivered
twice.

A busy loop reads late. For streams whose events depend on time the port records when each frame arrived (`keep_times`).
"""

from __future__ import annotations

import asyncio
import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

from barewire.canopen.frame import CanFrame
from barewire.errors import PortError
from barewire.io.canopen.bus.subscriber import BusItem
from barewire.io.ports.base import Port

_ASK_AFTER = 8
_BURST = 64
"""Frames that are read at once; then other tasks run."""
_RETRY_AFTER = 0.001
"""Seconds until the next attempt to read a port that another thread reads now, for 0.05 s at most."""


class LoopReadableBus(Protocol):
    """The operations of a bus that a `LoopReader` uses; those of `CanBus` are described there."""

    port: Port[CanFrame]
    has_frames: Callable[[], bool] | None
    reading: threading.Lock
    loop_reader: LoopReader | None

    def read_now(self, timeout: float, /) -> BusItem | None: ...

    def deliver(self, item: BusItem, at: float, /) -> bool: ...

    def report_losses(self) -> None: ...

    def fail_directly(self, why: str, /) -> None: ...


class LoopReader:
    """Reads the port of a bus in the running event loop, until `stop`. Raises NotImplementedError if that loop cannot
    watch descriptors, OSError if there are no more of them."""

    def __init__(self, bus: LoopReadableBus) -> None:
        self.loop = asyncio.get_running_loop()
        self._bus = bus
        self._thread = threading.get_ident()
        self._last = 0.0  # the time of the last frame
        self._is_rung = False
        self._singles = 0
        self._descriptor = -1
        self._notify: Callable[[Callable[[], object] | None], object] | None = getattr(bus.port, "notify", None)
        if self._notify is not None:
            self._notify(self._ring)
            return
        # The port may be closed in a thread, and its number be that of another file before this loop notices.
        self._descriptor = os.dup(bus.port.fileno())  # type: ignore[attr-defined]
        try:
            self.loop.add_reader(self._descriptor, self.read)
        except BaseException:
            os.close(self._descriptor)
            raise

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {getattr(self._bus.port, 'name', 'the bus')}>"

    def keep_times(self) -> None:
        """Deliver frames with the time at which they arrived, if the port knows it, instead of the present time."""
        keep_times = getattr(self._bus.port, "keep_times", None)
        if keep_times is not None:
            keep_times()

    def _ring(self) -> None:
        """Let the loop read: called by a port that has no descriptor, in any thread."""
        if self._is_rung:
            return
        try:
            self._is_rung = True
            if threading.get_ident() == self._thread:
                self.loop.call_soon(self.read)
                return
            with suppress(RuntimeError):  # the loop is closed
                self.loop.call_soon_threadsafe(self.read)
        except BaseException:  # of a signal handler: the next frame tells the loop again
            self._is_rung = False
            raise

    def read(self) -> None:
        """Deliver the frames that have arrived."""
        try:
            self._is_rung = False
            self._read()
        except BaseException:
            self._is_rung = False
            raise

    def _read(self) -> None:
        bus, count, why = self._bus, 0, None
        if bus.loop_reader is not self:
            return  # the reader thread has begun
        if not bus.reading.acquire(blocking=False):
            # A listener that ends in another thread still reads. What comes after its last read is left to this loop,
            # which a port without a descriptor tells only once.
            if self._notify is not None:
                self._is_rung = True
                self.loop.call_later(_RETRY_AFTER, self.read)
            return
        try:
            while count < _BURST and (item := bus.read_now(0.0)) is not None:
                count += 1
                if not bus.deliver(item, self._time()):
                    return
                if count == 1 and bus.has_frames is not None and not self._may_go_on(bus.has_frames):
                    break
            bus.report_losses()
        except PortError as error:
            why = str(error)
        finally:
            bus.reading.release()
        if why is not None:
            bus.fail_directly(why)
        elif count == _BURST:
            self.loop.call_soon(self.read)  # the port may hold frames that its descriptor does not show

    def _may_go_on(self, has_frames: Callable[[], bool]) -> bool:
        """Return whether to read on after one frame: in a burst, reading all at once spares turns of the loop.

        The question costs as much as a read, and most frames are single answers. So of a descriptor, which the loop
        looks at again anyway, it is asked after every eighth single frame only, and always while a burst lasts.
        """
        if self._descriptor >= 0 and self._singles % _ASK_AFTER:
            self._singles += 1
            return False
        self._singles = 0 if has_frames() else 1
        return not self._singles

    def _time(self) -> float:
        """Return when the last frame arrived: not in the future, and not before the one before, if clocks are set."""
        now = time.monotonic()
        arrived: float | None = getattr(self._bus.port, "received_at", None)
        if arrived is not None:
            now = max(self._last, min(now, now - (time.time() - arrived)))
        self._last = now
        return now

    def stop(self) -> None:
        """Do not read any more. May be called in any thread; the loop is told if it is another's."""
        if threading.get_ident() == self._thread or self.loop.is_closed():
            self._release()
            return
        try:
            self.loop.call_soon_threadsafe(self._release)
        except RuntimeError:  # closed meanwhile
            self._release()

    def _release(self) -> None:
        if self._notify is not None:
            self._notify(None)
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            if not self.loop.is_closed():
                self.loop.remove_reader(descriptor)
            os.close(descriptor)
