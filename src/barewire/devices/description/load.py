"""Loads device descriptions: a directory of TOML files -> a Device. `catalog/README.md` describes the format.

    catalog/az3/device.toml      name, title, [modbus], [canopen], [[pdo]], [drive], its own tables -> Device.extra
    catalog/az3/coils.toml       [[parameter]] rows                                                 -> Device.parameters
    catalog/az3/holding.toml     ...  in the order of the file names

A description of the catalogue is only parsed and built, because a test checks it before it is shipped. A description of
a user is checked completely before it is built, and errors have file, line and key.
"""

from __future__ import annotations

import os
import tomllib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from barewire.codecs.order import ORDERS, Order
from barewire.devices.description.build import build_device
from barewire.devices.device import Device, UnknownName
from barewire.errors import EncodeError, fold, shown, suggest

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

CATALOG = Path(__file__).parent.parent / "catalog"
"""The directory of the catalogue. Where the package is in a zip archive, there is none: `_catalog` is for both."""

DEVICE_FILE = "device.toml"


def names() -> list[str]:
    """Return the devices of the catalogue.

    >>> "az3" in names()
    True
    """
    return sorted(entry.name.replace("_", "-") for entry in _catalog().iterdir() if (entry / DEVICE_FILE).is_file())


def load(name_or_path: str | Path) -> Device:
    """Load a device of the catalogue by its name, or one of your own by the path of its directory or its device.toml.

    >>> load("AZ3").find("status word").modbus
    ModbusAt(table='input', address=24, words=1, half=None, bit=None, order='CDAB')

    `?order=` behind the name gives the order of the words of long values, for a machine that was set to another order.

    >>> load("csd-mt?order=ABCD").find("Target Position").modbus.order
    'ABCD'

    A device of the catalogue is read once in a process. Raises UnknownName for any other name, DescriptionError with
    file, line and key for a description that does not follow the format.
    """
    if not isinstance(name_or_path, (str, os.PathLike)):
        raise EncodeError(f"device {shown(name_or_path)}: expected the name or the path of a description")
    plain, mark, option = str(name_or_path).rpartition("?")
    if mark and not os.path.isdir(name_or_path):
        key, _, order = option.partition("=")
        if key != "order" or order.upper() not in ORDERS:
            expected = f"expected ?order= and one of {', '.join(ORDERS)} behind the name{suggest(order, ORDERS)}"
            raise UnknownName(f"device {shown(str(name_or_path))}: {expected}")
        return load(plain).in_order(cast(Order, order.upper()))
    name = fold(str(name_or_path)).replace("_", "-")
    if name in names():
        return _from_catalog(name)
    path = Path(name_or_path)
    # os.path.isfile returns False for a name that is too long, Path.is_file raises.
    if os.path.isfile(path) and path.name == DEVICE_FILE:
        path = path.parent
    if not os.path.isdir(path) or not str(name_or_path):  # the path of an empty name is the present directory
        raise _unknown_device(str(name_or_path))
    return load_directory(path)


def _unknown_device(name: str) -> UnknownName:
    hint = "; an EDS is for bus.node(5, eds=...)" if name.lower().endswith((".eds", ".dcf")) else suggest(name, names())
    return UnknownName(f"no device {shown(name)} in the catalogue ({', '.join(names())}), and no such directory{hint}")


@cache
def _from_catalog(name: str) -> Device:
    directory = _catalog() / name.replace("-", "_")
    return _build([tomllib.loads((directory / file).read_text("utf-8")) for file in _files(directory)])


def _catalog() -> Traversable:
    if CATALOG.is_dir():
        return CATALOG
    from importlib.resources import files  # takes as long to import as a device to load: only in an archive

    return files("barewire.devices") / "catalog"


def load_directory(directory: Path) -> Device:
    """Load the device that the TOML files of a directory describe, after all checks."""
    from barewire.devices.description.check import check_description, read_file

    files = [read_file(directory / file) for file in _files(directory)]
    check_description(files[0], files[1:])
    return _build([file.items for file in files])


def _files(directory: Traversable) -> list[str]:
    """Return the names of device.toml and then of the other TOML files, in order."""
    others = sorted(file.name for file in directory.iterdir() if file.name.endswith(".toml"))
    return [DEVICE_FILE, *(name for name in others if name != DEVICE_FILE)]


def _build(tables: list[Any]) -> Device:
    return build_device(tables[0], [row for table in tables for row in table.get("parameter", ())])
