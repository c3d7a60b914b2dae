"""The inputs of a CSD MT: their meanings, and their edges.            [CSD MT manual, registers 1008, 1066, 1067, 1088]

        CSD MT 94, bit of 1088 is 0      always, by 1067
        I0      proximity, for homing    start of a set-point (position), run (velocity); halt
        I1      negative limit switch    "
        I2      positive limit switch    "             ON: free to move.  OFF: status bit 11, and a halt; then only back
        I3      touch probe              "
        I4      -                        -             no bit shows it

        CSD MT S4     bits 1, 0 of 1088: I0 is 1 the negative limit switch, 2 proximity        3: general-purpose
                      bits 3, 2          I1 is 1 the touch probe, 2 the positive limit switch  3: general-purpose

A limit switch that is configured and not wired is OFF.

Edges come from the wiring, from switches that the shaft passes, and from the index pulse:

        shaft, wiring --> edge --> level of the input --> homing, start, halt, limits (axis)
                                                     '--> touch probe

The touch probe keeps the first position of its edge until it is disabled and enabled again (registers 1066, 1018). It
can take the index pulse instead of I3. The pulse lasts one count of an encoder of 400.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import floor
from typing import Literal, NamedTuple, Protocol

from barewire.codecs import Value
from barewire.devices.sim.cia402_axis import POSITION, VELOCITY
from barewire.devices.sim.csd_mt.environment import REVOLUTION, Context, Span, TimedAction
from barewire.devices.sim.csd_mt.shaft import EDGE, Shaft
from barewire.devices.sim.trajectory import wrapped

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
        """The present levels; `Edges` keeps them up to date."""
        self.store.measure("Digital Input", self.shown)

    def input_of(self, function: int) -> int | None:
        """Return the number of the input that has a special function now; None if no input has it."""
        config = self.store.integer("Input Config")
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
        shows_sto = bool(self.store.integer("Input Config") & _SHOW_STO)
        return word | self.shaft.closed_loop << 23 | (shows_sto and environment.safe_torque_off) << 24

    # Start and halt by inputs (register 1067)

    @property
    def start_input(self) -> StartInput | None:
        """The input that starts a motion; None if no input does."""
        code = self.store.integer("Control Word from I/O") & 0xF
        return StartInput((code - 1) // 2, code % 2 == 0) if 1 <= code <= 8 else None

    def halts(self, mode: int) -> bool:
        """Return whether an input holds the shaft: halt in profile position, a start input that is OFF in velocity."""
        if mode == VELOCITY:
            start = self.start_input
            return start is not None and not self.levels[start.number]
        code = self.store.integer("Control Word from I/O") >> 4
        return mode == POSITION and code in (1, 3, 5, 7) and self.levels[(code - 1) // 2]


_PULSE = REVOLUTION / 1600

_ACTIVE, _ON_INDEX, _RISING, _FALLING = 0x01, 0x04, 0x10, 0x20
"""Bits of Touch Probe Function (1066)."""

_SAMPLED_RISING, _SAMPLED_FALLING, _LEVEL = 0x02, 0x04, 0x80
"""Bits of Touch Probe Status (1018); bit 6 shows that the index pulse is used."""


Sign = Literal["on", "off", "index", "impact", "rest"]
"""What ends a movement of a homing run: an edge of the home switch, an index pulse, a mechanical stop, standstill."""


class InputFollower(Protocol):
    """The part of an axis that acts on the inputs."""

    awaits: Sign | None
    """The sign that a homing run waits for."""

    def inputs_changed(self) -> None:
        """Apply halts and limits."""

    def start(self, *, relative: bool) -> None:
        """Act on a start input that became ON."""

    def start_falls(self) -> None:
        """Act on a start input that became OFF."""

    def continue_search(self, sign: Sign) -> None:
        """Go on with a homing run that waits for this sign."""


class Edges:
    """Detects the edges of the inputs and of the index pulse, and passes them on."""

    def __init__(self, context: Context, shaft: Shaft, inputs: Inputs, axis: InputFollower) -> None:
        self.context, self.store, self.shaft, self.inputs, self.axis = context, context.store, shaft, inputs, axis
        self._config = -1
        self._index: bool | None = None
        """The level of the index pulse; None while it is not used."""
        self._sampled = 0
        self.store.measure("Touch Probe Status", self._probe_status)
        self.store.after("Touch Probe Function", self._probe_set)
        self.store.after("Control Word from I/O", lambda value: axis.inputs_changed())

    def restart(self) -> None:
        """Restart as at power-on of the logic; a disabled touch probe restarts too."""
        self._config, self._sampled, self._index = -1, 0, None
        for name in ("Touch Probe Positive Value", "Touch Probe Negative Value"):
            self.store[name] = 0

    def events(self) -> Iterator[TimedAction]:
        """Yield edges of the switches that the shaft passes, changed levels, changed meanings, and the index pulse."""
        now = self.context.now
        if self._config != self.store.integer("Input Config"):
            yield now, self._configured
        for number, (wire, on) in enumerate(zip(self.context.environment.inputs, self.inputs.levels)):
            if isinstance(wire, Span):
                yield self._passes(wire, on), partial(self._changes, number, not on)
            elif bool(wire) != on:
                yield now, partial(self._changes, number, bool(wire))
        if self._waits_for_index():
            yield from self._index_events()
        else:
            self._index = None

    def _passes(self, span: Span, on: bool) -> float:
        """Return when the shaft enters a span, or leaves it if it is inside."""
        now, shaft = self.context.now, self.shaft
        if on:
            return min(shaft.first(now, span.low - EDGE, rising=False), shaft.first(now, span.high + EDGE, rising=True))
        if shaft.position(now) < span.low + EDGE:
            return shaft.first(now, span.low + EDGE, rising=True)
        return shaft.first(now, span.high - EDGE, rising=False)

    def _configured(self) -> None:
        self._config = self.store.integer("Input Config")
        self.axis.inputs_changed()

    def _changes(self, number: int, on: bool) -> None:
        inputs, axis = self.inputs, self.axis
        inputs.levels[number] = on
        if number == inputs.input_of(PROXIMITY):
            axis.continue_search("on" if on else "off")
        if number == inputs.input_of(PROBE) and not self._function & _ON_INDEX:
            self._sample(on)
        start = inputs.start_input
        if start is not None and number == start.number:
            axis.start(relative=start.relative) if on else axis.start_falls()
        axis.inputs_changed()

    # Index pulse

    def _waits_for_index(self) -> bool:
        if not self.shaft.has_encoder or not self.context.environment.encoder:
            return False
        probes = self._function & (_ACTIVE | _ON_INDEX) == _ACTIVE | _ON_INDEX and not self._sampled
        return probes or self.axis.awaits == "index"

    def _pulse(self, ahead: int = 0) -> Span:
        """Return the index pulse at or before the shaft, or the one `ahead` revolutions further on."""
        index = self.context.environment.index
        turn = floor((self.shaft.position(self.context.now) + EDGE - index) / REVOLUTION) + ahead
        return Span(index + turn * REVOLUTION, index + turn * REVOLUTION + _PULSE)

    def _index_events(self) -> Iterator[TimedAction]:
        if self._index is None:
            self._index = self._is_in_pulse()
        pulses = (self._pulse(),) if self._index else (self._pulse(-1), self._pulse(), self._pulse(1))
        yield min(self._passes(pulse, self._index) for pulse in pulses), self._index_changes

    def _is_in_pulse(self) -> bool:
        pulse = self._pulse()
        return pulse.low <= self.shaft.position(self.context.now) <= pulse.high

    def _index_changes(self) -> None:
        self._index = not self._index
        if self._index:
            self.axis.continue_search("index")
        if self._function & _ON_INDEX:
            self._sample(self._index)

    # Touch probe

    @property
    def _function(self) -> int:
        return self.store.integer("Touch Probe Function")

    def _probe_set(self, value: Value) -> None:
        if not int(value) & _ACTIVE:
            self.restart()

    def _sample(self, on: bool) -> None:
        edge, bit = (_RISING, _SAMPLED_RISING) if on else (_FALLING, _SAMPLED_FALLING)
        if self._function & _ACTIVE and self._function & edge and not self._sampled & bit:
            self._sampled |= bit
            name = "Touch Probe Positive Value" if on else "Touch Probe Negative Value"
            self.store[name] = wrapped(self.shaft.shown_position())

    def _probe_status(self) -> int:
        function = self._function
        if not function & _ACTIVE:
            return 0
        level = self._is_in_pulse() if function & _ON_INDEX else self.inputs.is_on(PROBE)
        return _ACTIVE | self._sampled | (function & _ON_INDEX) << 4 | _LEVEL * level
