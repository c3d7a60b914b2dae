"""One [[parameter]] row -> a Parameter. Here the printed number becomes the address on the wire.

    holding = 1001            first_register = 0     ->  ModbusAt("holding", 1001)     CSD MT counts as the wire does
    input = 25                first_register = 1     ->  ModbusAt("input", 24)         AZ3 counts from 1
    object = 0x6041           sub = 0                ->  ObjectAt(0x6041, 0)

A row is checked key by key (`check.py`), then as a whole: does the place fit the type, do the limits, does the
device have a function that reads this table.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from types import MappingProxyType
from typing import Any, NamedTuple, cast

from barewire.codecs import ORDERS, codec
from barewire.codecs.order import Order
from barewire.devices.description.rules import (
    PRINTED_MAX,
    Rule,
    TomlTable,
    Unfit,
    any_text,
    fraction,
    number,
    numbered,
    one_of,
    scalar,
    text,
    truth,
    whole,
)
from barewire.devices.device import ModbusSettings
from barewire.devices.parameter import ModbusAt, ObjectAt, Parameter, TableName, show
from barewire.errors import shown

TABLES: tuple[TableName, ...] = ("holding", "input", "coil", "discrete")
INTEGERS = ("u8", "u16", "u32", "u64", "i8", "i16", "i32", "i64")
TYPES = ("bool", *INTEGERS, "f32", "f64", "text")


def printed(value: Any) -> dict[str, str]:
    """field -> what the manual prints there; `range` is min and max in one, `canopen_` or `modbus_` tells whose."""
    if not isinstance(value, dict):
        raise Unfit('expected a table of fields and texts: { max = "4.2E10" }')
    for key, says in value.items():
        if key.removeprefix("canopen_").removeprefix("modbus_") not in (*RULES, "range"):
            raise Unfit(f"{key!r} is no field; expected a key of the row, or range, maybe behind canopen_ or modbus_")
        if not isinstance(says, str):
            raise Unfit(f"{key} = {shown(says)}: expected text, as it is printed")
    return value


RULES: dict[str, Rule] = {
    "name": text,
    "type": one_of(*TYPES),
    **{table: whole(0, PRINTED_MAX + 0xFFFF) for table in TABLES},
    "half": one_of("L", "H"),
    "bit": whole(0, 15),
    "order": one_of(*ORDERS),
    "words": whole(1, 125),
    "object": whole(1, 0xFFFF),
    "sub": whole(0, 0xFF),
    "object_bit": whole(0, 31),
    "access": one_of("ro", "rw", "wo"),
    "unit": any_text,
    "scale": fraction,
    "default": scalar,
    "min": number,
    "max": number,
    "values": numbered,
    "bits": numbered,
    "firmware": text,
    "storable": truth,
    "answered": truth,
    "note": text,
    "printed": printed,
}
REQUIRED = ("name", "type", "access")


class Counting(NamedTuple):
    """How the device counts and orders: what the rows leave out because it is the same for all."""

    first: Mapping[str, int] = MappingProxyType({})
    """For each table the printed number that is address 0 on the wire; 0 if it is not said."""

    order: Order = "ABCD"


def read_row(block: TomlTable, modbus: ModbusSettings | None, counting: Counting, has_canopen: bool) -> Parameter:
    """The row as a Parameter, or a DescriptionError."""
    row = block.read(RULES, REQUIRED)
    parameter = Parameter(
        name=" ".join(row["name"].split()),
        type=row["type"],
        unit=row.get("unit", ""),
        scale=row.get("scale", Fraction(1)),
        default=row.get("default"),
        minimum=row.get("min"),
        maximum=row.get("max"),
        access=row["access"],
        values=MappingProxyType(row.get("values", {})),
        bits=MappingProxyType(row.get("bits", {})),
        firmware=row.get("firmware", ""),
        storable=row.get("storable"),
        answered=row.get("answered", True),
        note=row.get("note", ""),
        printed=MappingProxyType(row.get("printed", {})),
        modbus=_modbus_place(block, row, modbus, counting),
        object=_object_place(block, row, has_canopen),
    )
    if parameter.modbus is None and parameter.object is None:
        raise block.error("name", f"no place; expected one of {', '.join(TABLES)}, or object, or both")
    _check_numbers(block, parameter)
    _check_names(block, parameter)
    return parameter


def _modbus_place(
    block: TomlTable, row: dict[str, Any], side: ModbusSettings | None, counting: Counting
) -> ModbusAt | None:
    given = [table for table in TABLES if table in row]
    kind = row["type"]
    if len(given) > 1:
        raise block.error(given[1], f"a second table beside {given[0]!r}; expected one place on Modbus at most")
    if not given:
        for key in ("half", "bit", "order", "words"):
            if key in row:
                raise block.error(key, "belongs to a register; expected holding or input in the same row")
        return None
    table = given[0]
    if side is None:
        raise block.error(table, "the device has no Modbus; expected a table [modbus] in device.toml")
    if row["access"] != "wo" and table not in side.read_functions:
        raise block.error(table, f"nothing reads it; expected {table!r} in read_functions of [modbus]")
    if row["access"] != "ro" and table not in side.write_functions and "object" not in row:
        raise block.error("access", f"nothing writes table {table!r}; expected ro, or {table!r} in write_functions")
    words = _words(block, row, table)
    address = row[table] - counting.first.get(table, 0)
    if not 0 <= address <= 0x10000 - words:
        raise block.error(table, f"{row[table]} is address {address} on the wire; expected 0..{0x10000 - words}")
    if kind == "text" or table in ("coil", "discrete"):
        return ModbusAt(table, address, words)
    return ModbusAt(table, address, words, row.get("half"), row.get("bit"), row.get("order", counting.order))


def _words(block: TomlTable, row: dict[str, Any], table: TableName) -> int:
    """How many entries of the table the value takes, after a look at whether it can lie there at all."""
    kind = row["type"]
    if table in ("coil", "discrete"):
        if kind != "bool":
            raise block.error("type", f"{kind!r} in table {table!r}; expected bool")
        for key in ("half", "bit", "order", "words"):
            if key in row:
                raise block.error(key, f"a {table} is one bit already; expected it only with holding or input")
    if "half" in row and kind not in ("u8", "i8"):
        raise block.error("half", f"half a register with type {kind!r}; expected u8 or i8")
    if "bit" in row and kind != "bool":
        raise block.error("bit", f"one bit with type {kind!r}; expected bool")
    if "words" in row and kind != "text":
        raise block.error("words", f"type {kind!r} has its own width; expected words only with text")
    if kind == "text":
        if "words" not in row:
            raise block.error("words", "missing; expected how many registers the text takes")
        if "order" in row:
            raise block.error("order", "text has no byte order; expected none")
        return cast(int, row["words"])
    return 1 if kind == "bool" else max(1, codec(kind).size // 2)


def _object_place(block: TomlTable, row: dict[str, Any], has_canopen: bool) -> ObjectAt | None:
    if "object" not in row:
        for key in ("sub", "object_bit"):
            if key in row:
                raise block.error(key, "belongs to an object; expected object in the same row")
        return None
    if not has_canopen:
        raise block.error("object", "the device has no CANopen; expected a table [canopen] in device.toml")
    if "object_bit" in row and row["type"] != "bool":
        raise block.error("object_bit", f"one bit with type {row['type']!r}; expected bool")
    return ObjectAt(row["object"], row.get("sub", 0), row.get("object_bit"))


def _check_numbers(block: TomlTable, parameter: Parameter) -> None:
    """Scale, range and default: of the right kind, within the type, and within each other."""
    kind, low, high, default = parameter.type, parameter.minimum, parameter.maximum, parameter.default
    if kind in ("bool", "text"):
        for key in ("scale", "min", "max"):
            if key in block.items:
                raise block.error(key, f"type {kind!r} has none; expected it only with numbers")
        if default is not None and not isinstance(default, bool if kind == "bool" else str):
            raise block.error("default", f"{default!r}; expected {'true or false' if kind == 'bool' else 'text'}")
        return
    if isinstance(default, (bool, str, bytes)):
        raise block.error("default", f"{default!r}; expected a number")
    for key, limit in (("min", low), ("max", high), ("default", default)):
        if limit is not None:
            _check_fits(block, parameter, key, limit)
    if low is not None and high is not None and low > high:
        raise block.error("min", f"{show(low)} is above max; expected at most {show(high)}")
    outside = default is not None and not ((low is None or low <= default) and (high is None or default <= high))
    if outside and not parameter.note:
        raise block.error("default", f"{show(default or 0)} is outside min..max; expected it inside, or a note why not")


def _check_fits(block: TomlTable, parameter: Parameter, key: str, value: int | float) -> None:
    limits = codec(parameter.type)
    raw = Fraction(value) / parameter.scale
    # A binary 655.35 is not quite 65535 hundredths: within a thousandth of a step it is meant to be.
    slack = Fraction(1, 1000)
    if not limits.minimum - slack <= raw <= limits.maximum + slack:
        low, high = (show(parameter.from_raw(limit)) for limit in (limits.minimum, limits.maximum))
        raise block.error(key, f"{show(value)} does not fit {parameter.type}; expected {low}..{high}")
    if key == "default" and not limits.is_float and abs(raw - round(raw)) > slack:
        raise block.error(key, f"{show(value)} falls between two steps of {show(float(parameter.scale))}")


def _check_names(block: TomlTable, parameter: Parameter) -> None:
    """values and bits: only numbers that the type has."""
    kind = parameter.type
    for key, names in (("values", parameter.values), ("bits", parameter.bits)):
        if not names:
            continue
        if kind not in (INTEGERS if key == "bits" else ("bool", *INTEGERS)):
            raise block.error(key, f"type {kind!r} has no such names; expected a whole-number type")
        low, high = (0, 1) if kind == "bool" else (int(codec(kind).minimum), int(codec(kind).maximum))
        if key == "bits":
            low, high = 0, codec(kind).bits - 1
        for named in names:
            if not low <= named <= high:
                raise block.error(key, f"{named} is not in {kind}; expected {low}..{high}")
