"""docs/conform-canopen.md has every case, and is as `tools/conform_can.py` writes it."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from barewire.canopen.conformance.battery import cases

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("conform_can_tool", ROOT / "tools" / "conform_can.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_device_of_the_page_supports_every_case(tool: ModuleType) -> None:
    assert [case.name for case in cases(tool.subject()) if case.lacks] == []


def test_every_case_is_on_the_page(tool: ModuleType) -> None:
    page = tool.PAGE.read_text(encoding="utf-8")
    assert all(f"| {case.name} | {case.title} | {case.effect} | {case.why} |" in page for case in cases(tool.subject()))


def test_the_page_is_up_to_date(tool: ModuleType) -> None:
    assert tool.PAGE.read_text(encoding="utf-8") == tool.page(), "run python tools/conform_can.py"
