"""The axis of a CSD MT: what it does beyond CiA 402 states and motion.              [CSD MT manual, ch. 11 and 12]

        enable    |--1095--> current on |------1096------> OPERATION ENABLED, ready for a motion
                                        |--1094--> brake unlocked
        disable   brake locked |--1093--> current off, the shaft coasts          (1093, 1094: only with a brake at O1)

Inputs start and halt (register 1067), limit switches forbid a direction (1088), homing is a search. While the shaft
stops for a halt, a quick stop or to turn round, "the motion cannot be changed" (multi-set-point limits).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import inf
from typing import TYPE_CHECKING

from barewire.devices.drive.cia402 import State, Transition, command_of
from barewire.devices.sim.csd_mt.homing import Search, Sign
from barewire.devices.sim.csd_mt.settings import Registers
from barewire.devices.sim.motion.cia402_axis import CURRENT_ON, POSITION, RELATIVE, VELOCITY, Axis

if TYPE_CHECKING:
    from barewire.devices.sim.csd_mt.machine import CsdMt

Event = tuple[float, Callable[[], None]]
"""When something happens by itself, and what it brings about."""

SWITCHING = frozenset({State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE, State.FAULT})
"""From here the mode cannot be switched; it is when the drive has left (ch. 12, profile position mode)."""
ENABLING, DISABLING = 4, (5, 8, 9)


class StepperAxis(Axis):
    """The axis of one drive, which has its inputs, its shaft and its registers."""

    def __init__(self, drive: CsdMt) -> None:
        super().__init__(Registers(drive), stays_in_quick_stop=True)  # option code 5 (ch. 11, transitions 12 and 16)
        self.drive = drive
        self.search: Search | None = None
        self.brake_at = inf
        """Since when the brake is unlocked; inf while it is locked."""
        self._pending: Transition | None = None
        self._current_at = inf
        self._done_at = inf
        self._stops_until = -inf

    def events(self) -> Iterator[Event]:
        """What the axis does by itself."""
        yield self._current_at, self._switch_current
        yield self._done_at, self._finish
        if self.search is not None:
            yield self.search.rests_at(), lambda: self.tell_search("rest")

    def _delay(self, name: str) -> float:
        return self.drive.store.number(name) / 1000

    # States with delays

    def control(self, word: int, now: float) -> None:
        """Another command takes the place of one that is still being carried out."""
        command = command_of(word, self.word)
        if self._pending is not None and command is not None and command is not self._pending.command:
            self._cancel(now)
        super().control(word, now)
        self.change_mode(now)

    def _go(self, transition: Transition, now: float) -> None:
        if self._pending is not None:
            return
        if transition.number == ENABLING:
            if self.drive.safe_torque_off:
                return  # "otherwise the current flowing in the motor phases is not allowed" (ch. 13)
            self._pending = transition
            self._current_at = now + self._delay("Brake Delay Current ON")
            self._done_at = self._current_at + self._delay("Brake Delay Azio Ready")
        elif transition.number in DISABLING and self.drive.service.has_brake:
            self._pending, self.brake_at = transition, inf
            self._done_at = now + self._delay("Brake Delay Lock")
            self._stop(now)
        else:
            super()._go(transition, now)
            # The brake output is "ON if the drive is in Operation Enabled state only" (register 1089).
            if self.drive.service.has_brake:
                self.brake_at = now if self.state is State.OPERATION_ENABLED else inf

    def _switch_current(self) -> None:
        self._current_at = inf
        if self.drive.shaft.current_on() and self.drive.service.has_brake:
            self.brake_at = self.drive.now + self._delay("Brake Delay Unlock")

    def _finish(self) -> None:
        done, self._pending, self._done_at = self._pending, None, inf
        if done is not None:
            super()._go(done, self.drive.now)
            if done.number == ENABLING:
                self.drive.enabled()

    def _cancel(self, now: float) -> None:
        done, self._pending = self._pending, None
        self._current_at = self._done_at = inf
        if done is not None and done.number == ENABLING:
            self._release(now)
        else:
            self.brake_at = now

    def _release(self, now: float) -> float:
        """Current off: the command stands where it is, the shaft coasts."""
        self._acknowledged, self._reached = False, True
        self.search = self._pending = None
        self.brake_at = self._current_at = self._done_at = inf
        stands_at = self.drive.shaft.current_off()
        self.trajectory.jump(now, self.trajectory.position(now))
        self.drive.released()
        return stands_at

    def torque_off(self) -> None:
        """Safe Torque Off: without a command, the motor has no current any more (CSD MT S4)."""
        self._release(self.drive.now)
        if self.state in CURRENT_ON:
            self.state = State.SWITCH_ON_DISABLED

    def change_mode(self, now: float) -> None:
        """From four of the states only; in the others the register waits."""
        if self.state not in SWITCHING and self.settings.mode() != self.mode:
            super().change_mode(now)

    @property
    def ready(self) -> bool:
        """Whether a motion can be commanded."""
        return self.state is State.OPERATION_ENABLED and self._pending is None

    # Set-points

    def _set_point(self, word: int, now: float) -> None:
        if not self.ready or self._settles(now):
            return
        if not self.trajectory.moves(now) and not self.drive.shaft.run_begins(relative=bool(word & RELATIVE)):
            return
        super()._set_point(word, now)

    def replan(self, now: float) -> None:
        """A new velocity on the way, unless the shaft stops or turns round."""
        if not self._settles(now):
            super().replan(now)

    def _settles(self, now: float) -> bool:
        return now < max(self._stops_until, self.trajectory.turns_until)

    def start(self, *, relative: bool) -> None:
        """An input says what bit 4 would (register 1067)."""
        if self.mode == POSITION and self.ready and not self._halts:
            self._set_point(RELATIVE if relative else 0, self.drive.now)

    def start_falls(self) -> None:
        """And what bit 4 would when it goes."""
        if self.mode == POSITION:
            self._acknowledged = False

    def halted(self) -> bool:
        """By bit 8, or by an input."""
        return super().halted() or self.drive.inputs.halts(self.mode)

    def look_again(self) -> None:
        """An input or its meaning has changed: halt, limits."""
        now = self.drive.now
        if not self.ready:
            return
        self.look_at_halt(now)
        heading = self.trajectory.velocity(now) or self.trajectory.position(
            self.trajectory.ends_at
        ) - self.trajectory.position(now)
        if self.mode == VELOCITY:
            wanted = self.settings.target_velocity()
            if self.trajectory.velocity(self.trajectory.ends_at) != (wanted if self.may_go(wanted) else 0.0):
                self.follow(now)
        elif not self.may_go(heading):
            self._stop(now)  # "like it has received Halt command" (register 1008)

    def may_go(self, way: float) -> bool:
        """Not in the direction of a limit switch that is OFF."""
        inputs = self.drive.inputs
        return not ((way < 0 and inputs.below_limit) or (way > 0 and inputs.above_limit))

    def _stop(self, now: float) -> None:
        self.search = None
        super()._stop(now)
        self._stops_until = self.trajectory.ends_at

    def break_off(self) -> None:
        """A following error with reaction 0: with the ramp, or at once if the run has none (register 1085)."""
        now = self.drive.now
        if self.mode == POSITION and self.without_ramp(now):
            self.search, self._reached = None, True
            self.trajectory.jump(now, self.trajectory.position(now))
        else:
            self._stop(now)

    def without_ramp(self, now: float) -> bool:
        """Whether the run that is under way is a start-stop one: slow, and not because it is on a ramp."""
        return not self.trajectory.acceleration(now) and self.settings.without_ramp(abs(self.trajectory.velocity(now)))

    # Homing

    def _start_homing(self, now: float) -> None:
        if not self.ready or self.trajectory.moves(now) or self.search is not None:
            return
        self.homed = self._reached = False
        method = self.drive.store.whole("Homing Method")
        if Search.possible(self.drive, method):
            self.drive.shaft.run_begins(relative=True)
            self.search = Search(self.drive, method)
            self.search.begin()

    def tell_search(self, sign: Sign) -> None:
        """Something has happened that a homing run may be waiting for."""
        if self.search is not None:
            self.search.happens(sign)

    def give_up_search(self) -> None:
        """A limit switch is in the way: the shaft stands, bit 11 says why, bit 12 does not come."""
        self._stop(self.drive.now)

    def home_found(self) -> None:
        """The place where the shaft is now is called by Homing Offset."""
        self.search = None
        self.rest_at(self.drive.store.number("Homing Offset"), self.drive.now)
        self.homed = self._reached = True

    def rest_at(self, position: float, now: float) -> None:
        """Another name for the place, in both counters."""
        place = self.drive.shaft.position(now)
        super().rest_at(position, now)
        self.drive.shaft.call(position, place)

    def renumber(self, by: float) -> None:
        """The command counter gets other numbers, the movement goes on."""
        self.trajectory.renumber(self.drive.now, by)
        self._goal += by
        self._overall_start += by
