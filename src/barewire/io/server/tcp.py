"""A Modbus TCP server without asyncio: one thread, one look at all sockets, and whoever spoke is answered.

    watch   ->  recv  ->  Server.feed  ->  send          and the next one that spoke
                                 '-> not all of it was taken: what is left goes first, and until then nobody listens

This answers sooner than an event loop does, and a small machine need not load one. The limits are those of `guests`.
Nobody waits for anybody else: no call here waits but the one look, and a peer that sends without end has one read at a
time, like all others.
"""

from __future__ import annotations

import contextlib
import errno
import socket
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING

from barewire.io.modbus.carriers import modbus_line
from barewire.io.ports.readiness import IN, OUT, most, watch
from barewire.io.ports.tcp import CHUNK, attend, listen, reason
from barewire.io.server.connection_limits import ConnectionTable, say_all
from barewire.io.server.open import LOOK, Host
from barewire.modbus.server.server import Server

if TYPE_CHECKING:
    import threading

    from barewire.io.endpoint import Endpoint
    from barewire.io.fault_injection.ports import FaultInjector
    from barewire.io.ports.readiness import Watch
    from barewire.modbus import Unit

_FULL = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
"""What the system says when it has no room for another connection."""


class TcpHost(Host):
    """A server on a TCP port. `guests` are its connections; `spoil`, if there is one, says what becomes of answers."""

    def __init__(self, endpoint: Endpoint, units: Mapping[int, Unit]) -> None:
        super().__init__()
        self.guests: ConnectionTable[_Connection] = ConnectionTable(endpoint)
        self.guests.most = most(self.guests.most)
        self.by_file: dict[int, _Connection] = {}
        self.spoil: FaultInjector | None = None
        self.endpoint = endpoint
        self.units = units
        modbus_line(endpoint, "server", units)  # what is wrong with the URL is told here
        self._listener, self.url = listen(endpoint)
        self._listener.setblocking(False)

    def _serve(self, stop: threading.Event) -> None:
        clock = time.monotonic
        listener = self._listener.fileno()
        with contextlib.closing(watch()) as watching:
            watching.register(listener, IN)
            try:
                now = clock()
                while not self.is_over(stop):
                    found = watching.poll(self._patience(now))
                    now = clock()
                    for file, _ in found:
                        if file == listener:
                            self._take_new(watching, now)
                        elif (connection := self.by_file.get(file)) is not None:
                            try:
                                connection.ready(now)
                            except Exception as error:
                                # Of a user's code: units that are looked up, whoever is told of a fault.
                                self.guests.turn_away(connection, f"{type(error).__name__}: {error}")
            finally:
                for connection in list(self.guests.connections):
                    connection.abort()

    def _give_back(self) -> None:
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

    def _take_new(self, watching: Watch, now: float) -> None:
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
        self.guests.arrived(_Connection(self, watching, found, address), now)

    def _make_room(self, why: str) -> None:
        if self.guests.connections:
            self.guests.make_room(f"there was no room for another connection: {why}")
        else:
            time.sleep(LOOK)  # somebody else has it all: try again, but not a million times a second


class _Connection:
    """One client: its own line, the units of all."""

    was_answered = False

    def __init__(self, host: TcpHost, watching: Watch, connection: socket.socket, address: tuple[str, int]) -> None:
        self.peer = f"{address[0]}:{address[1]}"
        self._host = host
        self._socket = connection
        self._file = connection.fileno()
        self._watching = watching
        self._line = modbus_line(host.endpoint, "server", host.units)
        self._server = Server(self._line, host.units, serial=False)
        self._unsent = bytearray()
        self._ending = False  # as soon as everything is sent
        watching.register(self._file, IN)
        host.by_file[self._file] = self

    def ready(self, now: float) -> None:
        """It has spoken; or it takes again what it did not take before."""
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
        self._host.guests.heard(self, now)
        replies = self._server.feed(data, now)
        if replies:
            self.was_answered = True
            say_all(replies, self._send, self._host.spoil)
        if self._line.broken is not None:
            self._hang_up(str(self._line.broken))

    def _send(self, data: bytes) -> None:
        """As much as is taken now. The rest waits, and until it is gone nobody listens to this client."""
        if self._unsent:
            self._unsent += data  # late answers may come while others wait
        elif (taken := self._taken(data)) < len(data):
            self._unsent += data[taken:]
            self._watching.modify(self._file, OUT)

    def _send_rest(self) -> None:
        del self._unsent[: self._taken(self._unsent)]
        if self._unsent:
            return
        if self._ending:
            self.abort()
        elif self._socket.fileno() >= 0:
            self._watching.modify(self._file, IN)

    def _taken(self, data: bytes | bytearray) -> int:
        """How many bytes the system takes now: all of them, if nobody is there any more."""
        try:
            return self._socket.send(data)
        except (BlockingIOError, InterruptedError):
            return 0
        except OSError:
            self.abort()  # it is gone, or was closed by us while an answer was late
            return len(data)

    def _hang_up(self, why: str) -> None:
        """Nobody knows any more where a frame begins: the only honest answer is to close, after what is to be sent."""
        self._host.guests.note(self, why)
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
        self._unsent.clear()
        if self._socket.fileno() >= 0:
            self._watching.unregister(self._file)
            del self._host.by_file[self._file]
            self._socket.close()
