"""A text -> a value of a parameter, as in `NAME=VALUE`. Programs use numbers, and the names only.

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
from barewire.devices import Parameter
from barewire.devices.request_checks import value_of_name
from barewire.errors import EncodeError

_SUFFIXED = re.compile(r"[+-]?(?:[0-9][0-9A-Fa-f]*[hH]|[0-9A-F]+h)")


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
    try:
        return value_of_name(parameter, text)
    except EncodeError as no_name:
        if parameter.type == "text":
            return text
        number = _number(text.strip())
        if number is None:
            raise no_name from None
    return bool(number) if parameter.type == "bool" and number in (0, 1) else number


def _number(text: str) -> int | float | None:
    """Return the number; None for other text, and for more than a float can hold."""
    if _SUFFIXED.fullmatch(text):  # not `each`: a word with a small h begins with a digit or has capital letters
        return int(text[:-1], 16)
    base = {"0x": 16, "0b": 2}.get(text.lstrip("+-")[:2].lower(), 10)
    try:
        number = int(text, base) if base != 10 or text.lstrip("+-").isdecimal() else float(text)
    except ValueError:
        return None
    return None if isinstance(number, float) and math.isinf(number) and "inf" not in text.lower() else number
