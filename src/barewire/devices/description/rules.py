"""The rules of the description format for single keys, and the tables that they are applied to.

The parts:

    TomlTable                one table of a file; its errors have file, line, table and key
    rule(value)              a check of one value; raises Invalid("expected ...")
    table.check(rules)       all keys of a table: known, present, valid

    DEVICE, MODBUS, CANOPEN, PDO, DRIVE, PARAMETER       key -> rule, for each table of the format

Line numbers of the headers and keys of a TOML text, for error messages: tomllib does not keep them.

    1  # a comment                      KeyLines(text).of(("parameter", 0))               -> 2
    2  [[parameter]]                    KeyLines(text).of(("parameter", 0, "half"))       -> 3
    3  half = "L"                       KeyLines(text).of(("parameter", 0, "bits", "5"))  -> 5
    4  [parameter.bits]                 KeyLines(text).of(("parameter", 0, "name"))       -> 2, its table: no such key
    5  5 = "fault"

Only for texts that tomllib accepts; its error for any other text has a line. A line inside a multi-line string or an
array is not taken for a key or a header. The text is searched at the first call of `of` only.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

from barewire.codecs.order import ORDERS
from barewire.devices.device import suggest
from barewire.devices.parameter import INTEGER_TYPES, TABLE_NAMES, VALUE_TYPES
from barewire.devices.sdo_dialects import DIALECTS
from barewire.errors import BarewireError, shown

KeyPath: TypeAlias = tuple[str | int, ...]

_KEY = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')"""
_DOTTED = rf"{_KEY}(?:[ \t]*\.[ \t]*{_KEY})*"
_HEADER = re.compile(rf"[ \t]*(\[\[?)[ \t]*({_DOTTED})[ \t]*\]")
_ASSIGNMENT = re.compile(rf"[ \t]*({_DOTTED})[ \t]*=")
# Strings and comments, which may contain line ends and brackets, and line ends and brackets; long quotes come first.
_TOKEN = re.compile(
    r'''"""(?:\\.|[^\\])*?"""+|\'\'\'.*?\'\'\'+|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|\#[^\n]*|[\[{]|[\]}]|\n''', re.DOTALL
)


class KeyLines:
    """The lines of the headers and keys of one TOML text."""

    def __init__(self, text: str) -> None:
        self._text = text

    def of(self, path: KeyPath) -> int:
        """Return the line of that key or table, counted from 1, or of the table around it if it has no line."""
        while path and path not in self._lines:
            path = path[:-1]
        return self._lines.get(path, 1)

    @cached_property
    def _lines(self) -> dict[KeyPath, int]:
        lines: dict[KeyPath, int] = {}
        counts: dict[KeyPath, int] = {}
        table: KeyPath = ()
        for line, statement in _statements(self._text):
            if header := _HEADER.match(statement):
                table = _header_path(_parts(header[2]), counts)
                if header[1] == "[[":
                    counts[table] = counts.get(table, -1) + 1
                    lines.setdefault(table, line)
                    table = (*table, counts[table])
                lines.setdefault(table, line)
            elif assignment := _ASSIGNMENT.match(statement):
                path = table
                for part in _parts(assignment[1]):
                    path = (*path, part)
                    lines.setdefault(path, line)
        return lines


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Yield each header and each assignment with the line on which it begins."""
    line, begin, begun_at, depth = 1, 0, 1, 0
    for token in _TOKEN.finditer(text + "\n"):
        found = token[0]
        depth += (found in "[{") - (found in "]}")
        line += found.count("\n")
        if found == "\n" and depth == 0:
            yield begun_at, text[begin : token.start()]
            begin, begun_at = token.end(), line


def _parts(dotted: str) -> list[str]:
    return [part.strip("\"'") for part in re.findall(_KEY, dotted)]


def _header_path(parts: list[str], counts: dict[KeyPath, int]) -> KeyPath:
    """Return the path of a header: [parameter.bits] belongs to the latest [[parameter]]."""
    path: KeyPath = ()
    for place, part in enumerate(parts):
        path = (*path, part)
        if path in counts and place < len(parts) - 1:
            path = (*path, counts[path])
    return path


class DescriptionError(BarewireError, ValueError):
    """A device description does not follow the format. The text has file, line, key, and what was expected."""


class Invalid(Exception):
    """A value breaks a rule; the text has what the rule expected."""


KeyRule: TypeAlias = Callable[[Any], None]


class TomlTable(NamedTuple):
    """One table: its file, its path in the file, the title that errors give it, and its items."""

    file: str
    lines: KeyLines
    path: KeyPath
    title: str
    items: Mapping[str, Any]

    def line(self, key: str) -> int:
        """Return the line of a key, or of the table if the key is missing."""
        return self.lines.of((*self.path, key))

    def error(self, key: str, text: str) -> DescriptionError:
        """Return the error for one key, with its file and line."""
        title = f"{self.title}: " if self.title else ""
        return DescriptionError(f"{self.file}:{self.line(key)}: {title}key {key!r}: {text}")

    def check(self, rules: Mapping[str, KeyRule], required: Sequence[str] = ()) -> None:
        """Check every key. DescriptionError for a key that is unknown, missing or invalid."""
        for key in self.items:
            if key not in rules:
                near = suggest(key, rules) or f"; expected one of {', '.join(rules)}"
                raise self.error(key, f"unknown{near}")
        for key in required:
            if key not in self.items:
                raise self.error(key, f"missing; expected it in every {self.title.partition(' ')[0] or 'device.toml'}")
        for key, value in self.items.items():
            try:
                rules[key](value)
            except Invalid as invalid:
                raise self.error(key, f"{shown(value)}: {invalid}") from None

    def table(self, key: str) -> TomlTable | None:
        """Return the table [key] in this one, None if there is none."""
        items = self.items.get(key)
        if items is None:
            return None
        if not isinstance(items, dict):
            raise self.error(key, f"expected a table [{key}]")
        return TomlTable(self.file, self.lines, (*self.path, key), f"[{key}]", items)

    def tables(self, key: str) -> list[TomlTable]:
        """Return the tables [[key]] in this one."""
        rows = self.items.get(key, [])
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise self.error(key, f"expected [[{key}]] tables")
        return [
            TomlTable(self.file, self.lines, (*self.path, key, number), f"{key} {row.get('name', number + 1)!r}", row)
            for number, row in enumerate(rows)
        ]


# Rules


def text(value: Any) -> None:
    """Accept text that is not blank."""
    if not isinstance(value, str) or not value.strip():
        raise Invalid("expected text, not empty")


def any_text(value: Any) -> None:
    """Accept any text, also empty text."""
    if not isinstance(value, str):
        raise Invalid("expected text")


def texts(value: Any) -> None:
    """Accept a list of texts."""
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise Invalid("expected a list of texts")


def boolean(value: Any) -> None:
    """Accept true or false."""
    if not isinstance(value, bool):
        raise Invalid("expected true or false")


def finite_number(value: Any) -> None:
    """Accept a finite number: TOML has inf and nan too."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value - value != 0:
        raise Invalid("expected a number")


def scalar(value: Any) -> None:
    """Accept a default; `check.py` compares it with the type of the parameter."""
    if not isinstance(value, (bool, str)):
        finite_number(value)


def short_time(value: Any) -> None:
    """Accept a time of up to a minute."""
    finite_number(value)
    if not 0 <= value <= 60:
        raise Invalid("expected seconds, 0..60")


def whole(low: int, high: int) -> KeyRule:
    """Return a rule for a whole number within limits."""

    def rule(value: Any) -> None:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise Invalid(f"expected a whole number, {low}..{high}")

    return rule


def one_of(*choices: str | int) -> KeyRule:
    """Return a rule for one of a few words or numbers."""

    def rule(value: Any) -> None:
        if isinstance(value, bool) or value not in choices:
            raise Invalid(f"expected one of {', '.join(map(str, choices))}")

    return rule


def fraction(value: Any) -> None:
    """Accept a scale: "1/10" or "0.1", as text, since a binary 0.1 would not be a tenth."""
    # Python accepts "1e999999" too, and takes long to compute it.
    form = r"[0-9]{1,20}(/0*[1-9][0-9]{0,19}|\.[0-9]{1,20})?"
    if not (isinstance(value, str) and re.fullmatch(form, value) and Fraction(value) > 0):
        raise Invalid('expected a fraction or a decimal above 0, as text: "1/10"')


def numbered_texts(value: Any) -> None:
    """Accept { 0 = "text" }: the keys of TOML are text, and these must be whole numbers in decimal."""
    if not isinstance(value, dict) or not value:
        raise Invalid('expected a table of numbers and texts: { 0 = "off" }')
    for key, title in value.items():
        if not re.fullmatch(r"0|-?[1-9][0-9]{0,24}", key):
            raise Invalid(f"{key!r} is not a whole number in decimal")
        if not isinstance(title, str) or not title.strip():
            raise Invalid(f"{shown(title)} for {key}: expected text, not empty")


def table_of(rules: Mapping[str, KeyRule]) -> KeyRule:
    """Return a rule for an inline table with these keys."""

    def rule(value: Any) -> None:
        if not isinstance(value, dict):
            raise Invalid(f"expected a table with some of {', '.join(rules)}")
        for key, item in value.items():
            if key not in rules:
                raise Invalid(f"{key!r} is unknown; expected some of {', '.join(rules)}")
            try:
                rules[key](item)
            except Invalid as invalid:
                raise Invalid(f"{key} = {shown(item)}: {invalid}") from None

    return rule


def list_of(item_rule: KeyRule, least: int, most: int) -> KeyRule:
    """Return a rule for a list in which every item follows `item_rule`."""

    def rule(value: Any) -> None:
        if not isinstance(value, list) or not least <= len(value) <= most:
            raise Invalid(f"expected a list of {least} to {most}")
        for item in value:
            item_rule(item)

    return rule


PRINTED_MAX = 465_536
"""The largest number that manuals print for an address: 400001 is the first holding register in some of them."""


def each_of(*names: str) -> KeyRule:
    """Return a rule for one whole number for all of these names, or a table with a number for some of them."""
    number_rule = whole(0, PRINTED_MAX)
    table_rule = table_of(dict.fromkeys(names, number_rule))

    def rule(value: Any) -> None:
        (table_rule if isinstance(value, dict) else number_rule)(value)

    return rule


def mapping_entry(value: Any) -> None:
    """Accept an entry of a PDO mapping: [index, sub-index, bits]."""
    ranges = (whole(1, 0xFFFF), whole(0, 0xFF), whole(1, 64))
    if not isinstance(value, list) or len(value) != len(ranges):
        raise Invalid("expected [index, sub-index, bits] in each place")
    for rule, item in zip(ranges, value):
        rule(item)


def printed(value: Any) -> None:
    """Accept { field = "text of the manual" }.

    `range` is min and max in one text; the prefix `canopen_` or `modbus_` names the manual.
    """
    if not isinstance(value, dict):
        raise Invalid('expected a table of fields and texts: { max = "4.2E10" }')
    for key, words in value.items():
        if key.removeprefix("canopen_").removeprefix("modbus_") not in (*PARAMETER, "range"):
            raise Invalid(f"{key!r} is not a field; expected range or a key of the row, or canopen_ or modbus_ and one")
        if not isinstance(words, str):
            raise Invalid(f"{key} = {shown(words)}: expected text, as it is printed")


# Tables


def anything(value: Any) -> None:
    """Accept anything: a table that `check.py` checks by itself."""


_BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)

DEVICE: dict[str, KeyRule] = {
    "name": text,
    "title": text,
    "documents": texts,
    **dict.fromkeys(("modbus", "canopen", "pdo", "drive", "parameter"), anything),
}

MODBUS: dict[str, KeyRule] = {
    "unit": whole(0, 255),
    "port": whole(1, 0xFFFF),
    "first_register": each_of("holding", "input"),
    "first_coil": each_of("coil", "discrete"),
    "order": one_of(*ORDERS),
    "read_limit": whole(1, 125),
    "write_limit": whole(1, 123),
    "read_functions": table_of(
        {"holding": one_of(3, 4), "input": one_of(3, 4), "coil": one_of(1, 2), "discrete": one_of(1, 2)}
    ),
    "write_functions": table_of({"holding": list_of(one_of(6, 16), 1, 2), "coil": list_of(one_of(5, 15), 1, 2)}),
}

CANOPEN: dict[str, KeyRule] = {
    "node": whole(1, 127),
    "bitrate": one_of(*_BITRATES),
    "dialect": one_of(*DIALECTS),
}
PDO: dict[str, KeyRule] = {
    "name": text,
    "cob_id": whole(0x80, 0x7FF),
    "transmission": whole(0, 255),
    "map": list_of(mapping_entry, 0, 64),
}

READ_ROLES = ("status_word", "mode_display", "error_code", "position", "velocity")
"""The roles in a drive whose parameters are read."""
WRITTEN_ROLES = (
    *("control_word", "mode", "target_position", "target_velocity", "profile_velocity"),
    *("acceleration", "deceleration", "homing_method", "homing_speed_switch", "homing_speed_zero"),
)
DRIVE: dict[str, KeyRule] = {
    **dict.fromkeys((*READ_ROLES, *WRITTEN_ROLES), text),
    "modes": table_of(dict.fromkeys(("position", "velocity", "homing"), whole(-128, 127))),
    "stays_in_quick_stop": boolean,
    "settle": short_time,
}
DRIVE_REQUIRED = ("status_word", "control_word")

PARAMETER: dict[str, KeyRule] = {
    "name": text,
    "type": one_of(*VALUE_TYPES),
    **dict.fromkeys(TABLE_NAMES, whole(0, PRINTED_MAX + 0xFFFF)),
    "half": one_of("L", "H"),
    "bit": whole(0, 15),
    "order": one_of(*ORDERS),
    "words": whole(1, 125),
    "object": whole(1, 0xFFFF),
    "sub": whole(0, 0xFF),
    "object_bit": whole(0, 31),
    "object_type": one_of(*INTEGER_TYPES),
    "access": one_of("ro", "rw", "wo"),
    "unit": any_text,
    "scale": fraction,
    "default": scalar,
    "min": finite_number,
    "max": finite_number,
    "values": numbered_texts,
    "bits": numbered_texts,
    "firmware": text,
    "storable": boolean,
    "group": text,
    "answered": boolean,
    "note": text,
    "printed": printed,
}
PARAMETER_REQUIRED = ("name", "type", "access")
