"""Loading: the devices of the catalogue, devices of a user, and printed numbers that become addresses."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from pathlib import Path

import pytest

from barewire.devices import ModbusAt, ObjectAt, UnknownName, load, names
from barewire.devices.description.load import CATALOG
from tests.helpers import refused

SMALL = """\
name = "small"
title = "A small machine"

[modbus]
first_register = 1
first_coil = 10
order = "CDAB"

[canopen]
node = 7

[[pdo]]
name = "RPDO1"
cob_id = 0x200
transmission = 255
map = [[0x6040, 0, 16]]

[wiring]
colour = "grey"
"""


def device_in(directory: Path, rows: str, head: str = SMALL) -> Path:
    (directory / "device.toml").write_text(head, encoding="utf-8")
    (directory / "rows.toml").write_text(rows, encoding="utf-8")
    return directory


@pytest.mark.parametrize(
    ("name", "tables", "objects"),
    [
        ("adxl", {"holding": 20, "input": 39}, 0),
        ("az3", {None: 82, "coil": 40, "holding": 171, "input": 61}, 336),
        ("csd-mt", {"holding": 114}, 0),
    ],
)
def test_tables_and_objects_of_the_catalogue(name: str, tables: dict[str | None, int], objects: int) -> None:
    device = load(name)
    assert device.name == name
    assert Counter(p.modbus.table if p.modbus else None for p in device.parameters) == tables
    assert sum(p.object is not None for p in device.parameters) == objects
    assert (device.canopen is not None) == bool(objects)
    assert device.documents


def test_names_are_the_directories_of_the_catalogue() -> None:
    directories = [entry.name for entry in CATALOG.iterdir() if entry.is_dir() and not entry.name.startswith("_")]
    assert names() == sorted(name.replace("_", "-") for name in directories)
    assert {"adxl", "az3", "csd-mt"} <= set(names())
    assert [load(name).name for name in names()] == names()


@pytest.mark.parametrize("name", names())
def test_the_catalogue_passes_all_checks(name: str) -> None:
    """`load` does not check the catalogue at each start; loading it by its path does."""
    assert load(CATALOG / name.replace("-", "_")) == load(name)


def test_a_device_of_the_catalogue_is_read_once() -> None:
    assert load("az3") is load("AZ3 ") is not load(CATALOG / "az3")
    assert load("csd_mt") is load("CSD-MT")


def test_every_row_can_be_found_by_its_name_in_any_case() -> None:
    for name in names():
        device = load(name)
        assert all(device.find(parameter.name.swapcase()) is parameter for parameter in device.parameters)


def test_limits_and_functions_of_the_machines() -> None:
    adxl, az3, csd = (load(name).modbus for name in ("adxl", "az3", "csd-mt"))
    assert adxl is not None
    assert az3 is not None
    assert csd is not None
    assert (adxl.write_limit, adxl.read_functions["holding"], adxl.write_functions["holding"]) == (1, 4, (6,))
    assert (az3.read_limit, az3.write_limit, az3.write_functions["coil"]) == (124, 123, (5, 15))
    assert (csd.port, csd.read_limit, dict(csd.read_functions)) == (502, 125, {"holding": 3})


def test_tables_that_the_format_does_not_define_are_kept_in_extra() -> None:
    assert {"serial", "settings", "errors"} < set(load("adxl").extra)
    assert load("adxl").extra["errors"]["6"].startswith("Slave busy")
    assert load("csd-mt").extra["alarm"][0]["code"] == 0x2130
    assert len(load("csd-mt").extra["motor"]) == 16
    assert set(load("az3").extra) == {"identity", "settings"}


def test_default_pdos() -> None:
    settings = load("az3").canopen
    assert settings is not None
    assert (settings.node, settings.bitrate, settings.dialect) == (1, 125_000, "az3")
    assert [pdo.name for pdo in settings.pdos] == [
        f"{direction}PDO{number}" for direction in "RT" for number in (1, 2, 3, 4)
    ]
    assert settings.pdos[4].map == ((0x6041, 0, 16), (0x2005, 0, 16), (0x2002, 0, 16), (0x2006, 0, 16))


def test_printed_numbers_become_wire_addresses(tmp_path: Path) -> None:
    rows = """
[[parameter]]
name = "  a \\t wide  name "
type = "f32"
holding = 1
access = "rw"
scale = "0.5"

[[parameter]]
name = "coil"
type = "bool"
coil = 10
object = 0x2000
object_bit = 3
access = "rw"

[[parameter]]
name = "high"
type = "i8"
input = 65536
half = "H"
access = "ro"

[[parameter]]
name = "other order"
type = "u64"
holding = 5
order = "ABCD"
access = "rw"

[[parameter]]
name = "only an object"
type = "u32"
object = 0x2001
sub = 4
access = "wo"
"""
    device = load(device_in(tmp_path, rows))
    places = [parameter.modbus for parameter in device.parameters]
    assert places == [
        ModbusAt("holding", 0, 2, order="CDAB"),
        ModbusAt("coil", 0),
        ModbusAt("input", 0xFFFF, 1, "H", order="CDAB"),
        ModbusAt("holding", 4, 4, order="ABCD"),
        None,
    ]
    assert device.parameters[0].name == "a wide name"
    assert device.parameters[0].scale == Fraction(1, 2)
    assert device.find("COIL").object == ObjectAt(0x2000, 0, 3)
    assert device.find("only an object").object == ObjectAt(0x2001, 4)
    assert device.extra == {"wiring": {"colour": "grey"}}
    assert device.canopen is not None
    assert device.canopen.pdos[0].cob_id == 0x200


def test_a_path_may_be_the_directory_or_its_device_toml_and_rows_may_stand_in_it(tmp_path: Path) -> None:
    row = '[[parameter]]\nname = "{}"\ntype = "u16"\nholding = 1\naccess = "rw"\n'
    device_in(tmp_path, row.format("second"), SMALL + row.format("first"))
    for path in (tmp_path, str(tmp_path), tmp_path / "device.toml"):
        assert [parameter.name for parameter in load(path).parameters] == ["first", "second"]


def test_files_are_read_in_the_order_of_their_names(tmp_path: Path) -> None:
    for file, name in (("b", "2"), ("a", "1"), ("c", "3")):
        row = f'[[parameter]]\nname = "{name}"\ntype = "u16"\nholding = 1\naccess = "rw"\n'
        (tmp_path / f"{file}.toml").write_text(row, encoding="utf-8")
    (tmp_path / "device.toml").write_text(SMALL, encoding="utf-8")
    assert [parameter.name for parameter in load(tmp_path).parameters] == ["1", "2", "3"]


def test_the_error_for_an_unknown_device_has_the_nearest_names() -> None:
    known = ", ".join(names())
    with refused(UnknownName, f"no device 'az4' in the catalogue ({known}), and no such directory; did you mean"):
        load("az4")


def test_the_error_for_an_unknown_parameter_has_the_nearest_names() -> None:
    with refused(UnknownName, "az3 has no parameter 'STATUS WROD'; did you mean 'STATUS WORD'"):
        load("az3").find("STATUS WROD")


def test_each_table_may_be_counted_from_a_number_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "device.toml").write_text(
        """
name = "meter"
title = "A meter"
[modbus]
first_register = { holding = 40001, input = 30001 }
first_coil = { coil = 1, discrete = 10001 }
[[parameter]]
name = "setting"
type = "u16"
holding = 40008
access = "rw"
[[parameter]]
name = "measure"
type = "f32"
input = 30011
access = "ro"
[[parameter]]
name = "contact"
type = "bool"
discrete = 10003
access = "ro"
""",
        encoding="utf-8",
    )
    places = [parameter.modbus for parameter in load(tmp_path).parameters]
    assert [(place.table, place.address) for place in places if place] == [
        ("holding", 7),
        ("input", 10),
        ("discrete", 2),
    ]


def test_a_device_is_shown_on_one_line() -> None:
    az3 = load("az3")
    assert repr(az3) == f"<Device az3: {az3.title}, {len(az3.parameters)} parameters, Modbus and CANopen>"
