"""Who is connected to a server, and who has to go when there are too many, or when one was silent for too long.

        connections        A        B        C        D        E
        last heard        3.1      0.5      9.7      0.2      4.0
        answered           x        x        x        x
                                                      |        '-- over `most` connections the longest silent goes of
                                                      |            those that were never answered, if there are any:
                                                      |            who only opens connections takes nobody's
                                                      '-- with `idle` goes who was silent for so many seconds

To hear of a guest takes no time, for it happens with each request: no order is kept, and they are looked through when
one has to go, or might. What a guest is answered leaves at once (`say_all`).

I know: connections, and when each was heard.  I never know: sockets, loops, clocks: time is told.
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


Spoil = Callable[[bytes, Callable[[bytes], None]], None]
"""Given an answer and what says it: says it, something else, later, or nothing (`faulty`)."""


def say_all(replies: list[Reply], say: Callable[[bytes], None], spoil: Spoil | None) -> None:
    """The answers to all that came in one read leave in one send; whoever spoils answers is given each by itself."""
    if spoil is not None:
        for reply in replies:
            spoil(reply.data, say)
    else:
        say(replies[0].data if len(replies) == 1 else b"".join([reply.data for reply in replies]))


class TrackedConnection(Protocol):
    """One connection, as far as the limits are concerned."""

    peer: str
    was_answered: bool

    @property
    def unsent(self) -> int:
        """The bytes that the client has not taken yet."""

    def abort(self) -> None:
        """Hang up at once."""


G = TypeVar("G", bound="TrackedConnection")


class ConnectionTable(Generic[G]):
    """The connections of one server. The endpoint says `connections` and `idle`, if it says anything.

    Raises EncodeError for a number of connections or seconds that is none.
    """

    def __init__(self, endpoint: Endpoint) -> None:
        self.connections: dict[G, float] = {}
        """Each with the time it was last heard."""
        self.turned_away: deque[str] = deque(maxlen=16)
        """Why connections were closed by us, the latest: one line each."""
        self.most = endpoint.integer("connections", CONNECTIONS)
        self.idle = endpoint.seconds("idle", 0.0)
        self._heard_since = -inf  # everybody was heard then or later

    @property
    def unsent(self) -> int:
        """The bytes of answers that clients have not taken yet."""
        return sum(guest.unsent for guest in self.connections)

    def arrived(self, guest: G, now: float) -> None:
        """A new connection; if it is one too many, another one has to go."""
        while len(self.connections) >= self.most:
            self.make_room(f"unused longest of {self.most} connections")
        self.heard(guest, now)

    def heard(self, guest: G, now: float) -> None:
        """A connection is in use."""
        self.connections[guest] = now

    def left(self, guest: G) -> None:
        """A connection is over, whoever ended it."""
        self.connections.pop(guest, None)

    def make_room(self, why: str) -> None:
        """Somebody has to go."""
        unused = [guest for guest in self.connections if not guest.was_answered]
        self.turn_away(min(unused or self.connections, key=self.connections.__getitem__), why)

    def turn_away(self, guest: G, why: str) -> None:
        """Close a connection and keep the reason to be seen."""
        self.left(guest)
        self.note(guest, why)
        guest.abort()

    def note(self, guest: G, why: str) -> None:
        """Keep why we close a connection."""
        self.turned_away.append(f"{guest.peer}: {why}")

    def watch(self, now: float) -> float | None:
        """Whoever was silent for too long goes. When to look again; None while nobody could be."""
        if not self.idle or not self.connections:
            return None
        if now >= self._heard_since + self.idle:
            for guest, heard in list(self.connections.items()):
                if heard + self.idle <= now and guest in self.connections:
                    self.turn_away(guest, f"silent for {self.idle:g} s")
            self._heard_since = min(self.connections.values(), default=-inf)
        return self._heard_since + self.idle if self.connections else None
