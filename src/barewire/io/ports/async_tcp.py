"""TCP connections of asyncio clients, and TLS inside them (`async_tls`)."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable

from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.tcp import CHUNK, CONNECT_TIMEOUT, set_socket_options
from barewire.io.ports.tls import tls_reason


async def connect(endpoint: Endpoint, receive: Callable[[bytes], None], lose: Callable[[str], None]) -> StreamLink:
    """Connect to the host of an endpoint. Raises PortError, in one line, if that fails."""
    return await connect_stream(endpoint, receive, lose)


async def connect_stream(
    endpoint: Endpoint,
    receive: Callable[[bytes], None],
    lose: Callable[[str], None],
    context: ssl.SSLContext | None = None,
    server_name: str | None = None,
) -> StreamLink:
    """Connect to the host of an endpoint, with TLS inside if there is a `context`."""
    host, port = endpoint.host_and_port
    name = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
    link = StreamLink(receive, lose)
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT):
            await asyncio.get_running_loop().create_connection(
                lambda: link, host, port, ssl=context, server_hostname=server_name
            )
    except TimeoutError:
        raise PortError(f"{name}: no connection within {CONNECT_TIMEOUT:g} s") from None
    except OSError as error:
        raise PortError(f"{name}: {tls_reason(error)}") from None
    return link


class StreamLink(asyncio.BufferedProtocol):
    """A TCP or TLS connection. `receive` is called with received bytes, `lose` with the reason when it ends.

    It has its own buffer, because asyncio would allocate one of 256 KiB for each answer of thirty bytes.
    """

    def __init__(self, receive: Callable[[bytes], None], lose: Callable[[str], None]) -> None:
        self._receive = receive
        self._lose = lose
        self._transport: asyncio.Transport | None = None
        self._together: list[bytes] = []
        self._buffer = memoryview(bytearray(CHUNK))

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by asyncio when the connection is open."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        raw = transport.get_extra_info("socket")
        if raw is not None:
            set_socket_options(raw)

    def get_buffer(self, sizehint: int) -> memoryview:
        """Called by asyncio for the buffer of received bytes."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Called by asyncio when bytes arrived."""
        self._receive(self._buffer[:nbytes].tobytes())

    def connection_lost(self, exc: Exception | None) -> None:
        """Called by asyncio when the connection ended."""
        self._lose(tls_reason(exc) if isinstance(exc, OSError) else "the other side closed the connection")

    def write(self, item: bytes) -> None:
        """Send bytes."""
        if self._transport is not None:
            self._transport.write(item)

    def write_together(self, item: bytes) -> None:
        """Send bytes together with everything else that is written in this round of the loop: sixteen requests are one
        send, and arrive as one read."""
        if not self._together:
            asyncio.get_running_loop().call_soon(self._flush)
        self._together.append(item)

    def _flush(self) -> None:
        self.write(b"".join(self._together))
        self._together.clear()

    def close(self) -> None:
        """Close the connection at once, without waiting for unsent bytes."""
        if self._transport is not None:
            self._transport.abort()

    def sent(self) -> None:
        """Return None: the system has taken the bytes."""
