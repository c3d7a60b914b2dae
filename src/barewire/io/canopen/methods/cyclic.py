"""Cyclic frames: SYNC, a heartbeat, PDOs, sent by a machine of this program or by the kernel.

Examples:

    bus.sync.start(0.01)                            by="python": a thread or a task sends each frame
    bus.sync.start(0.01, by="kernel")               CAN_BCM of Linux sends them, if the bus is can://socketcan/...
    bus.nmt.start_heartbeat(127, 0.5)
    bus.start(CyclicProducer(0.01, frame))          any frames; `update` changes them
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias, cast

from barewire.canopen.frame import CanFrame
from barewire.errors import EncodeError, PortError, shown
from barewire.io.canopen.methods.operations import NO_FRAMES, BackgroundTask
from barewire.io.log import PortLog
from barewire.io.ports.can.socketcan import SocketCanPort

if TYPE_CHECKING:
    from barewire.io.canopen.bus.node_runner import Speaker
    from barewire.io.canopen.bus.shared_bus import CanBus
    from barewire.io.ports.can.bcm import BroadcastManager

SentBy: TypeAlias = Literal["python", "kernel"]
_RETRY = 1.0
"""Seconds between two attempts to find an interface that was removed."""


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
