"""The commands of the gateway: one frozen dataclass for each.   [CiA 309-3, commands]

        [1] 5 read 0x6041 0 u16       CommandLine(1, None, 5, ReadSdo(0x6041, 0, "u16"))

`parser` makes these values of a line, `session` executes them.

The error codes of the gateway, and the line that reports one.   [CiA 309-3, error codes]

        [7] ERROR:100 #no command "raed"              a command that the gateway does not support; 101 a syntax error
        [8] ERROR:0x06020000 #no such object          the node refused: the abort code of the SDO transfer
         |        |           |
         |        |           a comment for people; programs read up to the number sign
         |        code: three decimal digits, or eight hexadecimal ones
         the sequence number of the command

The codes 200 to 299 report the state of a node without a command, in lines such as "1 5 ERROR 203".
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, NamedTuple

from barewire.canopen.nmt.messages import NmtCommand
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


@dataclass(frozen=True, slots=True)
class ReadSdo:
    """`r[ead] index sub [type]`: an SDO upload."""

    index: int
    sub: int
    type: str = "hex"


@dataclass(frozen=True, slots=True)
class WriteSdo:
    """`w[rite] index sub type value`: an SDO download."""

    index: int
    sub: int
    data: bytes


@dataclass(frozen=True, slots=True)
class SendNmt:
    """`start`, `stop`, `preop[erational]`, `reset node`, `reset comm[unication]`: an NMT command."""

    command: NmtCommand


@dataclass(frozen=True, slots=True)
class SetOption:
    """`set network|node|sdo_timeout|sdo_block value`: a default for the commands that follow; `set heartbeat|id value`:
    the heartbeat time, in ms, and the next node-ID of the gateway's own node."""

    name: str
    value: int


@dataclass(frozen=True, slots=True)
class ConfigureGuarding:
    """`enable guarding time factor`, `disable guarding`: guard time in ms, 0 to disable it."""

    time: int
    factor: int


@dataclass(frozen=True, slots=True)
class ConfigureHeartbeat:
    """`enable heartbeat time`, `disable heartbeat`: consumer time in ms, 0 to disable it."""

    time: int


@dataclass(frozen=True, slots=True)
class EnableIndication:
    """`boot_up_indication Enable|Disable`; `_emcy_indication` and `_bus_indication` are extensions."""

    kind: Literal["boot_up", "emcy", "bus"]
    on: bool


@dataclass(frozen=True, slots=True)
class SetPdo:
    """`set rpdo|tpdo n cob type count (index sub type)*`; `tpdox` has inhibit time, event timer and SYNC start too.

    The gateway receives its RPDOs and sends its TPDOs.
    """

    send: bool
    number: int
    cob_id: int
    transmission: str
    types: tuple[str, ...]
    inhibit: int = 0
    timer: int = 0
    sync_start: int = 0


@dataclass(frozen=True, slots=True)
class ReadPdo:
    """`r[ead] p[do] n`: the last values of a received PDO."""

    number: int


@dataclass(frozen=True, slots=True)
class WritePdo:
    """`w[rite] p[do] n count value*`: the words, decoded later with the types of the PDO."""

    number: int
    words: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LssCommand:
    """`lss_...`: the name of the service and its numbers."""

    service: str
    numbers: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class InitGateway:
    """`init entry`: reset the communication of the gateway's own node. The entry of the bit rate table must be 9."""

    bit_rate: int


@dataclass(frozen=True, slots=True)
class ShowInfo:
    """`info version`, `help [lss|datatype]`: information about the gateway."""

    topic: str
    part: str = ""


GatewayCommand = (
    ReadSdo
    | WriteSdo
    | SendNmt
    | SetOption
    | ConfigureGuarding
    | ConfigureHeartbeat
    | EnableIndication
    | InitGateway
    | SetPdo
    | ReadPdo
    | WritePdo
    | LssCommand
    | ShowInfo
)


class CommandLine(NamedTuple):
    """A parsed line: its sequence number, net and node if they are given, and the command."""

    sequence: int
    net: int | None
    node: int | None
    command: GatewayCommand
