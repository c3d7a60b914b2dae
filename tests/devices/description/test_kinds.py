"""Settings are told from commands and measurements: what `barewire save` keeps, and what `restore` never writes."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from barewire import load
from barewire.devices import names
from tests.devices.description.test_check import HEAD, row, write


@pytest.mark.parametrize("name", names())
def test_every_parameter_of_the_catalogue_is_marked(name: str) -> None:
    for parameter in load(name).parameters:
        assert parameter.storable is not None, parameter.name
        assert (parameter.kind == "setting") or not parameter.storable, parameter.name
        if parameter.access == "ro":
            assert parameter.kind == "measurement", parameter.name


@pytest.mark.parametrize("name", names())
def test_no_word_that_moves_resets_or_stores_is_a_setting(name: str) -> None:
    device = load(name)
    roles = device.drive
    acting = ["*reset*", "* command", "*direct command*", "*cleaning", "start *", "* start", "save *", "store all*"]
    acting += [] if roles is None else [roles.control_word, roles.target_position, roles.target_velocity]
    settings = {"RESET ENCODER ON FIRST POWER UP"}  # what a reset does, not the reset
    for parameter in device.parameters:
        if any(fnmatchcase(parameter.name.casefold(), pattern.casefold()) for pattern in acting):
            assert parameter.kind != "setting" or parameter.name.upper() in settings, parameter.name


@pytest.mark.parametrize("name", names())
def test_what_restore_needs_names_parameters_of_the_device(name: str) -> None:
    device = load(name)
    table = device.extra["settings"]
    menus = [menu["name"] for menu in table.get("menus", [])]
    settings = [parameter.name for parameter in device.parameters if parameter.kind == "setting"] + menus
    for pattern in (*table.get("first", []), *table["communication"]):
        assert any(fnmatchcase(setting, pattern) for setting in settings), pattern
    for command, value in (table["store"] | table.get("store_communication", {})).items():
        assert device.find(command).kind == "command"
        device.find(command).to_raw(value)
    for read in (*table.get("idle", {}), *table.get("model", []), *table.get("versions", [])):
        assert device.find(read).kind == "measurement"
    for select in (*table.get("select", []), *filter(None, [table.get("selected")])):
        assert device.find(select).kind == "command"


def test_a_row_that_says_nothing_has_the_storable_of_its_device(tmp_path: Path) -> None:
    setting = row(access='"rw"')
    (parameter,) = load(write(tmp_path, setting, "storable = true\n" + HEAD)).parameters
    assert (parameter.kind, parameter.storable) == ("setting", True)
    (parameter,) = load(write(tmp_path, setting)).parameters
    assert parameter.storable is None
    (parameter,) = load(write(tmp_path, row(access='"rw"', kind='"command"'), "storable = true\n" + HEAD)).parameters
    assert parameter.storable is False
