"""CRC-16 of Modbus RTU: polynomial x^16 + x^15 + x^2 + 1, reflected, from FFFFh, low byte first on the wire.

    02 07  ->  1241h, sent as  41 12                                                [MB-SERIAL 6.2.2]

Three forms of one function, equal for every input (the tests compare them with crcmod):

    crc16_bit_by_bit   the definition: eight steps for each byte
    crc16_table        the same eight steps at once: a table of 256 remainders, one step for each byte
    crc16_folded       the whole frame at once, as one big number folded onto itself; its steps grow with the logarithm

`crc16`, the one to call, uses the table for short frames and folds long ones.

**Why a frame folds.** Read the frame as a polynomial over the two-element field, the bit sent first as the highest
power. Its CRC is the remainder after division by x^16 + x^15 + x^2 + 1, and that polynomial is a product:

    x^16 + x^15 + x^2 + 1  =  (x + 1) (x^15 + x + 1)

The remainder by x + 1 is the parity of the bits. Modulo the other factor x^15 = x + 1, and in this field the square
of a sum is the sum of the squares, so x^30 = x^2 + 1, x^60 = x^4 + 1, ...: for every k = 1, 2, 4, 8, ...

    x^15k  =  x^k + 1

So the first 14k bits of a frame can be removed and added again further on, twice: once where the rest begins, and
once k places later. A frame of n bits becomes one of n - 14k bits with the same remainder:

    frame   [ first 14k bits | rest ............ ]
                                  rest
              +                   first 14k bits
              +                    first 14k bits        (k later)

With the largest k that fits, ten such folds reduce a frame of 254 bytes to 15 bits. Each fold is a handful of
operations on whole big numbers, where the table takes 254 steps. The low bit of the number is the bit sent first, so
"the first 14k bits" are a mask, and "remove" is a shift to the right.
"""

from __future__ import annotations

POLYNOMIAL = 0xA001
"""8005h, the powers of x below x^16, with the bits mirrored because the least significant bit is sent first. The table
follows from it; `crc16_folded` holds for this one only."""

INITIAL = 0xFFFF

FOLD_FROM = 27
"""Bytes: from here on folding is faster than the table, as measured by bench/test_crc.py with Python 3.11 to 3.13.
With the 16 zero bits behind it, a frame of 27 bytes is the first that a fold with k = 8 halves."""


def crc16(data: bytes | bytearray) -> int:
    """Return the CRC of the bytes as a number. On the wire its low byte goes first.

    >>> f"{crc16(bytes.fromhex('0207')):04X}h"
    '1241h'
    >>> crc16(b"123456789").to_bytes(2, "little").hex(" ").upper()
    '37 4B'
    >>> crc16(bytes.fromhex("02074112"))            # the remainder of a frame with its own CRC is 0
    0
    """
    if len(data) >= FOLD_FROM:
        return crc16_folded(data)
    # The loop of crc16_table, inlined: for a frame of eight bytes the call would take a tenth of the time.
    crc = INITIAL
    table = TABLE
    for byte in data:
        crc = crc >> 8 ^ table[(crc ^ byte) & 0xFF]
    return crc


def is_one_bit_off(frame: bytes | bytearray) -> bool:
    """Return whether one flipped bit makes a frame with a good CRC of these bytes.

    The remainder of a frame with one wrong bit depends on the place of the bit only, counted from the end.

    >>> is_one_bit_off(bytes.fromhex("0207 4113")), is_one_bit_off(bytes.fromhex("0207 4112"))
    (True, False)
    """
    remainder, of_bit = crc16(frame), POLYNOMIAL
    for _ in range(8 * len(frame)):
        if remainder == of_bit:
            return True
        of_bit = of_bit >> 1 ^ (POLYNOMIAL if of_bit & 1 else 0)
    return False


def crc16_bit_by_bit(data: bytes | bytearray) -> int:
    """Compute the CRC by its definition: shift right, and subtract the polynomial if the bit shifted out is 1.

    >>> f"{crc16_bit_by_bit(bytes.fromhex('0207')):04X}h"
    '1241h'
    """
    crc = INITIAL
    for byte in data:
        crc ^= byte
        for _ in range(8):
            shifted_out = crc & 1
            crc >>= 1
            if shifted_out:
                crc ^= POLYNOMIAL
    return crc


def _remainder(byte: int) -> int:
    """Return the remainder of one byte after eight steps."""
    for _ in range(8):
        byte = byte >> 1 ^ (POLYNOMIAL if byte & 1 else 0)
    return byte


TABLE = tuple(map(_remainder, range(256)))


def crc16_table(data: bytes | bytearray) -> int:
    """Compute the CRC with the table, one step for each byte.

    >>> f"{crc16_table(bytes.fromhex('0207')):04X}h"
    '1241h'
    """
    crc = INITIAL
    for byte in data:
        crc = crc >> 8 ^ TABLE[(crc ^ byte) & 0xFF]
    return crc


_BLOCK = 0x10000
"""Bytes folded at once. A longer input is folded block by block, so no number becomes larger than a block."""

# For k = 2^14 down to 1: fold while there are 29k bits or more (14k are removed, and 15k must be left to add them to).
_LEVELS = tuple((29 << j, 14 << j, 1 << j, (1 << (14 << j)) - 1) for j in range(14, -1, -1))

_TRINOMIAL = 0xC001
"""x^15 + x + 1 mirrored in 16 bits, which is added if the parity of the remainder differs from that of the frame."""


def crc16_folded(data: bytes | bytearray) -> int:
    """Compute the CRC of the whole frame at once.

    >>> f"{crc16_folded(bytes.fromhex('0207')):04X}h"
    '1241h'
    """
    crc = INITIAL
    for start in range(0, len(data), _BLOCK):
        crc = _fold(data[start : start + _BLOCK], crc)
    return crc


def _fold(data: bytes | bytearray, crc: int) -> int:
    """Fold one block; `crc` is the remainder of the blocks before it."""
    # The CRC is the remainder of the frame with 16 zero bits behind it; that of earlier blocks is added at the front.
    bits = 8 * len(data) + 16
    number = int.from_bytes(data, "little") ^ crc
    parity = number.bit_count()
    for enough, shift, k, mask in _LEVELS[15 - (bits // 29).bit_length() :]:
        while bits >= enough:
            first = number & mask
            number = number >> shift ^ first ^ first << k
            bits -= shift
    # Between 16 and 28 bits are left: fold once more with k = 1, and remove only the bits above 15.
    rest = bits - 15
    first = number & (1 << rest) - 1
    number = number >> rest ^ first << 14 - rest ^ first << 15 - rest
    # `number` is the remainder by x^15 + x + 1. That by (x + 1)(x^15 + x + 1) is the same, or has the trinomial added.
    wrong_parity = (parity ^ number.bit_count()) & 1
    return number << 1 ^ (_TRINOMIAL if wrong_parity else 0)
