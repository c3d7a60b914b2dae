"""A shared bus for asyncio: subscribers, streams and running machines that wake a task instead of a thread.

        port --readable--> event loop --> LoopReader --> AsyncSubscriber --> the task        a port with a descriptor
        reader (thread) --> AsyncSubscriber --call_soon_threadsafe, once for a whole burst--> the task         others

Most interfaces of python-can have no file descriptor for `loop.add_reader`; slcan may hold half a frame behind it, and
`recv` of others blocks. So a thread reads them, as it reads any bus that has listeners besides one event loop.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from typing import TypeVar

from barewire.canopen.frame import CanFrame
from barewire.errors import PortError
from barewire.io.canopen.bus.node_runner import Action, NodeStatistics, RunningMachine, Speaker
from barewire.io.canopen.bus.subscriber import (
    LONGEST_PULL,
    STREAM_ROOM,
    SUBSCRIBER_ROOM,
    Arrived,
    BusItem,
    FrameBus,
    FrameListener,
    Key,
    Listener,
    Report,
    StreamBase,
    Subscriber,
)
from barewire.io.endpoint import check_wait
from barewire.io.log import PortLog
from barewire.io.ports.base import SEND_TIMEOUT, no_room

E = TypeVar("E")

B = TypeVar("B", bound=FrameBus)

_SEND_RETRY = 0.001
"""Seconds between two attempts to send a frame for which the controller has no room."""
_ASK_AFTER = 8
"""Single frames after which a reader asks whether more have arrived."""
_BURST = 64
"""Frames that are read at once; then other tasks run."""
_RETRY_AFTER = 0.001
"""Seconds until the next attempt to read a port that another thread reads now, for 0.05 s at most."""


class AsyncSubscriber(Subscriber):
    """The port of one task on a shared bus."""

    def __init__(
        self,
        bus: FrameBus,
        keys: Iterable[Key] | None,
        *,
        room: int = SUBSCRIBER_ROOM,
        reports: bool = False,
        node: bool = False,
    ) -> None:
        self.loop: asyncio.AbstractEventLoop = asyncio.get_running_loop()
        self._thread = threading.get_ident()
        self._waiter: asyncio.Future[None] | None = None
        self._outbox: deque[CanFrame] = deque()
        self._retrying = False
        self._give_up_at = 0.0  # for the first frame of the outbox
        self._refused: PortError | None = None
        super().__init__(bus, keys, room=room, reports=reports, node=node)

    def _wake(self) -> None:
        if threading.get_ident() == self._thread:
            self.wake()
            return
        with contextlib.suppress(RuntimeError):  # the loop is closed: no task waits
            self.loop.call_soon_threadsafe(self.wake)

    def wake(self) -> None:
        """Wake the task that waits, so that it checks its deadline again."""
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    async def pull_async(self, timeout: float) -> Arrived | None:
        """Return the next item, or None after `timeout` seconds."""
        arrived = self.take(wait=timeout > 0)
        if arrived is not None:
            return arrived
        if timeout <= 0:
            return self._take_unread()
        waiter = self._waiter = self.loop.create_future()
        timer = self.loop.call_later(min(timeout, LONGEST_PULL), self.wake)
        try:
            await waiter
        finally:
            timer.cancel()
            self._waiter = None
        return self.take() or self._take_unread()

    def _take_unread(self) -> Arrived | None:
        """Return an item that waits in the port although the loop was not told: an exception of a signal handler ended
        what tells it. Left there, it would be taken for the response to the next request of the same object."""
        return self.take() if self.bus.read_in_loop(self.loop) else None

    async def receive(self, timeout: float) -> CanFrame | None:  # type: ignore[override]  # the other engine's port
        """Return the next frame, or None after `timeout` seconds. A conversation calls it."""
        arrived = await self.pull_async(timeout)
        return None if arrived is None else arrived.item  # type: ignore[return-value]  # without reports only frames

    def write(self, item: CanFrame) -> None:
        """Send a frame. If the controller has no room, the frame is sent later, even if no task waits for that: it may
        be the abort of a task that was cancelled."""
        if self._outbox or not self.bus.try_send(item, self):
            if not self._outbox:
                self._give_up_at = self.loop.time() + SEND_TIMEOUT
            self._outbox.append(item)
            if not self._retrying:
                self._retrying = True
                self.loop.call_later(_SEND_RETRY, self._retry)

    def write_all(self, items: Sequence[CanFrame]) -> None:
        """Send frames one after the other, or later those for which there is no room."""
        for item in items if self._outbox else items[self.bus.try_send_all(items, self) :]:
            self.write(item)

    async def sent(self) -> float | None:
        """Wait until the controller has all frames. Raises PortError if a frame could not be sent."""
        while self._outbox:
            await asyncio.sleep(_SEND_RETRY)
            self._send_outbox()
        refused, self._refused = self._refused, None
        if refused is not None:
            raise refused
        return None

    def _send_outbox(self) -> None:
        try:
            while self._outbox and self.bus.try_send(self._outbox[0], self, again=True):
                self._outbox.popleft()
                self._give_up_at = self.loop.time() + SEND_TIMEOUT  # each frame has its own
            if self._outbox and self.loop.time() >= self._give_up_at:
                raise no_room(self.bus.name)
        except PortError as error:
            self._outbox.clear()
            self._refused = error

    def _retry(self) -> None:
        self._send_outbox()
        self._retrying = bool(self._outbox)
        if self._retrying:
            self.loop.call_later(_SEND_RETRY, self._retry)

    def discard_queued(self) -> None:
        """Do not send the frames that still wait for room."""
        self._outbox.clear()


class AsyncChannelSubscriber(AsyncSubscriber):
    """The subscriber of one SDO channel for one task at a time, which stays on the bus between exchanges."""

    def __init__(self, bus: FrameBus, keys: frozenset[Key]) -> None:
        self._frames: deque[BusItem] = deque()
        self._deadline = 0.0
        self._timer: asyncio.TimerHandle | None = None
        super().__init__(bus, keys)

    def put(self, item: BusItem, at: float) -> None:
        """Add a frame, or count it as lost."""
        if len(self._frames) >= self.room:
            self.lost += 1
            return
        self._frames.append(item)
        if self._waiter is not None:  # set before the task looked for frames, so no frame is missed
            self._wake()

    def fail(self, why: str) -> None:
        """Let `receive` raise PortError(why) after the frames in the queue."""
        self._why = self._why or why
        if self._waiter is not None:
            self._wake()

    def clear(self) -> None:
        """Drop the frames that came between two exchanges. Raises PortError if the bus failed."""
        self._frames.clear()
        if self._why is not None:
            raise PortError(self._why)

    async def receive(self, timeout: float) -> CanFrame | None:  # type: ignore[override]  # the other engine's port
        """Return the next frame, or None after `timeout` seconds. Raises PortError."""
        if timeout > 0.0 and not self._frames:
            return await self.receive_until(self.loop.time() + timeout)
        if not self._frames:
            self.bus.read_in_loop(self.loop)
        return self._next()

    async def receive_until(self, until: float) -> CanFrame | None:
        """Return the next frame, or None when the clock of the loop is at `until`. Raises PortError."""
        if not self._frames:
            self._deadline = until
            if self._timer is None or self._timer.when() > until:
                self._set_timer(until)
            waiter = self._waiter = self.loop.create_future()
            try:
                if not self._frames and self._why is None:
                    await waiter
            finally:
                self._waiter = None
            if not self._frames:  # the time is over; see `_take_unread`
                self.bus.read_in_loop(self.loop)
        return self._next()

    def _next(self) -> CanFrame | None:
        if self._frames:
            return self._frames.popleft()  # type: ignore[return-value]  # without reports only frames
        if self._why is not None:
            raise PortError(self._why)
        return None

    def _set_timer(self, at: float) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.loop.call_at(at, self._ring)

    def _ring(self) -> None:
        """Wake the task that waits, if its time is over, or come again then."""
        self._timer = None
        if self._waiter is None:
            return
        if self.loop.time() >= self._deadline:
            self.wake()
        else:
            self._set_timer(self._deadline)


class LoopReader:
    """Reads the port of a bus in callbacks of the running event loop, until `stop`.

    A port can be read so if it has a `fileno`, which is readable while frames wait, or a `notify`, which registers a
    function that it calls when frames arrive; and if frames are kept until they are read. A listener in a thread, or in
    another loop, gets its frames from the reader thread of the bus: it starts when one comes, and this reader stops.

    A busy loop reads late. For streams whose events depend on time the port records when each frame arrived
    (`keep_times`).

    Raises NotImplementedError if the loop cannot watch descriptors, OSError if there are no more of them.
    """

    def __init__(self, bus: FrameBus) -> None:
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
        """Deliver frames with the time at which they arrived, if the port has it, instead of the present time."""
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
            with contextlib.suppress(RuntimeError):  # the loop is closed
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


class AsyncStream(StreamBase[E]):
    """`Stream` for a task."""

    _subscriber: AsyncSubscriber

    def __init__(
        self, bus: FrameBus, machine: Listener[E], keys: Iterable[Key] | None, *, room: int = STREAM_ROOM
    ) -> None:
        super().__init__(machine, AsyncSubscriber(bus, keys, room=room, reports=True))
        if not isinstance(machine, FrameListener):
            bus.keep_times()

    async def get(self, timeout: float | None = None) -> E | Report | None:
        """Return the next event, or None after `timeout` seconds. Without a time-out it waits for ever.

        Raises PortError if the bus is closed.
        """
        check_wait(timeout)
        clock = time.monotonic
        until = float("inf") if timeout is None else clock() + timeout
        while not self._ready:
            now = clock()
            self._feed(await self._subscriber.pull_async(self._wait_until(until) - now), clock())
            if not self._ready and clock() >= until:
                return None
        return self._ready.popleft()

    async def __aiter__(self) -> AsyncIterator[E | Report]:
        while True:
            try:
                event = await self.get()
            except PortError:
                if self._open:
                    raise
                return
            assert event is not None
            yield event


class AsyncRunning(RunningMachine):
    """A machine in an asyncio task. `do` changes the machine and sends the resulting frames at once."""

    def __init__(
        self,
        bus: FrameBus,
        machine: Speaker,
        keys: Iterable[Key] | None,
        statistics: NodeStatistics | None = None,
        log: PortLog | None = None,
    ) -> None:
        super().__init__(bus, machine, statistics, log)
        self._subscriber = AsyncSubscriber(bus, keys, node=True, reports=True)
        self._subscriber.machine = machine
        self._task = asyncio.create_task(self._run())

    async def _run(self) -> None:
        try:
            await self._serve()
        except Exception as error:
            self._ended(error)
            raise
        finally:
            self._release()

    async def _serve(self) -> None:
        driver, clock = self._driver, time.monotonic
        with self._subscriber:
            frames, count = driver.start(clock()), 0
            while True:
                for frame in frames:
                    await self._send(frame)
                try:
                    arrived = await self._subscriber.pull_async(driver.wait(clock()))
                except PortError:
                    return
                item = None if arrived is None else arrived.item
                self.statistics.count(item)
                frames = driver.feed(item, clock())
                count = 0 if item is None else (count + 1) % _BURST
                if not count:
                    await asyncio.sleep(0)  # a machine that is always due must not keep other tasks waiting

    async def _send(self, frame: CanFrame) -> None:
        try:
            self._subscriber.write(frame)
            await self._subscriber.sent()
            self.statistics.sent += 1
        except PortError as error:
            self.statistics.refused(frame, error, self._log)

    async def do(self, action: Action) -> None:
        """Call `action(now)`, then send the frames that it returns and those that are due.

        Raises what the action raises, and PortError if the machine has ended.
        """
        self._check_running()
        now = time.monotonic()
        for frame in [*(action(now) or ()), *self._driver.feed(None, now)]:
            await self._send(frame)

    def stop(self) -> None:
        """Stop the machine: it sends no further frame."""
        self._driver.release()
        self._subscriber.discard_queued()
        self._subscriber.close()
        self._task.cancel()

    close = stop


async def open_in_thread(open_bus: Callable[[], B]) -> B:
    """Open a bus in a thread. If the task is cancelled meanwhile, the bus is closed when it is open."""
    opened: list[B] = []
    abandoned = threading.Event()

    def work() -> B:
        bus = open_bus()
        opened.append(bus)
        if abandoned.is_set():
            bus.close()
        return bus

    try:
        return await asyncio.to_thread(work)
    except asyncio.CancelledError:
        abandoned.set()
        for bus in opened:
            bus.close()
        raise
