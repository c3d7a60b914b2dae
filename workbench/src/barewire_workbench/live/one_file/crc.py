"""CRC-16 of Modbus RTU: polynomial x^16 + x^15 + x^2 + 1, reflected, from FFFFh, low byte first on the wire.

    02 07  ->  1241h, sent as  41 12                                                [MB-SERIAL 6.2.2]

One step for each byte, with a table of 256 remainders. (barewire folds long frames, which is up to eight times faster.)
"""

from __future__ import annotations

POLYNOMIAL = 0xA001
"""8005h, the powers of x below x^16, with the bits mirrored because the least significant bit is sent first."""

INITIAL = 0xFFFF


def _remainder(byte: int) -> int:
    """Return the remainder of one byte after eight steps: a shift, and a subtraction if a 1 was shifted out."""
    for _ in range(8):
        byte = byte >> 1 ^ (POLYNOMIAL if byte & 1 else 0)
    return byte


TABLE = tuple(map(_remainder, range(256)))


def crc16(data: bytes | bytearray) -> int:
    """Return the CRC of the bytes as a number. On the wire its low byte goes first.

    >>> f"{crc16(bytes.fromhex('0207')):04X}h"
    '1241h'
    >>> crc16(bytes.fromhex("02074112"))            # the remainder of a frame with its own CRC is 0
    0
    """
    crc = INITIAL
    for byte in data:
        crc = crc >> 8 ^ TABLE[(crc ^ byte) & 0xFF]
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
