"""The log of both Modbus clients: connections, time-outs, late answers, bytes."""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest

import barewire
from barewire.errors import BarewireError
from barewire.modbus import ReadHoldingRegisters, Table
from barewire.rtu import encode

LOGGER = "barewire.modbus.client"
Use = Callable[[str, int, dict[str, Any]], None]


def blocking(url: str, requests: int, options: dict[str, Any]) -> None:
    """Send so many requests, and ignore their errors."""
    with barewire.ModbusClient(url, lazy=True, **options) as client:
        for _ in range(requests):
            with suppress(BarewireError):
                client.read_holding_registers(0, 1)


def with_asyncio(url: str, requests: int, options: dict[str, Any]) -> None:
    """Do the same with the asyncio client."""

    async def main() -> None:
        async with barewire.AsyncModbusClient(url, lazy=True, **options) as client:
            for _ in range(requests):
                with suppress(BarewireError):
                    await client.read_holding_registers(0, 1)

    asyncio.run(main())


def in_flight(url: str, requests: int, options: dict[str, Any]) -> None:
    """Do the same with the asyncio client that may have several requests under way."""
    with_asyncio(url, requests, {"in_flight": 2, **options})


BOTH = pytest.mark.parametrize("use", [blocking, with_asyncio, in_flight])


@contextmanager
def peer(answers: list[list[bytes]]) -> Iterator[str]:
    """A server that sends the next answers after each request, and closes the connection when there are none left."""

    def serve() -> None:
        with listener.accept()[0] as connection:
            for parts in answers:
                connection.recv(260)
                for part in parts:
                    connection.sendall(part)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve)
        thread.start()
        yield f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        thread.join(30)


def texts(caplog: pytest.LogCaptureFixture, url: str) -> list[str]:
    """The lines of the client, without their beginning."""
    lines = [record.getMessage() for record in caplog.records if record.name == LOGGER]
    assert all(line.startswith(f"{url}: ") for line in lines)
    return [line.removeprefix(f"{url}: ") for line in lines]


@BOTH
def test_connections_of_a_client(use: Use, log: pytest.LogCaptureFixture) -> None:
    with barewire.ModbusServer("tcp://127.0.0.1:0", {1: Table()}) as server:
        use(server.url, 2, {})
    assert texts(log, server.url) == ["connected", "closed"]
    log.clear()
    # Nothing listens any more. The second request does not wait until the next attempt.
    use(server.url, 2, {"timeout": 0.0, "jitter": lambda: 0.5})
    assert texts(log, server.url) == ["not connected: connection refused; next attempt after 0.12 s"]


@BOTH
def test_a_connection_that_ended_and_the_next_one(use: Use, log: pytest.LogCaptureFixture) -> None:
    with peer([[]]) as url:
        use(url, 1, {})
        found = texts(log, url)
    assert found == ["connected", "connection given up: the other side closed the connection"]


@BOTH
def test_a_time_out_and_its_late_answer(use: Use, log: pytest.LogCaptureFixture) -> None:
    late = bytes.fromhex("0001 0000 0005 01 03 02 0007")
    answer = bytes.fromhex("0002 0000 0005 01 03 02 0008")
    with peer([[], [late, answer]]) as url:
        use(url, 2, {"timeout": 0.2})
    first, second, third, last = texts(log, url)
    assert (first, last) == ("connected", "closed")
    assert second == "unit 1 did not answer Read Holding Registers within 0.2 s"
    number = "no request has this transaction number: 00 01 00 00 00 05 01 03 02 00 07"
    shown = number if use is in_flight else "a frame from unit 1, function 03, transaction 1"
    assert third == f"discarded: {shown}"


def test_a_late_answer_on_a_serial_line_names_its_request(log: pytest.LogCaptureFixture) -> None:
    answers = [[], [encode(1, bytes.fromhex("03 02 00 07")), encode(1, bytes.fromhex("88 01"))], [], []]
    with peer(answers) as url:
        use_url = url.replace("tcp:", "rtu+tcp:")
        blocking(use_url, 2, {"timeout": 0.3})
    late = ReadHoldingRegisters(0, 1)
    assert f"late answer discarded: unit 1, to {late}: 03 02 00 07" in texts(log, use_url)


@BOTH
def test_all_bytes_at_level_debug(use: Use, log: pytest.LogCaptureFixture) -> None:
    log.set_level(logging.DEBUG, LOGGER)
    shown: list[str] = []
    with barewire.ModbusServer("tcp://127.0.0.1:0", {1: Table()}) as server:
        use(server.url, 1, {"watch": lambda direction, data: shown.append(f"{direction} {data.hex(' ').upper()}")})
    sent, received = "sent 00 01 00 00 00 06 01 03 00 00 00 01", "received 00 01 00 00 00 05 01 03 02 00 00"
    assert texts(log, server.url) == ["connected", sent, received, "closed"]
    assert shown == [sent, received]


@pytest.mark.parametrize("use", [blocking, with_asyncio])
def test_a_dead_unit_does_not_flood_the_log(use: Use, log: pytest.LogCaptureFixture) -> None:
    with barewire.ModbusServer("rtu+tcp://127.0.0.1:0", {9: Table()}) as server:
        use(server.url, 25, {"timeout": 0.001, "recovery": "wait", "late_window": 0.001})
    silent = [text for text in texts(log, server.url) if text.startswith("unit 1 ")]
    assert len(silent) == 11  # ten, and one when the client was closed
    assert silent[-1].rpartition(" in the last ")[0].endswith("(14 more like this")
