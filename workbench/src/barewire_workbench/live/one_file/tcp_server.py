"""The server on TCP: one thread waits for all connections, and answers those that are readable."""

from __future__ import annotations

import selectors
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from time import monotonic

from barewire.errors import PortError
from barewire.io.ports.network import CHUNK, place_of, reason, set_socket_options
from barewire.modbus.server.server import Server, ServerStatistics, Unit
from barewire.tcp.line import TcpLine

_POLL_INTERVAL = 0.1
"""Seconds after which `serve` looks whether it is over."""


class ModbusTcpServer:
    """Units on a TCP port; port 0 takes a free one, which is then in `port`.

    units          by address: a `Table`, or an object of your own, see `Unit`; 255 or 0 answers for all others
    connections    how many clients may be connected (default 32); one that is too many ends the longest silent one

    `statistics` has the numbers of requests, exceptions and connections, and the latest errors in the code of units.
    """

    def __init__(self, host: str, port: int, units: Mapping[int, Unit], *, connections: int = 32) -> None:
        self.units = units
        self.statistics = ServerStatistics()
        self._limit = connections
        self._open: dict[_Connection, float] = {}  # when each was heard last, the longest silent first
        try:
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            self._listener = socket.create_server((host, port), family=family)
        except OSError as error:
            raise PortError(f"{place_of(host, port)}: {reason(error)}") from None
        self._listener.setblocking(False)
        self.port = int(self._listener.getsockname()[1])
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)

    def serve(self, is_over: Callable[[], bool] = lambda: False) -> None:
        """Serve until `is_over()`; without it, until an exception."""
        while not is_over():
            for key, _ in self._selector.select(_POLL_INTERVAL):
                connection: _Connection | None = key.data
                if connection is None:
                    self._accept()
                elif connection in self._open:  # not closed meanwhile
                    self._open[connection] = self._open.pop(connection)
                    if not connection.ready(monotonic()):
                        self._end(connection)
                    else:
                        self._selector.modify(connection.socket, connection.events, connection)

    def _accept(self) -> None:
        with suppress(OSError):  # the client has gone, or the system has no file left: it asks again
            client, _ = self._listener.accept()
            while len(self._open) >= self._limit:
                self._end(next(iter(self._open)))
            connection = _Connection(client, Server(TcpLine(), self.units, serial=False, statistics=self.statistics))
            self._open[connection] = monotonic()
            self._selector.register(client, connection.events, connection)

    def _end(self, connection: _Connection) -> None:
        del self._open[connection]
        self._selector.unregister(connection.socket)
        connection.socket.close()

    def close(self) -> None:
        """Close the port and all connections."""
        for connection in tuple(self._open):
            self._end(connection)
        self._selector.close()
        self._listener.close()


class _Connection:
    """One client: while an answer is not sent completely, nothing more is read from it."""

    def __init__(self, client: socket.socket, server: Server) -> None:
        self.socket = client
        self.server = server
        self._unsent = b""
        client.setblocking(False)
        set_socket_options(client)

    @property
    def events(self) -> int:
        """What to wait for."""
        return selectors.EVENT_WRITE if self._unsent else selectors.EVENT_READ

    def ready(self, now: float) -> bool:
        """Send the rest of an answer, or read and answer. Return whether the connection goes on."""
        try:
            if not self._unsent:
                data = self.socket.recv(CHUNK)
                if not data:
                    return False
                self._unsent = b"".join(reply.data for reply in self.server.feed(data, now))
            self._unsent = self._unsent[self.socket.send(self._unsent) :] if self._unsent else b""
        except BlockingIOError:
            return True
        except OSError:
            return False
        return self.server.line.broken is None or bool(self._unsent)
