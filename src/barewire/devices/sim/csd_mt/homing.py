"""The homing methods of the CSD MT, each as a sequence of movements.               [CSD MT manual, ch. 12, homing mode]

        home switch        .----------.            19: from below fast up into it, then slowly down and out at A
                   OFF     |    ON    |   OFF      20: the same, and slowly up into it again: A from below
        -------------------A----------B-------->   21: from above fast down into it, then slowly up and out at B
                                                   22: the same, and slowly down into it again: B from above

3, 4, 5 and 6 are 19, 20, 21 and 22, and then on in the same direction to the next index pulse. If the shaft is in the
switch at the beginning, the fast part is left out. 35 and 37: the place where the shaft stands. -1 (down) and -2 (up):
fast against a mechanical stop, until Auto Sync detects that the shaft lags, and 1115 steps back.

The manual prints 19 as "OFF->ON transition, negative direction" and refers to DSP 402 2.0, where the same method leaves
the switch downwards, ON to OFF. Both are right if the transition is that of the switch seen upwards (A is OFF->ON, B
ON->OFF) and the direction that of the last movement. Read so, the eight lines of register 1050 are the eight methods
of DSP 402, and this file follows both.

Home gets the number +offset, as in the manual (in CiA 402 it would be -offset). A slow search at speed 0, the default
of 1054, never ends, nor does a search for an input that Input Config (1088) does not make the proximity input.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import Literal, NamedTuple

Sign = Literal["on", "off", "index", "impact", "rest"]
"""The end of a movement: an edge of the home switch, an index pulse, a mechanical stop, standstill."""


class Run(NamedTuple):
    """Run at a velocity in step/s, with a ramp in step/s²; without one the velocity changes at once."""

    velocity: float
    ramp: float = inf


class Retreat(NamedTuple):
    """Move away from a mechanical stop, by 1115 steps. `direction` is that in which the shaft hit it."""

    direction: int
    ramp: float


class SearchStep(NamedTuple):
    """A movement (None: the one before goes on), and the sign that ends it."""

    move: Run | Retreat | None
    until: Sign


class SwitchMethod(NamedTuple):
    """`towards`: where the switch is searched. `final`: the direction of the last movement. 1 is up."""

    towards: int
    final: int
    by_index: bool


_BY_SWITCH = {
    3: SwitchMethod(1, -1, True),
    4: SwitchMethod(1, 1, True),
    5: SwitchMethod(-1, 1, True),
    6: SwitchMethod(-1, -1, True),
    19: SwitchMethod(1, -1, False),
    20: SwitchMethod(1, 1, False),
    21: SwitchMethod(-1, 1, False),
    22: SwitchMethod(-1, -1, False),
}
_ON_THE_SPOT = (35, 37)
_BY_IMPACT = {-1: -1, -2: 1}
"""Method -> direction. The manual does not print which is which (register 1115)."""


def is_possible(method: int, *, auto_sync: bool) -> bool:
    """Return whether the method exists; only Auto Sync detects a mechanical stop."""
    return auto_sync if method in _BY_IMPACT else method in _BY_SWITCH or method in _ON_THE_SPOT


def search_steps(method: int, *, fast: float, slow: float, ramp: float, in_switch: bool) -> Iterator[SearchStep]:
    """Yield the movements of a method, for speeds in step/s. After the last one the shaft is at home.

    >>> for step in search_steps(19, fast=8000, slow=800, ramp=1e5, in_switch=False):
    ...     print(step.move, step.until)
    Run(velocity=8000, ramp=100000.0) on
    Run(velocity=0.0, ramp=100000.0) rest
    Run(velocity=-800, ramp=inf) off
    """
    if method in _BY_IMPACT:
        direction = _BY_IMPACT[method]
        yield SearchStep(Run(direction * fast, ramp), "impact")
        yield SearchStep(Retreat(direction, ramp), "rest")
    elif method in _BY_SWITCH:
        towards, final, by_index = _BY_SWITCH[method]
        if not in_switch:
            yield SearchStep(Run(towards * fast, ramp), "on")
            yield SearchStep(Run(0.0, ramp), "rest")  # as a rule beyond the switch (register 1052, note)
        yield SearchStep(Run(-towards * slow), "off")
        if final == towards:
            yield SearchStep(Run(final * slow), "on")
        if by_index:
            yield SearchStep(None, "index")
