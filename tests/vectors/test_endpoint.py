"""`barewire vectors check --endpoint`: the cases of server-conformance, put to a server that runs."""

from __future__ import annotations

import json
import socket
from typing import Any

import pytest

from barewire import ModbusServer
from barewire.modbus import Table
from barewire.vectors.files import load_vectors
from tests.cli.helpers import run_command
from tests.io.peers import answer, peer

pytestmark = pytest.mark.long

CASES = {case["comment"]: case for file in load_vectors().files for case in file.cases if "framings" in case}
FEW = ["03 with quantity 0", "17 writes before it reads", "five requests in one segment", "08/0B bus message count"]


def ids(*beginnings: str) -> list[str]:
    found = [case["id"] for name, case in CASES.items() if name.startswith(beginnings)]
    assert len(found) == len(beginnings)
    return found


def check(endpoint: str, cases: list[str]) -> tuple[int, dict[str, Any], dict[str, Any]]:
    """The exit status, the state of each case, and the numbers."""
    only = [word for case in cases for word in ("--only", case)]
    done = run_command("vectors", "check", "--endpoint", endpoint, "--json", *only)
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
    def stubborn(connection: socket.socket) -> None:
        while data := connection.recv(1000):
            for at in range(0, len(data), 12):
                connection.sendall(answer(data[at : at + 12].ljust(12, b"\0")))

    with peer(stubborn) as port:
        status, cases, _ = check(f"tcp://127.0.0.1:{port}?timeout=1", ids("03 with quantity 0", "five requests"))
    texts = [case["text"] for case in cases.values() if case["state"] == "failed"]
    assert status == 1
    assert texts == ["run: answers is ['03 02 00 00'], expected [['83 03']]"]


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--endpoint", "tcp://127.0.0.1:1"], "connection refused"),
        (["--endpoint", "can://socketcan/can0"], "there are cases for tcp://"),
        (["--endpoint", "tcp://127.0.0.1:1", "--adapter", "x"], "give one of them"),
    ],
)
def test_an_endpoint_that_cannot_be_used_is_an_error(words: list[str], text: str) -> None:
    done = run_command("vectors", "check", *words)
    assert done.returncode > 0
    assert text in done.stderr.lower() or text in done.stderr
