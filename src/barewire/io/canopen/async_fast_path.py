"""The fast path of SDO for asyncio: see `fast_path`.

        task       begin, send, wait                  answer_in
        bus                          frame --> wake

A subscriber of the channel stays on the bus; its frames come from the event loop, if that reads the port, or from the
thread that does. A timer for each exchange would be costly: one timer is kept, and moved when it rings.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Coroutine
from typing import Any, Protocol, TypeVar

from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.plain import NOT_PLAIN, PlainExchange
from barewire.conversation import Conversation, Heard
from barewire.errors import PortError
from barewire.io.canopen.bus.async_bus import AsyncSubscriber
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import BusItem, FrameBus, Key
from barewire.io.canopen.fast_path import ChannelMemory, KnownChannel
from barewire.io.canopen.methods.operations import BusOperation, whole_transfer
from barewire.io.engine.asyncio import abandon

T = TypeVar("T")


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


class RunInTask(Protocol):
    """Runs a conversation on a channel; `heard` is the first input of one that already listens."""

    def __call__(
        self,
        channel: Channel,
        conversation: Conversation[CanFrame, T],
        port: AsyncSubscriber,
        heard: Heard[CanFrame] | None = None,
        /,
    ) -> Coroutine[Any, Any, T]: ...


class CarryOutInTask(Protocol):
    """Waits for the locks of an operation, and carries it out."""

    def __call__(self, operation: BusOperation[T], /) -> Coroutine[Any, Any, T]: ...


class AsyncFastPath(ChannelMemory[AsyncChannelSubscriber]):
    """The fast path of one asyncio client. `carry_out` and `run` are for all that is not plain."""

    def __init__(self, carry_out: CarryOutInTask, run: RunInTask) -> None:
        super().__init__()
        self._carry_out = carry_out
        self._run = run

    async def exchange(self, bus: CanBus, plain: PlainExchange[T]) -> T:
        """Carry out an exchange, or the transfer that it turns out to be."""
        known = self._known.get(plain.channel) or self._remember(plain.channel)
        lock, task = known.lock, asyncio.current_task()
        if bus.failure is not None or lock.granted:
            return await self._carry_out(whole_transfer(plain))
        try:
            if bus.lock_if_free(lock, task):
                return await self._exchange(bus, known, plain)
        finally:
            try:
                if lock.granted and lock.owner is task:
                    bus.release_lock(lock)
            finally:  # an exception may have come before it was released
                if lock.granted and lock.owner is task:
                    bus.release_lock(lock)
        return await self._carry_out(whole_transfer(plain))

    async def _exchange(self, bus: CanBus, known: KnownChannel[AsyncChannelSubscriber], plain: PlainExchange[T]) -> T:
        channel = plain.channel
        try:
            port = self._subscriber(bus, known)
            port.clear()
            request = plain.begin()
            sent_at = None if request is None else _send(bus, port, plain, request)
            if sent_at is None:
                return await self._run(channel, plain.whole(), port)
            try:
                frame = await port.receive_until(sent_at + plain.timeout)
            except BaseException as error:
                rest = plain.rest(sent_at)
                next(rest)
                abandon(rest, port, error)
                raise
            if frame is None:
                return await self._run(channel, plain.rest(sent_at), port)
            result = plain.answer_in(frame)
            if result is not NOT_PLAIN:
                return result
            rest = plain.rest(sent_at)
            next(rest)
            return await self._run(channel, rest, port, Heard(frame, port.loop.time()))
        finally:
            try:
                if channel.busy:
                    plain.be_interrupted(asyncio.get_running_loop().time())
            finally:
                if channel.busy:
                    plain.be_interrupted(asyncio.get_running_loop().time())

    def _subscriber(self, bus: CanBus, known: KnownChannel[AsyncChannelSubscriber]) -> AsyncChannelSubscriber:
        subscriber = known.subscriber
        if subscriber is None or subscriber.has_failed or subscriber.loop is not asyncio.get_running_loop():
            known.close()
            subscriber = known.subscriber = AsyncChannelSubscriber(bus, known.keys)
        return subscriber


def _send(bus: CanBus, port: AsyncChannelSubscriber, plain: PlainExchange[T], request: CanFrame) -> float | None:
    """Send a request, and return when; None, after ending the exchange, if a frame waits to be read first, or if there
    is no room. Raises PortError."""
    try:
        waits = bus.loop_reader is not None and bus.has_frames is not None and bus.has_frames()
        if not waits and bus.try_send(request, port):
            return port.loop.time()
    except PortError:
        plain.cancel()
        raise  # after any other exception the request may have been sent: see `PlainExchange.be_interrupted`
    plain.cancel()
    return None
