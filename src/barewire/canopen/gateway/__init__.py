"""The text gateway: a CANopen net in lines of text, for netcat and scripts.   [CiA 309-3]

        people and scripts                   the gateway                          the bus
        [1] 5 read 0x6041 0 u16      ->      parse, ask                   ->      605h | 40 41 60 00 ...
        [1] 1591                     <-      read the answer, tell        <-      585h | 4B 41 60 00 37 06 ...
        1 5 BOOT_UP                  <-      tell by itself               <-      705h | 00

    words, requests, commands    one line, taken apart           values         words <-> bytes
    session                      a line carried out              lss_commands   the LSS ones
    notices, pdos                what is told unasked            codes          the numbers of what goes wrong

The syntax and the numbers are those of CiA 309-3; that text is not public, so they are taken from two open gateways
that follow it. What both leave open is said where it is decided: unsigned numbers are told in decimal (`x16` for
hexadecimal), a read without a type tells the bytes.

I know: lines, one net.  I never know: sockets, how many connections there are, time except as a number.
Who may import me: shells, cli, tests.
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.canopen.gateway.codes import GatewayCode as GatewayCode, GatewayError as GatewayError
    from barewire.canopen.gateway.notices import Notices as Notices
    from barewire.canopen.gateway.session import GatewaySession as GatewaySession

__getattr__, __all__ = lazy(
    __name__,
    {
        "codes": "GatewayCode GatewayError",
        "notices": "Notices",
        "session": "GatewaySession",
    },
)
