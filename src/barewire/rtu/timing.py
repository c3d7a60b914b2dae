"""The duration of a character, and the two silences of RTU, t1.5 and t3.5.

    one character, 11 bits:   | start | 8 data bits, lowest first | parity | stop |       [MB-SERIAL 2.5.1]
                                                    no parity: a second stop bit takes its place
    ...|char|char|char| <- at least t3.5, silence -> |char|char|char|char|...             [MB-SERIAL 2.5.1.1]
                         ends a frame                  no gap above t1.5 inside

t1.5 and t3.5 are 1.5 and 3.5 characters up to 19200 bit/s. Above that they are fixed at 750 us and 1750 us, because
the timers of small devices have no finer resolution. Lines with 8N1, not standard but common, send 10 bits a character.
"""

from __future__ import annotations

from typing import NamedTuple

from barewire.errors import EncodeError

FIXED_ABOVE = 19200
FIXED_T15 = 750e-6
FIXED_T35 = 1750e-6


class Timing(NamedTuple):
    """The times of a line, in seconds.

    >>> timing = Timing.of(19200)
    >>> [f"{1e6 * t:.1f} us" for t in timing]
    ['572.9 us', '859.4 us', '2005.2 us']
    >>> Timing.of(115200).t35
    0.00175
    """

    character: float
    t15: float
    t35: float

    @classmethod
    def of(cls, baudrate: int, bits: int = 11) -> Timing:
        """Return the times for a rate in bit/s and the bits per character: 11, or 10 with 8N1 and with 7E1 of ASCII.

        Raises EncodeError for a rate that is not positive, and for fewer than 7 or more than 12 bits.
        """
        if baudrate <= 0:
            raise EncodeError(f"baudrate {baudrate}: expected a positive number of bits per second", "baudrate")
        if not 7 <= bits <= 12:
            raise EncodeError(f"{bits} bits per character: expected 7..12", "bits")
        character = bits / baudrate
        if baudrate > FIXED_ABOVE:
            return cls(character, FIXED_T15, FIXED_T35)
        return cls(character, 1.5 * character, 3.5 * character)

    def duration(self, length: int) -> float:
        """Return the seconds that `length` characters take on the wire without gaps."""
        return length * self.character


def character_bits(data_bits: int, parity: str, stop_bits: float) -> int:
    """Return the bits of one character with these port settings: start, data, parity if any, stop.

    >>> character_bits(8, "E", 1), character_bits(8, "N", 2), character_bits(8, "N", 1), character_bits(7, "E", 1)
    (11, 11, 10, 10)
    """
    return 1 + data_bits + (parity.upper() != "N") + int(stop_bits + 0.5)
