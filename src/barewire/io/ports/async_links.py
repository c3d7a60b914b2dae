"""Connections of asyncio clients: TCP, TLS inside it, UDP and serial ports; and the mailbox of the bytes they receive.

    connection --put--> | chunk | chunk | --receive--> conversation

If the task that waits is cancelled, no bytes are lost: the next task receives them.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections import deque
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, cast

from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.network import CHUNK, CONNECT_TIMEOUT, place_of, reason, set_socket_options

if TYPE_CHECKING:
    from ssl import SSLContext

    from barewire.io.ports.base import AsyncLink
    from barewire.io.ports.serial import SerialPort

_LIMIT = 0x10000
"""Bytes that a mailbox holds at most: 250 of the longest frames."""

_POLL = 0.001
"""Seconds between two checks whether everything has been sent."""

Receive = Callable[[bytes], None]
"""Called with received bytes."""
Lose = Callable[[str], None]
"""Called with the reason when a connection ends."""


async def connect(endpoint: Endpoint, receive: Receive, lose: Lose) -> AsyncLink:
    """Open the connection of an endpoint. Raises PortError, in one line, if that fails, EncodeError for wrong
    certificates."""
    if endpoint.transport == "serial":
        from barewire.io.ports.serial import SerialPort  # needs pyserial

        return SerialLink(SerialPort.of(endpoint), receive, lose)
    context: SSLContext | None = None
    name: str | None = None
    why: Callable[[Exception], str] = reason
    if endpoint.transport == "tls":
        from barewire.io.ports.tls import client_context, server_name, tls_reason  # not every Python has TLS

        context, name, why = client_context(endpoint), server_name(endpoint), tls_reason
    host, port = endpoint.host_and_port
    loop = asyncio.get_running_loop()
    link: StreamLink | DatagramLink
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT):
            if endpoint.is_datagram:
                link = datagrams = DatagramLink(receive, lose)
                await loop.create_datagram_endpoint(lambda: datagrams, remote_addr=(host, port))
            else:
                link = stream = StreamLink(receive, lose, why)
                await loop.create_connection(lambda: stream, host, port, ssl=context, server_hostname=name)
    except TimeoutError:
        raise PortError(f"{place_of(host, port)}: no connection within {CONNECT_TIMEOUT:g} s") from None
    except OSError as error:
        raise PortError(f"{place_of(host, port)}: {why(error)}") from None
    return link


class StreamLink(asyncio.BufferedProtocol):
    """A TCP or TLS connection.

    It has its own buffer, because asyncio would allocate one of 256 KiB for each answer of thirty bytes.
    """

    def __init__(self, receive: Receive, lose: Lose, why: Callable[[Exception], str]) -> None:
        self._receive = receive
        self._lose = lose
        self._why = why
        self._transport: asyncio.Transport | None = None
        self._together: list[bytes] = []
        self._buffer = memoryview(bytearray(CHUNK))

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by asyncio when the connection is open."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        raw = transport.get_extra_info("socket")
        if raw is not None:
            set_socket_options(raw)

    def get_buffer(self, sizehint: int) -> memoryview:
        """Called by asyncio for the buffer of received bytes."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """Called by asyncio when bytes arrived."""
        self._receive(self._buffer[:nbytes].tobytes())

    def connection_lost(self, exc: Exception | None) -> None:
        """Called by asyncio when the connection ended."""
        self._lose(self._why(exc) if isinstance(exc, OSError) else "the other side closed the connection")

    def write(self, item: bytes) -> None:
        """Send bytes."""
        if self._transport is not None:
            self._transport.write(item)

    def write_together(self, item: bytes) -> None:
        """Send bytes together with everything else that is written in this round of the loop: sixteen requests are one
        send, and arrive as one read."""
        if not self._together:
            asyncio.get_running_loop().call_soon(self._flush)
        self._together.append(item)

    def _flush(self) -> None:
        self.write(b"".join(self._together))
        self._together.clear()

    def close(self) -> None:
        """Close the connection at once, without waiting for unsent bytes."""
        if self._transport is not None:
            self._transport.abort()

    def sent(self) -> None:
        """Return None: the system has taken the bytes."""


class DatagramLink(asyncio.DatagramProtocol):
    """Datagrams to one server."""

    def __init__(self, receive: Receive, lose: Lose) -> None:
        self._receive = receive
        self._lose = lose
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by asyncio when the socket is open."""
        # A cast, because the transports of some event loops do not inherit from DatagramTransport.
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Called by asyncio when a datagram arrived."""
        self._receive(data)

    def error_received(self, exc: Exception) -> None:
        """Called by asyncio when the peer reports that its port is closed."""
        self._lose(reason(exc))

    def write(self, item: bytes) -> None:
        """Send one datagram."""
        if self._transport is not None:
            self._transport.sendto(item)

    def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.abort()

    def write_together(self, item: bytes) -> None:
        """Send one datagram: each frame has its own."""
        self.write(item)

    def sent(self) -> None:
        """Return None: the system has taken the bytes."""


class SerialLink:
    """An open serial port. The loop watches its descriptor. Raises PortError on Windows, where a port has none.

    Sending takes time on a serial line: `sent` ends when the last bit is on the wire, as far as the system reports.
    Then a two-wire line is set back to receiving, if RTS or a function of the caller sets its direction.
    """

    def __init__(self, port: SerialPort, receive: Receive, lose: Lose) -> None:
        self.name = port.name
        self._port = port
        self._receive = receive
        self._lose = lose
        self._loop = asyncio.get_running_loop()
        self._unsent = bytearray()
        self._out: asyncio.Event = asyncio.Event()
        self._out.set()
        self._fd = port.fileno()
        self._loop.add_reader(self._fd, self._read)

    def _read(self) -> None:
        try:
            data = os.read(self._fd, CHUNK)
        except BlockingIOError:
            return
        except OSError as error:
            return self._fail(self._port.failure(error))
        if not data:
            return self._fail(self._port.failure())
        self._receive(data)

    def _fail(self, why: str) -> None:
        self.close()
        self._lose(why)

    def pause_reading(self) -> None:
        """Leave received bytes in the buffer of the system."""
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)

    def resume_reading(self) -> None:
        """Receive again, after `pause_reading`."""
        if self._fd >= 0:
            self._loop.add_reader(self._fd, self._read)

    def write(self, item: bytes) -> None:
        """Send bytes, as fast as the system takes them."""
        if self._fd < 0:
            raise PortError(f"{self.name}: the port was closed")
        try:
            self._port.set_direction(sending=True)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None
        self._out.clear()
        self._unsent += item
        self._write_some()
        self._loop.call_later(self._port.takes(len(item)), self._check_sent)

    def _write_some(self) -> None:
        try:
            del self._unsent[: os.write(self._fd, self._unsent)]
        except BlockingIOError:
            pass
        except OSError as error:
            return self._fail(self._port.failure(error))
        if self._unsent:
            self._loop.add_writer(self._fd, self._write_some)
        else:
            self._loop.remove_writer(self._fd)

    def _check_sent(self) -> None:
        """Set the line back to receiving if everything has been sent."""
        if self._fd >= 0:
            with contextlib.suppress(OSError):
                if self._unsent or self._port.waiting():
                    self._loop.call_later(_POLL, self._check_sent)
                    return
            try:
                self._port.set_direction(sending=False)
            except OSError as error:
                self._fail(self._port.failure(error))
            except PortError as error:
                self._fail(str(error))
        self._out.set()

    def write_together(self, item: bytes) -> None:
        """Send bytes: a line has only one request under way."""
        self.write(item)

    async def sent(self) -> None:
        """Wait until everything has been sent."""
        await self._out.wait()

    def close(self) -> None:
        """Close the port."""
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            self._loop.remove_writer(self._fd)
            self._fd = -1
            self._port.close()
        self._out.set()


class Mailbox:
    """An `AsyncPort` over a connection, which calls `put` with received bytes, and `fail` when it ends.

    It receives from the first byte on, and sends after `connected`.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.lost: str | None = None
        """Why the connection ended, or None."""
        self.chunks: deque[bytes] = deque()
        """The bytes that were received and not taken yet."""
        self._waiting = 0
        self._waiter: asyncio.Future[bytes | None] | None = None
        self._until = 0.0  # when the waiter gives up
        self._timer: asyncio.TimerHandle | None = None
        self.loop = asyncio.get_running_loop()

    def connected(
        self, write: Callable[[bytes], None], sent: Callable[[], Awaitable[float | None] | None] = lambda: None
    ) -> None:
        """Send with `write` from now on; `sent` returns an awaitable that ends when bytes are on the wire, or None."""
        self._write = write
        self.sent = sent

    def put(self, data: bytes) -> None:
        """Add received bytes. The connection ends if they are far more than are taken, so that memory is limited."""
        waiter = self._waiter
        if waiter is not None and not self.chunks and not waiter.done():
            waiter.set_result(data)
            return
        if self.lost is not None:
            return
        self._waiting += len(data)
        if self._waiting > _LIMIT:
            self.chunks.clear()
            self.fail(f"more than {_LIMIT} bytes arrived that were not requested")
            return
        self.chunks.append(data)
        self._wake()

    def fail(self, why: str) -> None:
        """Record the end of the connection: `receive` raises PortError after the bytes received before."""
        self.lost = self.lost or why
        self._wake()
        self._disarm()

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def _arm(self, until: float) -> None:
        """Set the timer of the task that waits. A timer that ends earlier stays, and is set again when it ends, so that
        it is not cancelled and set for each of a thousand requests that are answered in time."""
        self._until = until
        # One whose time is over was interrupted as it ended, and will not end again.
        if self._timer is None or not self.loop.time() < self._timer.when() <= until:
            self._disarm()
            self._timer = self.loop.call_at(until, self._time_out)

    def _disarm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _time_out(self) -> None:
        self._timer = None
        if self._waiter is None:
            return
        if self.loop.time() >= self._until:
            self._wake()
        else:
            self._arm(self._until)

    def write(self, item: bytes) -> None:
        """Send bytes. Raises PortError if the connection has ended."""
        if self.lost is not None:
            raise PortError(f"{self.name}: {self.lost}")
        self._write(item)

    def take(self) -> bytes | None:
        """Return bytes that were received already, or None. Raises PortError if there are none and the connection has
        ended."""
        if self.chunks:
            data = self.chunks.popleft()
            self._waiting -= len(data)
            return data
        if self.lost is not None:
            raise PortError(f"{self.name}: {self.lost}")
        return None

    async def receive(self, timeout: float) -> bytes | None:
        """Return received bytes, or None after `timeout` seconds. Raises PortError if the connection has ended."""
        for _ in range(2 if timeout <= 0 and not self.chunks else 0):
            await asyncio.sleep(0)  # the first round lets the loop read its ports, the second delivers
        if self.chunks or self.lost is not None or timeout <= 0:
            return self.take()
        waiter = self._waiter = self.loop.create_future()
        self._arm(self.loop.time() + timeout)
        try:
            data = await waiter
        except asyncio.CancelledError:
            if waiter.done() and not waiter.cancelled() and (given := waiter.result()) is not None:
                self.chunks.appendleft(given)  # for the next task: this one was cancelled when the bytes arrived
                self._waiting += len(given)
            raise
        finally:
            self._waiter = None
        return self.take() if data is None else data
