"""Current and temperature of a CSD MT.                          [CSD MT manual, registers 1080, 1083, 1123 to 1126]

        current   = 1117 · 1080 %              in motion, and 80 ms after it
                  = 1117 · 1080 % · 1112 %     at standstill
        above 1125: status bit 7, if 1105 is 1       above 1126: fault 4310h, until it is below 1125 again

How fast a drive warms up is not printed. Here it is a body with one time constant, whose heat is that of the current in
a resistance: drawn to look right.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import exp, inf, log
from typing import TYPE_CHECKING

from barewire.devices.sim.csd_mt.axis import Event

if TYPE_CHECKING:
    from barewire.devices.sim.csd_mt.machine import CsdMt

OVERHEATED = 0x4310
STANDS_AFTER = 0.08
"""Seconds after a run until the current is reduced (register 1083)."""

RISE, TIME_CONSTANT = 35.0, 300.0
"""Degrees above the surroundings at the full 100 % of current, and seconds."""

LOWEST, HIGHEST = 22, 125
"""What Drive Temperature (1124) can show."""


class Heat:
    """The temperature of one drive. It lives on when the drive is switched off."""

    def __init__(self, drive: CsdMt) -> None:
        self.drive = drive
        self.temperature = drive.environment.ambient
        self._since = drive.now
        self._tripped = False
        drive.store.measure("Drive Temperature", lambda: max(LOWEST, min(HIGHEST, self.temperature)))

    @property
    def current(self) -> float:
        """Amperes of the motor phases."""
        store = self.drive.store
        return store.number("Motor Current Limit") * self._ratio()

    def _ratio(self) -> float:
        drive = self.drive
        if not drive.shaft.has_current:
            return 0.0
        ratio = drive.store.number("Current Ratio") / 100
        return ratio * drive.store.number("Current Reduction Ratio") / 100 if self._is_reduced() else ratio

    def _is_reduced(self) -> bool:
        """At standstill. With Auto Sync, register 1108 says whether and when."""
        drive, way = self.drive, self.drive.axis.trajectory
        if way.velocity(drive.now) or drive.now < way.ends_at + STANDS_AFTER:
            return False
        if not drive.shaft.auto_sync:
            return True
        wanted = drive.store.whole("Auto Sync Enable")
        return wanted == 3 or (wanted == 2 and not drive.shaft.closed_loop)

    def _ends_at(self) -> float:
        return self.drive.environment.ambient + RISE * self._ratio() ** 2

    def creep(self, to: float) -> None:
        """Time passes, and nothing else changes in it."""
        end = self._ends_at()
        self.temperature = end + (self.temperature - end) * exp(-(to - self._since) / TIME_CONSTANT)
        self._since = to

    @property
    def is_warm(self) -> bool:
        """Above Warning Temperature (1125)."""
        return self.temperature > self.drive.store.number("Warning Temperature")

    def _crosses(self, level: float) -> float:
        """When the temperature is on the other side of a level, if things stay as they are; inf if it never is."""
        end, now = self._ends_at(), self.drive.now
        if (self.temperature - level) * (end - level) >= 0:
            return inf
        return now + TIME_CONSTANT * log((end - self.temperature) / (end - level)) + 1e-6

    def events(self) -> Iterator[Event]:
        """Too hot, cool again, less current."""
        drive = self.drive
        limit = drive.store.number("Drive Fault Temperature")
        if self._tripped:
            cool = self._cool()
            yield (drive.now if self.temperature <= cool else self._crosses(cool)), self._cools
        else:
            yield (drive.now if self.temperature > limit else self._crosses(limit)), self._overheats
        reduced_at = drive.axis.trajectory.ends_at + STANDS_AFTER
        if reduced_at > drive.now:
            yield reduced_at, lambda: None

    def _cool(self) -> float:
        """Below the threshold of the warning, and of the fault."""
        store = self.drive.store
        return min(store.number("Warning Temperature"), store.number("Drive Fault Temperature"))

    def _overheats(self) -> None:
        if self.temperature > self.drive.store.number("Drive Fault Temperature"):
            self._tripped = True
            self.drive.protect(OVERHEATED, passing=False)

    def _cools(self) -> None:
        if self.temperature <= self._cool():
            self._tripped = False
            if self.drive.axis.cause == OVERHEATED:
                self.drive.axis.cause = 0  # "if the temperature become lower than the threshold value" (1125)
