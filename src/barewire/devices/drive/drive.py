"""ONE drive code: CiA 402 over any wire, for every drive whose description has a table [drive].

    drive = Drive(ModbusAccess(bus, 1, load("csd-mt")), load("csd-mt"))       or CanopenAccess(Channel(1), load("az3"))

    enable        switch on disabled -> ready to switch on -> switched on -> operation enabled
    disable       whatever it does, the current goes off; a motor that turns coasts
    quick_stop    the brake ramp, first the word and then a look
    reset         fault -> switch on disabled, by the edge of bit 7
    move          set-point: bit 4 up, the drive says bit 12, bit 4 down, then it says bit 10, target reached
    velocity      ramps to a velocity; it says bit 10; it goes on turning
    home          bit 4 up; it says bits 12 and 10, or 13 for an error

Each is a conversation that ends with the last `Look`, or with `DriveStuck`, which says in which state and why. Whoever
wants to follow gives `progress`, a function that is called with a `Progress` after every look. A fault is never
reset on the way: somebody must have seen it. A target that is reached is taken for ours only if mode, target and
control word are still what was written: another master's halt says "reached" too.

Conversations over Modbus carry bytes, over CANopen frames; here nobody asks which.

I know: states, modes, hand-shakes.  I never know: registers, objects, clocks. Time is what `rest` returns.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from math import isclose, isfinite
from typing import TypeVar

from barewire.codecs import Value
from barewire.conversation import Conversation
from barewire.devices.drive.cia402 import DriveCommand, State
from barewire.devices.drive.report import LIMITED, MODE_BIT, MODE_ERROR, REACHED, Look
from barewire.devices.drive.states import DriveStates, seconds
from barewire.devices.parameter import Parameter, show
from barewire.devices.request_checks import sendable
from barewire.errors import EncodeError, Refused

Item = TypeVar("Item")

ENABLED = int(DriveCommand.ENABLE_OPERATION)
NEW_SET_POINT, IMMEDIATELY, RELATIVE, HALT = 0x10, 0x20, 0x40, 0x100
DEFINED = 0x01FF
"""The bits of the control word that CiA 402 gives a meaning in these modes."""

_AT_ONCE = float("-inf")


class Drive(DriveStates[Item]):
    """One drive: its states, and its motion."""

    def move(
        self,
        target: int | float,
        *,
        relative: bool = False,
        immediately: bool = False,
        velocity: int | float | None = None,
        acceleration: int | float | None = None,
        deceleration: int | float | None = None,
        within: float = 60.0,
    ) -> Conversation[Item, Look]:
        """Profile position: to `target`, or by `target` if `relative`, in the drive's units; enables the drive first.

        `immediately` replaces a movement that is under way; otherwise the drive takes the set-point when it stands.
        What is not given of the profile stays as it is in the drive. Raises EncodeError at once for a value out of
        range or a part that the description lacks.
        """
        values = {"profile_velocity": velocity, "acceleration": acceleration, "deceleration": deceleration}
        settings = self._settings("move", "position", {**values, "target_position": target}, within)
        set_point = ENABLED | (RELATIVE if relative else 0) | (IMMEDIATELY if immediately else 0)
        return self._move(settings, set_point, target, within)

    def _move(
        self, settings: Mapping[str, Value], set_point: int, target: float, within: float
    ) -> Conversation[Item, Look]:
        begun = yield from self._prepare("move", settings, within)
        yield from self._command(set_point)
        ready, taken = "bit 12 to fall (set-point acknowledge)", "bit 12 to rise (set-point acknowledge)"
        yield from self._until("move", ready, lambda look: not look.has(MODE_BIT), self.timeout)
        yield from self._command(set_point | NEW_SET_POINT)
        yield from self._until("move", taken, lambda look: look.has(MODE_BIT), self.timeout)
        yield from self._command(set_point)
        look = yield from self._until("move", "target reached", lambda look: look.has(REACHED), within)
        goal = target + float(begun.position or 0) if set_point & RELATIVE else target
        if look.has(LIMITED) and look.position is not None and look.position != goal:
            raise (yield from self._stuck("move", "target reached", None, look, [f"position {show(look.position)}"]))
        return (yield from self._still_ours("move", "target reached", settings, look))

    def velocity(
        self,
        target: int | float,
        *,
        acceleration: int | float | None = None,
        deceleration: int | float | None = None,
        within: float = 60.0,
    ) -> Conversation[Item, Look]:
        """Profile velocity: enables the drive, ramps to `target` and leaves it turning; 0 stops it on its ramp.

        Reached is what the drive calls so: some have a wide velocity window.
        """
        values = {"acceleration": acceleration, "deceleration": deceleration, "target_velocity": target}
        return self._velocity(self._settings("velocity", "velocity", values, within), target, within)

    def _velocity(self, settings: Mapping[str, Value], target: float, within: float) -> Conversation[Item, Look]:
        look = yield from self._prepare("velocity", settings, within)
        yield from self._command(ENABLED)  # takes a halt away
        # A drive that turned already says "reached" until it has seen the new target.
        yield from self.access.rest(look.now + self.period)

        def reached(look: Look) -> bool:
            # A limit switch holds the shaft, and the drive says that standing is what is wanted now.
            held = look.has(LIMITED) and target and look.velocity is not None and float(look.velocity) * target <= 0
            return look.has(REACHED) and not held

        look = yield from self._until("velocity", "target reached", reached, within)
        return (yield from self._still_ours("velocity", "target reached", settings, look))

    def home(self, method: int | None = None, *, within: float = 60.0) -> Conversation[Item, Look]:
        """Homing, with the method that is set in the drive or the one given; enables the drive first."""
        settings = self._settings("home", "homing", {"homing_method": method}, within)
        if method is not None:
            self._known_method(self.device.find(self.parts.homing_method), method)
        return self._home(settings, within)

    def _known_method(self, parameter: Parameter, method: Value) -> None:
        """A search by a method that is none would be waited for in vain."""
        if parameter.values and method not in parameter.values:
            known = ", ".join(map(str, parameter.values))
            raise EncodeError(f"home: {parameter.name} {show(method)} is no method: expected one of {known}")

    def _home(self, settings: Mapping[str, Value], within: float) -> Conversation[Item, Look]:
        name = self.parts.homing_method
        if name and name not in settings and self.device.find(name).readable:
            (method,) = yield from self.access.read([name])
            self._known_method(method.parameter, method.value)
        yield from self._prepare("home", settings, within)
        yield from self._command(ENABLED)
        yield from self._command(ENABLED | NEW_SET_POINT)
        # Bit 12 may be that of the last homing until the drive begins.
        yield from self.access.rest((yield from self.access.rest(_AT_ONCE)) + self.period)

        def ended(look: Look) -> bool:
            return look.has(MODE_ERROR) or (look.has(MODE_BIT) and look.has(REACHED))

        look = yield from self._until("home", "homing attained (bits 12 and 10)", ended, within)
        if look.has(MODE_ERROR):
            raise (yield from self._stuck("home", "homing attained, but the drive says homing error (13)", None, look))
        yield from self._still_ours("home", "homing attained", settings, look)
        yield from self._command(ENABLED)
        return look

    def _still_ours(
        self, action: str, waiting_for: str, settings: Mapping[str, Value], look: Look
    ) -> Conversation[Item, Look]:
        """A following error, and a halt by somebody else, in another mode or for another target, say "reached" too."""
        if look.has(MODE_ERROR) and action != "home":
            raise (yield from self._stuck(action, waiting_for, None, look, ["a following error, bit 13"]))
        parts = (self.parts.mode, self.parts.target_position, self.parts.target_velocity)
        wanted = {name: value for name, value in settings.items() if name in parts}
        wanted[self.parts.control_word] = self.control or 0
        readable = [name for name in wanted if self.device.find(name).readable]
        changed, found = [], []
        if readable:
            with suppress(Refused):  # a drive that does not show its commands is believed
                found = yield from self.access.read(readable)
        for reading in found:
            if reading.name == self.parts.control_word:
                if (int(reading.value) ^ int(wanted[reading.name])) & DEFINED:
                    changed.append(f"somebody else wrote {reading.name} {int(reading.value):04X}h")
            elif not isclose(float(reading.value), float(wanted[reading.name]), rel_tol=1e-6):  # an f32 rounds
                changed.append(f"somebody else wrote {reading.name} {show(reading.value)}")
        if changed:
            raise (yield from self._stuck(action, waiting_for, None, look, changed))
        return look

    def _settings(
        self, action: str, mode: str, values: Mapping[str, int | float | None], within: float
    ) -> dict[str, Value]:
        """What is to be written, the mode first, by name and checked; EncodeError before anything is sent."""
        seconds("within", within)
        if mode not in self.parts.modes:
            raise EncodeError(f"{action}: the description of {self.device.name} has no {mode!r} in modes of [drive]")
        settings: dict[str, Value] = {self.parts.mode: self.parts.modes[mode]}
        for part, value in values.items():
            if value is None:
                continue
            name = getattr(self.parts, part)
            if not name:
                raise EncodeError(f"{action}: the description of {self.device.name} names no {part} in [drive]")
            sendable(self.device.find(name), value)
            if not isfinite(value):  # a float without a range could carry it, and nobody knows where that is
                raise EncodeError(f"{name} = {show(value)}: expected a number with an end", name)
            settings[name] = value
        return settings

    def _prepare(self, action: str, settings: Mapping[str, Value], within: float) -> Conversation[Item, Look]:
        """Mode and values, then enabled. Between two modes the shaft is halted, so that nothing runs on by mistake."""
        (mode,) = yield from self.access.read([self.parts.mode])
        look = yield from self.look(action, "the mode")
        wanted = settings[self.parts.mode]
        halted = look.state is State.OPERATION_ENABLED and mode.value != wanted
        if halted:
            yield from self._command(ENABLED | HALT)
            yield from self._until(action, "standstill (halt)", lambda look: look.has(REACHED), within)
        yield from self.access.write(settings)
        if halted:  # in the new mode too: in profile velocity, slow enough counts as standing
            yield from self._until(action, "standstill (halt)", lambda look: look.has(REACHED), within)
        look = yield from self._enable(action)
        if self.parts.mode_display:
            shown = f"mode {show(wanted)} in {self.parts.mode_display}"
            look = yield from self._until(action, shown, lambda look: look.mode == wanted, self.timeout)
        return look
