"""The limits of servers: of connections and of datagrams, in virtual time, and on real ports."""

from __future__ import annotations

import asyncio
import contextlib
import os
import resource
import socket
import time
from collections.abc import AsyncIterator, Callable, Iterator
from itertools import islice
from typing import Any, NamedTuple

import pytest
from hypothesis import given, strategies as st

from barewire import AsyncModbusClient, AsyncModbusServer, ModbusServer, Table
from barewire.ascii import encode as ascii_frame
from barewire.errors import EncodeError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.network import is_own_address
from barewire.io.server.limits import COPIES, RATE, ConnectionTable, DatagramLimits
from barewire.modbus import Authorization
from barewire.rtu import encode as rtu_frame
from tests.helpers import modest, refused
from tests.io.schemes import NETWORK


class Fake:
    """A connection. `abort` may remove it from the table, as in the threaded server, or not, as in asyncio."""

    def __init__(self, name: str, table: ConnectionTable[Fake], removes_itself: bool = True) -> None:
        self.peer, self.was_answered, self.aborted = name, False, 0
        self._table, self._removes_itself = table, removes_itself

    unsent = 7

    def abort(self) -> None:
        self.aborted += 1
        if self._removes_itself:
            self._table.remove(self)


def table_with(**options: object) -> ConnectionTable[Fake]:
    return ConnectionTable(Endpoint.parse("tcp://host?" + "&".join(f"{key}={value}" for key, value in options.items())))


def connected(found: ConnectionTable[Fake], *names: str, now: float = 0.0) -> list[Fake]:
    """Add new connections, each a second later than the one before."""
    made = [Fake(name, found) for name in names]
    for place, connection in enumerate(made):
        found.add(connection, now + place)
    return made


def peers(found: ConnectionTable[Fake]) -> str:
    return "".join(connection.peer for connection in found.open)


# Too many connections -------------------------------------------------------------------------------------------------


def test_the_longest_silent_unanswered_connection_is_closed_first() -> None:
    found = table_with(connections=3)
    a, b, c = connected(found, "a", "b", "c")
    a.was_answered = c.was_answered = True
    found.received(b, 9.0)
    (d,) = connected(found, "d", now=10.0)
    assert peers(found) == "acd"
    d.was_answered = True
    found.received(a, 11.0)
    connected(found, "e", now=12.0)
    assert peers(found) == "ade"
    assert list(found.closed) == [f"{name}: unused longest of 3 connections" for name in "bc"]
    assert [connection.aborted for connection in (a, b, c, d)] == [0, 1, 1, 0]
    assert found.unsent == 21


def test_of_equally_silent_connections_the_oldest_is_closed() -> None:
    found = table_with(connections=3)
    a, b, c = connected(found, "a", "b", "c")
    for connection in (c, b, a):
        found.received(connection, 5.0)
    connected(found, "d", now=5.0)
    assert peers(found) == "bcd"


def test_with_a_limit_of_one_the_newest_connection_stays() -> None:
    found = table_with(connections=1)
    first, _ = connected(found, "a", "b")
    assert peers(found) == "b"
    first.was_answered = True
    connected(found, *"cdefg", now=5.0)
    assert peers(found) == "g"
    assert len(found.closed) == 6


def test_a_flood_of_idle_connections_does_not_displace_working_ones() -> None:
    found = table_with(connections=300)
    known = connected(found, *map(str, range(299)))
    for connection in known:
        connection.was_answered = True
    connected(found, *(f"new {number}" for number in range(1000)), now=1000.0)
    assert all(connection in found.open for connection in known)
    assert len(found.open) == 300
    assert len(found.closed) == 16


# Silent for too long -------------------------------------------------------------------------------------------------


def test_idle_connections_are_closed_exactly_at_the_time_out() -> None:
    found = table_with(idle=10)
    assert found.close_idle(0.0) is None
    a, _, c = connected(found, "a", "b", "c")
    assert found.close_idle(9.75) == 10.0
    found.received(a, 9.75)
    assert found.close_idle(10.0) == 11.0
    found.remove(c)
    assert found.close_idle(11.0) == 19.75
    assert peers(found) == "a"
    assert found.close_idle(19.75) is None
    assert list(found.closed) == ["b: silent for 10 s", "a: silent for 10 s"]
    connected(found, "d", now=30.0)
    assert found.close_idle(30.0) == 40.0


def test_a_changed_idle_time_out_applies_at_once() -> None:
    found = table_with()
    connected(found, "a", "b")
    assert found.close_idle(1000.0) is None
    found.idle_timeout = 2000.0
    assert found.close_idle(1000.0) == 2000.0
    found.idle_timeout = 999.5
    assert found.close_idle(1000.0) == 1000.5
    assert peers(found) == "b"
    found.idle_timeout = 0.0
    assert found.close_idle(5000.0) is None
    found.idle_timeout = 1.0
    assert found.close_idle(5000.0) is None
    assert peers(found) == ""


def test_a_connection_that_ends_with_another_is_closed_once() -> None:
    """Two connections of one client: closing one may close both."""
    found = table_with(idle=1)
    a, b = connected(found, "a", "b")
    a.abort = lambda: (found.remove(a), found.remove(b))  # type: ignore[assignment, func-returns-value]
    assert found.close_idle(100.0) is None
    assert (list(found.closed), b.aborted) == (["a: silent for 1 s"], 0)


# Any sequence of events -----------------------------------------------------------------------------------------------

STEPS = st.lists(
    st.tuples(
        st.sampled_from(
            ["connect", *["request"] * 3, "disconnect", "answer", "close_idle", "close_idle", "new idle_timeout"]
        ),
        st.integers(0, 7),
        st.sampled_from([0.0, 0.0, 0.25, 1.0, 2.5]),
    ),
    max_size=60,
)


@modest
@given(STEPS, st.integers(1, 5), st.sampled_from([0.0, 1.0, 2.5]), st.booleans())
def test_the_table_follows_the_simple_rule_for_any_sequence_of_events(
    steps: list[tuple[str, int, float]], most: int, idle: float, removes_itself: bool
) -> None:
    """The rule: a list in the order of the last requests. Steps may take no time; a connection that has ended may still
    send a request."""
    found = table_with(connections=most, idle=idle)
    connections = [Fake(str(number), found, removes_itself) for number in range(8)]
    row: list[tuple[float, int]] = []  # the time of the last request, and the number of the connection
    now = 0.0

    def remove(number: int) -> None:
        row[:] = [entry for entry in row if entry[1] != number]

    for event, number, seconds in steps:
        now += seconds
        connection = connections[number]
        if event == "connect" and connection not in found.open:
            while len(row) >= most:
                unused = [entry for entry in row if not connections[entry[1]].was_answered] or row
                longest = {peer for received_at, peer in unused if received_at == min(unused)[0]}
                remove(next(int(open_one.peer) for open_one in found.open if int(open_one.peer) in longest))
            found.add(connection, now)
            row.append((now, number))
        elif event == "request":
            found.received(connection, now)
            remove(number)
            row.append((now, number))
        elif event == "disconnect":
            found.remove(connection)
            remove(number)
        elif event == "answer":
            connection.was_answered = True
        elif event == "new idle_timeout":
            found.idle_timeout = seconds
        elif event == "close_idle":
            again = found.close_idle(now)
            row[:] = [entry for entry in row if not found.idle_timeout or entry[0] + found.idle_timeout > now]
            if not found.idle_timeout or not row:
                assert again is None
            else:  # when the first can be closed, or a little before; but later than now, so that it ends
                assert again is not None
                assert now < again <= min(row)[0] + found.idle_timeout
        times = {int(connection.peer): received_at for connection, received_at in found.open.items()}
        assert times == {number: received_at for received_at, number in row}


def test_the_unsent_bytes_may_be_asked_for_while_connections_come_and_go() -> None:
    """Another thread than that of the server may ask."""
    found = table_with()

    class Hasty(Fake):
        @property
        def unsent(self) -> int:  # type: ignore[override]
            connected(found, "b")  # as the thread of the server does meanwhile
            return 5

    found.add(Hasty("a", found), 0.0)
    assert found.unsent == 5
    assert len(found) == 2


# Datagrams ------------------------------------------------------------------------------------------------------------

WRITE = bytes.fromhex("0001 0000 0006 01 06 0001 002A")
SENDER = ("192.0.2.1", 502)
EQUAL = ["05 0001 FF00", "06 0001 002A", "16 0001 00F2 0025"]
"""Requests with an answer that equals them."""


def limits() -> DatagramLimits:
    return DatagramLimits(lambda sender: False)


def answered(found: DatagramLimits, data: bytes, now: float) -> bool:
    if found.is_own_answer(data, SENDER, now):
        return False
    found.answered_with_itself(data, SENDER, now)
    return True


def test_of_the_same_datagram_without_a_pause_one_is_refused() -> None:
    found = limits()
    results = [answered(found, WRITE, number / 100) for number in range(2 * COPIES + 2)]
    assert [place for place, was_answered in enumerate(results) if not was_answered] == [COPIES, 2 * COPIES + 1]


def test_the_same_datagram_with_pauses_is_always_answered() -> None:
    found = limits()
    assert all(answered(found, WRITE, float(number)) for number in range(3 * COPIES))


def test_other_datagrams_are_always_answered() -> None:
    found = limits()
    assert all(answered(found, number.to_bytes(2, "big") + WRITE[2:], 0.0) for number in range(3 * COPIES))
    assert len(found._copies) == 1024


def test_each_host_has_a_limit_of_its_own_for_a_second() -> None:
    found = limits()
    assert [found.is_too_much("192.0.2.1", 5.0) for _ in range(RATE + 2)] == [False] * RATE + [True] * 2
    assert not found.is_too_much("192.0.2.2", 5.9)
    assert not found.is_too_much("192.0.2.1", 6.0)


def test_hosts_beyond_those_remembered_share_a_limit() -> None:
    found = limits()
    refused = [found.is_too_much(f"host {number}", 0.0) for number in range(1024 + RATE + 1)]
    assert refused == [False] * (1024 + RATE) + [True]
    assert len(found._received) == 1025


@pytest.mark.parametrize(
    ("own", "sender", "expected"),
    [
        (("127.0.0.1", 502), ("127.0.0.1", 502), True),
        (("127.0.0.1", 502), ("127.0.0.1", 503), False),
        (("127.0.0.1", 502), ("127.0.0.2", 502), False),
        (("0.0.0.0", 502), ("127.0.0.1", 502), True),
        (("0.0.0.0", 502), ("127.0.0.1", 503), False),
        (("0.0.0.0", 502), ("192.0.2.1", 502), False),
    ],
)
def test_the_own_address(own: tuple[str, int], sender: tuple[str, int], expected: bool) -> None:
    assert is_own_address(own, sender) == expected


# With sockets: the socket of a server also sends the forged datagram ------------------------------------------------


async def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end
        await asyncio.sleep(0.01)


def bound() -> socket.socket:
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    found.bind(("127.0.0.1", 0))
    return found


@pytest.mark.parametrize("pdu", EQUAL)
def test_a_datagram_from_the_own_address_is_refused(pdu: str) -> None:
    data = bytes.fromhex(pdu)
    data = bytes([0, 1, 0, 0, 0, 1 + len(data), 1]) + data

    async def main() -> None:
        with bound() as port:
            async with AsyncModbusServer("udp://127.0.0.1:0", {1: Table()}, listener=port.dup()) as server:
                port.sendto(data, port.getsockname())
                await until(lambda: server.statistics.echoes == 1)
                assert server.statistics.requests == 0

    asyncio.run(main())


@pytest.mark.parametrize("pdu", EQUAL)
def test_two_servers_that_answer_each_other_come_to_rest(pdu: str) -> None:
    data = bytes.fromhex(pdu)
    data = bytes([0, 1, 0, 0, 0, 1 + len(data), 1]) + data

    async def main() -> None:
        with bound() as first, contextlib.closing(ModbusServer("udp://127.0.0.1:0", {1: Table()})) as threaded:
            threaded.start()
            async with AsyncModbusServer("udp://127.0.0.1:0", {1: Table()}, listener=first.dup()) as server:
                first.sendto(data, ("127.0.0.1", threaded.port))
                both = server.statistics, threaded.statistics
                await until(lambda: sum(counted.echoes for counted in both) == 1)
                assert sum(counted.requests for counted in both) == 2 * COPIES

    asyncio.run(main())


def test_a_client_that_repeats_its_write_with_the_same_transaction_is_answered() -> None:
    with ModbusServer("udp://127.0.0.1:0", {1: Table()}) as server, bound() as client:
        client.settimeout(30)
        for _ in range(300):
            client.sendto(WRITE, ("127.0.0.1", server.port))
            assert client.recv(300) == WRITE


# On real ports --------------------------------------------------------------------------------------------------------

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


@pytest.mark.parametrize(
    ("way", "scheme"),
    [
        ("thread", "tcp"),
        ("asyncio", "tcp"),
        pytest.param("asyncio", "rtu+tcp", marks=pytest.mark.proof),
        pytest.param("asyncio", "ascii+tcp", marks=pytest.mark.proof),
    ],
)
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
        async with serving(way, idle=4) as server:
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
            assert "silent for 4 s" in server.connections.closed[-1]
            await asyncio.gather(*(client.close() for client in (silent, half, busy)))

    asyncio.run(main())


@both
def test_a_client_that_never_reads_takes_no_memory_and_delays_no_other(way: str) -> None:
    async def main() -> None:
        async with serving(way) as server:
            sent = stalled = most = 0
            with socket.socket() as greedy:
                greedy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                greedy.connect(("127.0.0.1", server.port))
                greedy.setblocking(False)
                async with AsyncModbusClient(f"tcp://127.0.0.1:{server.port}") as client:
                    while stalled < 50 or not most:
                        try:
                            sent += greedy.send(MOST * 300)
                        except BlockingIOError:
                            stalled += 1
                        except ConnectionResetError:  # a busy computer took the 30 s after which it is given up
                            break
                        assert await client.read_holding_registers(0, 1) == (0,)  # meanwhile
                        most = max(most, server.connections.unsent)
            # The buffers of the system limit the requests; the answers to them would be a multiple.
            assert most < 200_000
            assert sent // len(MOST) * 259 > 2 * most

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
    with refused(EncodeError, "connections 0: expected 1..1000000"):
        AsyncModbusServer("tcp://127.0.0.1:0?connections=0", {1: Table()})
    with refused(EncodeError, "connections 0: expected 1..1000000"):
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
