"""ENVELOPE ended by a length: Modbus TCP, the MBAP header in front.

    transaction 2 | protocol 2 = 0 | length 2 | unit 1 | PDU 1..253                  [MB-TCP 3.1.3]

    frame    encode and decode of one whole frame     line    the framing state of one connection, or of datagrams
    fan_out  several questions under way on one connection

I know: where a frame begins and ends.  I never know: what a message means, sockets, clocks.  Shells, devices'
simulators and `explain` import me.
"""

from barewire.tcp.fan_out import FanOut
from barewire.tcp.frame import decode, encode
from barewire.tcp.line import DatagramLine, TcpLine

__all__ = ["encode", "decode", "TcpLine", "DatagramLine", "FanOut"]
