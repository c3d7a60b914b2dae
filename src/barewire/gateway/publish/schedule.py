"""When which group of parameters is read on a line, and which values are worth publishing. Time is an argument.

    group 1, every 1 s     |x         x         x         x
    group 2, every 1 s     |     x         x         x            staggered: never all at once
    group 3, every 5 s     |  x                                                 x

A line that is slower than its groups want loses no order: each group waits for its turn, and misses the times that have
passed. A machine that does not respond is asked less and less often, at least once a minute.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf

from barewire.codecs import Value

_LONGEST_PAUSE = 60.0
"""Seconds: a machine that does not respond is asked at least this often."""


@dataclass
class PollGroup:
    """Parameters of one machine that are read together every `every` seconds."""

    machine: str
    names: tuple[str, ...]
    every: float
    due_at: float = -inf
    failures: int = 0
    """Reads in a row that failed."""
    missed: int = 0
    """Times that passed while the line was busy."""
    refused: dict[str, str] = field(default_factory=dict)
    """The names that the machine refuses, and why. They are left out until `all_again_at`."""
    all_again_at: float = -inf


class PollSchedule:
    """The groups of one line.

    >>> schedule = PollSchedule([PollGroup("a", ("x",), 1.0), PollGroup("b", ("y",), 1.0)], now=10.0)
    >>> [(group.machine, group.due_at) for group in schedule.groups]
    [('a', 10.0), ('b', 10.5)]
    """

    def __init__(self, groups: Sequence[PollGroup], now: float) -> None:
        self.groups = groups
        for place, group in enumerate(groups):
            group.due_at = now + group.every * place / len(groups)

    def next(self) -> PollGroup:
        """Return the group that is due first."""
        return min(self.groups, key=lambda group: group.due_at)

    def done(self, group: PollGroup, now: float, *, has_failed: bool) -> None:
        """Set the next time of a group that was read."""
        group.failures = group.failures + 1 if has_failed else 0
        pause = min(group.every * 2.0 ** min(group.failures, 16), max(_LONGEST_PAUSE, group.every))
        step = pause if has_failed else group.every
        group.due_at += step
        if group.due_at < now:
            missed = int((now - group.due_at) / step) + 1
            group.missed += missed
            group.due_at += missed * step


@dataclass
class ValueFilter:
    """Which values are published: those that changed by more than `dead_band`, and each after `at_least` seconds.

    Without `on_change` every value is published.

    >>> changes = ValueFilter(dead_band=0.5, at_least=60.0)
    >>> [changes.passes("speed", value, now) for value, now in ((10.0, 0.0), (10.4, 1.0), (10.6, 2.0), (10.6, 62.0))]
    [True, False, True, True]
    """

    on_change: bool = True
    dead_band: float = 0.0
    at_least: float = 60.0
    published: dict[str, tuple[Value, float]] = field(default_factory=dict)

    def passes(self, name: str, value: Value, now: float) -> bool:
        """Return whether a value is to be published. If so, the next ones are compared with it."""
        known = self.published.get(name)
        if (
            self.on_change
            and known is not None
            and now < known[1] + self.at_least
            and not self._differs(value, known[0])
        ):
            return False
        self.published[name] = value, now
        return True

    def _differs(self, value: Value, known: Value) -> bool:
        numbers = (int, float)
        if isinstance(value, numbers) and isinstance(known, numbers) and not isinstance(value, bool):
            return abs(value - known) > self.dead_band or (value != value) != (known != known)  # nan is a value too
        return value != known

    def forget(self) -> None:
        """Publish every value again: the broker has lost them."""
        self.published.clear()
