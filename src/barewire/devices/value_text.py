"""What a person typed -> a value of a parameter, as `NAME=VALUE` on a command line has it.

    "3000"  "0x0BB8"  "0BB8h"  "0b101"  "-2.5e3"   a number; a hexadecimal one is the number, whatever the type
    "on"  "off"  "true"  "false"  "1"  "0"  a bit
    "Starter ready"                         the name of one of the parameter's values, whatever its case
    "Hall 4"                                text, as it stands

I know: how people write values.  I never know: ranges, types, the wire. Whether a value fits is asked later.
"""

from __future__ import annotations

import math
import re

from barewire.codecs import Value
from barewire.devices.parameter import Parameter
from barewire.errors import EncodeError, shown

_SUFFIXED = re.compile(r"[+-]?(?:[0-9][0-9A-Fa-f]*[hH]|[0-9A-F]+h)")
SWITCHED = {"on": True, "true": True, "off": False, "false": False}


def parse_value(parameter: Parameter, text: str) -> Value:
    """The value that the text stands for; EncodeError says what was expected.

    >>> relay = Parameter("Relay", "bool")
    >>> parse_value(relay, "on"), parse_value(relay, "0")
    (True, False)
    >>> parse_value(Parameter("Tariff", "u8"), "02")  # digits are decimal, whatever zeros stand before them
    2
    >>> parse_value(relay, "open")
    Traceback (most recent call last):
      ...
    barewire.errors.EncodeError: Relay = 'open': expected on or off
    >>> parse_value(Parameter("Limit", "u16"), "64h")
    100
    """
    plain = text.strip()
    for named, title in parameter.values.items():
        if plain.casefold() == title.casefold():
            return named
    if parameter.type == "text":
        return text
    if parameter.type == "bool" and plain.lower() in SWITCHED:
        return SWITCHED[plain.lower()]
    try:
        number: int | float = _number(plain)
        if isinstance(number, float) and math.isinf(number) and "inf" not in plain.lower():
            raise ValueError(f"{plain} is more than a float can hold")
    except ValueError:
        wanted = "on or off" if parameter.type == "bool" else "a number"
        names = f", or one of: {', '.join(parameter.values.values())}" if parameter.values else ""
        raise EncodeError(f"{parameter.name} = {shown(text)}: expected {wanted}{names}", parameter.name) from None
    return bool(number) if parameter.type == "bool" and number in (0, 1) else number


def _number(plain: str) -> int | float:
    """The number; ValueError for what is none. `each` is a word, for a number it would be 0EACh or EACh."""
    if _SUFFIXED.fullmatch(plain):
        return int(plain[:-1], 16)
    return int(plain, _base(plain)) if _looks_whole(plain) else float(plain)


def _looks_whole(text: str) -> bool:
    return text.lstrip("+-").isdecimal() or _base(text) != 10


def _base(text: str) -> int:
    return {"0x": 16, "0b": 2}.get(text.lstrip("+-")[:2].lower(), 10)
