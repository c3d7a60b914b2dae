"""Scans of real ports: pseudo-terminals, TCP, a CAN bus in memory; and the ports of a machine."""

from __future__ import annotations

import socketserver
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from barewire import CanopenServer, ModbusClient, ModbusServer, NoAnswer, Table
from barewire.canopen import CanFrame
from barewire.devices import load
from barewire.devices.sim import simulator
from barewire.errors import EncodeError, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.interfaces import can_port
from barewire.modbus import Unit
from barewire_workbench.live import ports
from barewire_workbench.live.scan_canopen import FoundNode, scan_canopen
from barewire_workbench.live.scan_modbus import ModbusScan, Progress, scan_addresses, scan_modbus
from tests.helpers import free_port


def test_the_units_of_a_line_are_found_and_named() -> None:
    units: dict[int, Unit] = {5: simulator("adxl").modbus, 7: simulator("az3").modbus, 9: Table()}
    with ModbusServer("rtu://pty", units) as server:
        scan = scan_modbus(server.url, range(4, 11))
        found = list(scan.run())
    assert [(unit.unit, unit.device and unit.device.name) for unit in found] == [(5, "adxl"), (7, "az3"), (9, None)]
    assert found[0].url == f"{server.url}?unit=5"
    assert "TEM AZ3" in str(found[1].identity)


def test_a_line_with_unknown_settings() -> None:
    """Three units at 9600 8N1. With other settings the client is on a line where nobody understands it."""
    right = {"baudrate": "9600", "parity": "N"}
    tried: list[str] = []
    with (
        ModbusServer("rtu://pty", {3: Table(), 5: Table(), 40: Table()}) as server,
        ModbusServer("rtu://pty", {200: Table()}) as deaf,
    ):

        def connect(url: str, **options: Any) -> ModbusClient:
            endpoint = Endpoint.parse(url)
            fits = right.items() <= endpoint.options.items()
            tried.append(f"{endpoint.options['baudrate']} {endpoint.options['parity']}")
            return ModbusClient(server.url if fits else deaf.url, **options)

        progress: list[Progress] = []
        url = "rtu:///dev/ttyUSB0?timeout=0.3"
        scan = scan_modbus(url, [3, 5, 40], baudrates=[19200, 9600], connect=connect, progress=progress.append)
        found = list(scan.run())
    assert [unit.unit for unit in found] == [3, 5, 40]
    assert {unit.url.partition("&unit")[0] for unit in found} == {f"{url}&baudrate=9600&parity=N"}
    # The likely units with each combination, until one answers; then the others with that one.
    assert tried == ["19200 E", "9600 E", "19200 N", "9600 N", "9600 N"]
    left = [step.seconds_left for step in progress]
    assert left[0] > left[-1] >= 0.0


def test_settings_of_the_url_are_kept() -> None:
    def settings(url: str, **options: Any) -> list[str]:
        return list(map(str, scan_modbus(url, **options).settings))

    assert settings("rtu:///dev/ttyUSB0?baudrate=4800&parity=O") == ["4800 8O1"]
    assert len(settings("rtu:///dev/ttyUSB0?baudrate=4800")) == 3
    assert settings("rtu:///dev/ttyUSB0?baudrate=4800", baudrates=[9600], formats=["8N2"]) == ["9600 8N2"]
    assert settings("ascii:///dev/ttyUSB0")[0] == "19200 7E1"
    assert settings("tcp://127.0.0.1") == []


@pytest.mark.parametrize(
    ("url", "options", "message"),
    [
        ("tcp://127.0.0.1", {"baudrates": [9600]}, "it has no baud rate"),
        ("rtu:///dev/ttyUSB0", {"formats": ["7E1"]}, "RTU has 8 data bits"),
        ("rtu:///dev/ttyUSB0", {"formats": ["9E1"]}, "such as 8E1"),
        ("rtu:///dev/ttyUSB0", {"units": [0]}, "broadcast"),
        ("can://socketcan/can0", {}, "Modbus goes over"),
    ],
)
def test_wrong_arguments(url: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(EncodeError, match=message):
        scan_modbus(url, **options)


@contextmanager
def served_by(handler: type[socketserver.BaseRequestHandler]) -> Iterator[str]:
    """The URL of a TCP server with this handler."""
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield f"tcp://127.0.0.1:{server.server_address[1]}?reconnect_first=0.001"
        finally:
            server.shutdown()
            thread.join()


def answering(answer: Callable[[int, int], bytes | None]) -> type[socketserver.BaseRequestHandler]:
    """A handler that answers a unit and a function with a PDU, or closes the connection."""

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            while len(header := self.rfile.read(7)) == 7:
                function = self.rfile.read(header[5] - 1)[0]
                pdu = answer(header[6], function)
                if pdu is None:
                    return
                self.wfile.write(header[:5] + bytes([len(pdu) + 1, header[6]]) + pdu)

    return Handler


def test_a_server_that_closes_the_connection_of_unknown_units_is_scanned_to_the_end() -> None:
    known = answering(lambda unit, function: bytes([function | 0x80, 2]) if unit in (2, 9) else None)
    with served_by(known) as url:
        scan = scan_modbus(f"{url}&timeout=30", range(1, 11))
        assert [unit.unit for unit in scan.run()] == [2, 9]
    assert scan.closed == 8


def test_a_unit_whose_server_closes_the_connection_when_it_is_asked_what_it_is() -> None:
    with served_by(answering(lambda unit, function: bytes([3, 2, 0, 1]) if function == 3 else None)) as url:
        (found,) = scan_modbus(f"{url}&timeout=30", [2]).run()
    assert (found.unit, str(found.identity)) == (2, "")


def test_a_server_of_another_protocol_is_no_unit() -> None:
    with served_by(_Babbler) as url:
        scan = scan_modbus(url, range(1, 5))
        assert list(scan.run()) == []
    assert scan.stray > 0


class _Babbler(socketserver.BaseRequestHandler):
    def handle(self) -> None:
        while self.request.recv(100):
            self.request.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")


def test_a_server_that_is_gone_ends_the_scan() -> None:
    with pytest.raises(PortError):
        list(scan_modbus(f"tcp://127.0.0.1:{free_port()}", [1]).run())


def test_addresses_of_a_simulated_machine() -> None:
    server = ModbusServer("tcp://127.0.0.1:0", {1: simulator("csd-mt").modbus})
    with server, ModbusClient(server.url, timeout=30) as client:
        described = {
            address
            for row in load("csd-mt").parameters
            if row.modbus is not None and "r" in row.access and row.answered
            for address in range(row.modbus.address, row.modbus.address + row.modbus.words)
        }
        pieces = list(scan_addresses(client, "holding", 1000, 1199))
        readable = {address for piece in pieces for address in range(piece.first, piece.last + 1)}
        assert readable == {address for address in described if 1000 <= address < 1200}
        for wrong in [("registers", 0, 1), ("holding", 2, 1), ("holding", 0, 65536)]:
            with pytest.raises(EncodeError):
                list(scan_addresses(client, *wrong))


def test_the_addresses_of_a_unit_that_is_not_there() -> None:
    server = ModbusServer("rtu://pty", {1: Table()})
    with server, ModbusClient(server.url, unit=9, timeout=0.05) as nobody, pytest.raises(NoAnswer):
        list(scan_addresses(nobody, "holding", 0, 9))


def closing_behind(address: int, requests: list[bytes] | None = None) -> type[socketserver.BaseRequestHandler]:
    """A handler that closes the connection of a request for an address behind this one; with a list also of the first
    request, once."""

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            while len(request := self.rfile.read(12)) == 12:
                first, count = (int.from_bytes(request[place : place + 2], "big") for place in (8, 10))
                if requests is not None and not requests:
                    requests.append(request)
                    return
                if first + count - 1 > address:
                    return
                self.wfile.write(request[:5] + bytes([3 + 2 * count, request[6], 3, 2 * count]) + bytes(2 * count))

    return Handler


def test_the_addresses_of_a_server_that_closes_the_connection_of_unknown_ones() -> None:
    with served_by(closing_behind(14)) as url, ModbusClient(f"{url}&timeout=30") as client:
        pieces = list(map(str, scan_addresses(client, "holding", 8, 20)))
    assert pieces == ["8-14", "15-20: the connection was closed"]
    with pytest.raises(PortError):  # now the server is gone
        list(scan_addresses(client, "holding", 8, 20))


def test_a_connection_that_was_lost_between_two_requests_makes_no_address_unknown() -> None:
    with served_by(closing_behind(20, [])) as url, ModbusClient(f"{url}&timeout=30") as client:
        assert list(map(str, scan_addresses(client, "holding", 8, 20))) == ["8-20"]


# CAN


@contextmanager
def station(url: str) -> Iterator[None]:
    """A station that sends heartbeats of node 9, which does not answer, and answers as a second node 6."""
    ended = threading.Event()
    port = can_port(Endpoint.parse(url))

    def serve() -> None:
        while not ended.is_set():
            frame = port.receive(0.02)
            if frame is None:
                port.send(CanFrame(0x709, b"\x05"))
            elif frame.id == 0x606 and frame.data[0] == 0x40:
                port.send(CanFrame(0x586, b"\x43" + frame.data[1:4] + b"\x01\0\0\0"))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        port.close()


def test_the_nodes_of_a_bus() -> None:
    url = "can://memory/scanned"
    with CanopenServer(f"{url}?node=5", device="az3"), CanopenServer(f"{url}?node=6", device="az3"), station(url):
        found: dict[int, FoundNode] = {node.node: node for node in scan_canopen(url, listen=1.0, timeout=0.5)}
    assert sorted(found) == [5, 6, 9]
    assert found[5].url == "can://memory/scanned?node=5"
    assert "profile 402 (drives)" in str(found[5].identity)
    assert not found[5].is_doubled
    assert "two devices answer as node 6" in found[6].why
    assert (found[9].is_silent, "operational" in found[9].why, "does not answer" in found[9].why) == (True,) * 3


# Ports


def test_serial_ports_with_usb_first(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = {"vid": None, "pid": None, "serial_number": None, "manufacturer": None, "description": "n/a"}
    usb = {"vid": 0x0403, "pid": 0x6001, "serial_number": "A1", "manufacturer": "FTDI", "description": "USB UART"}
    listed = [SimpleNamespace(device="/dev/ttyS9", **plain), SimpleNamespace(device="/dev/ttyUSB9", **usb)]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: listed)
    assert [f"{port.url}  {port}" for port in ports.serial_ports()] == [
        "rtu:///dev/ttyUSB9  FTDI USB UART; USB 0403:6001; serial number A1",
        "rtu:///dev/ttyS9  serial port",
    ]


def test_the_stable_name_and_the_programs_that_hold_a_port(tmp_path: Path) -> None:
    device = tmp_path / "ttyUSB0"
    device.touch()
    by_id, process = tmp_path / "by-id", tmp_path / "proc" / "42"
    by_id.mkdir()
    (by_id / "usb-FTDI_A1").symlink_to(device)
    (process / "fd").mkdir(parents=True)
    (process / "fd" / "3").symlink_to(device)
    (process / "comm").write_text("mbpoll\n")
    assert ports.stable_name(str(device), by_id) == str(by_id / "usb-FTDI_A1")
    assert ports.stable_name(str(device), tmp_path / "missing") is None
    assert ports.holders(str(device), tmp_path / "proc") == ("mbpoll (42)",)
    assert ports.holders(str(tmp_path / "other"), tmp_path / "proc") == ()


def test_can_interfaces_of_the_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, kind, state in [("eth0", "1", "up"), ("can0", "280", "up"), ("can1", "280", "down")]:
        folder = tmp_path / name
        folder.mkdir()
        (folder / "type").write_text(f"{kind}\n")
        (folder / "operstate").write_text(f"{state}\n")
    about = b'[{"linkinfo": {"info_data": {"state": "ERROR-PASSIVE", "bittiming": {"bitrate": 250000}}}}]'

    def run(command: list[str], **options: object) -> SimpleNamespace:
        if command[-1] == "can1":
            raise FileNotFoundError("ip")
        return SimpleNamespace(stdout=about)

    monkeypatch.setattr("subprocess.run", run)
    assert [f"{port.url}  {port}" for port in ports.can_interfaces(tmp_path)] == [
        "can://socketcan/can0  CAN interface; state ERROR-PASSIVE; 250000 bit/s",
        "can://socketcan/can1  CAN interface; state down; ip link set can1 up type can bitrate 125000",
    ]
    assert ports.can_interfaces(tmp_path / "missing") == []


def test_a_scan_can_be_run_again() -> None:
    with ModbusServer("tcp://127.0.0.1:0", {1: Table()}) as server:
        scan: ModbusScan = scan_modbus(server.url, [1])
        assert [[unit.unit for unit in scan.run()] for _ in range(2)] == [[1], [1]]
