"""Which of several waiting requests is next on a line: round robin by unit, first come first served within a unit.

    waiting   unit 1: a b c d      unit 2: e      unit 3: f g
    order     a e f b g c d

So a unit with a hundred requests does not keep the others waiting. The queue does not block: its callers wait, with a
condition or with futures.

An exception may interrupt every method at any line (Ctrl-C, a signal handler). So the caller makes the ticket before it
joins; a ticket is in `_places` before it is taken from those that wait, so that it is never in neither; and `leave` may
be called again.
"""

from __future__ import annotations

from collections import deque


class Ticket:
    """A place in the queue of one unit. `unit` None is the queue of requests to no unit in particular."""

    __slots__ = ("is_over", "unit")

    def __init__(self, unit: int | None) -> None:
        self.unit = unit
        self.is_over = False

    def __repr__(self) -> str:
        return f"<Ticket: unit {self.unit}{', over' if self.is_over else ''}>"


class FairQueue:
    """Admits `places` requests at the same time: 1 on a serial line, up to 16 on TCP.

    >>> queue = FairQueue()
    >>> first, second, other = Ticket(1), Ticket(1), Ticket(2)
    >>> queue.join(first), queue.join(second), queue.join(other)
    (0, None, None)
    >>> queue.leave(first)
    True
    >>> queue.place(second), queue.place(other)
    (None, 0)
    """

    def __init__(self, places: int = 1) -> None:
        self._places: list[Ticket | None] = [None] * places
        self._waiting: dict[int | None, deque[Ticket]] = {}
        self._served: dict[int | None, int] = {}  # unit -> the number of its latest admission
        self._count = 0

    @property
    def holders(self) -> frozenset[Ticket]:
        """The tickets that are admitted."""
        return frozenset(ticket for ticket in self._places if ticket is not None)

    def place(self, ticket: Ticket) -> int | None:
        """Return the number of the place to which this ticket is admitted; None if it waits."""
        return self._places.index(ticket) if ticket in self._places else None

    def join(self, ticket: Ticket) -> int | None:
        """Admit a ticket, or let it wait, and return its place as `place` does. `leave` ends it in both cases."""
        if self._waiting or None not in self._places:
            self._waiting.setdefault(ticket.unit, deque()).append(ticket)
            return None
        return self._take_place(ticket)

    def leave(self, ticket: Ticket) -> bool:
        """End a ticket whose request is done or given up. Returns whether another ticket was admitted."""
        ticket.is_over = True
        if ticket in self._places:
            self._places[self._places.index(ticket)] = None
        return bool(self._waiting) and self._admit()

    def _take_place(self, ticket: Ticket) -> int:
        self._count += 1
        self._served[ticket.unit] = self._count
        place = self._places.index(None)
        self._places[place] = ticket
        return place

    def _admit(self) -> bool:
        has_admitted = False
        while self._waiting and None in self._places:
            # The unit admitted longest ago; among units never admitted, the one that joined first.
            unit = min(self._waiting, key=lambda unit: self._served.get(unit, 0))
            queue = self._waiting[unit]
            if not queue:
                del self._waiting[unit]
                continue
            if not queue[0].is_over and queue[0] not in self._places:
                self._take_place(queue[0])
                has_admitted = True
            queue.popleft()
        return has_admitted
