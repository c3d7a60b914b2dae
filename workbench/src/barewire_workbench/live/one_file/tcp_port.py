"""A TCP connection of a client, by the standard library alone."""

from __future__ import annotations

import socket

from barewire.errors import PortError
from barewire.io.ports.network import CHUNK, LONGEST_WAIT, place_of, reason, set_socket_options

_CONNECT_TIMEOUT = 5.0
"""Seconds after which an attempt to connect, or to send to a peer that does not read, is given up."""


class TcpPort:
    """A connection to a server. Small frames are sent at once, and a dead peer is noticed."""

    def __init__(self, host: str, port: int) -> None:
        self.name = place_of(host, port)
        try:
            self._socket = socket.create_connection((host, port), _CONNECT_TIMEOUT)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None
        set_socket_options(self._socket)

    def send(self, item: bytes) -> None:
        """Send bytes."""
        try:
            self._socket.settimeout(_CONNECT_TIMEOUT)
            self._socket.sendall(item)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None

    def receive(self, timeout: float) -> bytes | None:
        """Return received bytes, or None after `timeout` seconds. Raises PortError after the peer closed."""
        try:
            self._socket.settimeout(min(timeout, LONGEST_WAIT))
            data = self._socket.recv(CHUNK)
        except (TimeoutError, BlockingIOError):
            return None
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None
        if not data:
            raise PortError(f"{self.name}: the other side closed the connection")
        return data

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()
