"""Who may talk now: some talks on a bus disturb each other, most do not.

        waiting, the oldest first       605h/585h    605h/585h    606h/586h    everything    607h/587h
        who goes ahead                  now          waits        now          waits         waits

A transfer claims its SDO channel, because two at once on one pair of identifiers would take each other's answers; LSS
claims the one master that a bus has. Whoever does not say what it needs claims everything. A claim goes ahead when no
older one wants any of the same, so nobody is overtaken for ever, and since all keys are claimed at once, no two wait
for each other.

I know: who wants what, in which order.  I never know: threads, tasks, what a key stands for.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable

from barewire.errors import EncodeError

Keys = frozenset[Hashable]


def _ignore() -> None:
    """Nobody waits."""


class ChannelLock:
    """One talk's place in the line. `keys` None is everything; `wake` is called when it may go ahead after waiting."""

    __slots__ = ("going", "keys", "owner", "wake")

    def __init__(self, keys: Keys | None, owner: Hashable, wake: Callable[[], None]) -> None:
        self.keys = keys
        self.owner = owner
        self.wake = wake
        self.going = False

    def meets(self, other: ChannelLock) -> bool:
        """Whether the two want something of the same."""
        if self.keys is None or other.keys is None:
            return (self.keys is None or bool(self.keys)) and (other.keys is None or bool(other.keys))
        return not self.keys.isdisjoint(other.keys)


class ChannelLocks:
    """The line.

    >>> claims = ChannelLocks()
    >>> first, second, other = (claims.join(frozenset({node})) for node in (5, 5, 6))
    >>> first.going, second.going, other.going
    (True, False, True)
    >>> claims.leave(first)
    >>> second.going
    True
    """

    __slots__ = ("_line",)

    def __init__(self) -> None:
        self._line: dict[ChannelLock, None] = {}  # in the order in which they came

    def __len__(self) -> int:
        return len(self._line)

    def join(self, keys: Keys | None, owner: Hashable = None, wake: Callable[[], None] = _ignore) -> ChannelLock:
        """Stand in the line. Whoever joins leaves, whether it went ahead or gave up before.

        `owner` is who talks, if that is known: EncodeError if it holds already what it would wait for, because then
        it would wait for itself.
        """
        claim = ChannelLock(keys, owner, wake)
        going = True
        for older in self._line:
            if older.meets(claim):
                going = False
                if owner is not None and older.owner == owner and older.going:
                    raise EncodeError("a talk on this bus was begun inside another one that has to end first")
        claim.going = going
        self._line[claim] = None
        return claim

    def leave(self, claim: ChannelLock) -> None:
        """The talk is over, or no longer wanted: whoever waited for it only goes ahead."""
        self._line.pop(claim, None)
        taken: set[Hashable] = set()
        for waiting in self._line:
            keys = waiting.keys
            if not waiting.going and (not taken if keys is None else taken.isdisjoint(keys)):
                waiting.going = True
                waiting.wake()
            if keys is None:
                return  # whoever came behind one that wants everything stays behind it
            taken |= keys
