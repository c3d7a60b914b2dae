"""Modbus RTU framing on a serial line: silence or the byte count ends a frame, the CRC confirms it.

    silence | unit 1 | PDU 1..253 | CRC 2, low byte first | silence                 [MB-SERIAL 2.5.1]
     t3.5                                                    t3.5

    crc      the checksum                         frame    encode and decode one whole frame
    timing   character times                      line     the framing state of one line
    shape    the length of a frame from its first bytes, by role

`barewire.ascii` and `barewire.tcp` have files of the same names.

Depends on: errors, modbus.adu, modbus.framing, modbus.messages (lengths only). Used by: explain, io.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from barewire.rtu.crc import crc16
from barewire.rtu.frame import decode, encode
from barewire.rtu.timing import Timing, character_bits

if TYPE_CHECKING:
    from barewire.rtu.line import RtuLine


def __getattr__(name: str) -> Any:
    # The line needs the lengths of all messages; a program that only encodes or decodes frames does not load them.
    if name == "RtuLine":
        from barewire.rtu.line import RtuLine

        return RtuLine
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = ["crc16", "encode", "decode", "Timing", "character_bits", "RtuLine"]
