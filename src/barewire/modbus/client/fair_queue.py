"""Which of several waiting requests is next on a line: round robin by unit, first come first served within a unit.

    waiting   unit 1: a b c d      unit 2: e      unit 3: f g
    order     a e f b g c d

So a unit with a hundred requests does not keep the others waiting. While a place is free and nothing waits, a ticket is
not needed: `enter` and `exit` are enough. The queue does not block: its callers wait, with a condition or with futures.

Depends on: nothing. Used by: the Modbus clients of io.
"""

from __future__ import annotations

from collections import deque


class Ticket:
    """A place in the queue of one unit. `unit` None is the queue of requests to no unit in particular."""

    __slots__ = ("unit",)

    def __init__(self, unit: int | None) -> None:
        self.unit = unit


class FairQueue:
    """Admits `places` requests at the same time: 1 on a serial line, up to 16 on TCP.

    >>> queue = FairQueue()
    >>> first, second, other = queue.join(1), queue.join(1), queue.join(2)
    >>> queue.leave(first)
    True
    >>> queue.has(second), queue.has(other)
    (False, True)
    """

    def __init__(self, places: int = 1) -> None:
        self._free = places
        self._waiting: dict[int | None, deque[Ticket]] = {}
        self._served: dict[int | None, int] = {}  # unit -> the number of its latest admission
        self._count = 0
        self._holders: set[Ticket] = set()

    @property
    def holders(self) -> frozenset[Ticket]:
        """The tickets that are admitted."""
        return frozenset(self._holders)

    def has(self, ticket: Ticket) -> bool:
        """Whether this ticket is admitted."""
        return ticket in self._holders

    def enter(self, unit: int | None) -> bool:
        """Take a free place without a ticket. False if there is none, or tickets wait. `exit` gives it back."""
        if not self._free or self._waiting:
            return False
        self._free -= 1
        self._count += 1
        self._served[unit] = self._count
        return True

    def exit(self) -> bool:
        """Give back a place taken by `enter`. Returns whether another ticket was admitted."""
        self._free += 1
        return bool(self._waiting) and self._admit()

    def join(self, unit: int | None) -> Ticket:
        """Take a ticket, which is admitted or waits. `leave` gives it back in both cases."""
        ticket = Ticket(unit)
        if self.enter(unit):
            self._holders.add(ticket)
        else:
            self._waiting.setdefault(unit, deque()).append(ticket)
        return ticket

    def leave(self, ticket: Ticket) -> bool:
        """Give back a ticket whose request is done or given up. Returns whether another ticket was admitted."""
        if ticket in self._holders:
            self._holders.remove(ticket)
            return self.exit()
        queue = self._waiting.get(ticket.unit)
        if queue is not None and ticket in queue:
            queue.remove(ticket)
            if not queue:
                del self._waiting[ticket.unit]
        return False

    def _admit(self) -> bool:
        while self._free and self._waiting:
            # The unit admitted longest ago; among units never admitted, the one that joined first.
            unit = min(self._waiting, key=lambda unit: self._served.get(unit, 0))
            queue = self._waiting[unit]
            self._holders.add(queue.popleft())
            self._free -= 1
            self._count += 1
            self._served[unit] = self._count
            if not queue:
                del self._waiting[unit]
        return True
