"""A client that is closed while a request is under way, waits, or connects: the request ends, nothing follows it."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from typing import Any

import pytest

from barewire import AsyncModbusClient, ModbusClient, ModbusServer, Table
from barewire.errors import PortError
from barewire.io.modbus import async_client
from barewire.io.ports import async_links
from barewire.modbus import WriteOutcomeUnknown
from tests.helpers import PATIENCE, refused, until
from tests.io.peers import peer, read_exactly

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
