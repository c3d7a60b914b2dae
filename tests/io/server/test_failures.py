"""Errors in the code of a unit: logged with their traceback, and kept in the statistics of the server."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from typing import Any

import pytest

import barewire
from barewire.io.server.failures import FailureLog
from barewire.modbus import Functions, ModbusException, ReadHoldingRegisters

LOGGER = "barewire.modbus.server"
THREADED = ["tcp://127.0.0.1:0", "rtu+tcp://127.0.0.1:0", "udp://127.0.0.1:0", "rtu://pty"]


def no_sensor(address: int, quantity: int) -> Sequence[int]:
    raise ValueError("no sensor")


FAILING = Functions(read_input_registers=no_sensor, read_holding_registers=lambda address, quantity: [0] * quantity)


def check(caplog: pytest.LogCaptureFixture, statistics: Any) -> None:
    (record,) = caplog.records
    assert (record.name, record.levelno) == (LOGGER, logging.ERROR)
    message = record.getMessage()
    assert message == "unit 7: ReadInputRegisters(address=3, quantity=2): its code failed, exception 04: no sensor"
    assert record.exc_info is not None
    assert record.exc_info[0] is ValueError
    assert "no_sensor" in caplog.text  # the function, from the traceback
    assert statistics.failures == ["ValueError: no sensor"]
    assert (statistics.requests, statistics.exceptions) == (2, 1)


@pytest.mark.parametrize("url", THREADED)
def test_a_threaded_server_logs_an_error_of_a_unit_and_keeps_it(url: str, caplog: pytest.LogCaptureFixture) -> None:
    with barewire.ModbusServer(url, {7: FAILING}) as server, barewire.ModbusClient(server.url, unit=7) as client:
        client.read_holding_registers(0, 1)
        with pytest.raises(ModbusException):
            client.read_input_registers(3, 2)
        check(caplog, server.statistics)


@pytest.mark.parametrize("url", THREADED[:3])
def test_an_asyncio_server_logs_an_error_of_a_unit_and_keeps_it(url: str, caplog: pytest.LogCaptureFixture) -> None:
    async def run() -> Any:
        server = barewire.AsyncModbusServer(url, {7: FAILING})
        async with server, barewire.AsyncModbusClient(server.url, unit=7) as client:
            await client.read_holding_registers(0, 1)
            with pytest.raises(ModbusException):
                await client.read_input_registers(3, 2)
            return server.statistics

    check(caplog, asyncio.run(run()))


def test_all_connections_of_a_server_count_in_the_same_statistics() -> None:
    with barewire.ModbusServer(THREADED[0], {1: FAILING}) as server:
        for _ in range(3):
            with barewire.ModbusClient(server.url) as client:
                client.read_holding_registers(0, 1)
        assert (server.statistics.requests, server.statistics.replies) == (3, 3)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Set the time that the log reads."""
    now = [100.0]
    monkeypatch.setattr("barewire.io.server.failures.monotonic", lambda: now[0])
    return lambda value: now.__setitem__(0, value)


def test_a_unit_is_logged_once_per_second(caplog: pytest.LogCaptureFixture, clock: Callable[[float], None]) -> None:
    log = FailureLog()
    request = ReadHoldingRegisters(0, 1)
    for _ in range(5):
        log(1, request, ValueError("a"))
    log(2, request, ValueError("b"))  # another unit has a limit of its own
    clock(100.9)
    log(1, request, ValueError("c"))
    clock(101.0)
    log(1, request, ValueError("d"))
    clock(102.5)
    log(1, request, ValueError("e"))
    texts = [record.getMessage().rpartition("04: ")[2] for record in caplog.records]
    assert texts == ["a", "b", "d (5 more since the last one logged)", "e"]


def test_a_log_that_fails_and_an_error_without_text_do_not_stop_the_server(monkeypatch: pytest.MonkeyPatch) -> None:
    class WithoutText(Exception):
        def __str__(self) -> str:
            raise RuntimeError

    def fail(record: logging.LogRecord) -> bool:
        raise RuntimeError("a wrong filter")

    log = FailureLog()
    log(1, None, WithoutText())
    monkeypatch.setattr(logging.getLogger(LOGGER), "filters", [fail])
    log(2, None, ValueError("x"))
