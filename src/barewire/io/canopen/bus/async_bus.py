"""A shared bus for asyncio: subscribers, streams and running machines that wake a task instead of a thread.

        event loop --> LoopReader --> AsyncSubscriber --> the task                           a port with a descriptor
        reader (thread) --> AsyncSubscriber --call_soon_threadsafe, once for a whole burst--> the task           others

Most interfaces of python-can have no file descriptor for `loop.add_reader`; slcan may hold half a frame behind it, and
`recv` of others blocks. So a thread reads them, as it reads any bus that has listeners besides one event loop.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from typing import Self, TypeVar

from barewire.canopen.channel_locks import ChannelLock, LockKeys
from barewire.canopen.frame import CanFrame
from barewire.errors import PortError
from barewire.io.canopen.bus.event_stream import STREAM_ROOM, FrameListener, Listener, Report, StreamBase
from barewire.io.canopen.bus.node_runner import (
    Action,
    NodeDriver,
    NodeStatistics,
    Speaker,
    check_node_is_free,
    ended_text,
)
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import (
    LONGEST_PULL,
    SUBSCRIBER_ROOM,
    Arrived,
    FrameBus,
    Key,
    Subscriber,
)
from barewire.io.endpoint import check_timeout
from barewire.io.log import PortLog
from barewire.io.ports.base import SEND_TIMEOUT, no_room

E = TypeVar("E")

_SEND_RETRY = 0.001


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


async def wait_until_open(bus: CanBus, timeout: float) -> None:
    """If the bus is being opened again, wait for it, `timeout` seconds at most."""
    if bus.failure is None:
        return
    loop, is_open = asyncio.get_running_loop(), asyncio.Event()

    def wake() -> None:
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(is_open.set)

    if not bus.when_open(wake):
        try:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(is_open.wait(), timeout)
        finally:
            bus.cancel_wake(wake)


async def open_in_thread(open_bus: Callable[[], CanBus]) -> CanBus:
    """Open a bus in a thread. If the task is cancelled meanwhile, the bus is closed when it is open."""
    opened: list[CanBus] = []
    abandoned = threading.Event()

    def work() -> CanBus:
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


@contextlib.asynccontextmanager
async def channels_locked(bus: CanBus, keys: LockKeys | None) -> AsyncIterator[None]:
    """Wait until these channels are free, and hold their locks. None means the whole bus."""
    loop = asyncio.get_running_loop()
    waiter: asyncio.Future[None] = loop.create_future()

    def grant() -> None:
        if not waiter.done():
            waiter.set_result(None)

    def wake() -> None:
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(grant)

    lock = ChannelLock(keys, asyncio.current_task(), wake)
    try:
        bus.request_lock(lock)
        if not lock.granted:
            await waiter
        yield
    finally:
        try:
            bus.release_lock(lock)
        finally:  # an exception may have come before it was released; a second time has no effect
            bus.release_lock(lock)


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
        check_timeout(timeout)
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


class AsyncRunning:
    """A machine in an asyncio task, until it is stopped or the bus is closed.

    `do` changes the machine and sends the resulting frames at once. `statistics` counts frames.
    """

    def __init__(
        self,
        bus: FrameBus,
        machine: Speaker,
        keys: Iterable[Key] | None,
        statistics: NodeStatistics | None = None,
        log: PortLog | None = None,
    ) -> None:
        self.machine = machine
        self.statistics = NodeStatistics() if statistics is None else statistics
        self._log = PortLog("barewire.canopen.client", f"can://{bus.name}") if log is None else log
        self._driver = NodeDriver(machine, self.statistics, self._log)
        check_node_is_free(bus, machine)
        self._subscriber = AsyncSubscriber(bus, keys, node=True, reports=True)
        self._subscriber.machine = machine
        self.failure: BaseException | None = None
        """The error that ended the machine: it could not be started."""
        self.by_kernel: bool = getattr(machine, "by_kernel", False)
        """Whether the kernel sends the frames of the machine."""
        self._task = asyncio.create_task(self._run())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    async def _run(self) -> None:
        try:
            await self._serve()
        except Exception as error:
            self.failure = error
            self._log.error("ended", ended_text(self.machine, error), error)
            raise
        finally:
            self._driver.release()
            self._log.flush()

    async def _serve(self) -> None:
        driver, clock = self._driver, time.monotonic
        with self._subscriber:
            frames = driver.start(clock())
            while True:
                for frame in frames:
                    await self._send(frame)
                try:
                    arrived = await self._subscriber.pull_async(driver.wait(clock()))
                except PortError:
                    return
                self.statistics.count(None if arrived is None else arrived.item)
                frames = driver.feed(None if arrived is None else arrived.item, clock())
                await asyncio.sleep(0)

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
        if self.failure is not None:
            raise PortError(f"{self._log.place}: {ended_text(self.machine, self.failure)}")
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
