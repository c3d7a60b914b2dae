"""Asyncio servers without connections: on a UDP port, and on a serial port."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from typing import Any, Self, cast

from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.modbus.carriers import modbus_line
from barewire.io.ports.tcp import reason
from barewire.io.server.connection_limits import Spoil
from barewire.modbus import Server, Unit


class DatagramServer(asyncio.DatagramProtocol):
    """A server on a UDP port: each datagram is a frame, and its answer goes where it came from."""

    def __init__(self, endpoint: Endpoint, units: Mapping[int, Unit]) -> None:
        self.endpoint = endpoint
        self.spoil: Spoil | None = None
        self._server = Server(modbus_line(endpoint, "server"), units, serial=False)
        self._transport: asyncio.DatagramTransport | None = None
        self._full = False

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def port(self) -> int:
        """The port it listens on."""
        assert self._transport is not None
        return int(self._transport.get_extra_info("sockname")[1])

    async def listen(self, listener: socket.socket | None = None) -> None:
        """Begin to listen; on a socket that is bound already, if there is one."""
        loop = asyncio.get_running_loop()
        host, port = self.endpoint.host_and_port
        where: dict[str, Any] = {"sock": listener} if listener is not None else {"local_addr": (host, port)}
        try:
            await loop.create_datagram_endpoint(lambda: self, **where)
        except OSError as error:
            raise PortError(f"{host}:{port}: {reason(error)}") from None

    async def close(self) -> None:
        """Give the port back."""
        if self._transport is not None:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        # Not every loop's transport is an instance of the class it fulfils.
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        for reply in self._server.feed(data, asyncio.get_running_loop().time()):
            if self.spoil is None:
                self._say(reply.data, addr)
            else:
                self.spoil(reply.data, partial(self._say, addr=addr))

    def _say(self, data: bytes, addr: Any) -> None:
        assert self._transport is not None
        if not self._full and not self._transport.is_closing():  # a datagram may be lost: memory is worse
            with suppress(OSError):
                self._transport.sendto(data, addr)

    def error_received(self, exc: Exception) -> None:
        """Somebody who asked is gone: nothing to be done about it."""

    def pause_writing(self) -> None:
        self._full = True

    def resume_writing(self) -> None:
        self._full = False


class SerialServer:
    """A server on a serial port of this loop."""

    def __init__(self, endpoint: Endpoint, units: Mapping[int, Unit]) -> None:
        from barewire.io.ports.async_serial import SerialLink
        from barewire.io.ports.serial import SerialPort

        self._line = modbus_line(endpoint, "server", tuple(units))
        self._server = Server(self._line, units, serial=True)
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._sending: set[asyncio.Task[None]] = set()
        self.failure: PortError | None = None
        """Why it ended by itself: the port is gone."""
        self._link = SerialLink(SerialPort.of(endpoint), self._feed, self._fail)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def _feed(self, data: bytes | None) -> None:
        replies = self._server.feed(data, self._loop.time())
        if replies:
            task = self._loop.create_task(self._send([reply.data for reply in replies], replies[0].at))
            self._sending.add(task)
            task.add_done_callback(self._sending.discard)
        if self._timer is not None:
            self._timer.cancel()
        deadline = self._server.deadline
        self._timer = None if deadline is None else self._loop.call_at(deadline, self._feed, None)

    async def _send(self, frames: list[bytes], at: float) -> None:
        await asyncio.sleep(at - self._loop.time())
        for frame in frames:
            with suppress(PortError):
                self._link.write(frame)
        await self._link.sent()
        self._line.sent(self._loop.time())

    def _fail(self, why: str) -> None:
        self.failure = PortError(f"{self._link.name}: {why}")

    async def close(self) -> None:
        """Give the port back."""
        if self._timer is not None:
            self._timer.cancel()
        self._link.close()
