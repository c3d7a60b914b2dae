"""TCP connections and UDP as blocking ports. Connecting, refusing and hanging up become one-line errors."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
from collections.abc import Callable

from barewire.errors import PortError
from barewire.io.endpoint import Endpoint

CHUNK = 4096
CONNECT = 5.0
"""Seconds until a connection that does not come about is given up."""
LONGEST_WAIT = 3600.0
"""Seconds that are waited at once: endless is not a number for the system."""
CONNECTIONS = 1024
"""How many connections a server has at a time, and how many may wait to be taken, where nobody says otherwise."""
UNHEARD = 10_000
"""Milliseconds that bytes may go unacknowledged before the system calls the connection dead, where it can be told."""
AT_ONCE = getattr(socket, "MSG_DONTWAIT", 0)
"""The flag of a call that must not wait, on a socket that may. Windows has none: there no socket of ours may wait."""


class TcpPort:
    """A connection to a server. Small frames leave at once (TCP_NODELAY), dead peers are found (SO_KEEPALIVE)."""

    def __init__(self, host: str, port: int, *, timeout: float = CONNECT) -> None:
        self.name = f"{host}:{port}"
        self._socket = self._connect(host, port, timeout)
        self._socket.setblocking(False)
        self._is_ready = readiness(self._socket)
        self._waited = self._limit = 0.0

    def _connect(self, host: str, port: int, timeout: float) -> socket.socket:
        try:
            # As bytes, where that is possible: for text the system's codec of names is loaded, and `re` with it.
            name = host.encode() if host.isascii() else host
            connection = socket.create_connection((name, port), timeout)  # type: ignore[arg-type]  # they are taken
        except TimeoutError:
            raise PortError(f"{self.name}: no connection within {timeout:g} s") from None
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None
        attend(connection)
        return connection

    def send(self, item: bytes) -> None:
        """Hand the bytes to the system, which nearly always takes them at once."""
        try:
            taken = self._socket.send(item, AT_ONCE)
        except BlockingIOError:
            taken = 0
        except OSError as error:
            raise PortError(f"{self.name}: {self._why(error)}") from None
        if taken < len(item):
            self._press(item[taken:])

    def _press(self, rest: bytes) -> None:
        """The other side does not read: it is given some time to."""
        before = self._socket.gettimeout()
        try:
            self._socket.settimeout(CONNECT)
            self._socket.sendall(rest)
            self._socket.settimeout(before)
        except OSError as error:
            raise PortError(f"{self.name}: {self._why(error)}") from None

    def receive(self, timeout: float) -> bytes | None:
        """What came within `timeout` seconds; PortError when the other side hung up."""
        try:
            if timeout == self._limit and timeout:
                data = self._socket.recv(CHUNK)
            else:
                if timeout and timeout == self._waited:
                    self._keep(timeout)
                self._waited = timeout or self._waited
                if not self._is_ready(timeout):
                    return None
                data = self._socket.recv(CHUNK, AT_ONCE)
        except BlockingIOError:
            return None  # nothing within the limit; or it was said to be there, and was not
        except (OSError, ValueError) as error:
            raise PortError(f"{self.name}: {self._why(error)}") from None
        if not data:
            raise PortError(f"{self.name}: the other side closed the connection")
        return data

    def _keep(self, timeout: float) -> None:
        """The same time-out again: from now on the system keeps it, so waiting that long is one call and not two."""
        if not AT_ONCE or not 1e-3 <= timeout < LONGEST_WAIT:
            return
        with contextlib.suppress(OSError):  # where it wants another form of time
            limit = struct.pack("@ll", int(timeout), int(timeout % 1.0 * 1e6))
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)
            self._socket.setblocking(True)
            self._limit = timeout

    def _why(self, error: Exception) -> str:
        return "the port was closed" if self._socket.fileno() < 0 else reason(error)

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


class UdpPort:
    """Datagrams to one server and from nobody else."""

    def __init__(self, host: str, port: int) -> None:
        self.name = f"{host}:{port}"
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind, protocol)
            self._socket.connect(address)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None

    def send(self, item: bytes) -> None:
        """One datagram."""
        try:
            self._socket.send(item)
        except OSError as error:
            raise PortError(f"{self.name}: {reason(error)}") from None

    def receive(self, timeout: float) -> bytes | None:
        """The next datagram within `timeout` seconds; PortError when the other machine says that nobody is there."""
        try:
            ready, _, _ = select.select([self._socket], [], [], min(timeout, 3600.0))
            return self._socket.recv(CHUNK) if ready else None
        except (OSError, ValueError) as error:
            raise PortError(f"{self.name}: {reason(error)}") from None

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()


def readiness(connection: socket.socket) -> Callable[[float], object]:
    """What waits for so many seconds until there is something to read, and says whether there is.

    `poll` where the system has it: it is quicker than `select`, and `select` cannot watch files above number 1023.
    """
    if not hasattr(select, "poll"):  # pragma: no cover - Windows
        return lambda timeout: select.select([connection], [], [], min(timeout, LONGEST_WAIT))[0]
    watched = select.poll()
    watched.register(connection, select.POLLIN)
    poll = watched.poll
    return lambda timeout: poll(1e3 * min(timeout, LONGEST_WAIT) if timeout else 0)


def listen(endpoint: Endpoint) -> tuple[socket.socket, str]:
    """The socket of a server at this endpoint, and the URL that clients use: port 0 takes a free one.

    Raises PortError for a port that cannot be had.
    """
    host, port = endpoint.host_and_port
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        if endpoint.scheme == "udp":
            listener = socket.socket(family, socket.SOCK_DGRAM)
            try:
                listener.bind((host, port))
            except BaseException:
                listener.close()
                raise
        else:
            listener = socket.create_server((host, port), family=family, backlog=CONNECTIONS)
    except OSError as error:
        raise PortError(f"{host}:{port}: {reason(error)}") from None
    shown = f"[{host}]" if ":" in host else host
    return listener, str(endpoint._replace(place=f"{shown}:{listener.getsockname()[1]}"))


def attend(connection: socket.socket) -> None:
    """Small frames leave at once; a peer that is gone without a word is noticed."""
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        with contextlib.suppress(OSError):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNHEARD)


def reason(error: Exception) -> str:
    """What the system says, in lower case and without its number: 'connection refused'."""
    if isinstance(error, ValueError):
        return "the port was closed"  # a descriptor of -1: another thread closed it meanwhile
    if isinstance(error, ConnectionError) and error.errno:
        error = OSError(error.errno, os.strerror(error.errno))  # asyncio has words of its own
    text = (error.strerror if isinstance(error, OSError) else "") or str(error) or type(error).__name__
    text = text.partition(" (while attempting")[0]  # Python's own, with the address that is told already
    return text[:1].lower() + text[1:]
