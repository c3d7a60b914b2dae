"""The text of the gateway's lines: words, numbers, values, error codes.   [CiA 309-3, syntax, data types, error codes]

        [12] 1 5 read 0x6041 0 u16   # the status word
         |   | | |                     |
         |   | | command and words     comment, to the end of the line
         |   | node; 0 is all nodes (NMT); the default is the one of `set node`
         |   net, may be omitted too
         sequence number, repeated in the answer

Double quotes hold a word together, and are doubled inside it:

        [1] 5 w 0x2000 0 vs "say ""no"" now" # a text    ->   w | 0x2000 | 0 | vs | say "no" now

The types of values, and what their text is:

        b  i8 i16 i24 ... i64  u8 u16 u24 ... u64   0, 1      numbers, decimal or 0x...; written in decimal
        x8 x16 ... x64                              the same, written in hexadecimal (a common extension)
        r32 r64                                     3.14      real numbers
        vs                                          "a text"  a double quote inside is doubled
        os us d                                     AAECAw==  base64 (for us: of its 16-bit characters)
        t td                                        15659 43200000   days, then milliseconds of the day
        hex                                         01 02 03  the bytes (an extension); default of a read command

Errors:

        [7] ERROR:100 #no command "raed"              a command that the gateway does not support; 101 a syntax error
        [8] ERROR:0x06020000 #no such object          the node refused: the abort code of the SDO transfer
         |        |           |
         |        |           a comment for people; programs read up to the number sign
         |        code: three decimal digits, or eight hexadecimal ones
         the sequence number of the command

The codes 200 to 299 report the state of a node without a command, in lines such as "1 5 ERROR 203".
"""

from __future__ import annotations

import base64
import binascii
from enum import IntEnum

from barewire.canopen.abort_codes import AbortCode
from barewire.canopen.datatypes import DAY, object_codec
from barewire.codecs import Value
from barewire.errors import BarewireError, EncodeError, shown


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
    """The gateway cannot execute a command: the code, and a sentence for people.

    The code is one of SDO if a node returned a value that is not of the requested type.
    """

    def __init__(self, code: GatewayCode | AbortCode, text: str) -> None:
        super().__init__(text)
        self.code = code


def error_line(sequence: int, code: int, text: str) -> str:
    """Return the line that reports an error.

    >>> error_line(7, GatewayCode.NOT_SUPPORTED, 'no command "raed"'), error_line(8, 0x06020000, "no such object")
    ('[7] ERROR:100 #no command "raed"', '[8] ERROR:0x06020000 #no such object')
    """
    digits = str(int(code)) if code < 1000 else f"0x{code:08X}"
    return f"[{sequence}] ERROR:{digits} #{' '.join(text.split())}"


# Words -------------------------------------------------------------------------------------------------------------


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


class Words:
    """The remaining words of a line. What is missing or wrong raises GatewayError 101, whose text names it."""

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

    def type(self) -> str:
        """Remove and return the next word, the name of a type."""
        word = self.take("a type").lower()
        if word not in TYPE_NAMES:
            raise GatewayError(GatewayCode.SYNTAX, f"type {shown(word)}: expected one of {', '.join(TYPE_NAMES)}")
        return word

    def numbers(self) -> list[int]:
        """Remove and return all remaining words as integers of 32 bits."""
        return [self.number("number", 0, 0xFFFF_FFFF) for _ in range(len(self._words))]

    def rest(self) -> list[str]:
        """Remove and return all remaining words."""
        words, self._words = self._words, []
        return words


def read_number(word: str) -> int:
    """Read an integer in decimal, or in hexadecimal after 0x. Raise ValueError."""
    # `int` reads digits of every script, and 1_000; and it would read a word of thousands of digits.
    if len(word) > 40 or not word.isascii() or "_" in word:
        raise ValueError(word)
    return int(word, 16 if word.lower().startswith(("0x", "-0x", "+0x")) else 10)


# Values ------------------------------------------------------------------------------------------------------------

_WIDTHS = (8, 16, 24, 32, 40, 48, 56, 64)
TYPE_NAMES: dict[str, str] = {
    "b": "bool",
    **{f"{sign}{width}": f"{sign}{width}" for sign in "iu" for width in _WIDTHS},
    **{f"x{width}": f"u{width}" for width in _WIDTHS},
    "r32": "f32",
    "r64": "f64",
    "t": "time_of_day",
    "td": "time_difference",
    "vs": "string",
    "os": "octets",
    "us": "unicode",
    "d": "domain",
    "hex": "domain",
}
"""The name of a type in the gateway: its name in `datatypes`."""

_BASE64 = ("os", "us", "d")


def width(type: str) -> int:
    """Return the bits of a type in a PDO, 0 for types without a fixed size."""
    if type == "b":
        return 1
    return 8 * (object_codec(TYPE_NAMES[type]).size or 0)


def word_count(type: str) -> int:
    """Return how many words of a line a value has; 0 stands for all remaining words."""
    return {"t": 2, "td": 2, "hex": 0}.get(type, 1)


def to_text(type: str, data: bytes) -> str:
    r"""Return the bytes of an object as text.

    >>> to_text("i16", b"\xFE\xFF"), to_text("x16", b"\xFE\xFF"), to_text("vs", b'say "no" now')
    ('-2', '0xFFFE', '"say ""no"" now"')

    Raise DecodeError for bytes that are not a value of the type.
    """
    if type == "hex":
        return data.hex(" ").upper()
    if type in _BASE64:
        return base64.b64encode(data).decode("ascii")
    value = object_codec(TYPE_NAMES[type]).decode(data)
    if type == "vs":
        return '"' + str(value).replace('"', '""') + '"'
    if type in ("t", "td"):
        days, milliseconds = divmod(int(value), DAY)
        return f"{days} {milliseconds}"
    if type[0] == "x":
        return f"0x{int(value):0{int(type[1:]) // 4}X}"
    return repr(value) if isinstance(value, float) else str(int(value))


def from_text(type: str, words: list[str]) -> bytes:
    """Return the bytes of the value that these words represent. Raise GatewayError 101 if they represent none.

    >>> from_text("u16", ["0x1234"]).hex(" "), from_text("td", ["1", "1000"]).hex(" "), from_text("hex", ["01", "0203"])
    ('34 12', 'e8 03 00 00 01 00', b'\\x01\\x02\\x03')
    """
    expected = word_count(type)
    if expected and len(words) != expected:
        text = f"a value of type {type} is {expected} word{'s' * (expected > 1)}, not {len(words)}"
        raise GatewayError(GatewayCode.SYNTAX, text)
    try:
        if type == "hex":
            return bytes.fromhex(" ".join(words))
        if type in _BASE64:
            return base64.b64decode(words[0], validate=True)
        return object_codec(TYPE_NAMES[type]).encode(_value(type, words))
    except EncodeError as error:
        raise GatewayError(GatewayCode.SYNTAX, str(error)) from None
    except (ValueError, OverflowError, binascii.Error):
        raise GatewayError(GatewayCode.SYNTAX, f"{shown(' '.join(words))} is not a value of type {type}") from None


def _value(type: str, words: list[str]) -> Value:
    if type == "vs":
        return words[0]
    if type in ("r32", "r64"):
        return float(words[0])
    if type in ("t", "td"):
        days, milliseconds = (read_number(word) for word in words)
        if not 0 <= milliseconds < DAY:
            raise EncodeError(f"{shown(milliseconds)} ms are more than a day has")
        return days * DAY + milliseconds
    return read_number(words[0])
