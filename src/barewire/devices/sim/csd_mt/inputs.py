"""The inputs of a CSD MT, and what each of them may mean.             [CSD MT manual, registers 1008, 1066, 1067, 1088]

        CSD MT 94, bit of 1088 is 0      always, by 1067
        I0      proximity, for homing    start of a set-point (position), run (velocity); halt
        I1      negative limit switch    "
        I2      positive limit switch    "             ON: free to move.  OFF: status bit 11, and a halt; then only back
        I3      touch probe              "
        I4      -                        -             no bit shows it

        CSD MT S4     bits 1, 0 of 1088: I0 is 1 the negative limit switch, 2 proximity        3: general-purpose
                      bits 3, 2          I1 is 1 the touch probe, 2 the positive limit switch  3: general-purpose

A limit switch to which nothing is wired is OFF. The touch probe keeps the first position of its edge until it is
disabled and enabled again. The index pulse, which it can take instead of I3, lasts one count of an encoder of 400.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import floor
from typing import TYPE_CHECKING

from barewire.codecs import Value
from barewire.devices.sim.csd_mt.axis import Event
from barewire.devices.sim.csd_mt.environment import REVOLUTION, Span
from barewire.devices.sim.csd_mt.shaft import EDGE
from barewire.devices.sim.motion.cia402_axis import POSITION, VELOCITY
from barewire.devices.sim.motion.trajectory import wrapped

if TYPE_CHECKING:
    from barewire.devices.sim.csd_mt.machine import CsdMt

PROXIMITY, NEGATIVE, POSITIVE, PROBE = 0, 1, 2, 3
"""The special functions, numbered as the inputs of a CSD MT 94 that have them."""

OF_AN_S4 = {PROXIMITY: (0, 2), NEGATIVE: (0, 1), POSITIVE: (1, 2), PROBE: (1, 1)}
"""The input that has a function, and the value of its two bits for that (table 21)."""

SHOW_STO = 0x80
"""Bit of Input Config (1088): bit 24 of Digital Input tells of Safe Torque Off."""

PULSE = REVOLUTION / 1600

ACTIVE, ON_INDEX, RISING, FALLING = 0x01, 0x04, 0x10, 0x20
"""Bits of Touch Probe Function (1066)."""

SAMPLED_RISING, SAMPLED_FALLING, BY_INDEX, LEVEL = 0x02, 0x04, 0x40, 0x80
"""Bits of Touch Probe Status (1018)."""


class Inputs:
    """I0 to I4 and the touch probe of one drive."""

    def __init__(self, drive: CsdMt) -> None:
        self.drive = drive
        self.levels = [self._level(wire) for wire in drive.environment.inputs]
        self._config = -1
        self._index: bool | None = None
        """The level of the index pulse while somebody waits for it."""
        self._sampled = 0
        store = drive.store
        store.measure("Digital Input", self.shown)
        store.measure("Touch Probe Status", self._probe_status)
        store.after("Touch Probe Function", self._probe_set)
        store.after("Control Word from I/O", lambda value: drive.axis.look_again())

    def reset(self) -> None:
        """Logic supply off and on."""
        self._config, self._sampled, self._index = -1, 0, None
        for name in ("Touch Probe Positive Value", "Touch Probe Negative Value"):
            self.drive.store[name] = 0

    # Levels

    def _level(self, wire: Span | bool) -> bool:
        if isinstance(wire, Span):
            return wire.low <= self.drive.shaft.position(self.drive.now) <= wire.high
        return wire

    def _input(self, function: int) -> int | None:
        """The input that has a special function now."""
        config = self.drive.store.whole("Input Config")
        if self.drive.environment.model == "94":
            return None if config >> function & 1 else function
        number, value = OF_AN_S4[function]
        return number if config >> 2 * number & 0b11 == value else None

    def _on(self, function: int) -> bool:
        number = self._input(function)
        return number is not None and self.levels[number]

    def _off(self, function: int) -> bool:
        number = self._input(function)
        return number is not None and not self.levels[number]

    @property
    def proximity(self) -> bool:
        """The home switch, if an input is the proximity input."""
        return self._on(PROXIMITY)

    @property
    def below_limit(self) -> bool:
        """Whether the negative limit switch is OFF, if there is one."""
        return self._off(NEGATIVE)

    @property
    def above_limit(self) -> bool:
        """Whether the positive limit switch is OFF, if there is one."""
        return self._off(POSITIVE)

    @property
    def limited(self) -> bool:
        """Status bit 11."""
        return self.below_limit or self.above_limit

    def shown(self) -> int:
        """Digital Input (1008): limits and proximity where configured, I0 to I3, Auto Sync at work, STO."""
        shown = self.levels[: 4 if self.drive.environment.model == "94" else 2]
        word = sum(level << 16 + number for number, level in enumerate(shown))
        word |= self._on(NEGATIVE) | self._on(POSITIVE) << 1 | self.proximity << 2
        tells = bool(self.drive.store.whole("Input Config") & SHOW_STO)
        return word | self.drive.shaft.closed_loop << 23 | (tells and self.drive.safe_torque_off) << 24

    # Start and halt by inputs (register 1067)

    def _start(self) -> tuple[int, bool] | None:
        """Which input starts a motion, and whether it is a relative one."""
        code = self.drive.store.whole("Control Word from I/O") & 0xF
        return ((code - 1) // 2, code % 2 == 0) if 1 <= code <= 8 else None

    def halts(self, mode: int) -> bool:
        """Whether an input holds the shaft: halt in profile position, a start input that is OFF in profile velocity."""
        start = self._start()
        if mode == VELOCITY:
            return start is not None and not self.levels[start[0]]
        code = self.drive.store.whole("Control Word from I/O") >> 4
        return mode == POSITION and code in (1, 3, 5, 7) and self.levels[(code - 1) // 2]

    # What happens by itself

    def events(self) -> Iterator[Event]:
        """Edges of the switches that the shaft passes, changed levels, changed meanings, the index pulse."""
        now = self.drive.now
        if self._config != self.drive.store.whole("Input Config"):
            yield now, self._configured
        for number, (wire, on) in enumerate(zip(self.drive.environment.inputs, self.levels)):
            if isinstance(wire, Span):
                yield self._passes(wire, on), partial(self._changes, number, not on)
            elif bool(wire) != on:
                yield now, partial(self._changes, number, bool(wire))
        if self._waits_for_index():
            yield from self._index_events()
        else:
            self._index = None

    def _passes(self, span: Span, on: bool) -> float:
        """When the shaft enters a span that it is outside of, or leaves the one that it is in."""
        now, shaft = self.drive.now, self.drive.shaft
        if on:
            return min(shaft.first(now, span.low - EDGE, rising=False), shaft.first(now, span.high + EDGE, rising=True))
        if shaft.position(now) < span.low + EDGE:
            return shaft.first(now, span.low + EDGE, rising=True)
        return shaft.first(now, span.high - EDGE, rising=False)

    def _configured(self) -> None:
        self._config = self.drive.store.whole("Input Config")
        self.drive.axis.look_again()

    def _changes(self, number: int, on: bool) -> None:
        self.levels[number] = on
        axis = self.drive.axis
        if number == self._input(PROXIMITY):
            axis.tell_search("on" if on else "off")
        if number == self._input(PROBE) and not self._function & ON_INDEX:
            self._sample(on)
        start = self._start()
        if start is not None and number == start[0]:
            axis.start(relative=start[1]) if on else axis.start_falls()
        axis.look_again()

    # Index pulse

    def _waits_for_index(self) -> bool:
        search = self.drive.axis.search
        if not self.drive.shaft.has_encoder or not self.drive.environment.encoder:
            return False
        probes = self._function & (ACTIVE | ON_INDEX) == ACTIVE | ON_INDEX and not self._sampled
        return probes or (search is not None and search.waits_for == "index")

    def _pulse(self, ahead: int = 0) -> Span:
        """The index pulse at or before the shaft, or so many further on."""
        index = self.drive.environment.index
        turn = floor((self.drive.shaft.position(self.drive.now) + EDGE - index) / REVOLUTION) + ahead
        return Span(index + turn * REVOLUTION, index + turn * REVOLUTION + PULSE)

    def _index_events(self) -> Iterator[Event]:
        place = self.drive.shaft.position(self.drive.now)
        if self._index is None:
            self._index = self._pulse().low <= place <= self._pulse().high
        pulses = (self._pulse(),) if self._index else (self._pulse(-1), self._pulse(), self._pulse(1))
        yield min(self._passes(pulse, self._index) for pulse in pulses), self._index_changes

    def _index_changes(self) -> None:
        self._index = not self._index
        if self._index:
            self.drive.axis.tell_search("index")
        if self._function & ON_INDEX:
            self._sample(self._index)

    # Touch probe

    @property
    def _function(self) -> int:
        return self.drive.store.whole("Touch Probe Function")

    def _probe_set(self, value: Value) -> None:
        if not int(value) & ACTIVE:
            self.reset()

    def _sample(self, on: bool) -> None:
        wanted, bit = (RISING, SAMPLED_RISING) if on else (FALLING, SAMPLED_FALLING)
        if self._function & ACTIVE and self._function & wanted and not self._sampled & bit:
            self._sampled |= bit
            name = "Touch Probe Positive Value" if on else "Touch Probe Negative Value"
            self.drive.store[name] = wrapped(self.drive.shaft.shown())

    def _probe_status(self) -> int:
        function = self._function
        if not function & ACTIVE:
            return 0
        if function & ON_INDEX:
            pulse = self._pulse()
            level = pulse.low <= self.drive.shaft.position(self.drive.now) <= pulse.high
        else:
            level = self._on(PROBE)
        return ACTIVE | self._sampled | (function & ON_INDEX) << 4 | LEVEL * level
