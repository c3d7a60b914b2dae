"""Modbus on real ports: pseudo-terminals and loopback TCP, blocking and asyncio, and how each of them fails."""

from __future__ import annotations

import asyncio
import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from barewire import AsyncModbusClient, AsyncModbusServer, ModbusClient, ModbusServer
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.io.ports.pty import PseudoTerminal, is_pseudo_terminal
from barewire.modbus import (
    ModbusException,
    ReadCoils,
    ReadHoldingRegisters,
    ReportServerId,
    Table,
    WriteMultipleRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
)
from tests.helpers import free_port

WIRES = [
    "tcp://127.0.0.1:0",
    "rtu://pty",
    "rtu://pty?baudrate=115200&parity=N&stopbits=2",
    "rtu://pty?patience=strict",
    "ascii://pty?baudrate=115200",
    "ascii://pty?baudrate=115200&bytesize=7",
]


@pytest.fixture(params=WIRES)
def host(request: pytest.FixtureRequest) -> Iterator[ModbusServer]:
    with ModbusServer(request.param, units={1: Table()}) as host:
        yield host


def test_written_values_are_read_back(host: ModbusServer) -> None:
    with ModbusClient(host.url) as client:
        client.ask(WriteSingleRegister(5, 0xBEEF))
        client.ask(WriteMultipleRegisters(6, range(100)))
        client.ask(WriteSingleCoil(3, True))
        assert client.ask(ReadHoldingRegisters(5, 3)).registers == (0xBEEF, 0, 1)
        assert client.ask(ReadCoils(0, 5)).bits == (False, False, False, True, False)
        assert b"table" in client.ask(ReportServerId()).data


def test_an_exception_response_is_a_modbus_exception(host: ModbusServer) -> None:
    with ModbusClient(host.url) as client, pytest.raises(ModbusException, match="illegal data address"):
        client.ask(ReadHoldingRegisters(0xFFFF, 2))


def test_the_line_can_be_opened_again_with_the_same_settings(host: ModbusServer) -> None:
    for value in (1, 2, 3):
        with ModbusClient(host.url) as client:
            client.ask(WriteSingleRegister(0, value))
            assert client.ask(ReadHoldingRegisters(0, 1)).registers == (value,)


def test_the_longest_frames_are_transferred(host: ModbusServer) -> None:
    with ModbusClient(host.url) as client:
        client.ask(WriteMultipleRegisters(0, range(123)))
        assert client.ask(ReadHoldingRegisters(0, 125)).registers == (*range(123), 0, 0)


def test_several_threads_may_use_one_client(host: ModbusServer) -> None:
    wrong: list[object] = []

    def use(address: int) -> None:
        for value in range(5):
            client.ask(WriteSingleRegister(address, value))
            got = client.ask(ReadHoldingRegisters(address, 1)).registers
            if got != (value,):
                wrong.append((address, value, got))

    with ModbusClient(host.url) as client:
        threads = [threading.Thread(target=use, args=(address,)) for address in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(30)
    assert wrong == []


@pytest.mark.parametrize("url", ["rtu://pty", "ascii://pty"])
def test_a_request_for_another_unit_on_a_serial_line_gets_no_answer(url: str) -> None:
    with (
        ModbusServer(url, units={1: Table()}) as host,
        ModbusClient(host.url) as client,
        pytest.raises(NoAnswer, match=r"unit 9 did not answer Read Holding Registers within 0\.2 s"),
    ):
        client.ask(ReadHoldingRegisters(0, 1), unit=9, timeout=0.2)


def test_a_broadcast_is_carried_out_and_not_answered() -> None:
    table = Table()
    with ModbusServer("rtu://pty", units={1: table}) as host, ModbusClient(host.url) as client:
        client.broadcast(WriteSingleRegister(7, 77))
        assert client.ask(ReadHoldingRegisters(7, 1)).registers == (77,)


def test_a_tcp_server_without_that_unit_answers_as_a_gateway() -> None:
    with (
        ModbusServer("tcp://127.0.0.1:0", units={1: Table()}) as host,
        ModbusClient(host.url) as client,
        pytest.raises(ModbusException, match="0B"),
    ):
        client.ask(ReadHoldingRegisters(0, 1), unit=9)


def test_a_refused_connection() -> None:
    port = free_port()
    with pytest.raises(PortError, match=f"^127.0.0.1:{port}: connection refused$"):
        ModbusClient(f"tcp://127.0.0.1:{port}")


@pytest.mark.parametrize("path", ["/dev/null", "/etc/passwd"])
def test_a_file_that_is_not_a_serial_port_is_an_error(path: str) -> None:
    with pytest.raises(PortError, match=f"^{path}: the file exists, but is not a serial port$"):
        ModbusClient(f"rtu://{path}")


def test_a_missing_serial_port_is_an_error() -> None:
    with pytest.raises(PortError, match=r"^/dev/tty-nowhere: no such file or directory$"):
        ModbusClient("rtu:///dev/tty-nowhere")


def test_a_serial_port_is_opened_by_one_program_at_a_time() -> None:
    terminal = PseudoTerminal()
    try:
        with ModbusClient(f"rtu://{terminal.path}"), pytest.raises(PortError, match="another program has it open"):
            ModbusClient(f"rtu://{terminal.path}")
    finally:
        terminal.close()


def test_a_port_that_is_unplugged_while_it_is_used() -> None:
    terminal = PseudoTerminal()
    with ModbusClient(f"rtu://{terminal.path}") as client:
        timer = threading.Timer(0.1, terminal.close)
        timer.start()
        with pytest.raises(PortError):
            client.ask(ReadHoldingRegisters(0, 1))
        timer.join()


def test_a_server_that_closes_the_connection_during_a_request() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with ModbusClient(url) as client:
            connection, _ = server.accept()
            timer = threading.Timer(0.1, connection.close)
            timer.start()
            with pytest.raises(PortError):
                client.ask(ReadHoldingRegisters(0, 1))
            timer.join()


def test_a_port_in_use_is_an_error() -> None:
    with (
        ModbusServer("tcp://127.0.0.1:0", units={1: Table()}) as host,
        pytest.raises(PortError, match="address already in use"),
    ):
        ModbusServer(host.url, units={1: Table()})


def test_a_stream_that_is_not_modbus_is_closed() -> None:
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table()}) as host:
        port = int(host.url.rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port), timeout=30) as peer_socket:
            peer_socket.sendall(b"GET / HTTP/1.1\r\n\r\n")
            assert peer_socket.recv(100) == b""


def test_several_requests_in_one_segment_and_one_in_many() -> None:
    request = bytes.fromhex("0001 0000 0006 01 03 0000 0001")
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table()}) as host:
        port = int(host.url.rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port), timeout=30) as peer_socket:
            peer_socket.sendall(3 * request)
            got = b""
            while len(got) < 3 * 11:
                got += peer_socket.recv(100)
            assert got == 3 * bytes.fromhex("0001 0000 0005 01 03 02 0000")
            for byte in request:
                peer_socket.sendall(bytes([byte]))
            assert peer_socket.recv(100) == bytes.fromhex("0001 0000 0005 01 03 02 0000")


def test_a_new_path_becomes_a_pseudo_terminal_and_is_removed_again(tmp_path: Path) -> None:
    path = tmp_path / "line"
    with ModbusServer(f"rtu://{path}", units={1: Table()}) as host:
        assert host.url == f"rtu://{path}"
        assert is_pseudo_terminal(os.fspath(path))
        with ModbusClient(host.url) as client:
            assert client.ask(ReadHoldingRegisters(0, 1)).registers == (0,)
    assert not path.is_symlink()


def test_a_pseudo_terminal_that_a_server_has_is_refused_to_a_second_server(tmp_path: Path) -> None:
    path = tmp_path / "line"
    expected = "another barewire server has this pseudo-terminal; stop it, or give this server another path"
    with ModbusServer(f"rtu://{path}", units={1: Table()}) as host:
        for url in (f"rtu://{path}", f"ascii://{os.path.realpath(path)}"):
            with pytest.raises(PortError, match=f"{url.partition('://')[2]}: {expected}"):
                ModbusServer(url, units={1: Table()})
            with pytest.raises(PortError, match=expected):
                asyncio.run(AsyncModbusServer(url, units={1: Table()}).start())
        with ModbusClient(host.url) as client:
            assert client.ask(ReadHoldingRegisters(0, 1)).registers == (0,)
            with pytest.raises(PortError, match="another program has it open"):
                ModbusServer(f"rtu://{path}", units={1: Table()})
            assert client.ask(ReadHoldingRegisters(0, 1)).registers == (0,)
    with ModbusServer(f"rtu://{path}", units={1: Table()}) as host, ModbusClient(host.url) as client:
        assert client.ask(ReadHoldingRegisters(0, 1)).registers == (0,)


def test_a_scheme_without_modbus_and_a_server_without_units_are_errors() -> None:
    with pytest.raises(EncodeError, match="Modbus goes over"):
        ModbusClient("can://virtual/x")
    with pytest.raises(EncodeError, match="expected a dict of unit address and unit"):
        ModbusServer("tcp://127.0.0.1:0", Table())  # type: ignore[arg-type]


async def _async_exchanges(port: int) -> None:
    async with AsyncModbusClient(f"tcp://127.0.0.1:{port}") as client:
        await client.ask(WriteSingleRegister(1, 42))
        answers = await asyncio.gather(*(client.ask(ReadHoldingRegisters(1, 1)) for _ in range(10)))
        assert {answer.registers for answer in answers} == {(42,)}
        with pytest.raises(ModbusException):
            await client.ask(ReadHoldingRegisters(0xFFFF, 2))


def test_the_asyncio_client() -> None:
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table()}) as host:
        asyncio.run(_async_exchanges(int(host.url.rpartition(":")[2])))


async def _cancelled_then_asked(port: int) -> None:
    async with AsyncModbusClient(f"tcp://127.0.0.1:{port}") as client:
        task = asyncio.ensure_future(client.ask(ReadHoldingRegisters(0, 1), unit=1))
        await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await client.ask(WriteSingleRegister(1, 43))
        assert (await client.ask(ReadHoldingRegisters(1, 1))).registers == (43,)


def test_a_cancelled_request_leaves_the_connection_usable() -> None:
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table()}) as host:
        asyncio.run(_cancelled_then_asked(int(host.url.rpartition(":")[2])))


def test_the_asyncio_client_fails_in_one_line() -> None:
    port = free_port()
    with pytest.raises(PortError, match=r"connection refused|connect call failed"):
        asyncio.run(AsyncModbusClient(f"tcp://127.0.0.1:{port}").open())


def test_a_silent_server_raises_no_answer() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"tcp://127.0.0.1:{server.getsockname()[1]}?timeout=0.1"
        with ModbusClient(url) as client, pytest.raises(NoAnswer, match=r"within 0\.1 s"):
            client.ask(ReadHoldingRegisters(0, 1))
