"""The inputs of a CSD MT, and their meanings.                         [CSD MT manual, registers 1008, 1066, 1067, 1088]

        CSD MT 94, bit of 1088 is 0      always, by 1067
        I0      proximity, for homing    start of a set-point (position), run (velocity); halt
        I1      negative limit switch    "
        I2      positive limit switch    "             ON: free to move.  OFF: status bit 11, and a halt; then only back
        I3      touch probe              "
        I4      -                        -             no bit shows it

        CSD MT S4     bits 1, 0 of 1088: I0 is 1 the negative limit switch, 2 proximity        3: general-purpose
                      bits 3, 2          I1 is 1 the touch probe, 2 the positive limit switch  3: general-purpose

A limit switch that is configured and not wired is OFF.
"""

from __future__ import annotations

from typing import NamedTuple

from barewire.devices.sim.csd_mt.context import Context
from barewire.devices.sim.csd_mt.environment import Span
from barewire.devices.sim.csd_mt.shaft import Shaft
from barewire.devices.sim.motion.cia402_axis import POSITION, VELOCITY

PROXIMITY, NEGATIVE, POSITIVE, PROBE = 0, 1, 2, 3
"""The special functions, numbered as the inputs of a CSD MT 94 that have them."""

_S4_FUNCTIONS = {PROXIMITY: (0, 2), NEGATIVE: (0, 1), POSITIVE: (1, 2), PROBE: (1, 1)}
"""The input that has a function, and the value of its two bits for that (table 21)."""

_SHOW_STO = 0x80
"""Bit of Input Config (1088): bit 24 of Digital Input shows Safe Torque Off."""


class StartInput(NamedTuple):
    """The input that starts a motion (register 1067)."""

    number: int
    relative: bool


class Inputs:
    """The levels of I0 to I4 and what they mean now."""

    def __init__(self, context: Context, shaft: Shaft) -> None:
        self.context, self.store, self.shaft = context, context.store, shaft
        place = shaft.position(context.now)
        self.levels = [
            wire.low <= place <= wire.high if isinstance(wire, Span) else wire for wire in context.environment.inputs
        ]
        """The present levels; `edges` keeps them up to date."""
        self.store.measure("Digital Input", self.shown)

    def input_of(self, function: int) -> int | None:
        """Return the number of the input that has a special function now; None if no input has it."""
        config = self.store.whole("Input Config")
        if self.context.environment.model == "94":
            return None if config >> function & 1 else function
        number, value = _S4_FUNCTIONS[function]
        return number if config >> 2 * number & 0b11 == value else None

    def is_on(self, function: int) -> bool:
        """Return whether there is an input with this function, and it is ON."""
        number = self.input_of(function)
        return number is not None and self.levels[number]

    def _is_off(self, function: int) -> bool:
        number = self.input_of(function)
        return number is not None and not self.levels[number]

    @property
    def proximity(self) -> bool:
        """Whether the home switch is ON."""
        return self.is_on(PROXIMITY)

    @property
    def below_limit(self) -> bool:
        """Whether there is a negative limit switch, and it is OFF."""
        return self._is_off(NEGATIVE)

    @property
    def above_limit(self) -> bool:
        """Whether there is a positive limit switch, and it is OFF."""
        return self._is_off(POSITIVE)

    @property
    def limited(self) -> bool:
        """Status bit 11."""
        return self.below_limit or self.above_limit

    def shown(self) -> int:
        """Return Digital Input (1008): limits and proximity where configured, I0 to I3, Auto Sync at work, STO."""
        environment = self.context.environment
        shown = self.levels[: 4 if environment.model == "94" else 2]
        word = sum(level << 16 + number for number, level in enumerate(shown))
        word |= self.is_on(NEGATIVE) | self.is_on(POSITIVE) << 1 | self.proximity << 2
        shows_sto = bool(self.store.whole("Input Config") & _SHOW_STO)
        return word | self.shaft.closed_loop << 23 | (shows_sto and environment.safe_torque_off) << 24

    # Start and halt by inputs (register 1067)

    @property
    def start_input(self) -> StartInput | None:
        """The input that starts a motion; None if no input does."""
        code = self.store.whole("Control Word from I/O") & 0xF
        return StartInput((code - 1) // 2, code % 2 == 0) if 1 <= code <= 8 else None

    def halts(self, mode: int) -> bool:
        """Return whether an input holds the shaft: halt in profile position, a start input that is OFF in velocity."""
        if mode == VELOCITY:
            start = self.start_input
            return start is not None and not self.levels[start.number]
        code = self.store.whole("Control Word from I/O") >> 4
        return mode == POSITION and code in (1, 3, 5, 7) and self.levels[(code - 1) // 2]
