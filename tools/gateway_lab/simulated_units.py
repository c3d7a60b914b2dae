"""Units behind a TCP port, in the event loop of the gateway that asks them, and what may be wrong with them."""

from __future__ import annotations

import asyncio
import random
from typing import Any

from barewire.rtu import crc16


def value_of(unit: int, address: int) -> int:
    """The content of a register."""
    return (unit * 1000 + address) & 0xFFFF


class Place:
    """A TCP port with units behind it, and what is wrong with them."""

    def __init__(self, units: range, timeout: float, dice: random.Random, *, is_serial: bool = False) -> None:
        self.units = units
        self.timeout = timeout
        self.dice = dice
        self.is_serial = is_serial
        self.silent: dict[int, float] = {}
        """Until when a unit does not answer."""
        self.faults: list[str] = []
        """What happens to the next answers."""
        self.free_at = 0.0
        """On a serial line a late answer delays those after it."""
        self.port = 0
        self.server: asyncio.Server | None = None
        self.connections: set[_Units] = set()

    @property
    def url(self) -> str:
        """Where it is."""
        return f"{'rtu+tcp' if self.is_serial else 'tcp'}://127.0.0.1:{self.port}"

    async def open(self) -> None:
        """Listen, at the same port as before."""
        loop = asyncio.get_running_loop()
        self.server = await loop.create_server(lambda: _Units(self), "127.0.0.1", self.port)
        self.port = self.server.sockets[0].getsockname()[1]

    def reset(self) -> None:
        """Break all connections."""
        for connection in list(self.connections):
            connection.transport.abort()

    def close(self) -> None:
        """Break all connections, and refuse new ones."""
        if self.server is not None:
            self.server.close()
        self.reset()


class _Units(asyncio.Protocol):
    """One connection to a place."""

    def __init__(self, place: Place) -> None:
        self.place = place
        self.held = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: Any = transport
        self.place.connections.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self.place.connections.discard(self)

    def data_received(self, data: bytes) -> None:
        self.held += data
        size = 8 if self.place.is_serial else 12  # reads and writes of one register have five bytes and an address
        while len(self.held) >= size:
            request, self.held = self.held[:size], self.held[size:]
            if self.place.is_serial and int.from_bytes(request[-2:], "little") != crc16(request[:-2]):
                self.held = b""  # a real line would find its way by the silence
                continue
            self._answer(request[:4], request[:6] if self.place.is_serial else request[6:])

    def _answer(self, transaction: bytes, request: bytes) -> None:
        place, loop = self.place, asyncio.get_running_loop()
        unit, function = request[:2]
        if unit not in place.units or loop.time() < place.silent.get(unit, 0.0):
            return
        first, count = int.from_bytes(request[2:4], "big"), int.from_bytes(request[4:6], "big")
        body = request
        if function == 3:
            words = b"".join(value_of(unit, first + offset).to_bytes(2, "big") for offset in range(count))
            body = bytes((unit, 3, len(words))) + words
        elif function != 6:
            body = bytes((unit, function | 0x80, 1))
        fault = place.faults.pop() if place.faults else ""
        delay = 0.005
        if fault == "drop":
            return
        if fault == "reset":
            self.transport.abort()
            return
        if fault == "busy":
            body = bytes((unit, function | 0x80, 6))
        if fault == "late":
            delay = place.timeout * place.dice.uniform(0.5, 2.5)
        if place.is_serial:
            frame = bytearray(body + crc16(body).to_bytes(2, "little"))
            if fault == "damaged":
                frame[place.dice.randrange(len(frame))] ^= 1 << place.dice.randrange(8)
            place.free_at = at = max(loop.time(), place.free_at) + delay
        else:
            if fault == "damaged":
                transaction = bytes((transaction[0] ^ 0x80,)) + transaction[1:]
            frame = bytearray(transaction + len(body).to_bytes(2, "big") + body)
            at = loop.time() + delay
        loop.call_at(at, self._write, bytes(frame))

    def _write(self, frame: bytes) -> None:
        if not self.transport.is_closing():
            self.transport.write(frame)
