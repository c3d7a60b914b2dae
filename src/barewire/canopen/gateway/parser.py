"""Parse a line of the gateway into a command.   [CiA 309-3, syntax]

        [12] 1 5 read 0x6041 0 u16   # the status word
         |   | | |                     |
         |   | | command and words     comment, to the end of the line
         |   | node; 0 is all nodes (NMT); the default is the one of `set node`
         |   net, may be omitted too
         sequence number, repeated in the answer

Capitals do not matter in the words of a command; read and write may be shortened to r and w. Double quotes hold a word
together, and are doubled inside it:

        [1] 5 w 0x2000 0 vs "say ""no"" now" # a text    ->   w | 0x2000 | 0 | vs | say "no" now

A missing or unexpected word raises GatewayError 101, whose text names it; an unknown command or setting 100. Commands
are executed by `session`.
"""

from __future__ import annotations

from typing import Literal

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
)
from barewire.canopen.gateway.values import TYPE_NAMES, from_text, read_number, width, word_count
from barewire.canopen.nmt.messages import NmtCommand
from barewire.canopen.pdo.mapping import BITS_MAX
from barewire.errors import shown

_NMT = {
    "start": NmtCommand.START,
    "stop": NmtCommand.STOP,
    "preop": NmtCommand.ENTER_PRE_OPERATIONAL,
    "preoperational": NmtCommand.ENTER_PRE_OPERATIONAL,
}
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
    "lss_allnodes": (0, 11),
}
"""How many numbers each LSS command takes, at least and at most."""
_INDICATIONS: dict[str, Literal["boot_up", "emcy", "bus"]] = {
    "boot_up_indication": "boot_up",
    "_emcy_indication": "emcy",
    "_bus_indication": "bus",
}
_SETTINGS = {
    "network": (0, 127),
    "node": (0, 127),
    "sdo_timeout": (1, 65_535),
    "sdo_block": (0, 1),
    "heartbeat": (0, 65_535),
    "id": (1, 127),
}
"""The limits of the settings."""
_OF_NET = (SetOption, LssCommand, SetPdo, ReadPdo, WritePdo, EnableIndication, InitGateway, ShowInfo)
"""The commands to the gateway or to a net: they take no node."""


def parse_line(line: str) -> CommandLine:
    """Parse a line.

    >>> parse_line("[12] 1 5 read 0x6041 0 u16")
    CommandLine(sequence=12, net=1, node=5, command=ReadSdo(index=24641, sub=0, type='u16'))

    Raise GatewayError 101 for a line that breaks the syntax, 100 for an unknown command.
    """
    sequence, rest = sequence_of(line)
    words = _Words(split_line(rest))
    numbers: list[int] = []
    while len(numbers) < 2 and words.peek()[:1].isdigit():
        numbers.append(words.number("net or node", 0, 0xFFFF_FFFF))
    command = _command(words)
    if words:
        raise GatewayError(GatewayCode.SYNTAX, f"{shown(words.take(''))} is unexpected after the command")
    if isinstance(command, _OF_NET):
        # A number before the command is the net.
        if len(numbers) > 1:
            raise GatewayError(GatewayCode.SYNTAX, "this command is for a net: it takes no node")
        return CommandLine(sequence, numbers[0] if numbers else None, None, command)
    node = numbers.pop() if numbers else None
    return CommandLine(sequence, numbers[0] if numbers else None, node, command)


def split_line(line: str) -> list[str]:
    """Return the words of a line without its comment, which begins at a number sign outside of quotes.

    >>> split_line('5 w 0x2000 0 vs "say ""no"" #1"  # a text')
    ['5', 'w', '0x2000', '0', 'vs', 'say "no" #1']
    """
    words: list[str] = []
    position, end = 0, len(line)
    while position < end and line[position] != "#":
        if line[position].isspace():
            position += 1
        elif line[position] == '"':
            word, position = _quoted(line, position + 1)
            words.append(word)
        else:
            begin = position
            while position < end and not line[position].isspace() and line[position] not in '#"':
                position += 1
            words.append(line[begin:position])
    return words


def _quoted(line: str, begin: int) -> tuple[str, int]:
    """Return the word in double quotes whose text begins at this position, and the position after it."""
    parts: list[str] = []
    while True:
        closing = line.find('"', begin)
        if closing < 0:
            raise GatewayError(GatewayCode.SYNTAX, "a double quote is not closed")
        parts.append(line[begin:closing])
        if line[closing + 1 : closing + 2] != '"':
            return '"'.join(parts), closing + 1
        begin = closing + 2


def sequence_of(line: str) -> tuple[int, str]:
    """Return the sequence number and the rest of a line. Raise GatewayError.

    >>> sequence_of("[ 7 ] start")
    (7, ' start')
    """
    before, opened, behind = line.partition("[")
    number, closed, rest = behind.partition("]")
    if before.strip() or not opened or not closed:
        raise GatewayError(GatewayCode.SYNTAX, "a line begins with its sequence number in brackets: [1] 5 start")
    try:
        sequence = read_number(number.strip())
    except ValueError:
        sequence = -1
    if not 0 <= sequence < 1 << 32:
        raise GatewayError(GatewayCode.SYNTAX, f"sequence number {shown(number.strip())}: expected 0..4294967295")
    return sequence, rest


class _Words:
    """The remaining words of a line."""

    def __init__(self, words: list[str]) -> None:
        self._words = words

    def __bool__(self) -> bool:
        return bool(self._words)

    def peek(self) -> str:
        """Return the next word in lower case, or an empty text."""
        return self._words[0].lower() if self._words else ""

    def take(self, name: str) -> str:
        """Remove and return the next word, unchanged."""
        if not self._words:
            raise GatewayError(GatewayCode.SYNTAX, f"the line ends where {name} was expected")
        return self._words.pop(0)

    def choice(self, name: str, *choices: str) -> str:
        """Remove and return the next word, one of these. For a choice `long|short`, both return `long`."""
        word = self.take(name).lower()
        for choice in choices:
            if word in choice.split("|"):
                return choice.split("|")[0]
        expected = ", ".join(choice.replace("|", " or ") for choice in choices)
        raise GatewayError(GatewayCode.SYNTAX, f"{shown(word)} is not a {name}: expected {expected}")

    def number(self, name: str, low: int, high: int) -> int:
        """Remove and return the next word as an integer within these limits, both included."""
        word = self.take(name)
        try:
            value = read_number(word)
        except ValueError:
            raise GatewayError(GatewayCode.SYNTAX, f"{name} {shown(word)}: expected an integer") from None
        if not low <= value <= high:
            raise GatewayError(GatewayCode.SYNTAX, f"{name} {word}: expected {low}..{high}")
        return value

    def rest(self) -> list[str]:
        """Remove and return all remaining words."""
        words, self._words = self._words, []
        return words


def _command(words: _Words) -> GatewayCommand:
    word = words.take("a command").lower()
    if word in ("r", "read"):
        return _read(words)
    if word in ("w", "write"):
        return _write(words)
    if word in _NMT:
        return SendNmt(_NMT[word])
    if word == "reset":
        target = words.choice("kind of reset", "node", "comm|communication")
        return SendNmt(NmtCommand.RESET_NODE if target == "node" else NmtCommand.RESET_COMMUNICATION)
    if word == "set":
        return _set(words)
    if word in ("enable", "disable"):
        return _control(words, word == "enable")
    if word in _INDICATIONS:
        return EnableIndication(_INDICATIONS[word], words.choice("choice", "enable", "disable") == "enable")
    if word == "init":
        return InitGateway(words.number("entry of the bit rate table", 0, 9))
    if word in _LSS_NUMBERS:
        return _lss(words, word)
    if word == "info":
        return ShowInfo(words.choice("kind of information", "version"))
    if word == "help":
        return ShowInfo(word, words.choice("topic", "lss", "datatype") if words else "")
    if word[:1].isdigit():
        raise GatewayError(GatewayCode.SYNTAX, f"{shown(word)} is no command; at most a net and a node precede one")
    raise GatewayError(GatewayCode.NOT_SUPPORTED, f"no command {shown(word)}; help lists them")


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
            raise GatewayError(GatewayCode.SYNTAX, f"{count} values were announced, but {len(values)} words follow")
        return WritePdo(number, tuple(values))
    index, sub = _object(words)
    type = _type(words)
    if word_count(type):
        value = [words.take(f"a value of type {type}") for _ in range(word_count(type))]
    else:
        value = words.rest()
    return WriteSdo(index, sub, from_text(type, value))


def _set(words: _Words) -> GatewayCommand:
    setting = words.take("a setting").lower()
    if setting in ("rpdo", "tpdo", "tpdox"):
        return _set_pdo(words, setting)
    if setting not in _SETTINGS:
        raise GatewayError(GatewayCode.NOT_SUPPORTED, f"set {shown(setting)}: this gateway has {', '.join(_SETTINGS)}")
    return SetOption(setting, words.number(setting, *_SETTINGS[setting]))


def _pdo_number(words: _Words) -> int:
    return words.number("number of a PDO", 1, 512)


def _set_pdo(words: _Words, setting: str) -> SetPdo:
    number = _pdo_number(words)
    cob_id = words.number("COB-ID", 1, 0x7FF)
    transmission = words.take("a transmission type").lower()
    if transmission not in ("event", "rtr", *(f"sync{period}" for period in range(241))):
        text = f"transmission type {shown(transmission)}: expected event, rtr or sync0..sync240"
        raise GatewayError(GatewayCode.SYNTAX, text)
    inhibit = timer = start = 0
    if setting == "tpdox":
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
    return SetPdo(setting != "rpdo", number, cob_id, transmission, tuple(types), inhibit, timer, start)


def _control(words: _Words, on: bool) -> GatewayCommand:
    if words.choice("error control", "guarding", "heartbeat") == "heartbeat":
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
        raise GatewayError(GatewayCode.SYNTAX, f"{service} takes {least} numbers, got {len(numbers)}")
    return LssCommand(service, tuple(numbers))
