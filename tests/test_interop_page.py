"""docs/interop.md is up to date, and every function over every carrier in both roles is tested against a peer.
The marks of the tests are compared with the services that were exchanged."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from tests.interop.conftest import pytest_runtest_call
from tests.interop.services import PUBLIC

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


def test_every_service_is_tested_against_a_peer(tool: ModuleType) -> None:
    assert tool.invalid_marks(tool.evidence()) == []
    assert tool.gaps(tool.evidence()) == []


def test_every_public_function_has_a_row(tool: ModuleType) -> None:
    assert set(tool.functions()) == set(PUBLIC)
    lines = tool.page().splitlines()
    for name in tool.functions():
        assert sum(line.startswith(f"| {name} ") for line in lines) == len(tool.ROLES)


def test_a_service_without_a_peer_is_reported(tool: ModuleType) -> None:
    """Without the evidence of one library at a time."""
    rest = tuple(row for row in tool.evidence() if row.peer != "tmodbus")
    assert "Modbus, client, rtu: 08/04" in tool.gaps(rest)
    assert "Modbus, server, rtu+tcp: 18" in tool.gaps(rest)
    rest = tuple(row for row in tool.evidence() if row.peer != "ourselves")
    assert "Modbus, server, udp: 2B/0D" in tool.gaps(rest)
    rest = tuple(row for row in tool.evidence() if row.peer != "tshark")
    assert {"Modbus, dissected: 03", "CANopen, dissected: LSS fastscan"} <= set(tool.gaps(rest))


def test_our_own_other_side_does_not_count_as_a_peer(tool: ModuleType) -> None:
    ours = tuple(row._replace(peer="ourselves") for row in tool.evidence() if row.peer == "tmodbus")
    rest = tuple(row for row in tool.evidence() if row.peer != "tmodbus")
    assert "Modbus, client, rtu: 08/04" in tool.gaps(rest + ours)


@pytest.mark.parametrize(("field", "value"), [("peer", "modbus9000"), ("carrier", "rs232"), ("role", "boss")])
def test_an_unknown_name_in_a_mark_is_reported(tool: ModuleType, field: str, value: str) -> None:
    good = next(row for row in tool.evidence() if row.role == "client")
    assert tool.invalid_marks([good]) == []
    assert value in tool.invalid_marks([good._replace(**{field: value})])[0]
    assert "'3'" in tool.invalid_marks([good._replace(services=("3",))])[0]
    dissected = next(row for row in tool.evidence() if row.role == "frames" and row.carrier == "file")
    assert tool.invalid_marks([dissected]) == []
    assert "'03'" in tool.invalid_marks([dissected._replace(services=("03",))])[0]


@pytest.mark.parametrize("seen", [{"03"}, {"03", "06", "10"}])
def test_a_test_fails_whose_mark_differs_from_the_exchanged_services(seen: set[str]) -> None:
    # One service less than marked; one more.
    mark = pytest.mark.evidence("pymodbus", "client", "tcp", "03", "06").mark
    item = SimpleNamespace(fixturenames=["exchanged"], funcargs={"exchanged": seen}, iter_markers=lambda name: [mark])
    running = pytest_runtest_call(item)  # type: ignore[arg-type]
    next(running)
    with pytest.raises(AssertionError):
        next(running)
