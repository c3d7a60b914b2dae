"""The text of values in the gateway's lines <-> the bytes of an object.   [CiA 309-3, data types]

        b  i8 i16 i24 ... i64  u8 u16 u24 ... u64   0, 1      numbers, decimal or 0x...; written in decimal
        x8 x16 ... x64                              the same, written in hexadecimal (a common extension)
        r32 r64                                     3.14      real numbers
        vs                                          "a text"  a double quote inside is doubled
        os us d                                     AAECAw==  base64 (for us: of its 16-bit characters)
        t td                                        15659 43200000   days, then milliseconds of the day
        hex                                         01 02 03  the bytes (an extension); default of a read command

Numbers are little-endian on the bus, as everywhere in CANopen.
"""

from __future__ import annotations

import base64
import binascii

from barewire.canopen.datatypes import DAY, object_codec
from barewire.canopen.gateway.commands import GatewayCode, GatewayError
from barewire.codecs import Value
from barewire.errors import DecodeError, EncodeError, shown

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


def read_number(word: str) -> int:
    """Read an integer in decimal, or in hexadecimal after 0x. Raise ValueError."""
    if len(word) > 40 or not word.isascii() or "_" in word:
        raise ValueError(word)
    return int(word, 16 if word.lower().startswith(("0x", "-0x", "+0x")) else 10)


def is_wrong_length(error: DecodeError) -> bool:
    """Return whether the object has another size than the type, which has an SDO abort code."""
    return error.reason in ("short", "long")
