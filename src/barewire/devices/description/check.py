"""Checks that a description follows the format: its tables key by key, and then the keys against each other.

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
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

from barewire.codecs import codec
from barewire.devices.description import rules
from barewire.devices.description.build import KEYS, Numbering, build_parameter, numbering_of, words_of
from barewire.devices.description.rules import DescriptionError, KeyLines, TomlTable
from barewire.devices.device import ModbusSettings, fold, suggest
from barewire.devices.parameter import INTEGER_TYPES, TABLE_NAMES, Parameter, show

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
    head._replace(items=own).check(rules.DEVICE, ("name", "title"))
    modbus = head.table("modbus")
    if modbus is not None:
        modbus.check(rules.MODBUS)
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
    canopen.check(rules.CANOPEN)
    node = canopen.items.get("node", 1)
    for pdo in pdos:
        pdo.check(rules.PDO, tuple(rules.PDO))
        cob_id, bits = pdo.items["cob_id"] + node, sum(bits for _, _, bits in pdo.items["map"])
        if cob_id > 0x7FF:
            raise pdo.error("cob_id", f"with node {node} it is {cob_id:X}h; expected 7FFh at most")
        if bits > 64:
            raise pdo.error("map", f"{bits} bits; a PDO has room for 64")


def _check_drive(drive: TomlTable, parameters: Mapping[str, Parameter]) -> None:
    drive.check(rules.DRIVE, rules.DRIVE_REQUIRED)
    for key in (*rules.READ_ROLES, *rules.WRITTEN_ROLES):
        if key in drive.items:
            _check_role(drive, key, drive.items[key], parameters)
    if drive.items.get("modes") and "mode" not in drive.items:
        raise drive.error("modes", "no parameter to write them to; expected mode in the same table")


def _check_role(drive: TomlTable, key: str, name: str, parameters: Mapping[str, Parameter]) -> None:
    found = parameters.get(fold(name))
    if found is None:
        titles = {folded: parameter.name for folded, parameter in parameters.items()}
        raise drive.error(key, f"{name!r} is not a parameter of this device{suggest(name, titles, titles.__getitem__)}")
    if key in rules.READ_ROLES and not found.readable:
        raise drive.error(key, f"{found.name!r} is write only; expected one that can be read")
    if key in rules.WRITTEN_ROLES and not found.writable:
        raise drive.error(key, f"{found.name!r} is read only; expected one that can be written")
    if key in rules.DRIVE_REQUIRED and found.type != "u16":
        raise drive.error(key, f"{found.name!r} is of type {found.type!r}; expected u16")
    if found.type in ("text", "bool"):
        raise drive.error(key, f"{found.name!r} is of type {found.type!r}; expected a number")


# A row


def _check_row(row: TomlTable, modbus: TomlTable | None, numbering: Numbering, *, has_canopen: bool) -> Parameter:
    """Check a [[parameter]] table and return its parameter."""
    row.check(rules.PARAMETER, rules.PARAMETER_REQUIRED)
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
