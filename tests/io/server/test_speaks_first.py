"""A server that sends before the first request: its data are counted, and the request is answered."""

from __future__ import annotations

import asyncio
import socket

import pytest

from barewire import AsyncModbusClient, ModbusClient
from tests.io.peers import honest, peer

GREETING = bytes.fromhex("00 00 00 00 00 03 01 03 00")


def greets(connection: socket.socket) -> None:
    connection.sendall(GREETING)
    honest(connection)


def test_the_blocking_client_skips_unrequested_data() -> None:
    with peer(greets) as port, ModbusClient(f"tcp://127.0.0.1:{port}?timeout=5") as client:
        assert client.read_holding_registers(7, 1) == (7,)


@pytest.mark.parametrize("in_flight", [1, 4])
def test_the_asyncio_client_skips_unrequested_data(in_flight: int) -> None:
    async def main(port: int) -> None:
        for _ in range(20):  # the data arrive while the client connects, or just after
            async with AsyncModbusClient(f"tcp://127.0.0.1:{port}?timeout=5", in_flight=in_flight) as client:
                await asyncio.sleep(0)
                assert await client.read_holding_registers(7, 1) == (7,)

    with peer(greets) as port:
        asyncio.run(main(port))
