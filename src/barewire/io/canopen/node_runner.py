"""Machines that speak by themselves on a bus: a SYNC producer, a whole node. A thread each, or a task (`aio_run`)."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from types import TracebackType
from typing import Any, Protocol, Self

from barewire.canopen.frame import CanFrame, ErrorFrame
from barewire.errors import PortError
from barewire.io.canopen.shared_bus import CanBus
from barewire.io.canopen.subscriber import Item, Key, Subscriber
from barewire.io.engine.locking import exclusive

_BUS_OFF, _RESTARTED = 0x40, 0x100


class Speaker(Protocol):
    """A machine that says frames when its time has come, or when it has heard some."""

    @property
    def deadline(self) -> float | None: ...

    def feed(self, item: None, now: float) -> list[CanFrame]: ...


def begin(machine: Speaker, now: float) -> list[CanFrame]:
    """A node that has to be switched on is; what else it says first."""
    said: list[CanFrame] = []
    start = getattr(machine, "start", None)
    if start is not None:
        said += start(now) or []
    return said + machine.feed(None, now)


class CallbackAdapter:
    """A machine that both speaks and reports, such as the master of node guarding: its frames go to the bus, everything
    else is given to `tell`, in the thread or task in which the machine is at work."""

    def __init__(self, machine: Any, tell: Callable[[Any], object]) -> None:
        self.machine = machine
        self.tell = tell

    @property
    def deadline(self) -> float | None:
        """That of the machine."""
        due: float | None = self.machine.deadline
        return due

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """The frames among what the machine says."""
        said = []
        for item in self.machine.feed(frame, now):
            if isinstance(item, CanFrame):
                said.append(item)
            else:
                self.tell(item)
        return said


class NodeDriver:
    """What a machine on a bus is to be told: frames, time, and that the controller is back on the bus.

    A node that goes bus-off obeys its error behaviour, and says itself that it is back (emergency 8140h) as soon as
    something goes through again: the controller was restarted, or a frame came. A bus that is opened anew goes on for
    the machine as if it had only been silent.
    """

    def __init__(self, machine: Speaker) -> None:
        self.machine = machine
        self._off = False

    def hear(self, item: Item | None, now: float) -> list[CanFrame]:
        """What the machine says now. One that hears nothing is never given a frame."""
        frame = item if isinstance(item, CanFrame) else None
        classes = item.classes if isinstance(item, ErrorFrame) else 0
        said: list[CanFrame] = []
        if self._off and (frame is not None or classes & _RESTARTED):
            self._off = False
            recovered = getattr(self.machine, "recovered", None)
            said = [] if recovered is None else recovered(now)
        if classes & _BUS_OFF:
            self._off = True
            bus_off = getattr(self.machine, "bus_off", None)
            if bus_off is not None:
                bus_off(now)
        return said + self.machine.feed(frame, now)  # type: ignore[arg-type]


LOOK = 0.1
"""Seconds after which a machine is looked at anyway: somebody may have changed its values meanwhile."""

Action = Callable[[float], Iterable[CanFrame] | None]
"""Something that is done with a machine from outside, at that time; what it returns is said."""


class Running:
    """A machine at work in a thread of its own, until it is stopped or the bus is gone for good.

    `do` does something with it from another thread, and says at once what comes of it. What is changed without that is
    seen within a tenth of a second. `refused` counts what the bus did not take: without anybody to acknowledge, a frame
    is no reason to die.
    """

    def __init__(self, bus: CanBus, machine: Speaker, keys: Iterable[Key] | None) -> None:
        self.machine = machine
        self.refused = 0
        self._turn = threading.RLock()  # what is said goes out in the order in which it was said
        self._tap = Subscriber(bus, keys, node=True, reports=True)
        self._thread = threading.Thread(target=self._live, name=f"{type(machine).__name__} on {bus.name}", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.stop()

    def _live(self) -> None:
        machine, ears, clock = self.machine, NodeDriver(self.machine), time.monotonic
        with self._tap:
            with self._turn:
                self._say(begin(machine, clock()))
            while True:
                deadline = machine.deadline
                try:
                    arrived = self._tap.pull(LOOK if deadline is None else min(LOOK, deadline - clock()))
                except PortError:
                    return
                with self._turn:
                    with exclusive(machine):
                        said = ears.hear(None if arrived is None else arrived.item, clock())
                    self._say(said)

    def _say(self, frames: Iterable[CanFrame]) -> None:
        for frame in frames:
            try:
                self._tap.send(frame)
            except PortError:
                self.refused += 1

    def do(self, action: Action) -> None:
        """`action(now)` while nobody else is in the machine; the frames that it returns are said, then what is due."""
        with self._turn:
            with exclusive(self.machine):
                now = time.monotonic()
                said = [*(action(now) or ()), *self.machine.feed(None, now)]
            self._say(said)

    def stop(self) -> None:
        """No further frame; returns when it is still."""
        self._tap.close()
        if self._thread is not threading.current_thread():
            self._thread.join()

    close = stop
