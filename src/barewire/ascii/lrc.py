"""LRC of Modbus ASCII: the two's complement of the sum of the bytes, so that all bytes and the LRC sum to zero.

02 07  ->  F7                                                                       [MB-SERIAL 6.2.1]

The ADXL manual works an example, 01 04 00 00 08, and prints F5h. The arithmetic gives F3h: the sum is 0Dh and
100h - 0Dh is F3h. F5h is the LRC of 01 04 00 00 06.
"""

from __future__ import annotations


def lrc(data: bytes) -> int:
    """The LRC of the bytes; of the bytes that the characters encode, not of the characters.

    >>> f"{lrc(bytes.fromhex('0104000008')):02X}h"
    'F3h'
    """
    return -sum(data) & 0xFF
