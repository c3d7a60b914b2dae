"""Edges at the inputs of a CSD MT: switches that the shaft passes, the index pulse, the touch probe.

        shaft, wiring --> edge --> level of the input --> homing, start, halt, limits (axis)
                                                     '--> touch probe

The touch probe keeps the first position of its edge until it is disabled and enabled again (registers 1066, 1018). It
can take the index pulse instead of I3. The pulse lasts one count of an encoder of 400.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import floor

from barewire.codecs import Value
from barewire.devices.sim.csd_mt.axis import StepperAxis
from barewire.devices.sim.csd_mt.context import Context, TimedAction
from barewire.devices.sim.csd_mt.environment import REVOLUTION, Span
from barewire.devices.sim.csd_mt.inputs import PROBE, PROXIMITY, Inputs
from barewire.devices.sim.csd_mt.shaft import EDGE, Shaft
from barewire.devices.sim.motion.trajectory import wrapped

_PULSE = REVOLUTION / 1600

_ACTIVE, _ON_INDEX, _RISING, _FALLING = 0x01, 0x04, 0x10, 0x20
"""Bits of Touch Probe Function (1066)."""

_SAMPLED_RISING, _SAMPLED_FALLING, _LEVEL = 0x02, 0x04, 0x80
"""Bits of Touch Probe Status (1018); bit 6 shows that the index pulse is used."""


class Edges:
    """Detects the edges of the inputs and of the index pulse, and passes them on."""

    def __init__(self, context: Context, shaft: Shaft, inputs: Inputs, axis: StepperAxis) -> None:
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
        if self._config != self.store.whole("Input Config"):
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
        self._config = self.store.whole("Input Config")
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
        return self.store.whole("Touch Probe Function")

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
