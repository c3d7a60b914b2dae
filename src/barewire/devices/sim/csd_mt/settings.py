"""What the axis of a CSD MT asks its registers: steps and seconds are the units of the drive too."""

from __future__ import annotations

from typing import TYPE_CHECKING

from barewire.devices.sim.motion.cia402_axis import HOMING, POSITION

if TYPE_CHECKING:
    from barewire.devices.sim.csd_mt.machine import CsdMt

START_STOP = 16_000.0
"""At most this many steps per second are reached without a ramp (ch. 12, motion profiles)."""


class Registers:
    """The `Settings` of one drive."""

    def __init__(self, drive: CsdMt) -> None:
        self.drive = drive
        self.store = drive.store

    def mode(self) -> int:
        """Register 1041."""
        return self.store.whole("Mode of Operation")

    def target_position(self) -> float:
        """Register 1042."""
        return self.store.number("Target Position")

    def target_velocity(self) -> float:
        """Register 1048, limited by 1074; a limit of 0 is taken for none."""
        wanted, limit = self.store.number("Target Velocity"), self.store.number("Max Motor Speed")
        return max(-limit, min(wanted, limit)) if limit else wanted

    def profile_velocity(self) -> float:
        """Register 1044."""
        return self.store.number("Profile Velocity")

    def acceleration(self) -> float:
        """Register 1046."""
        return self.store.number("Profile Acceleration")

    def deceleration(self) -> float:
        """Register 1072 in profile velocity; a position move brakes with 1046: it is a trapezoid if PV² < PA·ΔS."""
        ramps = {POSITION: "Profile Acceleration", HOMING: "Homing Acceleration"}
        return self.store.number(ramps.get(self.drive.axis.mode, "Profile Deceleration"))

    def without_ramp(self, velocity: float) -> bool:
        """Up to 16000 steps per second a move is start-stop (ch. 12, motion profiles)."""
        return velocity <= START_STOP

    def velocity_window(self) -> tuple[float, float]:
        """Registers 1062 and 1063, read as CiA 402 means them."""
        return self.store.number("Velocity Window"), self.store.number("Velocity Window Time") / 1000

    def zero_window(self) -> tuple[float, float]:
        """Registers 1064 and 1065."""
        return self.store.number("Velocity Threshold"), self.store.number("Velocity Threshold Time") / 1000
