"""The asyncio servers of host and port: connections (TCP, TLS, RTU and ASCII over TCP), and datagrams (UDP).

    bytes -> (TlsSession) -> answer -> (fault injector) -> (TlsSession) -> bytes

While a client does not read its answers, its requests are not read either. Clients do not delay each other.
`AsyncioService` runs such a server in a thread.
"""

from __future__ import annotations

import asyncio
import socket
from collections import OrderedDict
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, cast

from barewire.errors import DecodeError, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.network import CHUNK, CONNECTIONS, is_own_address, listening_socket, place_of, reason
from barewire.io.server.base import POLL_INTERVAL
from barewire.io.server.limits import COPIES, RATE, Acceptor, DatagramLimits, End
from barewire.io.server.units import Inject, UnitsConnection, UnitsServer, later_response
from barewire.modbus import AnyUnit, Authorization, Caller, Reply, Request, Server
from barewire.modbus.server.server import counters_for

if TYPE_CHECKING:
    from ssl import SSLContext

    from barewire.io.ports.tls import TlsSession

_HANDSHAKE = 10.0
"""Seconds that a TLS handshake may take."""
_HANDSHAKES = 256
"""TLS handshakes under way at a time: each takes 50 KB, most of it in OpenSSL."""
_CALLERS = 256
"""The most clients of a UDP port that are remembered, each with its queue in a gateway."""
_SHORTEST = 1.0
"""Seconds that a TLS handshake has in any case, also while others wait."""


class StreamServer(UnitsServer):
    """A server of units on a TCP port. `authorization` is used with TLS; `inject` puts faults into the answers."""

    def __init__(
        self,
        endpoint: Endpoint,
        units: Mapping[int, AnyUnit],
        authorization: Authorization | None = None,
        inject: Inject | None = None,
    ) -> None:
        super().__init__(endpoint, units, inject)
        self.context: SSLContext | None = None
        self.authorization = authorization
        self.counters = counters_for(self.line)
        """By unit, for RTU and ASCII: the counters of a unit include the frames of all connections."""
        self._listener: socket.socket | None = None
        self._accepting: asyncio.Task[None] | None = None
        self.handshakes: dict[_Connection, float] = {}
        """The connections whose TLS handshake is under way, and since when."""
        self._timer: asyncio.TimerHandle | None = None
        if endpoint.transport == "tls":
            from barewire.io.ports.tls import roles_of, server_context  # not every Python has TLS

            self.context = server_context(endpoint)
            self.authorization = authorization or roles_of(endpoint)

    async def listen(self, listener: socket.socket | None = None) -> None:
        """Begin to listen, on `listener` if given (a bound socket). Raises PortError."""
        self._listener = listening_socket(self.endpoint)[0] if listener is None else listener
        place = place_of(self.endpoint.host_and_port[0], self._listener.getsockname()[1])
        try:
            self._listener.listen(CONNECTIONS)
        except OSError as error:
            raise PortError(f"{place}: {reason(error)}") from None
        self.url = str(self.endpoint._replace(place=place))
        self.log.serving(self.url, self.units)
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


class _Connection(UnitsConnection, asyncio.BufferedProtocol):
    """The connection of one client, with a transport of the running loop."""

    def __init__(self, server: StreamServer) -> None:
        has_roles = server.context is not None or server.authorization is not None
        super().__init__(
            server,
            permits=self._permits if has_roles else None,
            counters=server.counters,
            send_later=lambda reply, caller: self.send([reply]),
            wait_for=later_response,
        )
        self._stream_server = server
        self._loop = asyncio.get_running_loop()
        self._tls: TlsSession | None = None
        if server.context is not None:
            from barewire.io.ports.tls import TlsSession

            self._tls = TlsSession(server.context)
        # One read takes at most this buffer. It is small where frames are searched byte by byte, so that a client which
        # sends noise delays the others less.
        self._buffer = memoryview(bytearray(512 if self._server.serial else CHUNK))
        self._timer: asyncio.TimerHandle | None = None
        self._transport: asyncio.Transport | None = None

    @property
    def role(self) -> str | None:
        """The role of the client, from its TLS certificate."""
        return None if self._tls is None else self._tls.role

    def _permits(self, unit: int, request: Request[Any]) -> bool:
        table = self._stream_server.authorization
        return table is None or table.allows(self.role, unit, request)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        host, port = (transport.get_extra_info("peername") or ("?", 0))[:2]
        self.peer = self.caller.peer = place_of(host, port)
        self._watch = self._shared.log.watch(self.peer)
        self._stream_server.connected(self)
        if self._tls is not None:
            self._stream_server.handshakes[self] = self._loop.time()
            self._timer = self._loop.call_later(_HANDSHAKE, self._handshake_timeout)

    def _handshake_timeout(self) -> None:
        if self._tls is not None and not self._tls.is_established:
            self._shared.connections.close(self, f"no TLS handshake within {_HANDSHAKE:g} s", "refused")

    def connection_lost(self, exc: Exception | None) -> None:
        self.caller.is_gone = True
        self._shared.connections.remove(self)
        if self._timer is not None:
            self._timer.cancel()
        self._stream_server.handshakes.pop(self, None)
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
        except PortError as error:
            why = str(error)
        if tls.is_established:
            self._stream_server.handshakes.pop(self, None)
            self.caller.role = tls.role
        self._transport.write(tls.outgoing())  # after an error it has the alert, which gives the client the reason
        for part in received:
            self._feed(part, now)
        if why or tls.ended:
            self.end(why, "broken" if tls.is_established else "refused")

    def _feed(self, data: bytes | None, now: float) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        has_sent = self.answer(data, now)
        if self._server.serial:
            self._set_timer(has_sent)

    def _set_timer(self, has_sent: bool) -> None:
        """Set the timer for the next silence of a serial line, which may be at the end of a tunnel."""
        if has_sent:
            self._server.sent(self._loop.time())
        if self._timer is not None:
            self._timer.cancel()
        deadline = self._server.deadline
        self._timer = None if deadline is None else self._loop.call_at(deadline, self._feed, None, deadline)

    def write(self, data: bytes) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._watch is not None:
            self._watch("sent", data)
        if self._tls is not None:
            self._tls.send(data)
            data = self._tls.outgoing()
        self._transport.write(data)

    def end(self, why: str, end: End) -> None:
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


class DatagramServer(UnitsServer, asyncio.DatagramProtocol):
    """A server on a UDP port. Each datagram is a frame; its answer is sent to the address it came from."""

    def __init__(self, endpoint: Endpoint, units: Mapping[int, AnyUnit], inject: Inject | None = None) -> None:
        super().__init__(endpoint, units, inject)
        self._watch: Callable[[str, bytes], None] | None = None
        self._peer = "?"  # the sender of the present request
        self._callers: OrderedDict[Any, Caller] = OrderedDict()  # by address, the one that sent last at the end
        self._server = Server(
            self.line,
            units,
            serial=False,
            statistics=self.statistics,
            on_failure=self.log.failed,
            on_refusal=lambda unit, request: self.log.refused(unit, request, self._peer),
            send_later=lambda reply, caller: self._send_later(reply, caller),
            wait_for=later_response,
        )
        self._transport: asyncio.DatagramTransport | None = None
        self._full = False
        self._limits = DatagramLimits(lambda sender: is_own_address(self._address, sender))
        self._address: Any = None

    async def listen(self, listener: socket.socket | None = None) -> None:
        """Begin to listen, on `listener` if given (a bound socket). Raises PortError."""
        loop = asyncio.get_running_loop()
        host, port = self.endpoint.host_and_port
        address: dict[str, Any] = {"sock": listener} if listener is not None else {"local_addr": (host, port)}
        try:
            await loop.create_datagram_endpoint(lambda: self, **address)
        except OSError as error:
            raise PortError(f"{place_of(host, port)}: {reason(error)}") from None
        self.url = str(self.endpoint._replace(place=place_of(host, self._address[1])))
        self.log.serving(self.url, self.units)
        self._watch = self.log.watch()

    async def close(self) -> None:
        """Release the port."""
        if self._transport is not None:
            self._transport.abort()
        self.log.stopped()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        # A cast, because the transports of some event loops do not inherit from DatagramTransport.
        self._transport = cast(asyncio.DatagramTransport, transport)
        self._address = transport.get_extra_info("sockname")

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self._peer = addr[0]
        if self._watch is not None:
            self._watch(f"{addr[0]}:{addr[1]}: received", data)
        now = asyncio.get_running_loop().time()
        if self._limits.is_too_much(addr[0], now):
            self.statistics.busy += 1
            self.log.warning("rate", f"{addr[0]}: more than {RATE} datagrams in a second: refused")
            return
        if self._limits.is_own_answer(data, addr, now):
            self.statistics.echoes += 1
            why = f"from the address of this server, or the same {COPIES} times, as an answer that goes round"
            self.log.warning("echo", f"{addr[0]}:{addr[1]}: a datagram {why}: refused")
            return
        self._server.caller = self._caller(addr)
        for reply in self._server.feed(data, now):
            if reply.data == data:
                self._limits.answered_with_itself(data, addr, now)
            if self.inject is None:
                self._send(reply.data, addr)
            else:
                self.inject(reply, partial(self._send, addr=addr))

    def _send_later(self, reply: Reply, caller: Caller) -> None:
        host, _, port = caller.peer.rpartition(":")
        self._send(reply.data, (host.strip("[]"), int(port)))

    def _caller(self, addr: Any) -> Caller:
        """Return the client with this address. Only the latest are known, because an address may be forged."""
        caller = self._callers.get(addr)
        if caller is None:
            caller = Caller(place_of(addr[0], addr[1]))
            if len(self._callers) >= _CALLERS:
                oldest = next((known for known, other in self._callers.items() if not other.open_requests), None)
                if oldest is None:
                    return caller  # all of them wait for a response: this one is not remembered
                del self._callers[oldest]
            self._callers[addr] = caller
        self._callers.move_to_end(addr)
        return caller

    def _send(self, data: bytes, addr: Any) -> None:
        assert self._transport is not None
        # While the buffer is full, answers are dropped: a datagram may be lost, but memory must stay limited.
        if not self._full and not self._transport.is_closing():
            if self._watch is not None:
                self._watch(f"{addr[0]}:{addr[1]}: sent", data)
            with suppress(OSError):
                self._transport.sendto(data, addr)

    def error_received(self, exc: Exception) -> None:
        """Called by asyncio if an earlier datagram could not be delivered; the server ignores that."""

    def pause_writing(self) -> None:
        self._full = True

    def resume_writing(self) -> None:
        self._full = False


def server_at(
    endpoint: Endpoint,
    units: Mapping[int, AnyUnit],
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
        units: Mapping[int, AnyUnit],
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
