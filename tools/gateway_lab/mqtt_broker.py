"""A broker for a publisher in virtual time: as much of MQTT 3.1.1 as one client needs, and outages on demand.

A real broker lives in real time; a publisher whose time jumps would not wait for it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

_CONNECT, _PUBLISH, _SUBSCRIBE, _PING, _DISCONNECT = 1, 3, 8, 12, 14


class Broker:
    """Acknowledges everything, unless it is mute, and passes readings to `hear(topic, payload)`."""

    def __init__(self, hear: Callable[[str, bytes], object]) -> None:
        self.hear = hear
        self.is_mute = False
        """Whether it takes nothing and acknowledges nothing, as a broker whose disk hangs."""
        self.port = 0
        self.server: asyncio.Server | None = None
        self.connections: set[_Connection] = set()

    async def open(self) -> None:
        """Listen, at the same port as before."""
        loop = asyncio.get_running_loop()
        self.server = await loop.create_server(lambda: _Connection(self), "127.0.0.1", self.port)
        self.port = self.server.sockets[0].getsockname()[1]

    def speak(self) -> None:
        """Be mute no longer: what has come meanwhile is answered."""
        self.is_mute = False
        for connection in list(self.connections):
            connection.data_received(b"")

    def close(self) -> None:
        """End: connections break, and new ones are refused."""
        if self.server is not None:
            self.server.close()
        for connection in list(self.connections):
            connection.transport.abort()


class _Connection(asyncio.Protocol):
    def __init__(self, broker: Broker) -> None:
        self.broker = broker
        self.held = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: Any = transport
        self.broker.connections.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self.broker.connections.discard(self)

    def data_received(self, data: bytes) -> None:
        self.held += data
        while not self.broker.is_mute and (packet := self._packet()) is not None:
            self._answer(*packet)

    def _packet(self) -> tuple[int, bytes] | None:
        """Take one packet: its first byte, and its content. The length has seven bits in each of up to four bytes."""
        length, shift, place = 0, 0, 1
        while place < len(self.held):
            byte = self.held[place]
            length |= (byte & 0x7F) << shift
            shift, place = shift + 7, place + 1
            if byte < 0x80:
                if len(self.held) < place + length:
                    return None
                first, content = self.held[0], self.held[place : place + length]
                self.held = self.held[place + length :]
                return first, content
        return None

    def _answer(self, first: int, content: bytes) -> None:
        kind = first >> 4
        if kind == _CONNECT:
            self.transport.write(bytes((0x20, 2, 0, 0)))
        elif kind == _SUBSCRIBE:
            self.transport.write(bytes((0x90, 3)) + content[:2] + b"\1")
        elif kind == _PING:
            self.transport.write(bytes((0xD0, 0)))
        elif kind == _DISCONNECT:
            self.transport.close()
        elif kind == _PUBLISH:
            after = 2 + int.from_bytes(content[:2], "big")
            topic, payload = content[2:after].decode(), content[after:]
            if first & 0x06:  # QoS 1: a number, which is acknowledged
                self.transport.write(bytes((0x40, 2)) + payload[:2])
                payload = payload[2:]
            if b'"sequence"' in payload:
                self.broker.hear(topic, payload)
