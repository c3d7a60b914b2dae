"""Descriptors: one that is closed while a thread waits for it, and numbers that `select` cannot wait for."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from barewire import CanopenClient, CanopenServer, ModbusClient, ModbusServer, Table
from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.network import UdpPort
from barewire.io.ports.pty import PseudoTerminal
from barewire.io.ports.serial import SerialPort
from tests.helpers import PATIENCE, free_port, refused, until
from tests.io.ports.receiving import receiving
from tests.io.schemes import EVERY_SCHEME_WITHOUT_TLS, SERIAL

resource = pytest.importorskip("resource", reason="Windows has no such descriptors")


@pytest.mark.parametrize("end", [SerialPort, PseudoTerminal])
def test_a_thread_that_waits_for_a_closed_port_reads_no_file_that_gets_its_number(
    end: type[SerialPort | PseudoTerminal], tmp_path: Path
) -> None:
    terminal = PseudoTerminal()
    there = SerialPort.of(Endpoint.parse(f"rtu://{terminal.path}"))
    port, other = (there, terminal) if end is SerialPort else (terminal, there)
    number = port.fileno()
    kept = tmp_path / "kept"
    kept.write_text("of the program")
    thread, errors = receiving(port)
    until(lambda: waits(thread))
    port.close()
    with kept.open() as file:
        assert file.fileno() == number
        with contextlib.suppress(PortError):  # where the other end of a closed pseudo-terminal is gone too
            other.send(b"late")
        thread.join(PATIENCE)
        assert not thread.is_alive()
        assert file.read() == "of the program"
    assert errors == [f"{port.name}: the port was closed"]
    with refused(PortError, "the port was closed"):
        port.receive(0.0)
    with refused(PortError, "the port was closed"):
        port.send(b"x")
    other.close()


def waits(thread: threading.Thread) -> bool:
    """Whether the system says that a thread sleeps; where it cannot be asked, after a while."""
    try:
        return Path(f"/proc/self/task/{thread.native_id}/stat").read_text().rpartition(")")[2].split()[0] == "S"
    except OSError:
        thread.join(0.1)
        return True


@pytest.fixture
def above_1023() -> Iterator[None]:
    """All descriptors that are opened in the test have numbers above 1023."""
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    if limits[1] < 2048:
        pytest.skip("this user may not open so many files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(limits[0], 2048), limits[1]))
    held: list[int] = []
    try:
        while not held or held[-1] < 1030:
            held.append(os.open(os.devnull, os.O_RDONLY))
        yield
    finally:
        for number in held:
            os.close(number)
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


@EVERY_SCHEME_WITHOUT_TLS
def test_a_program_with_many_files_uses_every_carrier(scheme: str, above_1023: None) -> None:
    place = "pty" if scheme in SERIAL else "127.0.0.1:0"
    with ModbusServer(f"{scheme}://{place}", {1: Table()}) as server:
        with ModbusClient(server.url, timeout=PATIENCE) as client:
            assert client.read_holding_registers(0, 2) == (0, 0)
        assert server.failure is None


def test_a_program_with_many_files_uses_socketcand(above_1023: None) -> None:
    url = f"can://socketcand/127.0.0.1:{free_port()}/many?node=5"
    with CanopenServer(url, device="az3"), CanopenClient(url, timeout=PATIENCE) as client:
        assert client.node(5).sdo.upload(0x1000)


def test_a_datagram_port_that_cannot_be_opened_leaves_no_socket_open() -> None:
    with pytest.raises(PortError) as error:
        UdpPort("255.255.255.255", 502)
    frame = error.tb
    while frame.tb_next is not None:
        frame = frame.tb_next
    assert frame.tb_frame.f_locals["self"]._socket.fileno() == -1
