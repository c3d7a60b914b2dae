"""Locks on SDO channels and on LSS: which conversations of one bus may run at the same time.

        requests, the oldest first      605h/585h    605h/585h    606h/586h    everything    607h/587h
                                        granted      waits        granted      waits         waits

An SDO transfer locks its channel, because two transfers on one pair of identifiers would take each other's responses.
LSS locks the role of the master, because a bus has only one. A conversation without keys locks everything.

There is no starvation: a lock is granted when no older request shares a key with it, so no request is overtaken for
ever. There is no deadlock: a conversation requests all of its keys at once, so no two wait for each other.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable

from barewire.errors import EncodeError

LockKeys = frozenset[Hashable]


def _ignore() -> None:
    """Do nothing: the default of `wake`."""


class ChannelLock:
    """One request in the queue. `keys` None locks everything; `wake` is called when a waiting lock is granted, twice
    if an exception ended the release."""

    __slots__ = ("granted", "keys", "owner", "wake")

    def __init__(self, keys: LockKeys | None, owner: Hashable, wake: Callable[[], None]) -> None:
        self.keys = keys
        self.owner = owner
        self.wake = wake
        self.granted = False

    def conflicts_with(self, other: ChannelLock) -> bool:
        """Return whether two requests share a key."""
        if self.keys is None or other.keys is None:
            return (self.keys is None or bool(self.keys)) and (other.keys is None or bool(other.keys))
        return not self.keys.isdisjoint(other.keys)


class ChannelLocks:
    """The queue of requests.

    >>> locks = ChannelLocks()
    >>> first, second, other = (locks.request(frozenset({node})) for node in (5, 5, 6))
    >>> first.granted, second.granted, other.granted
    (True, False, True)
    >>> locks.release(first)
    >>> second.granted
    True
    """

    __slots__ = ("_queue",)

    def __init__(self) -> None:
        self._queue: dict[ChannelLock, None] = {}  # in the order of the requests

    def __len__(self) -> int:
        return len(self._queue)

    def request(self, keys: LockKeys | None, owner: Hashable = None, wake: Callable[[], None] = _ignore) -> ChannelLock:
        """Append a request. Every request must be released, also one that was not granted.

        `owner` is the thread or task of the conversation, if known. Raise EncodeError if it already holds a lock that
        this request would wait for, because then it would wait for itself.
        """
        lock = ChannelLock(keys, owner, wake)
        self.enter(lock)
        return lock

    def enter(self, lock: ChannelLock) -> None:
        """Append a request that the caller has made, so that it can release it whatever happens. Raise as `request`."""
        owner, granted = lock.owner, True
        for older in self._queue:
            if older.conflicts_with(lock):
                granted = False
                if owner is not None and older.owner == owner and older.granted:
                    raise EncodeError("a conversation on this bus was begun inside another one, which must end first")
        lock.granted = granted
        self._queue[lock] = None

    def take_if_free(self, lock: ChannelLock, owner: Hashable = None) -> bool:
        """Grant a lock, which may be used again and again, if no request shares a key with it. Return whether it did.

        >>> locks, lock = ChannelLocks(), ChannelLock(frozenset({5}), None, list)
        >>> locks.take_if_free(lock), locks.take_if_free(ChannelLock(frozenset({5}), None, list))
        (True, False)
        >>> locks.release(lock)
        >>> locks.take_if_free(lock)
        True
        """
        for older in self._queue:
            if older.conflicts_with(lock):
                return False
        lock.owner = owner
        lock.granted = True
        self._queue[lock] = None
        return True

    def release(self, lock: ChannelLock) -> None:
        """Remove a request, granted or waiting, and grant the requests that waited only for it. A second call completes
        one that an exception ended."""
        self._queue.pop(lock, None)
        claimed: set[Hashable] = set()  # the keys of older requests
        for waiting in self._queue:
            keys = waiting.keys
            if not waiting.granted and (not claimed if keys is None else claimed.isdisjoint(keys)):
                waiting.wake()  # before it counts as granted: a second call wakes it if an exception comes between
                waiting.granted = True
            if keys is None:
                break  # all later requests wait for a request for everything
            claimed |= keys
        lock.granted = False
