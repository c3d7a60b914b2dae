"""A Modbus TCP server without asyncio: one thread waits for all sockets and answers those that are readable.

    select ->  recv  ->  answer  ->  send          and the next readable socket
                                '-> not all of it was taken: the rest is sent first, and until then nothing is read

It answers sooner than an event loop does, and a small machine need not load one. Clients do not delay each other: only
the select waits, and a client that sends without end is read once in each round.
"""

from __future__ import annotations

import selectors
import socket
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from barewire.io.ports.network import CHUNK, listening_socket, place_of
from barewire.io.server.base import POLL_INTERVAL, ends_program
from barewire.io.server.limits import Acceptor, End
from barewire.io.server.units import UnitsConnection, UnitsServer

if TYPE_CHECKING:
    from barewire.io.endpoint import Endpoint
    from barewire.io.fault_injection.ports import FaultInjector
    from barewire.modbus import AnyUnit

_SELECT_LIMIT = 500
"""Connections where the system has nothing but `select`, which fails with more than 512 sockets."""


class TcpService(UnitsServer):
    """A server of units on a TCP port. `injector` puts faults into the answers."""

    def __init__(self, endpoint: Endpoint, units: Mapping[int, AnyUnit], injector: FaultInjector | None = None) -> None:
        super().__init__(endpoint, units, injector)
        self._injector = injector
        if issubclass(selectors.DefaultSelector, selectors.SelectSelector):
            self.connections.lower_limit(_SELECT_LIMIT, "the system has only `select`")
        self._listener, self.url = listening_socket(endpoint)

    def serve(self, is_over: Callable[[], bool]) -> None:
        """Serve until `is_over()`."""
        clock = time.monotonic
        self.log.serving(self.url, self.units)
        with selectors.DefaultSelector() as selector:
            acceptor = Acceptor(self._listener, self.connections)
            selector.register(self._listener, selectors.EVENT_READ)
            try:
                now = clock()
                while not is_over():
                    ready = selector.select(self._wait(now))
                    now = clock()
                    for key, _ in ready:
                        connection: _Connection | None = key.data
                        if connection is None:
                            self._accept(acceptor, selector, now)
                        elif connection in self.connections.open:  # not closed meanwhile
                            try:
                                connection.ready(now)
                            except BaseException as error:
                                # Raised by the caller's code: a look-up of units, a callback for faults.
                                if ends_program(error):
                                    raise
                                self.connections.close(connection, f"{type(error).__name__}: {error}", "broken")
            finally:
                self.connections.close_all()
                self.log.stopped()

    def close(self) -> None:
        """Release the port."""
        self._listener.close()

    def _wait(self, now: float) -> float:
        """Carry out the actions that are due; return the seconds that `select` may wait."""
        if not self.connections.idle_timeout and self._injector is None:
            return POLL_INTERVAL
        until = now + POLL_INTERVAL
        if (idle_at := self.connections.close_idle(now)) is not None:
            until = min(until, idle_at)
        if self._injector is not None:
            self._injector.deliver()
            until = min(until, self._injector.due or until)
        return max(0.0, until - now)

    def _accept(self, acceptor: Acceptor, selector: selectors.BaseSelector, now: float) -> None:
        try:
            accepted = acceptor.accept()
        except OSError as error:
            time.sleep(acceptor.failed(error))  # it is not zero only if there is no connection to serve
            return
        for connection, address in accepted:
            self.connections.add(_Connection(self, selector, connection, address), now)


class _Connection(UnitsConnection):
    """The connection of one client, with a socket that does not block."""

    def __init__(
        self, service: TcpService, selector: selectors.BaseSelector, connection: socket.socket, address: tuple[str, int]
    ) -> None:
        super().__init__(service)
        self.peer = place_of(address[0], address[1])
        self._watch = service.log.watch(self.peer)
        self._socket = connection
        self._selector = selector
        self._unsent = bytearray()
        self._ending = False  # it closes when everything is sent
        selector.register(connection, selectors.EVENT_READ, self)

    def ready(self, now: float) -> None:
        """Read and answer, or send the rest of an answer. Called when the socket is ready for that."""
        if self._unsent:
            self._send_rest()
            return
        try:
            data = self._socket.recv(CHUNK)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            data = b""
        if not data:
            self.abort()
            return
        self._shared.connections.received(self, now)
        self.answer(data, now)

    def write(self, data: bytes) -> None:
        """Send as much as the system takes now. Nothing is read from this client until the rest is sent."""
        if self._watch is not None:
            self._watch("sent", data)
        if self._unsent:
            self._unsent += data  # an answer that a fault delayed, while others wait
        elif (sent := self._send_some(data)) < len(data):
            self._unsent += data[sent:]
            self._selector.modify(self._socket, selectors.EVENT_WRITE, self)

    def _send_rest(self) -> None:
        del self._unsent[: self._send_some(self._unsent)]
        if self._unsent:
            return
        if self._ending:
            self.abort()
        elif self._socket.fileno() >= 0:
            self._selector.modify(self._socket, selectors.EVENT_READ, self)

    def _send_some(self, data: bytes | bytearray) -> int:
        """Send, and return how many bytes the system took; all of them if the connection has ended."""
        try:
            return self._socket.send(data)
        except (BlockingIOError, InterruptedError):
            return 0
        except OSError:
            self.abort()  # the client closed it, or the server did while an answer was delayed
            return len(data)

    def end(self, why: str, end: End) -> None:
        self._shared.connections.note(self, why, end)
        self._ending = True
        if not self._unsent:
            self.abort()

    @property
    def unsent(self) -> int:
        """How many bytes the client has not read yet."""
        return len(self._unsent)

    def abort(self) -> None:
        """Close the connection at once."""
        self._shared.connections.remove(self)
        self._unsent.clear()
        if self._socket.fileno() >= 0:
            self._selector.unregister(self._socket)
            self._socket.close()
