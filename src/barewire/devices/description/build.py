"""Builds a Device from the tables of its TOML files. Printed numbers become addresses on the wire here.

    holding = 1001            first_register = 0     ->  ModbusAt("holding", 1001)     the CSD MT counts from 0
    input = 25                first_register = 1     ->  ModbusAt("input", 24)         the AZ3 counts from 1
    object = 0x6041           sub = 0                ->  ObjectAt(0x6041, 0)

Nothing is checked here: `check.py` checks descriptions of users, and a test checks those of the catalogue.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from functools import lru_cache
from types import MappingProxyType
from typing import Any, NamedTuple

from barewire.codecs.order import Order
from barewire.devices.device import CanopenSettings, Device, DevicePdo, DriveRoles, ModbusSettings
from barewire.devices.parameter import TABLE_NAMES, ModbusAt, ObjectAt, Parameter, ParameterKind
from barewire.errors import fold

KEYS = ("name", "title", "documents", "storable", "modbus", "canopen", "pdo", "drive", "parameter")
"""The keys of device.toml that the format defines. Tables with other names are kept in `Device.extra`."""

_WORDS = {"u32": 2, "i32": 2, "f32": 2, "u64": 4, "i64": 4, "f64": 4}
_KINDS: Mapping[str, ParameterKind] = {"ro": "measurement", "wo": "command"}
_NONE: Mapping[Any, Any] = MappingProxyType({})
_fraction = lru_cache(maxsize=None)(Fraction)  # few scales occur, each of them often
_ONE = _fraction(1)


class Numbering(NamedTuple):
    """Settings for all rows: the first number of each table in the manual, and the order of long values."""

    first: Mapping[str, int] = _NONE
    """For each table the printed number of address 0 on the wire; 0 if it is not given."""

    order: Order = "ABCD"

    storable: bool | None = None
    """Whether a setting is storable whose row does not say it."""


def build_device(head: Mapping[str, Any], rows: Iterable[Mapping[str, Any]]) -> Device:
    """Return the device of these tables: `head` is device.toml, `rows` are the [[parameter]] tables of all files."""
    numbering = numbering_of(head.get("modbus", _NONE))._replace(storable=head.get("storable"))
    parameters: list[Parameter] = []
    for row in rows:
        parameters.append(build_parameter(row, numbering, parameters[-1].group if parameters else ""))
    modbus, canopen, drive = head.get("modbus"), head.get("canopen"), head.get("drive")
    return Device(
        name=head["name"],
        title=head["title"],
        parameters=tuple(parameters),
        documents=tuple(head.get("documents", ())),
        modbus=None if modbus is None else _modbus(modbus),
        canopen=None if canopen is None else _canopen(canopen, head.get("pdo", ())),
        drive=None if drive is None else _drive(drive, parameters),
        extra=MappingProxyType({key: value for key, value in head.items() if key not in KEYS}),
    )


def numbering_of(modbus: Mapping[str, Any]) -> Numbering:
    """Return the numbering that a table [modbus] gives."""
    first: dict[str, int] = {}
    for key, tables in (("first_register", ("holding", "input")), ("first_coil", ("coil", "discrete"))):
        number = modbus.get(key, 0)
        first |= number if isinstance(number, dict) else dict.fromkeys(tables, number)
    return Numbering(first, modbus.get("order", "ABCD"))


def build_parameter(row: Mapping[str, Any], numbering: Numbering, group: str = "") -> Parameter:
    """Return the parameter of one [[parameter]] table, in the `group` of the row before unless it begins a new one."""
    get = row.get
    kind: ParameterKind = get("kind") or _KINDS.get(row["access"], "setting")
    return Parameter(
        name=" ".join(row["name"].split()),
        type=row["type"],
        unit=get("unit", ""),
        scale=_fraction(row["scale"]) if "scale" in row else _ONE,
        default=get("default"),
        minimum=get("min"),
        maximum=get("max"),
        access=row["access"],
        values=_numbered(row["values"]) if "values" in row else _NONE,
        bits=_numbered(row["bits"]) if "bits" in row else _NONE,
        firmware=get("firmware", ""),
        kind=kind,
        storable=get("storable", numbering.storable) if kind == "setting" else False,
        group=get("group", group),
        answered=get("answered", True),
        note=get("note", ""),
        printed=MappingProxyType(row["printed"]) if "printed" in row else _NONE,
        modbus=_modbus_address(row, numbering),
        object=_object_address(row) if "object" in row else None,
    )


def words_of(row: Mapping[str, Any]) -> int:
    """Return how many registers or bits of its table a row takes."""
    words: int = row["words"] if row["type"] == "text" else _WORDS.get(row["type"], 1)
    return words


def _modbus_address(row: Mapping[str, Any], numbering: Numbering) -> ModbusAt | None:
    table = next((name for name in TABLE_NAMES if name in row), None)
    if table is None:
        return None
    address = row[table] - numbering.first.get(table, 0)
    if row["type"] == "text" or table in ("coil", "discrete"):
        return ModbusAt(table, address, words_of(row))
    return ModbusAt(table, address, words_of(row), row.get("half"), row.get("bit"), row.get("order", numbering.order))


def _object_address(row: Mapping[str, Any]) -> ObjectAt:
    return ObjectAt(row["object"], row.get("sub", 0), row.get("object_bit"), row.get("object_type", ""))


def _numbered(table: Mapping[str, str]) -> Mapping[int, str]:
    """Return { 0 = "text" } with numbers as keys; in TOML every key is text."""
    return MappingProxyType({int(key): text for key, text in table.items()})


def _modbus(table: Mapping[str, Any]) -> ModbusSettings:
    # The printed first numbers are not kept: they are in the addresses now.
    values = {key: value for key, value in table.items() if not key.startswith("first_")}
    if "read_functions" in table:
        values["read_functions"] = MappingProxyType(table["read_functions"])
    if "write_functions" in table:
        functions = {name: tuple(codes) for name, codes in table["write_functions"].items()}
        values["write_functions"] = MappingProxyType(functions)
    return ModbusSettings(**values)


def _canopen(table: Mapping[str, Any], pdos: Iterable[Mapping[str, Any]]) -> CanopenSettings:
    built = tuple(DevicePdo(**{**pdo, "map": tuple(tuple(entry) for entry in pdo["map"])}) for pdo in pdos)
    return CanopenSettings(**table, pdos=built)


def _drive(table: Mapping[str, Any], parameters: Iterable[Parameter]) -> DriveRoles:
    """Return the roles with the names as the parameters have them; `modes`, `settle` and the flag hold no names."""
    names = {fold(parameter.name): parameter.name for parameter in parameters}
    roles: dict[str, Any] = {
        key: names[fold(value)] if isinstance(value, str) else value for key, value in table.items()
    }
    if "settle" in roles:
        roles["settle"] = float(roles["settle"])
    return DriveRoles(**roles)
