"""`barewire devices`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from barewire.devices import load, names
from tests.cli.helpers import error_of, output_of


def test_the_list_of_devices() -> None:
    listed = [json.loads(line) for line in output_of("devices", "--json").splitlines()]
    protocols = {device["name"]: device["protocols"] for device in listed}
    assert list(protocols) == names()
    assert (protocols["az3"], protocols["adxl"]) == (["Modbus", "CANopen"], ["Modbus"])
    assert "TEM AZ3" in output_of("devices")


@pytest.mark.parametrize("name", names())
def test_every_parameter_is_listed_with_every_field(name: str) -> None:
    keys = ["name", "type", "unit", "scale", "default", "min", "max", "access", "values", "firmware", "note"]
    rows = [json.loads(line) for line in output_of("devices", name, "--json").splitlines()]
    assert [row["name"] for row in rows] == [parameter.name for parameter in load(name).parameters]
    for row in rows:
        assert list(row)[:13] == [*keys, "modbus", "object"]
        if row["modbus"]:
            assert list(row["modbus"]) == ["table", "address", "words", "half", "bit", "order"]
        if row["object"]:
            assert list(row["object"]) == ["index", "sub", "bit"]
    assert rows[0]["name"] in output_of("devices", name)


def test_a_device_without_parameters(tmp_path: Path) -> None:
    (tmp_path / "device.toml").write_text('name = "bare"\ntitle = "Bare"\n')
    assert output_of("devices", str(tmp_path)) == "Bare: 0 parameters\n"
    assert "bare has no Modbus: no table [modbus]" in error_of("simulate", str(tmp_path), "tcp://127.0.0.1:0")
