"""Modbus TCP framing: an MBAP header with a length precedes the PDU.

The files, in reading order:

    transaction 2 | protocol 2 = 0 | length 2 | unit 1 | PDU 1..253                  [MB-TCP 3.1.3]

    frame     encode and decode one whole frame
    line      the framing state of one connection, or of datagrams
    fan_out   several requests in flight on one connection
"""

from barewire.tcp.fan_out import FanOut
from barewire.tcp.frame import decode, encode
from barewire.tcp.line import DatagramLine, TcpLine

__all__ = ["encode", "decode", "TcpLine", "DatagramLine", "FanOut"]
