"""What every connection needs: pauses between attempts to connect, and an end in forked processes.

    attempt fails at 0.0      next attempt not before 0.125 s later (`first`), then 0.25, 0.5, ... up to `longest`

The pauses vary at random (`jitter`), so that the hundred clients of a server that was restarted do not all connect at
the same time. Nothing runs in the background: a client without requests does not connect. Times and random numbers are
passed in.

A child process has inherited the connections of its parent by `fork`:

        parent    client ---- socket ----.
                                          >---- one connection: an answer goes to whichever process reads first
        child     client ---- socket ----'

So the child's copy of an open client raises PortError, and the parent's stays as it is: nothing is sent, and no
connection is shut down. `multiprocessing` forks by default on Linux up to Python 3.13.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Protocol
from weakref import WeakSet

from barewire.io.endpoint import PAUSES

OPENED_BEFORE_FORK = "opened before fork: open one in this process"
"""The end of the error in the child."""


def random_fraction() -> float:
    """Return a random number in 0..1."""
    from random import random  # not at the top: needed only after a failed attempt, and slow to load

    return random()


class BackOff:
    """The pauses of one connection, in seconds. `random` returns numbers in 0..1.

    >>> pauses = BackOff(lambda: 0.5)
    >>> for now in (10.0, 20.0, 30.0):
    ...     pauses.failed(now, "connection refused")
    >>> pauses.wait(30.25), pauses.wait(31.0)
    (0.25, 0.0)
    """

    def __init__(
        self, random: Callable[[], float], *, first: float = PAUSES[0], longest: float = PAUSES[1], jitter: float = 0.5
    ) -> None:
        self.why = ""
        """Why the latest attempt failed; empty if it succeeded."""
        self._random = random
        self._first = first
        self._longest = longest
        self._jitter = jitter
        self._failures = 0
        self._not_before = float("-inf")

    def wait(self, now: float) -> float:
        """Return the seconds until the next attempt may be made."""
        return max(0.0, self._not_before - now)

    def failed(self, now: float, why: str) -> None:
        """Record a failed attempt. The pause doubles, up to `longest`, and varies by half of `jitter` up or down."""
        # 32 doublings are beyond every longest pause; a float has no more than 1023 of them.
        pause = min(self._first * 2.0 ** min(self._failures, 32), self._longest)
        self._failures += 1
        self._not_before = now + pause * (1.0 + self._jitter * (self._random() - 0.5))
        self.why = why

    def reset(self) -> None:
        """Forget the failed attempts, after one that succeeded or when the user asks for a new one: it may be made at
        once, and the next pause is the first again."""
        self._failures = 0
        self._not_before = float("-inf")
        self.why = ""


class _Inheritable(Protocol):
    def end_in_child(self) -> None:
        """Make this copy raise PortError. Called in a child process, whose only thread is the caller's."""


_open: WeakSet[_Inheritable] | None = None


def end_after_fork(connection: _Inheritable) -> None:
    """Call `end_in_child` of this connection in each process that is forked from this one, while the object lives."""
    global _open
    if _open is None:
        _open = WeakSet()
        if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
            os.register_at_fork(after_in_child=_end_all)
    _open.add(connection)


def _end_all() -> None:
    for connection in tuple(_open or ()):
        connection.end_in_child()
