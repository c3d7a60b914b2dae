"""The conformance cases on real ports: barewire's servers pass, wrong and missing servers are reported."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import cache
from itertools import islice, product
from pathlib import Path
from typing import TypeVar

import pytest

from barewire import ModbusServer
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.pty import PseudoTerminal
from barewire.modbus import (
    ModbusException,
    ReadCoils,
    ReadHoldingRegisters,
    Response,
    Server,
    Table,
    WriteMultipleCoils,
    WriteSingleCoil,
)
from barewire.modbus.exceptions import ILLEGAL_DATA_ADDRESS
from barewire.rtu import RtuLine, Timing
from barewire_workbench.cli.app import run_command_line
from barewire_workbench.conform.modbus import answer_text
from barewire_workbench.live import modbus_conformance as shell
from barewire_workbench.live.modbus_conformance import CaseResult, cases_of, conform
from barewire_workbench.live.results import Unfinished
from tests.certificates import tls_url
from tests.helpers import refused
from tests.io.peers import again, peer, stubborn
from tests.workbench.cli.helpers import run_command, run_here
from tools import conform_page

OURS = {
    "tcp": "tcp://127.0.0.1:0",
    "rtu": "rtu://pty?baudrate=115200&parity=N",
    "ascii": "ascii://pty?baudrate=115200&parity=N",
}
OTHERS = ["udp://127.0.0.1:0", "rtu+tcp://127.0.0.1:0?latency=usb", "ascii+tcp://127.0.0.1:0"]
CASES = {framing: cases_of(framing) for framing in ("tcp", "rtu", "ascii")}
CASES_TCP = CASES["tcp"]

K = TypeVar("K")
R = TypeVar("R")


def at_once(run: Callable[[K], R], keys: Iterable[K]) -> dict[K, R]:
    """The result of `run` for each of `keys`, each in a thread: a battery mostly waits."""
    keys = list(keys)
    with ThreadPoolExecutor(len(keys)) as pool:
        return dict(zip(keys, pool.map(run, keys)))


def hold(url: str, unit: Table) -> list[CaseResult]:
    """The results of a barewire server."""

    def run(patience: str) -> list[CaseResult]:
        with ModbusServer(url, units={1: unit}) as host:
            endpoint = Endpoint.parse(host.url)
            return list(conform(endpoint._replace(options={**endpoint.options, "timeout": patience})))

    return again(run)


@cache
def held() -> dict[str, list[CaseResult]]:
    """The results of a barewire server on each carrier."""
    return at_once(lambda url: hold(url, Table(100)), [*OURS.values(), *OTHERS])


@pytest.mark.parametrize("url", [*OURS.values(), *OTHERS])
def test_barewire_servers_pass_their_cases(url: str) -> None:
    results = held()[url]
    assert [result.failure for result in results if result.failure] == []
    assert [result.case for result in results] == list(CASES[Endpoint.parse(url).framing])


@pytest.mark.needs("openssl")
def test_the_barewire_tls_server_passes_its_cases(certificates: Path) -> None:

    def run(patience: str) -> list[CaseResult]:
        with ModbusServer(tls_url(certificates, "server", roles="any"), units={1: Table(100)}) as host:
            place = host.url.partition("?")[0].removeprefix("tls://")
            return list(conform(Endpoint.parse(tls_url(certificates, "operator", place, timeout=patience))))

    results = again(run)
    assert [result.failure for result in results if result.failure] == []
    assert len(results) == len(CASES_TCP)


def test_the_page_has_the_present_results_of_barewire() -> None:
    """docs/reference/conform.md: the columns of barewire are made again; those of others are as they were measured."""
    assert conform_page.OURS == OURS
    own = {
        kind: {
            result.case.name: conform_page.cell_of(result.case, result.failure, result.received)
            for result in held()[url]
        }
        for kind, url in OURS.items()
    }
    assert conform_page.PAGE.read_text(encoding="utf-8") == conform_page.page(own), "run python tools/conform_page.py"
    named = {name for part in conform_page.SURVEY.values() for row in part["row"] for name in row.get("cases", ())}
    assert named <= {case.name for cases in CASES.values() for case in cases}


def test_an_echo_is_not_taken_for_an_answer() -> None:
    """Everything that is sent comes back first, as from a two-wire adapter."""
    stop, terminal = threading.Event(), PseudoTerminal()
    line = RtuLine(Timing.of(115200), role="server", units=(1,))
    server = Server(line, {1: Table(100)}, serial=True)

    def serve() -> None:
        while not stop.is_set():
            data = terminal.receive(0.02)
            if data:
                terminal.send(data)
            for reply in server.feed(data, time.monotonic()):
                terminal.send(reply.data)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        url = f"rtu://{terminal.path}?baudrate=115200&parity=N&echo=1&timeout="
        results = again(lambda patience: list(islice(conform(Endpoint.parse(url + patience)), 8)))
    finally:
        stop.set()
        thread.join(30)
        terminal.close()
    assert [result.failure for result in results if result.failure] == []


def test_a_server_that_always_answers_the_same_fails() -> None:
    with peer(stubborn) as port:
        failures = {}
        for result in conform(Endpoint.parse(f"tcp://127.0.0.1:{port}?timeout=2")):
            failures[result.case.name] = result.failure
            if result.case.name == "five requests in one segment":
                break
    assert failures["03 with quantity 0"] == "03 with quantity 0: 03 02 00 00, expected 83 03"
    assert failures["five requests in one segment"] is None


def test_a_server_that_closes_the_connection_fails_with_that_reason() -> None:
    with peer(socket.socket.close) as port:
        result = next(conform(Endpoint.parse(f"tcp://127.0.0.1:{port}?timeout=30")))
    assert result.received == (None,)
    assert result.failure == "03 with quantity 0: closed, expected 83 03"


def test_no_server_and_an_endpoint_without_cases_are_errors() -> None:
    with refused(PortError, "connection refused"):
        list(conform(Endpoint.parse("tcp://127.0.0.1:1")))
    with refused(EncodeError, "there are cases for tcp://"):
        list(conform(Endpoint.parse("can://socketcan/can0")))


def test_the_conform_command() -> None:
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table(100)}) as host:
        for patience in ("0.25", "2", "8"):  # as `again`
            url = f"{host.url}?timeout={patience}"
            done = run_here("conform", "--timing", url)
            if done.returncode == 0:
                break
    assert done.returncode == 0
    assert (
        done.stderr
        == f"barewire: {url} waits for no silence: length fields delimit frames, transaction numbers match responses\n"
    )
    assert done.stdout.splitlines()[0] == "ok      MB-APP 6.3          03 with quantity 0"
    assert done.stdout.splitlines()[-1] == f"{len(CASES_TCP)} of {len(CASES_TCP)} passed"
    with peer(stubborn) as port:
        done = run_here("conform", f"tcp://127.0.0.1:{port}?timeout=2", "--json")
    assert done.returncode == 1
    first = json.loads(done.stdout.splitlines()[0])
    assert (first["ok"], first["clause"], first["received"]) == (False, "MB-APP 6.3", ["03 02 00 00"])


class WithoutCoils(Table):
    """A unit without functions 01, 05 and 0F."""

    @staticmethod
    def supports(request: type[object]) -> bool:
        return Table.supports(request) and request not in (ReadCoils, WriteSingleCoil, WriteMultipleCoils)


LACKING: dict[str, tuple[Callable[[], Table], tuple[str, ...]]] = {
    "registers": (
        lambda: Table(0),
        ("03 are refused with 02", "06, 17 are refused with 02", "06, 16, 03 are refused with 02"),
    ),
    "functions": (
        lambda: WithoutCoils(100),
        ("01 are refused with 01", "05 are refused with 01", "0F are refused with 01"),
    ),
}


@cache
def held_by_lesser_units() -> dict[tuple[str, str], list[CaseResult]]:
    """The results of servers that lack something, by what they lack and carrier."""
    return at_once(lambda key: hold(OURS[key[1]], LACKING[key[0]][0]()), product(LACKING, ("tcp", "rtu")))


@pytest.mark.parametrize("carrier", ["tcp", "rtu"])
@pytest.mark.parametrize("what", LACKING)
def test_cases_whose_registers_or_functions_the_server_lacks_are_not_judged(what: str, carrier: str) -> None:
    results, refusals = held_by_lesser_units()[what, carrier], LACKING[what][1]
    assert [result.failure for result in results if result.failure] == []
    reasons = {result.not_judged for result in results} - {""}
    assert reasons >= {f"valid requests of {refusal}" for refusal in refusals}
    assert sum(not result.not_judged for result in results) > 15


class RefusesFirstRead(Table):
    """A unit that answers the first valid read with exception 02, and every other one with the value."""

    refused = False

    def handle(self, request: object, now: float) -> Response | None:
        if isinstance(request, ReadHoldingRegisters) and request.address == 0 and not self.refused:
            self.refused = True
            raise ModbusException(ILLEGAL_DATA_ADDRESS)
        return super().handle(request, now)


def test_the_conform_command_names_the_cases_that_are_not_judged() -> None:
    with ModbusServer(OURS["tcp"], units={1: Table(0)}) as host:
        runs = at_once(lambda option: run_command("conform", f"{host.url}?timeout=2", *option), [(), ("--json",)])
    done, objects = runs[()], [json.loads(line) for line in runs["--json",].stdout.splitlines()]
    *_, total, hint = done.stdout.splitlines()
    judged = [item["ok"] for item in objects if item["ok"] is not None]
    assert total == f"{len(judged)} of {len(judged)} passed, {len(CASES_TCP) - len(judged)} not judged"
    assert hint == "The cases need registers and coils 0 to 9 of the unit, to read and to write."
    reason = "valid requests of 06, 17 are refused with 02"
    assert f"-       MB-APP 6.17         17 writes before it reads (not judged: {reason})" in done.stdout.splitlines()
    assert [item["not_judged"] for item in objects if item["case"] == "17 writes before it reads"] == [reason]
    assert done.returncode == 0


def test_a_refusal_is_a_failure_if_a_valid_request_is_carried_out() -> None:
    with ModbusServer(OURS["tcp"], units={1: RefusesFirstRead(100)}) as host:
        results = list(conform(Endpoint.parse(f"{host.url}?timeout=2")))
    assert [result.not_judged for result in results if result.not_judged] == []
    (failed,) = [result for result in results if result.failure]
    assert [answer_text(answer) for answer in failed.received].count("83 02") == 1


def flood(connection: socket.socket) -> None:
    """Sends without end."""
    while True:
        connection.sendall(b"\x00\x01\x00\x00\x00\x03\x01\x83\x02" * 400)


def drip(connection: socket.socket) -> None:
    """Sends a little at a time, until the client closes the connection."""
    while True:
        connection.sendall(b"\x01")
        time.sleep(0.002)


@cache
def held_by_endless_servers() -> dict[tuple[str, Callable[[socket.socket], None]], list[CaseResult]]:
    """The results of servers that do not stop sending."""

    def run(key: tuple[str, Callable[[socket.socket], None]]) -> list[CaseResult]:
        for patience in (0.1, 3.0, 10.0):  # as `again`
            results: list[CaseResult] = []
            with peer(key[1]) as port, pytest.raises(NoAnswer) as caught:
                collect(f"{key[0]}://127.0.0.1:{port}?timeout={patience}", results)
            if "never stops sending" in str(caught.value):
                return results
        raise caught.value

    return at_once(run, ENDLESS)


ENDLESS = [("tcp", flood), ("rtu+tcp", flood), ("ascii+tcp", flood), ("rtu+tcp", drip), ("ascii+tcp", drip)]


@pytest.mark.parametrize("kind", ENDLESS, ids=lambda kind: f"{kind[0]}-{kind[1].__name__}")
def test_a_server_that_does_not_stop_sending_ends_the_run(kind: tuple[str, Callable[[socket.socket], None]]) -> None:
    failures = [result.failure or "" for result in held_by_endless_servers()[kind][-3:]]
    assert len(failures) == 3
    assert all("it did not stop sending" in failure and len(failure) < 200 for failure in failures)


def test_a_server_that_never_answers_gets_no_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some cases accept silence, so a wrong unit number would pass them."""
    monkeypatch.setattr(shell, "RESTART", 0.1)
    message = refused(NoAnswer, "nothing was answered in any case: is there a unit 9")
    with peer(lambda connection: print(connection.recv(1))) as port, message:
        list(conform(Endpoint.parse(f"tcp://127.0.0.1:{port}?timeout=0.02&unit=9")))


def collect(url: str, results: list[CaseResult], count: int = 0, change: Callable[[], None] = lambda: None) -> None:
    """Collect the results; call `change` after `count` of them."""
    for result in conform(Endpoint.parse(url)):
        results.append(result)
        if len(results) == count:
            change()


def test_a_dead_port_ends_the_run_early(monkeypatch: pytest.MonkeyPatch) -> None:
    """On UDP a missing server is not reported."""
    monkeypatch.setattr(shell, "RESTART", 0.1)
    results: list[CaseResult] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mute:
        mute.bind(("127.0.0.1", 0))
        with pytest.raises(Unfinished) as caught:
            collect(f"udp://127.0.0.1:{mute.getsockname()[1]}?timeout=0.02", results)
    assert (len(results), caught.value.not_run) == (3, len(CASES_TCP) - 3)
    assert str(caught.value).endswith(f" ({len(CASES_TCP) - 3} cases not run)")


@pytest.mark.parametrize(("scheme", "words"), [("tcp", "connection refused"), ("udp", "has stopped answering")])
def test_a_server_that_dies_during_the_run_ends_it(monkeypatch: pytest.MonkeyPatch, scheme: str, words: str) -> None:
    monkeypatch.setattr(shell, "RESTART", 0.1)
    results: list[CaseResult] = []
    raises = pytest.raises(Unfinished, match=words)
    with ModbusServer(f"{scheme}://127.0.0.1:0", units={1: Table(100)}) as host, raises as caught:
        collect(f"{host.url}?timeout=2", results, 5, host.close)
    assert len(results) >= 5
    assert len(results) + caught.value.not_run == len(CASES_TCP)


def test_a_server_that_is_restarted_is_tested_further() -> None:
    def run(patience: str) -> list[CaseResult]:
        results: list[CaseResult] = []
        with ExitStack() as stack:
            host = stack.enter_context(ModbusServer("tcp://127.0.0.1:0", units={1: Table(100)}))
            url = host.url

            def restart_server() -> None:
                host.close()
                stack.enter_context(ModbusServer(url, units={1: Table(100)}))

            collect(f"{url}?timeout={patience}", results, 5, restart_server)
        return results

    results = again(run)
    assert len(results) == len(CASES_TCP)
    assert [result.failure for result in results if result.failure] == []


def test_the_conform_command_reports_cases_that_were_not_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(shell, "RESTART", 0.1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mute:
        mute.bind(("127.0.0.1", 0))
        url = f"udp://127.0.0.1:{mute.getsockname()[1]}?timeout=0.02"
        assert run_command_line(["conform", url, "--json"]) == 1
    out, err = capsys.readouterr()
    lines = [json.loads(line) for line in out.splitlines()]
    assert [line["ok"] for line in lines[:-1]] == [False, False, False]
    assert lines[-1]["not_run"] == len(CASES_TCP) - 3
    assert err == f"barewire: {lines[-1]['unfinished']}\n"
