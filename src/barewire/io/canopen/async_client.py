"""The asyncio CANopen client: the same methods as the blocking client, awaited, on the same buses.

    async with AsyncCanopenClient("can://socketcan/can0", timeout=0.5) as bus:
        await bus.node(5, device="az3").read("STATUS WORD")
        await asyncio.gather(*(bus.node(number).sdo.upload(0x1000) for number in range(1, 6)))

Transfers on one SDO channel run one at a time, in the order of the calls; transfers with different nodes run
concurrently. If a task is cancelled, its transfer is aborted, and late responses are ignored.
"""

from __future__ import annotations

import asyncio
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar, overload

from barewire.canopen import CanFrame
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.conversation import Conversation
from barewire.errors import BarewireError, PortError
from barewire.io.canopen.async_bus import (
    AsyncRunning,
    AsyncStream,
    AsyncSubscriber,
    channels_locked,
    open_in_thread,
    wait_until_open,
)
from barewire.io.canopen.client_base import ClientBase
from barewire.io.canopen.event_stream import Listener
from barewire.io.canopen.methods.operations import AsyncBusRunner, BackgroundTask, BusOperation, Subscription
from barewire.io.canopen.node import AsyncDeviceNode, EdsNode, Node, dictionary_of
from barewire.io.canopen.node_runner import Speaker
from barewire.io.canopen.shared_bus import CanBus, WatchFrames
from barewire.io.canopen.subscriber import Key
from barewire.io.endpoint import check_timeout
from barewire.io.engine.asyncio import run
from barewire.io.ports.base import Port

if TYPE_CHECKING:
    from pathlib import Path

    from barewire.canopen.eds.eds_file import Eds
    from barewire.canopen.object_dictionary import ObjectDictionary
    from barewire.devices.device import Device

T = TypeVar("T")
E = TypeVar("E")


class AsyncCanopenClient(ClientBase[AsyncBusRunner]):
    """A client of the nodes on a bus, for asyncio. The arguments are those of `CanopenClient`.

    A bus given by its URL is opened by `async with`, or by `connect`. `watch` is called in the reader thread.
    """

    def __init__(
        self,
        bus: str | CanBus | Port[CanFrame],
        *,
        node: int | None = None,
        timeout: float | None = None,
        dialect: str | SdoDialect | None = None,
        watch: WatchFrames | None = None,
        **options: Any,
    ) -> None:
        # The client itself is the runner of its methods.
        super().__init__(self, bus, node, timeout, dialect, watch, options)
        self._receiving = asyncio.Lock()
        self._connecting = asyncio.Lock()
        self._everything: AsyncSubscriber | None = None
        self._closed = False
        if self._endpoint is None:
            self._bus = self._new_bus()

    async def connect(self) -> Self:
        """Open the bus, unless it is open. Raises PortError."""
        async with self._connecting:
            if self._bus is None:
                self._bus = await open_in_thread(self._new_bus)
                if self._closed:
                    await asyncio.to_thread(self._bus.close)
        return self

    async def __aenter__(self) -> Self:
        return await self.connect()

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        await self.aclose()

    def close(self) -> None:
        """Close the streams and background tasks of this client, and the bus if this client opened it."""
        self._close_tasks()
        if self.owns_bus and self._bus is not None:
            self._bus.close()

    async def aclose(self) -> None:
        """The same as `close`, but the loop is not blocked while the reader thread of the bus ends."""
        self._close_tasks()
        if self.owns_bus and self._bus is not None:
            await asyncio.to_thread(self._bus.close)

    def _close_tasks(self) -> None:
        self._closed = True
        if self._everything is not None:
            self._everything.close()
        for running in list(self._running):
            running.close()

    @overload
    def node(
        self,
        number: int | None = None,
        *,
        device: str | Path | Device,
        timeout: float | None = None,
        dialect: str | SdoDialect | None = None,
    ) -> AsyncDeviceNode: ...
    @overload
    def node(
        self,
        number: int | None = None,
        *,
        eds: str | Path | Eds | ObjectDictionary,
        timeout: float | None = None,
        dialect: str | SdoDialect | None = None,
    ) -> EdsNode[AsyncBusRunner]: ...
    @overload
    def node(
        self, number: int | None = None, *, timeout: float | None = None, dialect: str | SdoDialect | None = None
    ) -> Node[AsyncBusRunner]: ...
    def node(
        self,
        number: int | None = None,
        *,
        device: str | Path | Device | None = None,
        eds: str | Path | Eds | ObjectDictionary | None = None,
        timeout: float | None = None,
        dialect: str | SdoDialect | None = None,
    ) -> Node[AsyncBusRunner]:
        """One node of the bus: `number` (1..127), or that of the URL, or the device's own. `device` is the name or path
        of a description, or a description; `eds` the path of an EDS, a parsed one, or an ObjectDictionary."""
        description, node_id = self._described(number, device, eds)
        settings: dict[str, Any] = self._settings(timeout, dialect)
        if description is not None:
            return AsyncDeviceNode(self, node_id, description, **settings)
        if eds is not None:
            return EdsNode(self, node_id, dictionary_of(eds, node_id), **settings)
        return Node(self, node_id, **settings)

    async def run(self, conversation: Conversation[CanFrame, T]) -> T:
        """Carry out any conversation. It locks all channels of the bus, because those that it uses are unknown."""
        return await self.carry_out(BusOperation(conversation, None, None))

    def watch(self, machine: Listener[E], receives: frozenset[Key] | None = None) -> AsyncStream[E]:
        """The events of a machine that only listens. `receives` are its (identifier, extended), None for all frames."""
        return self.subscribe(Subscription(machine, receives))

    def start(self, machine: Speaker, receives: frozenset[Key] | None = None) -> AsyncRunning:
        """Run any machine that also sends frames, until it is stopped."""
        return self.start_task(BackgroundTask(machine, receives))

    async def receive(self, timeout: float | None = None) -> CanFrame | None:
        """The next frame on the bus, or None after `timeout` seconds. The first call begins to collect frames.

        `frames` returns a stream.
        """
        wait = self.timeout if timeout is None else timeout
        check_timeout(wait)
        async with self._receiving:
            if self._everything is None:
                await wait_until_open(self.bus, wait)
                self._everything = AsyncSubscriber(self.bus, None)
            try:
                return await self._everything.receive(wait)
            except PortError:
                if not self._closed:
                    self._everything = None  # a bus that is opened again needs a new subscriber
                raise

    # The runner of the methods

    async def carry_out(self, operation: BusOperation[T]) -> T:
        """Wait for the locks of an operation, then carry it out. If the bus is being opened again, wait for it too."""
        await wait_until_open(self.bus, self.timeout if operation.timeout is None else operation.timeout)
        async with channels_locked(self.bus, operation.locks):
            with AsyncSubscriber(self.bus, operation.receives) as subscriber:
                try:
                    return await run(operation.conversation, subscriber)
                except BarewireError as error:
                    subscriber.note_losses(error)
                    raise

    def subscribe(self, subscription: Subscription[E]) -> AsyncStream[E]:
        """A stream of the events of a subscription."""
        stream = AsyncStream(self.bus, subscription.machine, subscription.receives)
        self._running.add(stream)
        return stream

    def start_task(self, task: BackgroundTask) -> AsyncRunning:
        """Run the machine of a background task in an asyncio task."""
        running = AsyncRunning(self.bus, task.machine, task.receives)
        self._running.add(running)
        return running
