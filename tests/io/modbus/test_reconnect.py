"""Options for lines with faults and devices that are off: `retries`, the bounds of the pauses, `lazy` and `open`."""

from __future__ import annotations

import asyncio
import socket
import time
from typing import Any

import pytest

from barewire import (
    AsyncCanopenClient,
    AsyncModbusClient,
    CanopenClient,
    EncodeError,
    ModbusClient,
    ModbusServer,
    NoAnswer,
    PortError,
    Table,
    connect,
)
from barewire.io.endpoint import CARRIERS, Endpoint
from barewire.modbus import ReadHoldingRegisters, WriteOutcomeUnknown
from tests.helpers import PATIENCE, free_port, refused
from tests.io.peers import honest, peer, read_exactly
from tests.io.schemes import EVERY_SCHEME_WITHOUT_TLS, SERIAL

CLIENTS: list[Any] = [ModbusClient, AsyncModbusClient]


def hang_up(connection: socket.socket) -> None:
    read_exactly(connection, 12)


def deaf_once(connection: socket.socket) -> None:
    """Leaves one request without an answer, then answers."""
    read_exactly(connection, 12)
    honest(connection)


# retries


@pytest.mark.parametrize("scheme", CARRIERS)
def test_every_carrier_of_modbus_has_retries(scheme: str) -> None:
    place = "/dev/x" if scheme in SERIAL else "127.0.0.1:1"
    assert Endpoint.parse(f"{scheme}://{place}?retries=3").integer("retries", 0) == 3
    with refused(EncodeError, "retries -1: expected 0..1000"):
        Endpoint.parse(f"{scheme}://{place}?retries=-1")


@EVERY_SCHEME_WITHOUT_TLS
def test_a_line_that_loses_answers_can_be_read_from(scheme: str) -> None:
    """Each method reads, with both clients, although a third of the answers are missing: the seed is one that drops
    the answer of at least one of the first requests."""
    place = "pty" if scheme in SERIAL else "127.0.0.1:0"
    # Sending takes no time on this line, so that a time-out can be short: a slow machine needs more of them.
    retries = int(PATIENCE / 0.1)
    url = f"{scheme}://{place}{'?pace=0' if scheme in SERIAL else ''}"
    dropped: list[str] = []
    with ModbusServer(url, units={1: Table()}, faults={"drop": 0.3}, fault_seed=7, on_fault=dropped.append) as server:
        with ModbusClient(server.url, timeout=0.1, retries=retries) as client:
            for _ in range(3):
                assert client.read_holding_registers(0, 2) == (0, 0)
                assert client.at(unit=1).ask(ReadHoldingRegisters(0, 1)).registers == (0,)
                assert client.read("adxl", "Status")[0].value == 0
            assert client.read_device_identification().objects[0] == b"barewire"

        async def main() -> None:
            async with AsyncModbusClient(server.url, timeout=0.1, retries=retries) as client:
                for _ in range(2):
                    assert await client.read_holding_registers(0, 2) == (0, 0)
                    assert (await client.read("adxl", "Status"))[0].value == 0

        asyncio.run(main())
    assert dropped


def test_retries_of_a_call_override_those_of_the_url_and_a_write_is_not_repeated() -> None:
    with (
        peer(deaf_once) as port,
        ModbusClient(f"tcp://127.0.0.1:{port}?retries=3&timeout=0.05") as client,
        pytest.raises(NoAnswer),
    ):
        client.ask(ReadHoldingRegisters(7, 1), retries=0)
    with (
        peer(deaf_once) as port,
        ModbusClient(f"tcp://127.0.0.1:{port}?retries=3&timeout=0.05") as client,
        pytest.raises(WriteOutcomeUnknown),
    ):
        client.write_single_register(7, 1)


def test_retries_connect_again() -> None:
    with peer(hang_up, honest) as port, ModbusClient(f"tcp://127.0.0.1:{port}?retries=1") as client:
        assert client.read_holding_registers(7, 1) == (7,)

    async def main(port: int) -> None:
        async with AsyncModbusClient(f"tcp://127.0.0.1:{port}?retries=1") as client:
            assert await client.read_holding_registers(7, 1) == (7,)

    with peer(hang_up, honest) as port:
        asyncio.run(main(port))


def read_one(client: Any) -> object:
    """Read a register with a client of either world, and close it."""
    if isinstance(client, ModbusClient):
        with client:
            return client.read_holding_registers(0, 1)

    async def main() -> object:
        async with client:
            return await client.read_holding_registers(0, 1)

    return asyncio.run(main())


@pytest.mark.parametrize("client", CLIENTS)
@pytest.mark.parametrize(("first", "attempts"), [(0.2, 3), (1000, 1)])
def test_a_retry_waits_for_the_pause_and_none_is_made_if_that_is_longer_than_the_time_out(
    client: Any, first: float, attempts: int
) -> None:
    """Of the pauses 0.2, 0.4 and 0.8 s the last one is longer than the time-out."""
    drawn: list[float] = []

    def jitter() -> float:
        drawn.append(0.5)
        return 0.5

    url = f"tcp://127.0.0.1:{free_port()}?retries=1000&timeout=0.5&reconnect_first={first}"
    with refused(PortError, "connection refused") as caught:
        read_one(client(url, lazy=True, jitter=jitter))
    assert "tried again" not in str(caught.value)
    assert len(drawn) == attempts


@pytest.mark.parametrize("client", CLIENTS)
def test_a_closed_client_makes_no_retry(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    one = client("tcp://127.0.0.1:1?retries=1000", lazy=True)
    one.connection.close()
    run, runs = one.connection.run, []

    def counted(*arguments: Any) -> Any:
        runs.append(arguments)
        return run(*arguments)

    monkeypatch.setattr(one.connection, "run", counted)
    with refused(PortError, "the client was closed"):
        read_one(one)
    assert len(runs) == 1


# The bounds of the pauses


@pytest.mark.parametrize(
    ("query", "bounds"),
    [
        ("", (0.125, 30.0)),
        ("reconnect_first=1&reconnect_longest=4", (1.0, 4.0)),
        ("reconnect_first=60", (60.0, 60.0)),
        ("reconnect_longest=0.05", (0.05, 0.05)),
    ],
)
@pytest.mark.parametrize("place", ["tcp://127.0.0.1:1", "rtu:///dev/x", "can://socketcan/can0"])
def test_the_bounds_of_a_url(place: str, query: str, bounds: tuple[float, float]) -> None:
    assert Endpoint.parse(f"{place}?{query}").pauses == bounds


@pytest.mark.parametrize(
    ("query", "message"),
    [
        ("reconnect_first=0", "reconnect_first='0': expected 0.001 s or more"),
        ("reconnect_longest=0.0001", "reconnect_longest='0.0001': expected 0.001 s or more"),
        ("reconnect_first=2&reconnect_longest=1", "reconnect_longest='1': expected reconnect_first=2 or more"),
        ("reconnect_first=soon", "reconnect_first='soon' is not a number of seconds"),
    ],
)
def test_wrong_bounds_are_an_error(query: str, message: str) -> None:
    for place in ("udp://127.0.0.1:1", "can://socketcan/can0"):
        with refused(EncodeError, message):
            Endpoint.parse(f"{place}?{query}")


@pytest.mark.parametrize("client", CLIENTS)
def test_the_pauses_of_a_modbus_client_have_the_bounds_of_its_url_or_keywords(client: Any) -> None:
    for one in (
        client("tcp://127.0.0.1:1?reconnect_first=2&reconnect_longest=5", lazy=True, jitter=lambda: 0.5),
        client("tcp://127.0.0.1:1", reconnect_first=2, reconnect_longest=5.0, lazy=True, jitter=lambda: 0.5),
    ):
        waits = []
        for _ in range(4):
            one.connection.back_off.failed(0.0, "off")
            waits.append(one.connection.back_off.wait(0.0))
        assert waits == [2, 4, 5, 5]


def test_the_pauses_of_a_bus_have_the_bounds_of_its_url() -> None:
    url = "can://virtual/pauses?reconnect_first=2&reconnect_longest=5"

    def check(reopening: Any) -> None:
        reopening.back_off.failed(0.0, "off")
        assert 1.5 <= reopening.back_off.wait(0.0) <= 2.5

    with CanopenClient(url) as bus:
        check(bus.bus._reopening)

    async def main() -> None:
        async with AsyncCanopenClient("can://virtual/pauses", reconnect_first=2) as bus:
            check(bus.bus._reopening)

    asyncio.run(main())


# A device that is off when the program starts


def test_open_by_hand_ends_the_pause_and_begins_with_the_first_one_again() -> None:
    port = free_port()
    url = f"tcp://127.0.0.1:{port}?reconnect_first=1000&timeout=5"
    with ModbusClient(url, lazy=True, jitter=lambda: 0.5) as client:
        for text in ("connection refused", "connection refused; tried again in "):
            with refused(PortError, text):
                client.read_holding_registers(0, 1)
        with refused(PortError, "connection refused"):
            client.open()
        assert 990 < client.connection.back_off.wait(time.monotonic()) <= 1000  # the first pause, not the second
        with ModbusServer(f"tcp://127.0.0.1:{port}", units={1: Table()}):
            with refused(PortError, "tried again in "):
                client.read_holding_registers(0, 1)
            client.open()
            assert client.read_holding_registers(0, 1) == (0,)
            client.open()  # it is open already: nothing happens
            assert client.read_holding_registers(0, 1) == (0,)

    async def main() -> None:
        async with AsyncModbusClient(url, lazy=True, jitter=lambda: 0.5) as client:
            for text in ("connection refused", "connection refused; tried again in "):
                with refused(PortError, text):
                    await client.read_holding_registers(0, 1)
            with ModbusServer(f"tcp://127.0.0.1:{port}", units={1: Table()}):
                await client.open()
                assert await client.read_holding_registers(0, 1) == (0,)

    asyncio.run(main())
    with refused(PortError, "the client was closed"):
        client.open()


def test_a_machine_by_name_may_be_off_when_the_program_starts() -> None:
    port = free_port()
    url = f"tcp://127.0.0.1:{port}?reconnect_longest=0.01&timeout=5"
    with connect("adxl", url, lazy=True) as machine:
        with refused(PortError, "connection refused"):
            machine.read("Status")
        with ModbusServer(f"tcp://127.0.0.1:{port}", units={1: Table()}):
            assert machine.read("Status").value == 0
