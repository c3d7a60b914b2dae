"""The settings that an unknown serial line may have, the likely ones first, and how long one unit takes with them.

A device answers only what it receives without a fault, so a wrong baud rate or parity shows as silence: each
combination has to be tried.

    auto baud rates   19200  9600  115200  38400  57600  4800  2400  1200
    auto formats      RTU    8E1  8N1  8O1            ASCII   7E1  8E1  8N1  7O1  7N2

19200 8E1 is the default of the standard [MB-SERIAL 2.5.1], and 9600 8N1 what most devices are delivered with. 8N2 is
not among the formats of RTU: a receiver looks at the first stop bit only, so 8N1 reaches those devices too.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

from barewire.rtu.frame import Timing, character_bits

BAUDRATES = (19200, 9600, 115200, 38400, 57600, 4800, 2400, 1200)
FORMATS = {"rtu": ("8E1", "8N1", "8O1"), "ascii": ("7E1", "8E1", "8N1", "7O1", "7N2")}

TURNAROUND = 0.15
"""Seconds in which a unit begins to answer. One that takes longer is found by its late answer, see `units`."""

_ANSWER = 7
"""Bytes of the answer to the request of a scan: unit, function, count, two of the register, two of the CRC."""


class LineSettings(NamedTuple):
    """Baud rate, data bits, parity and stop bits of a serial line."""

    baudrate: int
    bytesize: int
    parity: str
    stopbits: float

    def __str__(self) -> str:
        return f"{self.baudrate} {self.bytesize}{self.parity}{self.stopbits:g}"

    @property
    def options(self) -> dict[str, int | float | str]:
        """The settings as options of an endpoint, without 8 data bits and one stop bit, which are the default."""
        options: dict[str, int | float | str] = {"baudrate": self.baudrate, "parity": self.parity}
        if self.bytesize != 8:
            options["bytesize"] = self.bytesize
        return options if self.stopbits == 1 else options | {"stopbits": self.stopbits}

    def timeout(self, framing: str) -> float:
        """Return the seconds that a scan waits for an answer: the time of its characters, and the turnaround.

        >>> [round(LineSettings(rate, 8, "N", 1).timeout("rtu"), 4) for rate in (9600, 1200)]
        [0.1573, 0.2083]
        """
        timing = Timing.of(self.baudrate, character_bits(self.bytesize, self.parity, self.stopbits))
        characters = _ANSWER if framing == "rtu" else 2 * _ANSWER + 1  # : and CR LF instead of a second CRC byte
        return TURNAROUND + characters * timing.character


def parse_format(text: str, framing: str) -> tuple[int, str, float]:
    """Return data bits, parity and stop bits.

    >>> parse_format("8e1", "rtu"), parse_format("7N2", "ascii")
    ((8, 'E', 1.0), (7, 'N', 2.0))

    Raises ValueError with what was expected.
    """
    bits, parity, stopbits = text[:1], text[1:2].upper(), text[2:]
    if bits not in ("7", "8") or parity not in ("N", "E", "O") or stopbits not in ("1", "1.5", "2"):
        raise ValueError(f"{text!r}: expected data bits, parity and stop bits, such as 8E1")
    if framing == "rtu" and bits == "7":
        raise ValueError(f"{text!r}: RTU has 8 data bits; 7 are for ascii://")
    return int(bits), parity, float(stopbits)


def combinations(framing: str, baudrates: Sequence[int] | None, formats: Sequence[str] | None) -> list[LineSettings]:
    """Return the settings to try, the likely ones first; None stands for the automatic lists.

    >>> [str(settings) for settings in combinations("rtu", None, ["8N1"])][:3]
    ['19200 8N1', '9600 8N1', '115200 8N1']
    >>> [str(settings) for settings in combinations("rtu", None, None)][:5]
    ['19200 8E1', '9600 8E1', '19200 8N1', '9600 8N1', '115200 8E1']
    """
    rates = BAUDRATES if baudrates is None else baudrates
    places = product(enumerate(rates), enumerate(FORMATS[framing] if formats is None else formats))
    # Both lists are in the order of likelihood. The two usual rates are tried with the two usual formats first.
    ordered = sorted(places, key=lambda pair: (pair[0][0] // 2 + pair[1][0] // 2, pair[1][0], pair[0][0]))
    return [LineSettings(rate, *parse_format(text, framing)) for (_, rate), (_, text) in ordered]
