"""SDO dialects: how the SDO of one device departs from CiA 301, as data.

The standard has one command byte to request an object: 40h, whatever its type. Some devices expect a read request that
repeats the command byte of the response (43h for 4 bytes), and send every number in four bytes:

        standard     C  40 40 60 00 00 00 00 00        S  4B 40 60 00 06 00 00 00
        sized        C  43 40 60 00 00 00 00 00        S  43 40 60 00 06 00 00 00

A client uses the dialect of its device. A server accepts both, because bits 7 to 5, which are the command, are the
same; it counts the departure. The dialects of known devices, by name, are in `barewire.devices.sdo_dialects`.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

from barewire.errors import DecodeError, EncodeError, Reason


class SdoDialect(NamedTuple):
    """One variant of SDO.

    read_commands   pairs (size of the requested type in bytes, command byte); empty: 40h for all
    lengths         the bytes of a number: "exact", as many as its type has; "in four", always four
    """

    name: str
    read_commands: tuple[tuple[int, int], ...] = ()
    lengths: Literal["exact", "in four"] = "exact"

    def read_command(self, size: int | None) -> int:
        """Return the command byte that requests an object of `size` bytes; of 4 bytes if the size is unknown.

        >>> sized = SdoDialect("sized", ((2, 0x4B), (4, 0x43)))
        >>> hex(STANDARD.read_command(2)), hex(sized.read_command(2)), hex(sized.read_command(None))
        ('0x40', '0x4b', '0x43')

        Raise EncodeError if the dialect has no command for that size.
        """
        if not self.read_commands:
            return 0x40
        for known, command in self.read_commands:
            if known == (size or 4):
                return command
        sizes = ", ".join(str(known) for known, _ in self.read_commands)
        raise EncodeError(f"dialect {self.name} cannot ask for {size} bytes: expected {sizes}")


STANDARD = SdoDialect("standard")


def fit(data: bytes, size: int) -> bytes:
    """Cut a response to the size of its type, for servers that send a short number in four bytes.

    >>> fit(bytes.fromhex("06000000"), 2).hex(" ")
    '06 00'

    The surplus bytes must be zeros, or the sign extension of a negative number; anything else would change the value
    and raises DecodeError("long"). Too few bytes raise DecodeError("short").
    """
    value, surplus = data[:size], data[size:]
    if len(data) < size or not size:
        reason: Reason = "short" if len(data) < size else "length"
        raise DecodeError(reason, data, len(data), f"{size} bytes wanted, got {len(data)}")
    is_negative = bool(value[-1] & 0x80)
    if not surplus.strip(b"\0") or (is_negative and not surplus.strip(b"\xff")):
        return value
    raise DecodeError("long", data, size, f"the value does not fit {size} bytes")
