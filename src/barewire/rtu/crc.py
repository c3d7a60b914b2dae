"""CRC-16 of Modbus RTU: polynomial x^16 + x^15 + x^2 + 1, reflected, from FFFFh, low byte first on the wire.

    02 07  ->  1241h, sent as  41 12                                                [MB-SERIAL 6.2.2]

`crc16_bit_by_bit` is the definition, eight steps for each byte; `crc16` does the same eight at once with a table
of 256 remainders. They are equal for every input, and crcmod is the referee in the tests.
"""

from __future__ import annotations

POLYNOMIAL = 0xA001
"""8005h, the powers of x below x^16, with the bits mirrored since the least significant one is sent first."""

INITIAL = 0xFFFF


def crc16_bit_by_bit(data: bytes) -> int:
    """The definition: shift right; if a one fell out, subtract the polynomial.

    >>> f"{crc16_bit_by_bit(bytes.fromhex('0207')):04X}h"
    '1241h'
    """
    crc = INITIAL
    for byte in data:
        crc ^= byte
        for _ in range(8):
            fell_out = crc & 1
            crc >>= 1
            if fell_out:
                crc ^= POLYNOMIAL
    return crc


def _remainder(byte: int) -> int:
    """What eight steps make of a single byte."""
    for _ in range(8):
        byte = byte >> 1 ^ (POLYNOMIAL if byte & 1 else 0)
    return byte


TABLE = tuple(map(_remainder, range(256)))


def crc16(data: bytes | bytearray) -> int:
    """The CRC of the bytes as a number. On the wire its low byte goes first.

    >>> f"{crc16(bytes.fromhex('0207')):04X}h"
    '1241h'
    >>> crc16(b"123456789").to_bytes(2, "little").hex(" ").upper()
    '37 4B'
    >>> crc16(bytes.fromhex("02074112"))            # a frame with its own CRC leaves nothing
    0
    """
    crc = INITIAL
    table = TABLE
    for byte in data:
        crc = crc >> 8 ^ table[(crc ^ byte) & 0xFF]
    return crc
