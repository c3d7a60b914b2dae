"""The pauses between attempts to connect: none before the first, then longer and longer ones.

    attempt fails at 0.0      next attempt not before 0.125 s later (`first`), then 0.25, 0.5, ... up to `longest`

The pauses vary at random (`jitter`), so that the hundred clients of a server that was restarted do not all connect at
the same time. Nothing runs in the background: a client without requests does not connect. Times and random numbers are
passed in.
"""

from __future__ import annotations

from collections.abc import Callable

from barewire.io.endpoint import PAUSES


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
