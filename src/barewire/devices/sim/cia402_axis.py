"""A simulated axis after CiA 402: its states, and the motion that they allow. The AZ3 and the CSD MT extend it.

        control word --> states --> may the shaft move? --> mode 1 position, 3 velocity, 6 homing --> trajectory
                                                                                                        |
        status word  <-- state bits, 9 remote, 10 target reached, 12 by mode ---------------------------'

Drives differ in their `AxisSettings`: units, limits, and the source of the values. Their additions (delays, inputs,
limit switches and homing in `csd_mt.axis`, a brake in `az3_motion`) override the methods that are marked as hooks.
Everything is in steps and seconds. The bits 4 to 8 of the control word depend on the mode: 4 new set-point or homing
start, 5 change immediately, 6 relative, 8 halt (CSD MT manual, ch. 12, register 1040).
"""

from __future__ import annotations

from math import inf
from typing import Protocol

from barewire.devices.cia402 import (
    HALT,
    IMMEDIATELY,
    MODE_BIT,
    NEW_SET_POINT,
    QUICK_STOP,
    REACHED,
    RELATIVE,
    REMOTE,
    TRANSITIONS,
    VOLTAGE_ENABLED,
    DriveCommand,
    State,
    Transition,
    command_of,
    with_state,
)
from barewire.devices.sim.trajectory import Trajectory, wrapped

POSITION, VELOCITY, TORQUE, HOMING = 1, 3, 4, 6
_COUNTER_RANGE = 1 << 32

CURRENT_ON = frozenset({State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE})


class AxisSettings(Protocol):
    """The present settings of a drive, in steps and seconds."""

    def mode(self) -> int: ...

    def target_position(self) -> float: ...

    def target_velocity(self) -> float: ...

    def profile_velocity(self) -> float: ...

    def acceleration(self) -> float: ...

    def deceleration(self, mode: int) -> float: ...

    def without_ramp(self, velocity: float) -> bool:
        """Return whether a position move at this velocity starts and stops without a ramp."""

    def velocity_window(self) -> tuple[float, float]:
        """Return how near to the target velocity counts as reached, and after how many seconds there."""

    def zero_window(self) -> tuple[float, float]:
        """Return the velocity below which the shaft counts as standing, and after how many seconds there."""


class Cia402Axis:
    """States and motion of one drive: `control` takes control words, `tick` takes time."""

    def __init__(self, settings: AxisSettings, *, stays_in_quick_stop: bool, power_delay: float = 0.0) -> None:
        self.settings = settings
        self.stays_in_quick_stop = stays_in_quick_stop
        """True: 12 only by command, and 16 is allowed (option code 5). False: 12 by itself after the ramp."""
        self.power_delay = power_delay
        """For how many seconds power must be present before transition 3."""
        self.powered_since: float | None = -inf
        """Since when the power section is supplied; None while it is not."""
        self.restart()

    def restart(self) -> None:
        """Set every state as at power-on, at position 0. The supply stays as it is."""
        self.state = State.SWITCH_ON_DISABLED
        self.trajectory = Trajectory()
        self.word = 0
        self.mode = 0
        self.cause = 0
        """The code of the fault whose cause is still present, 0 if there is none."""
        self.transient = False
        """Whether the cause lasts no longer than the fault, so that a reset ends both."""
        self.homed = False
        self._goal = 0.0
        self._rates = (1.0, 1.0)
        self._overall_start = 0.0
        self._relative = False
        self._acknowledged = False
        self._reached = True
        self._halts = False
        self._fault_at = inf

    # Time

    def tick(self, now: float) -> None:
        """Carry out what is due until now: the end of a quick stop, of a fault reaction."""
        end = self.trajectory.ends_at
        if self.state is State.QUICK_STOP_ACTIVE and not self.stays_in_quick_stop and end <= now:
            self.state = State.SWITCH_ON_DISABLED  # 12
        if self.state is State.FAULT_REACTION_ACTIVE and self._fault_at <= now:
            self.state = State.FAULT  # 14

    # Commands

    def control(self, word: int, now: float) -> None:
        """Carry out a control word that was written."""
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
            if not self.transient:
                return  # "allowed when the fault of the drive is solved" (transition 15)
            self.cause = 0
        if transition.number == 16 and not self.stays_in_quick_stop:
            return
        self._go(transition, now)

    def _go(self, transition: Transition, now: float) -> None:
        """Make a transition that is allowed. A hook for delays."""
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
        self.update_halt(now)
        if word & ~before & NEW_SET_POINT and not self._halts:
            if self.mode == POSITION:
                self._set_point(word, now)
            elif self.mode == HOMING:
                self._start_homing(now)

    def halted(self, now: float) -> bool:
        """Return whether a halt is commanded. A hook for inputs."""
        return bool(self.word & HALT)

    def update_halt(self, now: float) -> None:
        """Begin or end a halt, if `halted` has changed."""
        before, self._halts = self._halts, self.halted(now)
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
            self._rates = self.settings.acceleration(), self.settings.deceleration(self.mode)
        # On the way "a relative movement has the overall starting point as a reference", a change of bit 6 is ignored,
        # and new ramps wait for the next movement (CSD MT manual, ch. 12, multi-set-point).
        if self._relative:
            self._goal = self._overall_start + self.settings.target_position()
        else:
            # A counter that has wrapped shows a position within its range: the distance counts from the shown position.
            position = self.trajectory.position(now)
            turns = round((position - wrapped(position)) / _COUNTER_RANGE)
            self._goal = turns * _COUNTER_RANGE + self.settings.target_position()
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

    def may_go(self, direction: float) -> bool:
        """Return whether the shaft may move up (a `direction` above 0) or down (below 0). A hook for limit switches."""
        return True

    def _start_homing(self, now: float) -> None:
        """Start homing. A hook: this axis has no homing, so bits 12 and 10 stay as they are."""

    def replan(self, now: float) -> None:
        """Apply a changed profile velocity to a set-point move: "immediately, independently of New Set Point"."""
        if self.mode == POSITION and self.trajectory.moves(now) and not self._halts:
            self._plan(now)

    def follow(self, now: float) -> None:
        """Ramp to the target velocity in profile velocity mode, if the shaft may run."""
        if self.state is State.OPERATION_ENABLED and self.mode == VELOCITY and not self._halts:
            target = self.settings.target_velocity()
            acceleration, deceleration = self.settings.acceleration(), self.settings.deceleration(self.mode)
            self.trajectory.run_at(now, target if self.may_go(target) else 0.0, acceleration, deceleration)

    def change_mode(self, now: float) -> None:
        """Apply a mode of operation that was written. A movement of the old mode ends on its ramp."""
        mode = self.settings.mode()
        if mode == self.mode:
            return
        self.mode = mode
        if self.state is State.OPERATION_ENABLED:
            self._stop(now)
            self._enter(now)

    def _enter(self, now: float) -> None:
        self._reached = True
        self._halts = self.halted(now)
        self.follow(now)

    def _release(self, now: float) -> float:
        """Switch the current off, simplified to braking. Returns when the shaft stands. A hook for a coasting shaft."""
        self._acknowledged = False
        self._stop(now)
        return self.trajectory.ends_at

    def _stop(self, now: float) -> None:
        self._reached = True
        self.trajectory.stop(now, max(self.settings.deceleration(self.mode), 1.0))

    def rest_at(self, position: float, now: float) -> None:
        """End a movement here, and give the present place the number `position`."""
        self.trajectory.jump(now, position)

    # Faults

    def fault(self, code: int, now: float, *, reaction: bool = False, transient: bool = False) -> None:
        """Make transitions 13 and 14: with a `reaction` 14 follows when the shaft stands, otherwise at once."""
        self.cause, self.transient = code, transient
        if self.state is State.FAULT:
            return
        stands_at = self._release(now)
        self._fault_at = stands_at if reaction else now
        self.state = State.FAULT_REACTION_ACTIVE
        self.tick(now)

    # Status word

    def status(self, now: float) -> int:
        """Return the status word, without the bits that a drive adds."""
        # In SWITCH ON DISABLED CiA 402 leaves bit 5 open; table 12 of the CSD MT manual prints 1.
        word = with_state(1 << QUICK_STOP if self.state is State.SWITCH_ON_DISABLED else 0, self.state)
        if self.powered_since is not None:
            word |= 1 << VOLTAGE_ENABLED
        # During a fault reaction the drive accepts no commands: remote is 0 (CSD MT manual, register 1085, step 3).
        if self.state is not State.FAULT_REACTION_ACTIVE:
            word |= 1 << REMOTE
        if self.state in CURRENT_ON and self._target_reached(now):
            word |= 1 << REACHED
        return word | self._mode_bit(now) << MODE_BIT

    def _mode_bit(self, now: float) -> bool:
        if self.mode == POSITION:
            return self._acknowledged
        if self.mode == HOMING:
            return self.homed
        # In velocity mode it means "speed is 0", which a drive does not tell while it brakes because of a fault.
        return self.mode == VELOCITY and self.state is not State.FAULT_REACTION_ACTIVE and self._stands(now)

    def _stands(self, now: float) -> bool:
        width, seconds = self.settings.zero_window()
        since = self.trajectory.inside_since(now, 0.0, width)
        return since is not None and now - since >= seconds

    def _target_reached(self, now: float) -> bool:
        if self.mode == VELOCITY and self.state is State.OPERATION_ENABLED:
            target = self.settings.target_velocity()
            velocity = target if self.may_go(target) and not self._halts else 0.0
            width, seconds = self.settings.velocity_window()
            since = self.trajectory.inside_since(now, velocity, width)
            return since is not None and now - since >= seconds
        return self._reached and not self.trajectory.moves(now)
