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
reset on the way: somebody must have seen it.

Conversations over Modbus carry bytes, over CANopen frames; here nobody asks which.

I know: states, modes, hand-shakes.  I never know: registers, objects, clocks. Time is what `rest` returns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Generic, TypeVar

from barewire.codecs import Value
from barewire.conversation import Conversation
from barewire.devices.cia402 import Command, State, next_control_word
from barewire.devices.device import Device, DriveSide
from barewire.devices.drive_access import Access
from barewire.devices.drive_report import (
    FAULTED,
    MODE_BIT,
    MODE_ERROR,
    REACHED,
    SWITCHED_OFF,
    DriveStuck,
    Look,
    Progress,
    stuck,
)
from barewire.devices.parameter import Reading, show
from barewire.errors import BarewireError, EncodeError

Item = TypeVar("Item")

ENABLED = int(Command.ENABLE_OPERATION)
NEW_SET_POINT, IMMEDIATELY, RELATIVE, HALT = 0x10, 0x20, 0x40, 0x100
WATCHED = ("status_word", "mode_display", "position", "velocity")
_AT_ONCE = float("-inf")


class Drive(Generic[Item]):
    """One drive. `timeout` is how long each step may take, `period` the seconds between two looks at it."""

    def __init__(
        self,
        access: Access[Item],
        device: Device,
        *,
        timeout: float = 3.0,
        period: float = 0.02,
        progress: Callable[[Progress], None] | None = None,
    ) -> None:
        if device.drive is None:
            raise EncodeError(f"{device.name} is no drive: its description has no table [drive]")
        self.access = access
        self.device = device
        self.parts: DriveSide = device.drive
        self.timeout = timeout
        self.period = period
        self.progress = progress
        self.control: int | None = None
        """The last control word that was written."""
        self._watched = {part: name for part in WATCHED if (name := getattr(self.parts, part))}

    # Looking

    def look(self, action: str = "status", waiting_for: str = "") -> Conversation[Item, Look]:
        """What the drive says now."""
        readings = yield from self.access.read(list(self._watched.values()))
        now = yield from self.access.rest(_AT_ONCE)
        said = dict(zip(self._watched, (reading.value for reading in readings)))
        look = Look(now, int(said["status_word"]), said.get("mode_display"), said.get("position"), said.get("velocity"))
        if self.progress is not None:
            self.progress(Progress(action, waiting_for, look))
        return look

    def _until(
        self, action: str, waiting_for: str, there: Callable[[Look], bool], within: float, *, enabled: bool = True
    ) -> Conversation[Item, Look]:
        """Look until it is so. While `enabled` has to stay, leaving operation enabled ends the waiting."""
        began: float | None = None
        while True:
            look = yield from self.look(action, waiting_for)
            began = look.now if began is None else began
            lost = enabled and look.state not in (State.OPERATION_ENABLED, None)
            if not lost and there(look):
                return look
            if lost or look.now >= began + within:
                raise (yield from self._stuck(action, waiting_for, None if lost else within, look))
            yield from self.access.rest(min(look.now + self.period, began + within))

    def _stuck(self, action: str, waiting_for: str, waited: float | None, look: Look) -> Conversation[Item, DriveStuck]:
        error: Reading | None = None
        if self.parts.error_code:
            with suppress(BarewireError):  # what is known already is worth more than why this question failed
                (error,) = yield from self.access.read([self.parts.error_code])
        return stuck(action, waiting_for, waited, look, self.control, error)

    # States

    def _command(self, word: int) -> Conversation[Item, None]:
        yield from self.access.write({self.parts.control_word: word})
        self.control = word

    def _go(self, action: str, goal: State) -> Conversation[Item, Look]:
        """Command after command until the drive is at its goal. A command that had no effect is repeated.

        Where the current is to be off, a fault is as good: it has switched it off.
        """
        waiting_for = f"{goal.value!r}"
        began: float | None = None
        before: State | None = None
        while True:
            look = yield from self.look(action, waiting_for)
            began = look.now if began is None else began
            if look.state is goal or (look.state is State.FAULT and goal is State.SWITCH_ON_DISABLED):
                return look
            if look.state is State.FAULT:
                raise (yield from self._stuck(action, waiting_for, None, look))
            if look.now >= began + self.timeout:
                raise (yield from self._stuck(action, waiting_for, self.timeout, look))
            if look.state is before:
                yield from self.access.rest(min(look.now + self.period, began + self.timeout))
            before = look.state
            if look.state is not None:
                word = next_control_word(look.state, goal, stays_in_quick_stop=self.parts.stays_in_quick_stop)
                if word is not None:
                    yield from self._command(word)

    def enable(self) -> Conversation[Item, Look]:
        """To operation enabled, and then the pause that the motor needs."""
        return self._enable("enable")

    def _enable(self, action: str) -> Conversation[Item, Look]:
        look = yield from self.look(action, f"{State.OPERATION_ENABLED.value!r}")
        if look.state is State.OPERATION_ENABLED:
            return look
        look = yield from self._go(action, State.OPERATION_ENABLED)
        yield from self.access.rest(look.now + self.parts.settle)
        return (yield from self.look(action, "the motor to settle"))

    def disable(self) -> Conversation[Item, Look]:
        """Current off. A drive with a fault has it off already, and stays in its fault."""
        return self._go("disable", State.SWITCH_ON_DISABLED)

    def quick_stop(self, *, within: float = 30.0) -> Conversation[Item, Look]:
        """Brake on the quick stop ramp, and wait until the shaft stands or the current is off."""
        yield from self._command(int(Command.QUICK_STOP))

        def stands(look: Look) -> bool:
            if look.state is State.QUICK_STOP_ACTIVE:
                return self.parts.stays_in_quick_stop and look.has(REACHED)
            return look.state not in (State.OPERATION_ENABLED, State.FAULT_REACTION_ACTIVE, None)

        return (yield from self._until("quick stop", "standstill", stands, within, enabled=False))

    def reset(self) -> Conversation[Item, Look]:
        """Out of a fault. The edge is given again until it is taken: a cause may need its time to go."""

        def off(look: Look) -> bool:
            return look.state not in (*FAULTED, None)

        look = yield from self.look("reset", SWITCHED_OFF)
        began = look.now
        while not off(look):
            if look.now >= began + self.timeout:
                raise (yield from self._stuck("reset", SWITCHED_OFF, self.timeout, look))
            if look.state is State.FAULT:
                yield from self._command(int(Command.DISABLE_VOLTAGE))
                yield from self._command(int(Command.FAULT_RESET))
            look = yield from self.look("reset", SWITCHED_OFF)
            if not off(look):
                yield from self.access.rest(min(look.now + self.period, began + self.timeout))
        if self.control == Command.FAULT_RESET:
            yield from self._command(int(Command.DISABLE_VOLTAGE))
        return look

    # Motion

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
        settings = self._settings("move", "position", {**values, "target_position": target})
        set_point = ENABLED | (RELATIVE if relative else 0) | (IMMEDIATELY if immediately else 0)
        return self._move(settings, set_point, within)

    def _move(self, settings: Mapping[str, Value], set_point: int, within: float) -> Conversation[Item, Look]:
        yield from self._prepare("move", settings, within)
        yield from self._command(set_point)
        ready, taken = "bit 12 to fall (set-point acknowledge)", "bit 12 to rise (set-point acknowledge)"
        yield from self._until("move", ready, lambda look: not look.has(MODE_BIT), self.timeout)
        yield from self._command(set_point | NEW_SET_POINT)
        yield from self._until("move", taken, lambda look: look.has(MODE_BIT), self.timeout)
        yield from self._command(set_point)
        return (yield from self._until("move", "target reached", lambda look: look.has(REACHED), within))

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
        return self._velocity(self._settings("velocity", "velocity", values), within)

    def _velocity(self, settings: Mapping[str, Value], within: float) -> Conversation[Item, Look]:
        look = yield from self._prepare("velocity", settings, within)
        yield from self._command(ENABLED)  # takes a halt away
        # A drive that turned already says "reached" until it has seen the new target.
        yield from self.access.rest(look.now + self.period)
        return (yield from self._until("velocity", "target reached", lambda look: look.has(REACHED), within))

    def home(self, method: int | None = None, *, within: float = 60.0) -> Conversation[Item, Look]:
        """Homing, with the method that is set in the drive or the one given; enables the drive first."""
        return self._home(self._settings("home", "homing", {"homing_method": method}), within)

    def _home(self, settings: Mapping[str, Value], within: float) -> Conversation[Item, Look]:
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
        yield from self._command(ENABLED)
        return look

    def _settings(self, action: str, mode: str, values: Mapping[str, int | float | None]) -> dict[str, Value]:
        """What is to be written, the mode first, by name and checked; EncodeError before anything is sent."""
        if mode not in self.parts.modes:
            raise EncodeError(f"{action}: the description of {self.device.name} has no {mode!r} in modes of [drive]")
        settings: dict[str, Value] = {self.parts.mode: self.parts.modes[mode]}
        for part, value in values.items():
            if value is None:
                continue
            name = getattr(self.parts, part)
            if not name:
                raise EncodeError(f"{action}: the description of {self.device.name} names no {part} in [drive]")
            self.device.find(name).to_raw(value)
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
