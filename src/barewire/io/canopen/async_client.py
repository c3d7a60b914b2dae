"""The asyncio CANopen client: the same methods as the blocking client, awaited, on the same buses.

    async with AsyncCanopenClient("can://socketcan/can0", timeout=0.5) as bus:
        await bus.node(5, device="az3").read("STATUS WORD")
        await asyncio.gather(*(bus.node(number).sdo.upload(0x1000) for number in range(1, 6)))

Transfers on one SDO channel run one at a time, in the order of the calls; transfers with different nodes run
concurrently. If a task is cancelled, its transfer is aborted, and late responses are ignored.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from typing import TYPE_CHECKING, Any, Self, TypeVar

from barewire.canopen import CanFrame
from barewire.canopen.channel_locks import ChannelLock, LockKeys
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.plain import NOT_PLAIN, PlainExchange
from barewire.conversation import Conversation, Heard
from barewire.errors import BarewireError, PortError
from barewire.io.canopen.bus.async_bus import (
    AsyncChannelSubscriber,
    AsyncRunning,
    AsyncStream,
    AsyncSubscriber,
    open_in_thread,
)
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.client_base import ClientBase, KnownChannel, rest_of
from barewire.io.canopen.node import AsyncDeviceNode
from barewire.io.canopen.operations import (
    AnyOperation,
    AsyncBusRunner,
    BusOperation,
    whole_transfer,
)
from barewire.io.endpoint import check_wait
from barewire.io.engine.asyncio import abandon, run

if TYPE_CHECKING:
    from barewire.devices.device import Device

T = TypeVar("T")
E = TypeVar("E")


class AsyncCanopenClient(ClientBase[AsyncBusRunner, AsyncDeviceNode]):
    """A client of the nodes on a bus, for asyncio. The arguments are those of `CanopenClient`.

    The constructor opens nothing; `async with` or `await open()` opens a bus given by its URL. Without them the first
    request does; a stream, and a machine in the background, need an open bus. `watch` is called in the event
    loop if that reads the bus, on SocketCAN without other listeners; else in the reader thread.
    """

    _stream_type, _running_type = AsyncStream, AsyncRunning

    def _prepare(self) -> None:
        self._receiving = asyncio.Lock()
        self._connecting = asyncio.Lock()
        self._everything: AsyncSubscriber | None = None
        if self._endpoint is None:
            self._bus = self._new_bus(lazy=True)

    def _device_node(self, number: int, device: Device, **settings: Any) -> AsyncDeviceNode:
        return AsyncDeviceNode(self, number, device, **settings)

    async def open(self) -> None:
        """Open the bus, unless it is open. Raises PortError if that fails, or if the client was closed."""
        self._check_open()
        async with self._connecting:
            if self._bus is None:
                self._bus = await open_in_thread(lambda: self._new_bus(lazy=True))
                if self._closed:
                    await asyncio.to_thread(self._bus.close)

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the streams and background tasks of this client, and the bus unless it is shared."""
        self._stop_running()
        if self.owns_bus and self._bus is not None:
            await asyncio.to_thread(self._bus.close)  # it waits until the reader thread of the bus has ended

    async def receive(self, timeout: float | None = None) -> CanFrame | None:
        """Return the next frame on the bus, or None after `timeout` seconds. The first call begins to collect frames.

        `frames` returns a stream.
        """
        wait = self.timeout if timeout is None else timeout
        check_wait(wait)
        self._check_open()
        if self._bus is None:
            await self.open()
        async with self._receiving:
            if self._everything is None:
                await wait_until_open(self.bus, wait)
                self._everything = AsyncSubscriber(self.bus, None)
                self._running.add(self._everything)
            try:
                return await self._everything.receive(wait)
            except PortError:
                if not self._closed:
                    self._everything = None  # a bus that is opened again needs a new subscriber
                raise

    # The runner of the methods

    async def carry_out(self, operation: AnyOperation[T]) -> T:
        """Wait for the locks of an operation, then carry it out. If the bus is being opened again, wait for it too."""
        if self._closed:
            self._check_open()
        bus = self._bus or self.bus
        if not isinstance(operation, BusOperation):
            return await self._exchange(bus, operation)
        await wait_until_open(bus, self.timeout if operation.timeout is None else operation.timeout)
        async with channels_locked(bus, operation.locks):
            with AsyncSubscriber(bus, operation.receives) as subscriber:
                result: T = await self._run(operation.channel, operation.conversation, subscriber)
                return result

    async def _run(
        self,
        channel: Channel | None,
        conversation: Conversation[CanFrame, T],
        port: AsyncSubscriber,
        heard: Heard[CanFrame] | None = None,
    ) -> T:
        """Run a conversation; `heard` is the first input of one that already listens."""
        with self._logged(channel):
            try:
                return await run(conversation, port, heard)
            except BarewireError as error:
                port.note_losses(error)
                raise

    async def open_and_carry_out(self, make: Callable[[], AnyOperation[T]]) -> T:
        """Open the bus, unless it is open, then carry out the operation that `make` returns."""
        if self._bus is None:
            await self.open()
        return await self.carry_out(make())

    # The fast path, see `client_base`

    async def _exchange(self, bus: CanBus, plain: PlainExchange[T]) -> T:
        """Carry out an exchange, or the transfer that it turns out to be."""
        known = self._known.get(plain.channel) or self._remember(plain.channel)
        lock, task = known.lock, asyncio.current_task()
        if bus.failure is not None or lock.granted:
            return await self.carry_out(whole_transfer(plain))
        try:
            if bus.lock_if_free(lock, task):
                return await self._exchange_locked(bus, known, plain)
        finally:
            try:
                if lock.granted and lock.owner is task:
                    bus.release_lock(lock)
            finally:  # an exception may have come before it was released
                if lock.granted and lock.owner is task:
                    bus.release_lock(lock)
        return await self.carry_out(whole_transfer(plain))

    async def _exchange_locked(self, bus: CanBus, known: KnownChannel, plain: PlainExchange[T]) -> T:
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
                abandon(rest_of(plain, sent_at), port, error)
                raise
            if frame is None:
                return await self._run(channel, plain.rest(sent_at), port)
            result = plain.answer_in(frame)
            if result is not NOT_PLAIN:
                return result
            return await self._run(channel, rest_of(plain, sent_at), port, Heard(frame, port.loop.time()))
        finally:
            try:
                if channel.busy:
                    plain.be_interrupted(asyncio.get_running_loop().time())
            finally:
                if channel.busy:
                    plain.be_interrupted(asyncio.get_running_loop().time())

    def _subscriber(self, bus: CanBus, known: KnownChannel) -> AsyncChannelSubscriber:
        subscriber: AsyncChannelSubscriber | None = known.subscriber
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
                async with asyncio.timeout(timeout):  # `wait_for` may lose a cancellation before Python 3.12
                    await is_open.wait()
        finally:
            bus.cancel_wake(wake)


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
