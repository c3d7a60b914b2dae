"""UDP as a blocking port: one datagram is one frame."""

from __future__ import annotations

import select
import socket
from collections.abc import Callable
from typing import Any

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


def is_own_address(own: Any, sender: Any) -> bool:
    """Return whether `sender` is the address of the socket that is bound to `own`: the same, or if it is bound to all
    hosts of this machine, one of them with the same port."""
    if sender[1] != own[1] or own[0] not in ("0.0.0.0", "::"):
        return bool(sender[:2] == own[:2])
    with socket.socket(socket.AF_INET6 if ":" in own[0] else socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((sender[0], 0, *sender[2:]))  # the system binds to addresses of this machine only
        except OSError:
            return False
    return True
