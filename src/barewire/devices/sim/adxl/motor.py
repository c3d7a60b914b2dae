"""The motor behind a soft starter: phases of a start and a stop, and what the instruments show meanwhile.

        status   2 | 5 ramp | 6 current limit | 5 | 8 run | 9 bypass closed .. | 10 ramp down | 12 freewheel | 2
                 --+--------+-----------------+---+-------+--------------------+--------------+--------------+---
        voltage    | rises to full voltage in P01.04                           | falls        | 0
        current    | rises, held at 2.5 In while it would be more, then load   | falls        | 0

Before the ramp there may be a start delay (3) and a kick (4), in it a torque limit (7): `start_delay`, `kick_time` and
`torque_limit`. No parameter of the Modbus manual sets them, so they are off until somebody sets them here. With `small`
(C15, the test with a motor of low power) all that the motor takes is a twentieth, and no limit is ever reached.

Everything is a function of the time since the phase began. What accumulates (energy, hours, temperatures) is integrated
in steps of `STEP` while something changes and in one step while nothing does, so that a day at the bypass costs as
little as a second. The shape of the curves is chosen to look right; it is no motor's.
"""

from __future__ import annotations

from enum import Enum
from math import exp, inf, sin, sqrt
from typing import NamedTuple

RATED_CURRENT, LINE_VOLTAGE, FREQUENCY = 30.0, 400.0, 50.0  # of an ADXL0030600, type 01 of function 17
LOAD = 0.8
CURRENT_LIMIT = 2.5
KICK_VOLTAGE = 0.8
SMALL = 0.05
"""The rated current of the motor of low power, of that of the starter."""

FIRST_VOLTAGE = 0.3
POWER_FACTOR_STALLED, POWER_FACTOR_RUNNING = 0.35, 0.86
PHASES = (1.0, 0.99, 1.01)
"""No three phases are quite alike."""

BYPASS_CLOSES, DECELERATION, COASTING = 1.0, 5.0, 2.0
"""Seconds. The parameters behind these times are not in the Modbus manual, so they cannot be set."""

AMBIENT = 24.5
THYRISTOR_RISE, THYRISTOR_TIME = 20.0, 30.0
MOTOR_RISE, MOTOR_TIME = 75.0, 600.0
"""Motor thermal status in % at rated current, for ever; its time constant."""

STEP = 0.1


class Phase(Enum):
    """What the starter is doing."""

    READY = "ready"
    DELAYED = "start delay"
    KICKING = "kick start"
    STARTING = "starting"
    CLOSING = "running, the bypass closes"
    BYPASSED = "bypass closed"
    STOPPING = "stopping"
    COASTING = "freewheel"


class Sample(NamedTuple):
    """The instruments at one moment. Currents in rated currents."""

    voltage: float
    current: float
    wanted: float
    torque: float
    power_factor: float

    def scaled(self, by: float) -> Sample:
        """The same voltage on a motor that is so much smaller."""
        return self._replace(current=self.current * by, wanted=self.wanted * by, torque=self.torque * by)


STANDSTILL = Sample(0.0, 0.0, 0.0, 0.0, 0.0)
RUNNING = Sample(1.0, LOAD, LOAD, LOAD, POWER_FACTOR_RUNNING)


class Motor:
    """One motor on one starter. `advance` lets time pass; everything else is as of then."""

    def __init__(self, now: float) -> None:
        self.phase = Phase.READY
        self.began = now
        self.now = now
        self.acceleration_time = 0.0
        self.energy = 0.0  # kWh
        self.seconds = 0.0  # of running
        self.starts = 0
        self.thermal = 0.0  # %
        self.thyristors = AMBIENT
        # What a bench sets; the rest of a start is in the parameters of the starter.
        self.start_delay = 0.0
        self.kick_time = 0.0
        self.torque_limit: float | None = None  # of the rated torque
        self.small = False

    # Commands

    def start(self, acceleration_time: float) -> None:
        """Begin: the delay, the kick, or the acceleration ramp at once."""
        self.acceleration_time = acceleration_time
        self.starts += 1
        self._begin(Phase.DELAYED if self.start_delay > 0 else self._after_delay, self.now)

    @property
    def _after_delay(self) -> Phase:
        return Phase.KICKING if self.kick_time > 0 else Phase.STARTING

    def stop(self) -> None:
        """Begin the deceleration ramp."""
        self._begin(Phase.STOPPING, self.now)

    def cut(self) -> None:
        """Take the current away at once: the motor coasts."""
        if self.is_running:
            self._begin(Phase.COASTING, self.now)
        elif self.phase is Phase.DELAYED:
            self._begin(Phase.READY, self.now)

    def _begin(self, phase: Phase, at: float) -> None:
        self.phase, self.began = phase, at

    # Time

    @property
    def phase_ends(self) -> float:
        """When the present phase is over by itself."""
        lasts = {
            Phase.DELAYED: self.start_delay,
            Phase.KICKING: self.kick_time,
            Phase.STARTING: self.acceleration_time,
            Phase.CLOSING: BYPASS_CLOSES,
            Phase.STOPPING: DECELERATION,
            Phase.COASTING: COASTING,
        }
        return self.began + lasts.get(self.phase, inf)

    def advance(self, now: float) -> None:
        """Pass through phases up to now, and accumulate."""
        following = {
            Phase.DELAYED: self._after_delay,
            Phase.KICKING: Phase.STARTING,
            Phase.STARTING: Phase.CLOSING,
            Phase.CLOSING: Phase.BYPASSED,
            Phase.STOPPING: Phase.COASTING,
            Phase.COASTING: Phase.READY,
        }
        while self.phase_ends <= now:
            ends = self.phase_ends
            self._integrate(ends)
            self._begin(following[self.phase], ends)
        self._integrate(now)

    def _integrate(self, until: float) -> None:
        changes = self.phase in (Phase.STARTING, Phase.STOPPING)
        while self.now < until:
            # On a grid that begins with the phase, so that looking more often changes as little as possible.
            following = self.began + (int((self.now - self.began) / STEP + 1e-9) + 1) * STEP if changes else until
            step = min(following, until) - self.now
            sample = self.sample(self.now + step / 2)
            self._accumulate(sample, step)
            self.now = min(following, until)

    def _accumulate(self, sample: Sample, step: float) -> None:
        self.energy += self.power(sample) * step / 3600
        self.seconds += step if self.is_running else 0.0
        # Behind the closed bypass the thyristors carry nothing and cool down.
        carried = 0.0 if self.phase is Phase.BYPASSED else sample.current
        self.thyristors = _creep(self.thyristors, AMBIENT + THYRISTOR_RISE * carried, step / THYRISTOR_TIME)
        self.thermal = _creep(self.thermal, MOTOR_RISE * sample.current**2, step / MOTOR_TIME)

    # Instruments

    @property
    def is_running(self) -> bool:
        """Whether the starter feeds the motor."""
        return self.phase not in (Phase.READY, Phase.DELAYED, Phase.COASTING)

    @property
    def is_limited(self) -> bool:
        """Whether the motor would take more current than the limit gives it."""
        return self.phase is Phase.STARTING and self.sample(self.now).wanted > CURRENT_LIMIT

    @property
    def is_torque_limited(self) -> bool:
        """Whether the torque would be more than the limit lets it be."""
        return self.phase is Phase.STARTING and self.sample(self.now).torque == self.torque_limit

    def sample(self, now: float) -> Sample:
        """Voltage, current, torque and power factor at a time within the present phase."""
        sample = self._sample(now)
        if self.small:
            return sample.scaled(SMALL)
        if self.torque_limit is None or sample.torque <= self.torque_limit or self.phase is not Phase.STARTING:
            return sample
        # Torque goes with the square of the voltage, current with the voltage.
        less = sqrt(self.torque_limit / sample.torque)
        return sample._replace(voltage=sample.voltage * less, current=sample.current * less, torque=self.torque_limit)

    def _sample(self, now: float) -> Sample:
        if not self.is_running:
            return STANDSTILL
        if self.phase is Phase.KICKING:
            wanted = 6.5 * KICK_VOLTAGE
            torque = 1.2 * KICK_VOLTAGE**2
            return Sample(KICK_VOLTAGE, min(wanted, CURRENT_LIMIT), wanted, torque, POWER_FACTOR_STALLED)
        if self.phase is Phase.STARTING:
            return _ramp(min(1.0, (now - self.began) / self.acceleration_time))
        if self.phase is Phase.STOPPING:
            left = max(0.0, 1 - (now - self.began) / DECELERATION)
            return Sample(left, LOAD * left, LOAD * left, LOAD * left**2, POWER_FACTOR_RUNNING)
        return RUNNING

    def power(self, sample: Sample) -> float:
        """Active power of all three phases in kW, seen from the line."""
        return sqrt(3) * LINE_VOLTAGE * sample.current * RATED_CURRENT * sample.power_factor / 1000

    def line_voltage(self) -> float:
        """The line breathes a little, always in the same way, so that a picture of it is no straight line."""
        return LINE_VOLTAGE * (1 + 0.003 * sin(self.now / 7) + 0.001 * sin(self.now * 1.7))


def _ramp(x: float) -> Sample:
    """A start, at the part `x` of the acceleration time. The speed is a smooth step from 0 to 1."""
    speed = x * x * (3 - 2 * x)
    voltage = FIRST_VOLTAGE + (1 - FIRST_VOLTAGE) * x
    wanted = 6.5 * voltage * (1 - speed) + LOAD * speed
    torque = 1.2 * voltage**2 * (1 - speed) + LOAD * speed
    factor = POWER_FACTOR_STALLED + (POWER_FACTOR_RUNNING - POWER_FACTOR_STALLED) * speed
    return Sample(voltage, min(wanted, CURRENT_LIMIT), wanted, torque, factor)


def _creep(value: float, towards: float, time: float) -> float:
    """First-order approach; `time` in time constants. Exact for any length while `towards` stays."""
    return towards + (value - towards) * exp(-time)
