"""The settings of a description: which they are, their order, and errors in the table [settings]."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from barewire import load
from barewire.errors import BarewireError
from barewire_workbench.settings.rules import SettingRules


def test_modes_are_first_and_what_reaches_the_device_is_last() -> None:
    settings = SettingRules.of(load("csd-mt")).settings(is_can=False)
    names = [setting.name for setting in settings]
    assert names[:3] == ["Mode of Operation", "Motor Code", "Following Error Reaction Code"]
    assert names.index("Motor Code") < names.index("Encoder Count Per Revolution")
    assert [setting.communication for setting in settings] == [False] * 48 + [True] * 13
    assert names[-1] == "Little Endian / Big Endian"


def test_no_command_and_no_measurement_is_kept() -> None:
    for name in ("az3", "adxl", "csd-mt"):
        device = load(name)
        for is_can in (False, True):
            for setting in SettingRules.of(device).settings(is_can=is_can):
                assert setting.parameter.kind == "setting"
    kept = {setting.name for setting in SettingRules.of(load("az3")).settings(is_can=True)}
    assert "PROFILE ACCELERATION" in kept
    assert kept.isdisjoint({"CONTROL WORD", "TARGET VELOCITY", "COIL WORD 0", "SOFTWARE RESET", "STORE ALL PARAMETERS"})


def test_a_parameter_of_a_menu_is_a_setting_behind_its_numbers() -> None:
    setting = SettingRules.of(load("adxl")).settings(is_can=False)[0]
    assert (setting.name, setting.parameter.unit, setting.read_as) == (
        "P01.04 acceleration time",
        "s",
        "Parameter value",
    )
    assert list(setting.select.values()) == [1, 0, 4]


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ([], "settings: expected a table"),
        ({"frist": []}, "'frist': expected first, "),
        ({"first": "Current Ratio"}, "first = 'Current Ratio': expected a list"),
        ({"store_takes": "5 s"}, "store_takes = '5 s': expected a number"),
        ({"store": {"Save All": 1}}, "no parameter 'Save All'"),
        ({"menus": [{"name": "a", "at": [1]}], "selected": "Current Ratio", "select": []}, "expected name and at = "),
    ],
)
def test_a_wrong_table_is_one_clear_error(table: Any, message: str) -> None:
    with pytest.raises(BarewireError, match=message):
        SettingRules.of(replace(load("csd-mt"), extra={"settings": table}))


def test_a_device_without_a_table_has_settings_in_its_own_order() -> None:
    device = replace(load("csd-mt"), extra={})
    names = [setting.name for setting in SettingRules.of(device).settings(is_can=False)]
    assert names == [row.name for row in device.parameters if row.kind == "setting"]
