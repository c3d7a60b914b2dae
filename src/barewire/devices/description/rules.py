"""Whether a table of a description is as the format says: every key known, every value fit, none missing.

    Block                    one table of a file, which knows how to say where it is wrong
    rule(value) -> value     one key; raises Unfit("expected ...")
    block.read(rules)        all keys of the table; DescriptionError("FILE:LINE: parameter 'NAME': key 'half': ...")

I know: tables, keys, types, lines.  I never know: what a register is.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple, TypeAlias

from barewire.devices.description.line_numbers import KeyLines, Path
from barewire.devices.device import suggest
from barewire.errors import BarewireError, shown


class DescriptionError(BarewireError, ValueError):
    """A device description is not as the format says. The text names file, line and key, and what was expected."""


class Unfit(Exception):
    """A rule's verdict on a value: what it expected."""


Rule: TypeAlias = Callable[[Any], Any]


class TomlTable(NamedTuple):
    """One table: in which file and where, what to call it, and what it holds."""

    file: str
    lines: KeyLines
    path: Path
    title: str
    items: Mapping[str, Any]

    def error(self, key: str, text: str) -> DescriptionError:
        """What is wrong with one key, with the place where it stands."""
        line = self.lines.of((*self.path, key))
        title = f"{self.title}: " if self.title else ""
        return DescriptionError(f"{self.file}:{line}: {title}key {key!r}: {text}")

    def read(self, rules: Mapping[str, Rule], required: Sequence[str] = ()) -> dict[str, Any]:
        """The values as the rules turn them. DescriptionError for a key unknown, missing or unfit."""
        for key in self.items:
            if key not in rules:
                near = suggest(key, rules) or f"; expected one of {', '.join(rules)}"
                raise self.error(key, f"unknown{near}")
        for key in required:
            if key not in self.items:
                raise self.error(key, f"missing; expected it in every {self.title.partition(' ')[0] or 'device.toml'}")
        values = {}
        for key, value in self.items.items():
            try:
                values[key] = rules[key](value)
            except Unfit as unfit:
                raise self.error(key, f"{shown(value)}: {unfit}") from None
        return values


# The rules


def text(value: Any) -> str:
    """Text that says something."""
    if not isinstance(value, str) or not value.strip():
        raise Unfit("expected text, not empty")
    return value


def any_text(value: Any) -> str:
    """Text that may be empty."""
    if not isinstance(value, str):
        raise Unfit("expected text")
    return value


def texts(value: Any) -> tuple[str, ...]:
    """A list of texts."""
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise Unfit("expected a list of texts")
    return tuple(value)


def truth(value: Any) -> bool:
    """true or false."""
    if not isinstance(value, bool):
        raise Unfit("expected true or false")
    return value


def number(value: Any) -> int | float:
    """A number that is one: TOML has inf and nan too."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value - value != 0:
        raise Unfit("expected a number")
    return value


def scalar(value: Any) -> int | float | bool | str:
    """A default: which of these it may be depends on the type of the parameter."""
    return value if isinstance(value, (bool, str)) else number(value)


def whole(low: int, high: int) -> Rule:
    """A whole number within limits."""

    def rule(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise Unfit(f"expected a whole number, {low}..{high}")
        return value

    return rule


def one_of(*choices: str | int) -> Rule:
    """One of a few words or numbers."""

    def rule(value: Any) -> str | int:
        if isinstance(value, bool) or value not in choices:
            raise Unfit(f"expected one of {', '.join(map(str, choices))}")
        chosen: str | int = value
        return chosen

    return rule


def fraction(value: Any) -> Fraction:
    """A scale: "1/10" or "0.1", as text, since a binary 0.1 would not be a tenth."""
    # Python would take "1e999999" too, and be busy with it for a while.
    if isinstance(value, str) and re.fullmatch(r"[0-9]{1,20}(/0*[1-9][0-9]{0,19}|\.[0-9]{1,20})?", value):
        found = Fraction(value)
        if found > 0:
            return found
    raise Unfit('expected a fraction or a decimal above 0, as text: "1/10"')


def numbered(value: Any) -> dict[int, str]:
    """{ 0 = "text" }: TOML keys are text, these must be whole numbers in decimal."""
    if not isinstance(value, dict) or not value:
        raise Unfit('expected a table of numbers and texts: { 0 = "off" }')
    found = {}
    for key, title in value.items():
        if str(key) != str(_decimal(key)):
            raise Unfit(f"{key!r} is no whole number in decimal")
        if not isinstance(title, str) or not title.strip():
            raise Unfit(f"{shown(title)} for {key}: expected text, not empty")
        found[int(key)] = title
    return found


def _decimal(key: str) -> int | None:
    try:
        return int(key)
    except ValueError:
        return None


def table_of(rules: Mapping[str, Rule]) -> Rule:
    """An inline table with keys of its own."""

    def rule(value: Any) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise Unfit(f"expected a table with some of {', '.join(rules)}")
        found = {}
        for key, item in value.items():
            if key not in rules:
                raise Unfit(f"{key!r} is unknown; expected some of {', '.join(rules)}")
            try:
                found[key] = rules[key](item)
            except Unfit as unfit:
                raise Unfit(f"{key} = {shown(item)}: {unfit}") from None
        return found

    return rule


PRINTED_MAX = 465_536
"""The largest number that manuals print for a place: 400001 is the first holding register of some of them."""


def each_of(*names: str) -> Rule:
    """One whole number for all of these names, or a table with a number for some of them."""
    number = whole(0, PRINTED_MAX)
    numbers = table_of(dict.fromkeys(names, number))

    def rule(value: Any) -> Any:
        return numbers(value) if isinstance(value, dict) else dict.fromkeys(names, number(value))

    return rule


def list_of(item_rule: Rule, least: int, most: int) -> Rule:
    """A list whose every item follows one rule."""

    def rule(value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list) or not least <= len(value) <= most:
            raise Unfit(f"expected a list of {least} to {most}")
        return tuple(item_rule(item) for item in value)

    return rule
