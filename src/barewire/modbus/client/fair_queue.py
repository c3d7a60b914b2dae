"""Whose turn it is on a line that many want: round about by unit, first come first served within a unit.

    waiting   unit 1: a b c d      unit 2: e      unit 3: f g
    turns     a e f b g c d

A unit that is asked a hundred things does not keep the others waiting. Where there is a place and nobody waits, `enter`
and `exit` do without a ticket. The queue is pure: the shells wait with a condition or with futures, whoever tests it
needs neither.
"""

from __future__ import annotations

from collections import deque


class Ticket:
    """A place in the queue of one unit. None is the queue of whatever concerns no unit in particular."""

    __slots__ = ("unit",)

    def __init__(self, unit: int | None) -> None:
        self.unit = unit


class FairQueue:
    """`places` may have their turn at the same time: 1 on a serial line, up to 16 on TCP.

    >>> turns = FairQueue()
    >>> first, second, other = turns.join(1), turns.join(1), turns.join(2)
    >>> turns.leave(first)
    True
    >>> turns.has(second), turns.has(other)
    (False, True)
    """

    def __init__(self, places: int = 1) -> None:
        self._free = places
        self._waiting: dict[int | None, deque[Ticket]] = {}
        self._served: dict[int | None, int] = {}  # when each unit had its last turn: the number of that turn
        self._count = 0
        self._holders: set[Ticket] = set()

    @property
    def holders(self) -> frozenset[Ticket]:
        """Those whose turn it is, as far as they have a ticket."""
        return frozenset(self._holders)

    def has(self, ticket: Ticket) -> bool:
        """Whether it is this one's turn."""
        return ticket in self._holders

    def enter(self, unit: int | None) -> bool:
        """Take a place at once, if nobody is kept waiting by that. Whoever entered exits."""
        if not self._free or self._waiting:
            return False
        self._free -= 1
        self._count += 1
        self._served[unit] = self._count
        return True

    def exit(self) -> bool:
        """The turn of one who entered is over. Whether it is somebody else's turn now."""
        self._free += 1
        return bool(self._waiting) and self._admit()

    def join(self, unit: int | None) -> Ticket:
        """Stand in the queue. Whoever joins leaves, whether it got its turn or gave up before."""
        ticket = Ticket(unit)
        if self.enter(unit):
            self._holders.add(ticket)
        else:
            self._waiting.setdefault(unit, deque()).append(ticket)
        return ticket

    def leave(self, ticket: Ticket) -> bool:
        """The turn is over, or no longer wanted. Whether it is somebody else's turn now."""
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
            # The one whose last turn is longest ago; of those that had none, the first that came.
            unit = min(self._waiting, key=lambda unit: self._served.get(unit, 0))
            queue = self._waiting[unit]
            self._holders.add(queue.popleft())
            self._free -= 1
            self._count += 1
            self._served[unit] = self._count
            if not queue:
                del self._waiting[unit]
        return True
