"""Answers as people type them: numbers with units, hexadecimal numbers, bits, bytes, words.

Each function raises UnreadableAnswer with what was expected.
"""

from __future__ import annotations

import re

from barewire.errors import shown
from barewire_workbench.cli.teach.labs.model import UnreadableAnswer
from barewire_workbench.frames.input import parse_hex

_NUMBER = re.compile(r"([-+\u2212]?(?:[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+))\s*(\S*)")
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "\u00b5s": 1e-6, "\u03bcs": 1e-6}
_LONGEST = 400
"""Characters of an answer; none needs more."""


_LARGEST = 1e18


def checked_length(text: str) -> str:
    """Return the answer without blanks around it, unless it is too long to be one."""
    if len(text) > _LONGEST:
        raise UnreadableAnswer(f"an answer of {len(text)} characters: none needs more than {_LONGEST}")
    return text.strip()


def typed_number(text: str, *units: str) -> float:
    """Return a decimal number, with or without one of the units behind it.

    >>> typed_number("24,5 \u00b0C", "\u00b0C"), typed_number("-200")
    (24.5, -200.0)
    """
    found = _NUMBER.fullmatch(checked_length(text))
    if found is None or found[2].lower() not in ("", *(unit.lower() for unit in units)):
        behind = f", or one with {' or '.join(units)} behind it" if units else ""
        raise UnreadableAnswer(f"{shown(text)} is not a number: expected a decimal number{behind}")
    return _in_range(float(found[1].replace(",", ".").replace("\u2212", "-")), text)


def _in_range(value: float, text: str) -> float:
    if abs(value) > _LARGEST:
        raise UnreadableAnswer(f"{shown(text)} is larger than any answer")
    return value


def typed_seconds(text: str, unit: str) -> float:
    """Return a time in seconds; without a unit behind it, it is in `unit`.

    >>> round(typed_seconds("104", "us"), 7), round(typed_seconds("0.104 ms", "us"), 7)
    (0.000104, 0.000104)
    """
    found = _NUMBER.fullmatch(checked_length(text))
    if found is None or (given := found[2].lower() or unit) not in _TIMES:
        raise UnreadableAnswer(f"{shown(text)} is not a time: expected a number, with s, ms or us behind it")
    return _in_range(float(found[1].replace(",", ".").replace("\u2212", "-")), text) * _TIMES[given]


def hex_number(text: str) -> int:
    """Return a hexadecimal number: 605, 605h, 0x605.

    >>> hex_number("0x605") == hex_number("605h") == 0x605
    True
    """
    digits = checked_length(text).replace(" ", "").lower().removeprefix("0x").removesuffix("h")
    if not re.fullmatch(r"[0-9a-f]{1,16}", digits):
        raise UnreadableAnswer(f"{shown(text)} is not a hexadecimal number: expected digits 0 to 9 and A to F")
    return int(digits, 16)


def any_number(text: str) -> set[int]:
    """Return the numbers that a text can mean: decimal, or hexadecimal if it has a mark or a digit of that.

    >>> sorted(any_number("107")), sorted(any_number("6Bh")), sorted(any_number("0x6B"))
    ([107, 263], [107], [107])
    """
    typed = checked_length(text).lower()
    meanings = {int(typed)} if re.fullmatch(r"[-+]?[0-9]{1,18}", typed) else set()
    try:
        meanings.add(hex_number(typed))
    except UnreadableAnswer:
        if not meanings:
            raise UnreadableAnswer(f"{shown(text)} is not a number: expected one such as 42, 2Ah or 0x2A") from None
    return meanings


def typed_bits(text: str) -> list[int]:
    """Return the bits of a text of zeros and ones; blanks, commas and bars between them are for the eye.

    >>> typed_bits("0 1011 0010 1")
    [0, 1, 0, 1, 1, 0, 0, 1, 0, 1]
    """
    digits = re.sub(r"[\s,;|_.]", "", checked_length(text))
    if not digits or set(digits) - set("01"):
        raise UnreadableAnswer(f"{shown(text)}: expected bits, only 0 and 1, in the order of time")
    return [int(digit) for digit in digits]


def typed_octets(text: str) -> bytes:
    """Return bytes in any usual notation of hexadecimal."""
    data = parse_hex(checked_length(text))
    if not data:
        raise UnreadableAnswer("no bytes: expected pairs of hexadecimal digits, such as 01 04 0F B1")
    return data


def typed_words(text: str) -> list[str]:
    """Return the words of an answer with several parts, which blanks, commas or semicolons separate."""
    return [word for word in re.split(r"[\s,;]+", checked_length(text)) if word]


def in_hex(data: bytes) -> str:
    """Return bytes as hexadecimal pairs."""
    return data.hex(" ").upper()
