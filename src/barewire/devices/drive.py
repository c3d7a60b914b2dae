"""Moves any drive of CiA 402 whose description has a table [drive], over any bus.

    drive = Drive(ModbusAccess(bus, 1, load("csd-mt")), load("csd-mt"))       or CanopenAccess(Channel(1), load("az3"))

    switch on disabled --06h--> ready to switch on --07h--> switched on --0Fh--> operation enabled
           ^                                                                        |       | 02h
           '------------------------------- 00h ------------------------------------'   quick stop active
    fault --00h, 80h: an edge of bit 7--> switch on disabled

    enable        to operation enabled                   move          set-point: bit 4 up, wait for bit 12, bit 4 down,
    disable       current off; a turning motor coasts                  wait for bit 10, target reached
    quick_stop    the brake ramp                         velocity      wait for bit 10; the motor goes on turning
    reset         fault -> switch on disabled            home          bit 4 up, wait for bits 12 and 10; 13 is an error

Each is a conversation that returns the last `DriveStatus`, or raises `DriveStuck` with the state and the reasons.
`progress`, if given, is called with a `DriveProgress` after every reading. Only `reset` resets a fault; all others
report it. "Target reached" is a success only if mode, target and control word are still the written ones: after a halt
by another master the drive reports "reached" too. A movement switches the current on only with `enable=True`.

The error of a drive that does not reach its goal:

    move: stuck in 'ready to switch on' after 3 s, waiting for 'operation enabled': no high voltage, bit 4 (voltage
    enabled) is off; status word 0221h: ready to switch on, quick stop, remote; last control word 0007h
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from math import isclose, isfinite
from typing import Any, Generic, NamedTuple, Protocol

from barewire.codecs import Value, codec
from barewire.conversation import Conversation, Item
from barewire.devices.cia402 import (
    FAULT_STATES,
    HALT,
    IMMEDIATELY,
    LIMITED,
    MODE_BIT,
    MODE_ERROR,
    NEW_SET_POINT,
    REACHED,
    RELATIVE,
    REMOTE,
    STATUS_BITS,
    VOLTAGE_ENABLED,
    DriveCommand,
    State,
    next_control_word,
    state_of,
)
from barewire.devices.device import Device, drive_roles
from barewire.devices.parameter import Parameter, Reading, show
from barewire.devices.request_checks import naming
from barewire.errors import BarewireError, DecodeError, EncodeError, Refused

_ENABLED = int(DriveCommand.ENABLE_OPERATION)
_READ_ROLES = ("status_word", "mode_display", "position", "velocity")
_ZERO_STOPS = {
    "move": ("profile_velocity", "acceleration"),
    "velocity": ("acceleration",),
    "home": ("homing_speed_switch", "homing_speed_zero"),
}
"""Action -> the roles whose value 0 keeps the motor from turning."""

_NOW = float("-inf")
"""A time that is past: waiting until then only tells the present time."""

_MODES = {
    "move": ("position", "moved to a position"),
    "velocity": ("velocity", "turned at a velocity"),
    "home": ("homing", "homed"),
}
"""Movement -> its mode in the table [drive] of a description, and its words in an error."""

_DEFINED_BITS = 0x01FF
"""The bits of the control word that CiA 402 defines in these modes."""

_NOT_ENABLED = "the drive is not enabled: enable it first, or together with the movement (--enable, enable=True)"


class DriveStatus(NamedTuple):
    """The values read of a drive at one time (seconds). None where the description has no parameter in this role."""

    now: float
    status_word: int
    mode: Value | None = None
    position: Value | None = None
    velocity: Value | None = None

    def __repr__(self) -> str:
        values = (("mode", self.mode), ("position", self.position), ("velocity", self.velocity))
        shown = "".join(f", {name} {show(value)}" for name, value in values if value is not None)
        return f"<{type(self).__name__}: {self.state_name}, status word {self.status_word:04X}h{shown}>"

    @property
    def state(self) -> State | None:
        """The state; None for a word without a state, which a drive shows only during a transition."""
        try:
            return state_of(self.status_word)
        except DecodeError:
            return None

    @property
    def state_name(self) -> str:
        """The state in words."""
        return self.state.value if self.state else "no state of CiA 402"

    @property
    def is_limited(self) -> bool:
        """Whether a limit of the drive is active (bit 11): it does less than it was told to."""
        return self.has(LIMITED)

    def has(self, bit: int) -> bool:
        """Return whether a bit of the status word is set."""
        return bool(self.status_word >> bit & 1)


class DriveProgress(NamedTuple):
    """Reported after every reading of the drive: the action, the event it waits for, and the status."""

    action: str
    waiting_for: str
    status: DriveStatus

    def as_dict(self) -> dict[str, Any]:
        """Return the progress for JSON, with the status word as a number and its bits in words."""
        status = self.status
        return {
            "time": round(status.now, 3),
            "action": self.action,
            "waiting_for": self.waiting_for,
            "state": status.state_name,
            "status_word": status.status_word,
            "bits": bit_names(status.status_word),
            "mode": status.mode,
            "position": status.position,
            "velocity": status.velocity,
        }


class DriveStuck(BarewireError, TimeoutError):
    """The drive did not reach its goal in time, or cannot from its state. The text has the state and the reasons."""

    def __init__(self, text: str, status: DriveStatus, error: Reading | None) -> None:
        super().__init__(text)
        self.status = status
        self.error = error
        """The drive's error code, if it has one and it could be read."""


def bit_names(word: int) -> list[str]:
    """Return the named bits that are set.

    >>> bit_names(0x0221)
    ['ready to switch on', 'quick stop', 'remote']
    """
    return [name for bit, name in STATUS_BITS.items() if word >> bit & 1]


class _Motion(NamedTuple):
    """The values to write before a movement by name, the mode first; the longest time; whether to enable the drive."""

    settings: Mapping[str, Value]
    within: float
    enable: bool


class DriveAccess(Protocol[Item]):
    """The operations on a drive that `drive.py` uses."""

    def read(self, names: Sequence[str]) -> Conversation[Item, list[Reading]]:
        """Read values by name, in the order of `names`."""

    def write(self, values: Mapping[str, Value]) -> Conversation[Item, None]:
        """Write values by name, in their order."""

    def wait(self, until: float) -> Conversation[Item, float]:
        """Wait until this time, not at all if it is past; returns the present time."""


class Drive(Generic[Item]):
    """One drive. `timeout` (seconds) limits each step, `period` (seconds) is the pause between two readings."""

    def __init__(
        self,
        access: DriveAccess[Item],
        device: Device,
        *,
        timeout: float = 3.0,
        period: float = 0.02,
        progress: Callable[[DriveProgress], None] | None = None,
    ) -> None:
        self.access, self.device, self.roles = access, device, drive_roles(device)
        self.timeout, self.period = _check_seconds("timeout", timeout), _check_seconds("period", period)
        self.progress = progress
        self.control: int | None = None
        """The last control word that was written."""
        self._names = {role: name for role in _READ_ROLES if (name := getattr(self.roles, role))}

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.device.name}>"

    # States

    def status(self, action: str = "status", waiting_for: str = "") -> Conversation[Item, DriveStatus]:
        """Read status word, mode, position and velocity once."""
        readings = yield from self.access.read(list(self._names.values()))
        now = yield from self.access.wait(_NOW)
        values = dict(zip(self._names, (reading.parameter.shortened(reading.value) for reading in readings)))
        word, mode = int(values["status_word"]), values.get("mode_display")
        status = DriveStatus(now, word, mode, values.get("position"), values.get("velocity"))
        if self.progress is not None:
            self.progress(DriveProgress(action, waiting_for, status))
        return status

    def enable(self) -> Conversation[Item, DriveStatus]:
        """Bring the drive to operation enabled, and wait as long as the motor needs to settle."""
        return self._enable("enable")

    def disable(self) -> Conversation[Item, DriveStatus]:
        """Switch the current off. A drive with a fault has it off already, and stays in its fault."""
        return self._go("disable", State.SWITCH_ON_DISABLED)

    def quick_stop(self, *, within: float = 30.0) -> Conversation[Item, DriveStatus]:
        """Brake on the quick stop ramp, and wait (`within` seconds) until the shaft stands or the current is off."""
        _check_seconds("within", within)
        yield from self._command(int(DriveCommand.QUICK_STOP))

        def stands(status: DriveStatus) -> bool:
            if status.state is State.QUICK_STOP_ACTIVE:
                return self.roles.stays_in_quick_stop and status.has(REACHED)
            return status.state not in (State.OPERATION_ENABLED, State.FAULT_REACTION_ACTIVE, None)

        return (yield from self._until("quick stop", "standstill", stands, within, enabled=False))

    def reset(self) -> Conversation[Item, DriveStatus]:
        """Leave a fault. The edge of bit 7 is repeated until the drive accepts it: the cause may last for some time."""

        def is_reset(status: DriveStatus) -> bool:
            return status.state not in (*FAULT_STATES, None)

        waiting_for = f"{State.SWITCH_ON_DISABLED.value!r}"
        status = yield from self.status("reset")  # waits for nothing if there is no fault
        began = status.now
        while not is_reset(status):
            if status.now >= began + self.timeout:
                raise (yield from self._stuck("reset", waiting_for, self.timeout, status))
            if status.state is State.FAULT:
                yield from self._command(int(DriveCommand.DISABLE_VOLTAGE))
                yield from self._command(int(DriveCommand.FAULT_RESET))
            status = yield from self.status("reset", waiting_for)
            if not is_reset(status):
                yield from self.access.wait(min(status.now + self.period, began + self.timeout))
        if self.control == DriveCommand.FAULT_RESET:
            yield from self._command(int(DriveCommand.DISABLE_VOLTAGE))  # so that the next reset is an edge again
        return status

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
        enable: bool = False,
    ) -> Conversation[Item, DriveStatus]:
        """Move the enabled drive to `target` (profile position). All values are in the drive's units.

            enable          enable the drive first; otherwise it must be in operation enabled
            relative        move by `target` from the present position instead
            immediately     replace a movement under way; otherwise the drive begins this one at the end of that one
            velocity, acceleration, deceleration      the profile; without one, the value in the drive stays
            within          the longest time for the movement, in seconds

        Raises EncodeError at once for a value out of range or a role that the description does not have, and DriveStuck
        if the drive is not enabled, or the target is not reached in time.
        """
        values = {"profile_velocity": velocity, "acceleration": acceleration, "deceleration": deceleration}
        motion = self._motion("move", {**values, "target_position": target}, within, enable)
        set_point = _ENABLED | (RELATIVE if relative else 0) | (IMMEDIATELY if immediately else 0)
        return self._move(motion, set_point, target)

    def _move(self, motion: _Motion, set_point: int, target: float) -> Conversation[Item, DriveStatus]:
        before = yield from self._prepare("move", motion)
        # Bit 4 acts by its edge, and the drive acknowledges it by bit 12: both must be low at first.
        yield from self._command(set_point)
        low, high = "bit 12 to fall (set-point acknowledge)", "bit 12 to rise (set-point acknowledge)"
        yield from self._until("move", low, lambda status: not status.has(MODE_BIT), self.timeout)
        yield from self._command(set_point | NEW_SET_POINT)
        yield from self._until("move", high, lambda status: status.has(MODE_BIT), self.timeout)
        yield from self._command(set_point)
        status = yield from self._until("move", "target reached", lambda status: status.has(REACHED), motion.within)
        goal = target + float(before.position or 0) if set_point & RELATIVE else target
        if status.has(LIMITED) and status.position is not None and status.position != goal:
            raise (
                yield from self._stuck("move", "target reached", None, status, [f"position {show(status.position)}"])
            )
        return (yield from self._unchanged("move", "target reached", motion.settings, status))

    def velocity(
        self,
        target: int | float,
        *,
        acceleration: int | float | None = None,
        deceleration: int | float | None = None,
        within: float = 60.0,
        enable: bool = False,
    ) -> Conversation[Item, DriveStatus]:
        """Ramp the enabled drive to the velocity `target` and leave it turning (profile velocity); 0 stops it.

        The drive decides when the velocity is reached: some have a wide velocity window, and one with a limit below
        `target` reports it there, with bit 11 (`DriveStatus.is_limited`). The rest is as for `move`.
        """
        values = {"acceleration": acceleration, "deceleration": deceleration, "target_velocity": target}
        return self._velocity(self._motion("velocity", values, within, enable), target)

    def _velocity(self, motion: _Motion, target: float) -> Conversation[Item, DriveStatus]:
        status = yield from self._prepare("velocity", motion)
        yield from self._command(_ENABLED)  # ends a halt
        # A drive that turned already reports "reached" until it has accepted the new target.
        yield from self.access.wait(status.now + self.period)

        def reached(status: DriveStatus) -> bool:
            # A limit switch stops the shaft, and the drive then reports the standstill as the target.
            velocity = status.velocity
            blocked = status.has(LIMITED) and target and velocity is not None and float(velocity) * target <= 0
            return status.has(REACHED) and not blocked

        status = yield from self._until("velocity", "target reached", reached, motion.within)
        return (yield from self._unchanged("velocity", "target reached", motion.settings, status))

    def home(
        self, method: int | None = None, *, within: float = 60.0, enable: bool = False
    ) -> Conversation[Item, DriveStatus]:
        """Home the enabled drive with `method`, or with the one that is set in it. The rest is as for `move`."""
        motion = self._motion("home", {"homing_method": method}, within, enable)
        if method is not None:
            _check_homing_method(self.device.find(self.roles.homing_method), method)
        return self._home(motion)

    def _home(self, motion: _Motion) -> Conversation[Item, DriveStatus]:
        name = self.roles.homing_method
        if name and name not in motion.settings and self.device.find(name).readable:
            (method,) = yield from self.access.read([name])
            _check_homing_method(method.parameter, method.value)
        yield from self._prepare("home", motion)
        yield from self._command(_ENABLED)
        yield from self._command(_ENABLED | NEW_SET_POINT)
        # Bit 12 may be that of the last homing until the drive begins.
        yield from self.access.wait((yield from self.access.wait(_NOW)) + self.period)

        def ended(status: DriveStatus) -> bool:
            return status.has(MODE_ERROR) or (status.has(MODE_BIT) and status.has(REACHED))

        status = yield from self._until("home", "homing attained (bits 12 and 10)", ended, motion.within)
        if status.has(MODE_ERROR):
            failed = "homing attained, but the drive reports homing error (13)"
            raise (yield from self._stuck("home", failed, None, status))
        yield from self._unchanged("home", "homing attained", motion.settings, status)
        yield from self._command(_ENABLED)
        return status

    # Steps of these actions

    def _command(self, word: int) -> Conversation[Item, None]:
        yield from self.access.write({self.roles.control_word: word})
        self.control = word

    def _enable(self, action: str) -> Conversation[Item, DriveStatus]:
        status = yield from self.status(action, f"{State.OPERATION_ENABLED.value!r}")
        if status.state is State.OPERATION_ENABLED:
            return status
        status = yield from self._go(action, State.OPERATION_ENABLED)
        yield from self.access.wait(status.now + self.roles.settle)
        return (yield from self.status(action, "the motor to settle"))

    def _go(self, action: str, goal: State) -> Conversation[Item, DriveStatus]:
        """Send commands until the drive is in the state `goal`.

        Where the goal is current off, a fault counts as reached: the drive has switched it off.
        """
        waiting_for = f"{goal.value!r}"
        began: float | None = None
        before: State | None = None
        while True:
            status = yield from self.status(action, waiting_for)
            began = status.now if began is None else began
            if status.state is goal or (status.state is State.FAULT and goal is State.SWITCH_ON_DISABLED):
                return status
            if status.state is State.FAULT:
                raise (yield from self._stuck(action, waiting_for, None, status))
            if status.now >= began + self.timeout:
                raise (yield from self._stuck(action, waiting_for, self.timeout, status))
            if status.state is before:  # the command needs time, or had no effect and is repeated
                yield from self.access.wait(min(status.now + self.period, began + self.timeout))
            before = status.state
            if status.state is not None:
                word = next_control_word(status.state, goal, stays_in_quick_stop=self.roles.stays_in_quick_stop)
                if word is not None:
                    yield from self._command(word)

    def _until(
        self,
        action: str,
        waiting_for: str,
        is_done: Callable[[DriveStatus], bool],
        within: float,
        *,
        enabled: bool = True,
    ) -> Conversation[Item, DriveStatus]:
        """Read the drive until `is_done`. With `enabled`, leaving operation enabled ends the waiting with an error."""
        began: float | None = None
        while True:
            status = yield from self.status(action, waiting_for)
            began = status.now if began is None else began
            lost = enabled and status.state not in (State.OPERATION_ENABLED, None)
            if not lost and is_done(status):
                return status
            if lost or status.now >= began + within:
                raise (yield from self._stuck(action, waiting_for, None if lost else within, status))
            yield from self.access.wait(min(status.now + self.period, began + within))

    def _motion(self, action: str, values: Mapping[str, int | float | None], within: float, enable: bool) -> _Motion:
        """Return a movement with its values checked. Raises EncodeError before anything is sent."""
        _check_seconds("within", within)
        mode = check_mode(self.device, action)
        settings: dict[str, Value] = {self.roles.mode: self.roles.modes[mode]}
        for role, value in values.items():
            if value is None:
                continue
            name = getattr(self.roles, role)
            if not name:
                raise EncodeError(f"{action}: the description of {self.device.name} names no {role} in [drive]")
            _check_encodable(self.device.find(name), value)
            if not isfinite(value):  # an f32 without a range could carry it
                raise EncodeError(f"{name} = {show(value)}: expected a finite number", name)
            settings[name] = value
        return _Motion(settings, within, enable)

    def _prepare(self, action: str, motion: _Motion) -> Conversation[Item, DriveStatus]:
        """Write mode and values to a drive that is enabled, or will be. A change of mode halts the shaft first."""
        settings, within, enable = motion
        status = yield from self.status(action, "'operation enabled'")
        if not enable and status.state is not State.OPERATION_ENABLED:
            off = [] if status.state in FAULT_STATES else [_NOT_ENABLED]
            raise (yield from self._stuck(action, "'operation enabled'", None, status, off))
        (mode,) = yield from self.access.read([self.roles.mode])
        new_mode = settings[self.roles.mode]
        halted = status.state is State.OPERATION_ENABLED and mode.value != new_mode
        if halted:
            yield from self._command(_ENABLED | HALT)
            yield from self._until(action, "standstill (halt)", lambda status: status.has(REACHED), within)
        yield from self.access.write(settings)
        if halted:  # in the new mode too: in profile velocity, slow enough counts as standing
            yield from self._until(action, "standstill (halt)", lambda status: status.has(REACHED), within)
        if enable:
            status = yield from self._enable(action)
        else:
            status = yield from self._until(action, "the mode", lambda status: status.state is not None, self.timeout)
        if self.roles.mode_display:
            display = f"mode {show(new_mode)} in {self.roles.mode_display}"
            status = yield from self._until(action, display, lambda status: status.mode == new_mode, self.timeout)
        return status

    def _unchanged(
        self, action: str, waiting_for: str, settings: Mapping[str, Value], status: DriveStatus
    ) -> Conversation[Item, DriveStatus]:
        """Raise DriveStuck if "reached" is not about our target: the drive reports it also after a following error, or
        after another master commanded a halt, a mode or a target."""
        if status.has(MODE_ERROR) and action != "home":
            raise (yield from self._stuck(action, waiting_for, None, status, ["a following error, bit 13"]))
        commanded = (self.roles.mode, self.roles.target_position, self.roles.target_velocity)
        written = {name: value for name, value in settings.items() if name in commanded}
        written[self.roles.control_word] = self.control or 0
        readable = [name for name in written if self.device.find(name).readable]
        present: list[Reading] = []
        if readable:
            with suppress(Refused):  # a drive whose commands cannot be read back is not checked
                present = yield from self.access.read(readable)
        if changed := list(_foreign_writes(present, written, self.roles.control_word)):
            raise (yield from self._stuck(action, waiting_for, None, status, changed))
        return status

    # Reasons

    def _stuck(
        self, action: str, waiting_for: str, waited: float | None, status: DriveStatus, reasons: Sequence[str] = ()
    ) -> Conversation[Item, DriveStuck]:
        """Return the error with all reasons. `waited` (seconds) is None where more time would not help."""
        error = yield from self._read_reason(self.roles.error_code)
        reasons = [*_reasons(action, status, error), *reasons]
        if status.state is State.OPERATION_ENABLED and not status.velocity:
            for role in _ZERO_STOPS.get(action, ()):
                reading = yield from self._read_reason(getattr(self.roles, role))
                reasons += [f"{reading.name} is 0"] if reading is not None and reading.value == 0 else []
        after = "" if waited is None else f" after {waited:g} s"
        because = f": {'; '.join(reasons)}" if reasons else ""
        text = f"{action}: stuck in {status.state_name!r}{after}, waiting for {waiting_for}{because}"
        bits = ", ".join(bit_names(status.status_word)) or "no bit set"
        command = "" if self.control is None else f"; last control word {self.control:04X}h"
        return DriveStuck(f"{text}; status word {status.status_word:04X}h: {bits}{command}", status, error)

    def _read_reason(self, name: str) -> Conversation[Item, Reading | None]:
        """Read a value that may explain the error; return None if it cannot be read."""
        if name:
            with suppress(BarewireError):
                return (yield from self.access.read([name]))[0]
        return None


# The reasons of a DriveStuck


def _foreign_writes(present: Sequence[Reading], written: Mapping[str, Value], control_word: str) -> Iterator[str]:
    """Yield a reason for every value that is no longer the written one."""
    for reading in present:
        if reading.name == control_word:
            if (int(reading.value) ^ int(written[reading.name])) & _DEFINED_BITS:
                yield f"another master wrote {reading.name} {int(reading.value):04X}h"
        elif not isclose(float(reading.value), float(written[reading.name]), rel_tol=1e-6):  # an f32 rounds
            yield f"another master wrote {reading.name} {reading.parameter.plain_text(reading.value)}"


def _reasons(action: str, status: DriveStatus, error: Reading | None) -> list[str]:
    """Return the reasons in the error code and in the status word, the most certain first."""
    reasons = []
    code = f"{error.name} {_code(error.parameter, error.value)}" if error is not None and error.value else ""
    if status.state in FAULT_STATES:
        reasons.append(f"the drive has a fault, {code or 'no error code'}")
        if action == "reset":
            reasons.append("its cause is still there, or the reset was not taken")
        return reasons
    if code:
        reasons.append(code)
    if not status.has(VOLTAGE_ENABLED):
        reasons.append("no high voltage, bit 4 (voltage enabled) is off")
    if not status.has(REMOTE):
        reasons.append("the drive does not take commands from the bus, bit 9 (remote) is off")
    if status.has(LIMITED):
        reasons.append("a limit of the drive is active, bit 11")
    if status.state is State.OPERATION_ENABLED and status.velocity is not None:  # one that turns may need more time
        turns = f"still turns, velocity {show(status.velocity)}" if status.velocity else "stands"
        reasons.append(f"the motor {turns}")
    return reasons


def _code(parameter: Parameter, value: Value) -> str:
    """Return an error code as manuals print it, with its meaning if the description has one."""
    meaning = parameter.values.get(int(value)) if isinstance(value, int) else None
    number = f"{value & 0xFFFF:04X}h" if isinstance(value, int) else str(value)
    return f"{number} ({meaning})" if meaning else number


# Checks before anything is sent


def check_mode(device: Device, action: str) -> str:
    """Return the mode of a movement. Raise EncodeError if the description of the drive does not have it."""
    mode, words = _MODES[action]
    if mode not in drive_roles(device).modes:
        reason = f"its description has no {mode!r} in modes of [drive] (its manual may describe none)"
        raise EncodeError(f"{action}: {device.name} cannot be {words} by this command: {reason}")
    return mode


def _check_homing_method(parameter: Parameter, method: Value) -> None:
    """Raise EncodeError for a homing method that the drive does not have: it would never finish."""
    if parameter.values and method not in parameter.values:
        known = ", ".join(map(str, parameter.values))
        raise EncodeError(f"home: {parameter.name} {show(method)} is not a homing method: expected one of {known}")


def _check_encodable(parameter: Parameter, value: Value) -> None:
    """Raise EncodeError if the value cannot be sent: out of range, between two steps, or outside of the type."""
    raw = parameter.to_raw(value)
    if parameter.type not in ("bool", "text"):
        with naming(parameter, value):
            codec(parameter.type).encode(raw)


def _check_seconds(name: str, value: float) -> float:
    """Return a time in seconds. Raises EncodeError unless it is above 0: waiting for not-a-number would never end."""
    if not value > 0:
        raise EncodeError(f"{name} = {value:g}: expected seconds, above 0", name)
    return value
