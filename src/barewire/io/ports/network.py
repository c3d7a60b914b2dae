"""TCP and UDP as blocking ports, and functions for all sockets. Every failure is a PortError of one line."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
import struct
import sys
from collections.abc import Callable
from typing import Any

from barewire.errors import PortError
from barewire.io.endpoint import Endpoint

CHUNK = 4096
"""Bytes that one read takes at most."""
CONNECT_TIMEOUT = 5.0
"""Seconds after which an attempt to connect is given up."""
LONGEST_WAIT = 3600.0
"""Seconds of the longest single wait: the system calls have no value for an endless one."""
CONNECTIONS = 1024
"""Connections of a server at a time, unless the endpoint has `connections=`; and how many may wait to be accepted."""
_UNACKNOWLEDGED = 10_000
"""Milliseconds that bytes may go unacknowledged before the system ends the connection, where it has such an option."""
_DONT_WAIT = getattr(socket, "MSG_DONTWAIT", 0)
"""The flag of a call that must not wait on a blocking socket. Windows has none: there the sockets never block."""


def dialer(endpoint: Endpoint) -> Callable[[], TcpPort | UdpPort]:
    """Return the function that opens the port of an endpoint."""
    kind = UdpPort if endpoint.is_datagram else TcpPort
    host, port = endpoint.host_and_port
    return lambda: kind(host, port)


class TcpPort:
    """A connection to a server. Small frames are sent at once (TCP_NODELAY), dead peers are detected (SO_KEEPALIVE)."""

    def __init__(self, host: str, port: int, *, timeout: float = CONNECT_TIMEOUT) -> None:
        self.name = place_of(host, port)
        self._is_closed = False
        self._socket = self._connect(host, port, timeout)
        self._socket.setblocking(False)
        self._is_ready = readiness(self._socket)
        self._latest_timeout = 0.0
        self._system_timeout = 0.0  # the time-out that the system applies to `recv`; 0: none, and `poll` waits

    def _connect(self, host: str, port: int, timeout: float) -> socket.socket:
        try:
            # As bytes if possible: for text Python loads the codec of domain names, and `re` with it.
            name = host.encode() if host.isascii() else host
            connection = socket.create_connection((name, port), timeout)  # type: ignore[arg-type]  # accepted
        except TimeoutError:
            raise PortError(f"{self.name}: no connection within {timeout:g} s") from None
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None
        set_socket_options(connection)
        return connection

    def send(self, item: bytes) -> None:
        """Send bytes. The system nearly always takes them at once."""
        try:
            sent = self._socket.send(item, _DONT_WAIT)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            raise PortError(f"{self.name}: {self._why(error)}") from None
        if sent < len(item):
            self._send_slowly(item[sent:])

    def _send_slowly(self, rest: bytes) -> None:
        """Send the rest to a peer that does not read. Raises PortError after `CONNECT_TIMEOUT` seconds."""
        before = self._socket.gettimeout()
        try:
            self._socket.settimeout(CONNECT_TIMEOUT)
            self._socket.sendall(rest)
            self._socket.settimeout(before)
        except OSError as error:
            raise PortError(f"{self.name}: {self._why(error)}") from None

    def receive(self, timeout: float) -> bytes | None:
        """Return received bytes, or None after `timeout` seconds. Raises PortError after the peer closed."""
        try:
            if timeout == self._system_timeout and timeout:
                data = self._socket.recv(CHUNK)
            else:
                if timeout and timeout == self._latest_timeout:  # a client that waits the same for each response
                    self._give_to_system(timeout)
                self._latest_timeout = timeout or self._latest_timeout
                if not self._is_ready(timeout):
                    return None
                data = self._socket.recv(CHUNK, _DONT_WAIT)
        except BlockingIOError:
            return None  # the system's time-out, or `poll` reported bytes that were no good: a wrong checksum
        except (OSError, ValueError) as error:
            raise PortError(f"{self.name}: {self._why(error)}") from None
        if not data:
            raise PortError(f"{self.name}: {self._why()}")
        return data

    def _give_to_system(self, timeout: float) -> None:
        """Set this time-out as that of the socket itself, so that waiting is one call instead of two from now on."""
        # Below a millisecond it could be rounded to 0, which the system takes for "no time-out".
        if not _DONT_WAIT or not 1e-3 <= timeout < LONGEST_WAIT:
            return
        with contextlib.suppress(OSError):  # on systems with another `struct timeval`
            timeval = struct.pack("@ll", int(timeout), int(timeout % 1.0 * 1e6))
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeval)
            self._socket.setblocking(True)
            self._system_timeout = timeout

    def _why(self, error: Exception | None = None) -> str:
        if self._is_closed:
            return "the port was closed"
        return "the other side closed the connection" if error is None else reason(error)

    def close(self) -> None:
        """Close the connection. A thread that waits for bytes gets a PortError."""
        self._is_closed = True
        close_and_wake(self._socket)


class UdpPort:
    """Datagrams to one server, and only from it."""

    def __init__(self, host: str, port: int) -> None:
        self.name = place_of(host, port)
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind, protocol)
            try:
                self._socket.connect(address)
            except BaseException:
                self._socket.close()
                raise
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None
        self._is_ready = readiness(self._socket)
        self._is_closed = False

    def send(self, item: bytes) -> None:
        """Send one datagram."""
        try:
            self._socket.send(item)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None

    def receive(self, timeout: float) -> bytes | None:
        """Return the next datagram, or None after `timeout` seconds. Raises PortError if the peer's port is closed."""
        try:
            data = self._socket.recv(CHUNK) if self._is_ready(timeout) else None
        except (OSError, ValueError) as error:
            raise PortError(f"{self.name}: {reason(error)}") from None
        if self._is_closed:
            raise PortError(f"{self.name}: the port was closed")
        return data

    def close(self) -> None:
        """Close the socket. A thread that waits for a datagram gets a PortError."""
        self._is_closed = True
        close_and_wake(self._socket)


def close_and_wake(connection: socket.socket) -> None:
    """Close a socket for which other threads may wait: `close` alone would leave them waiting."""
    with contextlib.suppress(OSError):  # it has ended already
        socket.socket.shutdown(connection, socket.SHUT_RDWR)  # of TLS too the socket, under what a thread reads now
    connection.close()


def readiness(*files: socket.socket | int, room_in: int | None = None) -> Callable[[float], object]:
    """Return a function that waits for so many seconds until there are bytes to read, or room in `room_in`, and returns
    whether there are.

    It uses `poll` if the system has it: `poll` is faster than `select`, which also fails for files above number 1023.
    The `poll` of macOS does not know terminals, whose descriptors are passed by number.
    """
    writes = [] if room_in is None else [room_in]
    if not hasattr(select, "poll") or (
        sys.platform == "darwin" and any(isinstance(file, int) for file in (*files, *writes))
    ):
        return lambda timeout: any(select.select(files, writes, [], min(timeout, LONGEST_WAIT)))  # pragma: no cover
    watched = select.poll()
    for file in files:
        watched.register(file, select.POLLIN)
    for number in writes:
        watched.register(number, select.POLLOUT)
    poll = watched.poll
    return lambda timeout: poll(1e3 * min(timeout, LONGEST_WAIT) if timeout else 0)


def listening_socket(endpoint: Endpoint) -> tuple[socket.socket, str]:
    """Open the socket of a server; return it, and the URL for clients. Port 0 takes a free port.

    Raises PortError for a port that cannot be opened.
    """
    host, port = endpoint.host_and_port
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        if endpoint.is_datagram:
            listener = socket.socket(family, socket.SOCK_DGRAM)
            try:
                listener.bind((host, port))
            except BaseException:
                listener.close()
                raise
        else:
            listener = socket.create_server((host, port), family=family, backlog=CONNECTIONS)
    except OSError as error:
        raise PortError(f"{place_of(host, port)}: {reason(error)}") from None
    return listener, str(endpoint._replace(place=place_of(host, listener.getsockname()[1])))


def is_own_address(own: Any, sender: Any) -> bool:
    """Return whether `sender` is the address of the socket that is bound to `own`. One that is bound to all addresses
    of this machine has each of them, with its port."""
    if sender[1] != own[1] or own[0] not in ("0.0.0.0", "::"):
        return bool(sender[:2] == own[:2])
    with socket.socket(socket.AF_INET6 if ":" in own[0] else socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((sender[0], 0, *sender[2:]))  # the system binds to addresses of this machine only
        except OSError:
            return False
    return True


def place_of(host: str, port: int) -> str:
    """Return HOST:PORT as in a URL, where an address of IPv6 has brackets."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def set_socket_options(connection: socket.socket) -> None:
    """Send small frames at once, and end connections whose peer does not acknowledge."""
    # Some systems refuse options once the peer has left. That is not an error here: the next read reports it.
    with contextlib.suppress(OSError):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNACKNOWLEDGED)


UNPLUGGED = {errno.EIO, errno.ENODEV, errno.ENXIO}
"""The errors of the system for a device that was open and is not there any more."""


def reason(error: Exception) -> str:
    """Return the system's text of an error, in lower case and without its number: 'connection refused'."""
    if isinstance(error, ValueError) or (isinstance(error, OSError) and error.errno == errno.EBADF):
        return "the port was closed"  # a descriptor of -1: another thread closed it meanwhile
    text = (error.strerror if isinstance(error, OSError) else "") or str(error) or type(error).__name__
    # asyncio writes the address into the text, in words that change between versions: the system's own text instead.
    if isinstance(error, ConnectionError) or "while attempting to bind" in text:
        text = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else text
    elif text.startswith("could not bind on any address"):  # from 3.13 on, without a number
        text = os.strerror(errno.EADDRNOTAVAIL)
    return text[:1].lower() + text[1:]
