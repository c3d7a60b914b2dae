"""Current and temperature of a CSD MT.                          [CSD MT manual, registers 1080, 1083, 1123 to 1126]

        current   = 1117 · 1080 %              in motion, and 80 ms after it
                  = 1117 · 1080 % · 1112 %     at standstill
        above 1125: status bit 7, if 1105 is 1       above 1126: fault 4310h, until it is below 1125 again

Simplified: the manual does not print how fast a drive warms up. Here it is a body with one time constant, heated by the
current in a resistance; its constants are plausible values.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import exp, inf, log

from barewire.devices.sim.csd_mt.axis import StepperAxis
from barewire.devices.sim.csd_mt.context import OVERHEATED, Context, TimedAction
from barewire.devices.sim.csd_mt.shaft import Shaft

_STANDS_AFTER = 0.08
"""Seconds after a run until the current is reduced (register 1083)."""

_RISE, _TIME_CONSTANT = 35.0, 300.0
"""Degrees above the ambient temperature at 100 % of the current, and seconds."""

_LOWEST, _HIGHEST = 22, 125
"""The range of Drive Temperature (1124)."""


class ThermalModel:
    """The temperature of one drive. It keeps its state when the drive is switched off."""

    def __init__(self, context: Context, shaft: Shaft, axis: StepperAxis) -> None:
        self.context, self.store, self.shaft, self.axis = context, context.store, shaft, axis
        self.temperature = context.environment.ambient
        self._since = context.now
        self._tripped = False
        self.store.measure("Drive Temperature", lambda: max(_LOWEST, min(_HIGHEST, self.temperature)))

    @property
    def current(self) -> float:
        """The current of the motor phases in A."""
        return self.store.number("Motor Current Limit") * self._ratio()

    def _ratio(self) -> float:
        if not self.shaft.has_current:
            return 0.0
        ratio = self.store.number("Current Ratio") / 100
        return ratio * self.store.number("Current Reduction Ratio") / 100 if self._is_reduced() else ratio

    def _is_reduced(self) -> bool:
        """Return whether the motor is at standstill. With Auto Sync, register 1108 determines whether and when."""
        now, trajectory = self.context.now, self.axis.trajectory
        if trajectory.velocity(now) or now < trajectory.ends_at + _STANDS_AFTER:
            return False
        if not self.shaft.auto_sync:
            return True
        mode = self.store.whole("Auto Sync Enable")
        return mode == 3 or (mode == 2 and not self.shaft.closed_loop)

    def _final(self) -> float:
        """Return the temperature that is reached in the end, if nothing changes."""
        return self.context.environment.ambient + _RISE * self._ratio() ** 2

    def advance(self, now: float) -> None:
        """Let time pass in which nothing else changes."""
        final = self._final()
        self.temperature = final + (self.temperature - final) * exp(-(now - self._since) / _TIME_CONSTANT)
        self._since = now

    @property
    def is_warm(self) -> bool:
        """Whether the temperature is above Warning Temperature (1125)."""
        return self.temperature > self.store.number("Warning Temperature")

    def _crosses(self, level: float) -> float:
        """Return when the temperature crosses a level, if nothing changes; inf if it never does."""
        final, now = self._final(), self.context.now
        if (self.temperature - level) * (final - level) >= 0:
            return inf
        return now + _TIME_CONSTANT * log((final - self.temperature) / (final - level)) + 1e-6

    def events(self) -> Iterator[TimedAction]:
        """Yield the events of overheating, of cooling down, and of the current reduction."""
        now, limit = self.context.now, self.store.number("Drive Fault Temperature")
        if self._tripped:
            cool = self._cool()
            yield (now if self.temperature <= cool else self._crosses(cool)), self._cools
        else:
            yield (now if self.temperature > limit else self._crosses(limit)), self._overheats
        reduced_at = self.axis.trajectory.ends_at + _STANDS_AFTER
        if reduced_at > now:
            yield reduced_at, lambda: None

    def _cool(self) -> float:
        """Return the threshold of the warning, or that of the fault if it is lower."""
        return min(self.store.number("Warning Temperature"), self.store.number("Drive Fault Temperature"))

    def _overheats(self) -> None:
        if self.temperature > self.store.number("Drive Fault Temperature"):
            self._tripped = True
            self.axis.protect(OVERHEATED, transient=False)

    def _cools(self) -> None:
        if self.temperature <= self._cool():
            self._tripped = False
            if self.axis.cause == OVERHEATED:
                self.axis.cause = 0  # "if the temperature become lower than the threshold value" (1125)
