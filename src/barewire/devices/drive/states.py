"""The states of a drive of CiA 402 over any wire: look, wait, go from one to another. `drive.py` adds the motion.

    switch on disabled --06h--> ready to switch on --07h--> switched on --0Fh--> operation enabled
           ^                                                                        |       | 02h
           '------------------------------- 00h ------------------------------------'   quick stop active
    fault --00h, 80h: an edge of bit 7--> switch on disabled

I know: states, and how long to wait for one.  I never know: registers, objects, clocks, motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Generic, TypeVar

from barewire.conversation import Conversation
from barewire.devices.device import Device, DriveRoles
from barewire.devices.drive.access import DriveAccess
from barewire.devices.drive.cia402 import DriveCommand, State, next_control_word
from barewire.devices.drive.report import (
    FAULTED,
    REACHED,
    SWITCHED_OFF,
    DriveProgress,
    DriveStuck,
    Look,
    stuck,
)
from barewire.devices.parameter import Reading
from barewire.errors import BarewireError, EncodeError

Item = TypeVar("Item")

MOVED_BY = {
    "move": ("profile_velocity", "acceleration"),
    "velocity": ("acceleration",),
    "home": ("homing_speed_switch", "homing_speed_zero"),
}
"""What a motor stands still for if it is 0, by action."""

WATCHED = ("status_word", "mode_display", "position", "velocity")
_AT_ONCE = float("-inf")


def seconds(name: str, value: float) -> float:
    """How long something may take: above 0, and a number; with not-a-number no waiting would ever end."""
    if not value > 0:
        raise EncodeError(f"{name} = {value:g}: expected seconds, above 0", name)
    return value


def drive_roles(device: Device) -> DriveRoles:
    """The parts that a device has as a drive. EncodeError for one that is none."""
    if device.drive is None:
        raise EncodeError(f"{device.name} is no drive: its description has no table [drive]")
    return device.drive


class DriveStates(Generic[Item]):
    """One drive. `timeout` is how long each step may take, `period` the seconds between two looks at it."""

    def __init__(
        self,
        access: DriveAccess[Item],
        device: Device,
        *,
        timeout: float = 3.0,
        period: float = 0.02,
        progress: Callable[[DriveProgress], None] | None = None,
    ) -> None:
        self.access = access
        self.device = device
        self.parts = drive_roles(device)
        self.timeout = seconds("timeout", timeout)
        self.period = seconds("period", period)
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
            self.progress(DriveProgress(action, waiting_for, look))
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

    def _stuck(
        self, action: str, waiting_for: str, waited: float | None, look: Look, more: Sequence[str] = ()
    ) -> Conversation[Item, DriveStuck]:
        error = yield from self._asked_for_why(self.parts.error_code)
        more = list(more)
        if look.state is State.OPERATION_ENABLED and not look.velocity:
            for part in MOVED_BY.get(action, ()):
                said = yield from self._asked_for_why(getattr(self.parts, part))
                more += [f"{said.name} is 0"] if said is not None and said.value == 0 else []
        return stuck(action, waiting_for, waited, look, self.control, error, more)

    def _asked_for_why(self, name: str) -> Conversation[Item, Reading | None]:
        """What may explain it. What is known already is worth more than why this question failed."""
        if name:
            with suppress(BarewireError):
                return (yield from self.access.read([name]))[0]
        return None

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
        seconds("within", within)
        yield from self._command(int(DriveCommand.QUICK_STOP))

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
                yield from self._command(int(DriveCommand.DISABLE_VOLTAGE))
                yield from self._command(int(DriveCommand.FAULT_RESET))
            look = yield from self.look("reset", SWITCHED_OFF)
            if not off(look):
                yield from self.access.rest(min(look.now + self.period, began + self.timeout))
        if self.control == DriveCommand.FAULT_RESET:
            yield from self._command(int(DriveCommand.DISABLE_VOLTAGE))
        return look
