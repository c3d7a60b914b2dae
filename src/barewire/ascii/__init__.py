"""ENVELOPE ended by CR LF: Modbus ASCII on a serial line, every byte as two hexadecimal digits.

    : | unit | PDU 1..253 | LRC | CR LF                                              [MB-SERIAL 2.5.2]

    lrc    the checksum    frame      encode and decode of one whole frame
    line   the framing state of one connection             delimiter  what stands for LF where 08/03 said so

I know: where a frame begins and ends, and whether it is whole.  I never know: what a message means, sockets, ports,
clocks.  Shells, devices' simulators and `explain` import me.
"""

from barewire.ascii.frame import decode, encode
from barewire.ascii.line import AsciiLine
from barewire.ascii.lrc import lrc

__all__ = ["lrc", "encode", "decode", "AsciiLine"]
