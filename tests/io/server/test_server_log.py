"""The log and the statistics of a server: errors in the code of units with their traceback, connections, refusals."""

from __future__ import annotations

import asyncio
import logging
import os
import re
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest

import barewire
from barewire.io.endpoint import Endpoint
from barewire.io.server.base import server_log
from barewire.modbus import Functions, ModbusException, ReadCoils, ReadHoldingRegisters, Table
from tests.helpers import until

LOGGER = "barewire.modbus.server"
THREADED = ["tcp://127.0.0.1:0", "rtu+tcp://127.0.0.1:0", "udp://127.0.0.1:0", "rtu://pty"]


def no_sensor(address: int, quantity: int) -> Sequence[int]:
    raise ValueError("no sensor")


FAILING = Functions(read_input_registers=no_sensor, read_holding_registers=lambda address, quantity: [0] * quantity)


WAYS = ["thread", "asyncio"]


@contextmanager
def serving(way: str, url: str, units: Any = None, **options: Any) -> Iterator[Any]:
    """A server, by default with unit 1, in a thread or in an event loop in a thread. It is closed at the end."""
    units = units or {1: Table()}
    if way == "thread":
        with barewire.ModbusServer(url, units, **options) as server:
            yield server
        return
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    other = barewire.AsyncModbusServer(url, units, **options)
    asyncio.run_coroutine_threadsafe(other.start(), loop).result(30)
    try:
        yield other
    finally:
        asyncio.run_coroutine_threadsafe(other.close(), loop).result(30)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(30)
        loop.close()


@pytest.mark.parametrize(
    ("way", "url"), [*(("thread", url) for url in THREADED), *(("asyncio", url) for url in THREADED[:3])]
)
def test_a_server_logs_an_error_of_a_unit_and_keeps_it(way: str, url: str, caplog: pytest.LogCaptureFixture) -> None:
    with serving(way, url, {7: FAILING}) as server, barewire.ModbusClient(server.url, unit=7, timeout=30) as client:
        client.read_holding_registers(0, 1)
        with pytest.raises(ModbusException):
            client.read_input_registers(3, 2)
        (record,) = caplog.records
        assert (record.name, record.levelno) == (LOGGER, logging.ERROR)
        message = record.getMessage()
        request = "unit 7: ReadInputRegisters(address=3, quantity=2)"
        assert message.partition(": ")[2] == f"{request}: its code failed, exception 04: ValueError: no sensor"
        assert record.exc_info is not None
        assert record.exc_info[0] is ValueError
        assert "no_sensor" in caplog.text  # the function, from the traceback
        statistics = server.statistics
        assert statistics.failures == ["ValueError: no sensor"]
        assert (statistics.requests, statistics.exceptions) == (2, 1)


def test_all_connections_of_a_server_count_in_the_same_statistics() -> None:
    with barewire.ModbusServer(THREADED[0], {1: FAILING}) as server:
        for _ in range(3):
            with barewire.ModbusClient(server.url) as client:
                client.read_holding_registers(0, 1)
        assert (server.statistics.requests, server.statistics.replies) == (3, 3)


def test_errors_of_each_request_and_kind_have_a_limit_of_their_own(caplog: pytest.LogCaptureFixture) -> None:
    log = server_log(Endpoint.parse("tcp://plc:502"))
    log.serving("tcp://plc:502", [1, 2])
    request = ReadHoldingRegisters(0, 1)
    for _ in range(50):
        log.failed(1, request, ValueError("a"))
    log.failed(2, request, ValueError("b"))
    log.failed(1, request, OSError("c"))
    log.failed(1, ReadCoils(0, 1), ValueError("d"))
    texts = [record.getMessage().rpartition("04: ")[2] for record in caplog.records]
    assert texts == [*["ValueError: a"] * 10, "ValueError: b", "OSError: c", "ValueError: d"]


def test_the_unit_number_of_a_client_makes_no_further_lines(caplog: pytest.LogCaptureFixture) -> None:
    with barewire.ModbusServer(THREADED[0], {255: FAILING}) as server, barewire.ModbusClient(server.url) as client:
        for unit in range(1, 31):
            with pytest.raises(ModbusException):
                client.at(unit=unit).read_input_registers(3, 2)
        assert len(caplog.records) == 10


def test_a_log_that_fails_and_an_error_without_text_do_not_stop_the_server(monkeypatch: pytest.MonkeyPatch) -> None:
    class WithoutText(Exception):
        def __str__(self) -> str:
            raise RuntimeError

    def fail(record: logging.LogRecord) -> bool:
        raise RuntimeError("a wrong filter")

    log = server_log(Endpoint.parse("tcp://plc:502"))
    log.failed(1, None, WithoutText())
    monkeypatch.setattr(logging.getLogger(LOGGER), "filters", [fail])
    log.failed(2, None, ValueError("x"))


# Connections, refusals, bytes: the lines, and the counters that add up ------------------------------------------------

READ = bytes.fromhex("0001 0000 0006 01 03 0000 0001")


def connected(server: Any) -> socket.socket:
    """A connection that the server has accepted."""
    before = server.statistics.opened
    opened = socket.create_connection(("127.0.0.1", server.port))
    until(lambda: server.statistics.opened > before)
    return opened


def lines(caplog: pytest.LogCaptureFixture, server: Any) -> list[str]:
    """The level and text of each line, without the URL, and with letters in place of the clients' addresses."""
    found: list[str] = []
    peers: dict[str, str] = {}
    for record in caplog.records:
        assert record.name == LOGGER
        text = record.getMessage().removeprefix(server.url.partition("?")[0] + ": ")
        for peer in re.findall(r"127\.0\.0\.1:\d+", text):
            text = text.replace(peer, peers.setdefault(peer, "ABCDEFGH"[len(peers)]))
        found.append(f"{record.levelname} {text}")
    return found


def adds_up(server: Any) -> None:
    counted = server.statistics
    ended = counted.left + counted.refused + counted.idle + counted.broken + counted.stopped
    assert counted.opened == len(server.connections) + ended


@pytest.mark.parametrize("way", WAYS)
def test_why_each_connection_ended(way: str, log: pytest.LogCaptureFixture) -> None:
    with ExitStack() as closing, serving(way, "tcp://127.0.0.1:0", connections=2) as server:
        counted = server.statistics
        first, second = (closing.enter_context(connected(server)) for _ in range(2))
        second.sendall(READ)
        second.recv(260)
        third = closing.enter_context(connected(server))  # the first one has to go
        assert first.recv(1) == b""
        adds_up(server)
        third.close()
        until(lambda: counted.left == 1)
        adds_up(server)
        fourth = closing.enter_context(connected(server))
        fourth.sendall(b"GET / HTTP/1.0\r\n\r\n")
        until(lambda: counted.broken == 1)
        adds_up(server)
    assert (counted.opened, counted.left, counted.refused, counted.broken, counted.stopped) == (4, 1, 1, 1, 1)
    assert (counted.idle, len(server.connections)) == (0, 0)
    broken = lines(log, server).pop(-2)
    assert broken.startswith("WARNING D: ")
    assert broken.endswith(": closed")
    assert [line for line in lines(log, server) if line != broken] == [
        "INFO serving unit 1",
        "INFO A connected, 1 in all",
        "INFO B connected, 2 in all",
        "WARNING A: unused longest of 2 connections: closed",
        "INFO C connected, 2 in all",
        "INFO C left, 1 in all",
        "INFO D connected, 2 in all",
        "INFO closed",
    ]


@pytest.mark.parametrize("way", WAYS)
def test_a_connection_that_is_silent(way: str, log: pytest.LogCaptureFixture) -> None:
    with serving(way, "tcp://127.0.0.1:0", idle=0.05) as server, connected(server) as client:
        assert client.recv(1) == b""
        until(lambda: server.statistics.idle == 1)
        adds_up(server)
    assert "INFO A: silent for 0.05 s: closed" in lines(log, server)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("scheme", ["tcp", "udp"])
def test_a_unit_that_is_not_served(way: str, scheme: str, log: pytest.LogCaptureFixture) -> None:
    with serving(way, f"{scheme}://127.0.0.1:0") as server, barewire.ModbusClient(server.url, unit=9) as client:
        for _ in range(15):
            with pytest.raises(ModbusException, match="0B"):
                client.read_coils(0, 1)
    told = [line for line in lines(log_of(log), server) if "unit 9" in line]
    assert len(told) == 11
    assert told[0].endswith(": unit 9 is not served, exception 0B")
    assert "(4 more like this in the last" in told[-1]
    assert (server.statistics.for_others, server.statistics.exceptions, server.statistics.replies) == (15, 15, 15)


def log_of(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    """The same log without the lines of the client, which is in this process too."""
    caplog.records[:] = [record for record in caplog.records if record.name == LOGGER]
    return caplog


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("scheme", ["tcp", "udp", "rtu+tcp"])
def test_all_bytes_at_level_debug(way: str, scheme: str, log: pytest.LogCaptureFixture) -> None:
    log.set_level(logging.DEBUG, LOGGER)
    with serving(way, f"{scheme}://127.0.0.1:0") as server, barewire.ModbusClient(server.url) as client:
        client.read_holding_registers(0, 1)
    told = [line.rpartition(": ")[2] for line in lines(log_of(log), server) if line.startswith("DEBUG")]
    if scheme == "rtu+tcp":
        assert told == ["received 01 03 00 00 00 01 84 0A", "sent 01 03 02 00 00 B8 44"]
    else:
        assert told == ["received 00 01 00 00 00 06 01 03 00 00 00 01", "sent 00 01 00 00 00 05 01 03 02 00 00"]


def test_all_bytes_of_a_pseudo_terminal(log: pytest.LogCaptureFixture) -> None:
    log.set_level(logging.DEBUG, LOGGER)
    with barewire.ModbusServer("rtu://pty", {1: Table()}) as server, barewire.ModbusClient(server.url) as client:
        client.read_holding_registers(0, 1)
    told = lines(log_of(log), server)
    assert told[0] == "INFO serving unit 1"
    assert told[-2:] == ["DEBUG sent 01 03 02 00 00 B8 44", "INFO closed"]


@pytest.mark.parametrize("way", WAYS)
def test_every_request_is_counted_once(way: str) -> None:
    frames = [
        bytes.fromhex("0001 0000 0006 01 03 0000 0001"),  # answered
        bytes.fromhex("0002 0000 0006 01 03 FFFF 0002"),  # exception 02
        bytes.fromhex("0003 0000 0006 09 03 0000 0001"),  # a unit that is not served
        bytes.fromhex("0004 0000 0003 01 83 01"),  # an exception, not a request
    ]
    with serving(way, "tcp://127.0.0.1:0") as server, connected(server) as client:
        client.sendall(b"".join(frames) + b"".join([READ] * 16))  # in one read sixteen are handled
        received = b""
        while len(received) < 11 + 9 + 9 + 12 * 11 + 4 * 9:
            received += client.recv(4096)
        counted = server.statistics
    assert (counted.requests, counted.for_others, counted.not_requests, counted.busy) == (14, 1, 1, 4)
    assert counted.requests + counted.for_others + counted.not_requests + counted.busy == len(frames) + 16
    assert counted.replies == counted.requests + counted.for_others + counted.busy
    assert counted.exceptions == 1 + counted.for_others + counted.busy


def test_a_serial_port_that_is_unplugged_ends_the_server_in_the_log(log: pytest.LogCaptureFixture) -> None:
    terminal, other = os.openpty()
    try:
        server = barewire.ModbusServer(f"rtu://{os.ttyname(other)}", {1: Table()})
        ended = threading.Event()
        server.on_end = ended.set
        with server:
            os.close(terminal)
            assert ended.wait(30)
    finally:
        os.close(other)
    assert server.failure is not None
    assert f"ERROR ended: {server.failure}" in lines(log, server)
