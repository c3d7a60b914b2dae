"""The environment of a CSD MT: its supply, the mechanics that its shaft turns, and the wiring of its inputs.

    walls.low   limit switch I1   home switch I0             index, once a revolution       limit switch I2   walls.high
        |======[ON                   [ON]                  '      '      '      '                        ON]======|
        '----------------------------- position of the shaft, in steps ----------------------------------------> +

Positions here are those of the shaft, in steps of 1/12800 revolution from where it stood at first, whatever position
the drive reports; up is the direction of Revolution Direction 0. An attribute may be set at any time. It takes effect
at the next `tick` or request, at the time of the last one.

`Context` is what all parts of the drive share: clock, registers, environment and alarm log.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from math import inf
from typing import NamedTuple

from barewire.devices.sim.machine import SWITCH, EnvironmentProperty, Form, number
from barewire.devices.sim.store import MachineClock, MachineStore

REVOLUTION = 12_800
"""Steps of a revolution: Step Revolution (1081) has no other value."""


class Span(NamedTuple):
    """A range of shaft positions, in steps."""

    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.low:.10g}:{self.high:.10g}"


_HOME_SWITCH = Span(25_600, 26_880)
_NO_WALLS = Span(-inf, inf)

_POWER_RANGE = 24 * 0.9, 48 * 1.1
"""Volts of the power section that are in range (ch. 14, 5100h)."""


def _default_inputs() -> list[Span | bool]:
    """Return a home switch at I0, and no voltage at I1 to I4."""
    return [_HOME_SWITCH, False, False, False, False]


@dataclass
class Environment:
    """The surroundings of the drive. A `Span` at an input is a switch that is ON while the shaft is inside.

    >>> environment = Environment()
    >>> environment.inputs[1] = Span(-50_000, inf)  # a negative limit switch: OFF below -50000
    >>> environment.inputs[3] = True  # a button that is pressed
    """

    inputs: list[Span | bool] = field(default_factory=_default_inputs)
    """The wiring of I0 to I4: a level, or a switch that the shaft passes."""
    walls: Span = _NO_WALLS
    """The ends of the mechanics. A motor that is driven against a wall loses its steps."""
    pull_out: float = inf
    """The load: above this speed, in step/s, the motor does not follow."""
    friction: float = 400_000.0
    """The deceleration of a shaft without current, in step/s²."""
    encoder: int = 400
    """Counts per revolution of the encoder on the shaft; 0 for a motor without one."""
    index: float = 0.0
    """Where in the revolution the index pulse of the encoder begins."""
    ambient: float = 25.0
    """Ambient temperature in °C."""
    volts: float = 48.0
    """Supply of the power section: 24 to 48 V, ±10 %, are in range. The logic has a supply of its own."""
    model: str = "94"
    """"94", with I0 to I4 and O0 to O4, or "S4", with I0, I1, O0 to O2 and Safe Torque Off."""
    sto: tuple[bool, bool] = (True, True)
    """CSD MT S4: whether there are 24 V at STO1 and at STO2. The motor has current only with both."""

    @property
    def has_power(self) -> bool:
        """Whether the supply of the power section is in range."""
        return _POWER_RANGE[0] <= self.volts <= _POWER_RANGE[1]

    @property
    def safe_torque_off(self) -> bool:
        """Whether the motor may have no current (CSD MT S4, ch. 13)."""
        return self.model == "S4" and not all(self.sto)

    def properties(self) -> tuple[EnvironmentProperty, ...]:
        """Return what can be set by name, with the present values.

        >>> [(row.name, row.text) for row in Environment().properties()][:2]
        [('I0', '25600:26880'), ('I1', 'off')]
        """
        of, wiring = EnvironmentProperty.of, "on, off, or a switch that is ON from LOW to HIGH"
        return (
            *(
                EnvironmentProperty(f"I{place}", wiring, _WIRE, wire, partial(self.inputs.__setitem__, place))
                for place, wire in enumerate(self.inputs)
            ),
            of(self, "walls", "the mechanical end stops", _SPAN),
            of(self, "pull_out", "the speed above which steps are lost, from the load", number()),
            of(self, "friction", "the deceleration of a shaft without current, step/s²", number()),
            of(self, "encoder", "counts of the encoder per revolution; 0: none", number(0, read=int)),
            of(self, "index", "where its index pulse begins", number()),
            of(self, "ambient", "°C around the drive", number()),
            of(self, "volts", "volts of the power section; 0: none", number()),
            of(self, "model", "CSD MT 94 or CSD MT S4", _MODEL),
        )


def _span(text: str) -> Span:
    """Return the span of LOW:HIGH, either of which may be missing."""
    low, high = text.split(":")
    span = Span(float(low or "-inf"), float(high or "inf"))
    if not span.low < span.high:
        raise ValueError(text)
    return span


def _wire(text: str) -> Span | bool:
    return SWITCH.read(text) if ":" not in text else _span(text)


_SPAN = Form("LOW:HIGH, the lower one first,", _span)
_WIRE = Form("on, off, or LOW:HIGH for a switch", _wire)
_MODEL = Form("94 or S4", {"94": "94", "S4": "S4", "s4": "S4"}.__getitem__, ("94", "S4"))


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
        self.entries = [(int(uptime) % 0x10000, code), *self.entries][: self.SIZE]  # the time is one register

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
