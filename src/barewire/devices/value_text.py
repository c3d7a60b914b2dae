"""Text -> a value of a parameter, as in `NAME=VALUE` on a command line. Programs use numbers, and the names only.

    "3000"  "0x0BB8"  "0BB8h"  "0b101"  "-2.5e3"   a number; a hexadecimal one is the number itself, for any type
    "on"  "off"  "true"  "false"  "1"  "0"         a bit
    "Starter ready"                                the name of one of the parameter's values, in upper or lower case
    "Hall 4"                                       text, unchanged

Ranges are not checked here: writing checks them.
"""

from __future__ import annotations

import math
import re

from barewire.codecs import Value
from barewire.devices.device import suggest
from barewire.devices.parameter import Parameter
from barewire.errors import EncodeError, shown

_SUFFIXED = re.compile(r"[+-]?(?:[0-9][0-9A-Fa-f]*[hH]|[0-9A-F]+h)")
_SWITCHED = {"on": True, "true": True, "off": False, "false": False}


def parse_value(parameter: Parameter, text: str) -> Value:
    """Return the value in a text. Raises EncodeError with what was expected.

    >>> relay = Parameter("Relay", "bool")
    >>> parse_value(relay, "on"), parse_value(relay, "0")
    (True, False)
    >>> parse_value(Parameter("Tariff", "u8"), "02")  # digits are decimal, also with leading zeros
    2
    >>> parse_value(relay, "open")
    Traceback (most recent call last):
      ...
    barewire.errors.EncodeError: Relay = 'open': expected on or off
    >>> parse_value(Parameter("Limit", "u16"), "64h")
    100
    """
    stripped = text.strip()
    named = _named_value(parameter, stripped)
    if named is not None:
        return named
    if parameter.type == "text":
        return text
    try:
        value = _number(stripped)
        if isinstance(value, float) and math.isinf(value) and "inf" not in stripped.lower():
            raise ValueError(f"{stripped} is more than a float can hold")
    except ValueError:
        raise _unknown(parameter, text) from None
    return bool(value) if parameter.type == "bool" and value in (0, 1) else value


def value_of_name(parameter: Parameter, name: str) -> Value:
    """Return the value with this name, in upper or lower case; on or off for a bit. Raises EncodeError with the names.

    >>> value_of_name(Parameter("Mode", "i8", values={1: "position", 3: "velocity"}), "Velocity")
    3
    """
    found = _named_value(parameter, name.strip())
    if found is None:
        raise _unknown(parameter, name)
    return found


def _named_value(parameter: Parameter, name: str) -> Value | None:
    for number, title in parameter.values.items():
        if name.casefold() == title.casefold():
            return number
    return _SWITCHED.get(name.lower()) if parameter.type == "bool" else None


def _unknown(parameter: Parameter, text: str) -> EncodeError:
    wanted = "on or off" if parameter.type == "bool" else "a number"
    names = f", or one of: {', '.join(parameter.values.values())}" if parameter.values else ""
    hint = suggest(text, parameter.values.values())
    return EncodeError(f"{parameter.name} = {shown(text)}: expected {wanted}{names}{hint}", parameter.name)


def _number(text: str) -> int | float:
    """Return the number. Raises ValueError for other text, also for `each`: before a small h, a digit comes first."""
    if _SUFFIXED.fullmatch(text):
        return int(text[:-1], 16)
    base = {"0x": 16, "0b": 2}.get(text.lstrip("+-")[:2].lower(), 10)
    return int(text, base) if base != 10 or text.lstrip("+-").isdecimal() else float(text)
