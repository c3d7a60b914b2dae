"""One connection to the gateway: its settings, and the execution of its lines.   [CiA 309-3]

        line                          conversation on the bus                   answer
        [1] 5 r 0x6041 0 u16     ->   605h 40 41 60 00 ... 585h 4B ...     ->   [1] 1591
        [2] 5 start              ->   000h 01 05                           ->   [2] OK
        [3] 5 r 0x6999 0         ->   605h ...  585h 80 ... 06020000h      ->   [3] ERROR:0x06020000 #...

`COMMANDS` has a row for each command: its words, whom it is for, its arguments, and the method that executes it.
The help, parsing and execution are derived from it.

`answer` is a conversation. The caller also feeds every frame to `notices`. The lines of one connection are executed one
after the other, in their order.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from functools import partial
from typing import Any, Literal, NamedTuple

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.master import store_configuration
from barewire.canopen.lss.messages import LssRefused
from barewire.canopen.nmt.messages import NmtCommand, NmtMessage
from barewire.canopen.pdo.mapping import BITS_MAX
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.client import download, upload
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.conversation import Conversation, Heard, Listen, Send
from barewire.errors import DecodeError, EncodeError, NoAnswer, shown
from barewire_workbench.ascii_gateway import lss_commands as lss
from barewire_workbench.ascii_gateway.lines import (
    GatewayCode,
    GatewayError,
    Words,
    error_line,
    from_text,
    sequence_of,
    split_line,
    to_text,
    width,
)
from barewire_workbench.ascii_gateway.notices import EVENT, RTR, Notices, PdoSettings
from barewire_workbench.ascii_gateway.own_node import GatewayNode

_SDO_TIMEOUT = 0.5  # seconds, until `set sdo_timeout`
MAX_LINE = 65_536
"""Bytes of the longest line: room for a domain of some 48 KiB."""

_BIT_RATE_UNCHANGED = 9
"""The entry of CiA 305's bit rate table that is no bit rate: "automatic"."""


class Command(NamedTuple):
    """A row of the table of commands.

    to          gateway: the gateway itself    own: its own node on the bus    net: the net    lss: LSS devices
                node: a node                   nodes: a node or all of them    sdo: the SDO server of a node
    arguments   their names, as in the help; those in brackets may be missing. `_LIMITS` and `_READERS` say what each is
    run         a method of the session, or for LSS a function; called with the node, if any, and the arguments.
                It executes the command, or returns a conversation that does. The answer is the text it returns, or OK.
    help        a remark for the help
    """

    to: Literal["gateway", "own", "net", "lss", "node", "nodes", "sdo"]
    arguments: str
    run: Callable[..., object]
    help: str = ""


class CommandLine(NamedTuple):
    """A parsed line: its sequence number, net and node if they are given, the command and its arguments."""

    sequence: int
    net: int | None
    node: int | None
    command: str
    arguments: list[Any]


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
        channel: Callable[[int], Channel] | None = None,
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
        except (GatewayError, SdoAbort) as error:
            return [error_line(sequence, error.code, str(error))]
        except LssRefused as error:
            return [error_line(sequence, lss.error_code(error), str(error))]
        except NoAnswer as error:
            code = AbortCode.TIMED_OUT if COMMANDS[line.command].to == "sdo" else GatewayCode.TIME_OUT
            return [error_line(sequence, code, str(error))]
        except EncodeError as error:
            return [error_line(sequence, GatewayCode.SYNTAX, str(error))]
        *comments, last = answer.split("\n")
        return [*comments, f"[{sequence}] {last}"]

    def target(self, text: str) -> Channel | Literal["LSS", "own"] | None:
        """Return what a line needs for itself: an SDO channel, LSS, the gateway's own node, or nothing."""
        try:
            line = parse_line(text)
            to = COMMANDS[line.command].to
            if to == "sdo":
                node = self._node(line.node)
                return "own" if self._is_own(node) else self._channel_of(node)
        except GatewayError:
            return None
        if to == "own" and self.own is not None:
            return "own"
        return "LSS" if to == "lss" else None

    def _execute(self, line: CommandLine) -> Conversation[CanFrame, str]:
        command = COMMANDS[line.command]
        arguments = line.arguments
        if command.to != "gateway":
            self._check_net(line.net)
        if command.to in ("node", "nodes", "sdo"):
            arguments = [self._node(line.node, all_too=command.to == "nodes"), *arguments]
        result = command.run(*arguments) if command.to == "lss" else command.run(self, *arguments)
        if isinstance(result, Generator):
            result = yield from result
        return result if isinstance(result, str) else "OK"

    def _check_net(self, given: int | None) -> None:
        net = self._default_net if given is None else given
        if net is None:
            raise GatewayError(GatewayCode.NO_DEFAULT_NET, "no net given, and no default: set network n")
        if net != self.net:
            raise GatewayError(GatewayCode.UNSUPPORTED_NET, f"net {net}: this gateway has net {self.net}")

    def _node(self, given: int | None, *, all_too: bool = False) -> int:
        node = self._default_node if given is None else given
        if node is None:
            raise GatewayError(GatewayCode.NO_DEFAULT_NODE, "no node given, and no default: set node n")
        if not (0 if all_too else 1) <= node <= 127:
            low = "0 for all, or " if all_too else ""
            raise GatewayError(GatewayCode.UNSUPPORTED_NODE, f"node {node}: expected {low}1..127")
        return node

    # Settings and information

    def _set_network(self, net: int) -> None:
        if net not in (0, self.net):
            raise GatewayError(GatewayCode.UNSUPPORTED_NET, f"net {net}: this gateway has net {self.net}")
        self._default_net = net or None

    def _set_node(self, node: int) -> None:
        self._default_node = node or None

    def _set_timeout(self, milliseconds: int) -> None:
        self._timeout = milliseconds / 1000

    def _set_block(self, block: int) -> None:
        self._block = bool(block)

    def _enable_indication(self, on: bool, *, kind: Literal["boot_up", "emcy", "bus"]) -> None:
        self.notices.enabled[kind] = on

    def _info_version(self) -> str:
        return self._version or "barewire"

    def _help(self, part: str = "") -> str:
        lines = {"lss": [line for line in _help_lines() if "lss_" in line], "datatype": [_TYPES]}
        return "\n".join([*lines.get(part, [*_help_lines(), _TYPES]), "OK"])

    # SDO and NMT

    def _read(self, node: int, index: int, sub: int, type: str = "hex") -> Conversation[CanFrame, str]:
        channel = self._channel(node)
        data = yield from upload(channel, index, sub, timeout=self._timeout, block=self._block)
        try:
            return to_text(type, data)
        except DecodeError as error:
            # Only an object of another size than the type has an abort code of its own.
            code = AbortCode.LENGTH if error.reason in ("short", "long") else AbortCode.INVALID_VALUE
            text = f"{index:04X}h:{sub:02X}: {error.text}: {data[:16].hex(' ')}"
            raise GatewayError(code, text) from None

    def _write(self, node: int, index: int, sub: int, type: str, words: list[str]) -> Conversation[CanFrame, None]:
        data = from_text(type, words)
        block = self._block and len(data) > 4  # an expedited transfer takes 4 bytes
        yield from download(self._channel(node), index, sub, data, timeout=self._timeout, block=block)

    def _channel(self, node: int) -> Channel:
        return Channel(node) if self._is_own(node) else self._channel_of(node)

    def _is_own(self, node: int) -> bool:
        return self.own is not None and self.own.device.node == node

    def _nmt(self, node: int, *, command: NmtCommand) -> Conversation[CanFrame, None]:
        yield Send(NmtMessage(command, node).encode())

    # Error control

    def _enable_guarding(self, node: int, milliseconds: int, factor: int) -> Conversation[CanFrame, None]:
        if not self._remote:
            text = "this bus carries no remote frames: use enable heartbeat instead"
            raise GatewayError(GatewayCode.NOT_SUPPORTED, text)
        self.notices.guard(node, milliseconds / 1000, factor, (yield from _time()))

    def _disable_guarding(self, node: int) -> Conversation[CanFrame, None]:
        self.notices.guard(node, 0, 0, (yield from _time()))

    def _set_consumer_time(self, node: int, milliseconds: int = 0) -> None:
        self.notices.heartbeat(node, milliseconds / 1000)

    # PDOs

    def _set_pdo(self, number: int, cob_id: int, transmission: int, *more: Any, send: bool) -> None:
        *times, types = more  # `tpdox` has three times before the objects, the other two have none
        self.notices.set_pdo(PdoSettings(send, number, cob_id, transmission, types, *times))

    def _read_pdo(self, number: int) -> str:
        return f"{self.net} pdo {number} {self.notices.pdo(number, send=False).text()}"

    def _write_pdo(self, number: int, words: list[str]) -> Conversation[CanFrame, None]:
        pdo = self.notices.pdo(number, send=True)
        pdo.write(words)
        for frame in pdo.feed(None, (yield from _time())):
            yield Send(frame)

    # The gateway's own node

    def _own_node(self) -> GatewayNode:
        if self.own is None:
            text = "this gateway is not a node itself; barewire canopen-gateway --node-id N makes it one"
            raise GatewayError(GatewayCode.NOT_SUPPORTED, text)
        return self.own

    def _set_heartbeat(self, milliseconds: int) -> None:
        self._own_node().set_heartbeat(milliseconds)

    def _set_id(self, node: int) -> None:
        self._own_node().next_id = node

    def _init(self, bit_rate: int) -> Conversation[CanFrame, None]:
        own = self._own_node()
        if bit_rate != _BIT_RATE_UNCHANGED:
            text = f"init {bit_rate}: the bit rate is that of the open interface; init 9 leaves it as it is"
            raise GatewayError(GatewayCode.NOT_SUPPORTED, text)
        yield Send(NmtMessage(NmtCommand.RESET_COMMUNICATION, own.device.node or 0).encode())


def _time() -> Conversation[CanFrame, float]:
    """Return the present time without waiting. A frame received with it is left to the notices."""
    heard: Heard[CanFrame] = yield Listen(float("-inf"))
    return heard.now


# The table of commands ---------------------------------------------------------------------------------------------

_Session = GatewaySession


def _nmt(command: NmtCommand) -> Command:
    return Command("nodes", "", partial(_Session._nmt, command=command), "NMT; node 0: all nodes")


def _pdo(arguments: str, *, send: bool) -> Command:
    return Command("net", arguments, partial(_Session._set_pdo, send=send), "no objects: remove it")


def _indication(kind: Literal["boot_up", "emcy", "bus"], what: str) -> Command:
    return Command("net", "enable|disable", partial(_Session._enable_indication, kind=kind), f"report {what}")


COMMANDS: dict[str, Command] = {
    "read": Command("sdo", "index sub [type]", _Session._read, "SDO upload"),
    "write": Command("sdo", "index sub type value...", _Session._write, "SDO download"),
    "start": _nmt(NmtCommand.START),
    "stop": _nmt(NmtCommand.STOP),
    "preoperational": _nmt(NmtCommand.ENTER_PRE_OPERATIONAL),
    "reset node": _nmt(NmtCommand.RESET_NODE),
    "reset communication": _nmt(NmtCommand.RESET_COMMUNICATION),
    "enable guarding": Command("node", "time_ms factor", _Session._enable_guarding, "report when it becomes silent"),
    "disable guarding": Command("node", "", _Session._disable_guarding),
    "enable heartbeat": Command("node", "time_ms", _Session._set_consumer_time, "report when it becomes silent"),
    "disable heartbeat": Command("node", "", _Session._set_consumer_time),
    "set network": Command("gateway", "net", _Session._set_network, "default net, 0: none"),
    "set node": Command("net", "node", _Session._set_node, "default node, 0: none"),
    "set sdo_timeout": Command("net", "timeout_ms", _Session._set_timeout),
    "set sdo_block": Command("net", "0|1", _Session._set_block, "1: block transfers"),
    "set rpdo": _pdo("number cob_id transmission objects...", send=False),
    "set tpdo": _pdo("number cob_id transmission objects...", send=True),
    "set tpdox": _pdo("number cob_id transmission inhibit_100us timer_ms sync_start objects...", send=True),
    "read pdo": Command("net", "number", _Session._read_pdo, "the values received last"),
    "write pdo": Command("net", "number values...", _Session._write_pdo, "send a tpdo"),
    "boot_up_indication": _indication("boot_up", "boot-ups"),
    "_emcy_indication": _indication("emcy", "emergencies"),
    "_bus_indication": _indication("bus", "errors of the CAN controller"),
    "set heartbeat": Command("own", "interval_ms", _Session._set_heartbeat, "of the gateway itself, with --node-id"),
    "set id": Command("own", "node_id", _Session._set_id, "of the gateway itself, from its next reset on"),
    "init": Command("own", "bit_rate", _Session._init, "9: reset communication of the gateway itself"),
    "lss_switch_glob": Command("lss", "0|1", lss.switch_all, "1: configuration, 0: waiting"),
    "lss_switch_sel": Command("lss", "vendor product revision serial", lss.switch_one),
    "lss_set_node": Command("lss", "new_node", lss.set_node, "255: none"),
    "lss_conf_bitrate": Command("lss", "table entry", lss.set_bit_rate),
    "lss_activate_bitrate": Command("lss", "delay_ms", lss.activate_bit_rate),
    "lss_store": Command("lss", "", store_configuration),
    "lss_inquire_addr": Command("lss", "[part]", lss.inquire, "0..3, or all four"),
    "lss_get_node": Command("lss", "", lss.get_node),
    "lss_identity": Command("lss", "vendor product rev_low rev_high serial_low serial_high", lss.identify),
    "lss_ident_nonconf": Command("lss", "", lss.identify_nonconfigured),
    "_lss_fastscan": Command("lss", "[scan_ms]", lss.find_one),
    "lss_allnodes": Command(
        "lss", "[scan_ms] [first_node] [0|1] [scan...]", lss.assign_all, "assign node-IDs, 1: store; type, number x4"
    ),
    "info version": Command("gateway", "", _Session._info_version),
    "help": Command("gateway", "", _Session._help),
    "help lss": Command("gateway", "", partial(_Session._help, part="lss")),
    "help datatype": Command("gateway", "", partial(_Session._help, part="datatype")),
}

_SHORT = {"r": "read", "w": "write", "p": "pdo", "preop": "preoperational", "comm": "communication"}

_LIMITS = {
    "index": (0, 0xFFFF),
    "sub": (0, 0xFF),
    "net": (0, 127),
    "node": (0, 127),
    "node_id": (1, 127),
    "timeout_ms": (1, 65_535),
    "time_ms": (1, 65_535),
    "interval_ms": (0, 65_535),
    "factor": (1, 255),
    "number": (1, 512),
    "cob_id": (1, 0x7FF),
    "inhibit_100us": (0, 0xFFFF),
    "timer_ms": (0, 0xFFFF),
    "sync_start": (0, 240),
    "0|1": (0, 1),
    "bit_rate": (0, 9),
    "first_node": (1, 127),
}
"""The limits of numbers; those of all other numbers are 0 and FFFF FFFFh."""


def _transmission(words: Words) -> int:
    word = words.take("a transmission type").lower()
    types = {"event": EVENT, "rtr": RTR, **{f"sync{period}": period for period in range(241)}}
    if word not in types:
        text = f"transmission type {shown(word)}: expected event, rtr or sync0..sync240"
        raise GatewayError(GatewayCode.SYNTAX, text)
    return types[word]


def _objects(words: Words) -> tuple[str, ...]:
    """Return the types of the objects of a PDO."""
    types: list[str] = []
    for _ in range(words.number("number of objects", 0, 64)):
        for name in ("index", "sub"):
            words.number(name, *_LIMITS[name])
        types.append(words.type())
        if not width(types[-1]):
            raise GatewayError(GatewayCode.SYNTAX, f"type {types[-1]} has no fixed size: no PDO holds it")
    bits = sum(map(width, types))
    if bits > BITS_MAX:
        raise GatewayError(GatewayCode.PDO_LENGTH_EXCEEDED, f"{bits} bits: a PDO has {BITS_MAX}")
    return tuple(types)


def _values(words: Words) -> list[str]:
    """Return the words of the values of a PDO: a value may have two."""
    count = words.number("number of values", 0, 64)
    values = words.rest()
    if len(values) < count:
        raise GatewayError(GatewayCode.SYNTAX, f"{count} values were announced, but {len(values)} words follow")
    return values


def _enable(words: Words) -> bool:
    word = words.take("enable or disable").lower()
    if word not in ("enable", "disable"):
        raise GatewayError(GatewayCode.SYNTAX, f"{shown(word)}: expected enable or disable")
    return word == "enable"


_READERS: dict[str, Callable[[Words], object]] = {
    "type": Words.type,
    "value...": Words.rest,
    "transmission": _transmission,
    "objects...": _objects,
    "values...": _values,
    "enable|disable": _enable,
    "scan...": Words.numbers,
}
"""How the arguments are read that are not one number."""

_TYPES = "types: b i8..i64 u8..u64 x8..x64 r32 r64 vs os us d t td hex;  # begins a comment"


def _help_lines() -> list[str]:
    """Return a line for each command, and the explanation of its words."""
    lines = []
    for words, command in COMMANDS.items():
        address = {"gateway": "", "node": "[[net] node] ", "nodes": "[[net] node] ", "sdo": "[[net] node] "}
        syntax = f"[seq] {address.get(command.to, '[net] ')}{words} {command.arguments}"
        lines.append(f"{syntax:<74} {command.help}".rstrip())
    return [
        *lines,
        "short: " + ", ".join(f"{short} = {word}" for short, word in _SHORT.items()),
        "transmission: event, rtr, sync0..sync240; objects...: their number, then index sub type of each",
    ]


def parse_line(line: str) -> CommandLine:
    """Parse a line.

    >>> parse_line("[12] 1 5 r 0x6041 0 u16")
    CommandLine(sequence=12, net=1, node=5, command='read', arguments=[24641, 0, 'u16'])

    Capitals do not matter in the words of a command. A missing or unexpected word raises GatewayError 101, whose text
    names it; an unknown command or setting 100.
    """
    sequence, rest = sequence_of(line)
    words = Words(split_line(rest))
    address: list[int] = []
    while len(address) < 2 and words.peek()[:1].isdigit():
        address.append(words.number("net or node", 0, 0xFFFF_FFFF))
    name = _command_name(words)
    command = COMMANDS[name]
    arguments: list[Any] = []
    for argument in command.arguments.split():
        if argument.startswith("[") and not words:
            break
        argument = argument.strip("[]")
        limits = _LIMITS.get(argument, (0, 0xFFFF_FFFF))
        arguments.append(_READERS[argument](words) if argument in _READERS else words.number(argument, *limits))
    if words:
        raise GatewayError(GatewayCode.SYNTAX, f"{shown(words.take(''))} is unexpected after the command")
    node = None
    if command.to in ("node", "nodes", "sdo"):
        node = address.pop() if address else None  # a single number is the node
    elif len(address) > 1:
        raise GatewayError(GatewayCode.SYNTAX, "this command is for a net: it takes no node")
    return CommandLine(sequence, address[0] if address else None, node, name, arguments)


def _command_name(words: Words) -> str:
    """Remove the one or two words of a command, and return its name in the table."""
    word = words.take("a command").lower()
    first = _SHORT.get(word, word)
    second = words.peek()
    name = f"{first} {_SHORT.get(second, second)}"
    if name in COMMANDS:
        words.take("")
        return name
    if first in COMMANDS:
        return first
    choices = [name.partition(" ")[2] for name in COMMANDS if name.startswith(f"{first} ")]
    if choices:
        expected = f"one of {', '.join(choices)}"
        text = f"{first} {shown(words.take(expected))}: expected {expected}"
        # CiA 309-3 has more settings than a gateway must have, but no other second words.
        raise GatewayError(GatewayCode.NOT_SUPPORTED if first == "set" else GatewayCode.SYNTAX, text)
    if word[:1].isdigit():
        raise GatewayError(GatewayCode.SYNTAX, f"{shown(word)} is no command; at most a net and a node precede one")
    raise GatewayError(GatewayCode.NOT_SUPPORTED, f"no command {shown(word)}; help lists them")
