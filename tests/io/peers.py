"""Peers that misbehave on purpose, on real sockets, each in a thread of its own; and a second try for a battery."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

from barewire.errors import BarewireError
from barewire.modbus import Table, Unit

R = TypeVar("R")


@contextlib.contextmanager
def peer(*handlers: Callable[[socket.socket], None]) -> Iterator[int]:
    """A server on loopback; yields its port. Each connection is passed to the next of `handlers`, all further ones to
    the last of them."""
    listener = socket.create_server(("127.0.0.1", 0))
    open_now: list[socket.socket] = []

    def serve() -> None:
        count = 0
        with contextlib.suppress(OSError):
            while True:
                connection, _ = listener.accept()
                open_now.append(connection)
                handler = handlers[min(count, len(handlers) - 1)]
                count += 1
                threading.Thread(target=converse, args=(handler, connection), daemon=True).start()

    def converse(handler: Callable[[socket.socket], None], connection: socket.socket) -> None:
        with contextlib.suppress(OSError):
            connection.settimeout(60)
            handler(connection)
        connection.close()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield listener.getsockname()[1]
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        thread.join(30)
        for connection in open_now:
            connection.close()


def read_exactly(connection: socket.socket, count: int) -> bytes:
    """Read so many bytes, or raise OSError."""
    data = b""
    while len(data) < count:
        data += (got := connection.recv(count - len(data)))
        if not got:
            raise ConnectionError("closed")
    return data


def answer(request: bytes) -> bytes:
    """The answer to a Modbus TCP read of one register: its own address."""
    return request[:5] + bytes([5, request[6], request[7], 2]) + request[8:10]


def honest(connection: socket.socket) -> None:
    """Answers reads of one register with the register's address."""
    while True:
        connection.sendall(answer(read_exactly(connection, 12)))


def stubborn(connection: socket.socket) -> None:
    """Answers whatever it is sent as a read of one register, each 12 bytes of it."""
    while data := connection.recv(1000):
        for at in range(0, len(data), 12):
            connection.sendall(answer(data[at : at + 12].ljust(12, b"\0")))


def full(size: int = 300) -> dict[int, Unit]:
    """A unit whose registers hold their own addresses."""
    return {1: Table(holding_registers=range(size))}


def again(run: Callable[[str], list[R]]) -> list[R]:
    """The results of a battery that takes a time-out in seconds: short at first, because many cases wait for it, and
    longer if anything failed or was given up, because the computer may have been busy."""
    for patience in ("0.25", "2"):
        with contextlib.suppress(BarewireError):
            results: Any = run(patience)
            if not any(result.failure for result in results):
                return list(results)
    return run("8")
