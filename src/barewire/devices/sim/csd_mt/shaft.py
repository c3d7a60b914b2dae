"""The shaft of the CSD MT's motor: it follows the command, loses steps, is recovered by Auto Sync, or coasts.

        command counter C      the trajectory of the axis, in the drive's steps
        shaft R                held:     R = ±(C + k), the magnetic spring without its swing
                               let go:   a way of its own: blocked, out of step, recovering, or without current
        encoder E              R seen through 1121 and 1092, and what 1004 and 1020 show  (C, if 1085 is 17)
        following error        |C - E| outside of 1084, or of 1110 with Auto Sync --> bit 13, and what 1085 says

Out of step are a motor that is driven against a wall, one that is driven faster than the load lets it
(`World.pull_out`), and one whose shaft somebody turned (`slip`). Without Auto Sync it stands until the command stands
or goes the other way. With Auto Sync it runs after the command until the lag is gone. Drawn, not measured: how
fast it does that, and that a motor falls into step at any place, where a real one does so at each 1/50 revolution.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import inf
from typing import TYPE_CHECKING

from barewire.devices.sim.csd_mt.axis import Event
from barewire.devices.sim.csd_mt.environment import REVOLUTION
from barewire.devices.sim.motion.trajectory import Era, Trajectory, wrapped

if TYPE_CHECKING:
    from barewire.devices.sim.csd_mt.machine import CsdMt

EDGE = 1e-3
"""A switch and a wall are this many steps thick, so that one passage is one event."""

NO_ENCODER = 17
SPEED_TOO_HIGH = 0x8400
FULL_STEP = REVOLUTION / 200
WINDOWS = tuple(REVOLUTION * degrees / 360 for degrees in (0.9, 1.8, 3.6, 5.4, 7.2, 9.0))
"""Encoder Window (1084), in steps."""

RECOVERY = 640.0
"""Speed of recovery in step/s for each % of Auto Sync Kv (1109)."""

KEPT = 32


class Shaft:
    """The shaft and the encoder of one drive. It lives on when the drive is switched off."""

    def __init__(self, drive: CsdMt) -> None:
        self.drive = drive
        self.eras = [Era(-inf, Trajectory(), 1.0, 0.0)]
        self.has_current = False
        self.held = False
        self.lost = False
        """Bit 13: a following error that nobody has reset."""
        self.zero = 0.0
        self._ratio = self._ratio_set()
        self._sign, self._k = 1.0, 0.0
        self._out_of_step_towards = 1.0

    # Where

    def position(self, now: float) -> float:
        """R, in steps of the world."""
        return next((era for era in reversed(self.eras) if era.since <= now), self.eras[0]).position(now)

    def first(self, after: float, position: float, *, rising: bool) -> float:
        """When the shaft is first at a place or beyond it."""
        return self.eras[-1].first(after, position, rising=rising)

    @property
    def direction(self) -> float:
        """Revolution Direction (1092)."""
        return -1.0 if self.drive.store.whole("Revolution Direction") else 1.0

    @property
    def has_encoder(self) -> bool:
        """Whether the drive reads one (1085)."""
        return self.drive.store.whole("Following Error Reaction Code") != NO_ENCODER

    @property
    def auto_sync(self) -> bool:
        """Whether Auto Sync watches (1108); never without an encoder."""
        return self.has_encoder and self.drive.store.whole("Auto Sync Enable") > 0

    def _ratio_set(self) -> float:
        counts = self.drive.store.number("Encoder Count Per Revolution") or 1.0
        return self.direction * self.drive.environment.encoder / counts

    def encoder(self, now: float) -> float:
        """E, in steps of the drive."""
        return self._ratio * self.position(now) + self.zero

    def shown(self) -> int:
        """Position Actual Value (1004)."""
        now = self.drive.now
        return wrapped(self.encoder(now) if self.has_encoder else self.drive.axis.trajectory.position(now))

    def speed_shown(self) -> float:
        """Velocity Actual Value (1020): over so many milliseconds as 1113 says; the commanded one without encoder."""
        now = self.drive.now
        if not self.has_encoder:
            return self.drive.axis.trajectory.velocity(now)
        time = self.drive.store.number("Velocity Total Sample") / 1000 or 0.001
        return self._ratio * (self.position(now) - self.position(now - time)) / time

    @property
    def window(self) -> float:
        """How many steps of difference are a following error."""
        store = self.drive.store
        return store.number("Auto Sync Window") if self.auto_sync else WINDOWS[store.whole("Encoder Window")]

    # Lag: what Auto Sync acts on

    def _lag(self) -> Trajectory:
        era = self.eras[-1]
        return self.drive.axis.trajectory.minus(era.trajectory, self._sign * era.sign, -self._k, self.drive.now)

    @property
    def recovering(self) -> bool:
        """Whether Auto Sync is at work."""
        return self.has_current and self.auto_sync and not self.held

    @property
    def closed_loop(self) -> bool:
        """Bit 23 of Digital Input: farther behind than one full step at standstill, two in motion (register 1108)."""
        return self.recovering and abs(self._lag().position(self.drive.now)) > self._allowed()

    def _allowed(self) -> float:
        return FULL_STEP * (2 if self.drive.axis.trajectory.moves(self.drive.now) else 1)

    # What happens by itself

    def events(self) -> Iterator[Event]:
        """Walls; falling out of step and into it again; the following error."""
        now, axis, walls = self.drive.now, self.drive.axis, self.drive.environment.walls
        yield self.first(now, walls.high + EDGE, rising=True), partial(self._hit, walls.high, 1.0)
        yield self.first(now, walls.low - EDGE, rising=False), partial(self._hit, walls.low, -1.0)
        if not self.has_current:
            return
        if self.held:
            yield axis.trajectory.first_faster(now, max(self.drive.environment.pull_out, 1.0)), self._fall_out
        elif self.auto_sync:
            lag, towards = self._lag(), self._out_of_step_towards
            yield lag.first(now, -towards * EDGE, rising=towards < 0), self._recovered
            if axis.search is not None and axis.search.waits_for == "impact":
                there = lag.first(now, towards * 2 * FULL_STEP, rising=towards > 0)
                yield there, partial(axis.tell_search, "impact")
        else:
            yield axis.trajectory.first_at_rest(now, self._out_of_step_towards), self.hold
        if self.has_encoder and not self.lost:
            era = self.eras[-1]
            gap = axis.trajectory.minus(
                era.trajectory, self._ratio * era.sign, self._ratio * era.sign * era.offset + self.zero, now
            )
            window = self.window + EDGE
            yield gap.first(now, window, rising=True), self._following_error
            yield gap.first(now, -window, rising=False), self._following_error

    def _begin(self, way: Trajectory, sign: float, offset: float) -> None:
        self.eras = [*self.eras[-KEPT:], Era(self.drive.now, way, sign, offset)]

    def hold(self) -> None:
        """In step, from where shaft and command are now."""
        self._hold_at(self.position(self.drive.now))

    def _hold_at(self, place: float) -> None:
        self._sign = self.direction
        self._k = self._sign * place - self.drive.axis.trajectory.position(self.drive.now)
        self._begin(self.drive.axis.trajectory, self._sign, self._k)
        self.held = True

    def _recovered(self) -> None:
        self._begin(self.drive.axis.trajectory, self._sign, self._k)
        self.held = True
        if self.drive.store.whole("Following Error Reaction Code") == 1:
            self.lost = False  # "bit 13 becomes equal to 0 when the synchronization is recovered"

    def _hit(self, wall: float, direction: float) -> None:
        if self.held:
            self._out_of_step_towards = direction * self._sign
        self.held = False
        self._begin(Trajectory(wall), 1.0, 0.0)

    def _fall_out(self) -> None:
        """Too fast for the load."""
        velocity = self.drive.axis.trajectory.velocity(self.drive.now)
        self._run_after(1.0 if velocity >= 0 else -1.0)

    def _run_after(self, towards: float) -> None:
        """Auto Sync runs after the command; without it the shaft stands."""
        now, store = self.drive.now, self.drive.store
        speed = min(self.drive.environment.pull_out, RECOVERY * store.number("Auto Sync Kv")) if self.auto_sync else 0.0
        place = self.position(now)
        self._out_of_step_towards, self.held = towards, False
        self._begin(Trajectory.moving(now, place, self._sign * towards * speed), 1.0, 0.0)

    def sync_changed(self) -> None:
        """Auto Sync was switched on or off."""
        if self.has_current and not self.held:
            self._run_after(self._out_of_step_towards)

    def slip(self, steps: float) -> None:
        """Somebody turns the shaft by so many steps, against the current if there is any."""
        now = self.drive.now
        self._begin(Trajectory(self.position(now) + steps), 1.0, 0.0)
        if not self.has_current:
            return
        lag = self._lag().position(now)
        if self.auto_sync and abs(lag) > self._allowed():
            self._run_after(1.0 if lag > 0 else -1.0)
        else:
            self.hold()

    # Current

    def current_on(self) -> bool:
        """The shaft is caught where it is; False if it turns too fast for that (register 1116)."""
        now, store, axis = self.drive.now, self.drive.store, self.drive.axis
        limit = store.number("Power Up Speed Limit")
        if limit and abs(self.eras[-1].trajectory.velocity(now)) > limit:
            self.drive.protect(SPEED_TOO_HIGH)
            return False
        self.has_current, self.lost = True, False
        axis.trajectory.jump(now, self.encoder(now) if self.has_encoder else axis.trajectory.position(now))
        self.hold()
        return True

    def current_off(self) -> float:
        """The shaft coasts. Returns when it stands. Bit 13 goes with the current (register 1086)."""
        if self.has_current:
            era, now = self.eras[-1], self.drive.now
            self.turn(era.sign * era.trajectory.velocity(now))
        self.has_current = self.held = self.lost = False
        return self.eras[-1].trajectory.ends_at

    def turn(self, velocity: float) -> None:
        """Without current: the shaft has this velocity, and friction slows it down."""
        now = self.drive.now
        way = Trajectory.moving(now, self.position(now), velocity)
        way.stop(now, max(self.drive.environment.friction, 1.0))
        self._begin(way, 1.0, 0.0)

    # Following errors and numbers

    def _following_error(self) -> None:
        self.lost = True
        reaction = self.drive.store.whole("Following Error Reaction Code")
        if reaction == 0:
            self.drive.axis.break_off()
        elif reaction == 2:
            self.drive.following_error()

    def run_begins(self, *, relative: bool) -> bool:
        """A run may reset bit 13, or may not begin because of it (registers 1085, 1086)."""
        if self.lost and self.drive.store.whole("Following Error Reaction Code") == 1:
            return relative
        if self.lost:
            self.reset_error()
        return True

    def reset_error(self) -> None:
        """Bit 13 goes; without Auto Sync the command counter takes the position of the encoder."""
        self.lost = False
        if not self.auto_sync:
            self.command_follows_shaft()

    def command_follows_shaft(self) -> None:
        """The difference between encoder and command is forgotten; nothing moves."""
        now = self.drive.now
        by = self.encoder(now) - self.drive.axis.trajectory.position(now)
        self.drive.axis.renumber(by)
        self._k -= by
        if self.held:
            self._begin(self.drive.axis.trajectory, self._sign, self._k)

    def encoder_follows_command(self) -> None:
        """Position Error Reset = 2: "loading the logic step counter into the encoder position"."""
        now = self.drive.now
        self.lost = False
        self.zero += self.drive.axis.trajectory.position(now) - self.encoder(now)

    def call(self, position: float, place: float) -> None:
        """The place of the shaft has another name, in both counters; the command stands at it already."""
        self.zero = position - self._ratio * place
        if self.has_current:
            self._hold_at(place)

    def rescale(self) -> None:
        """Direction or counts per revolution may be others: the position stays what it is, from here on it differs."""
        if self._ratio == self._ratio_set():
            return
        now = self.drive.now
        before = self.encoder(now)
        self._ratio = self._ratio_set()
        self.zero += before - self.encoder(now)
