"""docs/interop.md: every function over every carrier in both roles has a stranger, and the page is as the tool would
leave it. The marks that it is made of are held against what was really exchanged."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from tests.interop.conftest import pytest_runtest_call
from tests.interop.services import EVERY

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("interop_tool", ROOT / "tools" / "interop.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_is_up_to_date(tool: ModuleType) -> None:
    assert tool.PAGE.read_text(encoding="utf-8") == tool.page(), "run python tools/interop.py"


def test_there_is_no_hole(tool: ModuleType) -> None:
    assert tool.slips(tool.evidence()) == []
    assert tool.holes(tool.evidence()) == []


def test_every_public_function_has_a_row(tool: ModuleType) -> None:
    assert set(tool.functions()) == {*EVERY, "2B/0D"}
    lines = tool.page().splitlines()
    for name in tool.functions():
        assert sum(line.startswith(f"| {name} ") for line in lines) == len(tool.ROLES)


def test_a_hole_is_seen(tool: ModuleType) -> None:
    """Without the one library that has them all."""
    rest = tuple(row for row in tool.evidence() if row.stranger != "tmodbus")
    assert "Modbus, client, rtu: 08/04" in tool.holes(rest)
    assert "Modbus, server, rtu+tcp: 18" in tool.holes(rest)
    rest = tuple(row for row in tool.evidence() if row.stranger != "ourselves")
    assert "Modbus, server, udp: 2B/0D" in tool.holes(rest)
    rest = tuple(row for row in tool.evidence() if row.stranger != "tshark")
    assert {"Modbus, dissected: 03", "CANopen, dissected: LSS fastscan"} <= set(tool.holes(rest))


def test_ourselves_is_not_a_stranger(tool: ModuleType) -> None:
    ours = tuple(row._replace(stranger="ourselves") for row in tool.evidence() if row.stranger == "tmodbus")
    rest = tuple(row for row in tool.evidence() if row.stranger != "tmodbus")
    assert "Modbus, client, rtu: 08/04" in tool.holes(rest + ours)


@pytest.mark.parametrize(("field", "value"), [("stranger", "nobody"), ("carrier", "rs232"), ("role", "boss")])
def test_a_slip_is_seen(tool: ModuleType, field: str, value: str) -> None:
    good = next(row for row in tool.evidence() if row.role == "client")
    assert tool.slips([good]) == []
    assert value in tool.slips([good._replace(**{field: value})])[0]
    assert "'3'" in tool.slips([good._replace(services=("3",))])[0]
    dissected = next(row for row in tool.evidence() if row.role == "frames" and row.carrier == "file")
    assert tool.slips([dissected]) == []
    assert "'03'" in tool.slips([dissected._replace(services=("03",))])[0]


@pytest.mark.parametrize("seen", [{"03"}, {"03", "06", "10"}])
def test_a_mark_that_says_what_did_not_happen_fails(seen: set[str]) -> None:
    """Less, and more."""
    mark = pytest.mark.evidence("pymodbus", "client", "tcp", "03", "06").mark
    item = SimpleNamespace(fixturenames=["witness"], funcargs={"witness": seen}, iter_markers=lambda name: [mark])
    running = pytest_runtest_call(item)  # type: ignore[arg-type]
    next(running)
    with pytest.raises(AssertionError):
        next(running)
