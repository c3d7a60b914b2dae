"""The TCP server without asyncio: the same answers as the asyncio server, its life cycle, units that raise, faults."""

from __future__ import annotations

import contextlib
import os
import selectors
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st

from barewire import ModbusClient, ModbusServer
from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.fault_injection.faults import faults_at
from barewire.io.fault_injection.ports import FaultInjector, LoopFaultInjector
from barewire.io.server.asyncio_network import AsyncioService
from barewire.io.server.base import ThreadedServer
from barewire.io.server.modbus import Service
from barewire.io.server.tcp import TcpService, _Connection
from barewire.modbus import Server, Table, Unit
from barewire.tcp import TcpLine, encode as frame
from tests.helpers import FailingUnit, modest, refused
from tests.io.peers import read_exactly

READ = frame(1, bytes.fromhex("03 0000 0001"), 1)
ANSWER = frame(1, bytes.fromhex("03 02 0000"), 1)
MOST = frame(1, bytes.fromhex("03 0000 007D"), 1)


def client(host: ThreadedServer) -> socket.socket:
    return socket.create_connection(Endpoint.parse(host.url).host_and_port, timeout=30)


def to_end(connection: socket.socket) -> bytes:
    data = b""
    with contextlib.suppress(ConnectionError):
        while chunk := connection.recv(0x10000):
            data += chunk
    return data


def answers_to(host: ThreadedServer, data: bytes = READ) -> bytes:
    """Return the answers to a client that sends these bytes, closes its sending half, and reads to the end."""
    with client(host) as connection:
        connection.sendall(data)
        connection.shutdown(socket.SHUT_WR)
        return to_end(connection)


# The same answers ---------------------------------------------------------------------------------------------------

CODES = st.sampled_from([*range(0, 9), 11, 12, 0x0F, 0x10, 0x16, 0x17, 0x18, 0x2B, 0x41, 0x83])
SENSIBLE = st.builds(
    lambda code, address, value: bytes([code]) + address.to_bytes(2, "big") + value.to_bytes(2, "big"),
    st.sampled_from([1, 2, 3, 4, 5, 6]), st.sampled_from([0, 1, 9, 10, 0xFFFF]), st.sampled_from([0, 1, 126, 0xFF00]),
)  # fmt: skip
PDUS = SENSIBLE | st.builds(lambda code, rest: bytes([code]) + rest, CODES, st.binary(max_size=12))


@st.composite
def client_data(draw: st.DrawFn, unit: int) -> list[bytes]:
    """The data of one client, in pieces: requests, then perhaps half of one, or a wrong header, which ends it.

    There are no more requests than the server handles at a time, so the limits of reads do not matter; and nothing
    after the wrong header, because that would be lost with the connection.
    """
    pdus = draw(st.lists(PDUS, max_size=12))
    units = st.sampled_from([unit, unit, unit, 99])
    sent = b"".join(frame(draw(units), pdu, draw(st.integers(0, 0xFFFF))) for pdu in pdus)
    sent += draw(st.sampled_from([b"", b"", READ[:5], READ[:11], b"\0\1\0\1\0\6", b"\0\1\0\0\0\1", b"\0\1\0\0\0\xff"]))
    cuts = sorted(draw(st.lists(st.integers(0, len(sent)), max_size=5)))
    return [sent[a:b] for a, b in zip([0, *cuts], [*cuts, len(sent)], strict=True)]


class NewUnits(Mapping[int, Unit]):
    """Units 1 to 3, which are made again for every example."""

    def __init__(self) -> None:
        self.renew()

    def renew(self) -> None:
        self.units: dict[int, Unit] = {number: Table(10) for number in (1, 2, 3)}

    def __getitem__(self, number: int) -> Unit:
        return self.units[number]

    def __iter__(self) -> Iterator[int]:
        return iter(self.units)

    def __len__(self) -> int:
        return len(self.units)


class Served(ThreadedServer):
    """A server of one of the two services for tcp://."""

    def __init__(self, service: Service) -> None:
        super().__init__()
        self.service = service
        self.url = service.url

    def _serve(self, stop: threading.Event) -> None:
        self.service.serve(lambda: self.is_over(stop))

    def _release(self) -> None:
        self.service.close()


def responses(host: ThreadedServer, sent: list[list[bytes]]) -> list[bytes]:
    """Return the data that each client receives, if they send their pieces in turn."""
    with contextlib.ExitStack() as stack:
        connections = [stack.enter_context(client(host)) for _ in sent]
        for turn in range(max(map(len, sent))):
            for connection, pieces in zip(connections, sent, strict=True):
                with contextlib.suppress(ConnectionError):
                    connection.sendall(b"".join(pieces[turn : turn + 1]))
        for connection in connections:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_WR)
        return [to_end(connection) for connection in connections]


def test_both_tcp_services_answer_any_input_as_the_server_machine() -> None:
    with contextlib.ExitStack() as stack:
        servers: list[tuple[ThreadedServer, NewUnits]] = []
        for kind in (TcpService, AsyncioService):
            units_of_server = NewUnits()
            server = stack.enter_context(Served(kind(Endpoint.parse("tcp://127.0.0.1:0"), units_of_server)))
            servers.append((server, units_of_server))

        @modest
        @given(st.tuples(client_data(1), client_data(2), client_data(3)))
        def holds(sent: tuple[list[bytes], ...]) -> None:
            units = NewUnits()
            expected = []
            for pieces in sent:
                replies = Server(TcpLine(), units, serial=False).feed(b"".join(pieces), 0.0)
                expected.append(b"".join(reply.data for reply in replies))
            for host, units_of_server in servers:
                units_of_server.renew()
                assert responses(host, list(sent)) == expected
                assert vars_of(units_of_server) == vars_of(units)

        holds()


def vars_of(units: NewUnits) -> list[Any]:
    return [(bytes(unit.coils), list(unit.holding_registers)) for unit in units.values() if isinstance(unit, Table)]


@pytest.mark.parametrize("kind", [TcpService, AsyncioService])
def test_any_transaction_does_not_make_the_line_a_serial_one(kind: Any) -> None:
    """On a serial line a request followed by another one, and one for an unknown unit, would not be answered."""
    with Served(kind(Endpoint.parse("tcp://127.0.0.1:0?any_transaction=1"), {1: Table()})) as host:
        unknown_unit = frame(5, b"\x07", 9)
        assert answers_to(host, READ + READ + unknown_unit) == ANSWER + ANSWER + frame(5, b"\x87\x0b", 9)


# Errors and life cycle ------------------------------------------------------------------------------------------------


class FailingLookup(Mapping[int, Unit]):
    """Units whose look-up fails for some addresses."""

    def __getitem__(self, number: int) -> Unit:
        if number == 1:
            return Table()
        raise RuntimeError("no connection to the data base")

    def __iter__(self) -> Iterator[int]:
        return iter((1,))

    def __len__(self) -> int:
        return 1

    def get(self, number: int, default: Any = None) -> Any:
        return self[number]


def test_an_error_with_one_client_does_not_affect_the_others() -> None:
    with ModbusServer("tcp://127.0.0.1:0", units=FailingLookup()) as host, client(host) as other:
        other.sendall(READ)
        assert read_exactly(other, len(ANSWER)) == ANSWER
        assert answers_to(host, frame(2, b"\x07")) == b""
        assert host.connections.closed[-1].endswith("RuntimeError: no connection to the data base")
        other.sendall(READ)
        assert read_exactly(other, len(ANSWER)) == ANSWER


@pytest.mark.parametrize("error", [ValueError("no"), RecursionError(), MemoryError()])
def test_a_unit_that_raises_is_exception_04_and_the_connection_stays(error: Exception) -> None:
    with ModbusServer("tcp://127.0.0.1:0", units={1: FailingUnit(error)}) as host:
        assert answers_to(host, READ + READ) == frame(1, b"\x83\x04", 1) * 2


SCHEMES = ["tcp://127.0.0.1:0", "udp://127.0.0.1:0", "rtu+tcp://127.0.0.1:0", "rtu://pty"]
ONCE = "a server serves once: this one has run, or was closed"


@pytest.mark.parametrize("url", SCHEMES)
def test_close_ends_a_run_in_another_thread_and_the_server_cannot_start_again(url: str) -> None:
    host = ModbusServer(url, units={1: Table()})
    running = threading.Thread(target=host.run, args=(threading.Event(),), daemon=True)
    running.start()
    with ModbusClient(f"{host.url}?timeout=30&unit=1") as modbus_client:
        assert modbus_client.read_holding_registers(0, 1) == (0,)
        host.close()
        running.join(30)
        assert not running.is_alive()
    for begin in (host.start, lambda: host.run(threading.Event())):
        with refused(PortError, ONCE):
            begin()
    host.close()  # a second time: no effect


@pytest.mark.parametrize("url", SCHEMES)
def test_a_server_starts_once(url: str) -> None:
    with ModbusServer(url, units={1: Table()}) as host:
        for begin in (host.start, lambda: host.run(threading.Event())):
            with refused(PortError, ONCE):
                begin()
        with ModbusClient(f"{host.url}?timeout=30&unit=1") as modbus_client:
            assert modbus_client.read_holding_registers(0, 1) == (0,)


def test_a_server_that_was_never_started_removes_its_terminal() -> None:
    """What is open is compared: another program may be given the same path at once."""
    before = terminals()
    host = ModbusServer("rtu://pty", units={1: Table()})
    assert len(terminals()) == len(before) + 2  # both sides of the new one
    host.close()
    assert terminals() == before


def terminals() -> list[str]:
    """The terminals that this process has open."""
    return sorted(
        path for entry in Path("/dev/fd").iterdir() if (path := os.path.realpath(entry)).startswith("/dev/pt")
    )


def test_two_servers_on_one_port_are_an_error() -> None:
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table()}) as host:
        with pytest.raises(PortError, match=r"^127\.0\.0\.1:\d+: address already in use$"):
            ModbusServer(host.url, units={1: Table()})
        assert answers_to(host) == ANSWER


def test_a_unit_may_close_the_server_that_serves_it() -> None:
    class Last(Table):
        def handle(self, request: Any, now: float) -> Any:
            host.close()
            return super().handle(request, now)

    host = ModbusServer("tcp://127.0.0.1:0", units={1: Last()})
    with host:
        assert answers_to(host) == ANSWER
    with pytest.raises(ConnectionError):
        client(host)


def test_closing_a_server_drops_unsent_answers() -> None:
    def connected() -> socket.socket:
        # With little room the answers soon wait. After megabytes of small ones Linux 6.18 ends the connection itself.
        made = stack.enter_context(socket.socket())
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        made.connect(Endpoint.parse(host.url).host_and_port)
        made.setblocking(False)
        return made

    with ModbusServer("tcp://127.0.0.1:0", units={1: Table()}) as host, contextlib.ExitStack() as stack:
        unread, left = connected(), b""
        while not host.connections.unsent:
            left = left or MOST * 64
            try:
                left = left[unread.send(left) :]  # a busy server takes a part, which may end within a frame
            except BlockingIOError:
                pass
            except ConnectionError:  # by Linux
                unread, left = connected(), b""
            time.sleep(0.001)  # the thread of the server comes to read
        host.close()
        assert not len(host.connections)
        assert host.connections.unsent == 0


def test_a_server_on_an_ipv6_address() -> None:
    with ModbusServer("tcp://[::1]:0", units={1: Table()}) as host:
        assert host.url.startswith("tcp://[::1]:")
        assert answers_to(host) == ANSWER


# Faults --------------------------------------------------------------------------------------------------------------


def server_with_faults(kind: Any, faults: dict[str, float], **settings: Any) -> Served:
    endpoint = Endpoint.parse("tcp://127.0.0.1:0")
    model = faults_at(endpoint, faults, **settings)
    if kind is TcpService:
        return Served(TcpService(endpoint, {1: Table()}, FaultInjector(model)))
    return Served(AsyncioService(endpoint, {1: Table()}, inject=LoopFaultInjector(model)))


@pytest.mark.parametrize("kind", [TcpService, AsyncioService])
def test_the_parts_of_a_split_answer_are_not_interleaved(kind: Any) -> None:
    """Several requests may be under way. A connection keeps the order of its bytes, delayed ones included."""
    twelve_requests = [frame(1, bytes([3, 0, 0, 0, number]), number) for number in range(1, 13)]
    answers = {frame(1, bytes([3, 2 * number, *bytes(2 * number)]), number) for number in range(1, 13)}
    with (
        server_with_faults(kind, faults={"split": 0.6, "late": 0.4}, seed=3, delay=0.01) as host,
        contextlib.ExitStack() as stack,
    ):
        connections = [stack.enter_context(client(host)) for _ in range(3)]
        for connection in connections:
            connection.sendall(b"".join(twelve_requests))
        for connection in connections:
            data = read_exactly(connection, sum(map(len, answers)))
            found = set()
            while data:
                size = 6 + int.from_bytes(data[4:6], "big")
                found.add(data[:size])
                data = data[size:]
            assert found == answers


class FullSocket:
    """A socket and its selector. It takes `room` bytes, and counts the calls."""

    def __init__(self) -> None:
        self.room, self.sends, self.taken, self.watched = 0, 0, b"", 0

    def fileno(self) -> int:
        return 3

    def recv(self, size: int) -> bytes:
        return READ

    def send(self, data: bytes) -> int:
        self.sends += 1
        if not self.room:
            raise BlockingIOError
        taken, self.room = bytes(data[: self.room]), max(0, self.room - len(data))
        self.taken += taken
        return len(taken)

    def register(self, _: object, events: int, data: object) -> None:
        self.watched = events

    modify = register


def test_late_answers_to_a_client_that_does_not_read_are_not_tried_again_one_by_one() -> None:
    """To try each again, with everything that waits already, would take seconds and delay all clients."""
    late: list[Callable[[bytes], None]] = []
    inject: Any = lambda answer, send: late.append(send)  # noqa: E731
    host = TcpService(Endpoint.parse("tcp://127.0.0.1:0"), {1: Table()}, inject)
    peer: Any = FullSocket()
    connection = _Connection(host, peer, peer, ("192.0.2.1", 1024))
    connection.ready(0.0)
    (send,) = late
    peer.room = 2
    for number in range(1000):
        send(number.to_bytes(4, "big"))
    assert (peer.sends, peer.watched) == (1, selectors.EVENT_WRITE)
    assert connection.unsent == 3998
    for room in (1, 3000, 0, 5000):
        peer.room = room
        connection.ready(0.0)
    assert (peer.sends, peer.watched, connection.unsent) == (5, selectors.EVENT_READ, 0)
    assert peer.taken == b"".join(number.to_bytes(4, "big") for number in range(1000))
    host.close()
