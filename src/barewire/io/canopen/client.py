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
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Self, TypeVar

from barewire.canopen import CanFrame
from barewire.canopen.channel_locks import ChannelLock, LockKeys
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.plain import NOT_PLAIN, PlainExchange
from barewire.conversation import Conversation, Heard
from barewire.errors import BarewireError, PortError
from barewire.io.canopen.bus.direct_port import DirectPort
from barewire.io.canopen.bus.node_runner import Running
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import ChannelSubscriber, Stream, Subscriber
from barewire.io.canopen.client_base import ClientBase, KnownChannel, rest_of
from barewire.io.canopen.node import DeviceNode
from barewire.io.canopen.operations import (
    AnyOperation,
    BlockingBusRunner,
    BusOperation,
    whole_transfer,
)
from barewire.io.endpoint import check_wait
from barewire.io.engine.blocking import abandon, run

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

    _stream_type, _running_type = Stream, Running

    def _prepare(self) -> None:
        self._receiving = threading.Lock()
        self._everything: Subscriber | None = None
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
        if self.owns_bus:
            self.bus.close()

    def receive(self, timeout: float | None = None) -> CanFrame | None:
        """Return the next frame on the bus, or None after `timeout` seconds. The first call begins to collect frames.

        `frames` returns a stream.
        """
        wait = self.timeout if timeout is None else timeout
        check_wait(wait)
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
            return self._exchange(bus, operation)
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

    # The fast path, see `client_base`

    def _exchange(self, bus: CanBus, plain: PlainExchange[T]) -> T:
        """Carry out an exchange, or the transfer that it turns out to be."""
        known = self._known.get(plain.channel) or self._remember(plain.channel)
        lock, thread = known.lock, threading.get_ident()
        if bus.failure is not None or lock.granted:
            return self.carry_out(whole_transfer(plain))
        try:
            if bus.lock_if_free(lock, thread):
                return self._exchange_locked(bus, known, plain)
        finally:
            try:
                if lock.granted and lock.owner == thread:
                    bus.release_lock(lock)
            finally:  # an exception may have come before it was released
                if lock.granted and lock.owner == thread:
                    bus.release_lock(lock)
        return self.carry_out(whole_transfer(plain))

    def _exchange_locked(self, bus: CanBus, known: KnownChannel, plain: PlainExchange[T]) -> T:
        try:
            port = known.direct
            if port is None:
                port = known.direct = DirectPort(bus, bus.reading, known.keys)
            try:
                if bus.begin_direct(port, plain.timeout):
                    return self._exchange_on(port, plain)
            finally:
                try:
                    port.close()
                finally:  # an exception may have come before it was closed
                    port.close()
            return self._exchange_on(self._subscriber(bus, known), plain)
        finally:
            try:
                if plain.channel.busy:
                    plain.be_interrupted(time.monotonic())
            finally:
                if plain.channel.busy:
                    plain.be_interrupted(time.monotonic())

    def _exchange_on(self, port: DirectPort | ChannelSubscriber, plain: PlainExchange[T]) -> T:
        request = plain.begin()
        if request is None:
            return self._run(plain.channel, plain.whole(), port)
        try:
            frame = port.exchange(request, plain.timeout)
        except BaseException as error:
            # End the exchange as its conversation does.
            if port.sent_at is None:
                plain.cancel()
            else:
                abandon(rest_of(plain, port.sent_at), port, error)
            raise
        sent_at = port.sent_at
        if sent_at is None:
            plain.cancel()
            return self._run(plain.channel, plain.whole(), port)
        if frame is None:
            return self._run(plain.channel, plain.rest(sent_at), port)
        result = plain.answer_in(frame)
        if result is not NOT_PLAIN:
            return result
        return self._run(plain.channel, rest_of(plain, sent_at), port, Heard(frame, time.monotonic()))

    def _subscriber(self, bus: CanBus, known: KnownChannel) -> ChannelSubscriber:
        subscriber: ChannelSubscriber | None = known.subscriber
        if subscriber is None or subscriber.has_failed:
            known.close()
            subscriber = known.subscriber = ChannelSubscriber(bus, known.keys)
        return subscriber


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
