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

Used by: the threaded and the asyncio TCP server.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

from barewire.io.ports.tcp import CONNECTIONS

if TYPE_CHECKING:
    from barewire.io.endpoint import Endpoint
    from barewire.modbus.server.server import Reply

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

    def __init__(self, endpoint: Endpoint) -> None:
        self.open: dict[C, float] = {}
        """Each open connection, with the time of its last request."""
        self.closed: deque[str] = deque(maxlen=16)
        """Why the server closed connections: the latest reasons, one line each."""
        self.limit = endpoint.integer("connections", CONNECTIONS)
        self.idle_timeout = endpoint.seconds("idle", 0.0)
        """Seconds without a request after which a connection is closed; 0 for never."""
        self._none_older = -inf  # no connection sent its last request before this time

    def __len__(self) -> int:
        return len(self.open)

    @property
    def unsent(self) -> int:
        """How many bytes of answers the clients have not read yet."""
        return sum(connection.unsent for connection in self.open)

    def add(self, connection: C, now: float) -> None:
        """Record a new connection. If there are too many then, close another one."""
        while len(self.open) >= self.limit:
            self.close_longest_silent(f"unused longest of {self.limit} connections")
        self.open[connection] = now

    def received(self, connection: C, now: float) -> None:
        """Record that a connection sent something."""
        self.open[connection] = now

    def remove(self, connection: C) -> None:
        """Remove a connection that ended."""
        self.open.pop(connection, None)

    def close_longest_silent(self, why: str) -> None:
        """Close the connection that was silent longest, if possible one that never got an answer."""
        unanswered = [connection for connection in self.open if not connection.was_answered]
        self.close(min(unanswered or self.open, key=self.open.__getitem__), why)

    def close(self, connection: C, why: str) -> None:
        """Close a connection and keep the reason."""
        self.remove(connection)
        self.note(connection, why)
        connection.abort()

    def note(self, connection: C, why: str) -> None:
        """Keep the reason for which the server closes a connection."""
        self.closed.append(f"{connection.peer}: {why}")

    def close_idle(self, now: float) -> float | None:
        """Close the connections that were silent too long. Return when to call this again, None if it is not needed."""
        if not self.idle_timeout or not self.open:
            return None
        if now >= self._none_older + self.idle_timeout:
            for connection, received_at in list(self.open.items()):
                if received_at + self.idle_timeout <= now and connection in self.open:
                    self.close(connection, f"silent for {self.idle_timeout:g} s")
            self._none_older = min(self.open.values(), default=-inf)
        return self._none_older + self.idle_timeout if self.open else None
