"""The limits of a server: how many clients may be connected, how long one may be silent, which datagrams are refused.

        connections        A        B        C        D        E
        last request      3.1      0.5      9.7      0.2      4.0
        served before      x        x        x        x
                                             |                 '-- above `limit` connections, the server closes the one
                                             |                     that was silent longest among those that never got
                                             |                     an answer, if there are any; so a client that only
                                             |                     opens connections cannot displace a working one
                                             '-- with `idle_timeout`, the server closes a connection that sent no
                                                 request for that many seconds

Recording a request costs O(1): no order is kept, and the table is searched only when a connection must be closed.
Why each connection ended is counted in the statistics of the server, and logged. Times are passed in.

Datagrams have no connections. The answer to functions 05, 06 and 16h equals its request, and the sender of a datagram
is easily forged: with the address of the server itself, or of another server, one request would go round for ever.

    server A    <--  06 0001 002A  -->    server B        each takes the answer of the other for a request

A client may repeat a request, with the same transaction number too, and nothing in it tells the two apart. But one
datagram that is lost ends the round, and costs a client one time-out. So the same datagram from the same sender,
answered with itself, is answered `COPIES` times and then refused once, if it comes at least every second.
"""

from __future__ import annotations

import errno
import os
import socket
from collections import deque
from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, Any, Generic, Literal, Protocol, TypeVar

from barewire.io.ports.network import CONNECTIONS, readiness, reason, set_socket_options
from barewire.io.server.base import POLL_INTERVAL, server_log
from barewire.modbus.server.server import ServerStatistics

if TYPE_CHECKING:
    from barewire.io.endpoint import Endpoint
    from barewire.io.log import PortLog

End = Literal["left", "refused", "idle", "broken", "stopped"]
"""Why a connection ended: the name of its counter in `ServerStatistics`."""

BATCH = 16
"""Connections that are accepted before the next requests are answered."""
_RESERVE = 32
"""Descriptors kept for the rest of the program, and for a batch that is accepted before others are closed."""
_FULL = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
"""Errors of a system that has no room for another connection."""
COPIES = 1000
"""How often the same datagram of a sender is answered with itself, before one is refused."""
_PAUSE = 1.0
"""Seconds after which a copy counts as the first one: what is as slow does no harm."""
RATE = 20_000
"""Datagrams of one host in a second: more than a client sends that waits for each answer."""
_SENDERS = 1024
"""Hosts and datagrams that are remembered. All other hosts share one limit; the oldest datagram is forgotten."""


class TrackedConnection(Protocol):
    """The methods of a connection that the limits use."""

    peer: str
    was_answered: bool

    @property
    def unsent(self) -> int:
        """How many bytes the client has not read yet."""

    def abort(self) -> None:
        """Close the connection at once."""


C = TypeVar("C", bound=TrackedConnection)


class ConnectionTable(Generic[C]):
    """The connections of one server, with the limits `connections` and `idle` of its endpoint."""

    def __init__(
        self, endpoint: Endpoint, statistics: ServerStatistics | None = None, log: PortLog | None = None
    ) -> None:
        self.statistics = ServerStatistics() if statistics is None else statistics
        self.log = server_log(endpoint) if log is None else log
        self.open: dict[C, float] = {}
        """Each open connection, with the time of its last request."""
        self.closed: deque[str] = deque(maxlen=16)
        """Why the server closed connections: the latest reasons, one line each."""
        self.limit = endpoint.integer("connections", CONNECTIONS)
        # A limit that the user set and the system lowers deserves a warning; that of the default does not.
        self._log_lowered = self.log.warning if "connections" in endpoint.options else self.log.info
        self.idle_timeout = endpoint.seconds("idle", 0.0)
        """Seconds without a request after which a connection is closed; 0 for never."""
        self._ends: dict[C, End] = {}  # why the server is closing a connection
        self._oldest_request = -inf  # no connection sent its last request before this time

    def __len__(self) -> int:
        return len(self.open)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self) or 'none'} open, {len(self.closed)} closed by the server>"

    @property
    def unsent(self) -> int:
        """How many bytes of answers the clients have not read yet."""
        return sum(connection.unsent for connection in list(self.open))  # a copy: any thread may ask

    def lower_limit(self, limit: int, why: str) -> None:
        """Lower the limit, if it is higher, to what the system allows."""
        limit = max(1, limit)
        if limit < self.limit:
            self._log_lowered("limit", f"at most {limit} connections instead of {self.limit}: {why}")
            self.limit = limit

    def add(self, connection: C, now: float) -> None:
        """Record a new connection. If there are too many then, close another one."""
        while len(self.open) >= self.limit:
            self.close_longest_silent(f"unused longest of {self.limit} connections")
        self.open[connection] = now
        self.statistics.opened += 1
        self.log.info("connected", f"{connection.peer} connected, {len(self.open)} in all")

    def received(self, connection: C, now: float) -> None:
        """Record that a connection sent something."""
        self.open[connection] = now

    def remove(self, connection: C) -> None:
        """Remove a connection that ended. Without a reason noted before, the client ended it."""
        if self.open.pop(connection, None) is None:
            return
        end = self._ends.pop(connection, "left")
        setattr(self.statistics, end, getattr(self.statistics, end) + 1)
        if end == "left":
            self.log.info("left", f"{connection.peer} left, {len(self.open)} in all")

    def close_longest_silent(self, why: str) -> None:
        """Close the connection that was silent longest, if possible one that never got an answer."""
        unanswered = [connection for connection in self.open if not connection.was_answered]
        self.close(min(unanswered or self.open, key=self.open.__getitem__), why, "refused")

    def close(self, connection: C, why: str, end: End) -> None:
        """Close a connection and keep the reason."""
        self.note(connection, why, end)
        self.remove(connection)
        connection.abort()

    def note(self, connection: C, why: str, end: End) -> None:
        """Keep the reason for which the server closes a connection."""
        if connection in self.open:
            self._ends[connection] = end
        text = f"{connection.peer}: {why}"
        self.closed.append(text)
        if end == "idle":
            self.log.info(end, f"{text}: closed")
        else:
            self.log.warning(end, f"{text}: closed")

    def close_all(self) -> None:
        """Close all connections, with the server."""
        for connection in list(self.open):
            self._ends[connection] = "stopped"
            self.remove(connection)
            connection.abort()

    def close_idle(self, now: float) -> float | None:
        """Close the connections that were silent too long. Return when to call this again, None if it is not needed."""
        if not self.idle_timeout or not self.open:
            return None
        if now >= self._oldest_request + self.idle_timeout:
            for connection, received_at in list(self.open.items()):
                # Closing one may end others, which are then in the list, but not in the table any more.
                if received_at + self.idle_timeout <= now and connection in self.open:
                    self.close(connection, f"silent for {self.idle_timeout:g} s", "idle")
            self._oldest_request = min(self.open.values(), default=-inf)
        return self._oldest_request + self.idle_timeout if self.open else None


class Acceptor:
    """Accepts the clients of one listener. Its constructor lowers the limit of `connections` if the process has fewer
    descriptors left: the client above the limit needs one too, since it is accepted before another is closed for it."""

    def __init__(self, listener: socket.socket, connections: ConnectionTable[Any]) -> None:
        listener.setblocking(False)
        self._listener = listener
        self._connections = connections
        self._is_ready = readiness(listener)
        free = _free_descriptors(listener)
        if free is not None:
            connections.lower_limit(free - min(_RESERVE, free // 4), f"{free} file descriptors are left")

    def accept(self, *accepted: tuple[socket.socket, Any]) -> list[tuple[socket.socket, Any]]:
        """Accept the clients that wait, `BATCH` with those `accepted` already. Raises OSError if it is none."""
        batch = list(accepted)
        try:
            while len(batch) < BATCH:
                batch.append(self._listener.accept())
        except OSError:
            if not batch:
                raise
        for connection, _ in batch:
            connection.setblocking(False)
            set_socket_options(connection)
        return batch

    def failed(self, error: OSError) -> float:
        """Make room if `accept` found none. Return the seconds to wait before it is tried again."""
        if isinstance(error, (BlockingIOError, InterruptedError, ConnectionError)):
            return 0.0  # no client waits, or it has left again
        why = f"there was no room for another connection: {reason(error)}"
        if error.errno not in _FULL:
            self._connections.log.warning("accept", f"a connection was not accepted: {reason(error)}")
        elif not self._is_ready(0):
            pass  # Linux needs a descriptor to find out that no client waits
        elif self._connections.open:
            self._connections.close_longest_silent(why)
            return 0.0
        else:
            self._connections.log.warning("full", why)
        return POLL_INTERVAL


def _free_descriptors(listener: socket.socket) -> int | None:
    """Return how many files the process may still open; None where there is no such limit, as on Windows."""
    try:
        import resource
    except ImportError:
        return None
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return None
    try:
        used = len(os.listdir("/dev/fd"))
    except OSError:
        used = listener.fileno() + 1  # the system gives the lowest free number
    return max(0, soft - used)


class DatagramLimits:
    """What is remembered of the senders. `is_own(address)` tells whether that is the address of the server."""

    def __init__(self, is_own: Callable[[Any], bool]) -> None:
        self._is_own = is_own
        self._received: dict[str, int] = {}  # by host, until `_until`
        self._until = 0.0
        self._copies: dict[tuple[bytes, Any], tuple[int, float]] = {}  # how many were answered, and when the latest

    def is_too_much(self, host: str, now: float) -> bool:
        """Count a datagram of this host. Return whether it has sent more than `RATE` within a second."""
        if now >= self._until:
            self._received.clear()
            self._until = now + 1.0
        if host not in self._received and len(self._received) >= _SENDERS:
            host = ""  # the limit that all further hosts share: forged addresses cannot fill the memory
        count = self._received[host] = self._received.get(host, 0) + 1
        return count > RATE

    def is_own_answer(self, data: bytes, sender: Any, now: float) -> bool:
        """Return whether this is taken for an answer of the server itself, and not for a request."""
        if self._is_own(sender):
            return True
        count, latest = self._copies.get((data, sender), (0, now))
        is_quick = now < latest + _PAUSE
        if is_quick and count < COPIES:
            return False
        self._copies.pop((data, sender), None)  # counted anew: after a pause, or because refusing one ends the round
        return is_quick

    def answered_with_itself(self, data: bytes, sender: Any, now: float) -> None:
        """Record that the answer to this datagram equals it."""
        # Removed and added again, so that the first in the table is the one that was not repeated for longest.
        count, _ = self._copies.pop((data, sender), (0, now))
        if len(self._copies) >= _SENDERS:
            del self._copies[next(iter(self._copies))]
        self._copies[data, sender] = count + 1, now
