"""The shaft of the CSD MT's motor: it follows the command, loses steps, is recovered by Auto Sync, or coasts.

        command counter C      `command`, the trajectory of the axis, in the drive's steps
        shaft R                in step:   R = ±(C + offset), the magnetic spring without its oscillation
                               otherwise: a motion of its own: blocked, out of step, recovering, or without current
        encoder E              R through 1121 and 1092; 1004 and 1020 show it  (C, if 1085 is 17)
        following error        |C - E| outside of 1084, or of 1110 with Auto Sync --> bit 13, and the reaction of 1085

A motor is out of step after it was driven against a wall, or faster than the load allows (`Environment.pull_out`), or
after its shaft was turned by force (`slip`). Without Auto Sync the shaft then stands until the command stands or
changes its direction. With Auto Sync it runs after the command until the lag is gone. Simplified: its speed then, and
that a motor falls into step at any place; a real one does so at each 1/50 revolution.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from math import inf

from barewire.devices.sim.csd_mt.environment import REVOLUTION, Context, TimedAction
from barewire.devices.sim.trajectory import ShaftMotion, Trajectory, wrapped

EDGE = 1e-3
"""A switch and a wall are this many steps thick, so that one passage is one event."""

NO_ENCODER = 17
"""Value of Following Error Reaction Code (1085) for a drive without encoder."""

_FULL_STEP = REVOLUTION / 200
_WINDOWS = tuple(REVOLUTION * degrees / 360 for degrees in (0.9, 1.8, 3.6, 5.4, 7.2, 9.0))
"""Encoder Window (1084), in steps."""

_RECOVERY = 640.0
"""Speed of recovery in step/s for each % of Auto Sync Kv (1109)."""

_HISTORY = 32
"""How many past motions are kept, for the velocity over the last milliseconds."""


class Shaft:
    """The shaft and the encoder of one drive. It keeps its state when the drive is switched off."""

    def __init__(self, context: Context) -> None:
        self.context, self.store = context, context.store
        self.command = Trajectory()
        """The trajectory that the motor is to follow, in steps of the drive. Set by the axis."""
        self.on_following_error: Callable[[], None] = lambda: None
        """Called when a following error begins. Set by the axis."""
        self.motions = [ShaftMotion(-inf, Trajectory(), 1.0, 0.0)]
        self.has_current = False
        self.in_step = False
        self.error = False
        """Bit 13: a following error that has not been reset."""
        self._zero = 0.0
        self._ratio = self._ratio_set()
        self._sign, self._offset = 1.0, 0.0
        self._out_of_step_towards = 1.0

    # Position

    def position(self, now: float) -> float:
        """Return R, in steps of the environment."""
        motions = self.motions
        return next((motion for motion in reversed(motions) if motion.since <= now), motions[0]).position(now)

    def first(self, after: float, position: float, *, rising: bool) -> float:
        """Return when the shaft is first at a position or beyond it; inf if it never is."""
        return self.motions[-1].first(after, position, rising=rising)

    @property
    def direction(self) -> float:
        """Revolution Direction (1092) as 1 or -1."""
        return -1.0 if self.store.integer("Revolution Direction") else 1.0

    @property
    def has_encoder(self) -> bool:
        """Whether the drive reads an encoder (1085)."""
        return self.store.integer("Following Error Reaction Code") != NO_ENCODER

    @property
    def auto_sync(self) -> bool:
        """Whether Auto Sync is enabled (1108); never without an encoder."""
        return self.has_encoder and self.store.integer("Auto Sync Enable") > 0

    def _ratio_set(self) -> float:
        counts = self.store.number("Encoder Count Per Revolution") or 1.0
        return self.direction * self.context.environment.encoder / counts

    def encoder(self, now: float) -> float:
        """Return E, in steps of the drive."""
        return self._ratio * self.position(now) + self._zero

    def shown_position(self) -> int:
        """Return Position Actual Value (1004)."""
        now = self.context.now
        return wrapped(self.encoder(now) if self.has_encoder else self.command.position(now))

    def shown_velocity(self) -> float:
        """Return Velocity Actual Value (1020): the mean over the time in 1113, or the command without an encoder."""
        now = self.context.now
        if not self.has_encoder:
            return self.command.velocity(now)
        time = self.store.number("Velocity Total Sample") / 1000 or 0.001
        return self._ratio * (self.position(now) - self.position(now - time)) / time

    def _window(self) -> float:
        """Return the difference in steps above which there is a following error."""
        if self.auto_sync:
            return self.store.number("Auto Sync Window")
        return _WINDOWS[self.store.integer("Encoder Window")]

    # The lag on which Auto Sync acts

    def _lag(self) -> Trajectory:
        motion = self.motions[-1]
        return self.command.minus(motion.trajectory, self._sign * motion.sign, -self._offset, self.context.now)

    @property
    def recovering(self) -> bool:
        """Whether Auto Sync is moving the shaft after the command."""
        return self.has_current and self.auto_sync and not self.in_step

    @property
    def closed_loop(self) -> bool:
        """Bit 23 of Digital Input: farther behind than one full step at standstill, two in motion (register 1108)."""
        return self.recovering and abs(self._lag().position(self.context.now)) > self._allowed_lag()

    def _allowed_lag(self) -> float:
        return _FULL_STEP * (2 if self.command.moves(self.context.now) else 1)

    def impact_at(self) -> float:
        """Return when Auto Sync detects that the shaft is blocked, two full steps behind; inf if it does not."""
        if not self.recovering:
            return inf
        towards = self._out_of_step_towards
        return self._lag().first(self.context.now, towards * 2 * _FULL_STEP, rising=towards > 0)

    # Timed actions

    def events(self) -> Iterator[TimedAction]:
        """Yield impacts on a wall, loss of step and return into step, and following errors."""
        now, environment = self.context.now, self.context.environment
        walls = environment.walls
        yield self.first(now, walls.high + EDGE, rising=True), partial(self._hit, walls.high, 1.0)
        yield self.first(now, walls.low - EDGE, rising=False), partial(self._hit, walls.low, -1.0)
        if not self.has_current:
            return
        if self.in_step:
            yield self.command.first_faster(now, max(environment.pull_out, 1.0)), self._fall_out
        elif self.auto_sync:
            towards = self._out_of_step_towards
            yield self._lag().first(now, -towards * EDGE, rising=towards < 0), self._recovered
        else:
            yield self.command.first_at_rest(now, self._out_of_step_towards), self.hold
        if self.has_encoder and not self.error:
            motion = self.motions[-1]
            factor = self._ratio * motion.sign
            gap = self.command.minus(motion.trajectory, factor, factor * motion.offset + self._zero, now)
            window = self._window() + EDGE
            yield gap.first(now, window, rising=True), self._following_error
            yield gap.first(now, -window, rising=False), self._following_error

    def _begin(self, trajectory: Trajectory, sign: float, offset: float) -> None:
        motion = ShaftMotion(self.context.now, trajectory, sign, offset)
        self.motions = [*self.motions[-_HISTORY:], motion]

    def hold(self) -> None:
        """Fall into step, with shaft and command where they are now."""
        self._hold_at(self.position(self.context.now))

    def _hold_at(self, place: float) -> None:
        self._sign = self.direction
        self._offset = self._sign * place - self.command.position(self.context.now)
        self._begin(self.command, self._sign, self._offset)
        self.in_step = True

    def _recovered(self) -> None:
        self._begin(self.command, self._sign, self._offset)
        self.in_step = True
        if self.store.integer("Following Error Reaction Code") == 1:
            self.error = False  # "bit 13 becomes equal to 0 when the synchronization is recovered"

    def _hit(self, wall: float, direction: float) -> None:
        if self.in_step:
            self._out_of_step_towards = direction * self._sign
        self.in_step = False
        self._begin(Trajectory(wall), 1.0, 0.0)

    def _fall_out(self) -> None:
        """Fall out of step: the command is too fast for the load."""
        self._run_after(1.0 if self.command.velocity(self.context.now) >= 0 else -1.0)

    def _run_after(self, towards: float) -> None:
        """Move a shaft that is out of step: with Auto Sync it runs after the command, without it it stands."""
        now, speed = self.context.now, 0.0
        if self.auto_sync:
            speed = min(self.context.environment.pull_out, _RECOVERY * self.store.number("Auto Sync Kv"))
        place = self.position(now)
        self._out_of_step_towards, self.in_step = towards, False
        self._begin(Trajectory.moving(now, place, self._sign * towards * speed), 1.0, 0.0)

    def _following_error(self) -> None:
        self.error = True
        self.on_following_error()

    def auto_sync_changed(self) -> None:
        """Act on Auto Sync being enabled or disabled."""
        if self.has_current and not self.in_step:
            self._run_after(self._out_of_step_towards)

    def slip(self, steps: float) -> None:
        """Turn the shaft by force, against the current if there is any."""
        now = self.context.now
        self._begin(Trajectory(self.position(now) + steps), 1.0, 0.0)
        if not self.has_current:
            return
        lag = self._lag().position(now)
        if self.auto_sync and abs(lag) > self._allowed_lag():
            self._run_after(1.0 if lag > 0 else -1.0)
        else:
            self.hold()

    # Current

    @property
    def is_too_fast(self) -> bool:
        """Whether the shaft turns too fast for switching the current on (register 1116)."""
        limit = self.store.number("Power Up Speed Limit")
        return bool(limit) and abs(self.motions[-1].trajectory.velocity(self.context.now)) > limit

    def current_on(self) -> None:
        """Catch the shaft where it is; the command counter takes the position of the encoder."""
        now = self.context.now
        self.has_current, self.error = True, False
        self.command.jump(now, self.encoder(now) if self.has_encoder else self.command.position(now))
        self.hold()

    def current_off(self) -> float:
        """Let the shaft coast. Returns when it stands. Bit 13 is reset with the current (register 1086)."""
        if self.has_current:
            motion = self.motions[-1]
            self.turn(motion.sign * motion.trajectory.velocity(self.context.now))
        self.has_current = self.in_step = self.error = False
        return self.motions[-1].trajectory.ends_at

    def turn(self, velocity: float) -> None:
        """Give a shaft without current a velocity in step/s; friction slows it down."""
        now = self.context.now
        trajectory = Trajectory.moving(now, self.position(now), velocity)
        trajectory.stop(now, max(self.context.environment.friction, 1.0))
        self._begin(trajectory, 1.0, 0.0)

    # Counters

    def command_renumbered(self, shift: float) -> None:
        """Keep the shaft where it is after every position of the command has become larger by `shift`."""
        self._offset -= shift
        if self.in_step:
            self._begin(self.command, self._sign, self._offset)

    def encoder_follows_command(self) -> None:
        """Position Error Reset = 2: "loading the logic step counter into the encoder position"."""
        now = self.context.now
        self.error = False
        self._zero += self.command.position(now) - self.encoder(now)

    def renumber(self, position: float, place: float) -> None:
        """Give the place of the shaft the number `position` in the encoder; the command already has it."""
        self._zero = position - self._ratio * place
        if self.has_current:
            self._hold_at(place)

    def rescale(self) -> None:
        """Apply a new direction or count per revolution: the position stays, and changes differently from here on."""
        if self._ratio == self._ratio_set():
            return
        now = self.context.now
        before = self.encoder(now)
        self._ratio = self._ratio_set()
        self._zero += before - self.encoder(now)
