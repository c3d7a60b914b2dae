"""The motion of the AZ3: units, limits, brake, phasing, measured values.           [ST.TEC.022, ST.TEC.071, CiA 402]

        user units --velocity factor, polarity, limits--> Cia402Axis --> trajectory in increments and seconds

With VELOCITY FACTOR 60 over 1 a user unit of velocity is a revolution per minute; a unit of position is an increment of
the encoder. POLARITY (607Eh) reverses position (bit 7) and velocity (bit 6). SOFT MIN and MAX POSITION LIMIT (607Dh)
limit a target position while MIN is below MAX [CiA 402].

The brake, with BRAKE ACTIVATION on:

        OPERATION ENABLED   current on, brake begins to open | BRAKE DISENGAGE TIME | the shaft may move
        any other state     the shaft is braked, then BRAKE ENGAGE TIME until the brake holds

BRAKE VALUE shows whether it is open; with BRAKE ACTIVATION off it is an output that a client sets. The guides give the
names and the times (in ms) only; the sequence is that of other drives with parameters of these names.

Phasing, the alignment of motor and encoder:

        START PHASING, ABSOLUTE ENCODER PHASING START, ALIGNMENT REQUEST
                alignment current for T ALIGN, then the captures are stored; the first two end with AUTO-PHASED MOTOR on
        EEPROM AUTOPHASING DATA CLEANING
                AUTO-PHASED MOTOR off, no captures

Simulated: the time, the current, the captures and the results above. The motor needs no phasing to turn. T ALIGN is
taken in tenths of a millisecond, the unit of the other times on that page of the guide.

The measured values:

        axis --> position, velocity --> flywheel and friction --> torque --> current --> DC link voltage, temperature

Simplified: the motor is a flywheel with friction, so torque follows acceleration and speed. In torque mode the shaft is
held, and only the torque moves towards TARGET TORQUE. The heatsink has no time constant.

The guides list some measured values as read/write (HEATSINK TEMPERATURE, CUSTOM POSITION ACTUAL VALUE, SENSORLESS
MEASURED SPEED). A write to one is accepted and has no effect, because each read computes the value.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import inf, isfinite, pi

from barewire.devices.cia402 import HALT, NEW_SET_POINT, State, Transition
from barewire.devices.sim.cia402_axis import CURRENT_ON, POSITION, TORQUE, VELOCITY, Cia402Axis
from barewire.devices.sim.store import MachineClock, MachineStore
from barewire.devices.sim.trajectory import Trajectory, wrapped

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
        self._ends_at = self.clock.now + self.store.integer("T ALIGN") * _TENTHS_OF_MS
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
        sector = self.settings.increments / (self.store.integer("MOTOR POLES PAIR") or 1) / 6
        start = self.axis.trajectory.position(now)
        self.captures[:] = [wrapped(start + number * sector, 16) for number in range(CAPTURES)]
        if self._sets_phased:
            self.store["AUTO-PHASED MOTOR"] = True


_SLOWEST_RAMP, _STEEPEST_RAMP = 1.0, 1e9
_REVERSES_POSITION, _REVERSES_VELOCITY = 0x80, 0x40


class Az3Settings:
    """The `AxisSettings` of an AZ3, from the parameters of the drive, and its units."""

    def __init__(self, store: MachineStore) -> None:
        self.store = store

    @property
    def increments(self) -> float:
        """Increments of position per revolution of the motor."""
        revolutions = self.store.number("POSITION ENCODER RESOLUTION MOTOR REVOLUTIONS")
        return (self.store.number("POSITION ENCODER RESOLUTIONS INCREMENTS") or 1.0) / (revolutions or 1.0)

    @property
    def unit(self) -> float:
        """One user unit of velocity in increments per second. A factor with a 0 in it is ignored: rpm."""
        numerator = self.store.number("VELOCITY FACTOR NUMERATOR")
        denominator = self.store.number("VELOCITY FACTOR DENOMINATOR")
        return self.increments * (denominator / numerator if numerator > 0 and denominator > 0 else 1 / 60)

    def _signed(self, value: float, bit: int) -> float:
        return -value if self.store.integer("POLARITY") & bit else value

    def shown_position(self, steps: float) -> float:
        """Return the POSITION ACTUAL VALUE of a position in increments."""
        return self._signed(steps, _REVERSES_POSITION)

    def shown_velocity(self, steps: float) -> float:
        """Return the VELOCITY ACTUAL VALUE, in user units, of a velocity in increments per second."""
        return self._signed(steps / self.unit, _REVERSES_VELOCITY)

    def brake_time(self, name: str) -> float:
        """Return a brake time in seconds; 0 for a drive without a brake."""
        return self.store.number(name) / 1000 if self.store["BRAKE ACTIVATION"] else 0.0

    def is_limited(self) -> bool:
        """Return whether a soft limit reduces the target position, or MAX MOTOR SPEED the target velocity."""
        if self.mode() == VELOCITY:
            return abs(self.store.number("TARGET VELOCITY")) > self.store.number("MAX MOTOR SPEED")
        return self.mode() == POSITION and self._limited() != self.store.number("TARGET POSITION")

    def _limited(self) -> float:
        target = self.store.number("TARGET POSITION")
        low, high = (self.store.number(f"SOFT {side} POSITION LIMIT") for side in ("MIN", "MAX"))
        return max(low, min(high, target)) if low < high else target

    # Settings of the axis

    def mode(self) -> int:  # object 6060h
        return self.store.integer("MODES OF OPERATION")

    def target_position(self) -> float:  # object 607Ah
        return self._signed(self._limited(), _REVERSES_POSITION)

    def target_velocity(self) -> float:  # object 60FFh, not above MAX MOTOR SPEED
        limit = self.store.number("MAX MOTOR SPEED")
        velocity = max(-limit, min(limit, self.store.number("TARGET VELOCITY")))
        return self._signed(velocity, _REVERSES_VELOCITY) * self.unit

    def profile_velocity(self) -> float:  # object 6081h, not above MAX PROFILE VELOCITY
        return self.unit * min(self.store.number("PROFILE VELOCITY"), self.store.number("MAX PROFILE VELOCITY"))

    def acceleration(self) -> float:  # object 6083h, at least one unit: a ramp of 0 would never end
        return self.unit * max(self.store.number("PROFILE ACCELERATION"), _SLOWEST_RAMP)

    def deceleration(self, mode: int) -> float:  # object 6084h, at least one unit
        return self.unit * max(self.store.number("PROFILE DECELERATION"), _SLOWEST_RAMP)

    def without_ramp(self, velocity: float) -> bool:
        return False  # this drive always has ramps

    def velocity_window(self) -> tuple[float, float]:  # one unit, at once: the guides list no velocity window
        return self.unit, 0.0

    def zero_window(self) -> tuple[float, float]:  # one unit, at once, as the velocity window
        return self.unit, 0.0

    # Torque and voltage

    @property
    def rated_torque(self) -> float:
        """MOTOR RATED TORQUE in Nm."""
        return (self.store.number("MOTOR RATED TORQUE") or 1.0) / 1000

    def target_torque(self) -> float:
        """Return object 6071h (‰ of the rated torque), limited by MAX TORQUE, MAX CURRENT and TORQUE LIMIT."""
        limit = min(self.store.number("MAX TORQUE"), self.store.number("MAX CURRENT"))
        torque_limit = self.store.number("TORQUE LIMIT")
        if self.store["TORQUE LIMIT ON"] and isfinite(torque_limit):
            limit = min(limit, 1000 * abs(torque_limit) / self.rated_torque)
        return max(-limit, min(limit, self.store.number("TARGET TORQUE")))

    def torque_slope(self) -> float:  # object 6087h
        return max(self.store.number("TORQUE SLOPE"), _SLOWEST_RAMP)

    def voltage_ramp(self, change: float) -> float:
        """Return the positive or the negative ramp of the voltage reference, in V/s."""
        name = "V REF POSITIVE RAMP" if change > 0 else "V REF NEGATIVE RAMP"
        return min(abs(self.store.number(name)) or _SLOWEST_RAMP, _STEEPEST_RAMP)


class Az3Axis(Cia402Axis):
    """An axis whose shaft is held until its brake is open."""

    def __init__(self, settings: Az3Settings) -> None:
        self.brake_time = settings.brake_time
        super().__init__(settings, stays_in_quick_stop=False)

    def restart(self) -> None:
        """Set every state as at power-on."""
        super().restart()
        self._brake_opens_at = -inf
        self._brake_holds_at = -inf

    def halted(self, now: float) -> bool:
        """Return whether bit 8 is set, or the brake is not open yet."""
        return bool(self.word & HALT) or self._brake_opens_at > now

    def brake_is_open(self, now: float) -> bool:
        """Return whether the brake lets the shaft turn."""
        if self.state in CURRENT_ON:
            return now >= self._brake_opens_at
        return now < self._brake_holds_at

    def _go(self, transition: Transition, now: float) -> None:
        before = self.state
        super()._go(transition, now)
        if self.state is State.OPERATION_ENABLED and before not in CURRENT_ON:
            self._brake_opens_at = now + self.brake_time("BRAKE DISENGAGE TIME")
            self.update_halt(now)

    def _release(self, now: float) -> float:
        stands_at = super()._release(now)
        self._brake_opens_at = -inf
        self._brake_holds_at = stands_at + self.brake_time("BRAKE ENGAGE TIME")
        return stands_at

    def tick(self, now: float) -> None:
        """Carry out what is due now, such as the motion that waited for the brake to open."""
        opened, was = self._brake_opens_at, self.state
        if self.state is State.OPERATION_ENABLED and -inf < opened <= now:
            self._brake_opens_at = -inf
            self.update_halt(opened)
            if self.mode == POSITION and self.word & NEW_SET_POINT and not self._acknowledged:
                self._set_point(self.word, opened)  # received while the brake was opening
        super().tick(now)
        if was is State.QUICK_STOP_ACTIVE and self.state is not was:
            self._brake_holds_at = self.trajectory.ends_at + self.brake_time("BRAKE ENGAGE TIME")


_INERTIA, _FRICTION = 2e-4, 2e-4
"""kg m², Nm s: a small motor with some load."""

_SUPPLY = 48.0
_SUPPLY_RESISTANCE = 0.05
_AMBIENT = 25.0
_WARMING = 0.5  # °C per ampere

_MONITORED: dict[int, str] = {
    1: "VELOCITY ACTUAL VALUE",
    2: "POSITION ACTUAL VALUE",
    3: "TORQUE ACTUAL VALUE",
    4: "RMS CURRENT",
    5: "VBUS MEAN",
    6: "TARGET VELOCITY",
    7: "HEATSINK TEMPERATURE",
}
"""The values that CHANNEL_SEL_1 to 4 can select, besides 8, the voltage reference. Other numbers show 0."""

_REFERENCE = 8


class Measurements:
    """The measured values of one drive. They are computed when they are read."""

    def __init__(
        self, clock: MachineClock, store: MachineStore, settings: Az3Settings, axis: Az3Axis, phasing: Phasing
    ) -> None:
        self.clock, self.store, self.settings, self.axis, self.phasing = clock, store, settings, axis, phasing
        self.supply = _SUPPLY
        """Volts of the supply."""
        self._torque = Trajectory()
        self._reference = Trajectory()
        measures: dict[str, Callable[[], float]] = {
            "POSITION ACTUAL VALUE": lambda: self._position(32),
            "CUSTOM POSITION ACTUAL VALUE": lambda: self._position(16),
            "VELOCITY ACTUAL VALUE": self._velocity,
            "VL VELOCITY ACTUAL VALUE": self._velocity,
            "CUSTOM VELOCITY ACTUAL VALUE": self._velocity,
            "SENSORLESS MEASURED SPEED": self._velocity,
            "TORQUE ACTUAL VALUE": self._torque_permille,
            "TORQUE DEMAND": self._torque_permille,
            "TORQUE ACTUAL VALUE NM": self._torque_nm,
            "TORQUE SHAFT VALUE": self._torque_nm,
            "CURRENT ACTUAL VALUE": self._torque_permille,
            "RMS CURRENT": self._current,
            "IQRMSX10": lambda: 10 * self._current(),
            "DC LINK CIRCUIT VOLTAGE": lambda: 1000 * self._bus_voltage(),
            "VBUS MEAN": self._bus_voltage,
            "HEATSINK TEMPERATURE": lambda: _AMBIENT + _WARMING * self._current(),
        }
        for name, read in measures.items():
            store.measure(name, read)
        for index in range(CAPTURES):
            store.measure(f"PHASE DATA INCREMENTAL CAPTURES {index}", partial(phasing.captures.__getitem__, index))
        for channel in range(1, 5):
            store.measure(f"MONITOR VAR {channel}", partial(self._monitor, channel))

    def restart(self) -> None:
        """Restart as at power-on, without torque and voltage reference."""
        self._torque, self._reference = Trajectory(), Trajectory()

    # Set-points on ramps

    def follow_torque(self) -> None:
        """Ramp the torque with TORQUE SLOPE to TARGET TORQUE, or to 0 outside torque mode (‰ of the rated torque)."""
        on = self.axis.mode == TORQUE and self.axis.state is State.OPERATION_ENABLED
        slope = self.settings.torque_slope()
        self._torque.move(self.clock.now, self.settings.target_torque() if on else 0.0, slope, slope, slope, jerky=True)

    def follow_reference(self) -> None:
        """Move the voltage reference to V REF SETPOINT on its ramp, in volts."""
        on = self.axis.state is State.OPERATION_ENABLED
        target = self.store.number("V REF SETPOINT") if on else 0.0
        slope = self.settings.voltage_ramp(target - self._reference.position(self.clock.now))
        self._reference.move(self.clock.now, target, slope, slope, slope, jerky=True)

    # Values

    def _position(self, bits: int) -> int:
        return wrapped(self.settings.shown_position(self.axis.trajectory.position(self.clock.now)), bits)

    def _velocity(self) -> float:
        return self.settings.shown_velocity(self.axis.trajectory.velocity(self.clock.now))

    def _torque_nm(self) -> float:
        """Return the torque of torque mode, and what flywheel and friction take."""
        if self.axis.state not in CURRENT_ON:
            return 0.0
        now, trajectory = self.clock.now, self.axis.trajectory
        commanded = self._torque.position(now) / 1000 * self.settings.rated_torque
        turn = 2 * pi / self.settings.increments
        return commanded + turn * (_INERTIA * trajectory.acceleration(now) + _FRICTION * trajectory.velocity(now))

    def _torque_permille(self) -> float:
        return 1000 * self._torque_nm() / self.settings.rated_torque

    def _current(self) -> float:
        """Return the current in A: the rated current gives the rated torque; phasing takes the alignment current."""
        if self.phasing.in_progress:
            return self.store.number("ALIGNMENT CURRENT")
        return abs(self._torque_permille()) / 1000 * self.store.number("MOTOR RATED CURRENT") / 1000

    def _bus_voltage(self) -> float:
        """Return the supply voltage, which drops a little under current."""
        return max(0.0, self.supply - _SUPPLY_RESISTANCE * self._current())

    def _monitor(self, channel: int) -> float:
        selected = self.store.integer(f"CHANNEL_SEL_{channel}")
        if selected == _REFERENCE:
            return self._reference.position(self.clock.now)
        name = _MONITORED.get(selected)
        return self.store.number(name) if name else 0.0
