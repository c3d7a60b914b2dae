"""Machines that speak by themselves on a bus: a SYNC producer, a whole node. A thread each, or a task (`aio_run`)."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from types import TracebackType
from typing import Protocol, Self

from barewire.canopen.frame import CanFrame
from barewire.errors import PortError
from barewire.shells.can_fan import CanBus
from barewire.shells.can_tap import LONGEST, Key, Tap


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


class Running:
    """A machine at work in a thread of its own, until it is stopped or the bus is gone.

    `refused` counts what the bus did not take: without anybody to acknowledge, a frame is no reason to die.
    """

    def __init__(self, bus: CanBus, machine: Speaker, keys: Iterable[Key] | None) -> None:
        self.machine = machine
        self.refused = 0
        self._tap = Tap(bus, keys, node=True)
        self._thread = threading.Thread(target=self._live, name=f"{type(machine).__name__} on {bus.name}", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.stop()

    def _live(self) -> None:
        machine, clock = self.machine, time.monotonic
        with self._tap:
            said = begin(machine, clock())
            while True:
                for frame in said:
                    self._say(frame)
                deadline = machine.deadline
                try:
                    heard = self._tap.receive(LONGEST if deadline is None else deadline - clock())
                except PortError:
                    return
                said = feed(machine, heard, clock())

    def _say(self, frame: CanFrame) -> None:
        try:
            self._tap.send(frame)
        except PortError:
            self.refused += 1

    def stop(self) -> None:
        """No further frame; returns when it is still."""
        self._tap.close()
        if self._thread is not threading.current_thread():
            self._thread.join()

    close = stop


def feed(machine: Speaker, frame: CanFrame | None, now: float) -> list[CanFrame]:
    """What the machine says now. One that hears nothing is never given a frame."""
    return machine.feed(frame, now)  # type: ignore[arg-type]
