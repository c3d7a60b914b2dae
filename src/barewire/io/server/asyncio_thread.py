"""An asyncio server in a thread, for TLS, datagrams, and serial lines in a tunnel, whose silences need timers."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from barewire.io.endpoint import Endpoint
from barewire.io.ports.tcp import listening_socket
from barewire.io.server.asyncio_stream import server_at
from barewire.io.server.base import POLL_INTERVAL
from barewire.io.server.connection_limits import Inject
from barewire.modbus import Authorization, Unit


class AsyncioService:
    """A server of units on a TCP or UDP port: tls, udp, rtu+tcp, ascii+tcp. `inject` puts faults into the answers."""

    def __init__(
        self,
        endpoint: Endpoint,
        units: Mapping[int, Unit],
        authorization: Authorization | None = None,
        inject: Inject | None = None,
    ) -> None:
        self._server = server_at(endpoint, units, authorization, inject)
        self.connections = self._server.connections
        self._listener, self.url = listening_socket(endpoint)

    def serve(self, is_over: Callable[[], bool]) -> None:
        """Serve until `is_over()`."""
        asyncio.run(self._until(is_over))

    def close(self) -> None:
        """Release the port."""
        self._listener.close()

    async def _until(self, is_over: Callable[[], bool]) -> None:
        await self._server.listen(self._listener)
        try:
            while not is_over():
                await asyncio.sleep(POLL_INTERVAL)
        finally:
            await self._server.close()
