"""Asyncio servers without connections: on a UDP port, and on a serial port."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, cast

from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.modbus.carriers import modbus_line
from barewire.io.ports.tcp import place_of, reason
from barewire.io.ports.udp import is_own_address
from barewire.io.server.connection_limits import ConnectionTable, Inject
from barewire.io.server.datagram_limits import COPIES, RATE, DatagramLimits
from barewire.io.server.server_log import server_log
from barewire.modbus import Server, Unit
from barewire.modbus.server.server import Reply, ServerStatistics


class DatagramServer(asyncio.DatagramProtocol):
    """A server on a UDP port. Each datagram is a frame; its answer is sent to the address it came from."""

    def __init__(self, endpoint: Endpoint, units: Mapping[int, Unit], inject: Inject | None = None) -> None:
        self.connections: ConnectionTable[Any] = ConnectionTable(endpoint)  # always empty: datagrams have none
        self._endpoint = endpoint
        self._inject = inject
        self._log = server_log(endpoint)
        self._watch: Callable[[str, bytes], None] | None = None
        self._peer = "?"
        self._server = Server(
            modbus_line(endpoint, "server"),
            units,
            serial=False,
            on_failure=self._log.failed,
            on_refusal=lambda unit, request: self._log.refused(unit, request, self._peer),
        )
        self.statistics = self._server.statistics
        self._transport: asyncio.DatagramTransport | None = None
        self._full = False
        self._limits = DatagramLimits(lambda sender: is_own_address(self._address, sender))
        self._address: Any = None

    @property
    def port(self) -> int:
        """The UDP port number on which the server listens."""
        assert self._transport is not None
        return int(self._transport.get_extra_info("sockname")[1])

    async def listen(self, listener: socket.socket | None = None) -> None:
        """Begin to listen, on `listener` if given (a bound socket). Raises PortError."""
        loop = asyncio.get_running_loop()
        host, port = self._endpoint.host_and_port
        address: dict[str, Any] = {"sock": listener} if listener is not None else {"local_addr": (host, port)}
        try:
            await loop.create_datagram_endpoint(lambda: self, **address)
        except OSError as error:
            raise PortError(f"{host}:{port}: {reason(error)}") from None
        self._log.serving(str(self._endpoint._replace(place=place_of(host, self.port))), self._server.units)
        self._watch = self._log.watch()

    async def close(self) -> None:
        """Release the port."""
        if self._transport is not None:
            self._transport.abort()
        self._log.stopped()

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
            self._log.warning("rate", f"{addr[0]}: more than {RATE} datagrams in a second: refused")
            return
        if self._limits.is_own_answer(data, addr, now):
            self.statistics.echoes += 1
            why = f"from the address of this server, or the same {COPIES} times, as an answer that goes round"
            self._log.warning("echo", f"{addr[0]}:{addr[1]}: a datagram {why}: refused")
            return
        for reply in self._server.feed(data, now):
            if reply.data == data:
                self._limits.answered_with_itself(data, addr, now)
            if self._inject is None:
                self._send(reply.data, addr)
            else:
                self._inject(reply, partial(self._send, addr=addr))

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


class SerialServer:
    """A server on a serial port, read and written by the running event loop. It counts in `statistics`.

    As the server in a thread, it does not read while it sends a reply, or waits until a `Delayed` one is due.
    """

    def __init__(
        self, endpoint: Endpoint, units: Mapping[int, Unit], inject: Inject | None, statistics: ServerStatistics
    ) -> None:
        from barewire.io.ports.async_serial import SerialLink
        from barewire.io.ports.serial import SerialPort

        self.connections: ConnectionTable[Any] = ConnectionTable(endpoint)  # always empty: a line has none
        self._inject = inject
        self._line = modbus_line(endpoint, "server", tuple(units))
        self._log = server_log(endpoint)
        self._server = Server(self._line, units, serial=True, statistics=statistics, on_failure=self._log.failed)
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._sending: asyncio.Task[None] | None = None
        self.failure: PortError | None = None
        """The error of the port that ended the server, or None."""
        self._link = SerialLink(SerialPort.of_server(endpoint), self._feed, self._fail)
        self._log.serving(str(endpoint), units)
        self._watch = self._log.watch()

    def _feed(self, data: bytes | None) -> None:
        if self._watch is not None and data is not None:
            self._watch("received", data)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        replies = self._server.feed(data, self._loop.time())
        if replies:
            # The server answers one request after the other: until the reply is sent, requests wait in the port.
            self._link.pause_reading()
            self._sending = self._loop.create_task(self._send(replies))
        else:
            self._set_timer()

    def _set_timer(self) -> None:
        deadline = self._server.deadline
        self._timer = None if deadline is None else self._loop.call_at(deadline, self._feed, None)

    async def _send(self, replies: list[Reply]) -> None:
        try:
            for reply in replies:
                await asyncio.sleep(reply.at - self._loop.time())
                if self._inject is None:
                    self._write(reply.data)
                else:
                    self._inject(reply, self._write)
            await self._link.sent()
            self._line.sent(self._loop.time())
        finally:
            self._link.resume_reading()
            self._set_timer()

    def _write(self, frame: bytes) -> None:
        if self._watch is not None:
            self._watch("sent", frame)
        with suppress(PortError):
            self._link.write(frame)

    def _fail(self, why: str) -> None:
        self.failure = PortError(f"{self._link.name}: {why}")
        self._log.error("ended", f"ended: {why}")

    async def close(self) -> None:
        """Release the port."""
        self._link.close()
        if self._sending is not None:
            self._sending.cancel()
            await asyncio.wait([self._sending])
        if self._timer is not None:
            self._timer.cancel()
        self._log.stopped()
