"""When to try again to connect: at once the first time, then after pauses that grow, each a little different.

    attempt fails at 0.0      next attempt not before 0.125 s later, then 0.25, 0.5, ... up to `longest`

The pauses vary at random (`jitter`), so that a hundred clients of a server that was restarted do not come all at once.
Nothing runs by itself: a client without requests does not connect. Times and random numbers are passed in.
"""

from __future__ import annotations

from collections.abc import Callable


def random_fraction() -> float:
    """A random number in 0..1."""
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
        self, random: Callable[[], float], *, first: float = 0.125, longest: float = 30.0, jitter: float = 0.5
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
        """How many seconds until the next attempt may be made."""
        return max(0.0, self._not_before - now)

    def failed(self, now: float, why: str) -> None:
        """An attempt failed: a pause begins, twice the last, not above `longest`; then half of `jitter` up or down."""
        pause = min(self._first * 2.0 ** min(self._failures, 32), self._longest)
        self._failures += 1
        self._not_before = now + pause * (1.0 + self._jitter * (self._random() - 0.5))
        self.why = why

    def worked(self) -> None:
        """An attempt succeeded: the next pause is the first again."""
        self._failures = 0
        self._not_before = float("-inf")
        self.why = ""
