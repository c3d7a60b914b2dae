"""`barewire vectors check --endpoint`: the cases of server-conformance and device-conformance, put to what runs."""

from __future__ import annotations

import json
from typing import Any

import pytest

from barewire import CanopenServer, ModbusServer
from barewire.canopen import Entry
from barewire.io.endpoint import Endpoint
from barewire.modbus import Table
from barewire_workbench.live import canopen_conformance as shell
from barewire_workbench.live.canopen_conformance import LiveDevice
from barewire_workbench.vectors.run import run_cases, selected
from tests.io.peers import peer, stubborn
from tests.workbench.cli.helpers import run_here
from tests.workbench.conform.canopen.devices import NODE, plain
from tests.workbench.vectors.loaded import VECTORS

pytestmark = pytest.mark.long

CASES = {case["comment"]: case for file in VECTORS.files for case in file.cases if "framings" in case}
FEW = ["03 with quantity 0", "17 writes before it reads", "five requests in one segment", "08/0B bus message count"]


def ids(*beginnings: str) -> list[str]:
    found = [case["id"] for name, case in CASES.items() if name.startswith(beginnings)]
    assert len(found) == len(beginnings)
    return found


def check(endpoint: str, cases: list[str]) -> tuple[int, dict[str, Any], dict[str, Any]]:
    """The exit status, the state of each case, and the numbers."""
    only = [word for case in cases for word in ("--only", case)]
    done = run_here("vectors", "check", "--endpoint", endpoint, "--json", *only)
    *lines, summary = [json.loads(line) for line in done.stdout.splitlines()]
    return done.returncode, {line["id"]: line for line in lines}, summary


def test_a_barewire_server_passes() -> None:
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table(100)}) as host:
        status, cases, summary = check(f"{host.url}?timeout=1", ids(*FEW))
    assert status == 0
    assert {case["state"] for case in cases.values()} == {"passed"}
    assert summary["passed"] == len(FEW)


def test_a_case_of_another_framing_and_one_that_the_server_lacks_are_not_offered() -> None:
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table(100, coils=[])}) as host:
        status, cases, _ = check(f"{host.url}?timeout=1", ids("a wrong CRC", "03 with quantity 0", "05 with 1234h"))
    states = {case["state"]: case.get("text", "") for case in cases.values()}
    assert status == 0
    assert states["passed"] == ""
    assert "the endpoint has tcp frames" in states["not offered"]


def test_a_server_that_always_answers_the_same_fails() -> None:
    with peer(stubborn) as port:
        status, cases, _ = check(f"tcp://127.0.0.1:{port}?timeout=1", ids("03 with quantity 0", "five requests"))
    texts = [case["text"] for case in cases.values() if case["state"] == "failed"]
    assert status == 1
    assert texts == ['run: answers is ["03 02 00 00"], expected [["83 03"]]']


NODE_CASES = {case["name"]: case["id"] for file in VECTORS.files for case in file.cases if "effect" in case}


def test_a_running_device_passes_fails_lacks_what_a_case_needs_and_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its device type has two bytes, and its TPDO answers no remote frames."""
    device = plain(tpdo=0x4000_0180 + NODE)
    device.objects.replace(Entry(0x1000, 0, "device type", "u16", "const", 0x192))
    names = ["SDO-01", "SDO-45", "SEG-01", "SEG-40", "STO-01", "TPD-48"]
    vectors = selected(VECTORS, only=[NODE_CASES[name] for name in names])
    url = f"can://virtual/vectors?node={NODE}"
    monkeypatch.setattr(shell, "BOOT", 0.1)
    with CanopenServer(url, device=device) as server, LiveDevice(Endpoint.parse(f"{url}&timeout=1")) as ask:
        found = {one.case["name"]: one.verdict for one in run_cases(vectors, ask)}
        server.close()
        gone = [one.verdict.text for one in run_cases(selected(vectors, only=[NODE_CASES["SDO-45"]]), ask)]
    assert {name: found[name].state for name in ("SDO-01", "SDO-45", "SEG-01")} == {
        "SDO-01": "failed",
        "SDO-45": "passed",
        "SEG-01": "passed",
    }
    assert "after 605#4000100000000000: 585#4B00100092010000, expected 585#43001000" in found["SDO-01"].text
    assert {name: verdict.text for name, verdict in found.items() if verdict.state == "not offered"} == {
        "SEG-40": "run: needs large object",
        "STO-01": "run: stores values: needs --save",
        "TPD-48": "run: only for a device with <tpdo.word&40000000/4> is 00000000",
    }
    assert gone == [f"run: node {NODE} does not answer any more after the case SEG-01"]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--endpoint", "tcp://127.0.0.1:1"], "connection refused"),
        (["--endpoint", "can://virtual/nobody?timeout=0.05"], "can://virtual is inside one process"),
        (["--endpoint", "tcp://127.0.0.1:1", "--adapter", "x"], "give one of them"),
    ],
)
def test_an_endpoint_that_cannot_be_used_is_an_error(words: list[str], text: str) -> None:
    done = run_here("vectors", "check", *words)
    assert done.returncode > 0
    assert text in done.stderr.lower() or text in done.stderr
