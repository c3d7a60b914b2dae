"""`barewire devices`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from barewire.devices import load, names
from barewire_workbench.cli.devices import parameter_fields
from tests.workbench.cli.helpers import ENVIRONMENT, error_of, output_of, run_here
from tests.workbench.eds.test_device import plant

KEYS = ["name", "type", "unit", "scale", "default", "min", "max", "access", "values", "firmware", "note"]
KEYS += ["modbus", "object", "bits", "kind", "storable", "answered", "printed", "group"]


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
            assert list(row["object"]) == ["index", "sub", "bit", "type"]
        assert row["group"]
    for arguments in ((), ("--long",)):
        lines = output_of("devices", name, *arguments).splitlines()
        assert [row["name"] for row in rows if any(line.strip().startswith(row["name"]) for line in lines)] == [
            row["name"] for row in rows
        ]


def test_a_table_has_a_line_for_each_parameter_and_a_heading_for_each_group() -> None:
    lines = output_of("devices", "az3").splitlines()
    groups = list(dict.fromkeys(parameter.group for parameter in load("az3").parameters))
    assert len(lines) == 1 + 1 + 2 * len(groups) + 354 + 2
    assert lines[0] == "TEM AZ3 servo drive: 354 parameters"
    assert lines[1].split() == ["name", "access", "type", "range", "and", "unit", "Modbus", "CANopen"]
    at = lines.index("Control word, mode, targets and limits")
    assert lines[at - 1] == ""
    assert lines[at + 1].split() == ["CONTROL", "WORD", "rw", "u16", "0..65535", "holding", "154", "6040h:00"]
    assert max(map(len, lines)) < 160
    assert "--long" in lines[-1]


def test_a_word_selects_parameters_by_name_group_or_place() -> None:
    found = output_of("devices", "az3", "bit rate").splitlines()
    assert found[0] == "TEM AZ3 servo drive: 2 of 354 parameters"
    assert [line.split("  ")[1] for line in found[2:] if line.startswith("  ")] == ["CAN BIT RATE", "BOOT BIT RATE"]
    assert "CONTROL WORD" in output_of("devices", "az3", "6040h")
    assert len(output_of("devices", "az3", "heartbeat", "--json").splitlines()) == 5
    assert "phasing" in output_of("devices", "az3", "PHASING").lower()
    assert "az3 has no parameter with 'flux capacitor' in its name, group or place" in error_of(
        "devices", "az3", "flux capacitor", status=2
    )


def test_the_long_form_has_values_defaults_and_notes() -> None:
    text = output_of("devices", "az3", "CAN BIT RATE", "--long")
    assert "default 5" in text
    assert "    3: 20 kbit/s" in text
    assert "the manual prints for canopen_range: 0÷65535" in text
    assert "default 5" not in output_of("devices", "az3", "CAN BIT RATE")


def test_control_characters_of_names_do_not_reach_the_terminal(tmp_path: Path) -> None:
    file = tmp_path / "odd.eds"
    file.write_bytes(plant().encode().replace(b"Speed", b"Speed\x1b[2J"))
    for options in ([], ["--long"]):
        shown = run_here("devices", str(file), *options).stdout
        assert "Speed?[2J" in shown
        assert "\x1b" not in shown


def test_a_device_without_parameters(tmp_path: Path) -> None:
    (tmp_path / "device.toml").write_text('name = "bare"\ntitle = "Bare"\n')
    assert output_of("devices", str(tmp_path)) == "Bare: 0 parameters\n"
    assert "bare has no Modbus: no table [modbus]" in error_of("simulate", str(tmp_path), "tcp://127.0.0.1:0", status=2)


@pytest.mark.parametrize("name", names())
def test_a_table_fits_a_terminal_of_80_columns(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ENVIRONMENT, "COLUMNS", "80")
    lines = output_of("devices", name).splitlines()
    assert max(map(len, lines)) <= 80
    for parameter in load(name).parameters:
        own = f"  {parameter.name}"
        at = next(place for place, text in enumerate(lines) if text == own or text.startswith(f"{own}  "))
        assert all(place in f"{lines[at]} {lines[at + 1]}" for place in parameter.places)
    left_out = "range and unit, type" if name == "az3" else "range and unit"
    assert lines[-1] == f"Left out on this narrow terminal, see --long: {left_out}"


@pytest.mark.parametrize("name", names())
def test_every_parameter_is_json_with_the_same_keys(name: str) -> None:
    for parameter in load(name).parameters:
        fields = parameter_fields(parameter)
        assert list(fields) == KEYS
        assert json.loads(json.dumps(fields, allow_nan=False)) == fields


def test_places_scale_and_names() -> None:
    fields = parameter_fields(load("az3").find("START PHASING"))
    assert fields["modbus"] == {"table": "coil", "address": 1, "words": 1, "half": None, "bit": None, "order": "ABCD"}
    assert fields["object"] == {"index": 0x2018, "sub": 0, "bit": 1, "type": "bool"}
    assert fields["default"] is False
    fields = parameter_fields(load("adxl").find("Frequency"))
    assert (fields["scale"], fields["unit"], fields["object"], fields["min"]) == (0.001, "Hz", None, None)
    fields = parameter_fields(load("adxl").find("C02 Thermal status reset"))
    assert (fields["scale"], fields["values"]) == (1, {"1": "execute"})
    half = parameter_fields(load("adxl").find("Events counter"))["modbus"]
    assert half == {"table": "input", "address": 0x502F, "words": 1, "half": "H", "bit": None, "order": "ABCD"}
    assert parameter_fields(load("az3").find("IQRMSX10"))["modbus"] is None
