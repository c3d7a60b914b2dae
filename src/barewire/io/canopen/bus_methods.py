"""Methods of the whole bus: `bus.lss`, `bus.sync`, `bus.time`, and cyclic frames.   [CiA 305; CiA 301, SYNC and TIME]

bus.lss.fastscan(progress=print)                   node-IDs and bit rates, over the bus itself
bus.sync.start(0.01)                               a SYNC every 10 ms, by a thread or a task
bus.sync.start(0.01, by="kernel")                  CAN_BCM of Linux sends them, if the bus is can://socketcan/...
bus.time.send()                                    the time of this computer
bus.nmt.start_heartbeat(127, 0.5)
bus.start(CyclicProducer(0.01, frame))             any frames; `update` changes them
"""

from __future__ import annotations

import functools
import inspect
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, ParamSpec, Protocol, TypeAlias, TypeVar, cast

from barewire import canopen
from barewire.canopen.cob_ids import SYNC_KEY, TIME_KEY, cob_id
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss import master as lss_master
from barewire.errors import EncodeError, PortError, shown
from barewire.io.canopen.bus.subscriber import Key, check_key
from barewire.io.canopen.operations import (
    ERROR_CONTROL,
    NO_FRAMES,
    BackgroundTask,
    BusOperation,
    Methods,
    R,
    Subscription,
    background,
    operation,
    send_frame,
    subscription,
)
from barewire.io.log import PortLog
from barewire.io.ports.can.socketcan import SocketCanPort

if TYPE_CHECKING:
    from barewire.conversation import Conversation
    from barewire.io.canopen.bus.node_runner import Speaker
    from barewire.io.canopen.bus.shared_bus import CanBus
    from barewire.io.ports.can.bcm import BroadcastManager

P = ParamSpec("P")
T = TypeVar("T")

LSS_RECEIVES = ERROR_CONTROL | {(cob_id("LSS answer"), False)}
"""Responses, and the boot-up messages of nodes that got an ID."""
LSS_LOCK = frozenset({"LSS"})
SentBy: TypeAlias = Literal["python", "kernel"]
_RETRY = 1.0
"""Seconds between two attempts to find an interface that was removed."""


def _lss(make: Callable[P, Conversation[CanFrame, T]]) -> operation[P, T]:
    """Return a function of `canopen.lss` as a method with the same parameters."""

    def method(_: Methods[R], /, *args: P.args, **kwargs: P.kwargs) -> BusOperation[T]:
        return BusOperation(make(*args, **kwargs), LSS_LOCK, LSS_RECEIVES)

    functools.update_wrapper(method, make)
    decorated = operation(method)
    # `make` has no `self`. Without one in the signature, `help` and `inspect` would drop its first parameter.
    shown = inspect.signature(cast("Callable[..., T]", decorated))
    itself = inspect.Parameter("self", inspect.Parameter.POSITIONAL_ONLY)
    vars(decorated)["__signature__"] = shown.replace(parameters=[itself, *shown.parameters.values()])
    return decorated


class LssMethods(Methods[R]):
    """The LSS master of a bus."""

    switch_global = _lss(lss_master.switch_global)
    switch_selective = _lss(lss_master.switch_selective)
    identify_slaves = _lss(lss_master.identify_slaves)
    identify_unconfigured = _lss(lss_master.identify_unconfigured)
    inquire_address = _lss(lss_master.inquire_address)
    inquire_node = _lss(lss_master.inquire_node)
    configure_node = _lss(lss_master.configure_node)
    configure_bit_timing = _lss(lss_master.configure_bit_timing)
    activate_bit_timing = _lss(lss_master.activate_bit_timing)
    store_configuration = _lss(lss_master.store_configuration)
    fastscan = _lss(lss_master.fastscan)
    assign_node_ids = _lss(lss_master.assign_node_ids)


class SyncMethods(Methods[R]):
    """SYNC messages. `key` is their (identifier, extended) if object 1005h of the nodes has another one than 80h."""

    @operation
    def send(self, counter: int | None = None, *, key: Key = SYNC_KEY) -> BusOperation[None]:
        """Send one SYNC."""
        return send_frame(canopen.SyncMessage(counter).encode(check_key(key)))

    @background
    def start(self, period: float, *, overflow: int = 0, key: Key = SYNC_KEY, by: SentBy = "python") -> BackgroundTask:
        """Send a SYNC every `period` seconds, with a counter up to `overflow` if that is not 0, until it is stopped.

        by="kernel": the kernel sends them if the bus is can://socketcan, at more equal intervals, and the first one at
        once; `by_kernel` of the result is whether it does.
        """
        return cyclic_task(self.runner.bus, canopen.SyncProducer(period, overflow=overflow, key=check_key(key)), by)

    @subscription
    def events(
        self, period: float | None = None, *, overflow: int | None = None, key: Key = SYNC_KEY
    ) -> Subscription[canopen.SyncEvent]:
        """Return a stream of the SYNC messages of another producer, checked by `SyncMonitor`."""
        return Subscription(canopen.SyncMonitor(period, overflow=overflow, key=check_key(key)), frozenset({key}))


class TimeMethods(Methods[R]):
    """TIME messages. `key` is their (identifier, extended) if object 1012h of the nodes has another one than 100h."""

    @operation
    def send(self, unix: float | None = None, *, key: Key = TIME_KEY) -> BusOperation[None]:
        """Send one TIME message: the time of this computer, or `unix` in seconds since 1 January 1970."""
        stamp = canopen.TimeStamp.of_unix(time.time() if unix is None else unix)
        return send_frame(stamp.encode(check_key(key)))

    @background
    def start(self, period: float, *, key: Key = TIME_KEY) -> BackgroundTask:
        """Send the time of this computer at once and every `period` seconds, until it is stopped."""
        return BackgroundTask(
            canopen.TimeProducer(period, time.time() - time.monotonic(), key=check_key(key)), NO_FRAMES
        )

    @subscription
    def events(self, *, key: Key = TIME_KEY) -> Subscription[canopen.TimeReceived]:
        """Return a stream of the TIME messages of another producer."""
        return Subscription(canopen.TimeConsumer(key), frozenset({key}))


class CyclicFrames(Protocol):
    """A producer whose frames are known in advance: `SyncProducer`, `CyclicProducer`."""

    period: float

    @property
    def frames(self) -> tuple[CanFrame, ...]: ...

    @property
    def deadline(self) -> float | None: ...

    def feed(self, item: None, now: float) -> list[CanFrame]: ...


class KernelCycle:
    """A machine in the place of `producer`: it has the kernel send its frames, and sends none itself.

    `feed` takes over frames and a period that were changed. If the interface was removed, it waits until it is back.
    """

    by_kernel = True
    deadline: float | None = None

    def __init__(self, producer: CyclicFrames, manager: BroadcastManager) -> None:
        self.producer = producer
        self._manager = manager
        self._log = PortLog("barewire.canopen.client", manager.place)
        self._retry_at = 0.0
        try:
            manager.send(producer.frames, producer.period)
        except BaseException:
            manager.close()
            raise

    def __repr__(self) -> str:
        frames = self.producer.frames
        shown_frames = ", ".join(map(str, frames[:3])) + (", ..." if len(frames) > 3 else "")
        return f"<{type(self).__name__} every {self.producer.period:g} s on {self._manager.place}: {shown_frames}>"

    def feed(self, item: None, now: float) -> list[CanFrame]:
        """Give the kernel the present frames of the producer. A failure of the interface is logged."""
        manager, producer = self._manager, self.producer
        if now < self._retry_at:
            return []
        try:
            if self._retry_at:
                manager.reopen()
            else:
                manager.check()
            manager.send(producer.frames, producer.period)
            self._retry_at = 0.0
        except PortError as error:
            self._log.warning("kernel", self._log.short(error))
            if not manager.is_sending:
                self._retry_at = now + _RETRY
        return []

    def close(self) -> None:
        """End the frames."""
        self._manager.close()
        self._log.flush()


def cyclic_task(bus: CanBus, producer: CyclicFrames, by: SentBy) -> BackgroundTask:
    """Return the task that sends the frames of a producer.

    With "kernel", the kernel sends the first one at once, and the others until the task is stopped. On a bus that is
    not SocketCAN, and with a kernel without CAN_BCM, the task is the producer itself. Raises EncodeError for another
    `by`, and for frames or a period that the kernel does not take; PortError.
    """
    if by not in ("python", "kernel"):
        raise EncodeError(f"by={shown(by)}: expected 'python' or 'kernel'", "by")
    machine: Speaker = producer
    if by == "kernel":
        machine = _kernel_cycle(bus, producer) or producer
    return BackgroundTask(machine, NO_FRAMES)


def cyclic_frames(machine: object) -> CyclicFrames:
    """Return a machine whose frames are known in advance. Raises EncodeError for any other: it runs in Python only."""
    if not (hasattr(machine, "frames") and hasattr(machine, "period")):
        text = "expected a CyclicProducer or a SyncProducer, for the kernel"
        raise EncodeError(f"{type(machine).__name__}: {text}", "machine")
    return cast("CyclicFrames", machine)


def _kernel_cycle(bus: CanBus, producer: CyclicFrames) -> KernelCycle | None:
    from barewire.io.ports.can.bcm import BroadcastManager, NoBroadcastManager, check_cycle

    check_cycle(producer.frames, producer.period)
    try:
        if not isinstance(bus.port, SocketCanPort):
            raise NoBroadcastManager("the kernel sends frames on can://socketcan only")
        return KernelCycle(producer, BroadcastManager(bus.name.partition("/")[2]))
    except NoBroadcastManager as error:
        PortLog("barewire.canopen.client", bus.place).info("python", f"cyclic frames are sent by Python: {error}")
        return None
