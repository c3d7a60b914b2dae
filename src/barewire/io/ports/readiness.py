"""Many sockets and one look: which of them have something to say, or take again what they did not take.

        watch() -> register(file, IN)   modify(file, OUT)   unregister(file)   poll(seconds) -> [(file, events), ...]

On Linux this is `select.epoll` itself, whose words these are. Elsewhere `selectors` does it, with whatever a system
has: the same in other words, which take longer than reading a request does.
"""

from __future__ import annotations

import select
import selectors
from typing import Protocol


class Watch(Protocol):
    """What is used of `select.epoll`."""

    def register(self, fd: int, eventmask: int, /) -> None: ...
    def modify(self, fd: int, eventmask: int, /) -> None: ...
    def unregister(self, fd: int, /) -> None: ...
    def poll(self, timeout: float, /) -> list[tuple[int, int]]: ...
    def close(self) -> None: ...


IN, OUT = 1, 4
"""Something to read; room to write. (The numbers of `EPOLLIN` and `EPOLLOUT`.)"""
SELECT_MOST = 500
"""Connections where a system has nothing but `select`, which looks at 512 sockets and fails with more."""
_EVENTS = {IN: selectors.EVENT_READ, OUT: selectors.EVENT_WRITE}


class Selectors:
    """A watch made of `selectors`."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()

    def register(self, fd: int, eventmask: int, /) -> None:
        """Watch one more file."""
        self._selector.register(fd, _EVENTS[eventmask])

    def modify(self, fd: int, eventmask: int, /) -> None:
        """Watch it for something else."""
        self._selector.modify(fd, _EVENTS[eventmask])

    def unregister(self, fd: int, /) -> None:
        """Watch it no longer. To be said before it is closed."""
        self._selector.unregister(fd)

    def poll(self, timeout: float, /) -> list[tuple[int, int]]:
        """The files of which something is to be told, within so many seconds."""
        return [(key.fd, events) for key, events in self._selector.select(timeout)]

    def close(self) -> None:
        """Give back what the system lent."""
        self._selector.close()


def watch() -> Watch:
    """The quickest watch that there is here."""
    return select.epoll() if hasattr(select, "epoll") else Selectors()


def most(wanted: int) -> int:
    """How many connections can be watched, if so many are wanted."""
    return min(wanted, SELECT_MOST) if issubclass(selectors.DefaultSelector, selectors.SelectSelector) else wanted
