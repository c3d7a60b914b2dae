"""Modbus ASCII framing on a serial line: every byte as two hexadecimal digits, CR LF ends a frame.

The files, in reading order:

    : | unit | PDU 1..253 | LRC | CR LF                                              [MB-SERIAL 2.5.2]

    frame      encode and decode one whole frame, and its checksum, the LRC
    line       the framing state of one line, and the character that replaces LF after function 08/03
"""

from barewire.ascii.frame import decode, encode, lrc
from barewire.ascii.line import AsciiLine

__all__ = ["lrc", "encode", "decode", "AsciiLine"]
