"""The asyncio engine: `blocking` with await, and what asyncio has of its own: a TCP client and a TCP server.

    async with await open_tcp("127.0.0.1", 1502) as client:
        (await client.ask(ReadHoldingRegisters(0, 2))).registers

    server = await serve_tcp({1: Table()}, "127.0.0.1", 1502)

A task that is cancelled abandons its conversation; the connection stays good, because what comes late carries the
transaction number of a request that nobody waits for any more.
"""

from __future__ import annotations

import asyncio
import socket
from collections import deque
from collections.abc import Mapping
from types import TracebackType
from typing import Protocol, Self, TypeVar

from barewire.codecs import Value
from barewire.conversation import Conversation, Heard, Send, last_words
from barewire.devices.access import read_modbus, write_modbus
from barewire.devices.device import Device
from barewire.devices.parameter import Reading
from barewire.errors import PortError
from barewire.modbus import Bus, Line, Request, Response, Server, Unit
from barewire.shells.tcp_socket import reason
from barewire.tcp import TcpLine

Item = TypeVar("Item")
Result = TypeVar("Result")
R = TypeVar("R", bound=Response)
T = TypeVar("T")


class AsyncPort(Protocol[Item]):
    """What the asyncio engine talks through. `write` only hands over, so it can be called while going down."""

    def write(self, item: Item) -> None: ...

    async def receive(self, timeout: float) -> Item | None: ...

    def close(self) -> None: ...


async def run(conversation: Conversation[Item, Result], port: AsyncPort[Item]) -> Result:
    """Carry a conversation out. Cancelling the task abandons it: it may say its last words."""
    clock = asyncio.get_running_loop().time
    try:
        step = next(conversation)
        while True:
            if isinstance(step, Send):
                port.write(step.item)
                heard: Heard[Item] = Heard(None, clock())
            else:
                item = await port.receive(max(0.0, step.until - clock()))
                heard = Heard(item, clock())
            step = conversation.send(heard)
    except StopIteration as stop:
        result: Result = stop.value
        return result
    except BaseException:
        for item in last_words(conversation):
            port.write(item)
        raise


class TcpPort(asyncio.Protocol):
    """A TCP connection as an asyncio port."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._chunks: deque[bytes] = deque()
        self._waiter: asyncio.Future[None] | None = None
        self._lost: str | None = None
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: the connection stands."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        no_delay(transport)

    def data_received(self, data: bytes) -> None:
        """asyncio: bytes came."""
        self._chunks.append(data)
        self._wake()

    def connection_lost(self, exc: Exception | None) -> None:
        """asyncio: the connection is gone."""
        self._lost = reason(exc) if isinstance(exc, OSError) else "the other side closed the connection"
        self._wake()

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def write(self, item: bytes) -> None:
        """Hand the bytes over; PortError if the connection is gone."""
        if self._lost is not None or self._transport is None:
            raise PortError(f"{self.name}: {self._lost or 'not connected'}")
        self._transport.write(item)

    async def receive(self, timeout: float) -> bytes | None:
        """What came within `timeout` seconds, or None; PortError if the connection is gone."""
        if not self._chunks and self._lost is None and timeout > 0:
            loop = asyncio.get_running_loop()
            self._waiter = loop.create_future()
            timer = loop.call_later(timeout, self._wake)
            try:
                await self._waiter
            finally:
                timer.cancel()
                self._waiter = None
        if self._chunks:
            return self._chunks.popleft()
        if self._lost is not None:
            raise PortError(f"{self.name}: {self._lost}")
        return None

    def close(self) -> None:
        """Hang up."""
        if self._transport is not None:
            self._transport.close()


class AsyncModbusClient:
    """A client on one connection, the same words as the blocking one. One exchange at a time has the line."""

    def __init__(self, port: AsyncPort[bytes], line: Line, *, unit: int = 1, timeout: float = 1.0) -> None:
        self.port = port
        self.bus = Bus(line)
        self.unit = unit
        self.timeout = timeout
        self._turn = asyncio.Lock()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the port back."""
        self.port.close()

    async def run(self, conversation: Conversation[bytes, T]) -> T:
        """Carry any conversation out on this line, alone."""
        async with self._turn:
            return await run(conversation, self.port)

    async def ask(
        self, request: Request[R], *, unit: int | None = None, timeout: float | None = None, retries: int = 0
    ) -> R:
        """Ask and return the response; a read may be repeated. Raises ModbusException, NoAnswer, PortError."""
        at = self.unit if unit is None else unit
        limit = self.timeout if timeout is None else timeout
        return await self.run(self.bus.ask(at, request, timeout=limit, retries=retries))

    async def read(self, device: Device, *names: str) -> list[Reading]:
        """Named values, with as few requests as the device allows, in the order asked."""
        return await self.run(read_modbus(self.bus, self.unit, device, names, timeout=self.timeout))

    async def write(self, device: Device, values: Mapping[str, Value], *, force: bool = False) -> None:
        """Write named values, in the order given. Ranges and access are checked before anything is sent."""
        await self.run(write_modbus(self.bus, self.unit, device, values, timeout=self.timeout, force=force))


async def open_tcp(host: str, port: int = 502, *, unit: int = 1, timeout: float = 1.0) -> AsyncModbusClient:
    """Connect to a Modbus TCP server. PortError in one line if that fails."""
    name = f"{host}:{port}"
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(5.0):
            _, connection = await loop.create_connection(lambda: TcpPort(name), host, port)
    except TimeoutError:
        raise PortError(f"{name}: no connection within 5 s") from None
    except OSError as error:
        raise PortError(f"{name}: {reason(error)}") from None
    return AsyncModbusClient(connection, TcpLine(), unit=unit, timeout=timeout)


class TcpServer:
    """A running server and its connections. Leaving its `async with`, or `close`, ends all of them."""

    def __init__(self, units: Mapping[int, Unit]) -> None:
        self.units = units
        self.connections: set[asyncio.Transport] = set()
        self._server: asyncio.Server | None = None

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def port(self) -> int:
        """The port it listens on: of interest when it was asked for port 0."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    async def listen(self, host: str, port: int, listener: socket.socket | None) -> None:
        """Begin to listen."""
        loop = asyncio.get_running_loop()
        if listener is not None:
            self._server = await loop.create_server(lambda: _Connection(self), sock=listener)
        else:
            self._server = await loop.create_server(lambda: _Connection(self), host, port)

    async def close(self) -> None:
        """Hang up on everybody and give the port back."""
        assert self._server is not None
        self._server.close()
        for transport in list(self.connections):
            transport.abort()
        await self._server.wait_closed()


class _Connection(asyncio.Protocol):
    """One client of a server: its own line, the units of all."""

    def __init__(self, server: TcpServer) -> None:
        self._all = server.connections
        self._clock = asyncio.get_running_loop().time
        self._line = TcpLine()
        self._server = Server(self._line, server.units, serial=False)
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._all.add(transport)
        no_delay(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        assert self._transport is not None
        self._all.discard(self._transport)

    def data_received(self, data: bytes) -> None:
        assert self._transport is not None
        for reply in self._server.feed(data, self._clock()):
            self._transport.write(reply.data)
        if self._line.broken is not None:
            # Nobody knows any more where a frame begins: the only honest answer is to hang up.
            self._transport.close()

    def pause_writing(self) -> None:
        """A client that asks and does not read: stop listening to it until it does."""
        assert self._transport is not None
        self._transport.pause_reading()

    def resume_writing(self) -> None:
        assert self._transport is not None
        if not self._transport.is_closing():
            self._transport.resume_reading()


async def serve_tcp(
    units: Mapping[int, Unit], host: str = "127.0.0.1", port: int = 502, *, listener: socket.socket | None = None
) -> TcpServer:
    """Start a Modbus TCP server for these units. A `listener` is a socket that is bound already."""
    server = TcpServer(units)
    try:
        await server.listen(host, port, listener)
    except OSError as error:
        raise PortError(f"{host}:{port}: {reason(error)}") from None
    return server


def no_delay(transport: asyncio.Transport) -> None:
    """Small frames leave at once."""
    raw = transport.get_extra_info("socket")
    if raw is not None:
        raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
