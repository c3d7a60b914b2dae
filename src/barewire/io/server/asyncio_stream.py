"""The asyncio server for connections, TCP, TLS, RTU and ASCII over TCP; and an asyncio server in a thread.

    bytes -> (TlsSession) -> Server.feed -> (fault injector) -> (TlsSession) -> bytes

Its limits are those of `connection_limits`. While a client does not read its answers, its requests are not read
either. Clients do not delay each other.
"""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from barewire.errors import DecodeError, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.modbus.carriers import modbus_line
from barewire.io.ports.tcp import CHUNK, CONNECTIONS, listening_socket, place_of, reason
from barewire.io.ports.tls import roles_of, server_context, tls_reason
from barewire.io.ports.trace import Watch
from barewire.io.server.accepting import Acceptor
from barewire.io.server.asyncio_ports import DatagramServer
from barewire.io.server.base import POLL_INTERVAL
from barewire.io.server.connection_limits import ConnectionTable, End, Inject, send_replies
from barewire.io.server.server_log import server_log
from barewire.io.server.tls_session import TlsSession
from barewire.modbus import Authorization, Request, Server, Unit
from barewire.modbus.server.server import ServerStatistics, counters_for

if TYPE_CHECKING:
    from barewire.modbus.messages.registry import AnyRequest

_HANDSHAKE = 10.0
"""Seconds that a TLS handshake may take."""
_HANDSHAKES = 256
"""TLS handshakes under way at a time: each takes 50 KB, most of it in OpenSSL."""
_SHORTEST = 1.0
"""Seconds that a TLS handshake has in any case, also while others wait."""


class StreamServer:
    """A server of units on a TCP port. `authorization` is used with TLS; `inject` puts faults into the answers."""

    def __init__(
        self,
        endpoint: Endpoint,
        units: Mapping[int, Unit],
        authorization: Authorization | None = None,
        inject: Inject | None = None,
    ) -> None:
        self.log = server_log(endpoint)
        self.statistics = ServerStatistics()
        self.connections: ConnectionTable[_Connection] = ConnectionTable(endpoint, self.statistics, self.log)
        self.endpoint = endpoint
        self.units = units
        self.inject = inject
        self.context: ssl.SSLContext | None = None
        self.authorization = authorization
        self.counters = counters_for(modbus_line(endpoint, "server"))
        """By unit, for RTU and ASCII: the counters of a unit include the frames of all connections."""
        self._listener: socket.socket | None = None
        self._accepting: asyncio.Task[None] | None = None
        self.handshakes: dict[_Connection, float] = {}
        """The connections whose TLS handshake is under way, and since when."""
        self._timer: asyncio.TimerHandle | None = None
        if endpoint.transport == "tls":
            self.context = server_context(endpoint)
            self.authorization = authorization or roles_of(endpoint)

    @property
    def port(self) -> int:
        """The number of the port that it listens on."""
        assert self._listener is not None
        return int(self._listener.getsockname()[1])

    async def listen(self, listener: socket.socket | None = None) -> None:
        """Begin to listen, on `listener` if given (a bound socket). Raises PortError."""
        self._listener = listening_socket(self.endpoint)[0] if listener is None else listener
        host, _ = self.endpoint.host_and_port
        try:
            self._listener.listen(CONNECTIONS)
        except OSError as error:
            raise PortError(f"{place_of(host, self.port)}: {reason(error)}") from None
        self.log.serving(str(self.endpoint._replace(place=place_of(host, self.port))), self.units)
        acceptor = Acceptor(self._listener, self.connections)
        self._accepting = asyncio.get_running_loop().create_task(self._accept(self._listener, acceptor))

    async def _accept(self, listener: socket.socket, acceptor: Acceptor) -> None:
        loop = asyncio.get_running_loop()
        while True:
            while (wait := self._handshake_wait(loop.time())) is not None:
                await asyncio.sleep(wait)
            try:
                accepted = acceptor.accept(await loop.sock_accept(listener))
            except OSError as error:
                await asyncio.sleep(acceptor.failed(error))  # at least one round, in which the loop closes a connection
            else:
                await asyncio.gather(*(self._connect(connection) for connection, _ in accepted))

    async def _connect(self, connection: socket.socket) -> None:
        try:
            await asyncio.get_running_loop().connect_accepted_socket(lambda: _Connection(self), connection)
        except Exception as error:  # raised by the caller's code: a look-up of units
            connection.close()
            self.log.error("accept", f"a connection was not accepted: {type(error).__name__}: {error}", error)

    def _handshake_wait(self, now: float) -> float | None:
        """Return the seconds to wait because too many TLS handshakes are under way; None if another one may begin.

        A handshake that kept others waiting for a second is given up: those of a client that only begins them would
        take memory and keep others out; but no burst of clients that finish them loses one.
        """
        if len(self.handshakes) < _HANDSHAKES:
            return None
        oldest, since = next(iter(self.handshakes.items()))
        if now < since + _SHORTEST:
            return min(since + _SHORTEST - now, POLL_INTERVAL)
        self.connections.close(oldest, f"the oldest of {_HANDSHAKES} TLS handshakes under way", "refused")
        return 0.0

    async def close(self) -> None:
        """Close all connections and release the port."""
        if self._accepting is not None:
            self._accepting.cancel()
            await asyncio.wait([self._accepting])
        if self._timer is not None:
            self._timer.cancel()
        self.connections.close_all()
        await asyncio.sleep(0)  # in this round the loop closes them
        if self._listener is not None:
            self._listener.close()
        self.log.stopped()

    def connected(self, connection: _Connection) -> None:
        """Record a new connection, and start the timer that closes idle ones."""
        self.connections.add(connection, asyncio.get_running_loop().time())
        if self.connections.idle_timeout and self._timer is None:
            self._close_idle()

    def _close_idle(self) -> None:
        loop = asyncio.get_running_loop()
        again = self.connections.close_idle(loop.time())
        self._timer = None if again is None else loop.call_at(again, self._close_idle)


class _Connection(asyncio.BufferedProtocol):
    """The connection of one client: it has its own framing state, and shares the units."""

    def __init__(self, server: StreamServer) -> None:
        self.peer = "?"
        self.was_answered = False
        self._shared = server
        self._loop = asyncio.get_running_loop()
        self._line = modbus_line(server.endpoint, "server", tuple(server.units))
        is_serial = server.endpoint.framing != "tcp"
        has_roles = server.context is not None or server.authorization is not None
        permits = self._permits if has_roles else None
        self._server = Server(
            self._line,
            server.units,
            serial=is_serial,
            permits=permits,
            counters=server.counters,
            statistics=server.statistics,
            on_failure=server.log.failed,
            on_refusal=self._refused,
        )
        self._watch: Watch | None = None
        self._tls = TlsSession(server.context) if server.context is not None else None
        # One read takes at most this buffer. It is small where frames are searched byte by byte, so that a client which
        # sends noise delays the others less.
        self._buffer = memoryview(bytearray(512 if is_serial else CHUNK))
        self._timer: asyncio.TimerHandle | None = None
        self._transport: asyncio.Transport | None = None

    def _permits(self, unit: int, request: Request[Any]) -> bool:
        table, role = self._shared.authorization, self._tls.role if self._tls is not None else None
        return table is None or table.allows(role, unit, request)

    def _refused(self, unit: int, request: AnyRequest | None) -> None:
        self._shared.log.refused(unit, request, self.peer, None if self._tls is None else self._tls.role)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        host, port = (transport.get_extra_info("peername") or ("?", 0))[:2]
        self.peer = f"{host}:{port}"
        self._watch = self._shared.log.watch(self.peer)
        self._shared.connected(self)
        if self._tls is not None:
            self._shared.handshakes[self] = self._loop.time()
            self._timer = self._loop.call_later(_HANDSHAKE, self._handshake_timeout)

    def _handshake_timeout(self) -> None:
        if self._tls is not None and not self._tls.is_established:
            self._shared.connections.close(self, f"no TLS handshake within {_HANDSHAKE:g} s", "refused")

    def connection_lost(self, exc: Exception | None) -> None:
        self._shared.connections.remove(self)
        if self._timer is not None:
            self._timer.cancel()
        self._shared.handshakes.pop(self, None)
        # Now, and not when Python looks for circles of references: it does not count the memory of OpenSSL.
        self._tls = None

    @property
    def unsent(self) -> int:
        """How many bytes the client has not read yet."""
        return 0 if self._transport is None else self._transport.get_write_buffer_size()

    def abort(self) -> None:
        """Close the connection at once."""
        if self._transport is not None:
            self._transport.abort()

    def get_buffer(self, sizehint: int) -> memoryview:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        now = self._loop.time()
        self._shared.connections.received(self, now)
        data = self._buffer[:nbytes].tobytes()
        if self._tls is None:
            self._feed(data, now)
        else:
            self._decrypt(self._tls, data, now)

    def _decrypt(self, tls: TlsSession, data: bytes, now: float) -> None:
        assert self._transport is not None
        why, received = "", []
        try:
            received = tls.feed(data)
        except DecodeError as error:
            why = error.text
        except ssl.SSLError as error:
            why = tls_reason(error)
        if tls.is_established:
            self._shared.handshakes.pop(self, None)
        self._transport.write(tls.outgoing())  # after an error it has the alert, which gives the client the reason
        for part in received:
            self._feed(part, now)
        if why or tls.ended:
            self._end(why, "broken" if tls.is_established else "refused")

    def _feed(self, data: bytes | None, now: float) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._watch is not None and data is not None:
            self._watch("received", data)
        replies = self._server.feed(data, now)
        if replies:
            self.was_answered = True
            send_replies(replies, self._write, self._shared.inject)
        if self._server.serial:
            self._set_timer(bool(replies))
        if self._line.broken is not None:
            # The beginning of the next frame cannot be found any more.
            self._end(str(self._line.broken), "broken")

    def _set_timer(self, has_sent: bool) -> None:
        """Set the timer for the next silence of a serial line, which may be at the end of a tunnel."""
        if has_sent:
            self._line.sent(self._loop.time())
        if self._timer is not None:
            self._timer.cancel()
        deadline = self._server.deadline
        self._timer = None if deadline is None else self._loop.call_at(deadline, self._feed, None, deadline)

    def _write(self, data: bytes) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._watch is not None:
            self._watch("sent", data)
        if self._tls is not None:
            self._tls.send(data)
            data = self._tls.outgoing()
        self._transport.write(data)

    def _end(self, why: str, end: End) -> None:
        """Close after the pending bytes are sent. Without `why` the client ended the connection."""
        assert self._transport is not None
        if why:
            self._shared.connections.note(self, why, end)
        self._transport.close()

    def pause_writing(self) -> None:
        """Called by asyncio when the client does not read its answers: read nothing from it until it does."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.pause_reading()

    def resume_writing(self) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.resume_reading()


def server_at(
    endpoint: Endpoint,
    units: Mapping[int, Unit],
    authorization: Authorization | None = None,
    inject: Inject | None = None,
) -> StreamServer | DatagramServer:
    """Return the server of a host and port, which does not listen yet. Raises EncodeError for wrong options."""
    if endpoint.is_datagram:
        return DatagramServer(endpoint, units, inject)
    return StreamServer(endpoint, units, authorization, inject)


class AsyncioService:
    """An asyncio server in a thread of `ModbusServer`: tls, udp, rtu+tcp, ascii+tcp.

    `inject` puts faults into the answers.
    """

    def __init__(
        self,
        endpoint: Endpoint,
        units: Mapping[int, Unit],
        authorization: Authorization | None = None,
        inject: Inject | None = None,
    ) -> None:
        self._server = server_at(endpoint, units, authorization, inject)
        self.connections = self._server.connections
        self.statistics = self._server.statistics
        self._listener, self.url = listening_socket(endpoint)

    def serve(self, is_over: Callable[[], bool]) -> None:
        """Serve until `is_over()`."""
        asyncio.run(self._serve(is_over))

    async def _serve(self, is_over: Callable[[], bool]) -> None:
        await self._server.listen(self._listener)
        try:
            while not is_over():
                await asyncio.sleep(POLL_INTERVAL)
        finally:
            await self._server.close()

    def close(self) -> None:
        """Release the port."""
        self._listener.close()
