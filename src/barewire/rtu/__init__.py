"""Modbus RTU framing on a serial line: silence or the byte count ends a frame, the CRC confirms it.

    silence | unit 1 | PDU 1..253 | CRC 2, low byte first | silence                 [MB-SERIAL 2.5.1]
     t3.5                                                    t3.5

    crc      the checksum                         frame    encode and decode one whole frame; character times
    shape    the length of a frame from its first bytes, by role
    line     the framing state of one line

`barewire.ascii` and `barewire.tcp` have files of the same names. The line needs the lengths of all messages; a program
that only encodes or decodes frames does not load them.
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.rtu.crc import crc16 as crc16
    from barewire.rtu.frame import (
        Timing as Timing,
        character_bits as character_bits,
        decode as decode,
        encode as encode,
    )
    from barewire.rtu.line import RtuLine as RtuLine

__getattr__, __dir__, __all__ = lazy(
    __name__,
    {"crc": "crc16", "frame": "encode decode Timing character_bits", "line": "RtuLine"},
)
