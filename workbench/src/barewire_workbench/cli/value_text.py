"""A text -> a value of a parameter, as in `NAME=VALUE`. Programs use numbers, and the names only.

    "3000"  "0x0BB8"  "0BB8h"  "0b101"  "-2.5e3"   a number; a hexadecimal one is the number itself, for any type
    "on"  "off"  "true"  "false"  "1"  "0"         a bit
    "Starter ready"                                the name of one of the parameter's values, in upper or lower case
    "Hall 4"                                       text, unchanged
    "01AB"  "@program.bin"                         an octet string or a domain: bytes in hexadecimal, or of a file
    "2026-03-01T12:00:00"  "90000"                 a time of day; or milliseconds, as of a time difference

Ranges are not checked here: writing checks them.
"""

from __future__ import annotations

import math
import re
from datetime import datetime
from decimal import Decimal

from barewire.canopen.datatypes import TimeOfDay
from barewire.codecs import Value
from barewire.devices import Parameter
from barewire.devices.request_checks import value_of_name
from barewire.errors import EncodeError, shown
from barewire_workbench.cli.output import file_content

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
        if parameter.type in _FORMS:
            return _of_dictionary(parameter, text)
        number = _number(text.strip())
        if number is None:
            raise no_name from None
        if isinstance(number, float) and math.isfinite(number) and parameter.type not in ("f32", "f64"):
            number = _exact(parameter, number, text.strip())
    return bool(number) if parameter.type == "bool" and number in (0, 1) else number


_FORMS = {
    "octets": "bytes such as 01AB, or @FILE",
    "domain": "bytes such as 01AB, or @FILE",
    "time_of_day": "a time such as 2026-03-01T12:00:00, or milliseconds since 1984",
}
"""The data types of CiA 301 whose values are neither numbers nor text, and how they are written."""


def _of_dictionary(parameter: Parameter, text: str) -> Value:
    try:
        if parameter.type == "time_of_day":
            return int(text) if text.strip().isdecimal() else TimeOfDay.of(datetime.fromisoformat(text))
        return file_content(text[1:]) if text.startswith("@") else bytes.fromhex(text)
    except ValueError:
        expected = _FORMS[parameter.type]
        raise EncodeError(f"{parameter.name} = {shown(text)}: expected {expected}", parameter.name) from None


def _exact(parameter: Parameter, number: float, text: str) -> int | float:
    """Return the number of a parameter that counts steps: a whole one as an integer, which a float may round.

    Raises EncodeError for one that is whole only because the float has rounded it."""
    try:
        exact = Decimal(text)
    except ArithmeticError:
        exact = Decimal("nan")
    if exact == exact.to_integral_value():
        return int(exact)
    if number.is_integer():
        raise EncodeError(f"{parameter.name} = {shown(text)}: a float cannot hold these digits", parameter.name)
    return number


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
