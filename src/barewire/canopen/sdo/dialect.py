"""How a device departs from the letter of SDO, as data.

The standard has one way to ask for an object: 40h, whatever its type. The guide of the AZ3 teaches another: the
read request repeats the byte of the wanted answer, and its worked example moves a 16-bit object in four bytes.

        standard     C  40 40 60 00 00 00 00 00        S  4B 40 60 00 06 00 00 00
        az3          C  43 40 60 00 00 00 00 00        S  43 40 60 00 06 00 00 00

A client speaks the dialect that the device wants; a server understands both, because the bits that make a command
(7 to 5) are the same, and counts the departure.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

from barewire.errors import DecodeError, EncodeError, Reason


class Dialect(NamedTuple):
    """One manner of speaking SDO.

    `read_commands` are (size of the wanted type, command byte) pairs; none means 40h for all. `lengths` is how
    long a number is: `exact` as its type has it, or `in four` bytes whatever its type.
    """

    name: str
    read_commands: tuple[tuple[int, int], ...] = ()
    lengths: Literal["exact", "in four"] = "exact"

    def read_command(self, size: int | None) -> int:
        """The byte that asks for an object of `size` bytes, 4 if nobody knows.

        >>> hex(STANDARD.read_command(2)), hex(AZ3.read_command(2)), hex(AZ3.read_command(None))
        ('0x40', '0x4b', '0x43')
        """
        if not self.read_commands:
            return 0x40
        for known, command in self.read_commands:
            if known == (size or 4):
                return command
        sizes = ", ".join(str(known) for known, _ in self.read_commands)
        raise EncodeError(f"dialect {self.name} cannot ask for {size} bytes: expected {sizes}")


STANDARD = Dialect("standard")
AZ3 = Dialect("az3", ((1, 0x4F), (2, 0x4B), (4, 0x43)), "in four")

DIALECTS = {dialect.name: dialect for dialect in (STANDARD, AZ3)}
"""By name, as device descriptions and commands know them."""


def fit(data: bytes, size: int) -> bytes:
    """An answer cut to the size of its type, when a server sent a short number in four bytes.

    >>> fit(bytes.fromhex("06000000"), 2).hex(" ")
    '06 00'

    What is cut off must be nothing: zeros, or the sign of a negative number. Otherwise the value would be another
    one, and that is DecodeError("long"); too few bytes are DecodeError("short").
    """
    kept, surplus = data[:size], data[size:]
    if len(data) < size or not size:
        reason: Reason = "short" if len(data) < size else "length"
        raise DecodeError(reason, data, len(data), f"{size} bytes wanted, here are {len(data)}")
    negative = bool(kept[-1] & 0x80)
    if not surplus.strip(b"\0") or (negative and not surplus.strip(b"\xff")):
        return kept
    raise DecodeError("long", data, size, f"the value does not fit {size} bytes")
