"""Phasing of the AZ3: the alignment of motor and encoder.                                          [ST.TEC.022]

        START PHASING, ABSOLUTE ENCODER PHASING START, ALIGNMENT REQUEST
                alignment current for T ALIGN, then the captures are stored; the first two end with AUTO-PHASED MOTOR on
        EEPROM AUTOPHASING DATA CLEANING
                AUTO-PHASED MOTOR off, no captures

Simulated: the time, the current, the captures and the results above. The motor needs no phasing to turn. T ALIGN is
taken in tenths of a millisecond, the unit of the other times on that page of the guide.
"""

from __future__ import annotations

from barewire.devices.drive.cia402 import State
from barewire.devices.sim.az3.motion import Az3Axis, Az3Settings
from barewire.devices.sim.core.machine import MachineClock
from barewire.devices.sim.core.store import MachineStore
from barewire.devices.sim.motion.trajectory import wrapped

CAPTURES = 7
_TENTHS_OF_MS = 1e-4


class Phasing:
    """The alignment of one drive. It runs only with high voltage and while no client moves the shaft."""

    def __init__(self, clock: MachineClock, store: MachineStore, settings: Az3Settings, axis: Az3Axis) -> None:
        self.clock, self.store, self.settings, self.axis = clock, store, settings, axis
        self.captures = [0] * CAPTURES
        """Position counts at the six sectors of one electrical revolution, and at its end."""
        self._ends_at: float | None = None
        self._sets_phased = False

    @property
    def in_progress(self) -> bool:
        """PHASING IN PROGRESS."""
        return self._ends_at is not None

    def start(self, *, sets_phased: bool) -> None:
        """Begin the alignment; `sets_phased`: it ends with AUTO-PHASED MOTOR on."""
        if self.axis.state is State.OPERATION_ENABLED or self.axis.powered_since is None:
            return
        self._ends_at = self.clock.now + self.store.whole("T ALIGN") * _TENTHS_OF_MS
        self._sets_phased = sets_phased

    def cancel(self) -> None:
        """Break off an alignment that is in progress."""
        self._ends_at = None

    def clear(self) -> None:
        """Delete the results."""
        self.captures[:] = [0] * CAPTURES
        self.store["AUTO-PHASED MOTOR"] = False

    def tick(self, now: float) -> None:
        """End the alignment when its time is over. Enabling the drive meanwhile breaks it off."""
        if self._ends_at is not None and self.axis.state is State.OPERATION_ENABLED:
            self._ends_at = None
        if self._ends_at is None or now < self._ends_at:
            return
        self._ends_at = None
        sector = self.settings.increments / (self.store.whole("MOTOR POLES PAIR") or 1) / 6
        start = self.axis.trajectory.position(now)
        self.captures[:] = [wrapped(start + number * sector, 16) for number in range(CAPTURES)]
        if self._sets_phased:
            self.store["AUTO-PHASED MOTOR"] = True
