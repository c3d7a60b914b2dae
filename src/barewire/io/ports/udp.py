"""UDP as a blocking port: one datagram is one frame."""

from __future__ import annotations

import select
import socket
from collections.abc import Callable

from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.tcp import CHUNK, LONGEST_WAIT, reason


def dialer(endpoint: Endpoint) -> Callable[[], UdpPort]:
    """Return the function that opens the port of an endpoint."""
    host, port = endpoint.host_and_port
    return lambda: UdpPort(host, port)


class UdpPort:
    """Datagrams to one server, and only from it."""

    def __init__(self, host: str, port: int) -> None:
        self.name = f"{host}:{port}"
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind, protocol)
            self._socket.connect(address)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None

    def send(self, item: bytes) -> None:
        """Send one datagram."""
        try:
            self._socket.send(item)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None

    def receive(self, timeout: float) -> bytes | None:
        """Return the next datagram, or None after `timeout` seconds. Raises PortError if the peer's port is closed."""
        try:
            ready, _, _ = select.select([self._socket], [], [], min(timeout, LONGEST_WAIT))
            return self._socket.recv(CHUNK) if ready else None
        except (OSError, ValueError) as error:
            raise PortError(f"{self.name}: {reason(error)}") from None

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
