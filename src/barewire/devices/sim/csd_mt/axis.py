"""The axis of a CSD MT: its additions to the CiA 402 states and motion.             [CSD MT manual, ch. 11 and 12]

        enable    |--1095--> current on |------1096------> OPERATION ENABLED, ready for a motion
                                        |--1094--> brake unlocked
        disable   brake locked |--1093--> current off, the shaft coasts          (1093, 1094: only with a brake at O1)

Inputs start and halt (register 1067), limit switches block a direction (1088), homing is a sequence of movements. While
the shaft stops for a halt, a quick stop or to turn round, "the motion cannot be changed" (multi-set-point limits).

The homing methods, each as a sequence of movements (ch. 12, homing mode):

        home switch        .----------.            19: from below fast up into it, then slowly down and out at A
                   OFF     |    ON    |   OFF      20: the same, and slowly up into it again: A from below
        -------------------A----------B-------->   21: from above fast down into it, then slowly up and out at B
                                                   22: the same, and slowly down into it again: B from above

3, 4, 5 and 6 are 19, 20, 21 and 22, and then on in the same direction to the next index pulse. If the shaft is in the
switch at the beginning, the fast part is left out. 35 and 37: the place where the shaft stands. -1 (down) and -2 (up):
fast against a mechanical stop, until Auto Sync detects that the shaft lags, and 1115 steps back.

The manual prints 19 as "OFF->ON transition, negative direction" and refers to DSP 402 2.0, where the same method leaves
the switch downwards, ON to OFF. Both are right if the transition is that of the switch seen upwards (A is OFF->ON, B
ON->OFF) and the direction that of the last movement. Read so, the eight lines of register 1050 are the eight methods
of DSP 402, and this file follows both.

Home gets the number +offset, as in the manual (in CiA 402 it would be -offset). A slow search at speed 0, the default
of 1054, never ends, nor does a search for an input that Input Config (1088) does not make the proximity input.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import NamedTuple

from barewire.devices.cia402 import RELATIVE, State, Transition, command_of
from barewire.devices.sim.cia402_axis import CURRENT_ON, HOMING, POSITION, VELOCITY, Cia402Axis
from barewire.devices.sim.csd_mt.environment import FOLLOWING, SPEED_TOO_HIGH, Context, TimedAction
from barewire.devices.sim.csd_mt.inputs import Inputs, Sign
from barewire.devices.sim.csd_mt.shaft import Shaft
from barewire.devices.sim.store import MachineStore


class Run(NamedTuple):
    """Run at a velocity in step/s, with a ramp in step/s²; without one the velocity changes at once."""

    velocity: float
    ramp: float = inf


class Retreat(NamedTuple):
    """Move away from a mechanical stop, by 1115 steps. `direction` is that in which the shaft hit it."""

    direction: int
    ramp: float


class SearchStep(NamedTuple):
    """A movement (None: the one before goes on), and the sign that ends it."""

    move: Run | Retreat | None
    until: Sign


class SwitchMethod(NamedTuple):
    """`towards`: where the switch is searched. `final`: the direction of the last movement. 1 is up."""

    towards: int
    final: int
    by_index: bool


_BY_SWITCH = {
    3: SwitchMethod(1, -1, True),
    4: SwitchMethod(1, 1, True),
    5: SwitchMethod(-1, 1, True),
    6: SwitchMethod(-1, -1, True),
    19: SwitchMethod(1, -1, False),
    20: SwitchMethod(1, 1, False),
    21: SwitchMethod(-1, 1, False),
    22: SwitchMethod(-1, -1, False),
}
_ON_THE_SPOT = (35, 37)
_BY_IMPACT = {-1: -1, -2: 1}
"""Method -> direction. The manual does not print which is which (register 1115)."""


def is_possible(method: int, *, auto_sync: bool) -> bool:
    """Return whether the method exists; only Auto Sync detects a mechanical stop."""
    return auto_sync if method in _BY_IMPACT else method in _BY_SWITCH or method in _ON_THE_SPOT


def search_steps(method: int, *, fast: float, slow: float, ramp: float, in_switch: bool) -> Iterator[SearchStep]:
    """Yield the movements of a method, for speeds in step/s. After the last one the shaft is at home.

    >>> for step in search_steps(19, fast=8000, slow=800, ramp=1e5, in_switch=False):
    ...     print(step.move, step.until)
    Run(velocity=8000, ramp=100000.0) on
    Run(velocity=0.0, ramp=100000.0) rest
    Run(velocity=-800, ramp=inf) off
    """
    if method in _BY_IMPACT:
        direction = _BY_IMPACT[method]
        yield SearchStep(Run(direction * fast, ramp), "impact")
        yield SearchStep(Retreat(direction, ramp), "rest")
    elif method in _BY_SWITCH:
        towards, final, by_index = _BY_SWITCH[method]
        if not in_switch:
            yield SearchStep(Run(towards * fast, ramp), "on")
            yield SearchStep(Run(0.0, ramp), "rest")  # as a rule beyond the switch (register 1052, note)
        yield SearchStep(Run(-towards * slow), "off")
        if final == towards:
            yield SearchStep(Run(final * slow), "on")
        if by_index:
            yield SearchStep(None, "index")


_MODE_FIXED = frozenset({State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE, State.FAULT})
"""In these states the mode cannot be changed; it changes when the drive has left them (ch. 12, profile position)."""

_ENABLING, _DISABLING = 4, (5, 8, 9)
_POWER_DELAY = 0.5
"""For how many seconds the power section must be supplied before SWITCHED ON (ch. 11, transition 3)."""

_START_STOP = 16_000.0
"""Up to this velocity in step/s a move has no ramps (ch. 12, motion profiles)."""

_BRAKE_ON_O1 = (0x23, 0x27)


def is_brake_config(config: int) -> bool:
    """Return whether this value of Output Config (1089) makes O1 the brake."""
    return config in _BRAKE_ON_O1


class StepperSettings:
    """The `AxisSettings` of a CSD MT. The units of its registers are steps and seconds as well."""

    def __init__(self, store: MachineStore) -> None:
        self.store = store

    def mode(self) -> int:  # register 1041
        return self.store.integer("Mode of Operation")

    def target_position(self) -> float:  # register 1042
        return self.store.number("Target Position")

    def target_velocity(self) -> float:  # register 1048, limited by 1074; a limit of 0 is ignored
        target, limit = self.store.number("Target Velocity"), self.store.number("Max Motor Speed")
        return max(-limit, min(target, limit)) if limit else target

    def profile_velocity(self) -> float:  # register 1044
        return self.store.number("Profile Velocity")

    def acceleration(self) -> float:  # register 1046
        return self.store.number("Profile Acceleration")

    def deceleration(self, mode: int) -> float:
        """Return register 1072, or 1046 for a position move, which is a trapezoid if PV² < PA·ΔS."""
        ramps = {POSITION: "Profile Acceleration", HOMING: "Homing Acceleration"}
        return self.store.number(ramps.get(mode, "Profile Deceleration"))

    def without_ramp(self, velocity: float) -> bool:  # whether a move at this velocity is start-stop
        return velocity <= _START_STOP

    def velocity_window(self) -> tuple[float, float]:  # registers 1062 and 1063, with their meaning in CiA 402
        return self.store.number("Velocity Window"), self.store.number("Velocity Window Time") / 1000

    def zero_window(self) -> tuple[float, float]:  # registers 1064 and 1065
        return self.store.number("Velocity Threshold"), self.store.number("Velocity Threshold Time") / 1000


class StepperAxis(Cia402Axis):
    """The axis of one drive. It moves the shaft and obeys the inputs."""

    def __init__(self, context: Context, shaft: Shaft, inputs: Inputs) -> None:
        self.context, self.store, self.shaft, self.inputs = context, context.store, shaft, inputs
        # Option code 5 (ch. 11, transitions 12 and 16)
        super().__init__(StepperSettings(context.store), stays_in_quick_stop=True, power_delay=_POWER_DELAY)
        shaft.on_following_error = self._react_to_following_error  # the shaft is made first, without an axis

    def restart(self) -> None:
        """Set every state as at power-on of the logic."""
        super().restart()
        self.shaft.command = self.trajectory
        self.awaits: Sign | None = None
        """The sign that a homing run waits for; None if there is no homing run."""
        self._steps: Iterator[SearchStep] = iter(())
        self.brake_at = inf
        """Since when the brake is unlocked; inf while it is locked."""
        self.encoder_reset_pending = False
        """The encoder is to be reset when the current is switched off."""
        self._was_enabled = False
        self._pending: Transition | None = None
        self._current_at = inf
        self._done_at = inf
        self._stops_until = -inf

    def events(self) -> Iterator[TimedAction]:
        """Yield the ends of the delays and of the movements of a homing run."""
        yield self._current_at, self._switch_current_on
        yield self._done_at, self._finish
        if self.awaits == "rest":
            yield self.trajectory.ends_at, lambda: self.continue_search("rest")
        elif self.awaits == "impact":
            yield self.shaft.impact_at(), lambda: self.continue_search("impact")

    def _delay(self, name: str) -> float:
        return self.store.number(name) / 1000

    # States with delays

    @property
    def has_brake(self) -> bool:
        """Whether Output Config makes O1 the brake."""
        return is_brake_config(self.store.integer("Output Config"))

    def control(self, word: int, now: float) -> None:
        """Carry out a control word. A new command replaces one that is still being carried out."""
        command = command_of(word, self.word)
        if self._pending is not None and command is not None and command is not self._pending.command:
            self._cancel(now)
        super().control(word, now)
        self.change_mode(now)

    def _go(self, transition: Transition, now: float) -> None:
        if self._pending is not None:
            return  # the delay of this command is still running
        if transition.number == _ENABLING:
            if self.context.environment.safe_torque_off:
                return  # "otherwise the current flowing in the motor phases is not allowed" (ch. 13)
            self._pending = transition
            self._current_at = now + self._delay("Brake Delay Current ON")
            self._done_at = self._current_at + self._delay("Brake Delay Azio Ready")
        elif transition.number in _DISABLING and self.has_brake:
            self._pending, self.brake_at = transition, inf
            self._done_at = now + self._delay("Brake Delay Lock")
            self._stop(now)
        else:
            super()._go(transition, now)
            # The brake output is "ON if the drive is in Operation Enabled state only" (register 1089).
            if self.has_brake:
                self.brake_at = now if self.state is State.OPERATION_ENABLED else inf

    def _switch_current_on(self) -> None:
        self._current_at = inf
        if self.shaft.is_too_fast:
            self.protect(SPEED_TOO_HIGH)
            return
        self.shaft.current_on()
        if self.has_brake:
            self.brake_at = self.context.now + self._delay("Brake Delay Unlock")

    def _finish(self) -> None:
        transition, self._pending, self._done_at = self._pending, None, inf
        if transition is not None:
            super()._go(transition, self.context.now)
            if transition.number == _ENABLING:
                self._enabled()

    def _enabled(self) -> None:
        """Act on transition 4: "the first time there is a reset of Position Actual Value, if 1114 is set"."""
        if not self._was_enabled and self.store.integer("Reset Encoder On First Power Up"):
            self.rest_at(0.0, self.context.now)
            self.follow(self.context.now)
        self._was_enabled = True

    def _cancel(self, now: float) -> None:
        transition, self._pending = self._pending, None
        self._current_at = self._done_at = inf
        if transition is not None and transition.number == _ENABLING:
            self._release(now)
        else:
            self.brake_at = now

    def _release(self, now: float) -> float:
        """Switch the current off: the command stands where it is, the shaft coasts."""
        self._acknowledged, self._reached = False, True
        self.awaits = self._pending = None
        self.brake_at = self._current_at = self._done_at = inf
        stands_at = self.shaft.current_off()
        self.trajectory.jump(now, self.trajectory.position(now))
        if self.encoder_reset_pending:
            self.reset_encoder()
        return stands_at

    def torque_off(self) -> None:
        """Switch the current off by Safe Torque Off, without a command (CSD MT S4)."""
        self._release(self.context.now)
        if self.state in CURRENT_ON:
            self.state = State.SWITCH_ON_DISABLED

    def change_mode(self, now: float) -> None:
        """Apply the mode of operation, in the states that allow it; otherwise the register waits."""
        if self.state not in _MODE_FIXED and self.settings.mode() != self.mode:
            super().change_mode(now)

    @property
    def ready(self) -> bool:
        """Whether a motion can be commanded."""
        return self.state is State.OPERATION_ENABLED and self._pending is None

    # Faults

    def protect(self, code: int, *, transient: bool = True, reaction: bool = False) -> None:
        """Go to FAULT, with an entry in the alarm log. A `transient` cause can be reset at once."""
        self.fault(code, self.context.now, transient=transient, reaction=reaction)
        self.context.alarms.add(code, self.context.clock.uptime)

    def following_error(self, *, transient: bool = True) -> None:
        """Carry out reaction 2: in profile velocity FAULT waits until the shaft stands (register 1085, A to C)."""
        self.protect(FOLLOWING, transient=transient, reaction=self.mode == VELOCITY)

    def _react_to_following_error(self) -> None:
        reaction = self.store.integer("Following Error Reaction Code")
        if reaction == 0:
            self._break_off()
        elif reaction == 2:
            self.following_error()

    def _break_off(self) -> None:
        """Stop with the ramp, or at once if the run has none: reaction 0 of register 1085."""
        now = self.context.now
        if self.mode == POSITION and self._runs_without_ramp(now):
            self.awaits, self._reached = None, True
            self.trajectory.jump(now, self.trajectory.position(now))
        else:
            self._stop(now)

    def _runs_without_ramp(self, now: float) -> bool:
        """Return whether the present run is a start-stop one: slow, and not on a ramp."""
        slow = self.settings.without_ramp(abs(self.trajectory.velocity(now)))
        return not self.trajectory.acceleration(now) and slow

    # Set-points

    def _set_point(self, word: int, now: float) -> None:
        if not self.ready or self._settles(now):
            return
        if not self.trajectory.moves(now) and not self._run_begins(relative=bool(word & RELATIVE)):
            return
        super()._set_point(word, now)

    def _run_begins(self, *, relative: bool) -> bool:
        """Reset bit 13 before a run. False: the run may not begin because of it (registers 1085, 1086)."""
        if self.shaft.error and self.store.integer("Following Error Reaction Code") == 1:
            return relative
        if self.shaft.error:
            self.reset_error()
        return True

    def replan(self, now: float) -> None:
        """Apply a new velocity to the present move, unless the shaft stops or turns round."""
        if not self._settles(now):
            super().replan(now)

    def _settles(self, now: float) -> bool:
        return now < max(self._stops_until, self.trajectory.turns_until)

    def start(self, *, relative: bool) -> None:
        """Act on a start input that became ON as on bit 4 of the control word (register 1067)."""
        if self.mode == POSITION and self.ready and not self._halts:
            self._set_point(RELATIVE if relative else 0, self.context.now)

    def start_falls(self) -> None:
        """Act on a start input that became OFF as on a reset of bit 4 of the control word."""
        if self.mode == POSITION:
            self._acknowledged = False

    def halted(self, now: float) -> bool:
        """Return whether bit 8 or an input commands a halt."""
        return super().halted(now) or self.inputs.halts(self.mode)

    def inputs_changed(self) -> None:
        """Apply a changed input, or a changed meaning of one: halt, limits."""
        now, trajectory = self.context.now, self.trajectory
        if not self.ready:
            return
        self.update_halt(now)
        heading = trajectory.velocity(now) or trajectory.position(trajectory.ends_at) - trajectory.position(now)
        if self.mode == VELOCITY:
            target = self.settings.target_velocity()
            if trajectory.velocity(trajectory.ends_at) != (target if self.may_go(target) else 0.0):
                self.follow(now)
        elif not self.may_go(heading):
            self._stop(now)  # "like it has received Halt command" (register 1008)

    def may_go(self, direction: float) -> bool:
        """Return whether no limit switch that is OFF blocks this direction."""
        inputs = self.inputs
        return not ((direction < 0 and inputs.below_limit) or (direction > 0 and inputs.above_limit))

    def _stop(self, now: float) -> None:
        self.awaits = None
        super()._stop(now)
        self._stops_until = self.trajectory.ends_at

    # Homing

    def _start_homing(self, now: float) -> None:
        if not self.ready or self.trajectory.moves(now) or self.awaits is not None:
            return
        self.homed = self._reached = False
        method = self.store.integer("Homing Method")
        if is_possible(method, auto_sync=self.shaft.auto_sync):
            self._run_begins(relative=True)
            self._steps = search_steps(
                method,
                fast=self.store.number("Homing Speed During Search for Switch"),
                slow=self.store.number("Homing Speed During Search for Zero"),
                ramp=self.store.number("Homing Acceleration"),
                in_switch=self.inputs.proximity,
            )
            self._next_step()

    def continue_search(self, sign: Sign) -> None:
        """Go on with a homing run if it is waiting for this sign."""
        if sign == self.awaits:
            self._next_step()

    def _next_step(self) -> None:
        step, now = next(self._steps, None), self.context.now
        if step is None:
            self._home_found()
            return
        self.awaits = step.until
        match step.move:
            case Run(velocity, ramp) if self.may_go(velocity):
                self.trajectory.run_at(now, velocity, ramp, ramp)
            case Run():
                self._stop(now)  # a limit switch ends the homing run: bit 11 is set, bit 12 stays 0
            case Retreat(direction, ramp):
                self._command_follows_shaft()
                position = self.trajectory.position(now)
                target = position - direction * self.store.number("Hard Stop Homing Disengaging Steps")
                self.trajectory.jump(now, position)
                self.shaft.hold()
                self.trajectory.move(now, target, _START_STOP, ramp, ramp, jerky=True)

    def _home_found(self) -> None:
        """Give the present position the number in Homing Offset."""
        self.awaits = None
        self.rest_at(self.store.number("Homing Offset"), self.context.now)
        self.homed = self._reached = True

    # Counters

    def rest_at(self, position: float, now: float) -> None:
        """End a movement here, and give the present place the number `position` in both counters."""
        place = self.shaft.position(now)
        super().rest_at(position, now)
        self.shaft.renumber(position, place)

    def reset_encoder(self) -> None:
        """Give the present position the number 0, also with a new direction or count per revolution."""
        self.encoder_reset_pending = False
        self.shaft.rescale()
        self.rest_at(0.0, self.context.now)

    def reset_error(self) -> None:
        """Reset bit 13; without Auto Sync the command counter takes the position of the encoder."""
        self.shaft.error = False
        if not self.shaft.auto_sync:
            self._command_follows_shaft()

    def _command_follows_shaft(self) -> None:
        """Remove the difference between encoder and command by renumbering the command; nothing moves."""
        now = self.context.now
        shift = self.shaft.encoder(now) - self.trajectory.position(now)
        self.trajectory.renumber(now, shift)
        self._goal += shift
        self._overall_start += shift
        self.shaft.command_renumbered(shift)
