"""A TCP connection as a blocking port. Connecting, refusing and hanging up become one-line errors."""

from __future__ import annotations

import select
import socket

from barewire.errors import PortError

CHUNK = 4096


class TcpPort:
    """A connection to a server. Small frames leave at once (TCP_NODELAY), dead peers are found (SO_KEEPALIVE)."""

    def __init__(self, host: str, port: int, *, timeout: float = 5.0) -> None:
        self.name = f"{host}:{port}"
        try:
            self._socket = socket.create_connection((host, port), timeout)
        except TimeoutError:
            raise PortError(f"{self.name}: no connection within {timeout:g} s") from None
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)

    def send(self, item: bytes) -> None:
        """Hand the bytes to the system."""
        try:
            self._socket.sendall(item)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None

    def receive(self, timeout: float) -> bytes | None:
        """What came within `timeout` seconds; PortError when the other side hung up."""
        try:
            ready, _, _ = select.select([self._socket], [], [], min(timeout, 3600.0))
            if not ready:
                return None
            data = self._socket.recv(CHUNK)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None
        if not data:
            raise PortError(f"{self.name}: the other side closed the connection")
        return data

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


def reason(error: OSError) -> str:
    """What the system says, in lower case and without its number: 'connection refused'."""
    text = error.strerror or str(error) or type(error).__name__
    return text[:1].lower() + text[1:]
