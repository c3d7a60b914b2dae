"""UDP of asyncio clients."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import cast

from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.tcp import CONNECT_TIMEOUT, reason


async def connect(endpoint: Endpoint, receive: Callable[[bytes], None], lose: Callable[[str], None]) -> DatagramLink:
    """Open a socket for datagrams to the host of an endpoint. PortError in one line if that fails."""
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
    """UDP to one server. `receive` is called with each datagram, `lose` with the reason when it fails."""

    def __init__(self, receive: Callable[[bytes], None], lose: Callable[[str], None]) -> None:
        self._receive = receive
        self._lose = lose
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: the socket stands."""
        # Not every loop's transport is an instance of the class it fulfils.
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: object) -> None:
        """asyncio: a datagram came."""
        self._receive(data)

    def error_received(self, exc: Exception) -> None:
        """asyncio: the other machine reports that the port is closed."""
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
        """Send one datagram: each frame is one."""
        self.write(item)

    def sent(self) -> None:
        """Nothing to await: the system has taken the bytes."""
