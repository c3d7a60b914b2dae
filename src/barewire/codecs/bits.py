"""Bits and halves of words. Bit 0 is the least significant bit; coil 0 of a packed row is bit 0 of byte 0.

a register        15 14 13 12 11 10  9  8 | 7  6  5  4  3  2  1  0
                  '------- H half -------' '------- L half -------'

ten coils packed  byte 0: 7 6 5 4 3 2 1 0     byte 1: - - - - - - 9 8       [MB-APP 6.1]
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from barewire.errors import DecodeError, EncodeError

Half = Literal["L", "H"]


def _check_bit(bit: int, width: int) -> None:
    if not 0 <= bit < width:
        raise EncodeError(f"bit {bit} does not exist in {width} bits: expected 0..{width - 1}")


def get_bit(word: int, bit: int, width: int = 16) -> bool:
    """Return bit `bit` of a word.

    >>> get_bit(0x0004, 2)
    True
    """
    _check_bit(bit, width)
    return bool(word >> bit & 1)


def set_bit(word: int, bit: int, value: bool, width: int = 16) -> int:
    """Return the word with bit `bit` set to `value`; every other bit is kept.

    >>> hex(set_bit(0x00F0, 4, False))
    '0xe0'
    """
    _check_bit(bit, width)
    return word | 1 << bit if value else word & ~(1 << bit)


def get_field(word: int, low: int, bits: int, width: int = 16) -> int:
    """Return the number in `bits` bits of a word, from bit `low` upwards.

    >>> get_field(0x0B40, 6, 6)             # 0000 1011 01.. ....
    45
    """
    _check_field(low, bits, width)
    return word >> low & (1 << bits) - 1


def set_field(word: int, low: int, bits: int, value: int, width: int = 16) -> int:
    """Return the word with `value` in `bits` bits, from bit `low` upwards; every other bit is kept.

    >>> hex(set_field(0xFFFF, 4, 8, 0))
    '0xf00f'
    """
    _check_field(low, bits, width)
    if not 0 <= value < 1 << bits:
        raise EncodeError(f"{value} does not fit {bits} bits: expected 0..{(1 << bits) - 1}")
    mask = (1 << bits) - 1 << low
    return word & ~mask | value << low


def _check_field(low: int, bits: int, width: int) -> None:
    if bits < 1 or low < 0 or low + bits > width:
        raise EncodeError(f"bits {low}..{low + bits - 1} do not exist in {width} bits: expected 0..{width - 1}")


def get_half(word: int, half: Half) -> int:
    """Return the low or high byte of a register, 0..255.

    >>> hex(get_half(0x12AB, "H")), hex(get_half(0x12AB, "L"))
    ('0x12', '0xab')
    """
    if half == "L":
        return word & 0xFF
    if half == "H":
        return word >> 8 & 0xFF
    raise EncodeError(f"half {half!r}: expected L (low byte) or H (high byte)")


def set_half(word: int, half: Half, value: int) -> int:
    """Return the register with this half set to `value`; the other half is kept.

    >>> hex(set_half(0x12AB, "H", 0x34))
    '0x34ab'
    """
    if not 0 <= value <= 0xFF:
        raise EncodeError(f"{value} does not fit half a register: expected 0..255")
    if half == "L":
        return word & 0xFF00 | value
    if half == "H":
        return word & 0x00FF | value << 8
    raise EncodeError(f"half {half!r}: expected L (low byte) or H (high byte)")


def pack_bits(bits: Sequence[bool | int]) -> bytes:
    """Pack bits into bytes: the first bit is bit 0 of the first byte, the last byte is filled with zeros.

    >>> pack_bits([1, 0, 1, 1, 0, 0, 1, 1, 1, 0]).hex(" ")
    'cd 01'
    """
    number = 0
    for place, bit in enumerate(bits):
        if bit:
            number |= 1 << place
    return number.to_bytes((len(bits) + 7) // 8, "little")


def unpack_bits(data: bytes, quantity: int | None = None) -> tuple[bool, ...]:
    """Unpack bytes into bits: the first `quantity` bits, or all.

    >>> unpack_bits(bytes.fromhex("CD01"), 10)
    (True, False, True, True, False, False, True, True, True, False)

    Raises DecodeError("short") if the bytes hold fewer bits.
    """
    count = len(data) * 8 if quantity is None else quantity
    if count > len(data) * 8:
        raise DecodeError("short", data, len(data), f"{count} bits do not fit into {len(data)} bytes")
    number = int.from_bytes(data, "little")
    return tuple(bool(number >> place & 1) for place in range(count))
