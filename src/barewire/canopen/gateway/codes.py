"""The error codes of the gateway, and the line that reports one.   [CiA 309-3, error codes]

        [7] ERROR:100 #no command "raed"              a command that the gateway does not support; 101 a syntax error
        [8] ERROR:0x06020000 #no such object          the node refused: the abort code of the SDO transfer
         |        |           |
         |        |           a comment for people; programs read up to the number sign
         |        code: three decimal digits, or eight hexadecimal ones
         the sequence number of the command

The codes 200 to 299 report the state of a node without a command, in lines such as "1 5 ERROR 203".
"""

from __future__ import annotations

from enum import IntEnum

from barewire.errors import BarewireError


class GatewayCode(IntEnum):
    """The internal error codes that this gateway sends."""

    NOT_SUPPORTED = 100
    SYNTAX = 101
    INTERNAL_STATE = 102
    TIME_OUT = 103
    NO_DEFAULT_NET = 104
    NO_DEFAULT_NODE = 105
    UNSUPPORTED_NET = 106
    UNSUPPORTED_NODE = 107
    LOST_GUARDING_MESSAGE = 200
    LOST_CONNECTION = 201
    HEARTBEAT_STARTED = 202
    HEARTBEAT_LOST = 203
    WRONG_NMT_STATE = 204
    ERROR_PASSIVE = 300
    BUS_OFF = 301
    CAN_OVERFLOW = 303
    PDO_ALREADY_USED = 400
    PDO_LENGTH_EXCEEDED = 401
    LSS_ERROR = 501
    LSS_NODE_ID = 502
    LSS_BIT_RATE = 503
    LSS_STORING = 504
    LSS_MEDIA = 505
    OUT_OF_MEMORY = 600


class GatewayError(BarewireError):
    """The gateway cannot execute a command: the code, and a sentence for people."""

    def __init__(self, code: GatewayCode, text: str) -> None:
        super().__init__(text)
        self.code = code


def error_line(sequence: int, code: int, text: str) -> str:
    """Return the line that reports an error.

    >>> error_line(7, GatewayCode.NOT_SUPPORTED, 'no command "raed"'), error_line(8, 0x06020000, "no such object")
    ('[7] ERROR:100 #no command "raed"', '[8] ERROR:0x06020000 #no such object')
    """
    digits = str(int(code)) if code < 1000 else f"0x{code:08X}"
    return f"[{sequence}] ERROR:{digits} #{' '.join(text.split())}"
