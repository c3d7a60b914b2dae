"""A bus of a socketcand server: that of python-can, with a handshake that also works while others send.

    client                      server
    ------                      ------
                     <-  < hi >
    < open can0 >    ->
                     <-  < ok >
    < rawmode >      ->
                     <-  < ok >< frame 705 1764000000.000001 00 >

From the last `< ok >` on the server passes every frame on, and TCP has no boundaries: python-can 4.6 reads what has
arrived, and fails if a frame came along. On a bus with traffic it fails often.
"""

from __future__ import annotations

import select
import socket
from typing import Any

import can
from can.interfaces.socketcand import SocketCanDaemonBus

from barewire.io.endpoint import socketcand_address

HANDSHAKE_TIMEOUT = 3.0
"""Seconds for each answer of the server, and for the connection."""

_LONGEST_ANSWER = 256


class SocketcandBus(SocketCanDaemonBus):
    """The bus of python-can. Raises can.CanError or OSError if the server does not answer as the protocol says."""

    def __init__(self, place: str, options: dict[str, Any]) -> None:
        """Join the bus at `place`, HOST:PORT/CHANNEL, with the options of python-can."""
        if "host" in options:
            channel = place
        else:
            options["host"], options["port"] = socketcand_address(place)
            options.setdefault("tcp_tune", True)  # frames are sent at once, not after up to 40 ms
            channel = place.partition("/")[2]
        _check_greeting(options["host"], options["port"])
        try:
            super().__init__(channel, **options)  # type: ignore[no-untyped-call]
        except BaseException:
            self._connection().close()
            raise
        self._connection().settimeout(None)

    def check(self) -> None:
        """Raise can.CanError or OSError if the server closed the connection: python-can would read it for ever."""
        connection = self._connection()
        if select.select([connection], [], [], 0)[0] and not connection.recv(1, socket.MSG_PEEK):
            raise can.CanError("the server hung up")

    def _expect_msg(self, msg: str) -> None:
        """Read one message, and no byte behind it."""
        connection = self._connection()
        connection.settimeout(HANDSHAKE_TIMEOUT)
        answer = b""
        while not answer.endswith(b">"):
            byte = connection.recv(1)
            if not byte or len(answer) == _LONGEST_ANSWER:
                break
            answer += byte
        if answer != msg.encode():
            raise can.CanError(f"expected {msg!r} from the socketcand server, received {answer.decode('latin-1')!r}")

    def _connection(self) -> socket.socket:
        connection: socket.socket = self._SocketCanDaemonBus__socket  # type: ignore[attr-defined]
        return connection


def _check_greeting(host: str, port: int) -> None:
    """Raise can.CanError or OSError unless a socketcand server is there: python-can would try for ten seconds."""
    with socket.create_connection((host, port), timeout=HANDSHAKE_TIMEOUT) as probe:
        if b"< hi >" not in probe.recv(64):
            raise can.CanError(f"{host}:{port} is not a socketcand server")
