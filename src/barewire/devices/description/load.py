"""A directory of TOML -> a Device. The format is told in `catalog/README.md`; whatever departs from it is refused.

    catalog/az3/device.toml      name, title, [modbus], [canopen], [[pdo]], [drive], its own tables -> Device.extra
    catalog/az3/coils.toml       [[parameter]] rows                                                 -> Device.parameters
    catalog/az3/holding.toml     ...  in the order of the file names

    bad.toml:12: parameter 'TEMPERATURE': key 'half': half a register with type 'u16'; expected u8 or i8

I know: files and the format.  I never know: requests, buses.
"""

from __future__ import annotations

import os
import re
import tomllib
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

from barewire.codecs import ORDERS
from barewire.codecs.order import Order
from barewire.devices.description.drive_table import read_drive_table
from barewire.devices.description.line_numbers import KeyLines
from barewire.devices.description.parameter_table import Counting, read_row
from barewire.devices.description.rules import (
    DescriptionError,
    Rule,
    TomlTable,
    Unfit,
    each_of,
    list_of,
    one_of,
    table_of,
    text,
    texts,
    whole,
)
from barewire.devices.device import CanopenSettings, Device, DevicePdo, ModbusSettings, UnknownName, fold, suggest
from barewire.devices.parameter import Parameter
from barewire.errors import shown

CATALOG = Path(__file__).parent.parent / "catalog"
DEVICE_FILE = "device.toml"
BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)


def names() -> list[str]:
    """The devices of the catalogue.

    >>> names()
    ['adxl', 'az3', 'csd-mt']
    """
    return sorted(found.parent.name.replace("_", "-") for found in CATALOG.glob(f"*/{DEVICE_FILE}"))


def load(name_or_path: str | Path) -> Device:
    """A device of the catalogue by its name, or one of your own by the path of its directory or its device.toml.

    >>> load("AZ3").find("status word").modbus
    ModbusAt(table='input', address=24, words=1, half=None, bit=None, order='CDAB')

    `?order=` behind it says how the machine lays the words of long values now, where it can be told to.

    >>> load("csd-mt?order=ABCD").find("Target Position").modbus.order
    'ABCD'

    A device of the catalogue is read once. Raises UnknownName for what is neither, DescriptionError with file, line
    and key for a description that is not as the format says.
    """
    plain, mark, option = str(name_or_path).rpartition("?")
    if mark and not os.path.isdir(name_or_path):
        key, _, order = option.partition("=")
        if key != "order" or order.upper() not in ORDERS:
            known = ", ".join(ORDERS)
            raise UnknownName(f"device {shown(str(name_or_path))}: expected ?order= and one of {known} behind the name")
        return load(plain).in_order(cast(Order, order.upper()))
    wanted = fold(str(name_or_path)).replace("_", "-")
    if wanted in names():
        return _from_catalog(wanted)
    path = Path(name_or_path)
    # os.path answers no where a name is too long to be one, Path would raise.
    if os.path.isfile(path) and path.name == DEVICE_FILE:
        path = path.parent
    if not os.path.isdir(path) or not str(name_or_path):
        known = ", ".join(names())
        hint = suggest(wanted, dict.fromkeys(names()))
        raise UnknownName(
            f"no device {shown(str(name_or_path))} in the catalogue ({known}), and no such directory{hint}"
        )
    return read_directory(path)


@cache
def _from_catalog(name: str) -> Device:
    return read_directory(CATALOG / name.replace("-", "_"))


def read_directory(directory: Path) -> Device:
    """The device that the TOML files of a directory describe."""
    head = _read_file(directory / DEVICE_FILE)
    files = [head, *(_read_file(file) for file in sorted(directory.glob("*.toml")) if file.name != DEVICE_FILE)]
    own = {key: head.items[key] for key in head.items if key in _OWN or not _is_table(head.items[key])}
    values = head._replace(items=own).read(_DEVICE, ("name", "title"))
    modbus, counting = _modbus(head)
    canopen = _canopen(head)
    parameters: dict[str, Parameter] = {}
    stands_at: dict[str, str] = {}
    for file in files:
        for block in _rows(file, is_head=file is head):
            parameter = read_row(block, modbus, counting, canopen is not None)
            key = fold(parameter.name)
            if key in parameters:
                raise block.error("name", f"a second one of this name; expected one, the first is {stands_at[key]}")
            parameters[key] = parameter
            stands_at[key] = f"{file.file}:{block.lines.of((*block.path, 'name'))}"
    drive = _table(head, "drive")
    return Device(
        name=values["name"],
        title=values["title"],
        parameters=tuple(parameters.values()),
        documents=values.get("documents", ()),
        modbus=modbus,
        canopen=canopen,
        drive=None if drive is None else read_drive_table(drive, parameters),
        extra=MappingProxyType({key: value for key, value in head.items.items() if key not in own}),
    )


def _read_file(path: Path) -> TomlTable:
    """One file as a block that is the whole file."""
    try:
        content = path.read_bytes().decode("utf-8")
        items = tomllib.loads(content)
    except FileNotFoundError:
        raise DescriptionError(f"{path}:1: no such file; a device is a directory with a {DEVICE_FILE}") from None
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise DescriptionError(f"{path}:{line}: not UTF-8; expected TOML, which is always UTF-8") from None
    except OSError as error:
        raise DescriptionError(f"{path}:1: {error.strerror or error}") from None
    except RecursionError:
        raise DescriptionError(f"{path}:1: nested too deeply to be read") from None
    except ValueError as error:  # tomllib's own error is one, and so is Python's about a number of 5000 digits
        said = str(error)
        place = re.search(r" \(at (?:line (\d+), column \d+|end of document)\)$", said)
        line = int(place[1]) if place and place[1] else content.count("\n") + 1
        raise DescriptionError(f"{path}:{line}: no TOML: {said[: place.start()] if place else said}") from None
    return TomlTable(str(path), KeyLines(content), (), "", items)


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and value != [] and isinstance(value[0], dict))


def _rows(file: TomlTable, *, is_head: bool) -> list[TomlTable]:
    """The [[parameter]] tables of a file."""
    if not is_head:
        for key in file.items:
            if key != "parameter":
                raise file.error(key, f"unknown; expected only [[parameter]] here, the rest stands in {DEVICE_FILE}")
    return _tables(file, "parameter", "parameter")


def _tables(file: TomlTable, key: str, title: str) -> list[TomlTable]:
    rows = file.items.get(key, [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise file.error(key, f"expected [[{key}]] tables")
    return [
        TomlTable(file.file, file.lines, (key, place), f"{title} {row.get('name', place + 1)!r}", row)
        for place, row in enumerate(rows)
    ]


def _table(file: TomlTable, key: str) -> TomlTable | None:
    items = file.items.get(key)
    if items is None:
        return None
    if not isinstance(items, dict):
        raise file.error(key, f"expected a table [{key}]")
    return TomlTable(file.file, file.lines, (key,), f"[{key}]", items)


# The tables of device.toml


def _as_it_is(value: Any) -> Any:
    return value


_OWN = ("modbus", "canopen", "pdo", "drive", "parameter")
_DEVICE: dict[str, Rule] = {"name": text, "title": text, "documents": texts, **dict.fromkeys(_OWN, _as_it_is)}

_MODBUS: dict[str, Rule] = {
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


def _modbus(file: TomlTable) -> tuple[ModbusSettings | None, Counting]:
    block = _table(file, "modbus")
    if block is None:
        return None, Counting()
    values = block.read(_MODBUS)
    first = values.pop("first_register", {}) | values.pop("first_coil", {})
    counting = Counting(first, values.get("order", "ABCD"))
    for key in ("read_functions", "write_functions"):
        if key in values:
            values[key] = MappingProxyType(values[key])
    return ModbusSettings(**values), counting


def _dialect(value: Any) -> str:
    # Only a description that names a dialect needs the room that speaks it.
    from barewire.devices.sdo_dialects import DIALECTS

    return str(one_of(*DIALECTS)(value))


def _mapping(value: Any) -> tuple[int, int, int]:
    ranges = (whole(1, 0xFFFF), whole(0, 0xFF), whole(1, 64))
    if not isinstance(value, list) or len(value) != len(ranges):
        raise Unfit("expected [index, sub-index, bits] in each place")
    index, sub, bits = (rule(item) for rule, item in zip(ranges, value))
    return index, sub, bits


_CANOPEN: dict[str, Rule] = {"node": whole(1, 127), "bitrate": one_of(*BITRATES), "dialect": _dialect}
_PDO: dict[str, Rule] = {
    "name": text,
    "cob_id": whole(0x80, 0x7FF),
    "transmission": whole(0, 255),
    "map": list_of(_mapping, 0, 64),
}


def _canopen(file: TomlTable) -> CanopenSettings | None:
    block = _table(file, "canopen")
    tables = _tables(file, "pdo", "pdo")
    if block is None:
        if tables:
            raise file.error("pdo", "the device has no CANopen; expected a table [canopen]")
        return None
    values = block.read(_CANOPEN)
    pdos = []
    for table in tables:
        pdo = DevicePdo(**table.read(_PDO, tuple(_PDO)))
        node = values.get("node", 1)
        if pdo.cob_id + node > 0x7FF:
            raise table.error("cob_id", f"with node {node} it is {pdo.cob_id + node:X}h; expected 7FFh at most")
        if sum(bits for _, _, bits in pdo.map) > 64:
            raise table.error("map", f"{sum(bits for _, _, bits in pdo.map)} bits; a PDO has room for 64")
        pdos.append(pdo)
    return CanopenSettings(**values, pdos=tuple(pdos))
