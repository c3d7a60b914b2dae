"""The blocking CANopen client.

    with CanopenClient("can://socketcan/can0", timeout=0.5) as bus:
        five, six = bus.node(5, device="az3"), bus.node(6, eds="valve.eds")
        five["TARGET VELOCITY"] = 1500
        six.sdo.upload(0x1000)

A client may be used from several threads. Transfers on one SDO channel run one at a time, in the order of the calls;
transfers with different nodes run at the same time. Several clients may share a bus:

    with CanBus.open("can://socketcan/can0") as shared:
        client, other = CanopenClient(shared), CanopenClient(shared, timeout=5.0)
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Self, TypeVar

from barewire.canopen import CanFrame
from barewire.canopen.channel_locks import ChannelLock, LockKeys
from barewire.canopen.sdo.channel import Channel
from barewire.conversation import Conversation, Heard
from barewire.errors import BarewireError, PortError
from barewire.io.canopen.bus.direct_port import DirectPort
from barewire.io.canopen.bus.event_stream import Listener, Stream
from barewire.io.canopen.bus.node_runner import Running
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import Key, Subscriber
from barewire.io.canopen.client_base import ClientBase
from barewire.io.canopen.fast_path import FastPath
from barewire.io.canopen.methods.operations import (
    AnyOperation,
    BackgroundTask,
    BlockingBusRunner,
    BusOperation,
    Subscription,
    checked_conversation,
    checked_listener,
)
from barewire.io.canopen.node import DeviceNode
from barewire.io.endpoint import check_timeout
from barewire.io.engine.blocking import run

if TYPE_CHECKING:
    from barewire.devices.device import Device

T = TypeVar("T")
E = TypeVar("E")


class CanopenClient(ClientBase[BlockingBusRunner, DeviceNode]):
    """A client of the nodes on a bus.

    bus         a can:// URL; a `CanBus`, which other clients may share; or a port, which the client closes
    node        1..127, the node of calls that name none; by default the device's own, or 1
    timeout     seconds that a request waits for its response, where a call gives no other; by default 1
    dialect     how SDO requests are written; "az3" is the form in the guide of the AZ3; by default the standard's
    watch       called as watch("sent" or "received", frame) with every frame; only for a bus opened by URL
    options     all other options of a URL, which they override: `bitrate`, those of the interface

    Raises EncodeError for a wrong URL or option, PortError for a bus that cannot be opened.
    """

    def _prepare(self) -> None:
        self._receiving = threading.Lock()
        self._everything: Subscriber | None = None
        self._fast_path = FastPath(self.carry_out, self._run)
        self._bus = self._new_bus(lazy=True)

    def _device_node(self, number: int, device: Device, **settings: Any) -> DeviceNode:
        return DeviceNode(self, number, device, **settings)

    def __enter__(self) -> Self:
        self._check_open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the streams and background tasks of this client, and the bus unless it is shared."""
        self._stop_running()
        self._fast_path.close()
        if self.owns_bus:
            self.bus.close()

    def run(self, conversation: Conversation[CanFrame, T]) -> T:
        """Carry out any conversation. It locks all channels of the bus, because those that it uses are unknown."""
        return self.carry_out(BusOperation(checked_conversation(conversation), None, None))

    def watch(self, machine: Listener[E], receives: frozenset[Key] | None = None) -> Stream[E]:
        """Return a stream of the events of any machine that listens. `receives` are the (identifier, extended) of its
        frames, None for all."""
        return self.subscribe(Subscription(checked_listener(machine), receives))

    def receive(self, timeout: float | None = None) -> CanFrame | None:
        """Return the next frame on the bus, or None after `timeout` seconds. The first call begins to collect frames.

        `frames` returns a stream.
        """
        wait = self.timeout if timeout is None else timeout
        check_timeout(wait)
        self._check_open()
        with self._receiving:
            if self._everything is None:
                self.bus.wait_until_open(wait)
                self._everything = Subscriber(self.bus, None, alone=True)
                self._running.add(self._everything)
            try:
                return self._everything.receive(wait)
            except PortError:
                if not self._closed:
                    self._everything = None  # a bus that is opened again needs a new subscriber
                raise

    # The runner of the methods

    def carry_out(self, operation: AnyOperation[T]) -> T:
        """Wait for the locks of an operation, then carry it out. If the bus is being opened again, wait for it too."""
        if self._closed:
            self._check_open()
        bus = self._bus or self.bus
        if not isinstance(operation, BusOperation):
            return self._fast_path.exchange(bus, operation)
        patience = self.timeout if operation.timeout is None else operation.timeout
        bus.wait_until_open(patience)
        receives = operation.receives
        with (
            channels_locked(bus, operation.locks),
            bus.direct(receives, patience) or Subscriber(bus, receives) as port,
        ):
            result: T = self._run(operation.channel, operation.conversation, port)
            return result

    def _run(
        self,
        channel: Channel | None,
        conversation: Conversation[CanFrame, T],
        port: DirectPort | Subscriber,
        heard: Heard[CanFrame] | None = None,
    ) -> T:
        """Run a conversation; `heard` is the first input of one that already listens."""
        with self._logged(channel):
            try:
                return run(conversation, port, heard=heard)
            except BarewireError as error:
                port.note_losses(error)
                raise

    def subscribe(self, subscription: Subscription[E]) -> Stream[E]:
        """Return a stream of the events of a subscription."""
        self._check_open()
        stream = Stream(self.bus, subscription.machine, subscription.receives)
        self._running.add(stream)
        return stream

    def start_task(self, task: BackgroundTask) -> Running:
        """Run the machine of a background task in a thread of its own."""
        self._check_open()
        running = Running(self.bus, task.machine, task.receives)
        self._running.add(running)
        return running


@contextlib.contextmanager
def channels_locked(bus: CanBus, keys: LockKeys | None) -> Iterator[None]:
    """Wait until these channels are free, and hold their locks. None means the whole bus."""
    is_free = threading.Lock()  # made sooner than an event: most channels are free
    is_free.acquire()

    def wake() -> None:
        with contextlib.suppress(RuntimeError):  # it was woken already
            is_free.release()

    lock = ChannelLock(keys, threading.get_ident(), wake)
    try:
        bus.request_lock(lock)
        if not lock.granted:
            is_free.acquire()
        yield
    finally:
        try:
            bus.release_lock(lock)
        finally:  # an exception may have come before it was released; a second time has no effect
            bus.release_lock(lock)
