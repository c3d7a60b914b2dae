"""The bus between processes: frames are passed on, anything else is ignored."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from barewire.canopen import CanFrame
from barewire.io.canopen.socketcand import SocketcandHub
from barewire.io.endpoint import Endpoint
from barewire.io.ports.python_can import CanPort


@pytest.fixture
def port() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = int(taken.getsockname()[1])
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
            assert two.receive(2.0) == frame
            assert three.receive(2.0) == frame
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
        with socket.create_connection(("127.0.0.1", port), timeout=5) as foreign:
            foreign.sendall(b"< open can0 >< rawmode >" + message)
            one.send(CanFrame(0x123, b"\x01"))
            assert two.receive(2.0) == CanFrame(0x123, b"\x01")
            assert two.receive(0.05) is None
    finally:
        one.close()
        two.close()
