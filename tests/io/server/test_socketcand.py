"""The bus between processes: frames are passed on, anything else is ignored."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress

import pytest

from barewire.canopen import CanFrame
from barewire.canopen.frame import ErrorFrame
from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can import socketcand
from barewire.io.ports.can.python_can import CanPort
from barewire.io.ports.can.socketcand import read_hub_answer
from barewire.io.server.can import SocketcandHub
from tests.helpers import free_port, refused


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine may take longer to join the hub than the few seconds of a client."""
    monkeypatch.setattr(socketcand, "HANDSHAKE_TIMEOUT", 30.0)


@pytest.fixture
def port() -> Iterator[int]:
    number = free_port()
    hub = SocketcandHub("127.0.0.1", number)
    yield number
    hub.close()


def member(port: int) -> CanPort:
    return CanPort(Endpoint.parse(f"can://socketcand/127.0.0.1:{port}/can0"))


def test_frames_of_one_client_go_to_all_others(port: int) -> None:
    one, two, three = member(port), member(port), member(port)
    try:
        for frame in (
            CanFrame(0x605, bytes(range(8))),
            CanFrame(0x80),
            CanFrame(0x701, b"\x05"),
            CanFrame(0x181, b"\x01", extended=True),
        ):
            one.send(frame)
            assert two.receive(30.0) == frame
            assert three.receive(30.0) == frame
        assert one.receive(0.05) is None
    finally:
        for connection in (one, two, three):
            connection.close()


@pytest.mark.parametrize(
    "message",
    [
        b"< send zz 8 1 2 >",
        b"< send 601 3 GG 1 2 >",
        b"< send 601 1 123 >",
        b"< send 601 9 1 2 3 4 5 6 7 8 9 >",
        b"< send 601 2 1 >",
        b"< send \xff 1 1 >",
        b"< send >",
        b"<>",
        b"> > >",
        b"< nonsense >",
        b"< " + b" " * 2000 + b">",
    ],
)
def test_messages_that_are_not_frames_are_not_passed_on(port: int, message: bytes) -> None:
    one, two = member(port), member(port)
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=30) as foreign:
            foreign.sendall(b"< open can0 >< rawmode >" + message)
            one.send(CanFrame(0x123, b"\x01"))
            assert two.receive(30.0) == CanFrame(0x123, b"\x01")
            assert two.receive(0.05) is None
    finally:
        one.close()
        two.close()


def read_until(connection: socket.socket, end: bytes) -> None:
    received = b""
    while not received.endswith(end):
        byte = connection.recv(1)
        assert byte, received
        received += byte


def test_a_client_is_on_the_bus_that_it_opened_last_and_a_bus_without_clients_is_forgotten() -> None:
    number = free_port()
    with closing(SocketcandHub("127.0.0.1", number)) as hub:
        with socket.create_connection(("127.0.0.1", number), timeout=30) as foreign:
            read_until(foreign, b"< hi >")
            for name in ("a", "b"):
                foreign.sendall(f"< open {name} >< rawmode >".encode())
                read_until(foreign, b"< ok >< ok >")
            assert list(hub._buses) == ["b"]
            foreign.sendall(b"".join(b"< open n%d >" % each for each in range(100)))
            read_until(foreign, b"< ok >" * 100)
            assert not hub._buses
            foreign.sendall(b"< rawmode >")
            read_until(foreign, b"< ok >")
            assert list(hub._buses) == ["n99"]
            foreign.shutdown(socket.SHUT_WR)
            assert foreign.recv(100) == b""  # the hub has closed
        assert not hub._buses


def test_a_client_that_sends_but_never_reads_is_not_read_either() -> None:
    """Its answers would fill the memory. Others go on, and the hub closes without waiting for it."""
    number = free_port()
    with socket.socket() as foreign, closing(SocketcandHub("127.0.0.1", number)) as hub:
        foreign.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        foreign.connect(("127.0.0.1", number))
        foreign.settimeout(1.0)
        foreign.sendall(b"< open z >< rawmode >")
        with pytest.raises(TimeoutError):
            foreign.sendall(b"<x>" * 10_000_000)
        (writer,) = hub._buses["z"]
        assert writer.transport.get_write_buffer_size() < 0x40000
        one, two = member(number), member(number)
        one.send(CanFrame(0x123))
        assert two.receive(30.0) == CanFrame(0x123)
        one.close()
        two.close()


@contextmanager
def server_that_answers(*answers: bytes) -> Iterator[int]:
    """A server that greets two connections (the first only looks for the greeting), and answers the second."""

    def serve() -> None:
        with listener.accept()[0] as connection:
            connection.sendall(b"< hi >")
            connection.recv(100)
        with listener.accept()[0] as connection, suppress(ConnectionError):
            connection.sendall(b"< hi >")
            for answer in answers:
                if not connection.recv(100):
                    return
                connection.sendall(answer)
            connection.recv(100)  # until the client closes

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve)
        thread.start()
        yield int(listener.getsockname()[1])
        thread.join(timeout=30.0)


def test_a_frame_that_comes_along_with_the_last_ok_is_received() -> None:
    """As on a bus with traffic: TCP does not separate the answer from the first frame."""
    with server_that_answers(b"< ok >", b"< ok >< frame 705 1795373683.431301 00 >< frame 181") as port:
        joined = member(port)
        assert joined.receive(30.0) == CanFrame(0x705, b"\x00")
        joined.close()


@pytest.mark.parametrize(
    ("answers", "message"),
    [
        ((b"< error could not open bus >",), "expected '< ok >' from the socketcand server, received '< error could"),
        ((b"< ok >", b"x" * 300), "expected '< ok >' from the socketcand server, received 'xxxx"),
    ],
)
def test_another_answer_is_an_error(answers: tuple[bytes, ...], message: str) -> None:
    with server_that_answers(*answers) as port, refused(PortError, message):
        member(port)


def test_an_answer_that_does_not_end_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socketcand, "HANDSHAKE_TIMEOUT", 1.0)
    with server_that_answers(b"< ok >", b"< o") as port, refused(PortError, "timed out"):
        member(port)


@pytest.mark.parametrize(
    "message",
    [
        b"< frame 18Z 1.0 01 >",
        b"< frame 185 1.0 0 >",
        b"< frame 185 nan 01 >",
        b"< frame 185 >",
        b"< frame -5 1.0 01 >",
        b"< frame FFF 1.0 01 >",
        b"< frame 3FFFFFFF 1.0 01 >",
        b"< frame FFFFFFFFFFFF 1.0 01 >",
        b"< frame 185 1.0 010203040506070809 >",
        b"< frame 185 1.0 " + b"01" * 100 + b" >",
        b"< error 1 nan >",
        b"< error unknown command >",
        b">",
        b"< \xff >",
        b"\xff\xfe",
        b"< frame 185 1.0 0",
    ],
)
def test_a_message_that_is_no_frame_is_garbled_and_the_frames_around_it_are_received(message: bytes) -> None:
    before, behind = b"< frame 181 1.0 01 >", b"< frame 182 1.0  >< frame 00000183 1.0 01 02 >"
    with server_that_answers(b"< ok >", b"< ok >" + before + message + behind) as port:
        joined = member(port)
        try:
            assert [str(joined.receive(30.0)) for _ in range(3)] == ["181#01", "182#", "00000183#0102"]
            assert joined.receive(0.05) is None
            assert joined.garbled == 1
        finally:
            joined.close()


def test_a_message_without_an_end_is_dropped_and_the_port_goes_on() -> None:
    with server_that_answers(b"< ok >", b"< ok >" + b"<" * 3000 + b">< frame 182 1.0 >") as port:
        joined = member(port)
        try:
            assert joined.receive(30.0) == CanFrame(0x182)
            assert joined.garbled > 0
        finally:
            joined.close()


def test_an_error_frame_of_the_server_is_a_report_of_the_controller() -> None:
    with server_that_answers(b"< ok >", b"< ok >< error 20000040 1.0 >") as port:
        joined = member(port)
        try:
            report = joined.receive_any(2.0)
            assert isinstance(report, ErrorFrame)
            assert report.text == "bus off"
        finally:
            joined.close()


def test_a_bus_of_a_server_that_hangs_up_later_fails() -> None:
    with server_that_answers(b"< ok >", b"< ok >< frame 181 1.0 01 >") as port:
        joined = member(port)
        try:
            assert joined.receive(30.0) == CanFrame(0x181, b"\x01")
            joined._bus._tcp_send("< end >")  # type: ignore[attr-defined]  # the server above closes then
            with refused(PortError, "the server hung up"):
                joined.receive(30.0)
        finally:
            joined.close()


def test_an_answer_that_arrives_in_drops_is_awaited_for_the_same_time(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]

    class Connection:
        """A server that sends a byte each second."""

        def settimeout(self, seconds: float) -> None:
            assert 0.0 < seconds <= 3.0

        def recv(self, size: int) -> bytes:
            clock[0] += 1.0
            return b"x"

    monkeypatch.setattr(socketcand, "HANDSHAKE_TIMEOUT", 3.0)
    monkeypatch.setattr(socketcand, "monotonic", lambda: clock[0])
    with pytest.raises(TimeoutError, match="timed out"):
        read_hub_answer(Connection())  # type: ignore[arg-type]
    assert clock[0] == 3.0


def test_a_server_that_hangs_up_is_an_error() -> None:
    with server_that_answers() as port, refused(PortError, "received ''"):
        member(port)
