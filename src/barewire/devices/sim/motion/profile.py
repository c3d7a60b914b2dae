"""A motion profile as pieces of constant acceleration, and the school formula of how long a way takes.

        start-stop               trapezoid                triangle
        v  .-----.               v   .----.               v    .
           |     |                  /      \\                  / \\
        ---'     '---> t        ---'        '---> t        ---'   '---> t

The trapezoid lasts S/V + V/A if it speeds up and brakes with A and V² < A·S, the
triangle 2 √(S/A) (CSD MT manual, ch. 12, motion profiles).
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple


class Piece(NamedTuple):
    """Part of a plan: so long, from one velocity to another in a straight line."""

    duration: float
    before: float
    after: float


def trapezoid(
    way: float, before: float, velocity: float, acceleration: float, deceleration: float, sign: float, jerky: bool
) -> list[Piece]:
    """The pieces of a way that is long enough to stop on it, from a velocity that has its direction."""
    if way == 0:
        return [Piece(0.0, 0.0, 0.0)]
    if jerky:
        pieces = []
        if before > velocity:
            pieces.append(Piece((before - velocity) / deceleration, sign * before, sign * velocity))
            way = max(0.0, way - (before**2 - velocity**2) / (2 * deceleration))
        return [*pieces, Piece(way / velocity, sign * velocity, sign * velocity), Piece(0.0, 0.0, 0.0)]
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


def time_for(distance: float, velocity: float, acceleration: float) -> float:
    """How long a way ahead takes at constant acceleration; inf if it is too long."""
    under = velocity**2 + 2 * acceleration * distance
    if under < 0:
        return inf
    if velocity < 0:
        return (sqrt(under) - velocity) / acceleration if acceleration > 0 else inf
    divisor = velocity + sqrt(under)
    return 2 * distance / divisor if divisor > 0 else inf
