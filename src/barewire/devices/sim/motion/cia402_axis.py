"""A simulated servo axis: the CiA 402 states and the motion they let happen. Used by both drives of the catalogue.

        control word --> states --> may the shaft move? --> mode 1 position, 3 velocity, 6 homing --> trajectory
                                                                                                        |
        status word  <-- state bits, 9 remote, 10 target reached, 12 by mode ---------------------------'

What differs between drives (units, limits, where the values come from) is asked of a `Settings`. What one of them does
besides (delays, inputs, limit switches, homing: `csd_mt_axis`) it does in a subclass, at the methods marked as places
for it. Everything is in steps and seconds. Bits of the control word that are a mode's own: 4 new set-point or homing
start, 5 change immediately, 6 relative, 8 halt (CSD MT manual, ch. 12, register 1040).
"""

from __future__ import annotations

from math import inf
from typing import Protocol

from barewire.devices.drive.cia402 import TRANSITIONS, DriveCommand, State, Transition, command_of, with_state
from barewire.devices.sim.motion.trajectory import Trajectory, wrapped

POSITION, VELOCITY, TORQUE, HOMING = 1, 3, 4, 6
NEW_SET_POINT, IMMEDIATELY, RELATIVE, HALT = 0x10, 0x20, 0x40, 0x100
ROUND = 1 << 32
VOLTAGE_ENABLED, QUICK_STOP, REMOTE, REACHED, MODE_BIT = 0x10, 0x20, 0x200, 0x400, 0x1000

CURRENT_ON = frozenset({State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE})
FAULTED = frozenset({State.FAULT, State.FAULT_REACTION_ACTIVE})


class Settings(Protocol):
    """What an axis asks its drive: values in steps and seconds, at the moment of asking."""

    def mode(self) -> int: ...

    def target_position(self) -> float: ...

    def target_velocity(self) -> float: ...

    def profile_velocity(self) -> float: ...

    def acceleration(self) -> float: ...

    def deceleration(self) -> float: ...

    def without_ramp(self, velocity: float) -> bool:
        """Whether a position move at this velocity starts and stops without a ramp."""

    def velocity_window(self) -> tuple[float, float]:
        """How near to the target velocity counts as reached, and for how many seconds."""

    def zero_window(self) -> tuple[float, float]:
        """Below which velocity, and for how many seconds, the shaft counts as standing."""


class Axis:
    """States and motion of one drive. Feed it control words with `control`, and time with `tick`."""

    def __init__(self, settings: Settings, *, stays_in_quick_stop: bool) -> None:
        self.settings = settings
        self.stays_in_quick_stop = stays_in_quick_stop
        """True: 12 only by command and 16 is allowed (option code 5). False: 12 by itself after the ramp."""
        self.state = State.SWITCH_ON_DISABLED
        self.trajectory = Trajectory()
        self.word = 0
        self.mode = 0
        self.powered_since: float | None = -inf
        self.power_delay = 0.0
        """How long power must have been there before transition 3."""
        self.cause = 0
        """The code of the fault whose cause is still there, 0 if none is."""
        self.passing = False
        """Whether that cause lasts no longer than the fault, so that a reset takes both away."""
        self.homed = False
        self._goal = 0.0
        self._rates = (1.0, 1.0)
        self._overall_start = 0.0
        self._relative = False
        self._acknowledged = False
        self._reached = True
        self._halts = False
        self._faults_at = inf

    # Time

    def tick(self, now: float) -> None:
        """What happens by itself up to now: the end of a quick stop, of a fault reaction."""
        end = self.trajectory.ends_at
        if self.state is State.QUICK_STOP_ACTIVE and not self.stays_in_quick_stop and end <= now:
            self.state = State.SWITCH_ON_DISABLED  # 12
        if self.state is State.FAULT_REACTION_ACTIVE and self._faults_at <= now:
            self.state = State.FAULT  # 14

    # Commands

    def control(self, word: int, now: float) -> None:
        """A control word was written."""
        before, self.word = self.word, word
        if before & ~word & NEW_SET_POINT:
            self._acknowledged = False
        command = command_of(word, before)
        for transition in TRANSITIONS:
            # In the order of the list one word can take two steps: 3, and 4 at once.
            if command is not None and transition.source is self.state and transition.command is command:
                self._take(transition, now)
        if command is DriveCommand.ENABLE_OPERATION and self.state is State.OPERATION_ENABLED:
            self._move(word, before, now)

    def _take(self, transition: Transition, now: float) -> None:
        if transition.number == 3 and not self._has_power(now):
            return  # "otherwise drive remains in READY TO SWITCH ON" (CSD MT manual, ch. 11, transition 3)
        if transition.number == 15 and self.cause:
            if not self.passing:
                return  # "allowed when the fault of the drive is solved" (transition 15)
            self.cause = 0
        if transition.number == 16 and not self.stays_in_quick_stop:
            return
        self._go(transition, now)

    def _go(self, transition: Transition, now: float) -> None:
        """A place for delays: the transition is allowed."""
        before, self.state = self.state, transition.target
        if self.state is State.QUICK_STOP_ACTIVE:
            self._stop(now)
        elif self.state is State.OPERATION_ENABLED:
            self._enter(now)
        elif before in CURRENT_ON:
            self._release(now)

    def _has_power(self, now: float) -> bool:
        return self.powered_since is not None and now - self.powered_since >= self.power_delay

    def _move(self, word: int, before: int, now: float) -> None:
        self.look_at_halt(now)
        if word & ~before & NEW_SET_POINT and not self._halts:
            if self.mode == POSITION:
                self._set_point(word, now)
            elif self.mode == HOMING:
                self._start_homing(now)

    def halted(self) -> bool:
        """A place for inputs: whether the shaft is told to stand."""
        return bool(self.word & HALT)

    def look_at_halt(self, now: float) -> None:
        """Halt, or the end of one: after a change of what `halted` looks at."""
        before, self._halts = self._halts, self.halted()
        if self._halts and not before:
            self._stop(now)
        elif before and not self._halts:
            # "Target reached is automatically set to 0 and the interrupted movement is not completed" (bit 8).
            self._reached = False
            if self.mode == VELOCITY:
                self.follow(now)

    def _set_point(self, word: int, now: float) -> None:
        moving = self.trajectory.moves(now)
        if moving and not word & IMMEDIATELY:
            return  # not before the target is reached (bit 5)
        self._acknowledged = True
        if not moving:
            self._overall_start = self.trajectory.position(now)
            self._relative = bool(word & RELATIVE)
            self._rates = self.settings.acceleration(), self.settings.deceleration()
        # On the way "a relative movement has the overall starting point as a reference", a change of bit 6 is ignored,
        # and new ramps wait for the next movement (CSD MT manual, ch. 12, multi-set-point).
        if self._relative:
            self._goal = self._overall_start + self.settings.target_position()
        else:
            # A counter that has gone round shows a position of the range: the way is from what it shows.
            position = self.trajectory.position(now)
            turns = round((position - wrapped(position)) / ROUND)
            self._goal = turns * ROUND + self.settings.target_position()
        self._plan(now)

    def _plan(self, now: float) -> None:
        velocity = self.settings.profile_velocity()
        self._reached = True
        if not self.may_go(self._goal - self.trajectory.position(now)):
            self._stop(now)
        elif velocity > 0:
            self.trajectory.move(now, self._goal, velocity, *self._rates, jerky=self.settings.without_ramp(velocity))
        elif self._goal != self.trajectory.position(now):
            self._stop(now)
            self._reached = False  # at a profile velocity of 0 no target is ever reached

    def may_go(self, way: float) -> bool:
        """A place for limit switches: whether the shaft may go up (a `trajectory` above 0) or down."""
        return True

    def _start_homing(self, now: float) -> None:
        """A place for homing. This axis has none: bits 12 and 10 stay as they are."""

    def replan(self, now: float) -> None:
        """The profile velocity was changed: "immediately, independently of New Set Point", on a set-point move."""
        if self.mode == POSITION and self.trajectory.moves(now) and not self._halts:
            self._plan(now)

    def follow(self, now: float) -> None:
        """Profile velocity: head for the target velocity, if the shaft may run."""
        if self.state is State.OPERATION_ENABLED and self.mode == VELOCITY and not self._halts:
            wanted = self.settings.target_velocity()
            acceleration, deceleration = self.settings.acceleration(), self.settings.deceleration()
            self.trajectory.run_at(now, wanted if self.may_go(wanted) else 0.0, acceleration, deceleration)

    def change_mode(self, now: float) -> None:
        """The mode of operation was written. A movement of the old mode ends on its ramp."""
        mode = self.settings.mode()
        if mode == self.mode:
            return
        self.mode = mode
        if self.state is State.OPERATION_ENABLED:
            self._stop(now)
            self._enter(now)

    def _enter(self, now: float) -> None:
        self._reached = True
        self._halts = self.halted()
        self.follow(now)

    def _release(self, now: float) -> float:
        """A place for a shaft that coasts. Current off: drawn as braking. Returns when the shaft stands."""
        self._acknowledged = False
        self._stop(now)
        return self.trajectory.ends_at

    def _stop(self, now: float) -> None:
        self._reached = True
        self.trajectory.stop(now, max(self.settings.deceleration(), 1.0))

    def rest_at(self, position: float, now: float) -> None:
        """The present place is called `position` from now on; a movement ends here."""
        self.trajectory.jump(now, position)

    # Faults

    def fault(self, code: int, now: float, *, reaction: bool = False, passing: bool = False) -> None:
        """13 and 14. With a `reaction` FAULT waits until the shaft stands, otherwise it is there at once."""
        self.cause, self.passing = code, passing
        if self.state is State.FAULT:
            return
        stands_at = self._release(now)
        self._faults_at = stands_at if reaction else now
        self.state = State.FAULT_REACTION_ACTIVE
        self.tick(now)

    # What a master reads

    def status(self, now: float) -> int:
        """The status word, without the bits that a drive adds."""
        # In SWITCH ON DISABLED bit 5 is of no account in CiA 402; table 12 of the CSD MT manual prints 1.
        word = with_state(QUICK_STOP if self.state is State.SWITCH_ON_DISABLED else 0, self.state)
        if self.powered_since is not None:
            word |= VOLTAGE_ENABLED
        # During a fault reaction the drive hears nothing: remote is 0 (CSD MT manual, register 1085, step 3).
        if self.state is not State.FAULT_REACTION_ACTIVE:
            word |= REMOTE
        if self.state in CURRENT_ON and self._target_reached(now):
            word |= REACHED
        if self.mode == VELOCITY and self.state is not State.FAULT_REACTION_ACTIVE:
            width, seconds = self.settings.zero_window()
            since = self.trajectory.inside_since(now, 0.0, width)
            word |= MODE_BIT if since is not None and now - since >= seconds else 0
        elif self.mode == HOMING:
            word |= MODE_BIT if self.homed else 0
        elif self.mode == POSITION:
            word |= MODE_BIT if self._acknowledged else 0
        return word

    def _target_reached(self, now: float) -> bool:
        if self.mode == VELOCITY and self.state is State.OPERATION_ENABLED:
            wanted = self.settings.target_velocity()
            wanted = wanted if self.may_go(wanted) and not self._halts else 0.0
            width, seconds = self.settings.velocity_window()
            since = self.trajectory.inside_since(now, wanted, width)
            return since is not None and now - since >= seconds
        return self._reached and not self.trajectory.moves(now)
