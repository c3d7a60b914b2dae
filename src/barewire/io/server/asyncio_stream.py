"""Asyncio servers for every carrier: give `serve` a URL and units.

    async with await serve("tcp://0.0.0.0:502", {1: Table()}) as server:
        ...

Connections (TCP, TLS, RTU and ASCII over TCP) have the limits of `guests`. Who asks and does not read is not listened
to until then. Nobody waits for anybody else.
"""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import Mapping
from typing import Any, Self

from barewire.errors import DecodeError, PortError
from barewire.io.endpoint import Endpoint, Turn
from barewire.io.modbus.carriers import modbus_endpoint, modbus_line
from barewire.io.ports.tcp import CHUNK, CONNECTIONS, attend, reason
from barewire.io.ports.tls import roles_of, server_context, tls_reason
from barewire.io.ports.tls_session import TlsSession
from barewire.io.server.asyncio_ports import DatagramServer, SerialServer
from barewire.io.server.connection_limits import ConnectionTable, Spoil, say_all
from barewire.modbus import Authorization, Request, Server, Unit
from barewire.modbus.server.server import counters_for

HANDSHAKE = 10.0
"""Seconds that TLS may take to come about."""


class StreamServer(ConnectionTable["_Connection"]):
    """A server on a TCP port and its connections. Leaving its `async with`, or `close`, ends all of them."""

    def __init__(
        self, endpoint: Endpoint, units: Mapping[int, Unit], authorisation: Authorization | None = None
    ) -> None:
        super().__init__(endpoint)
        self.endpoint = endpoint
        self.units = units
        self.spoil: Spoil | None = None
        """Who decides what becomes of an answer, for a server with faults on request."""
        self.context: ssl.SSLContext | None = None
        self._authorisation = authorisation
        self.counters = counters_for(modbus_line(endpoint, "server"))
        """By unit, for the envelopes of serial lines: a unit counts what it sees, over whatever connection."""
        self._server: asyncio.Server | None = None
        self._timer: asyncio.TimerHandle | None = None
        if endpoint.scheme == "tls":
            self.context = server_context(endpoint)
            self._authorisation = authorisation or roles_of(endpoint)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def authorisation(self) -> Authorization | None:
        """Who may do what. Said when the server is made and not later: where nobody has a role, no connection asks."""
        return self._authorisation

    @property
    def port(self) -> int:
        """The port it listens on: of interest when it was asked for port 0."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    async def listen(self, listener: socket.socket | None = None) -> None:
        """Begin to listen; on a socket that is bound already, if there is one."""
        loop, (host, port) = asyncio.get_running_loop(), self.endpoint.host_and_port
        where: dict[str, Any] = {"host": host, "port": port} if listener is None else {"sock": listener}
        try:
            self._server = await loop.create_server(lambda: _Connection(self), backlog=CONNECTIONS, **where)
        except OSError as error:
            raise PortError(f"{host}:{port}: {reason(error)}") from None

    async def close(self) -> None:
        """Hang up on everybody and give the port back."""
        assert self._server is not None
        self._server.close()
        if self._timer is not None:
            self._timer.cancel()
        for connection in list(self.connections):
            connection.abort()
        await self._server.wait_closed()

    def arrived(self, guest: _Connection, now: float) -> None:
        """A new connection; if it is one too many, another one has to go."""
        super().arrived(guest, now)
        if self.idle and self._timer is None:
            self._watch()

    def _watch(self) -> None:
        loop = asyncio.get_running_loop()
        again = self.watch(loop.time())
        self._timer = None if again is None else loop.call_at(again, self._watch)


class _Connection(asyncio.BufferedProtocol):
    """One client of a server: its own line, the units of all. One read is never more than the buffer."""

    def __init__(self, server: StreamServer) -> None:
        self.peer = "?"
        self.was_answered = False
        self._all = server
        self._loop = asyncio.get_running_loop()
        self._line = modbus_line(server.endpoint, "server", tuple(server.units))
        is_serial = server.endpoint.envelope != "tcp"
        has_roles = server.context is not None or server.authorisation is not None
        permits = self._permits if has_roles else None
        self._server = Server(self._line, server.units, serial=is_serial, permits=permits, counters=server.counters)
        self._tls = TlsSession(server.context) if server.context is not None else None
        # Where frames are sought byte by byte, little at a time: whoever talks nonsense keeps the others waiting less.
        self._buffer = memoryview(bytearray(512 if is_serial else CHUNK))
        self._timer: asyncio.TimerHandle | None = None
        self._transport: asyncio.Transport | None = None

    def _permits(self, unit: int, request: Request[Any]) -> bool:
        table, role = self._all.authorisation, self._tls.role if self._tls is not None else None
        return table is None or table.allows(role, unit, request)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        host, port = (transport.get_extra_info("peername") or ("?", 0))[:2]
        self.peer = f"{host}:{port}"
        if (raw := transport.get_extra_info("socket")) is not None:
            attend(raw)
        self._all.arrived(self, self._loop.time())
        if self._tls is not None:
            self._timer = self._loop.call_later(HANDSHAKE, self._impatient)

    def _impatient(self) -> None:
        if self._tls is not None and not self._tls.stands:
            self._all.turn_away(self, f"TLS did not come about within {HANDSHAKE:g} s")

    def connection_lost(self, exc: Exception | None) -> None:
        self._all.left(self)
        if self._timer is not None:
            self._timer.cancel()

    @property
    def unsent(self) -> int:
        """The bytes that the client has not taken yet."""
        return 0 if self._transport is None else self._transport.get_write_buffer_size()

    def abort(self) -> None:
        """Hang up at once."""
        if self._transport is not None:
            self._transport.abort()

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        now = self._loop.time()
        self._all.heard(self, now)
        data = self._buffer[:nbytes].tobytes()
        if self._tls is None:
            self._feed(data, now)
        else:
            self._decrypt(self._tls, data, now)

    def _decrypt(self, tls: TlsSession, data: bytes, now: float) -> None:
        assert self._transport is not None
        why, said = "", []
        try:
            said = tls.feed(data)
        except DecodeError as error:
            why = error.text
        except ssl.SSLError as error:
            why = tls_reason(error)
        self._transport.write(tls.outgoing())  # the alert too, so that the client knows why
        for part in said:
            self._feed(part, now)
        if why or tls.ended:
            self._hang_up(why)

    def _feed(self, data: bytes | None, now: float) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        replies = self._server.feed(data, now)
        if replies:
            self.was_answered = True
            say_all(replies, self._write, self._all.spoil)
        if self._server.serial:
            self._keep_time(bool(replies))
        if self._line.broken is not None:
            # Nobody knows any more where a frame begins: the only honest answer is to hang up.
            self._hang_up(str(self._line.broken))

    def _keep_time(self, has_spoken: bool) -> None:
        """The silences of a serial line, which something behind a tunnel may be."""
        if has_spoken:
            self._line.sent(self._loop.time())
        if self._timer is not None:
            self._timer.cancel()
        at = self._server.deadline
        self._timer = None if at is None else self._loop.call_at(at, self._feed, None, at)

    def _write(self, data: bytes) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._tls is not None:
            self._tls.say(data)
            data = self._tls.outgoing()
        self._transport.write(data)

    def _hang_up(self, why: str) -> None:
        """Close, after what is still to be sent."""
        assert self._transport is not None
        if why:
            self._all.note(self, why)
        self._transport.close()

    def pause_writing(self) -> None:
        """A client that asks and does not read: stop listening to it until it does."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.pause_reading()

    def resume_writing(self) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.resume_reading()


AsyncServer = StreamServer | DatagramServer | SerialServer


async def serve(
    url: str,
    units: Mapping[int, Unit],
    *,
    listener: socket.socket | None = None,
    authorisation: Authorization | None = None,
    turn: Turn | None = None,
) -> AsyncServer:
    """Start a server for these units at a URL.

    A `listener` is a socket that is bound already; `turn(sending)` turns the direction of a two-wire line.

    Raises EncodeError for a URL that says nothing sensible, PortError for a port that cannot be had.
    """
    endpoint = modbus_endpoint(url).turned_by(turn)
    if endpoint.is_serial_port:
        return SerialServer(endpoint, units)
    server = server_at(endpoint, units, authorisation)
    await server.listen(listener)
    return server


def server_at(
    endpoint: Endpoint, units: Mapping[int, Unit], authorisation: Authorization | None = None
) -> StreamServer | DatagramServer:
    """The server of a host and port, not listening yet: what is wrong with the URL is told here."""
    if endpoint.scheme == "udp":
        return DatagramServer(endpoint, units)
    return StreamServer(endpoint, units, authorisation)


async def serve_tcp(
    units: Mapping[int, Unit], host: str = "127.0.0.1", port: int = 502, *, listener: socket.socket | None = None
) -> StreamServer:
    """Start a Modbus TCP server for these units."""
    shown = f"[{host}]" if ":" in host else host
    server = await serve(f"tcp://{shown}:{port}", units, listener=listener)
    assert isinstance(server, StreamServer)
    return server
