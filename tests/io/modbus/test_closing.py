"""A client that is closed while a request is under way, waits, or connects: the request ends, nothing follows it."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Callable
from typing import Any

import pytest

from barewire import AsyncModbusClient, ModbusClient, ModbusServer, Table
from barewire.errors import PortError
from barewire.io.modbus import async_client
from barewire.io.ports import async_links
from barewire.modbus import WriteOutcomeUnknown
from tests.certificates import tls_url
from tests.helpers import PATIENCE, refused, until
from tests.io.peers import peer, read_exactly
from tests.io.schemes import EVERY_SCHEME, SERIAL

CLIENTS: list[Any] = [ModbusClient, AsyncModbusClient]


def write_one(client: Any, address: int, value: int) -> None:
    """Write a register with a client of either world, which is not closed after it."""
    if isinstance(client, ModbusClient):
        client.write_single_register(address, value)
    else:
        asyncio.run(client.write_single_register(address, value))


def closing_after(client: Any, call: Callable[..., Any]) -> Callable[..., Any]:
    """The same function, but the client is closed as soon as it has returned."""

    def closing(*arguments: Any) -> Any:
        result = call(*arguments)
        client.connection.close()
        return result

    async def closing_later(*arguments: Any) -> Any:
        result = await call(*arguments)
        client.connection.close()
        return result

    return closing_later if asyncio.iscoroutinefunction(call) else closing


@pytest.mark.parametrize("kind", CLIENTS)
@pytest.mark.parametrize("when", ["in the pause", "while it connects"])
def test_a_client_closed_before_it_is_connected_stays_closed(
    kind: Any, when: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = Table()
    lost: list[str] = []
    with ModbusServer("tcp://127.0.0.1:0", {1: table}) as server:
        client = kind(server.url, lazy=True, timeout=PATIENCE, on_lost=lost.append)
        connection = client.connection
        if when == "in the pause":
            pause = closing_after(client, connection.pause_before_opening)
            monkeypatch.setattr(connection, "pause_before_opening", pause)
        elif kind is ModbusClient:
            monkeypatch.setattr(connection, "_dial", closing_after(client, connection._dial))
        else:
            monkeypatch.setattr(async_client, "connect", closing_after(client, async_links.connect))
        for _ in range(2):
            with refused(PortError, "the client was closed"):
                write_one(client, 5, 4242)
            assert not client.connected
        until(lambda: not server.connections)
    assert table.holding_registers[5] == 0
    assert lost == []


@pytest.mark.parametrize("kind", CLIENTS)
def test_on_lost_may_close_the_client(kind: Any) -> None:
    lost: list[str] = []

    def on_lost(why: str) -> None:
        lost.append(why)
        client.connection.close()

    async def drop() -> None:
        await client.open()
        client.connection.drop("not aligned")

    def hang_up(connection: socket.socket) -> None:
        read_exactly(connection, 12)

    with peer(hang_up) as port:
        client = kind(f"tcp://127.0.0.1:{port}", lazy=True, timeout=PATIENCE, on_lost=on_lost)
        with pytest.raises(WriteOutcomeUnknown):
            write_one(client, 5, 4242)
        assert not client.connected
        assert len(lost) == 1
        client = kind(f"tcp://127.0.0.1:{port}", lazy=True, timeout=PATIENCE, on_lost=on_lost)
        if kind is AsyncModbusClient:
            asyncio.run(drop())
        else:
            client.open()
            client.connection.drop("not aligned")
        assert not client.connected
        assert lost[1:] == ["not aligned"]


@EVERY_SCHEME
def test_closing_ends_a_request_that_waits_for_its_response(scheme: str, request: pytest.FixtureRequest) -> None:
    url, query = f"{scheme}://{'pty' if scheme in SERIAL else '127.0.0.1:0'}", ""
    if scheme == "tls":
        files = request.getfixturevalue("certificates")
        url, query = tls_url(files, "server", roles="any"), tls_url(files, "operator").partition("?")[2]
    arrived = threading.Event()
    errors: list[str] = []

    def read() -> None:
        try:
            client.read_holding_registers(0, 1)
        except PortError as error:
            errors.append(str(error))

    with ModbusServer(url, {1: Table()}, faults={"drop": 1.0}, on_fault=lambda _: arrived.set()) as server:
        client = ModbusClient(f"{server.url.partition('?')[0]}?{query}", timeout=2 * PATIENCE)
        place = client.connection.endpoint.place
        threads = [threading.Thread(target=read) for _ in range(2)]  # one waits for its response, one for its turn
        for thread in threads:
            thread.start()
        assert arrived.wait(PATIENCE)
        client.close()
        for thread in threads:
            thread.join(PATIENCE)
        assert sorted(errors) == sorted([f"{place}: the port was closed", "the client was closed"])
        for thread in threads:
            thread.join()
