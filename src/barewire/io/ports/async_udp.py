"""UDP sockets of asyncio clients."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import cast

from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.tcp import CONNECT_TIMEOUT, reason


async def connect(endpoint: Endpoint, receive: Callable[[bytes], None], lose: Callable[[str], None]) -> DatagramLink:
    """Open a socket for datagrams to the host of an endpoint. Raises PortError, in one line, if that fails."""
    link = DatagramLink(receive, lose)
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT):
            await asyncio.get_running_loop().create_datagram_endpoint(lambda: link, remote_addr=endpoint.host_and_port)
    except TimeoutError:
        raise PortError(f"{endpoint.place}: no connection within {CONNECT_TIMEOUT:g} s") from None
    except OSError as error:
        raise PortError(f"{endpoint.place}: {reason(error)}") from None
    return link


class DatagramLink(asyncio.DatagramProtocol):
    """Datagrams to one server. `receive` is called with each datagram, `lose` with the reason when the socket fails."""

    def __init__(self, receive: Callable[[bytes], None], lose: Callable[[str], None]) -> None:
        self._receive = receive
        self._lose = lose
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by asyncio when the socket is open."""
        # A cast, because the transports of some event loops do not inherit from DatagramTransport.
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Called by asyncio when a datagram arrived."""
        self._receive(data)

    def error_received(self, exc: Exception) -> None:
        """Called by asyncio when the peer reports that its port is closed."""
        self._lose(reason(exc))

    def write(self, item: bytes) -> None:
        """Send one datagram."""
        if self._transport is not None:
            self._transport.sendto(item)

    def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.abort()

    def write_together(self, item: bytes) -> None:
        """Send one datagram: each frame has its own."""
        self.write(item)

    def sent(self) -> None:
        """Return None: the system has taken the bytes."""
