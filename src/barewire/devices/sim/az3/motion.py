"""The shaft of the AZ3: its units, its limits, its brake.

        user units --velocity factor, polarity, limits--> axis (axis.py) --> trajectory in increments and seconds

A user unit of velocity is 1/60 revolution per second, a revolution per minute, as long as VELOCITY FACTOR is 60 over 1;
a unit of position is an increment of the encoder. POLARITY (607Eh) turns position (bit 7) and velocity (bit 6) round,
SOFT MIN and MAX POSITION LIMIT (607Dh) hold a target while the first is the smaller one [CiA 402].

The brake, with BRAKE ACTIVATION on:

        OPERATION ENABLED   current on, brake begins to open | BRAKE DISENGAGE TIME | the shaft may move
        any other state     the shaft is braked, then BRAKE ENGAGE TIME until the brake holds

BRAKE VALUE tells whether it is open; with BRAKE ACTIVATION off it is an output that somebody else commands. The guides
give the names and the times (in ms), and this is what such names mean elsewhere.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import TYPE_CHECKING

from barewire.devices.drive.cia402 import State, Transition
from barewire.devices.sim.motion.cia402_axis import CURRENT_ON, HALT, NEW_SET_POINT, POSITION, VELOCITY, Axis

if TYPE_CHECKING:
    from barewire.devices.sim.az3.machine import Az3

SLOWEST_RAMP, STEEPEST_RAMP = 1.0, 1e9
TURNS_POSITION, TURNS_VELOCITY = 0x80, 0x40


class Az3Axis(Axis):
    """An axis whose shaft is held until its brake is open."""

    def __init__(self, settings: Az3Motion) -> None:
        super().__init__(settings, stays_in_quick_stop=False)
        self.motion = settings
        self._opens_at = -inf
        self._closes_at = -inf

    def halted(self) -> bool:
        """Halt, or a brake that is not open yet."""
        return bool(self.word & HALT) or self._opens_at > self.motion.drive.now

    def brake_is_open(self, now: float) -> bool:
        """Whether the brake lets the shaft turn."""
        if self.state in CURRENT_ON:
            return now >= self._opens_at
        return now < self._closes_at

    def _go(self, transition: Transition, now: float) -> None:
        before = self.state
        super()._go(transition, now)
        if self.state is State.OPERATION_ENABLED and before not in CURRENT_ON:
            self._opens_at = now + self.motion.brake_time("BRAKE DISENGAGE TIME")
            self.look_at_halt(now)

    def _release(self, now: float) -> float:
        stands_at = super()._release(now)
        self._opens_at = -inf
        self._closes_at = stands_at + self.motion.brake_time("BRAKE ENGAGE TIME")
        return stands_at

    def tick(self, now: float) -> None:
        """As every axis; and the brake has opened."""
        opened, was = self._opens_at, self.state
        if self.state is State.OPERATION_ENABLED and -inf < opened <= now:
            self._opens_at = -inf
            self.look_at_halt(opened)
            if self.mode == POSITION and self.word & NEW_SET_POINT and not self._acknowledged:
                self._set_point(self.word, opened)  # it came while the brake was opening
        super().tick(now)
        if was is State.QUICK_STOP_ACTIVE and self.state is not was:
            self._closes_at = self.trajectory.ends_at + self.motion.brake_time("BRAKE ENGAGE TIME")


class Az3Motion:
    """What the axis asks, answered from the parameters of the drive."""

    def __init__(self, drive: Az3) -> None:
        self.drive = drive
        self.store = drive.store

    @property
    def increments(self) -> float:
        """Increments of position in a revolution of the motor."""
        revolutions = self.store.number("POSITION ENCODER RESOLUTION MOTOR REVOLUTIONS")
        return (self.store.number("POSITION ENCODER RESOLUTIONS INCREMENTS") or 1.0) / (revolutions or 1.0)

    @property
    def unit(self) -> float:
        """One user unit of velocity in increments per second. A factor with a 0 in it is none: rpm."""
        numerator = self.store.number("VELOCITY FACTOR NUMERATOR")
        denominator = self.store.number("VELOCITY FACTOR DENOMINATOR")
        return self.increments * (denominator / numerator if numerator > 0 and denominator > 0 else 1 / 60)

    def _turned(self, value: float, bit: int) -> float:
        return -value if self.store.whole("POLARITY") & bit else value

    def shown_position(self, steps: float) -> float:
        """POSITION ACTUAL VALUE of a place of the shaft."""
        return self._turned(steps, TURNS_POSITION)

    def shown_velocity(self, steps: float) -> float:
        """VELOCITY ACTUAL VALUE in user units."""
        return self._turned(steps / self.unit, TURNS_VELOCITY)

    def brake_time(self, name: str) -> float:
        """Seconds; 0 for a drive without a brake."""
        return self.store.number(name) / 1000 if self.store["BRAKE ACTIVATION"] else 0.0

    def is_limited(self) -> bool:
        """Whether a soft limit holds the target position, or MAX MOTOR SPEED the target velocity."""
        if self.mode() == VELOCITY:
            return abs(self.store.number("TARGET VELOCITY")) > self.store.number("MAX MOTOR SPEED")
        return self.mode() == POSITION and self._limited() != self.store.number("TARGET POSITION")

    def _limited(self) -> float:
        target = self.store.number("TARGET POSITION")
        low, high = (self.store.number(f"SOFT {side} POSITION LIMIT") for side in ("MIN", "MAX"))
        return max(low, min(high, target)) if low < high else target

    # Settings of the axis

    def mode(self) -> int:
        """6060h."""
        return self.store.whole("MODES OF OPERATION")

    def target_position(self) -> float:
        """607Ah."""
        return self._turned(self._limited(), TURNS_POSITION)

    def target_velocity(self) -> float:
        """60FFh, not above MAX MOTOR SPEED."""
        limit = self.store.number("MAX MOTOR SPEED")
        wanted = max(-limit, min(limit, self.store.number("TARGET VELOCITY")))
        return self._turned(wanted, TURNS_VELOCITY) * self.unit

    def profile_velocity(self) -> float:
        """6081h, not above MAX PROFILE VELOCITY."""
        return self.unit * min(self.store.number("PROFILE VELOCITY"), self.store.number("MAX PROFILE VELOCITY"))

    def acceleration(self) -> float:
        """6083h; a ramp of 0 would never arrive, so the slowest is one unit."""
        return self.unit * max(self.store.number("PROFILE ACCELERATION"), SLOWEST_RAMP)

    def deceleration(self) -> float:
        """6084h."""
        return self.unit * max(self.store.number("PROFILE DECELERATION"), SLOWEST_RAMP)

    def without_ramp(self, velocity: float) -> bool:
        """This drive always has ramps."""
        return False

    def velocity_window(self) -> tuple[float, float]:
        """The guides list no velocity window: one unit, at once."""
        return self.unit, 0.0

    def zero_window(self) -> tuple[float, float]:
        """As the velocity window."""
        return self.unit, 0.0

    # Torque and voltage

    def target_torque(self) -> float:
        """6071h in ‰ of the rated torque, within MAX TORQUE, MAX CURRENT and, with TORQUE LIMIT ON, TORQUE LIMIT."""
        limit = min(self.store.number("MAX TORQUE"), self.store.number("MAX CURRENT"))
        most = self.store.number("TORQUE LIMIT")
        if self.store["TORQUE LIMIT ON"] and isfinite(most):
            limit = min(limit, 1000 * abs(most) / self.drive.rated_torque)
        return max(-limit, min(limit, self.store.number("TARGET TORQUE")))

    def torque_slope(self) -> float:
        """6087h."""
        return max(self.store.number("TORQUE SLOPE"), SLOWEST_RAMP)

    def voltage_ramp(self, change: float) -> float:
        """Volts per second towards a reference that is so much away: the positive or the negative ramp."""
        name = "V REF POSITIVE RAMP" if change > 0 else "V REF NEGATIVE RAMP"
        return min(abs(self.store.number(name)) or SLOWEST_RAMP, STEEPEST_RAMP)
