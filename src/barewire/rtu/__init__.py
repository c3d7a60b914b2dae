"""ENVELOPE ended by silence or by count: Modbus RTU on a serial line.

    silence | unit 1 | PDU 1..253 | CRC 2, low byte first | silence                 [MB-SERIAL 2.5.1]
     t3.5                                                    t3.5

The names of the files are the same as in `barewire.ascii` and `barewire.tcp`; learn one envelope, know three:

    crc      the checksum           frame    encode and decode of one whole frame
    timing   character times        line     the framing state of one connection
    shape    what a count tells, and to whom

I know: where a frame begins and ends, and whether it is whole.  I never know: what a message means (only how long it
will be, which `modbus.functions` tells), sockets, ports, clocks.  Shells, devices' simulators and `explain` import me.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from barewire.rtu.crc import crc16
from barewire.rtu.frame import decode, encode
from barewire.rtu.timing import Timing, character_bits

if TYPE_CHECKING:
    from barewire.rtu.line import RtuLine


def __getattr__(name: str) -> Any:
    # The line counts bytes and needs the messages for that; whoever only checks frames need not load them.
    if name == "RtuLine":
        from barewire.rtu.line import RtuLine

        return RtuLine
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = ["crc16", "encode", "decode", "Timing", "character_bits", "RtuLine"]
