"""The homing methods of the CSD MT, each as a search in steps.                     [CSD MT manual, ch. 12, homing mode]

        home switch        .----------.            19: from below fast up into it, then slowly down and out at A
                   OFF     |    ON    |   OFF      20: the same, and slowly up into it again: A from below
        -------------------A----------B-------->   21: from above fast down into it, then slowly up and out at B
                                                   22: the same, and slowly down into it again: B from above

3, 4, 5 and 6 are 19, 20, 21 and 22, and then on in the same direction to the next index pulse. A shaft that is in the
switch when it begins leaves out the fast part. 35 and 37: the place where it stands. -1 (down) and -2 (up): fast
against a mechanical stop, until Auto Sync sees the shaft stay behind, and 1115 steps back.

The manual prints 19 as "OFF->ON transition, negative direction" and refers to DSP 402 2.0, where the same method leaves
the switch downwards, ON to OFF. Both are right if the transition is that of the switch seen upwards (A is OFF->ON, B
ON->OFF) and the direction that of the last movement. Read so, the eight lines of register 1050 are the eight methods
of DSP 402, and this file follows both.

What is found is called +offset, as the manual has it (in CiA 402 it would be -offset). A slow search at speed 0, the
default of 1054, never ends, nor does a search for an input that Input Config (1088) does not make the proximity input.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import TYPE_CHECKING, Literal, NamedTuple

from barewire.devices.sim.csd_mt.settings import START_STOP

if TYPE_CHECKING:
    from barewire.devices.sim.csd_mt.machine import CsdMt

Sign = Literal["on", "off", "index", "impact", "rest"]
"""What a step of a search waits for: an edge of the home switch, an index pulse, a stop that is hit, standstill."""


class Method(NamedTuple):
    """`towards`: where the switch is searched. `final`: the direction of the last movement. 1 is up."""

    towards: int
    final: int
    by_index: bool


METHODS = {
    3: Method(1, -1, True),
    4: Method(1, 1, True),
    5: Method(-1, 1, True),
    6: Method(-1, -1, True),
    19: Method(1, -1, False),
    20: Method(1, 1, False),
    21: Method(-1, 1, False),
    22: Method(-1, -1, False),
}
ON_THE_SPOT = (35, 37)
ON_IMPACT = {-1: -1, -2: 1}
"""Which is which is not printed (register 1115)."""


class Search:
    """One homing run. It is told what happens, and goes on when it is what it waits for."""

    def __init__(self, drive: CsdMt, method: int) -> None:
        self.drive = drive
        self.method = method
        self.fast = drive.store.number("Homing Speed During Search for Switch")
        self.slow = drive.store.number("Homing Speed During Search for Zero")
        self.ramp = drive.store.number("Homing Acceleration")
        self.waits_for: Sign | None = None
        self._steps = self._impact() if method in ON_IMPACT else self._switch()

    @staticmethod
    def possible(drive: CsdMt, method: int) -> bool:
        """Whether there is such a method; a mechanical stop is felt by Auto Sync only."""
        if method in ON_IMPACT:
            return drive.shaft.auto_sync
        return method in METHODS or method in ON_THE_SPOT

    def begin(self) -> None:
        """The first step."""
        if self.method in ON_THE_SPOT:
            self.drive.axis.home_found()
        else:
            self._advance()

    def happens(self, sign: Sign) -> None:
        """Something has happened now."""
        if sign == self.waits_for:
            self._advance()

    def _advance(self) -> None:
        self.waits_for = next(self._steps, None)
        if self.waits_for is None:
            self.drive.axis.home_found()

    def rests_at(self) -> float:
        """When the standstill comes that is waited for."""
        return self.drive.axis.trajectory.ends_at if self.waits_for == "rest" else inf

    # The steps. Each begins a movement and says what ends it.

    def _run(self, velocity: float, ramp: float = inf) -> None:
        if self.drive.axis.may_go(velocity):
            self.drive.axis.trajectory.run_at(self.drive.now, velocity, ramp, ramp)
        else:
            self.drive.axis.give_up_search()

    def _switch(self) -> Iterator[Sign]:
        towards, final, by_index = METHODS[self.method]
        if not self.drive.inputs.proximity:
            self._run(towards * self.fast, self.ramp)
            yield "on"
            self._run(0.0, self.ramp)
            yield "rest"  # as a rule beyond the switch (register 1052, note)
        self._run(-towards * self.slow)
        yield "off"
        if final == towards:
            self._run(final * self.slow)
            yield "on"
        if by_index:
            yield "index"

    def _impact(self) -> Iterator[Sign]:
        direction = ON_IMPACT[self.method]
        self._run(direction * self.fast, self.ramp)
        yield "impact"
        self.drive.shaft.command_follows_shaft()
        here = self.drive.axis.trajectory.position(self.drive.now)
        back = self.drive.store.number("Hard Stop Homing Disengaging Steps")
        self.drive.axis.trajectory.jump(self.drive.now, here)
        self.drive.shaft.hold()
        self.drive.axis.trajectory.move(
            self.drive.now, here - direction * back, START_STOP, self.ramp, self.ramp, jerky=True
        )
        yield "rest"
