"""TLS connections of asyncio clients."""

from __future__ import annotations

from collections.abc import Callable

from barewire.io.endpoint import Endpoint
from barewire.io.ports.async_tcp import StreamLink, connect_stream
from barewire.io.ports.tls import client_context, server_name


async def connect(endpoint: Endpoint, receive: Callable[[bytes], None], lose: Callable[[str], None]) -> StreamLink:
    """Connect to the host of an endpoint. Raises PortError if that fails, EncodeError for wrong certificates."""
    return await connect_stream(endpoint, receive, lose, client_context(endpoint), server_name(endpoint))
