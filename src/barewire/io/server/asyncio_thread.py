"""A server of asyncio in a thread: for TLS, datagrams, and serial lines in a tunnel, which have silences to keep."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Mapping

from barewire.io.endpoint import Endpoint
from barewire.io.ports.tcp import listen
from barewire.io.server.asyncio_stream import server_at
from barewire.io.server.open import LOOK, Host
from barewire.modbus import Unit


class NetworkHost(Host):
    """A server on a TCP or UDP port: tls, udp, rtu+tcp, ascii+tcp. Port 0 takes a free one."""

    def __init__(self, endpoint: Endpoint, units: Mapping[int, Unit]) -> None:
        super().__init__()
        self.server = server_at(endpoint, units)
        self._listener, self.url = listen(endpoint)

    def _serve(self, stop: threading.Event) -> None:
        asyncio.run(self._until(stop))

    def _give_back(self) -> None:
        self._listener.close()

    async def _until(self, stop: threading.Event) -> None:
        await self.server.listen(self._listener)
        async with self.server:
            while not self.is_over(stop):
                await asyncio.sleep(LOOK)
