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

Checks that a description follows the format: its tables key by key, and then the keys against each other.

The error of a wrong key, and the two functions:

    bad.toml:12: parameter 'TEMPERATURE': key 'half': half a register with type 'u16'; expected u8 or i8

    read_file             one file -> a TomlTable, or a DescriptionError with the line
    check_description     device.toml, its [modbus], [canopen], [[pdo]] and [drive], and every [[parameter]] row:
                          whether address and limits fit the type, whether the device has a function that reads the
                          table, and whether a parameter can have its role in the drive
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from barewire.codecs import codec
from barewire.codecs.order import ORDERS
from barewire.devices.description.build import KEYS, Numbering, build_parameter, numbering_of, words_of
from barewire.devices.device import ModbusSettings, fold, suggest
from barewire.devices.parameter import INTEGER_TYPES, TABLE_NAMES, VALUE_TYPES, Parameter, show
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


_DEFAULTS = ModbusSettings()


def read_file(path: Path) -> TomlTable:
    """Read one TOML file. Raises DescriptionError for a file that cannot be read, or that is not TOML."""
    try:
        content = path.read_bytes().decode("utf-8")
        items = tomllib.loads(content)
    except FileNotFoundError:
        raise DescriptionError(f"{path}:1: no such file; a device is a directory with a device.toml") from None
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise DescriptionError(f"{path}:{line}: not UTF-8; expected TOML, which is always UTF-8") from None
    except OSError as error:
        raise DescriptionError(f"{path}:1: {error.strerror or error}") from None
    except RecursionError:
        raise DescriptionError(f"{path}:1: nested too deeply to be read") from None
    except ValueError as error:  # tomllib's own error, or Python's for a number of 5000 digits
        message = str(error)
        place = re.search(r" \(at (?:line (\d+), column \d+|end of document)\)$", message)
        line = int(place[1]) if place and place[1] else content.count("\n") + 1
        raise DescriptionError(f"{path}:{line}: not TOML: {message[: place.start()] if place else message}") from None
    return TomlTable(str(path), KeyLines(content), (), "", items)


def check_description(head: TomlTable, others: Sequence[TomlTable]) -> None:
    """Check the file device.toml and the other files of a device. DescriptionError with file, line and key."""
    own = {key: value for key, value in head.items.items() if key in KEYS or not _is_table(value)}
    head._replace(items=own).check(DEVICE, ("name", "title"))
    modbus = head.table("modbus")
    if modbus is not None:
        modbus.check(MODBUS)
    _check_canopen(head)
    numbering = numbering_of(modbus.items if modbus is not None else {})
    parameters: dict[str, Parameter] = {}
    rows: dict[str, TomlTable] = {}
    for file in (head, *others):
        if file is not head:
            _check_only_parameters(file)
        for row in file.tables("parameter"):
            parameter = _check_row(row, modbus, numbering, has_canopen="canopen" in head.items)
            key = fold(parameter.name)
            if key in parameters:
                first = f"{rows[key].file}:{rows[key].line('name')}"
                raise row.error("name", f"a second one of this name; expected one, the first is {first}")
            parameters[key], rows[key] = parameter, row
    drive = head.table("drive")
    if drive is not None:
        _check_drive(drive, parameters)


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and value != [] and isinstance(value[0], dict))


def _check_only_parameters(file: TomlTable) -> None:
    for key in file.items:
        if key != "parameter":
            raise file.error(key, "unknown; expected only [[parameter]] here, the rest belongs in device.toml")


# device.toml


def _check_canopen(head: TomlTable) -> None:
    canopen, pdos = head.table("canopen"), head.tables("pdo")
    if canopen is None:
        if pdos:
            raise head.error("pdo", "the device has no CANopen; expected a table [canopen]")
        return
    canopen.check(CANOPEN)
    node = canopen.items.get("node", 1)
    for pdo in pdos:
        pdo.check(PDO, tuple(PDO))
        cob_id, bits = pdo.items["cob_id"] + node, sum(bits for _, _, bits in pdo.items["map"])
        if cob_id > 0x7FF:
            raise pdo.error("cob_id", f"with node {node} it is {cob_id:X}h; expected 7FFh at most")
        if bits > 64:
            raise pdo.error("map", f"{bits} bits; a PDO has room for 64")


def _check_drive(drive: TomlTable, parameters: Mapping[str, Parameter]) -> None:
    drive.check(DRIVE, DRIVE_REQUIRED)
    for key in (*READ_ROLES, *WRITTEN_ROLES):
        if key in drive.items:
            _check_role(drive, key, drive.items[key], parameters)
    if drive.items.get("modes") and "mode" not in drive.items:
        raise drive.error("modes", "no parameter to write them to; expected mode in the same table")


def _check_role(drive: TomlTable, key: str, name: str, parameters: Mapping[str, Parameter]) -> None:
    found = parameters.get(fold(name))
    if found is None:
        titles = {folded: parameter.name for folded, parameter in parameters.items()}
        raise drive.error(key, f"{name!r} is not a parameter of this device{suggest(name, titles, titles.__getitem__)}")
    if key in READ_ROLES and not found.readable:
        raise drive.error(key, f"{found.name!r} is write only; expected one that can be read")
    if key in WRITTEN_ROLES and not found.writable:
        raise drive.error(key, f"{found.name!r} is read only; expected one that can be written")
    if key in DRIVE_REQUIRED and found.type != "u16":
        raise drive.error(key, f"{found.name!r} is of type {found.type!r}; expected u16")
    if found.type in ("text", "bool"):
        raise drive.error(key, f"{found.name!r} is of type {found.type!r}; expected a number")


# A row


def _check_row(row: TomlTable, modbus: TomlTable | None, numbering: Numbering, *, has_canopen: bool) -> Parameter:
    """Check a [[parameter]] table and return its parameter."""
    row.check(PARAMETER, PARAMETER_REQUIRED)
    _check_modbus_address(row, modbus, numbering)
    _check_object(row, has_canopen)
    parameter = build_parameter(row.items, numbering)
    if parameter.modbus is None and parameter.object is None:
        raise row.error("name", f"no address; expected one of {', '.join(TABLE_NAMES)}, or object, or both")
    _check_numbers(row, parameter)
    _check_names(row, parameter)
    return parameter


def _check_modbus_address(row: TomlTable, modbus: TomlTable | None, numbering: Numbering) -> None:
    items = row.items
    given = [table for table in TABLE_NAMES if table in items]
    if len(given) > 1:
        raise row.error(given[1], f"a second table beside {given[0]!r}; expected at most one address on Modbus")
    if not given:
        for key in ("half", "bit", "order", "words"):
            if key in items:
                raise row.error(key, "belongs to a register; expected holding or input in the same row")
        return
    table = given[0]
    if modbus is None:
        raise row.error(table, "the device has no Modbus; expected a table [modbus] in device.toml")
    if items["access"] != "wo" and table not in modbus.items.get("read_functions", _DEFAULTS.read_functions):
        raise row.error(table, f"no function reads it; expected {table!r} in read_functions of [modbus]")
    writable = table in modbus.items.get("write_functions", _DEFAULTS.write_functions)
    if items["access"] != "ro" and not writable and "object" not in items:
        raise row.error("access", f"no function writes table {table!r}; expected ro, or {table!r} in write_functions")
    _check_width(row, table)
    words = words_of(items)
    address = items[table] - numbering.first.get(table, 0)
    if not 0 <= address <= 0x10000 - words:
        raise row.error(table, f"{items[table]} is address {address} on the wire; expected 0..{0x10000 - words}")


def _check_width(row: TomlTable, table: str) -> None:
    """Check that a value of this type can have this address."""
    items = row.items
    type_name = items["type"]
    if table in ("coil", "discrete"):
        if type_name != "bool":
            raise row.error("type", f"{type_name!r} in table {table!r}; expected bool")
        for key in ("half", "bit", "order", "words"):
            if key in items:
                raise row.error(key, f"a {table} is one bit already; expected it only with holding or input")
    if "half" in items and type_name not in ("u8", "i8"):
        raise row.error("half", f"half a register with type {type_name!r}; expected u8 or i8")
    if "bit" in items and type_name != "bool":
        raise row.error("bit", f"one bit with type {type_name!r}; expected bool")
    if "words" in items and type_name != "text":
        raise row.error("words", f"type {type_name!r} has its own width; expected words only with text")
    if type_name == "text":
        if "words" not in items:
            raise row.error("words", "missing; expected how many registers the text takes")
        if "order" in items:
            raise row.error("order", "text has no byte order; expected none")


def _check_object(row: TomlTable, has_canopen: bool) -> None:
    items = row.items
    if "object" not in items:
        for key in ("sub", "object_bit", "object_type"):
            if key in items:
                raise row.error(key, "belongs to an object; expected object in the same row")
        return
    if not has_canopen:
        raise row.error("object", "the device has no CANopen; expected a table [canopen] in device.toml")
    if "object_bit" in items and items["type"] != "bool":
        raise row.error("object_bit", f"one bit with type {items['type']!r}; expected bool")
    if "object_type" in items:
        kind, wide = items["type"], items["object_type"]
        if kind not in INTEGER_TYPES or kind[0] != wide[0] or codec(wide).size <= codec(kind).size:
            raise row.error("object_type", f"{wide!r} with type {kind!r}; expected a wider {kind[0]} type, or no key")


def _check_numbers(row: TomlTable, parameter: Parameter) -> None:
    """Check that scale, range and default have the right type, fit the parameter's type and agree with each other."""
    type_name, low, high, default = parameter.type, parameter.minimum, parameter.maximum, parameter.default
    if type_name in ("bool", "text"):
        for key in ("scale", "min", "max"):
            if key in row.items:
                raise row.error(key, f"type {type_name!r} has none; expected it only with numbers")
        if default is not None and not isinstance(default, bool if type_name == "bool" else str):
            raise row.error("default", f"{default!r}; expected {'true or false' if type_name == 'bool' else 'text'}")
        return
    if isinstance(default, (bool, str, bytes)):
        raise row.error("default", f"{default!r}; expected a number")
    for key, limit in (("min", low), ("max", high), ("default", default)):
        if limit is not None:
            _check_fits(row, parameter, key, limit)
    if low is not None and high is not None and low > high:
        raise row.error("min", f"{show(low)} is above max; expected at most {show(high)}")
    outside = default is not None and not ((low is None or low <= default) and (high is None or default <= high))
    if outside and not parameter.note:
        raise row.error("default", f"{show(default or 0)} is outside min..max; expected it inside, or a note why not")


def _check_fits(row: TomlTable, parameter: Parameter, key: str, value: int | float) -> None:
    limits = codec(parameter.type)
    raw = Fraction(value) / parameter.scale
    # A decimal such as 655.35 has no exact binary form: a thousandth of a step more or less is accepted.
    slack = Fraction(1, 1000)
    if not limits.minimum - slack <= raw <= limits.maximum + slack:
        low, high = (show(parameter.from_raw(limit)) for limit in (limits.minimum, limits.maximum))
        raise row.error(key, f"{show(value)} does not fit {parameter.type}; expected {low}..{high}")
    if key == "default" and not limits.is_float and abs(raw - round(raw)) > slack:
        raise row.error(key, f"{show(value)} falls between two steps of {show(float(parameter.scale))}")


def _check_names(row: TomlTable, parameter: Parameter) -> None:
    """Check that `values` and `bits` name only numbers that the type has."""
    type_name = parameter.type
    for key, names in (("values", parameter.values), ("bits", parameter.bits)):
        if not names:
            continue
        if type_name not in (INTEGER_TYPES if key == "bits" else ("bool", *INTEGER_TYPES)):
            raise row.error(key, f"type {type_name!r} has no such names; expected a whole-number type")
        low, high = (0, 1) if type_name == "bool" else (int(codec(type_name).minimum), int(codec(type_name).maximum))
        if key == "bits":
            low, high = 0, codec(type_name).bits - 1
        for named in names:
            if not low <= named <= high:
                raise row.error(key, f"{named} is not in {type_name}; expected {low}..{high}")
