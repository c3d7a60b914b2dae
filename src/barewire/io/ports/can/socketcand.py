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

import re
import socket
from time import monotonic
from typing import Any

import can
from can.interfaces.socketcand import SocketCanDaemonBus

from barewire.io.endpoint import socketcand_address
from barewire.io.ports.network import LONGEST_WAIT, readiness

HANDSHAKE_TIMEOUT = 3.0
"""Seconds for each answer of the server, and for the connection."""

_LONGEST_MESSAGE = 256

_TIME = rb"(\d+(?:\.\d*)?)"
_FRAME = re.compile(rb"\s*< *frame +([0-9A-Fa-f]{3,8}) +" + _TIME + rb"((?: *[0-9A-Fa-f]{2}){0,64}) *>")
_ERROR = re.compile(rb"\s*< *error +([0-9A-Fa-f]{3,8}) +" + _TIME + rb" *>")


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
        self._received = b""
        self._quick_ack = bool(options.get("tcp_tune")) and hasattr(socket, "TCP_QUICKACK")
        _check_greeting(options["host"], options["port"])
        try:
            super().__init__(channel, **options)  # type: ignore[no-untyped-call]
        except BaseException:
            self._connection().close()
            raise
        self._connection().settimeout(None)
        self._is_ready = readiness(self._connection())

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """Return the next message, or None. Raises ValueError for one that is no frame, and is ready for the next.

        python-can keeps a wrong message, fails at it again with everything that arrives, and repeats earlier frames.
        """
        connection = self._connection()
        if b">" not in self._received:
            if not self._is_ready(LONGEST_WAIT if timeout is None else timeout):
                return None, False
            data = connection.recv(4096)
            if not data:
                raise can.CanError("the server hung up")
            if self._quick_ack:
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
            self._received += data
        text, end, rest = self._received.partition(b">")
        if not end and len(text) <= _LONGEST_MESSAGE:
            return None, False
        start = text.rfind(b"<")
        if text[: max(start, 0)].strip():  # not part of the message: it is reported now, and the message read next
            self._received = text[start:] + end + rest
            raise ValueError(f"{text[:start]!r} is outside of a message")
        self._received = rest
        return _parsed(text + end), False

    def _expect_msg(self, msg: str) -> None:
        """Read one message, and no byte behind it."""
        answer = read_hub_answer(self._connection())
        if answer != msg.encode():
            raise can.CanError(f"expected {msg!r} from the socketcand server, received {answer.decode('latin-1')!r}")

    def _connection(self) -> socket.socket:
        connection: socket.socket = self._SocketCanDaemonBus__socket  # type: ignore[attr-defined]
        return connection


def read_hub_answer(connection: socket.socket) -> bytes:
    """Read up to the next `>`, or what came before the end. Raises OSError, also if it takes too long as a whole."""
    until = monotonic() + HANDSHAKE_TIMEOUT
    answer = b""
    while not answer.endswith(b">") and len(answer) < _LONGEST_MESSAGE:
        remaining = until - monotonic()
        if remaining <= 0.0:
            raise TimeoutError("timed out")
        connection.settimeout(remaining)
        byte = connection.recv(1)
        if not byte:
            break
        answer += byte
    return answer


def _parsed(text: bytes) -> can.Message:
    """Return the frame, or report of the controller, of a message. Raises ValueError for any other."""
    if match := _FRAME.fullmatch(text):
        identifier, timestamp, data = match.groups()
        return can.Message(
            timestamp=float(timestamp),
            arbitration_id=int(identifier, 16),
            is_extended_id=len(identifier) != 3,
            data=bytes.fromhex(data.decode()),
        )
    if match := _ERROR.fullmatch(text):
        return can.Message(timestamp=float(match[2]), arbitration_id=int(match[1], 16), is_error_frame=True)
    raise ValueError(f"{text!r} is no frame of a socketcand server")


def _check_greeting(host: str, port: int) -> None:
    """Raise can.CanError or OSError unless a socketcand server is there: python-can would try for ten seconds."""
    with socket.create_connection((host, port), timeout=HANDSHAKE_TIMEOUT) as probe:
        if b"< hi >" not in probe.recv(64):
            raise can.CanError(f"{host}:{port} is not a socketcand server")
