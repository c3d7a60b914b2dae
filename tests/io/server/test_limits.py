"""Limits of a server: connections, idle time, memory; slow or hostile clients do not delay others.

All tests are for both TCP servers: the one of asyncio, and the one in a thread.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import resource
import socket
from collections.abc import AsyncIterator, Iterator
from itertools import islice
from typing import Any, NamedTuple

import pytest

from barewire import AsyncModbusClient, AsyncModbusServer, ModbusServer
from barewire.ascii import encode as ascii_frame
from barewire.errors import EncodeError
from barewire.io.endpoint import Endpoint
from barewire.io.server.limits import ConnectionTable
from barewire.modbus import Authorization, Table
from barewire.rtu import encode as rtu_frame
from tests.helpers import refused
from tests.io.schemes import NETWORK

READ = bytes.fromhex("0001 0000 0006 01 03 0000 0001")
ANSWER = bytes.fromhex("0001 0000 0005 01 03 02 0000")
REFUSED = bytes.fromhex("0001 0000 0003 01 83 01")
MOST = bytes.fromhex("0001 0000 0006 01 03 0000 007D")
"""A request of 12 bytes with an answer of 259."""


@pytest.fixture
def many_files() -> Iterator[None]:
    """Both ends of a thousand connections are more files than the default limit of most systems."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, max(soft, 4096)), hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


class Serving(NamedTuple):
    """A running server: its port and its connections."""

    port: int
    connections: ConnectionTable[Any]


@contextlib.asynccontextmanager
async def serving(way: str, scheme: str = "tcp", **options: object) -> AsyncIterator[Serving]:
    url = f"{scheme}://127.0.0.1:0?{'&'.join(f'{key}={value}' for key, value in options.items())}"
    if way == "thread":
        with ModbusServer(url, units={1: Table()}) as host:
            yield Serving(host.port, host.connections)
    else:
        async with AsyncModbusServer(url, {1: Table()}) as server:
            yield Serving(server.port, server.connections)


both = pytest.mark.parametrize("way", ["asyncio", "thread"])


class Client:
    """A raw connection."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer

    @classmethod
    async def of(cls, server: Serving) -> Client:
        return cls(*await asyncio.open_connection("127.0.0.1", server.port))

    async def ask(self, read: bytes = READ, answer: bytes = ANSWER) -> bytes:
        self.writer.write(read)
        return await asyncio.wait_for(self.reader.readexactly(len(answer)), 60)

    async def is_closed(self) -> bool:
        try:
            return await asyncio.wait_for(self.reader.read(), 60) == b""
        except ConnectionError:
            return True

    async def close(self) -> None:
        self.writer.transport.abort()
        with contextlib.suppress(OSError):
            await self.writer.wait_closed()


PDU, VALUE = bytes.fromhex("03 0000 0001"), bytes.fromhex("03 02 0000")
EXCHANGES = {
    "tcp": (READ, ANSWER),
    "rtu+tcp": (rtu_frame(1, PDU), rtu_frame(1, VALUE)),
    "ascii+tcp": (ascii_frame(1, PDU), ascii_frame(1, VALUE)),
}


@pytest.mark.parametrize(("way", "scheme"), [("thread", "tcp"), *(("asyncio", scheme) for scheme in EXCHANGES)])
@pytest.mark.usefixtures("many_files")
def test_a_thousand_connections_at_once_each_served(way: str, scheme: str) -> None:
    async def main() -> None:
        read, answer = EXCHANGES[scheme]
        async with serving(way, scheme) as server:
            clients = await asyncio.gather(*(Client.of(server) for _ in range(1000)))
            for _ in range(3):
                reported = await asyncio.gather(*(client.ask(read, answer) for client in clients))
                assert set(reported) == {answer}
            assert len(server.connections) == 1000
            await asyncio.gather(*(client.close() for client in clients))

    asyncio.run(main())


@both
def test_over_the_limit_the_longest_silent_connection_is_closed(way: str) -> None:
    async def main() -> None:
        async with serving(way, connections=3) as server:
            clients = [await Client.of(server) for _ in range(3)]
            for client in clients:
                await client.ask()
            await clients[0].ask()  # so the second is now the one that was silent longest
            clients.append(await Client.of(server))
            assert await clients[3].ask() == ANSWER
            assert await clients[1].is_closed()
            assert [await clients[place].ask() for place in (0, 2, 3)] == [ANSWER] * 3
            assert "unused longest of 3 connections" in server.connections.closed[-1]
            await asyncio.gather(*(client.close() for client in clients))

    asyncio.run(main())


@both
@pytest.mark.parametrize("message", [b"", READ[:7]])
def test_over_the_limit_connections_without_requests_are_closed_first(way: str, message: bytes) -> None:
    async def main() -> None:
        async with serving(way, connections=3) as server:
            working = await Client.of(server)
            await working.ask()
            idle = []
            for _ in range(6):
                client = await Client.of(server)
                client.writer.write(message)
                idle.append(client)
            newcomer = await Client.of(server)
            assert await newcomer.ask() == ANSWER
            assert await working.ask() == ANSWER  # still connected, though it was silent longest
            # All but one of the idle ones; which one depends on the order in which the half requests were received.
            ends = [asyncio.ensure_future(client.is_closed()) for client in idle]
            assert [await end for end in islice(asyncio.as_completed(ends), 5)] == [True] * 5
            await asyncio.gather(*(end for end in ends if end.cancel()), return_exceptions=True)
            assert "unused longest of 3 connections" in server.connections.closed[-1]
            await asyncio.gather(*(client.close() for client in (working, newcomer, *idle)))

    asyncio.run(main())


@both
def test_an_idle_connection_is_closed_even_after_half_a_request(way: str) -> None:
    async def main() -> None:
        async with serving(way, idle=2) as server:
            silent, half, busy = [await Client.of(server) for _ in range(3)]
            half.writer.write(READ[:5])
            for _ in range(1200):
                await asyncio.sleep(0.05)
                assert await busy.ask() == ANSWER
                if len(server.connections.closed) == 2:
                    break
            assert await silent.is_closed()
            assert await half.is_closed()
            assert len(server.connections) == 1
            assert "silent for 2 s" in server.connections.closed[-1]
            await asyncio.gather(*(client.close() for client in (silent, half, busy)))

    asyncio.run(main())


@both
def test_a_client_that_never_reads_takes_no_memory_and_delays_no_other(way: str) -> None:
    async def main() -> None:
        async with serving(way) as server:
            greedy = socket.socket()
            greedy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            greedy.connect(("127.0.0.1", server.port))
            greedy.setblocking(False)
            async with AsyncModbusClient(f"tcp://127.0.0.1:{server.port}") as client:
                sent = stalled = most = 0
                while stalled < 50:
                    try:
                        sent += greedy.send(MOST * 300)
                    except BlockingIOError:
                        stalled += 1
                    assert await client.read_holding_registers(0, 1) == (0,)  # meanwhile
                    most = max(most, server.connections.unsent)
            # The buffers of the system limit the requests; the answers to them would be a multiple.
            assert 0 < most < 200_000
            assert sent // len(MOST) * 259 > 2 * most
            greedy.close()

    asyncio.run(main())


@both
def test_many_clients_that_send_single_bytes_delay_no_other(way: str) -> None:
    async def main() -> None:
        async with serving(way) as server, AsyncModbusClient(f"tcp://127.0.0.1:{server.port}") as client:
            slow = [await Client.of(server) for _ in range(50)]
            for byte in READ:
                for connection in slow:
                    connection.writer.write(bytes([byte]))
                assert await client.read_holding_registers(0, 1) == (0,)
            got = [await connection.reader.readexactly(len(ANSWER)) for connection in slow]
            assert got == [ANSWER] * 50
            await asyncio.gather(*(connection.close() for connection in slow))

    asyncio.run(main())


@both
def test_a_connection_that_is_not_modbus_is_closed_and_the_reason_kept(way: str) -> None:
    async def main() -> None:
        async with serving(way) as server:
            client = await Client.of(server)
            client.writer.write(b"GET / HTTP/1.1\r\n\r\n")
            assert await client.is_closed()
            assert "protocol identifier is 54 20, Modbus has 00 00" in server.connections.closed[-1]
            await client.close()

    asyncio.run(main())


def test_a_wrong_limit_is_an_error() -> None:
    with refused(EncodeError, "connections 0: expected 1 or more"):
        AsyncModbusServer("tcp://127.0.0.1:0?connections=0", {1: Table()})
    with refused(EncodeError, "connections 0: expected 1 or more"):
        ModbusServer("tcp://127.0.0.1:0?connections=0", units={1: Table()})


def test_without_free_descriptors_the_longest_silent_connection_is_closed() -> None:
    """A server without free file descriptors must neither loop without pause nor stop accepting connections."""
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table()}) as host, contextlib.ExitStack() as closing:
        address = Endpoint.parse(host.url).host_and_port

        def client() -> socket.socket:
            made = closing.enter_context(socket.create_connection(address, timeout=10))
            made.sendall(READ)
            return made

        silent, busy = client(), client()
        assert (silent.recv(64), busy.recv(64)) == (ANSWER, ANSWER)
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        # Room for the socket of the next client only: all files of the test itself have lower numbers.
        spare = os.dup(busy.fileno())
        os.close(spare)
        resource.setrlimit(resource.RLIMIT_NOFILE, (spare + 1, hard))
        try:
            assert client().recv(64) == ANSWER
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        assert silent.recv(64) == b""
        busy.sendall(READ)
        assert busy.recv(64) == ANSWER
        assert "there was no room for another connection: too many open files" in host.connections.closed[-1]


@pytest.mark.parametrize("scheme", [scheme for scheme in NETWORK if scheme != "tls"])
def test_a_server_that_was_never_started_releases_its_port(scheme: str) -> None:
    host = ModbusServer(f"{scheme}://127.0.0.1:0", units={1: Table()})
    host.close()
    ModbusServer(host.url, units={1: Table()}).close()  # the same port


def test_a_table_of_roles_applies_to_connections_without_a_role() -> None:
    """A connection without TLS has no role, so the table permits nothing. The constructor fixes it:
    a later table would not apply to open connections."""
    viewer_table = Authorization.parse('{"Viewer": [{}]}')

    async def main() -> None:
        async with AsyncModbusServer("tcp://127.0.0.1:0", {1: Table()}, authorization=viewer_table) as server:
            assert server.authorization is viewer_table
            client = await Client.of(Serving(server.port, server.connections))
            assert await client.ask(READ, REFUSED) == REFUSED
            await client.close()
        async with AsyncModbusServer("tcp://127.0.0.1:0", {1: Table()}) as server:
            with pytest.raises(AttributeError):
                server.authorization = viewer_table  # type: ignore[misc]

    asyncio.run(main())
