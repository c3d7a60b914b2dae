"""One line from a person or a script, taken apart into a command.   [CiA 309-3, syntax]

        [12] 1 5 read 0x6041 0 u16   # what is its status?
         |   | | |                     |
         |   | | command and words     comment, to the end of the line
         |   | node, 0 means all (NMT) or is left out: the default that `set node` gave
         |   net, may be left out as well
         sequence number: the answer bears it

Words of a command may be written in capitals or not; read and write may be r and w. What a line means is decided here
and nothing is done; `session` carries it out.
"""

from __future__ import annotations

from barewire.canopen.gateway.codes import GatewayCode, GatewayError
from barewire.canopen.gateway.requests import (
    CommandLine,
    ConfigureGuarding,
    ConfigureHeartbeat,
    EnableBootUp,
    GatewayCommand,
    LssCommand,
    ReadPdo,
    ReadSdo,
    SendNmt,
    SetOption,
    SetPdo,
    ShowInfo,
    WritePdo,
    WriteSdo,
)
from barewire.canopen.gateway.values import TYPE_NAMES, from_text, width, words_of
from barewire.canopen.gateway.words import _Words, sequence_of, split_line
from barewire.canopen.nmt.messages import NmtCommand
from barewire.canopen.pdo.mapping import BITS_MAX
from barewire.errors import shown

_LSS_NUMBERS = {
    "lss_switch_glob": (1, 1),
    "lss_switch_sel": (4, 4),
    "lss_set_node": (1, 1),
    "lss_conf_bitrate": (2, 2),
    "lss_activate_bitrate": (1, 1),
    "lss_store": (0, 0),
    "lss_inquire_addr": (0, 1),
    "lss_get_node": (0, 0),
    "lss_identity": (6, 6),
    "lss_ident_nonconf": (0, 0),
    "_lss_fastscan": (0, 1),
    "lss_allnodes": (0, 3),
}
"""How many numbers each LSS command takes, at least and at most."""


def parse_line(line: str) -> CommandLine:
    """The whole line.

    >>> parse_line("[12] 1 5 read 0x6041 0 u16")
    Line(sequence=12, net=1, node=5, request=Read(index=24641, sub=0, type='u16'))

    Raises GatewayError 101.
    """
    sequence, rest = sequence_of(line)
    words = _Words(split_line(rest))
    numbers: list[int] = []
    while len(numbers) < 2 and words.peek()[:1].isdigit():
        numbers.append(words.number("net or node", 0, 0xFFFF_FFFF))
    request = _request(words)
    if words:
        raise GatewayError(GatewayCode.SYNTAX, f"{shown(words.take(''))} is too much behind the command")
    if isinstance(request, (SetOption, LssCommand, SetPdo, ReadPdo, WritePdo, EnableBootUp, ShowInfo)):
        # Commands to the gateway or to a whole net have no node; a number before them is the net.
        if len(numbers) > 1:
            raise GatewayError(GatewayCode.SYNTAX, "this command is for a net: it takes no node")
        return CommandLine(sequence, numbers[0] if numbers else None, None, request)
    node = numbers.pop() if numbers else None
    return CommandLine(sequence, numbers[0] if numbers else None, node, request)


def _request(words: _Words) -> GatewayCommand:
    word = words.take("a command").lower()
    if word in ("r", "read"):
        return _read(words)
    if word in ("w", "write"):
        return _write(words)
    if word in _NMT:
        return SendNmt(_NMT[word])
    if word == "reset":
        which = words.among("kind of reset", "node", "comm|communication")
        return SendNmt(NmtCommand.RESET_NODE if which == "node" else NmtCommand.RESET_COMMUNICATION)
    if word == "set":
        return _set(words)
    if word in ("enable", "disable"):
        return _control(words, word == "enable")
    if word == "boot_up_indication":
        return EnableBootUp(words.among("choice", "enable", "disable") == "enable")
    if word in _LSS_NUMBERS:
        return _lss(words, word)
    if word == "info":
        return ShowInfo(words.among("kind of information", "version"))
    if word == "help":
        words.rest()
        return ShowInfo(word)
    if word in ("init", "log", "led"):
        raise GatewayError(GatewayCode.NOT_SUPPORTED, f"this gateway has no {word}")
    raise GatewayError(GatewayCode.SYNTAX, f"no command {shown(word)}; help lists them")


_NMT = {
    "start": NmtCommand.START,
    "stop": NmtCommand.STOP,
    "preop": NmtCommand.ENTER_PRE_OPERATIONAL,
    "preoperational": NmtCommand.ENTER_PRE_OPERATIONAL,
}


def _object(words: _Words) -> tuple[int, int]:
    return words.number("index", 0, 0xFFFF), words.number("sub-index", 0, 0xFF)


def _type(words: _Words) -> str:
    word = words.take("a type").lower()
    if word not in TYPE_NAMES:
        raise GatewayError(GatewayCode.SYNTAX, f"type {shown(word)}: expected one of {', '.join(TYPE_NAMES)}")
    return word


def _read(words: _Words) -> GatewayCommand:
    if words.peek() in ("p", "pdo"):
        words.take("pdo")
        return ReadPdo(_pdo_number(words))
    index, sub = _object(words)
    return ReadSdo(index, sub, _type(words)) if words else ReadSdo(index, sub)


def _write(words: _Words) -> GatewayCommand:
    if words.peek() in ("p", "pdo"):
        words.take("pdo")
        number = _pdo_number(words)
        count = words.number("number of values", 0, 64)
        values = words.rest()
        if len(values) < count:
            raise GatewayError(GatewayCode.SYNTAX, f"{count} values were announced, {len(values)} words follow")
        return WritePdo(number, tuple(values))
    index, sub = _object(words)
    type = _type(words)
    if words_of(type):
        value = [words.take(f"a value of type {type}") for _ in range(words_of(type))]
    else:
        value = words.rest()
    return WriteSdo(index, sub, from_text(type, value))


def _set(words: _Words) -> GatewayCommand:
    what = words.among(
        "setting",
        *("network", "node", "sdo_timeout", "sdo_block", "rpdo", "tpdo", "tpdox"),
        *("heartbeat", "id", "command_timeout", "command_size"),
    )
    if what in ("rpdo", "tpdo", "tpdox"):
        return _set_pdo(words, what)
    if what in ("heartbeat", "id", "command_timeout", "command_size"):
        why = "is no node itself" if what in ("heartbeat", "id") else "has no limit of this kind"
        raise GatewayError(GatewayCode.NOT_SUPPORTED, f"set {what}: this gateway {why}")
    high = {"network": 127, "node": 127, "sdo_timeout": 65_535, "sdo_block": 1}[what]
    return SetOption(what, words.number(what, 0, high))


def _pdo_number(words: _Words) -> int:
    return words.number("number of a PDO", 1, 512)


def _set_pdo(words: _Words, what: str) -> SetPdo:
    number = _pdo_number(words)
    cob_id = words.number("COB-ID", 1, 0x7FF)
    kind = words.take("a transmission type").lower()
    if kind not in ("event", "rtr", *(f"sync{period}" for period in range(241))):
        text = f"transmission type {shown(kind)}: expected event, rtr or sync0..sync240"
        raise GatewayError(GatewayCode.SYNTAX, text)
    inhibit = timer = start = 0
    if what == "tpdox":
        inhibit = words.number("inhibit time in 0.1 ms", 0, 0xFFFF)
        timer = words.number("event timer in ms", 0, 0xFFFF)
        start = words.number("SYNC start value", 0, 240)
    types: list[str] = []
    for _ in range(words.number("number of objects", 0, 64)):
        _object(words)
        types.append(_type(words))
        if not width(types[-1]):
            raise GatewayError(GatewayCode.SYNTAX, f"type {types[-1]} has no fixed size: no PDO holds it")
    if sum(map(width, types)) > BITS_MAX:
        raise GatewayError(GatewayCode.PDO_LENGTH_EXCEEDED, f"{sum(map(width, types))} bits: a PDO has {BITS_MAX}")
    return SetPdo(what != "rpdo", number, cob_id, kind, tuple(types), inhibit, timer, start)


def _control(words: _Words, on: bool) -> GatewayCommand:
    if words.among("error control", "guarding", "heartbeat") == "heartbeat":
        return ConfigureHeartbeat(words.number("time in ms", 1, 65_535) if on else 0)
    if not on:
        return ConfigureGuarding(0, 0)
    return ConfigureGuarding(words.number("guard time in ms", 1, 65_535), words.number("life time factor", 1, 255))


def _lss(words: _Words, service: str) -> LssCommand:
    least, most = _LSS_NUMBERS[service]
    numbers: list[int] = []
    while words and len(numbers) < most:
        numbers.append(words.number("number", 0, 0xFFFF_FFFF))
    if len(numbers) < least:
        raise GatewayError(GatewayCode.SYNTAX, f"{service} takes {least} numbers, here are {len(numbers)}")
    return LssCommand(service, tuple(numbers))
