"""Motion in closed form: where a shaft is and how fast, at any time, without stepping through the time before.

        velocity                                  a segment: at t0 position p0, velocity v0, then constant acceleration a
           ^      .--------.
           |     /          \\                     p(t) = p0 + v0 (t - t0) + a/2 (t - t0)^2
           |    / 1    2   3 \\                    v(t) = v0 + a (t - t0)
           '---'--------------'-----> t

`move` plans a trapezoid (or a triangle, where the way is too short for the velocity), from whatever velocity the shaft
has; `run_at` a ramp to a velocity. Positions are in steps, velocities in steps per second; both are floats here.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

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
            # Within a segment the velocity is a straight line: it is inside at its end, so at most once it came in.
            if abs(segment.velocity - centre) > width:
                edge = centre + (width if segment.velocity > centre else -width)
                return min(segment.start + (edge - segment.velocity) / segment.acceleration, until)
            until = segment.start
        return until

    # Plans. Each begins now and takes the place of what was planned for later.

    def _cut(self, now: float) -> tuple[float, float]:
        position, velocity = self.position(now), self.velocity(now)
        self.segments = [segment for segment in self.segments if segment.start < now][-KEPT:]
        return position, velocity

    def _add(self, start: float, velocity: float, acceleration: float) -> None:
        self.segments.append(Segment(start, self.position(start), velocity, acceleration))

    def jump(self, now: float, position: float) -> None:
        """Stand still at another position: what is called so is the same place."""
        self._cut(now)
        self.segments.append(Segment(now, position, 0.0, 0.0))

    def run_at(self, now: float, velocity: float, acceleration: float, deceleration: float) -> None:
        """Ramp to a velocity and keep it. Through zero the deceleration ends and the acceleration begins."""
        position, before = self._cut(now)
        self.segments.append(Segment(now, position, before, 0.0))
        if before * velocity < 0:
            now = self._ramp(now, before, 0.0, deceleration)
            before = 0.0
        self._ramp(now, before, velocity, acceleration if abs(velocity) > abs(before) else deceleration)

    def _ramp(self, start: float, before: float, after: float, rate: float) -> float:
        """One straight piece of velocity; returns when it ends. The segment behind it keeps `after`."""
        if self.segments[-1].start == start:
            self.segments.pop()
        here = Segment(start, self.position(start), before, 0.0) if not self.segments else None
        position = self._where(start, here)
        if before == after:
            self.segments.append(Segment(start, position, after, 0.0))
            return start
        slope = rate if after > before else -rate
        self.segments.append(Segment(start, position, before, slope))
        end = start + (after - before) / slope
        self.segments.append(Segment(end, self.segments[-1].position_at(end), after, 0.0))
        return end
