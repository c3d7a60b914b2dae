"""Motion in closed form, held against the formulas and against itself."""

from __future__ import annotations

from math import sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from barewire.devices.sim.trajectory import Trajectory

RATES = st.floats(1.0, 1e6)


@pytest.mark.parametrize(
    ("way", "velocity", "rate", "lasts"),
    [
        (240_000, 90_000, 140_000, 240_000 / 90_000 + 90_000 / 140_000),  # a trapezoid: S/V + V/A
        (10_000, 90_000, 140_000, 2 * sqrt(10_000 / 140_000)),  # a triangle: 2 sqrt(S/A)
        (-240_000, 90_000, 140_000, 240_000 / 90_000 + 90_000 / 140_000),
        (0, 90_000, 140_000, 0.0),
    ],
)
def test_a_move_lasts_as_long_as_the_formula_says(way: float, velocity: float, rate: float, lasts: float) -> None:
    run = Trajectory()
    run.move(5.0, way, velocity, rate, rate)
    assert run.ends_at == pytest.approx(5.0 + lasts)
    assert (run.position(run.ends_at), run.velocity(run.ends_at)) == (way, 0.0)


@given(RATES, RATES, RATES, st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(0.0, 3.0))
def test_wherever_it_is_and_however_fast_it_arrives(
    velocity: float, up: float, down: float, first: float, second: float, when: float
) -> None:
    run = Trajectory()
    run.move(0.0, first, velocity, up, down)
    run.move(when, second, velocity, up, down)
    assert run.position(run.ends_at + 1) == second
    assert run.velocity(run.ends_at + 1) == 0
    # Position and velocity have no jumps where segments meet.
    for segment in run.segments[1:]:
        just_before = segment.start - 1e-9 * max(1.0, abs(segment.start))
        assert run.position(just_before) == pytest.approx(segment.position, rel=1e-4, abs=1.0)


def test_a_shaft_too_fast_to_stop_comes_back() -> None:
    run = Trajectory()
    run.run_at(0.0, 100.0, 100.0, 100.0)
    run.move(2.0, run.position(2.0) + 10, 100.0, 100.0, 100.0)
    assert max(run.position(2 + step / 100) for step in range(300)) == pytest.approx(150 + 50, abs=0.1)
    assert run.position(run.ends_at) == 160


def test_since_when_the_velocity_is_right() -> None:
    run = Trajectory()
    run.run_at(1.0, 100.0, 10.0, 10.0)
    assert run.inside_since(0.5, 0.0, 5.0) == float("-inf")
    assert run.inside_since(5.0, 100.0, 20.0) is None
    assert run.inside_since(20.0, 100.0, 20.0) == pytest.approx(9.0)
    run.run_at(20.0, -100.0, 10.0, 10.0)
    assert run.inside_since(60.0, -100.0, 20.0) == pytest.approx(38.0)


def test_a_slower_velocity_on_the_way() -> None:
    run = Trajectory()
    run.move(0.0, 1000.0, 100.0, 100.0, 100.0)
    run.move(2.0, 1000.0, 50.0, 100.0, 100.0)
    assert run.velocity(2.5) == 50
    # 150 steps are behind; braking to 50 takes 37.5, stopping from there 12.5, the rest goes at 50 per second.
    assert run.ends_at == pytest.approx(2 + 0.5 + (850 - 37.5 - 12.5) / 50 + 0.5)
    assert run.position(run.ends_at) == 1000


def test_a_jump_of_velocity_ends_what_was_before() -> None:
    run = Trajectory()
    run.move(1.0, 100.0, 10.0, 10.0, 10.0, jerky=True)
    assert run.inside_since(5.0, 10.0, 1.0) == 1.0
    assert run.inside_since(20.0, 0.0, 1.0) == pytest.approx(11.0)
