"""Motion in closed form: where a shaft is and how fast, at any time, without stepping through the time before.

        velocity                              a segment: from t0 on, at p0 with v0, constant acceleration a
           ^      .--------.
           |     /          \\                 p(t) = p0 + v0 (t - t0) + a/2 (t - t0)^2
           |    / 1    2   3 \\                v(t) = v0 + a (t - t0)
           '---'--------------'-----> t

`move` plans a trapezoid (or a triangle, where the way is too short for the velocity), from whatever velocity the shaft
has; `run_at` a ramp to a velocity. `first`, `first_faster` and `first_at_rest` say when something will be so, which is
how a simulator acts at the right moment without looking at every moment before. Positions are in steps, velocities in
steps per second; both are floats here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from math import inf
from typing import NamedTuple

from barewire.devices.sim.motion.profile import Piece, time_for, trapezoid

ROUNDING = 1e-6
"""What counts as nothing, in steps and steps per second."""

KEPT = 12
"""How many segments are remembered: more than one plan has, so that the last few moments can be looked back on."""


class Segment(NamedTuple):
    """Constant acceleration from `start` on, until the next segment begins."""

    start: float
    position: float
    velocity: float
    acceleration: float

    def position_at(self, now: float) -> float:
        """Where the shaft is."""
        if self.start == -inf or now <= self.start:
            return self.position
        time = now - self.start
        return self.position + (self.velocity + self.acceleration * time / 2) * time

    def velocity_at(self, now: float) -> float:
        """How fast it is."""
        if self.start == -inf or now <= self.start:
            return self.velocity
        return self.velocity + self.acceleration * (now - self.start)


class Trajectory:
    """Segments one after the other; the last one goes on for ever.

    >>> way = Trajectory()
    >>> way.move(0.0, target=100.0, velocity=10.0, acceleration=10.0, deceleration=10.0)
    >>> way.ends_at, way.position(5.5), way.velocity(5.5), way.position(11.0)
    (11.0, 50.0, 10.0, 100.0)
    """

    def __init__(self, position: float = 0.0) -> None:
        self.segments: list[Segment] = [Segment(-inf, position, 0.0, 0.0)]
        self.turns_until = -inf
        """Until when the last `move` stops the shaft, to go the other way after that."""

    @classmethod
    def moving(cls, now: float, position: float, velocity: float) -> Trajectory:
        """A shaft that has this velocity and keeps it."""
        way = cls(position)
        way.segments.append(Segment(now, position, velocity, 0.0))
        return way

    def _at(self, now: float) -> Segment:
        for segment in reversed(self.segments):
            if segment.start <= now:
                return segment
        return self.segments[0]

    def position(self, now: float) -> float:
        """Where the shaft is."""
        return self._at(now).position_at(now)

    def velocity(self, now: float) -> float:
        """How fast it is, with the sign of the direction."""
        return self._at(now).velocity_at(now)

    def acceleration(self, now: float) -> float:
        """How fast the velocity changes."""
        return self._at(now).acceleration

    def moves(self, now: float) -> bool:
        """Whether a plan is being carried out: a shaft at constant velocity is at the end of one."""
        return now < self.ends_at

    @property
    def ends_at(self) -> float:
        """When the last plan is carried out: from then on the velocity stays as it is."""
        return self.segments[-1].start

    def inside_since(self, now: float, centre: float, width: float) -> float | None:
        """Since when the velocity has been within `width` of `centre` without a break; None if it is not now."""
        if abs(self.velocity(now) - centre) > width:
            return None
        until = now
        for segment in reversed(self.segments):
            if segment.start > now:
                continue
            if abs(segment.velocity_at(until) - centre) > width + ROUNDING:
                return until  # the velocity jumped
            # Within a segment the velocity is a straight line: inside at its end, it came in once at most.
            if abs(segment.velocity - centre) > width + ROUNDING:
                edge = centre + (width if segment.velocity > centre else -width)
                return segment.start + (edge - segment.velocity) / segment.acceleration
            until = segment.start
        return until

    # When

    def _ahead(self, after: float) -> Iterator[tuple[float, float, Segment]]:
        """Every stretch that is not over at `after`: from when, until when, and its segment."""
        for segment, following in pairwise([*self.segments, Segment(inf, 0.0, 0.0, 0.0)]):
            if following.start > after:
                yield max(segment.start, after), following.start, segment

    def first(self, after: float, position: float, *, rising: bool) -> float:
        """When the shaft is first at `position` or above it (not `rising`: or below it); inf if it never is.

        >>> way = Trajectory.moving(0.0, position=0.0, velocity=10.0)
        >>> way.first(1.0, 50.0, rising=True), way.first(1.0, 50.0, rising=False), way.first(1.0, -1.0, rising=False)
        (5.0, 1.0, inf)
        """
        sign = 1.0 if rising else -1.0
        for start, end, segment in self._ahead(after):
            distance = sign * (position - segment.position_at(start))
            if distance <= 0:
                return start
            at = start + time_for(distance, sign * segment.velocity_at(start), sign * segment.acceleration)
            if at <= end:
                return at
        return inf

    def first_faster(self, after: float, speed: float) -> float:
        """When the shaft is first faster than `speed`, whatever the direction; inf if it never is."""
        above = speed * (1 + ROUNDING)
        for start, end, segment in self._ahead(after):
            velocity = segment.velocity_at(start)
            if abs(velocity) > above:
                return start
            if segment.acceleration:
                edge = above if segment.acceleration > 0 else -above
                at = start + (edge - velocity) / segment.acceleration
                if at <= end:
                    return at
        return inf

    def first_at_rest(self, after: float, direction: float) -> float:
        """When a shaft that goes in `direction` first stands, or goes the other way."""
        for start, end, segment in self._ahead(after):
            velocity = segment.velocity_at(start) * direction
            if velocity <= ROUNDING:
                return start
            if segment.acceleration * direction < 0:
                at = start - velocity / (segment.acceleration * direction)
                if at <= end:
                    return at
        return inf

    def minus(self, other: Trajectory, factor: float, shift: float, now: float) -> Trajectory:
        """What is between the two from now on: this one less (`factor` times the other, plus `shift`)."""
        between = Trajectory()
        starts = {now, *(segment.start for way in (self, other) for segment in way.segments if segment.start > now)}
        between.segments = [
            Segment(
                at,
                self.position(at) - factor * other.position(at) - shift,
                self.velocity(at) - factor * other.velocity(at),
                self.acceleration(at) - factor * other.acceleration(at),
            )
            for at in sorted(starts)
        ]
        return between

    # Plans. Each begins now and takes the place of what was planned for later.

    def jump(self, now: float, position: float) -> None:
        """Stand still at another position: what is called so is the same place."""
        self._cut(now)
        self.turns_until = -inf
        self.segments.append(Segment(now, position, 0.0, 0.0))

    def renumber(self, now: float, by: float) -> None:
        """The same movement goes on, under other numbers: every position from now on is larger by `by`."""
        later = [segment._replace(position=segment.position + by) for segment in self.segments if segment.start > now]
        acceleration = self.acceleration(now)
        position, velocity = self._cut(now)
        self.segments += [Segment(now, position + by, velocity, acceleration), *later]

    def run_at(self, now: float, velocity: float, acceleration: float, deceleration: float) -> None:
        """Ramp to a velocity and keep it. Through zero the deceleration ends and the acceleration begins."""
        before = self.velocity(now)
        self.turns_until = -inf
        pieces = []
        if before * velocity < 0:
            pieces.append(Piece(abs(before) / deceleration, before, 0.0))
            before = 0.0
        rate = acceleration if abs(velocity) > abs(before) else deceleration
        pieces.append(Piece(abs(velocity - before) / rate, before, velocity))
        self._follow(now, pieces)

    def stop(self, now: float, deceleration: float) -> None:
        """Ramp to standstill."""
        self.run_at(now, 0.0, deceleration, deceleration)

    def move(
        self, now: float, target: float, velocity: float, acceleration: float, deceleration: float, jerky: bool = False
    ) -> None:
        """Travel to `target` and stand there. A `jerky` one has no ramps: the velocity is there at once.

        A jerky one that begins while the shaft is faster has a ramp down to its velocity, and none at the end.
        A shaft that runs the wrong way, or too fast to stop in time, is stopped first and comes back.
        """
        position, before = self.position(now), self.velocity(now)
        way = target - position
        stopping = before * abs(before) / (2 * deceleration)
        pieces = []
        if before * way < 0 or abs(stopping) > abs(way) + ROUNDING:
            pieces.append(Piece(abs(before) / deceleration, before, 0.0))
            way -= stopping
            before = 0.0
        self.turns_until = now + sum(piece.duration for piece in pieces) if pieces else -inf
        sign = 1.0 if way >= 0 else -1.0
        pieces += trapezoid(abs(way), abs(before), velocity, acceleration, deceleration, sign, jerky)
        self._follow(now, pieces, target)

    def _cut(self, now: float) -> tuple[float, float]:
        position, velocity = self.position(now), self.velocity(now)
        self.segments = [segment for segment in self.segments if segment.start < now][-KEPT:]
        return position, velocity

    def _follow(self, now: float, pieces: Iterable[Piece], target: float | None = None) -> None:
        position, velocity = self._cut(now)
        for piece in pieces:
            velocity = piece.after
            if piece.duration > 0:
                slope = (piece.after - piece.before) / piece.duration
                self.segments.append(Segment(now, position, piece.before, slope))
                now += piece.duration
                position = self.segments[-1].position_at(now)
        # What arithmetic leaves over after the last step is no distance: the target is reached exactly.
        self.segments.append(Segment(now, position if target is None else target, velocity, 0.0))


class Era(NamedTuple):
    """What follows a trajectory under other numbers, from `since` on: sign * (way + offset)."""

    since: float
    trajectory: Trajectory
    sign: float
    offset: float

    def position(self, now: float) -> float:
        """Where it is."""
        return self.sign * (self.trajectory.position(now) + self.offset)

    def first(self, after: float, position: float, *, rising: bool) -> float:
        """When it is first there or beyond."""
        return self.trajectory.first(after, self.sign * position - self.offset, rising=rising is (self.sign > 0))


def wrapped(position: float, bits: int = 32) -> int:
    """A position as a signed counter of so many bits shows it.

    >>> wrapped(40000.4), wrapped(40000.4, 16), wrapped(2147483648.0)
    (40000, -25536, -2147483648)
    """
    half = 1 << bits - 1
    return (round(position) + half) % (1 << bits) - half
