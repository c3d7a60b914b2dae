"""The motor on a soft starter: the phases of a start and a stop, and the values measured in them.

        status   2 | 5 ramp | 6 current limit | 5 | 8 run | 9 bypass closed .. | 10 ramp down | 12 freewheel | 2
                 --+--------+-----------------+---+-------+--------------------+--------------+--------------+---
        voltage    | rises to full voltage in P01.04                           | falls        | 0
        current    | rises, held at 2.5 In while it would be more, then load   | falls        | 0

Before the ramp there may be a start delay (3) and a kick (4), in the ramp a torque limit (7), set by `start_delay`,
`kick_time` and `torque_limit`. No parameter of the Modbus manual sets them, so they are off by default.
With `low_power` (C15, the test with a motor of low power) current and torque are a twentieth, and no limit is reached.

Simulated: the order and the duration of the phases. Everything is a function of the time since the phase began. Energy,
hours and temperatures are integrated in steps of 0.1 s on a ramp and in one step otherwise, so a day at the bypass
costs as little as a second. The shapes of the curves are plausible, but not measured at a motor.
"""

from __future__ import annotations

from enum import Enum
from math import exp, inf, sin, sqrt
from typing import NamedTuple

RATED_CURRENT, _LINE_VOLTAGE, FREQUENCY = 30.0, 400.0, 50.0  # of an ADXL0030600, type 01 of function 17
_LOAD = 0.8
_CURRENT_LIMIT = 2.5
_KICK_VOLTAGE = 0.8
_LOW_POWER = 0.05
"""The rated current of the motor of low power, relative to that of the starter."""

_FIRST_VOLTAGE = 0.3
_POWER_FACTOR_STALLED, _POWER_FACTOR_RUNNING = 0.35, 0.86
LINE_RATIOS = (1.0, 0.99, 1.01)
"""The currents of L1 to L3, relative to their mean: three phases are never exactly equal."""

_BYPASS_CLOSES, _DECELERATION, _COASTING = 1.0, 5.0, 2.0
"""Seconds. The Modbus manual does not give the parameters of these times, so they cannot be set."""

_AMBIENT = 24.5
_THYRISTOR_RISE, _THYRISTOR_TIME = 20.0, 30.0
_MOTOR_RISE, _MOTOR_TIME = 75.0, 600.0
"""Final motor thermal status in % at rated current; its time constant in seconds."""

_STEP = 0.1


class MotorPhase(Enum):
    """The phases of a start and a stop."""

    READY = "ready"
    DELAYED = "start delay"
    KICKING = "kick start"
    STARTING = "starting"
    CLOSING = "running, the bypass closes"
    BYPASSED = "bypass closed"
    STOPPING = "stopping"
    COASTING = "freewheel"


class MotorSample(NamedTuple):
    """The measured values at one moment, relative to the rated ones. `wanted` is the current without the limit."""

    voltage: float
    current: float
    wanted: float
    torque: float
    power_factor: float

    def scaled(self, factor: float) -> MotorSample:
        """Return the same voltage on a motor of `factor` times the size."""
        return self._replace(current=self.current * factor, wanted=self.wanted * factor, torque=self.torque * factor)


_STANDSTILL = MotorSample(0.0, 0.0, 0.0, 0.0, 0.0)
_RUNNING = MotorSample(1.0, _LOAD, _LOAD, _LOAD, _POWER_FACTOR_RUNNING)


class Motor:
    """One motor on one starter. `advance` lets time pass; everything else refers to that time."""

    def __init__(self, now: float) -> None:
        self.phase = MotorPhase.READY
        self.began = now
        self.now = now
        self.acceleration_time = 0.0
        self.energy = 0.0  # kWh
        self.seconds = 0.0  # of running
        self.starts = 0
        self.thermal = 0.0  # %
        self.thyristors = _AMBIENT
        # Set from outside; the acceleration time is a parameter of the starter.
        self.start_delay = 0.0
        self.kick_time = 0.0
        self.torque_limit = inf  # of the rated torque
        self.low_power = False

    # Commands

    def start(self, acceleration_time: float) -> None:
        """Begin the start delay, the kick, or the acceleration ramp, in seconds."""
        self.acceleration_time = acceleration_time
        self.starts += 1
        self._begin(MotorPhase.DELAYED if self.start_delay > 0 else self._after_delay, self.now)

    @property
    def _after_delay(self) -> MotorPhase:
        return MotorPhase.KICKING if self.kick_time > 0 else MotorPhase.STARTING

    def stop(self) -> None:
        """Begin the deceleration ramp."""
        self._begin(MotorPhase.STOPPING, self.now)

    def cut(self) -> None:
        """Switch the current off at once: the motor coasts."""
        if self.is_running:
            self._begin(MotorPhase.COASTING, self.now)
        elif self.phase is MotorPhase.DELAYED:
            self._begin(MotorPhase.READY, self.now)

    def _begin(self, phase: MotorPhase, began: float) -> None:
        self.phase, self.began = phase, began

    # Time

    @property
    def phase_ends(self) -> float:
        """The time at which the present phase ends without a command."""
        durations = {
            MotorPhase.DELAYED: self.start_delay,
            MotorPhase.KICKING: self.kick_time,
            MotorPhase.STARTING: self.acceleration_time,
            MotorPhase.CLOSING: _BYPASS_CLOSES,
            MotorPhase.STOPPING: _DECELERATION,
            MotorPhase.COASTING: _COASTING,
        }
        return self.began + durations.get(self.phase, inf)

    def advance(self, now: float) -> None:
        """Pass through the phases until `now`, and integrate energy, hours and temperatures."""
        next_phase = {
            MotorPhase.DELAYED: self._after_delay,
            MotorPhase.KICKING: MotorPhase.STARTING,
            MotorPhase.STARTING: MotorPhase.CLOSING,
            MotorPhase.CLOSING: MotorPhase.BYPASSED,
            MotorPhase.STOPPING: MotorPhase.COASTING,
            MotorPhase.COASTING: MotorPhase.READY,
        }
        while self.phase_ends <= now:
            ends = self.phase_ends
            self._integrate(ends)
            self._begin(next_phase[self.phase], ends)
        self._integrate(now)

    def _integrate(self, until: float) -> None:
        changes = self.phase in (MotorPhase.STARTING, MotorPhase.STOPPING)  # in all others one step is exact
        while self.now < until:
            # On a grid that begins with the phase, so that the result hardly depends on how often time is passed in.
            ends = until
            if changes:
                steps = int((self.now - self.began) / _STEP + 1e-9) + 1
                ends = min(until, self.began + steps * _STEP)
            step = ends - self.now
            self._accumulate(self.sample(self.now + step / 2), step)
            self.now = ends

    def _accumulate(self, sample: MotorSample, step: float) -> None:
        self.energy += self.power(sample) * step / 3600
        self.seconds += step if self.is_running else 0.0
        # With the bypass closed the thyristors carry no current and cool down.
        carried = 0.0 if self.phase is MotorPhase.BYPASSED else sample.current
        self.thyristors = _approach(self.thyristors, _AMBIENT + _THYRISTOR_RISE * carried, step / _THYRISTOR_TIME)
        self.thermal = _approach(self.thermal, _MOTOR_RISE * sample.current**2, step / _MOTOR_TIME)

    # Measured values

    @property
    def is_running(self) -> bool:
        """Whether the starter feeds the motor."""
        return self.phase not in (MotorPhase.READY, MotorPhase.DELAYED, MotorPhase.COASTING)

    @property
    def is_limited(self) -> bool:
        """Whether the motor would take more current than the limit allows."""
        return self.phase is MotorPhase.STARTING and self.sample(self.now).wanted > _CURRENT_LIMIT

    @property
    def is_torque_limited(self) -> bool:
        """Whether the torque would be more than the limit allows."""
        return self.phase is MotorPhase.STARTING and self.sample(self.now).torque == self.torque_limit

    def sample(self, now: float) -> MotorSample:
        """Return voltage, current, torque and power factor at a time within the present phase."""
        sample = self._sample(now)
        if self.low_power:
            return sample.scaled(_LOW_POWER)
        if sample.torque <= self.torque_limit or self.phase is not MotorPhase.STARTING:
            return sample
        # Torque goes with the square of the voltage, current with the voltage.
        less = sqrt(self.torque_limit / sample.torque)
        return sample._replace(voltage=sample.voltage * less, current=sample.current * less, torque=self.torque_limit)

    def _sample(self, now: float) -> MotorSample:
        if not self.is_running:
            return _STANDSTILL
        if self.phase is MotorPhase.KICKING:
            wanted = 6.5 * _KICK_VOLTAGE
            torque = 1.2 * _KICK_VOLTAGE**2
            return MotorSample(_KICK_VOLTAGE, min(wanted, _CURRENT_LIMIT), wanted, torque, _POWER_FACTOR_STALLED)
        if self.phase is MotorPhase.STARTING:
            return _ramp(min(1.0, (now - self.began) / self.acceleration_time))
        if self.phase is MotorPhase.STOPPING:
            voltage = max(0.0, 1 - (now - self.began) / _DECELERATION)
            current = _LOAD * voltage
            return MotorSample(voltage, current, current, _LOAD * voltage**2, _POWER_FACTOR_RUNNING)
        return _RUNNING

    def power(self, sample: MotorSample) -> float:
        """Return the active power of all three phases in kW, as taken from the line."""
        return sqrt(3) * _LINE_VOLTAGE * sample.current * RATED_CURRENT * sample.power_factor / 1000

    def line_voltage(self) -> float:
        """Return a line voltage that varies a little with time, so that a plot is not a straight line."""
        return _LINE_VOLTAGE * (1 + 0.003 * sin(self.now / 7) + 0.001 * sin(self.now * 1.7))


def _ramp(x: float) -> MotorSample:
    """Return the sample at the part `x` of the acceleration time. The speed is a smooth step from 0 to 1."""
    speed = x * x * (3 - 2 * x)
    voltage = _FIRST_VOLTAGE + (1 - _FIRST_VOLTAGE) * x
    wanted = 6.5 * voltage * (1 - speed) + _LOAD * speed
    torque = 1.2 * voltage**2 * (1 - speed) + _LOAD * speed
    factor = _POWER_FACTOR_STALLED + (_POWER_FACTOR_RUNNING - _POWER_FACTOR_STALLED) * speed
    return MotorSample(voltage, min(wanted, _CURRENT_LIMIT), wanted, torque, factor)


def _approach(value: float, towards: float, time: float) -> float:
    """Return the value after a first-order approach, exact for any `time` (in time constants) while `towards` stays."""
    return towards + (value - towards) * exp(-time)
