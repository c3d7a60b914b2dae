"""`barewire scan` and `barewire ports`: what is printed, the line to type next, the exit status, wrong options."""

from __future__ import annotations

import json
import shlex
import socketserver
import threading
from contextlib import suppress

import pytest

from barewire import CanopenClient, CanopenServer, ModbusServer, Table
from barewire.devices.sim import simulator
from barewire_workbench.cli.app import run_command_line
from tests.workbench.cli.helpers import error_of, output_of, run_here


@pytest.fixture
def serial_ports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pseudo-terminals are taken for serial ports, which have settings."""
    monkeypatch.setattr("barewire_workbench.live.scan_modbus.is_pseudo_terminal", lambda path: False)


def test_a_pseudo_terminal_has_no_settings_to_find() -> None:
    """Its unit is found once, and nothing says with which settings."""
    with ModbusServer("rtu://pty", {5: simulator("az3").modbus}) as server:
        lines = output_of("scan", server.url, "--units", "4-6", "--every").splitlines()
        assert lines[0].startswith("unit 5    answered after")
        assert lines[3:] == ["1 found", f'next: barewire read "{server.url}?unit=5" az3 "STATUS WORD"']
        assert "of which a pseudo-terminal is none" in run_here("scan", server.url, "--baudrates", "9600").stderr


@pytest.mark.usefixtures("serial_ports")
def test_a_unit_that_answers_with_several_settings_is_one_unit() -> None:
    with ModbusServer("rtu://pty", {5: Table()}) as server:
        lines = output_of("scan", server.url, "--units", "5", "--baudrates", "9600,19200", "--every").splitlines()
    assert len([line for line in lines if line.startswith("unit 5    ")]) == 6
    assert lines[-2] == "1 found, some with several settings"


@pytest.mark.usefixtures("serial_ports")
def test_a_line_as_text() -> None:
    with ModbusServer("rtu://pty", {5: simulator("az3").modbus}) as server:
        lines = output_of("scan", server.url, "--units", "4-6", "--baudrates", "9600", "--formats", "8N1").splitlines()
    url = f"{server.url}?baudrate=9600&parity=N&unit=5"
    assert lines[0].startswith("unit 5    9600 8N1  answered")
    assert lines[1].strip() == "az3: TEM AZ3 servo drive"
    assert lines[2].strip().startswith("says: TEM AZ3")
    assert lines[3:] == ["1 found", f'next: barewire read "{url}" az3 "STATUS WORD"']


def test_the_line_to_type_next_works() -> None:
    with ModbusServer("tcp://127.0.0.1:0", {5: simulator("az3").modbus, 6: Table(8)}) as server:
        named, unnamed = (
            output_of("scan", f"{server.url}?timeout=30", "--units", unit).splitlines()[-1] for unit in ("5", "6")
        )
        assert "STATUS WORD" in output_of(*_words(named))
        addresses = output_of(*_words(unnamed)).splitlines()
        assert addresses[:2] == ["holding:0-7", "8 of 1000 addresses can be read"]
        assert output_of(*_words(addresses[-1])).startswith("holding:0")


@pytest.mark.parametrize(
    ("protocol", "greets", "answer"),
    [
        ("SSH", True, b"SSH-2.0-OpenSSH_9.2\r\n"),
        ("HTTP", False, b"HTTP/1.1 400 Bad Request\r\n\r\n"),
        ("TLS", False, bytes.fromhex("15 03 01 00 02 02 32")),
    ],
)
def test_a_server_of_another_protocol_is_named(protocol: str, greets: bool, answer: bytes) -> None:
    """By `read`, `write`, `watch` and `scan`; an SSH server speaks first, the others after a request."""

    class Foreign(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            with suppress(ConnectionError):  # the client leaves when it knows what this is
                if greets:
                    self.request.sendall(answer)
                while self.request.recv(1000):
                    self.request.sendall(answer)

    class Server(socketserver.ThreadingTCPServer):
        daemon_threads = True

    with Server(("127.0.0.1", 0), Foreign) as server:
        threading.Thread(target=server.serve_forever).start()
        url = f"tcp://127.0.0.1:{server.server_address[1]}?timeout=30"
        for words in (("read", url, "raw", "holding:0"), ("read", url, "csd-mt", "Homing Method", "--no-check"),
                      ("write", url, "raw", "holding:0=1")):  # fmt: skip
            assert f"; the other side speaks {protocol}" in error_of(*words)
        watched = run_here("watch", url, "raw", "holding:0", "--count", "1")
        assert f"; the other side speaks {protocol}" in watched.stdout + watched.stderr
        scanned = run_here("scan", url.partition("?")[0], "--units", "1")
        assert f"are no answers: the other side speaks {protocol}" in scanned.stderr
        server.shutdown()


def _words(line: str) -> list[str]:
    """The arguments of `next: barewire read "URL" ...`."""
    return shlex.split(line.removeprefix("next: barewire "))


def test_a_server_that_answers_for_every_unit_is_said_to() -> None:
    with ModbusServer("tcp://127.0.0.1:0", dict.fromkeys(range(1, 6), Table())) as server:
        text = output_of("scan", f"{server.url}?timeout=30", "--units", "1-5")
    assert "all 5 units answer: the server probably does not look at the unit" in text


def test_as_json() -> None:
    with ModbusServer("tcp://127.0.0.1:0", {5: Table()}) as server:
        (line,) = output_of("scan", f"{server.url}?timeout=30", "--units", "5", "--json").splitlines()
        (block,) = output_of("scan", f"{server.url}?unit=5&timeout=30", "--addresses", "coil:3", "--json").splitlines()
    found = json.loads(line)
    assert (found["unit"], found["two_devices"], found["device"]) == (5, False, None)
    assert json.loads(block) == {"table": "coil", "first": 3, "last": 3, "problem": ""}


@pytest.mark.usefixtures("serial_ports")
def test_nothing_found_is_status_1_with_what_was_tried() -> None:
    with ModbusServer("rtu://pty", {5: Table()}) as server:
        text = error_of(
            "scan", f"{server.url}?timeout=0.05", "--units", "6", "--baudrates", "9600,19200", "--formats", "8N1"
        )
    assert "none of 1 unit answered with 9600 8N1, 19200 8N1" in text
    with ModbusServer("tcp://127.0.0.1:0", {1: Table(0)}) as server:
        assert "nothing can be read at holding:0-9" in error_of("scan", server.url, "--addresses", "holding:0-9")
    assert "no node sent anything" in error_of("scan", "can://memory/nobody", "--listen", "0", "--nodes", "1-3")


def test_the_nodes_of_a_bus() -> None:
    with CanopenServer("can://memory/scan-command?node=5", device="az3") as server:
        with CanopenClient(server.url, timeout=30) as client:
            client.node().sdo.upload(0x1000)  # it has sent its boot-up message
        lines = output_of("scan", "can://memory/scan-command", "--listen", "0", "--nodes", "4-6").splitlines()
    assert lines[0].startswith("node 5    answered")
    assert lines[1].strip() == "says: profile 402 (drives)"
    assert lines[-1].startswith('next: barewire read "can://memory/scan-command?node=5"')


def test_ports_and_their_status(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    from barewire_workbench.live import ports

    monkeypatch.setattr(ports, "all_ports", lambda: [])
    assert run_command_line(["ports"]) == 1
    assert "no serial port and no CAN interface" in capsys.readouterr().err
    monkeypatch.setattr(ports, "all_ports", lambda: [ports.FoundPort("rtu:///dev/ttyS0", "serial port")])
    assert run_command_line(["ports"]) == 0
    assert capsys.readouterr().out == "rtu:///dev/ttyS0  serial port\n"


def test_ports_of_this_machine() -> None:
    assert run_here("ports", "--json").returncode in (0, 1)
