"""docs/devices.md: the catalogue has every row of the manuals; the page has every correction and is up to date."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from barewire.devices import load, names

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("devices_tool", ROOT / "tools" / "devices.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_table_has_as_many_rows_as_in_the_manual(tool: ModuleType) -> None:
    counted = {(count.device, count.table): count.here() for count in tool.COUNTS}
    assert counted == {(count.device, count.table): count.manual for count in tool.COUNTS}


def test_every_device_of_the_catalogue_is_counted(tool: ModuleType) -> None:
    assert sorted(device.replace("_", "-") for device in tool.DEVICES) == names()


def test_every_counted_row_is_a_parameter(tool: ModuleType) -> None:
    for name in names():
        assert len(tool.rows(name.replace("-", "_"))) == len(load(name).parameters)


def test_every_correction_is_listed(tool: ModuleType) -> None:
    lines = tool.page().splitlines()
    for name in names():
        for parameter in load(name).parameters:
            for field in parameter.printed:
                assert any(line.startswith(f"| {parameter.name} | {field} | ") for line in lines), parameter.name


def test_the_page_is_up_to_date(tool: ModuleType) -> None:
    assert tool.PAGE.read_text(encoding="utf-8") == tool.page(), "run python tools/devices.py"
