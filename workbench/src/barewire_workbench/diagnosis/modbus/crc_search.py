"""Finds the one change of a byte, a bit or a length that makes the CRC of an RTU frame fit.

A receiver computes the CRC over the whole frame, its two CRC bytes too; a good frame ends with 0. The computation can
be followed from both sides, because each step of the table can be reversed:

    FFFFh  01  ->  .  03  ->  .  00  ->  .  ...  ->  .  C5  ->  .  CD  ->  0000h
           before[0]  before[1]                                            after[8]

`before[i]` is the remainder in front of byte i, computed from the start; `after[i]` is the remainder that must be there
for the rest to end with 0, computed from the end. A good frame has the same remainders in both rows. A frame with one
fault has equal rows except at the fault:

    a byte too many at i     before[i] == after[i + 1]
    a byte lost before i     one step leads from before[i] to after[i], and only one byte makes that step
    a wrong byte at i        one step leads from before[i] to after[i + 1]

So a frame of n bytes takes about 2 n steps for each of these questions, and not 256 n² of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from barewire.rtu.crc import INITIAL, TABLE

_ROW_OF = {entry >> 8: row for row, entry in enumerate(TABLE)}
"""The row of the table by the high byte of its entry: each high byte occurs once, so a step can be reversed."""


class CrcFit(NamedTuple):
    """A change with which the CRC fits: the place, the byte that would be there, and the whole frame after it."""

    at: int
    byte: int
    frame: bytes


def step(before: int, byte: int) -> int:
    """Return the remainder after one byte more."""
    return before >> 8 ^ TABLE[(before ^ byte) & 0xFF]


def step_back(after: int, byte: int) -> int:
    """Return the remainder before a byte, from the one after it.

    >>> f"{step_back(0x813E, 0x02):04X}"
    'FFFF'
    """
    row = _ROW_OF[after >> 8]
    return ((after ^ TABLE[row]) << 8 & 0xFF00) | (row ^ byte)


def forward(data: bytes) -> list[int]:
    """Return the remainder before each byte, and at the end.

    >>> [f"{remainder:04X}" for remainder in forward(bytes.fromhex("02074112"))]
    ['FFFF', '813E', '1241', '0012', '0000']
    """
    remainders = [INITIAL]
    for byte in data:
        remainders.append(step(remainders[-1], byte))
    return remainders


def backward(data: bytes) -> list[int]:
    """Return the remainder that each byte must find in order that the frame ends with 0.

    >>> [f"{remainder:04X}" for remainder in backward(bytes.fromhex("02074112"))]
    ['FFFF', '813E', '1241', '0012', '0000']
    """
    remainders = [0]
    for byte in reversed(data):
        remainders.append(step_back(remainders[-1], byte))
    return remainders[::-1]


def _between(before: int, after: int) -> int | None:
    """Return the byte that leads from one remainder to another, None if no byte does."""
    row = _ROW_OF[after >> 8]
    return row ^ (before & 0xFF) if before >> 8 == (after ^ TABLE[row]) & 0xFF else None


def extra_bytes(data: bytes) -> Iterator[CrcFit]:
    """Yield the frames without one of the bytes whose CRC fits.

    >>> [fit.at for fit in extra_bytes(bytes.fromhex("01 03 00 55 00 00 0A C5 CD"))]
    [3]
    """
    before, after = forward(data), backward(data)
    for at, byte in enumerate(data):
        if before[at] == after[at + 1]:
            yield CrcFit(at, byte, data[:at] + data[at + 1 :])


def lost_bytes(data: bytes) -> Iterator[CrcFit]:
    """Yield the frames with one byte more whose CRC fits. The same frame is yielded once.

    >>> [(fit.at, fit.byte) for fit in lost_bytes(bytes.fromhex("01 03 00 00 00 C5 CD"))]
    [(3, 24), (5, 10)]
    """
    before, after = forward(data), backward(data)
    seen = set()
    for at in range(len(data) + 1):
        byte = _between(before[at], after[at])
        if byte is not None and (frame := data[:at] + bytes((byte,)) + data[at:]) not in seen:
            seen.add(frame)
            yield CrcFit(at, byte, frame)


def changed_bytes(data: bytes) -> Iterator[CrcFit]:
    """Yield the frames with another value of one byte whose CRC fits; `byte` is the value that fits.

    >>> [(fit.at, fit.byte) for fit in changed_bytes(bytes.fromhex("01 03 00 40 00 0A C5 CD"))]
    [(3, 0)]
    """
    before, after = forward(data), backward(data)
    for at, was in enumerate(data):
        byte = _between(before[at], after[at + 1])
        if byte is not None and byte != was:
            yield CrcFit(at, byte, data[:at] + bytes((byte,)) + data[at + 1 :])
