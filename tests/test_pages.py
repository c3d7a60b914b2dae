"""The generated pages are up to date and complete: conformance cases of CANopen, devices, interoperability, mutation.

The marks of interop tests are compared with the services that were exchanged. `tests/test_layers.py` and, in
`tests/workbench`, `vectors/test_files.py` compare what their tools write; `live/test_modbus_conformance.py` there
compares the page conform.
"""

from __future__ import annotations

import tomllib
from collections import Counter
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from barewire.devices import load, names
from barewire_workbench.live.canopen_conformance import NODE_KIND, case_names, cases
from tests.interop.conftest import pytest_runtest_call
from tests.interop.services import PUBLIC
from tests.workbench.conform.canopen.described import OBJECTS
from tests.workbench.vectors.loaded import VECTORS
from tools import cia_cases, conform_can, devices, interop, mutants

pytestmark = pytest.mark.long


@pytest.mark.parametrize("tool", [conform_can, devices, interop], ids=lambda tool: tool.__name__)
def test_a_page_is_up_to_date(tool: ModuleType) -> None:
    assert tool.PAGE.read_text(encoding="utf-8") == tool.page(), f"run python -m {tool.__name__}"


# docs/reference/conform-canopen.md


def test_the_device_of_the_conformance_page_supports_every_case() -> None:
    assert [case.name for case in cases(conform_can.subject()) if case.lacks] == []


def test_every_case_is_on_the_conformance_page() -> None:
    page = conform_can.PAGE.read_text(encoding="utf-8")
    assert all(
        f"| {case.name} | {case.title} | {case.effect} | {case.why} |" in page for case in cases(conform_can.subject())
    )


def test_the_table_has_the_127_cases_of_the_cia_tool_and_names_of_ours() -> None:
    numbers = Counter(group for group, listed, *_ in cia_cases.CIA_CASES for _ in listed.split())
    assert numbers == {
        **{"EDS checker": 1, "SDO": 30, "PDO": 33, "OD": 9, "Emergency": 6, "Synchronization": 10, "Guarding": 6},
        **{"Heartbeat": 7, "Heartbeat versus guarding": 7, "Testing other": 10, "State": 4, "Transition": 4},
    }
    names = [f"{group} {number}" for group, listed, *_ in cia_cases.CIA_CASES for number in listed.split()]
    assert len(set(names)) == 127
    ours = {name.rpartition("-")[0] if name.startswith("OD-") else name for name in case_names(OBJECTS, (5,))}
    for group, listed, _, named, note in cia_cases.CIA_CASES:
        assert named or note, (group, listed)
        assert named == cia_cases.LINT or set(named.split()) <= ours, (group, listed)


def test_each_case_of_the_vectors_names_the_cases_of_the_cia_tool() -> None:
    wanted: dict[str, list[str]] = {}
    for group, listed, _, named, _ in cia_cases.CIA_CASES:
        for name in named.split():
            wanted.setdefault(name, []).extend(f"{group} {number}" for number in listed.split())
    for case in (case for file in VECTORS.files if file.kind == NODE_KIND for case in file.cases):
        names = ", ".join(wanted.get(case["name"], ()))
        assert case.get("origin", "") == (f"also in CiA's conformance test tool: {names}" if names else ""), case["id"]


# docs/reference/devices.md


def test_every_table_has_as_many_rows_as_in_the_manual() -> None:
    counted = {(count.device, count.table): count.here() for count in devices.COUNTS}
    assert counted == {(count.device, count.table): count.manual for count in devices.COUNTS}


def test_every_device_of_the_catalogue_is_counted() -> None:
    assert sorted(device.replace("_", "-") for device in devices.DEVICES) == names()


def test_every_counted_row_is_a_parameter() -> None:
    for name in names():
        assert len(devices.rows(name.replace("-", "_"))) == len(load(name).parameters)


def test_every_correction_is_listed() -> None:
    lines = devices.page().splitlines()
    for name in names():
        for parameter in load(name).parameters:
            for field in parameter.printed:
                assert any(line.startswith(f"| {parameter.name} | {field} | ") for line in lines), parameter.name


# docs/reference/interop.md


def test_every_service_is_tested_against_a_peer() -> None:
    assert interop.invalid_marks(interop.evidence()) == []
    assert interop.gaps(interop.evidence()) == []


def test_every_public_function_has_a_row() -> None:
    assert set(interop.functions()) == set(PUBLIC)
    lines = interop.page().splitlines()
    for name in interop.functions():
        assert sum(line.startswith(f"| {name} ") for line in lines) == len(interop.ROLES)


def test_a_service_without_a_peer_is_reported() -> None:
    """Without the evidence of one library at a time."""
    rest = tuple(row for row in interop.evidence() if row.peer != "tmodbus")
    assert "Modbus, client, rtu: 08/04" in interop.gaps(rest)
    assert "Modbus, server, rtu+tcp: 18" in interop.gaps(rest)
    rest = tuple(row for row in interop.evidence() if row.peer != "ourselves")
    assert "Modbus, server, udp: 2B/0D" in interop.gaps(rest)
    rest = tuple(row for row in interop.evidence() if row.peer != "tshark")
    assert {"Modbus, dissected: 03", "CANopen, dissected: LSS fastscan"} <= set(interop.gaps(rest))


def test_our_own_other_side_does_not_count_as_a_peer() -> None:
    ours = tuple(row._replace(peer="ourselves") for row in interop.evidence() if row.peer == "tmodbus")
    rest = tuple(row for row in interop.evidence() if row.peer != "tmodbus")
    assert "Modbus, client, rtu: 08/04" in interop.gaps(rest + ours)


@pytest.mark.parametrize("wrong", [{"peer": "modbus9000"}, {"carrier": "rs232"}, {"role": "boss"}])
def test_an_unknown_name_in_a_mark_is_reported(wrong: dict[str, Any]) -> None:
    good = next(row for row in interop.evidence() if row.role == "client")
    assert interop.invalid_marks([good]) == []
    (name,) = wrong.values()
    assert name in interop.invalid_marks([good._replace(**wrong)])[0]
    assert "'3'" in interop.invalid_marks([good._replace(services=("3",))])[0]
    dissected = next(row for row in interop.evidence() if row.role == "frames" and row.carrier == "file")
    assert interop.invalid_marks([dissected]) == []
    assert "'03'" in interop.invalid_marks([dissected._replace(services=("03",))])[0]


@pytest.mark.parametrize("seen", [{"03"}, {"03", "06", "10"}])
def test_a_test_fails_whose_mark_differs_from_the_exchanged_services(seen: set[str]) -> None:
    # One service less than marked; one more.
    mark = pytest.mark.evidence("pymodbus", "client", "tcp", "03", "06").mark
    item = SimpleNamespace(fixturenames=["exchanged"], funcargs={"exchanged": seen}, iter_markers=lambda name: [mark])
    running = pytest_runtest_call(item)  # type: ignore[arg-type]
    next(running)
    with pytest.raises(AssertionError):
        next(running)


# docs/reference/mutation.md


def test_every_survivor_on_the_page_is_a_change_of_a_line_that_exists() -> None:
    with (mutants.ROOT / "pyproject.toml").open("rb") as file:
        files = tomllib.load(file)["tool"]["mutmut"]["only_mutate"]
    texts = [(mutants.ROOT / name).read_text(encoding="utf-8") for name in files]
    code = " ".join(line.strip() for text in texts for line in text.splitlines())
    rows = mutants.explained(mutants.PAGE.read_text(encoding="utf-8"))
    assert [change for change in rows if change.before not in code] == []
    assert len(rows) == mutants.PAGE.read_text(encoding="utf-8").count("\n| `") - len(files)


def test_the_row_of_a_mutant_can_be_read_back() -> None:
    change = mutants.Change("Bus.ask", 'limit = first | "`"', 'limit = first & "`"')
    assert mutants.explained(mutants.row(change, "no reason")) == {change: "no reason"}
    assert mutants.name_of("barewire.rtu.line.xǁRtuLineǁ_take__mutmut_10") == ("barewire.rtu.line", "RtuLine._take")
    assert mutants.name_of("barewire.rtu.crc.x_crc16__mutmut_1") == ("barewire.rtu.crc", "crc16")
