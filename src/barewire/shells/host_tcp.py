"""A Modbus TCP server without asyncio: one thread, one look at all sockets, and whoever spoke is answered.

    select  ->  recv  ->  Server.feed  ->  send          and the next one that spoke
                                 '-> not all of it was taken: what is left goes first, and until then nobody listens

Where connections are few this answers sooner than an event loop does, and a small machine need not load one. The limits
are those of `guests`. Nobody waits for anybody else: no call here waits but the one look, and a peer that sends without
end has one read at a time, like all others.
"""

from __future__ import annotations

import contextlib
import errno
import selectors
import socket
import time
from collections.abc import Mapping

from barewire.modbus.serve import Server
from barewire.shells.carriers import modbus_line
from barewire.shells.guests import Guests
from barewire.shells.host import LOOK, Host
from barewire.shells.tcp_socket import CHUNK, attend, listen, reason

TYPE_CHECKING = False  # see `barewire.record`
if TYPE_CHECKING:
    import threading

    from barewire.modbus import Unit
    from barewire.shells.endpoint import Endpoint
    from barewire.shells.faulty import Spoiler

_FULL = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
"""What the system says when it has no room for another connection."""


class TcpHost(Host):
    """A server on a TCP port. `guests` are its connections; `spoil`, if there is one, says what becomes of answers."""

    def __init__(self, endpoint: Endpoint, units: Mapping[int, Unit]) -> None:
        super().__init__()
        self.guests: Guests[_Connection] = Guests(endpoint)
        self.spoil: Spoiler | None = None
        self.endpoint = endpoint
        self.units = units
        modbus_line(endpoint, "server", units)  # what is wrong with the URL is told here
        self._listener, self.url = listen(endpoint)
        self._listener.setblocking(False)

    def run(self, stop: threading.Event) -> None:
        """Serve until `stop` is set."""
        clock = time.monotonic
        with self._listener, selectors.DefaultSelector() as selector:
            selector.register(self._listener, selectors.EVENT_READ, None)
            try:
                now = clock()
                while not stop.is_set():
                    found = selector.select(self._patience(now))
                    now = clock()
                    for key, _ in found:
                        if key.data is None:
                            self._take_new(selector, now)
                        else:
                            key.data.ready(now)
            finally:
                for connection in list(self.guests.connections):
                    connection.abort()

    def close(self) -> None:
        """Stop serving and wait until the port is given back; also of a host that nobody started."""
        super().close()
        self._listener.close()

    def _patience(self, now: float) -> float:
        """How long may be waited for somebody to speak; what is due is done first."""
        if not self.guests.idle and self.spoil is None:
            return LOOK
        until = now + LOOK
        if (silent_at := self.guests.watch(now)) is not None:
            until = min(until, silent_at)
        if self.spoil is not None:
            self.spoil.deliver()
            until = min(until, self.spoil.due or until)
        return max(0.0, until - now)

    def _take_new(self, selector: selectors.BaseSelector, now: float) -> None:
        """One at a time: to ask whether there is another one takes a file too, where there may be none left."""
        try:
            found, address = self._listener.accept()
        except OSError as error:
            if error.errno in _FULL:
                self._make_room(reason(error))
            return
        found.setblocking(False)
        with contextlib.suppress(OSError):
            attend(found)
        self.guests.arrived(_Connection(self, selector, found, address), now)

    def _make_room(self, why: str) -> None:
        if self.guests.connections:
            self.guests.make_room(f"there was no room for another connection: {why}")
        else:
            time.sleep(LOOK)  # somebody else has it all: try again, but not a million times a second


class _Connection:
    """One client: its own line, the units of all."""

    was_answered = False

    def __init__(
        self, host: TcpHost, selector: selectors.BaseSelector, connection: socket.socket, address: tuple[str, int]
    ) -> None:
        self.peer = f"{address[0]}:{address[1]}"
        self._host = host
        self._socket = connection
        self._selector = selector
        self._line = modbus_line(host.endpoint, "server", host.units)
        self._server = Server(self._line, host.units, serial=False)
        self._unsent = b""
        self._ending = False  # as soon as everything is sent
        selector.register(connection, selectors.EVENT_READ, self)

    def ready(self, now: float) -> None:
        """It has spoken; or it takes again what it did not take before."""
        if self._socket.fileno() < 0:
            return  # closed while others of the same look were served
        if self._unsent:
            self._send(b"")
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
        self._host.guests.heard(self, now)
        replies = self._server.feed(data, now)
        if replies:
            self.was_answered = True
            if self._host.spoil is not None:
                for reply in replies:
                    self._host.spoil(reply.data, self._send)
            else:
                # The answers to all that came in one read leave in one send.
                self._send(replies[0].data if len(replies) == 1 else b"".join([reply.data for reply in replies]))
        if self._line.broken is not None:
            self._hang_up(str(self._line.broken))

    def _send(self, data: bytes) -> None:
        """As much as is taken now. The rest waits, and until it is gone nobody listens to this client."""
        waited = len(self._unsent)
        try:
            taken = self._socket.send(self._unsent + data if waited else data)
        except (BlockingIOError, InterruptedError):
            taken = 0
        except OSError:
            self.abort()  # it is gone, or was closed by us while an answer was late
            return
        if taken == len(data) and not waited:
            return
        self._unsent = (self._unsent + data)[taken:]
        if self._unsent and not waited:
            self._selector.modify(self._socket, selectors.EVENT_WRITE, self)
        elif waited and not self._unsent:
            self._selector.modify(self._socket, selectors.EVENT_READ, self)
        if self._ending and not self._unsent:
            self.abort()

    def _hang_up(self, why: str) -> None:
        """Nobody knows any more where a frame begins: the only honest answer is to close, after what is to be sent."""
        self._host.guests.turned_away.append(f"{self.peer}: {why}")
        self._ending = True
        if not self._unsent:
            self.abort()

    @property
    def unsent(self) -> int:
        """The bytes that the client has not taken yet."""
        return len(self._unsent)

    def abort(self) -> None:
        """Hang up at once."""
        self._host.guests.left(self)
        if self._socket.fileno() >= 0:
            self._selector.unregister(self._socket)
            self._socket.close()
