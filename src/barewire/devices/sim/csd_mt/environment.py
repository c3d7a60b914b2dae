"""What is outside of a CSD MT: the supply, the machine that its shaft turns, and what is wired to its inputs.

    walls.low   limit switch I1   home switch I0             index, once a revolution       limit switch I2   walls.high
        |======[ON                   [ON]                  '      '      '      '                        ON]======|
        '----------------------------- position of the shaft, in steps ----------------------------------------> +

Positions here are the shaft's own, in steps of 1/12800 revolution from where it stood when the world began, whatever
the drive calls them; up is the direction of Revolution Direction 0. Everything is an attribute that a user sets at any
time; what it brings about happens at the next `tick`, request or answer, at the time of the last one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, isnan, nan
from typing import NamedTuple

from barewire.errors import EncodeError

REVOLUTION = 12_800
"""Steps of a revolution: Step Revolution (1081) has no other value."""


class Span(NamedTuple):
    """A stretch of the shaft's way."""

    low: float
    high: float


HOME = Span(25_600, 26_880)
NO_WALLS = Span(-inf, inf)


def nothing_wired() -> list[Span | bool]:
    """A home switch at I0, and no voltage at I1 to I4."""
    return [HOME, False, False, False, False]


@dataclass
class Environment:
    """The machine around the drive. A `Span` at an input is a switch that is ON while the shaft is inside.

    >>> environment = Environment()
    >>> environment.inputs[1] = Span(-50_000, inf)  # a negative limit switch: OFF below -50000
    >>> environment.inputs[3] = True  # a button that is pressed
    """

    inputs: list[Span | bool] = field(default_factory=nothing_wired)
    """What is wired to I0 to I4: a level, or a switch that the shaft passes."""
    walls: Span = NO_WALLS
    """Where the mechanics end. A motor that is driven against a wall loses its steps."""
    pull_out: float = inf
    """The load: above this speed, in step/s, the motor does not follow."""
    friction: float = 400_000.0
    """How fast a shaft without current slows down, in step/s²."""
    encoder: int = 400
    """Counts per revolution of the encoder on the shaft; 0 for a motor without one."""
    index: float = 0.0
    """Where in the revolution the index pulse of the encoder begins."""
    ambient: float = 25.0
    """Temperature around the drive, in °C."""
    volts: float = 48.0
    """What the power section is supplied with: 24 to 48 V, ±10 %, are in range. The logic has a supply of its own."""
    model: str = "94"
    """"94", with I0 to I4 and O0 to O4, or "S4", with I0, I1, O0 to O2 and Safe Torque Off."""
    sto: tuple[bool, bool] = (True, True)
    """CSD MT S4: whether there are 24 V at STO1 and at STO2. The motor has current only with both."""

    def put(self, text: str) -> None:
        """Set one thing by its name, as somebody writes it at a command line.

        >>> environment = Environment()
        >>> for text in ("I0=1000:1200", "I3=on", "walls=-50000:50000", "pull-out=20000", "volts=0", "model=S4"):
        ...     environment.put(text)
        >>> environment.inputs[0], environment.inputs[3], environment.pull_out
        (Span(low=1000.0, high=1200.0), True, 20000.0)

        EncodeError says what was expected.
        """
        name, _, value = text.partition("=")
        name, value = name.strip().lower().replace("-", "_"), value.strip()
        if name in ("i0", "i1", "i2", "i3", "i4"):
            self.inputs[int(name[1])] = _switch(text, value)
        elif name == "walls":
            self.walls = _span(text, value)
        elif name == "model":
            if value.upper() not in MODELS:
                raise EncodeError(f"{text!r}: expected one of {', '.join(MODELS)}")
            self.model = value.upper()
        elif name in NUMBERS:
            number = _number(text, value)
            if name == "encoder" and not number.is_integer():
                raise EncodeError(f"{text!r}: expected a whole number behind =, found {value!r}")
            setattr(self, name, int(number) if name == "encoder" else number)
        else:
            known = ", ".join(["I0 to I4", "walls", "model", *(number.replace("_", "-") for number in NUMBERS)])
            raise EncodeError(f"{text!r}: expected NAME=VALUE with a name of {known}")


MODELS = ("94", "S4")
NUMBERS = ("pull_out", "friction", "encoder", "index", "ambient", "volts")


def _number(text: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        number = nan
    if isnan(number):
        raise EncodeError(f"{text!r}: expected a number behind =, found {value!r}")
    return number


def _span(text: str, value: str) -> Span:
    low, colon, high = value.partition(":")
    if not colon:
        raise EncodeError(f"{text!r}: expected LOW:HIGH behind =, found {value!r}")
    span = Span(_number(text, low or "-inf"), _number(text, high or "inf"))
    if not span.low < span.high:
        raise EncodeError(f"{text!r}: expected LOW below HIGH")
    return span


def _switch(text: str, value: str) -> Span | bool:
    if value.lower() in ("on", "off"):
        return value.lower() == "on"
    if ":" not in value:
        raise EncodeError(f"{text!r}: expected on, off, or LOW:HIGH for a switch, found {value!r}")
    return _span(text, value)
