"""Motion in closed form: position and velocity of a shaft at any time, without steps of time.

        velocity                              a segment: from t0 on, at p0 with v0, constant acceleration a
           ^      .--------.
           |     /          \\                 p(t) = p0 + v0 (t - t0) + a/2 (t - t0)^2
           |    / 1    2   3 \\                v(t) = v0 + a (t - t0)
           '---'--------------'-----> t

`move` plans one of three profiles from the present velocity of the shaft, `run_at` a ramp to a velocity:

        start-stop               trapezoid                triangle (the distance is too short for the velocity)
        v  .-----.               v   .----.               v    .
           |     |                  /      \\                  / \\
        ---'     '---> t        ---'        '---> t        ---'   '---> t

The trapezoid lasts S/V + V/A if it accelerates and brakes with A and V² < A·S, the triangle 2 √(S/A) (CSD MT manual,
ch. 12, motion profiles).

`first`, `first_faster` and `first_at_rest` return the time at which something will be true, so a simulator can act at
that time without looking at every moment before. Positions are in steps, velocities in steps per second; both are
floats. A trajectory depends on nothing but numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from math import inf, sqrt
from typing import NamedTuple

_ROUNDING = 1e-6
"""Differences below this are rounding errors, in steps and steps per second."""

_HISTORY = 12
"""How many past segments are kept: more than one plan has, so that `inside_since` can look back."""


class MotionSegment(NamedTuple):
    """Constant acceleration from `start` on, until the next segment begins."""

    start: float
    position: float
    velocity: float
    acceleration: float

    def position_at(self, now: float) -> float:
        """Return the position."""
        if self.start == -inf or now <= self.start:
            return self.position
        time = now - self.start
        return self.position + (self.velocity + self.acceleration * time / 2) * time

    def velocity_at(self, now: float) -> float:
        """Return the velocity."""
        if self.start == -inf or now <= self.start:
            return self.velocity
        return self.velocity + self.acceleration * (now - self.start)


class _Ramp(NamedTuple):
    """Part of a plan: a duration in seconds, in which the velocity changes linearly from `before` to `after`."""

    duration: float
    before: float
    after: float


class Trajectory:
    """Segments one after the other; the last one goes on for ever.

    >>> path = Trajectory()
    >>> path.move(0.0, target=100.0, velocity=10.0, acceleration=10.0, deceleration=10.0)
    >>> path.ends_at, path.position(5.5), path.velocity(5.5), path.position(11.0)
    (11.0, 50.0, 10.0, 100.0)
    """

    def __init__(self, position: float = 0.0) -> None:
        self.segments: list[MotionSegment] = [MotionSegment(-inf, position, 0.0, 0.0)]
        self.turns_until = -inf
        """Until this time the last `move` brakes the shaft, before it turns round or comes back."""

    @classmethod
    def moving(cls, now: float, position: float, velocity: float) -> Trajectory:
        """Return the trajectory of a shaft that keeps this velocity."""
        path = cls(position)
        path.segments.append(MotionSegment(now, position, velocity, 0.0))
        return path

    def _at(self, now: float) -> MotionSegment:
        for segment in reversed(self.segments):
            if segment.start <= now:
                return segment
        return self.segments[0]

    def position(self, now: float) -> float:
        """Return the position."""
        return self._at(now).position_at(now)

    def velocity(self, now: float) -> float:
        """Return the velocity, with the sign of the direction."""
        return self._at(now).velocity_at(now)

    def acceleration(self, now: float) -> float:
        """Return the acceleration."""
        return self._at(now).acceleration

    def moves(self, now: float) -> bool:
        """Return whether a plan is being carried out. A shaft at constant velocity is at the end of its plan."""
        return now < self.ends_at

    @property
    def ends_at(self) -> float:
        """When the last plan is complete: from then on the velocity is constant."""
        return self.segments[-1].start

    def inside_since(self, now: float, center: float, width: float) -> float | None:
        """Return since when the velocity has been within `width` of `center`; None if it is not now."""
        if abs(self.velocity(now) - center) > width:
            return None
        until = now
        for segment in reversed(self.segments):
            if segment.start > now:
                continue
            if abs(segment.velocity_at(until) - center) > width + _ROUNDING:
                return until  # the velocity jumped
            # Within a segment the velocity is a straight line: inside at its end, it came in once at most.
            if abs(segment.velocity - center) > width + _ROUNDING:
                edge = center + (width if segment.velocity > center else -width)
                return segment.start + (edge - segment.velocity) / segment.acceleration
            until = segment.start
        return until

    # Times of events

    def _ahead(self, after: float) -> Iterator[tuple[float, float, MotionSegment]]:
        """Yield every segment that ends later than `after`, with its beginning (not before `after`) and its end."""
        for segment, following in pairwise([*self.segments, MotionSegment(inf, 0.0, 0.0, 0.0)]):
            if following.start > after:
                yield max(segment.start, after), following.start, segment

    def first(self, after: float, position: float, *, rising: bool) -> float:
        """Return when the shaft is first at `position` or above it (not `rising`: below it); inf if it never is.

        >>> path = Trajectory.moving(0.0, position=0.0, velocity=10.0)
        >>> path.first(1.0, 50.0, rising=True), path.first(1.0, 50.0, rising=False), path.first(1.0, -1.0, rising=False)
        (5.0, 1.0, inf)
        """
        sign = 1.0 if rising else -1.0
        for start, end, segment in self._ahead(after):
            distance = sign * (position - segment.position_at(start))
            if distance <= 0:
                return start
            reached_at = start + _time_for(distance, sign * segment.velocity_at(start), sign * segment.acceleration)
            if reached_at <= end:
                return reached_at
        return inf

    def first_faster(self, after: float, speed: float) -> float:
        """Return when the shaft is first faster than `speed`, in either direction; inf if it never is."""
        above = speed * (1 + _ROUNDING)
        for start, end, segment in self._ahead(after):
            velocity = segment.velocity_at(start)
            if abs(velocity) > above:
                return start
            if segment.acceleration:
                edge = above if segment.acceleration > 0 else -above
                reached_at = start + (edge - velocity) / segment.acceleration
                if reached_at <= end:
                    return reached_at
        return inf

    def first_at_rest(self, after: float, direction: float) -> float:
        """Return when a shaft that moves in `direction` first stands or moves the other way."""
        for start, end, segment in self._ahead(after):
            velocity = segment.velocity_at(start) * direction
            if velocity <= _ROUNDING:
                return start
            if segment.acceleration * direction < 0:
                reached_at = start - velocity / (segment.acceleration * direction)
                if reached_at <= end:
                    return reached_at
        return inf

    def minus(self, other: Trajectory, factor: float, shift: float, now: float) -> Trajectory:
        """Return the difference from now on: this trajectory minus (`factor` times the other, plus `shift`)."""
        between = Trajectory()
        starts = {now, *(segment.start for path in (self, other) for segment in path.segments if segment.start > now)}
        between.segments = [
            MotionSegment(
                start,
                self.position(start) - factor * other.position(start) - shift,
                self.velocity(start) - factor * other.velocity(start),
                self.acceleration(start) - factor * other.acceleration(start),
            )
            for start in sorted(starts)
        ]
        return between

    # Plans. Each begins now and replaces what was planned for later.

    def jump(self, now: float, position: float) -> None:
        """Stand still from now on, at `position`: the same place with another number."""
        self._cut(now)
        self.turns_until = -inf
        self.segments.append(MotionSegment(now, position, 0.0, 0.0))

    def renumber(self, now: float, shift: float) -> None:
        """Continue the same movement with other numbers: every position from now on is larger by `shift`."""
        later = [
            segment._replace(position=segment.position + shift) for segment in self.segments if segment.start > now
        ]
        acceleration = self.acceleration(now)
        position, velocity = self._cut(now)
        self.segments += [MotionSegment(now, position + shift, velocity, acceleration), *later]

    def run_at(self, now: float, velocity: float, acceleration: float, deceleration: float) -> None:
        """Ramp to a velocity and keep it: down to zero with `deceleration`, away from zero with `acceleration`."""
        before = self.velocity(now)
        self.turns_until = -inf
        ramps = []
        if before * velocity < 0:
            ramps.append(_Ramp(abs(before) / deceleration, before, 0.0))
            before = 0.0
        rate = acceleration if abs(velocity) > abs(before) else deceleration
        ramps.append(_Ramp(abs(velocity - before) / rate, before, velocity))
        self._follow(now, ramps)

    def stop(self, now: float, deceleration: float) -> None:
        """Ramp to standstill."""
        self.run_at(now, 0.0, deceleration, deceleration)

    def move(
        self, now: float, target: float, velocity: float, acceleration: float, deceleration: float, jerky: bool = False
    ) -> None:
        """Travel to `target` and stand there. A `jerky` move has no ramps: the velocity changes at once.

        A jerky move that begins while the shaft is faster has a ramp down to its velocity, and none at the end.
        A shaft that runs away from the target, or too fast to stop in time, is stopped first and comes back.
        """
        position, before = self.position(now), self.velocity(now)
        distance = target - position
        stopping = before * abs(before) / (2 * deceleration)
        ramps = []
        if before * distance < 0 or abs(stopping) > abs(distance) + _ROUNDING:
            ramps.append(_Ramp(abs(before) / deceleration, before, 0.0))
            distance -= stopping
            before = 0.0
        self.turns_until = now + sum(ramp.duration for ramp in ramps) if ramps else -inf
        sign = 1.0 if distance >= 0 else -1.0
        ramps += _profile(abs(distance), abs(before), velocity, acceleration, deceleration, sign, jerky)
        self._follow(now, ramps, target)

    def _cut(self, now: float) -> tuple[float, float]:
        position, velocity = self.position(now), self.velocity(now)
        self.segments = [segment for segment in self.segments if segment.start < now][-_HISTORY:]
        return position, velocity

    def _follow(self, now: float, ramps: Iterable[_Ramp], target: float | None = None) -> None:
        position, velocity = self._cut(now)
        for ramp in ramps:
            velocity = ramp.after
            if ramp.duration > 0:
                slope = (ramp.after - ramp.before) / ramp.duration
                self.segments.append(MotionSegment(now, position, ramp.before, slope))
                now += ramp.duration
                position = self.segments[-1].position_at(now)
        # The target is reached exactly: what the additions leave over is a rounding error.
        self.segments.append(MotionSegment(now, position if target is None else target, velocity, 0.0))


class ShaftMotion(NamedTuple):
    """The motion of a shaft from `since` on: sign * (trajectory + offset)."""

    since: float
    trajectory: Trajectory
    sign: float
    offset: float

    def position(self, now: float) -> float:
        """Return the position."""
        return self.sign * (self.trajectory.position(now) + self.offset)

    def first(self, after: float, position: float, *, rising: bool) -> float:
        """Return when the shaft is first at `position` or beyond it."""
        return self.trajectory.first(after, self.sign * position - self.offset, rising=rising is (self.sign > 0))


def wrapped(position: float, bits: int = 32) -> int:
    """Return a position as a signed counter of `bits` bits shows it.

    >>> wrapped(40000.4), wrapped(40000.4, 16), wrapped(2147483648.0)
    (40000, -25536, -2147483648)
    """
    half = 1 << bits - 1
    return (round(position) + half) % (1 << bits) - half


def _profile(
    distance: float, before: float, velocity: float, acceleration: float, deceleration: float, sign: float, jerky: bool
) -> list[_Ramp]:
    """Return the ramps of a move over a distance on which the shaft can stop, from a velocity in its direction."""
    if distance == 0:
        return [_Ramp(0.0, 0.0, 0.0)]
    if jerky:
        ramps = []
        if before > velocity:
            ramps.append(_Ramp((before - velocity) / deceleration, sign * before, sign * velocity))
            distance = max(0.0, distance - (before**2 - velocity**2) / (2 * deceleration))
        return [*ramps, _Ramp(distance / velocity, sign * velocity, sign * velocity), _Ramp(0.0, 0.0, 0.0)]
    if before > velocity:
        peak, to_peak = velocity, (before - velocity) / deceleration
        used = (before**2 - velocity**2) / (2 * deceleration)
    else:
        # The peak of the triangle, from  distance = (v^2 - v0^2) / 2a + v^2 / 2d.
        summit = sqrt(
            (2 * distance * acceleration * deceleration + deceleration * before**2) / (acceleration + deceleration)
        )
        peak = min(velocity, summit)
        to_peak = (peak - before) / acceleration
        used = (peak**2 - before**2) / (2 * acceleration)
    braking = peak / deceleration
    cruise = max(0.0, distance - used - peak * braking / 2) / peak  # a rounding error may be below 0
    first, top = sign * before, sign * peak
    return [_Ramp(to_peak, first, top), _Ramp(cruise, top, top), _Ramp(braking, top, 0.0)]


def _time_for(distance: float, velocity: float, acceleration: float) -> float:
    """Return how long a distance takes at constant acceleration; inf if it is never covered."""
    end_squared = velocity**2 + 2 * acceleration * distance  # the square of the velocity at the end of the distance
    if end_squared < 0:
        return inf
    end = sqrt(end_squared)
    if velocity < 0:
        return (end - velocity) / acceleration if acceleration > 0 else inf
    # Not (end - velocity) / acceleration, which is 0 / 0 for a constant velocity.
    return 2 * distance / (velocity + end) if velocity + end > 0 else inf
