"""A race: the same work done by several contestants, in turns, in one run.

    round 1   floor  ours   pymodbus  ...        a turn repeats the work until it has taken about `turn` seconds
    round 2   pymodbus  ...  ours  floor         the order is shuffled for each round, with the same seed in each run
    round 3   ours  floor   ...  pymodbus
              |___________________________ in each round: time of this contestant for one piece of work / the floor's

Other load on the machine affects the turns of one round alike, so their ratio is more reliable than the two times, and
the median of the ratios is more reliable still. No contestant always runs after the same one, which leaves its data in
the caches and the other processor awake or asleep. The first piece of a turn is not measured, unless it is the whole
turn, because it wakes up what slept. The garbage collector is off during the race.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from random import Random
from statistics import quantiles
from typing import Any

import pytest

ROUNDS = 31
TURN = 0.002


class Many:
    """Work that one call does `count` times: inside an event loop, or on several objects at a time."""

    measures_itself = False
    """Whether `run` returns the measured seconds, because only a part of it counts."""

    def __init__(self, run: Callable[[int], Any]) -> None:
        self.run = run

    def __call__(self) -> Any:
        return self.run(1)


Work = Callable[[], Any]
Factory = Callable[[ExitStack], Work]


@dataclass(frozen=True)
class Race:
    """The contestants that do the work `what` of one `family` at one `size`. The first contestant is the floor.

    A factory receives an ExitStack for what must be closed afterwards, and returns the work. The result of the work
    must equal `expect`; a list may stand for a tuple, and None allows any result. The factory imports the library that
    it needs; a library that is missing is reported.
    """

    family: str
    what: str
    size: int | str
    contestants: Mapping[str, Factory]
    expect: Any = None
    rounds: int = ROUNDS
    turn: float = TURN

    @property
    def group(self) -> str:
        """The title of the table."""
        return f"{self.family}: {self.what}, {self.size}"

    def __str__(self) -> str:
        return f"{self.family}-{self.what}-{self.size}".replace(" ", "_")


@dataclass
class Outcome:
    """`seconds` for one piece of work, round by round; contestants that are `missing` or `failed`, with the reason."""

    seconds: dict[str, list[float]] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    failed: dict[str, Exception] = field(default_factory=dict)

    def ratio(self, contestant: str, floor: str) -> dict[str, float]:
        """Median and quartiles of the ratios, round by round."""
        ratios = [mine / best for mine, best in zip(self.seconds[contestant], self.seconds[floor])]
        low, middle, high = quantiles(ratios, n=4) if len(ratios) > 1 else ratios * 3
        return {"median": middle, "q1": low, "q3": high}


def _turn(work: Work, count: int) -> float:
    """Return seconds for one piece of work: the mean of one turn."""
    clock = time.perf_counter
    if isinstance(work, Many):
        start = clock()
        result = work.run(count)
        return float(result) if work.measures_itself else (clock() - start) / count
    turns = range(count)
    start = clock()
    for _ in turns:
        work()
    return (clock() - start) / count


def _plain(found: Any) -> Any:
    """Return the result with tuples in place of lists, so that no contestant must convert within its measured time."""
    return tuple(map(_plain, found)) if isinstance(found, list | tuple) else found


def _how_often(work: Work, turn: float) -> int:
    """Return how often the work fits into about `turn` seconds, from the fastest of three trials: a single stall here
    would make all turns of the race too short."""
    count = 1
    if turn == 0.0:
        return count
    while (took := min(_turn(work, count) for _ in range(3)) * count) < turn / 4 and count < 1 << 20:
        count = max(2 * count, min(int(count * turn / 4 / max(took, 1e-7)), 16 * count))
    return max(1, round(count * turn / took))


def run(race: Race) -> Outcome:
    """Run all contestants that work, `rounds` times, in turns."""
    outcome = Outcome()
    with ExitStack() as closing:
        works: dict[str, tuple[Work, int]] = {}
        for name, make in race.contestants.items():
            try:
                work = make(closing)
                found = work()
                if race.expect is not None and _plain(found) != _plain(race.expect):
                    raise AssertionError(f"{name}: {found!r}, expected {race.expect!r}")
                works[name] = work, _how_often(work, race.turn)
            except ImportError as error:
                outcome.missing[name] = str(error)
            except Exception as error:  # a library that fails is reported, and the race goes on without it
                outcome.failed[name] = error
        outcome.seconds = {name: [] for name in works}
        order, draw = list(works), Random(0)
        gc.collect()
        gc.disable()
        try:
            for _ in range(race.rounds):
                draw.shuffle(order)
                for name in tuple(order):
                    work, count = works[name]
                    try:
                        if count > 1:
                            work()
                        outcome.seconds[name].append(_turn(work, count))
                    except Exception as error:  # as above; its earlier rounds are dropped
                        outcome.failed[name] = error
                        del outcome.seconds[name]
                        order.remove(name)
        finally:
            gc.enable()
    return outcome


def entries(*races: Race) -> list[Any]:
    """Return each contestant of each race, as parameters of a test."""
    return [
        pytest.param(race, contestant, id=f"{race}-{contestant}".replace(" ", "_"))
        for race in races
        for contestant in race.contestants
    ]
