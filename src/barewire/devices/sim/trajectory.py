"""Motion in closed form: where a shaft is and how fast, at any time, without stepping through the time before.

        velocity                              a segment: from t0 on, at p0 with v0, constant acceleration a
           ^      .--------.
           |     /          \\                 p(t) = p0 + v0 (t - t0) + a/2 (t - t0)^2
           |    / 1    2   3 \\                v(t) = v0 + a (t - t0)
           '---'--------------'-----> t

`move` plans a trapezoid (or a triangle, where the way is too short for the velocity), from whatever velocity the shaft
has; `run_at` a ramp to a velocity. Positions are in steps, velocities in steps per second; both are floats here.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf, sqrt
from typing import NamedTuple

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


class Piece(NamedTuple):
    """Part of a plan: so long, from one velocity to another in a straight line."""

    duration: float
    before: float
    after: float


class Trajectory:
    """Segments one after the other; the last one goes on for ever.

    >>> way = Trajectory()
    >>> way.move(0.0, target=100.0, velocity=10.0, acceleration=10.0, deceleration=10.0)
    >>> way.ends_at, way.position(5.5), way.velocity(5.5), way.position(11.0)
    (11.0, 50.0, 10.0, 100.0)
    """

    def __init__(self, position: float = 0.0) -> None:
        self.segments: list[Segment] = [Segment(-inf, position, 0.0, 0.0)]

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

    # Plans. Each begins now and takes the place of what was planned for later.

    def jump(self, now: float, position: float) -> None:
        """Stand still at another position: what is called so is the same place."""
        self._cut(now)
        self.segments.append(Segment(now, position, 0.0, 0.0))

    def run_at(self, now: float, velocity: float, acceleration: float, deceleration: float) -> None:
        """Ramp to a velocity and keep it. Through zero the deceleration ends and the acceleration begins."""
        before = self.velocity(now)
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
        sign = 1.0 if way >= 0 else -1.0
        pieces += _trapezoid(abs(way), abs(before), velocity, acceleration, deceleration, sign, jerky)
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


def _trapezoid(
    way: float, before: float, velocity: float, acceleration: float, deceleration: float, sign: float, jerky: bool
) -> list[Piece]:
    """The pieces of a way that is long enough to stop on it, from a velocity that has its direction."""
    if way == 0:
        return [Piece(0.0, 0.0, 0.0)]
    if jerky:
        return [Piece(way / velocity, sign * velocity, sign * velocity), Piece(0.0, 0.0, 0.0)]
    if before > velocity:
        peak, first = velocity, (before - velocity) / deceleration
        used = (before**2 - velocity**2) / (2 * deceleration)
    else:
        # The peak of the triangle, from  way = (v^2 - v0^2) / 2a + v^2 / 2d.
        summit = sqrt(
            (2 * way * acceleration * deceleration + deceleration * before**2) / (acceleration + deceleration)
        )
        peak = min(velocity, summit)
        first = (peak - before) / acceleration
        used = (peak**2 - before**2) / (2 * acceleration)
    last = peak / deceleration
    cruise = max(0.0, way - used - peak * last / 2) / peak
    up, down = sign * before, sign * peak
    return [Piece(first, up, down), Piece(cruise, down, down), Piece(last, down, 0.0)]


def wrapped(position: float, bits: int = 32) -> int:
    """A position as a signed counter of so many bits shows it.

    >>> wrapped(40000.4), wrapped(40000.4, 16), wrapped(2147483648.0)
    (40000, -25536, -2147483648)
    """
    half = 1 << bits - 1
    return (round(position) + half) % (1 << bits) - half
