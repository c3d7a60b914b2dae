"""The order of the bytes of a number, and how they fill registers.

A register holds two bytes, the more significant one first [MB-APP 4.2]. Modbus does not define how a wider number
fills registers, so four orders are in use. With A the most significant byte:

              register n   register n+1
    ABCD        A  B          C  D        high word first, the usual reading
    CDAB        C  D          A  B        low word first, bytes in a register still A B
    BADC        B  A          D  C        high word first, bytes swapped in each register
    DCBA        D  C          B  A        everything reversed: a little-endian number, as CANopen has it

The names apply to any width: for 64 bits CDAB means GHEFCDAB, for 16 bits there is only AB or BA, and a single byte
has no order.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from operator import index
from typing import Literal

from barewire.errors import EncodeError

Order = Literal["ABCD", "CDAB", "BADC", "DCBA"]

ORDERS: tuple[Order, ...] = ("ABCD", "CDAB", "BADC", "DCBA")


def _swap_bytes(data: bytes) -> bytes:
    """Swap the two bytes of each register: AB CD -> BA DC."""
    swapped = bytearray(data)
    swapped[0::2], swapped[1::2] = data[1::2], data[0::2]
    return bytes(swapped)


def reorder(data: bytes, order: Order) -> bytes:
    """Convert big-endian bytes to `order`, or back: each of the four conversions is its own inverse.

    >>> reorder(bytes.fromhex("0A0B0C0D"), "CDAB").hex(" ").upper()
    '0C 0D 0A 0B'
    >>> reorder(bytes.fromhex("0A0B0C0D"), "BADC").hex(" ").upper()
    '0B 0A 0D 0C'

    Raises EncodeError for an unknown order, and for an odd number of bytes in order CDAB or BADC.
    """
    if order == "ABCD":
        return bytes(data)
    if order == "DCBA":
        return data[::-1]
    if order not in ORDERS:
        raise EncodeError(f"byte order {order!r}: expected one of {', '.join(ORDERS)}")
    if len(data) == 1:
        return bytes(data)
    if len(data) % 2:
        raise EncodeError(f"{len(data)} bytes do not fill registers of 2 bytes, so they have no order {order}")
    return _swap_bytes(data if order == "BADC" else data[::-1])


def to_registers(data: bytes) -> tuple[int, ...]:
    """Convert bytes to register values. Raises EncodeError for an odd number of bytes.

    >>> to_registers(bytes.fromhex("000A0102"))
    (10, 258)
    """
    if len(data) % 2:
        raise EncodeError(f"{len(data)} bytes do not fill registers of 2 bytes")
    return struct.unpack(f">{len(data) // 2}H", data)


def is_whole(value: object, low: int, high: int) -> bool:
    """Whether this is a whole number in low..high, of `int` or of another type that can be an index, as in numpy.

    >>> is_whole(3, 0, 7), is_whole(3.0, 0, 7), is_whole(8, 0, 7)
    (True, False, False)
    """
    try:
        return low <= index(value) <= high  # type: ignore[arg-type]  # a TypeError is the answer
    except TypeError:
        return False


def from_registers(registers: Sequence[int]) -> bytes:
    """Convert register values to bytes, two for each. Raises EncodeError for a value outside 0..65535.

    >>> from_registers([10, 258]).hex(" ")
    '00 0a 01 02'
    """
    try:
        return struct.pack(f">{len(registers)}H", *registers)
    except (struct.error, TypeError):
        for place, value in enumerate(registers):
            if not is_whole(value, 0, 0xFFFF):
                raise EncodeError(
                    f"register {place} of {len(registers)}: {value!r} is not a whole number in 0..65535"
                ) from None
        raise
