"""Checks that the description of a user follows the format: each key by `schema.json`, then the keys with each other.

    device.toml, others  -- read_file -->  TomlTable  -- check_description -->  nothing, or the DescriptionError
    of the first wrong key:

    bad.toml:12: parameter 'TEMPERATURE': key 'half': half a register with type 'u16'; expected u8 or i8

The schema has what one key alone must be. This file has what it cannot: whether address and limits fit the type,
whether the device has a function that reads the table, and whether a parameter can have its role in the drive.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from functools import cache, cached_property
from importlib import resources
from itertools import repeat
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from barewire.codecs import codec
from barewire.devices.description.build import KEYS, Numbering, build_parameter, numbering_of, words_of
from barewire.devices.device import ModbusSettings
from barewire.devices.parameter import INTEGER_TYPES, TABLE_NAMES, Parameter, show
from barewire.errors import BarewireError, fold, shown, suggest

Rule: TypeAlias = Mapping[str, Any]
KeyPath: TypeAlias = tuple[str | int, ...]

_DEFAULTS = ModbusSettings()
_TABLES = ("modbus", "canopen", "pdo", "drive", "parameter")
_READ_ROLES = ("status_word", "mode_display", "error_code", "position", "velocity")
"""The roles in a drive whose parameters are read; those of all other roles are written."""


class DescriptionError(BarewireError, ValueError):
    """A device description does not follow the format. The text has file, line, key, and what was expected."""


# The rules of single keys


class Invalid(Exception):
    """A value breaks a rule; the text has what the rule expected."""


@cache
def schema() -> Rule:
    """Return the JSON Schema of the format."""
    content: Rule = json.loads((resources.files(__package__) / "schema.json").read_text("utf-8"))
    return content


def rule_of(name: str) -> Rule:
    """Return a rule of the schema: that of "device", "modbus", "canopen", "pdo", "drive" or "parameter"."""
    rule: Rule = schema()["$defs"][name]
    return rule


_TYPES: dict[str, tuple[type, ...]] = {
    "integer": (int,),
    "number": (int, float),
    "boolean": (bool,),
    "string": (str,),
    "array": (list,),
    "object": (dict,),
}


def check_value(value: Any, rule: Rule) -> None:
    """Check a value against a rule, which may have the keywords that `schema.json` uses. Raises Invalid.

    >>> check_value(3, {"type": "integer", "minimum": 0, "maximum": 2})
    Traceback (most recent call last):
    ...
    barewire.devices.description.check.Invalid: expected a whole number, 0..2
    """
    if "$ref" in rule:
        rule = {**rule_of(rule["$ref"].rpartition("/")[2]), **rule}
    if "anyOf" in rule:  # one number for all tables, or a table of numbers
        number, table = rule["anyOf"]
        check_value(value, table if isinstance(value, dict) else number)
    elif "enum" in rule:
        # The types are compared because True equals 1.
        if not any(type(value) is type(choice) and value == choice for choice in rule["enum"]):
            raise Invalid(f"expected one of {', '.join(map(str, rule['enum']))}")
    elif not _fits(value, rule):
        raise Invalid(f"expected {_expected(rule)}")
    elif isinstance(value, dict):
        _check_entries(value, rule)
    elif isinstance(value, list):
        for item, item_rule in zip(value, rule.get("prefixItems") or repeat(rule["items"])):
            check_value(item, item_rule)


def _fits(value: Any, rule: Rule) -> bool:
    """Return whether type, range, length and form of a value are right."""
    names = rule["type"] if isinstance(rule["type"], list) else [rule["type"]]
    if not any(type(value) in _TYPES[name] for name in names):
        return False
    match value:
        case str():
            return re.search(rule.get("pattern", ""), value) is not None
        case list():
            return bool(rule.get("minItems", 0) <= len(value) <= rule.get("maxItems", len(value)))
        case dict():
            return bool(len(value) >= rule.get("minProperties", 0))
    # TOML has inf and nan, which no key may be; their difference to themselves is not 0.
    return bool(value - value == 0 and rule.get("minimum", value) <= value <= rule.get("maximum", value))


def _expected(rule: Rule) -> str:
    if "title" in rule:
        return str(rule["title"])
    if rule["type"] == "integer":
        return f"a whole number, {rule['minimum']}..{rule['maximum']}"
    return "true or false" if rule["type"] == "boolean" else f"a table with some of {', '.join(rule['properties'])}"


def _check_entries(table: Mapping[str, Any], rule: Rule) -> None:
    names, known = rule.get("propertyNames"), rule.get("properties")
    for key, item in table.items():
        if names is not None and not re.search(names["pattern"], key):
            raise Invalid(f"{key!r} is not {names['title']}")
        if known is not None and key not in known:
            raise Invalid(f"{key!r} is unknown; expected some of {', '.join(known)}")
        try:
            check_value(item, rule["additionalProperties"] if known is None else known[key])
        except Invalid as invalid:
            raise Invalid(f"{key} = {shown(item)}: {invalid}") from None


# Files and their tables


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

    def check(self, rule: Rule) -> None:
        """Check every key. DescriptionError for a key that is unknown, missing or invalid."""
        known = rule["properties"]
        for key in self.items:
            if key not in known:
                near = suggest(key, known) or f"; expected one of {', '.join(known)}"
                raise self.error(key, f"unknown{near}")
        for key in rule.get("required", ()):
            if key not in self.items:
                raise self.error(key, f"missing; expected it in every {self.title.partition(' ')[0] or 'device.toml'}")
        for key, value in self.items.items():
            try:
                check_value(value, known[key])
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


_KEY = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')"""
_DOTTED = rf"{_KEY}(?:[ \t]*\.[ \t]*{_KEY})*"
_HEADER = re.compile(rf"[ \t]*(\[\[?)[ \t]*({_DOTTED})[ \t]*\]")
_ASSIGNMENT = re.compile(rf"[ \t]*({_DOTTED})[ \t]*=")
# Strings and comments, which may contain line ends and brackets, and line ends and brackets; long quotes come first.
_TOKEN = re.compile(
    r'''"""(?:\\.|[^\\])*?"""+|\'\'\'.*?\'\'\'+|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|\#[^\n]*|[\[{]|[\]}]|\n''', re.DOTALL
)


class KeyLines:
    """The lines of the headers and keys of a TOML text that tomllib accepts: tomllib does not keep them.

        1  # a comment                      KeyLines(text).of(("parameter", 0))               -> 2
        2  [[parameter]]                    KeyLines(text).of(("parameter", 0, "half"))       -> 3
        3  half = "L"                       KeyLines(text).of(("parameter", 0, "bits", "5"))  -> 5
        4  [parameter.bits]                 KeyLines(text).of(("parameter", 0, "name"))       -> 2: no such key
        5  5 = "fault"

    A line inside a multi-line string or an array is not taken for a key or a header.
    """

    def __init__(self, text: str) -> None:
        self._text = text

    def of(self, path: KeyPath) -> int:
        """Return the line of that key or table, counted from 1, or of the table around it if it has no line."""
        while path and path not in self._lines:
            path = path[:-1]
        return self._lines.get(path, 1)

    @cached_property  # only an error needs it
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
    line, begin, first_line, depth = 1, 0, 1, 0
    for match in _TOKEN.finditer(text + "\n"):
        token = match[0]
        depth += (token in "[{") - (token in "]}")
        line += token.count("\n")
        if token == "\n" and depth == 0:  # a line end inside of brackets ends no statement
            yield first_line, text[begin : match.start()]
            begin, first_line = match.end(), line


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


# device.toml


def check_description(head: TomlTable, others: Sequence[TomlTable]) -> None:
    """Check the file device.toml and the other files of a device. DescriptionError with file, line and key."""
    # A table of the format is checked by itself below, and one that the format does not define is not checked.
    plain = {
        key: value for key, value in head.items.items() if key not in _TABLES and (key in KEYS or not _is_table(value))
    }
    head._replace(items=plain).check(rule_of("device"))
    modbus = head.table("modbus")
    if modbus is not None:
        modbus.check(rule_of("modbus"))
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


def _check_canopen(head: TomlTable) -> None:
    canopen, pdos = head.table("canopen"), head.tables("pdo")
    if canopen is None:
        if pdos:
            raise head.error("pdo", "the device has no CANopen; expected a table [canopen]")
        return
    canopen.check(rule_of("canopen"))
    node = canopen.items.get("node", 1)
    for pdo in pdos:
        pdo.check(rule_of("pdo"))
        cob_id, bits = pdo.items["cob_id"] + node, sum(bits for _, _, bits in pdo.items["map"])
        if cob_id > 0x7FF:
            raise pdo.error("cob_id", f"with node {node} it is {cob_id:X}h; expected 7FFh at most")
        if bits > 64:
            raise pdo.error("map", f"{bits} bits; a PDO has room for 64")


def _check_drive(drive: TomlTable, parameters: Mapping[str, Parameter]) -> None:
    drive.check(rule_of("drive"))
    for key, name in drive.items.items():
        if isinstance(name, str):  # modes, settle and stays_in_quick_stop are no roles
            _check_role(drive, key, name, parameters)
    if drive.items.get("modes") and "mode" not in drive.items:
        raise drive.error("modes", "no parameter to write them to; expected mode in the same table")


def _check_role(drive: TomlTable, key: str, name: str, parameters: Mapping[str, Parameter]) -> None:
    parameter = parameters.get(fold(name))
    if parameter is None:
        titles = {folded: known.name for folded, known in parameters.items()}
        raise drive.error(key, f"{name!r} is not a parameter of this device{suggest(name, titles, titles.__getitem__)}")
    if key in _READ_ROLES and not parameter.readable:
        raise drive.error(key, f"{parameter.name!r} is write only; expected one that can be read")
    if key not in _READ_ROLES and not parameter.writable:
        raise drive.error(key, f"{parameter.name!r} is read only; expected one that can be written")
    if key in ("status_word", "control_word") and parameter.type != "u16":
        raise drive.error(key, f"{parameter.name!r} is of type {parameter.type!r}; expected u16")
    if parameter.type in ("text", "bool"):
        raise drive.error(key, f"{parameter.name!r} is of type {parameter.type!r}; expected a number")


# A row


def _check_row(row: TomlTable, modbus: TomlTable | None, numbering: Numbering, *, has_canopen: bool) -> Parameter:
    row.check(rule_of("parameter"))
    _check_modbus_address(row, modbus, numbering)
    _check_object(row, has_canopen)
    parameter = build_parameter(row.items, numbering)
    if parameter.modbus is None and parameter.object is None:
        raise row.error("name", f"no address; expected one of {', '.join(TABLE_NAMES)}, or object, or both")
    if parameter.kind == "setting" and parameter.access != "rw":
        raise row.error("kind", f"a setting with access {parameter.access!r}; expected rw")
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
    _check_part(row, "half", "half a register", ("u8", "i8"))
    _check_part(row, "bit", "one bit", ("bool",))
    if "words" in items and type_name != "text":
        raise row.error("words", f"type {type_name!r} has its own width; expected words only with text")
    if type_name == "text":
        if "words" not in items:
            raise row.error("words", "missing; expected how many registers the text takes")
        if "order" in items:
            raise row.error("order", "text has no byte order; expected none")


def _check_part(row: TomlTable, key: str, part: str, types: tuple[str, ...]) -> None:
    if key in row.items and row.items["type"] not in types:
        raise row.error(key, f"{part} with type {row.items['type']!r}; expected {' or '.join(types)}")


def _check_object(row: TomlTable, has_canopen: bool) -> None:
    items = row.items
    if "object" not in items:
        for key in ("sub", "object_bit", "object_type"):
            if key in items:
                raise row.error(key, "belongs to an object; expected object in the same row")
        return
    if not has_canopen:
        raise row.error("object", "the device has no CANopen; expected a table [canopen] in device.toml")
    _check_part(row, "object_bit", "one bit", ("bool",))
    if "object_type" in items:
        kind, wide = items["type"], items["object_type"]
        if kind not in INTEGER_TYPES or kind[0] != wide[0] or codec(wide).size <= codec(kind).size:
            raise row.error("object_type", f"{wide!r} with type {kind!r}; expected a wider {kind[0]} type, or no key")


def _check_numbers(row: TomlTable, parameter: Parameter) -> None:
    """Check that scale, range and default have the right type, fit the parameter's type and agree with each other."""
    low, high, default = parameter.minimum, parameter.maximum, parameter.default
    if parameter.type in ("bool", "text"):
        _check_no_numbers(row, parameter)
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


def _check_no_numbers(row: TomlTable, parameter: Parameter) -> None:
    for key in ("scale", "min", "max"):
        if key in row.items:
            raise row.error(key, f"type {parameter.type!r} has none; expected it only with numbers")
    python_type, expected = (bool, "true or false") if parameter.type == "bool" else (str, "text")
    if parameter.default is not None and not isinstance(parameter.default, python_type):
        raise row.error("default", f"{parameter.default!r}; expected {expected}")


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
        for number in names:
            if not low <= number <= high:
                raise row.error(key, f"{number} is not in {type_name}; expected {low}..{high}")
