"""Sequences of choices: all of them up to a bound, or random ones.

A scenario is a function that takes one argument, `choices`, and calls `choices.take(alternatives)` wherever several
things may happen. `run_all` calls it once for each sequence of choices, by depth-first search; a scenario must be
deterministic apart from its choices and must end.

    >>> seen = []
    >>> run_all(lambda choices: seen.append(choices.take("ab") + choices.take("xyz")))
    6
    >>> seen
    ['ax', 'ay', 'az', 'bx', 'by', 'bz']
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from typing import TypeAlias, TypeVar

T = TypeVar("T")


class Choices:
    """The choices of one run: those of `script`, then random ones with `dice`, otherwise always the first."""

    def __init__(self, script: Sequence[int] = (), dice: random.Random | None = None) -> None:
        self.taken: list[tuple[int, int]] = []
        """Each choice so far: its place among the alternatives, and their number."""
        self._script = script
        self._dice = dice

    def take(self, alternatives: Sequence[T]) -> T:
        """Return one of the alternatives."""
        count, step = len(alternatives), len(self.taken)
        if step < len(self._script):
            place = self._script[step]
        else:
            place = self._dice.randrange(count) if self._dice is not None else 0
        self.taken.append((place, count))
        return alternatives[place]

    @property
    def script(self) -> tuple[int, ...]:
        """The places of all choices: `Choices(script)` repeats the run."""
        return tuple(place for place, _ in self.taken)


Scenario: TypeAlias = Callable[[Choices], object]


def run_all(scenario: Scenario, until: Callable[[], object] = bool) -> int:
    """Run the scenario once for each sequence of choices. Returns the number of runs.

    `until` ends the search: the runs behind one in which a planted mistake has shown say nothing new.
    """
    script: tuple[int, ...] = ()
    runs = 0
    while True:
        choices = Choices(script)
        scenario(choices)
        runs += 1
        taken = choices.taken
        while taken and taken[-1][0] + 1 == taken[-1][1]:
            taken.pop()
        if not taken or until():
            return runs
        script = (*(place for place, _ in taken[:-1]), taken[-1][0] + 1)


def run_random(scenario: Scenario, runs: int, *, seed: int = 1, until: Callable[[], object] = bool) -> int:
    """Run the scenario `runs` times with random choices, or until `until` ends it. Returns the number of runs."""
    dice = random.Random(seed)
    for run in range(1, runs + 1):
        scenario(Choices(dice=dice))
        if until():
            return run
    return runs
