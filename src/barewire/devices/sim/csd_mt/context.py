"""State that all parts of a CSD MT share: clock, registers, environment and alarm log; the fault codes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from barewire.devices.sim.core.machine import MachineClock
from barewire.devices.sim.core.store import MachineStore
from barewire.devices.sim.csd_mt.environment import Environment

TimedAction = tuple[float, Callable[[], None]]
"""An action without a command: its time in seconds (inf: never), and the function to call then."""

OVERCURRENT, OVERHEATED, NO_POWER, SPEED_TOO_HIGH, FOLLOWING = 0x2130, 0x4310, 0x5100, 0x8400, 0x8611
"""Values of Error Code (1007, ch. 14). The watchdog has no code: 0."""


class AlarmLog:
    """The last ten alarms, the newest first, in memory that survives power-off (registers 1220 to 1239)."""

    SIZE = 10

    def __init__(self) -> None:
        self.entries: list[tuple[int, int]] = []
        """Seconds since power-on, and the code."""

    def add(self, code: int, uptime: float) -> None:
        """Record an alarm, `uptime` seconds after power-on."""
        self.entries = [(int(uptime) % 0x10000, code), *self.entries][: self.SIZE]

    def clear(self) -> None:
        """Delete all alarms."""
        self.entries = []


@dataclass
class Context:
    """The shared state of one drive."""

    clock: MachineClock
    store: MachineStore
    environment: Environment
    alarms: AlarmLog = field(default_factory=AlarmLog)

    @property
    def now(self) -> float:
        """The time of the event that is being carried out, or the last one that was passed in."""
        return self.clock.now
