"""One connection to the gateway: its settings, and the execution of its lines.   [CiA 309-3]

        line                          conversation on the bus                   answer
        [1] 5 r 0x6041 0 u16     ->   605h 40 41 60 00 ... 585h 4B ...     ->   [1] 1591
        [2] 5 start              ->   000h 01 05                           ->   [2] OK
        [3] 5 r 0x6999 0         ->   605h ...  585h 80 ... 06020000h      ->   [3] ERROR:0x06020000 #...

`answer` is a conversation. The caller also feeds every frame to `notices`. The lines of one connection are executed one
after the other, in their order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.frame import CanFrame
from barewire.canopen.gateway.commands import (
    CommandLine,
    ConfigureGuarding,
    ConfigureHeartbeat,
    EnableIndication,
    GatewayCode,
    GatewayCommand,
    GatewayError,
    InitGateway,
    LssCommand,
    ReadPdo,
    ReadSdo,
    SendNmt,
    SetOption,
    SetPdo,
    ShowInfo,
    WritePdo,
    WriteSdo,
    error_line,
)
from barewire.canopen.gateway.lss_commands import lss_error_code, run_lss
from barewire.canopen.gateway.notices import Notices
from barewire.canopen.gateway.own_node import GatewayNode
from barewire.canopen.gateway.parser import parse_line, sequence_of
from barewire.canopen.gateway.values import is_wrong_length, to_text
from barewire.canopen.lss.messages import LssRefused
from barewire.canopen.nmt.messages import NmtCommand, NmtMessage
from barewire.canopen.sdo.client.channel import Channel
from barewire.canopen.sdo.client.download import download
from barewire.canopen.sdo.client.upload import upload
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.conversation import Conversation, Heard, Listen, Send
from barewire.errors import DecodeError, EncodeError, NoAnswer

_ChannelOf: TypeAlias = Callable[[int], Channel]

_SDO_TIMEOUT = 0.5  # seconds, until `set sdo_timeout`
MAX_LINE = 65_536
"""Bytes of the longest line: room for a domain of some 48 KiB."""

_BIT_RATE_UNCHANGED = 9
"""The entry of CiA 305's bit rate table that is no bit rate: "automatic"."""

_HELP = """\
[seq] [[net] node] r[ead] index sub [type]            SDO upload
[seq] [[net] node] w[rite] index sub type value       SDO download
[seq] [[net] node] start | stop | preop[erational] | reset node | reset comm[unication]
[seq] [[net] node] enable guarding time_ms factor | disable guarding | enable heartbeat time_ms | disable heartbeat
[seq] [net] set node n | set sdo_timeout ms | set sdo_block 0|1 ; [seq] set network n
[seq] [net] set rpdo|tpdo n cob event|rtr|sync0..240 count (index sub type)...
[seq] [net] set tpdox n cob type inhibit timer sync_start count (index sub type)...
[seq] [net] r[ead] p[do] n | w[rite] p[do] n count value...
[seq] [net] boot_up_indication enable|disable | _emcy_indication enable|disable | _bus_indication enable|disable
[seq] [net] set heartbeat ms | set id n | init 9      with --node-id: the node of the gateway itself
[seq] [net] lss_switch_glob 0|1 | lss_switch_sel vendor product revision serial | lss_set_node n | lss_get_node
[seq] [net] lss_conf_bitrate table index | lss_activate_bitrate delay_ms | lss_store | lss_inquire_addr [0..3]
[seq] [net] lss_identity vendor product rev_low rev_high serial_low serial_high | lss_ident_nonconf
[seq] [net] _lss_fastscan [timeout_ms] | lss_allnodes [timeout_ms [first_node store [scan_type number]x4]]
[seq] info version | help [lss|datatype]
types: b i8..i64 u8..u64 x8..x64 r32 r64 vs os us d t td hex;  # begins a comment"""


class _WrongType(Exception):
    """The value that a node returned is not of the requested type."""

    def __init__(self, code: AbortCode, text: str) -> None:
        super().__init__(text)
        self.code = code
        self.text = text


class GatewaySession:
    """The settings of one connection, and the execution of its lines.

        net            the number of the net that the gateway serves
        version        the answer to `info version`
        dialect        the SDO dialect of the nodes
        channel        returns the SDO channel to a node, for connections that share a bus; default: channels of its own
        remote         whether the bus carries remote frames, which node guarding needs
        indications    report boot-ups, emergencies and bus errors from the start
        own            the gateway's own node, if it is one

    >>> from barewire.conversation import play
    >>> node = lambda frame, now: [(now + 0.001, CanFrame.parse("585#4B41600037060000"))]
    >>> play(GatewaySession().answer("[1] 5 read 0x6041 0 x16"), node)[0]
    ['[1] 0x0637']
    """

    def __init__(
        self,
        net: int = 1,
        *,
        version: str = "",
        dialect: SdoDialect = STANDARD,
        channel: _ChannelOf | None = None,
        remote: bool = True,
        indications: bool = False,
        own: GatewayNode | None = None,
    ) -> None:
        self.net = net
        self.own = own
        self._remote = remote
        self.notices = Notices(net, indications=indications)
        self._version = version
        self._channels: dict[int, Channel] = {}
        self._channel_of = channel or (lambda node: self._channels.setdefault(node, Channel(node, dialect)))
        self._default_net: int | None = net
        self._default_node: int | None = None
        self._timeout = _SDO_TIMEOUT
        self._block = False

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: net {self.net}>"

    def answer(self, text: str) -> Conversation[CanFrame, list[str]]:
        """Execute one line. Return the lines of the answer: none for an empty line or a comment. Never raises.

        A line whose `target` is "own" must be carried out by `own.carry_out`.
        """
        if not text.partition("#")[0].strip():
            return []
        sequence = 0
        try:
            if len(text) > MAX_LINE:
                raise GatewayError(GatewayCode.OUT_OF_MEMORY, f"a line of more than {MAX_LINE} bytes")
            sequence = sequence_of(text)[0]
            line = parse_line(text)
            answer = yield from self._execute(line)
        except GatewayError as error:
            return [error_line(sequence, error.code, str(error))]
        except _WrongType as error:
            return [error_line(sequence, error.code, error.text)]
        except SdoAbort as error:
            return [error_line(sequence, error.code, str(error))]
        except LssRefused as error:
            return [error_line(sequence, lss_error_code(error), str(error))]
        except NoAnswer as error:
            code = AbortCode.TIMED_OUT if isinstance(line.command, (ReadSdo, WriteSdo)) else GatewayCode.TIME_OUT
            return [error_line(sequence, code, str(error))]
        except EncodeError as error:
            return [error_line(sequence, GatewayCode.SYNTAX, str(error))]
        *comments, last = answer.split("\n")
        return [*comments, f"[{sequence}] {last}"]

    def target(self, text: str) -> Channel | Literal["LSS", "own"] | None:
        """Return what a line needs for itself: an SDO channel, LSS, the gateway's own node, or nothing."""
        try:
            line = parse_line(text)
            if isinstance(line.command, (ReadSdo, WriteSdo)):
                node = self._node(line.node)
                return "own" if self._is_own(node) else self._channel_of(node)
        except GatewayError:
            return None
        if self.own is not None and _is_for_own_node(line.command):
            return "own"
        return "LSS" if isinstance(line.command, LssCommand) else None

    def _is_own(self, node: int) -> bool:
        return self.own is not None and self.own.device.node == node

    def _execute(self, line: CommandLine) -> Conversation[CanFrame, str]:
        command = line.command
        if isinstance(command, ShowInfo):
            return _help(command.part) if command.topic == "help" else self._version or "barewire"
        if not (isinstance(command, SetOption) and command.name == "network"):
            self._check_net(line.net)
        if _is_for_own_node(command):
            return (yield from self._own_node(command))
        if isinstance(command, SetOption):
            return self._set(command)
        if isinstance(command, (ReadSdo, WriteSdo)):
            return (yield from self._sdo_transfer(self._node(line.node), command))
        if isinstance(command, SendNmt):
            yield Send(NmtMessage(command.command, self._node(line.node, all_too=True)).encode())
            return "OK"
        if isinstance(command, LssCommand):
            return (yield from run_lss(command))
        return (yield from self._control(line, command))

    def _check_net(self, net: int | None) -> None:
        wanted = self._default_net if net is None else net
        if wanted is None:
            raise GatewayError(GatewayCode.NO_DEFAULT_NET, "no net given, and no default: set network n")
        if wanted != self.net:
            raise GatewayError(GatewayCode.UNSUPPORTED_NET, f"net {wanted}: this gateway has net {self.net}")

    def _node(self, node: int | None, *, all_too: bool = False) -> int:
        wanted = self._default_node if node is None else node
        if wanted is None:
            raise GatewayError(GatewayCode.NO_DEFAULT_NODE, "no node given, and no default: set node n")
        if not (0 if all_too else 1) <= wanted <= 127:
            low = "0 for all, or " if all_too else ""
            raise GatewayError(GatewayCode.UNSUPPORTED_NODE, f"node {wanted}: expected {low}1..127")
        return wanted

    def _set(self, command: SetOption) -> str:
        value = command.value
        if command.name == "network":
            if value not in (0, self.net):
                raise GatewayError(GatewayCode.UNSUPPORTED_NET, f"net {value}: this gateway has net {self.net}")
            self._default_net = value or None
        elif command.name == "node":
            self._default_node = value or None
        elif command.name == "sdo_timeout":
            self._timeout = value / 1000
        else:
            self._block = bool(value)
        return "OK"

    def _own_node(self, command: GatewayCommand) -> Conversation[CanFrame, str]:
        """Change the gateway's own node."""
        own = self.own
        if own is None:
            text = "this gateway is not a node itself; barewire canopen-gateway --node-id N makes it one"
            raise GatewayError(GatewayCode.NOT_SUPPORTED, text)
        if isinstance(command, SetOption) and command.name == "id":
            own.next_id = command.value
        elif isinstance(command, SetOption):
            own.set_heartbeat(command.value)
        elif isinstance(command, InitGateway):
            if command.bit_rate != _BIT_RATE_UNCHANGED:
                text = f"init {command.bit_rate}: the bit rate is that of the open interface; init 9 leaves it as it is"
                raise GatewayError(GatewayCode.NOT_SUPPORTED, text)
            yield Send(NmtMessage(NmtCommand.RESET_COMMUNICATION, own.device.node or 0).encode())
        return "OK"

    def _sdo_transfer(self, node: int, command: ReadSdo | WriteSdo) -> Conversation[CanFrame, str]:
        channel = Channel(node) if self._is_own(node) else self._channel_of(node)
        if isinstance(command, WriteSdo):
            block = self._block and len(command.data) > 4
            yield from download(channel, command.index, command.sub, command.data, timeout=self._timeout, block=block)
            return "OK"
        data = yield from upload(channel, command.index, command.sub, timeout=self._timeout, block=self._block)
        try:
            return to_text(command.type, data)
        except DecodeError as error:
            code = AbortCode.LENGTH if is_wrong_length(error) else AbortCode.INVALID_VALUE
            raise _WrongType(
                code, f"{command.index:04X}h:{command.sub:02X}: {error.text}: {data[:16].hex(' ')}"
            ) from None

    def _control(
        self,
        line: CommandLine,
        command: GatewayCommand,
    ) -> Conversation[CanFrame, str]:
        notices = self.notices
        if isinstance(command, EnableIndication):
            notices.enabled[command.kind] = command.on
        elif isinstance(command, ConfigureHeartbeat):
            notices.heartbeat(self._node(line.node), command.time / 1000)
        elif isinstance(command, ConfigureGuarding):
            if command.time and not self._remote:
                text = "this bus carries no remote frames: use enable heartbeat instead"
                raise GatewayError(GatewayCode.NOT_SUPPORTED, text)
            now = yield from _time()
            notices.guard(self._node(line.node), command.time / 1000, command.factor, now)
        elif isinstance(command, SetPdo):
            notices.set_pdo(command)
        elif isinstance(command, ReadPdo):
            pdo = notices.pdo(False, command.number)
            return f"{self.net} pdo {command.number} {pdo.text()}"
        elif isinstance(command, WritePdo):
            notices.pdo(True, command.number).write(command.words)
            for frame in notices.pdo(True, command.number).feed(None, (yield from _time())):
                yield Send(frame)
        return "OK"


def _is_for_own_node(command: GatewayCommand) -> bool:
    """Return whether a command concerns the gateway's own node."""
    return isinstance(command, InitGateway) or (isinstance(command, SetOption) and command.name in ("heartbeat", "id"))


def _help(part: str) -> str:
    """Return the help, or its lines about LSS or the data types, and OK."""
    lines = _HELP.split("\n")
    if part == "lss":
        lines = [line for line in lines if "lss_" in line]
    elif part == "datatype":
        lines = lines[-1:]
    return "\n".join([*lines, "OK"])


def _time() -> Conversation[CanFrame, float]:
    """Return the present time without waiting. A frame received with it is left to the notices."""
    heard: Heard[CanFrame] = yield Listen(float("-inf"))
    return heard.now
