"""A shared bus for asyncio: a tap that wakes a task instead of a thread.

        reader (thread) --> AsyncTap --call_soon_threadsafe, once for all that came meanwhile--> the task

One mechanism for every interface of python-can. Of those only some have a file descriptor for `loop.add_reader`, slcan
may hold half a frame behind it, and `recv` of others blocks. A second mechanism for the few would save them a wake-up
and lose three things: frames have the time at which they came although the loop is busy, what nobody takes
is counted here instead of lost in the kernel, and blocking and asyncio clients may share one bus.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Iterable
from types import TracebackType
from typing import Self, TypeVar

from barewire.canopen.bus.channel_locks import LockKeys
from barewire.canopen.frame import CanFrame
from barewire.errors import PortError
from barewire.io.canopen.event_stream import ROOM, Hearing, Listener, Report
from barewire.io.canopen.node_runner import LOOK, Action, NodeDriver, Speaker, begin
from barewire.io.canopen.shared_bus import PATIENCE, CanBus, no_room
from barewire.io.canopen.subscriber import LONGEST, ROOM as TAP_ROOM, Arrived, Key, Subscriber, seconds

E = TypeVar("E")

RETRY = 0.001


class AsyncSubscriber(Subscriber):
    """What one task has of a bus: the port of the asyncio engine."""

    def __init__(
        self,
        bus: CanBus,
        keys: Iterable[Key] | None,
        *,
        room: int = TAP_ROOM,
        reports: bool = False,
        node: bool = False,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._thread = threading.get_ident()
        self._waiter: asyncio.Future[None] | None = None
        self._outbox: deque[CanFrame] = deque()
        self._pressing = False
        self._until = 0.0  # so long has the first of the outbox, until it is given up
        self._refused: PortError | None = None
        super().__init__(bus, keys, room=room, reports=reports, node=node)

    def _ring(self) -> None:
        if threading.get_ident() == self._thread:
            self.wake()
            return
        with contextlib.suppress(RuntimeError):  # the loop is closed: nobody is there to wake
            self._loop.call_soon_threadsafe(self.wake)

    def wake(self) -> None:
        """Let the task that waits look again, although nothing may have come."""
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    async def pull_async(self, timeout: float) -> Arrived | None:
        """What came within `timeout` seconds, or None."""
        arrived = self.take(wait=timeout > 0)
        if arrived is not None or timeout <= 0:
            return arrived
        waiter = self._waiter = self._loop.create_future()
        timer = self._loop.call_later(min(timeout, LONGEST), self.wake)
        try:
            await waiter
        finally:
            timer.cancel()
            self._waiter = None
        return self.take()

    async def receive(self, timeout: float) -> CanFrame | None:  # type: ignore[override]  # the other engine's port
        """The port of a conversation: a frame that came within `timeout` seconds, or None."""
        arrived = await self.pull_async(timeout)
        return None if arrived is None else arrived.item  # type: ignore[return-value]  # without reports only frames

    def write(self, item: CanFrame) -> None:
        """Hand a frame over. Where the controller has no room it goes out later, whether anybody waits for it or not:
        it may be the last word of a task that was cancelled."""
        if self._outbox or not self.bus.try_send(item, self):
            if not self._outbox:
                self._until = self._loop.time() + PATIENCE
            self._outbox.append(item)
            if not self._pressing:
                self._pressing = True
                self._loop.call_later(RETRY, self._go_on)

    async def sent(self) -> float | None:
        """Wait until the controller has all of it."""
        while self._outbox:
            await asyncio.sleep(RETRY)
            self._press()
        refused, self._refused = self._refused, None
        if refused is not None:
            raise refused
        return None

    def _press(self) -> None:
        try:
            while self._outbox and self.bus.try_send(self._outbox[0], self, again=True):
                self._outbox.popleft()
                self._until = self._loop.time() + PATIENCE  # each has its own
            if self._outbox and self._loop.time() >= self._until:
                raise PortError(no_room(self.bus.name))
        except PortError as error:
            self._outbox.clear()
            self._refused = error

    def _go_on(self) -> None:
        self._press()
        self._pressing = bool(self._outbox)
        if self._pressing:
            self._loop.call_later(RETRY, self._go_on)

    def hush(self) -> None:
        """What waits is not said."""
        self._outbox.clear()


async def wait_open(bus: CanBus, patience: float) -> None:
    """Where the bus is being opened anew, give it so many seconds."""
    if bus.failure is None:
        return
    loop, there = asyncio.get_running_loop(), asyncio.Event()

    def wake() -> None:
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(there.set)

    if not bus.when_open(wake):
        try:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(there.wait(), patience)
        finally:
            bus.wake_no_more(wake)


@contextlib.asynccontextmanager
async def locked(bus: CanBus, keys: LockKeys | None) -> AsyncIterator[None]:
    """Wait until these channels are free, and hold their locks."""
    loop = asyncio.get_running_loop()
    waiter: asyncio.Future[None] = loop.create_future()

    def go() -> None:
        if not waiter.done():
            waiter.set_result(None)

    def wake() -> None:
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(go)

    claim = bus.join(keys, asyncio.current_task(), wake)
    try:
        if not claim.granted:
            await waiter
        yield
    finally:
        bus.leave(claim)


class AsyncStream(Hearing[E]):
    """`Stream` for a task."""

    _tap: AsyncSubscriber

    def __init__(self, bus: CanBus, machine: Listener[E], keys: Iterable[Key] | None, *, room: int = ROOM) -> None:
        super().__init__(machine, AsyncSubscriber(bus, keys, room=room, reports=True))

    async def get(self, timeout: float | None = None) -> E | Report | None:
        """The next event within `timeout` seconds, or None; without a time-out, whenever it comes.

        Raises PortError if the bus is gone.
        """
        seconds(timeout)
        events, clock = self._events, time.monotonic
        until = float("inf") if timeout is None else clock() + timeout
        while not events.ready:
            now = clock()
            events.take(await self._tap.pull_async(events.wait_until(until) - now), clock())
            if not events.ready and clock() >= until:
                return None
        return events.ready.popleft()

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
    """A machine at work in a task, until it is stopped or the bus is gone for good.

    `do` does something with it and says at once what comes of it. `refused` counts what the bus did not take.
    """

    def __init__(self, bus: CanBus, machine: Speaker, keys: Iterable[Key] | None) -> None:
        self.machine = machine
        self.refused = 0
        self._tap = AsyncSubscriber(bus, keys, node=True, reports=True)
        self._task = asyncio.create_task(self._live())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.stop()

    async def _live(self) -> None:
        machine, ears, clock = self.machine, NodeDriver(self.machine), time.monotonic
        with self._tap:
            said = begin(machine, clock())
            while True:
                for frame in said:
                    await self._say(frame)
                deadline = machine.deadline
                try:
                    arrived = await self._tap.pull_async(LOOK if deadline is None else min(LOOK, deadline - clock()))
                except PortError:
                    return
                said = ears.hear(None if arrived is None else arrived.item, clock())
                await asyncio.sleep(0)

    async def _say(self, frame: CanFrame) -> None:
        try:
            self._tap.write(frame)
            await self._tap.sent()
        except PortError:
            self.refused += 1

    async def do(self, action: Action) -> None:
        """`action(now)`; the frames that it returns are said, and what is due then."""
        now = time.monotonic()
        for frame in [*(action(now) or ()), *self.machine.feed(None, now)]:
            await self._say(frame)

    def stop(self) -> None:
        """No further frame."""
        self._tap.hush()
        self._tap.close()
        self._task.cancel()

    close = stop
