"""The asyncio CANopen client: the same methods as the blocking client, awaited, on the same buses.

    async with AsyncCanopenClient("can://socketcan/can0", timeout=0.5) as bus:
        await bus.node(5, device="az3").read("STATUS WORD")
        await asyncio.gather(*(bus.node(number).sdo.upload(0x1000) for number in range(1, 6)))

Transfers on one SDO channel run one at a time, in the order of the calls; transfers with different nodes run
concurrently. If a task is cancelled, its transfer is aborted, and late responses are ignored.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Self, TypeVar

from barewire.canopen import CanFrame
from barewire.canopen.sdo.channel import Channel
from barewire.conversation import Conversation, Heard
from barewire.errors import BarewireError, PortError
from barewire.io.canopen.async_fast_path import AsyncFastPath
from barewire.io.canopen.bus.async_bus import (
    AsyncRunning,
    AsyncStream,
    AsyncSubscriber,
    channels_locked,
    open_in_thread,
    wait_until_open,
)
from barewire.io.canopen.bus.event_stream import Listener
from barewire.io.canopen.bus.subscriber import Key
from barewire.io.canopen.client_base import ClientBase
from barewire.io.canopen.methods.operations import (
    AnyOperation,
    AsyncBusRunner,
    BackgroundTask,
    BusOperation,
    Subscription,
    checked_conversation,
    checked_listener,
)
from barewire.io.canopen.node import AsyncDeviceNode
from barewire.io.endpoint import check_timeout
from barewire.io.engine.asyncio import run

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

    def _prepare(self) -> None:
        self._receiving = asyncio.Lock()
        self._connecting = asyncio.Lock()
        self._everything: AsyncSubscriber | None = None
        self._fast_path = AsyncFastPath(self.carry_out, self._run)
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
        self._fast_path.close()
        if self.owns_bus and self._bus is not None:
            await asyncio.to_thread(self._bus.close)  # it waits until the reader thread of the bus has ended

    async def run(self, conversation: Conversation[CanFrame, T]) -> T:
        """Carry out any conversation. It locks all channels of the bus, because those that it uses are unknown."""
        return await self.open_and_carry_out(lambda: BusOperation(checked_conversation(conversation), None, None))

    def watch(self, machine: Listener[E], receives: frozenset[Key] | None = None) -> AsyncStream[E]:
        """Return a stream of the events of any machine that listens. `receives` are the (identifier, extended) of its
        frames, None for all."""
        return self.subscribe(Subscription(checked_listener(machine), receives))

    async def receive(self, timeout: float | None = None) -> CanFrame | None:
        """Return the next frame on the bus, or None after `timeout` seconds. The first call begins to collect frames.

        `frames` returns a stream.
        """
        wait = self.timeout if timeout is None else timeout
        check_timeout(wait)
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
            return await self._fast_path.exchange(bus, operation)
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

    def subscribe(self, subscription: Subscription[E]) -> AsyncStream[E]:
        """Return a stream of the events of a subscription."""
        self._check_open()
        stream = AsyncStream(self.bus, subscription.machine, subscription.receives)
        self._running.add(stream)
        return stream

    def start_task(self, task: BackgroundTask) -> AsyncRunning:
        """Run the machine of a background task in an asyncio task."""
        self._check_open()
        running = AsyncRunning(self.bus, task.machine, task.receives)
        self._running.add(running)
        return running
