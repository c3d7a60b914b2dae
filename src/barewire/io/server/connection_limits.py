"""Connection limits of a server: how many clients may be connected, and how long a client may stay silent.

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
Times are passed in.

Why each connection ended is counted in the statistics of the server, and logged.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, Generic, Literal, Protocol, TypeVar

from barewire.io.ports.tcp import CONNECTIONS
from barewire.io.server.server_log import server_log
from barewire.modbus.server.server import ServerStatistics

if TYPE_CHECKING:
    from barewire.io.endpoint import Endpoint
    from barewire.io.log import PortLog
    from barewire.modbus.server.server import Reply

End = Literal["left", "refused", "idle", "broken", "stopped"]
"""Why a connection ended: the name of its counter in `ServerStatistics`."""

Inject = Callable[["Reply", Callable[[bytes], None]], None]
"""Takes an answer and the function that sends it; sends it now, later, changed or not at all (`FaultInjector`)."""


def send_replies(replies: list[Reply], send: Callable[[bytes], None], inject: Inject | None) -> None:
    """Send the answers to the requests of one read together. A fault injector gets them one by one."""
    if inject is not None:
        for reply in replies:
            inject(reply, send)
    else:
        send(replies[0].data if len(replies) == 1 else b"".join([reply.data for reply in replies]))


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
        self._lowered = self.log.warning if "connections" in endpoint.options else self.log.info
        self.idle_timeout = endpoint.seconds("idle", 0.0)
        """Seconds without a request after which a connection is closed; 0 for never."""
        self._ends: dict[C, End] = {}  # why the server is closing a connection
        self._none_older = -inf  # no connection sent its last request before this time

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
        if (limit := max(1, limit)) < self.limit:
            self._lowered("limit", f"at most {limit} connections instead of {self.limit}: {why}")
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
        if now >= self._none_older + self.idle_timeout:
            for connection, received_at in list(self.open.items()):
                if received_at + self.idle_timeout <= now and connection in self.open:
                    self.close(connection, f"silent for {self.idle_timeout:g} s", "idle")
            self._none_older = min(self.open.values(), default=-inf)
        return self._none_older + self.idle_timeout if self.open else None
