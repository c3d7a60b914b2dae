"""Motion in closed form, compared with the formulas and with itself."""

from __future__ import annotations

from math import inf, sqrt

import pytest
from hypothesis import given, strategies as st

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
def test_the_duration_of_a_move_follows_the_formula(way: float, velocity: float, rate: float, lasts: float) -> None:
    run = Trajectory()
    run.move(5.0, way, velocity, rate, rate)
    assert run.ends_at == pytest.approx(5.0 + lasts)
    assert (run.position(run.ends_at), run.velocity(run.ends_at)) == (way, 0.0)


@given(RATES, RATES, RATES, st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(0.0, 3.0))
def test_a_second_move_always_arrives_at_its_target(
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


def test_inside_since_finds_when_the_velocity_came_in() -> None:
    run = Trajectory()
    run.run_at(1.0, 100.0, 10.0, 10.0)
    assert run.inside_since(0.5, 0.0, 5.0) == float("-inf")
    assert run.inside_since(5.0, 100.0, 20.0) is None
    assert run.inside_since(20.0, 100.0, 20.0) == pytest.approx(9.0)
    run.run_at(20.0, -100.0, 10.0, 10.0)
    assert run.inside_since(60.0, -100.0, 20.0) == pytest.approx(38.0)


def test_a_slower_velocity_in_motion() -> None:
    run = Trajectory()
    run.move(0.0, 1000.0, 100.0, 100.0, 100.0)
    run.move(2.0, 1000.0, 50.0, 100.0, 100.0)
    assert run.velocity(2.5) == 50
    # 150 steps are behind; braking to 50 takes 37.5, stopping from there 12.5, the rest goes at 50 per second.
    assert run.ends_at == pytest.approx(2 + 0.5 + (850 - 37.5 - 12.5) / 50 + 0.5)
    assert run.position(run.ends_at) == 1000


def test_inside_since_ends_at_a_jump_of_velocity() -> None:
    run = Trajectory()
    run.move(1.0, 100.0, 10.0, 10.0, 10.0, jerky=True)
    assert run.inside_since(5.0, 10.0, 1.0) == 1.0
    assert run.inside_since(20.0, 0.0, 1.0) == pytest.approx(11.0)


def test_first_finds_when_a_position_is_reached() -> None:
    run = Trajectory()
    run.move(1.0, 100.0, 10.0, 10.0, 10.0)
    assert run.first(0.0, 5.0, rising=True) == pytest.approx(2.0)  # the end of the ramp
    assert run.first(0.0, 50.0, rising=True) == pytest.approx(6.5)
    assert run.first(0.0, 100.0, rising=True) == pytest.approx(12.0)
    assert run.first(0.0, 100.1, rising=True) == inf
    assert run.first(7.0, 50.0, rising=True) == 7.0  # it is beyond already
    assert run.first(7.0, 50.0, rising=False) == inf
    assert run.first(20.0, 100.0, rising=False) == 20.0


@given(st.floats(-1e5, 1e5), st.floats(1.0, 1e5), st.floats(1.0, 1e5), st.floats(0.0, 20.0), st.floats(-1e5, 1e5))
def test_first_returns_the_time_of_arrival(
    target: float, velocity: float, rate: float, after: float, position: float
) -> None:
    run = Trajectory()
    run.run_at(0.0, velocity, rate, rate)
    run.move(0.5, target, velocity, rate, rate)
    for rising in (True, False):
        when = run.first(after, position, rising=rising)
        beyond = (run.position(after) - position) * (1 if rising else -1) >= 0
        assert (when == after) is beyond or when - after < 1e-6
        if after < when < inf:
            assert run.position(when) == pytest.approx(position, rel=1e-6, abs=0.01)
        if when == inf:
            far = [run.position(after + step / 10) for step in range(100)]
            assert all(place < position if rising else place > position for place in far)


def test_first_faster_and_first_at_rest() -> None:
    run = Trajectory()
    run.move(1.0, -100.0, 10.0, 10.0, 10.0)
    assert run.first_faster(0.0, 5.0) == pytest.approx(1.5)
    assert run.first_faster(0.0, 10.0) == inf
    assert run.first_faster(3.0, 5.0) == 3.0
    assert run.first_at_rest(3.0, -1.0) == pytest.approx(12.0)
    assert run.first_at_rest(3.0, 1.0) == 3.0
    run.run_at(3.0, 10.0, 10.0, 10.0)
    assert run.first_at_rest(3.0, -1.0) == pytest.approx(4.0)
    assert Trajectory.moving(0.0, 0.0, 1.0).first_at_rest(0.0, 1.0) == inf


def test_minus_is_the_difference_of_two_trajectories() -> None:
    run, other = Trajectory(), Trajectory.moving(2.0, 0.0, 5.0)
    run.move(0.0, 100.0, 10.0, 10.0, 10.0)
    between = run.minus(other, 2.0, 3.0, 2.0)
    for now in (2.0, 5.0, 10.5, 20.0):
        assert between.position(now) == pytest.approx(run.position(now) - 2 * other.position(now) - 3)


def test_renumber_continues_the_movement() -> None:
    run = Trajectory()
    run.move(0.0, 100.0, 10.0, 10.0, 10.0)
    run.renumber(0.5, 1000.0)
    assert run.position(0.4) == pytest.approx(0.8)  # earlier positions keep the old numbers
    assert (run.position(0.5), run.velocity(0.5), run.acceleration(0.5)) == (1001.25, 5.0, 10.0)
    assert (run.ends_at, run.position(20.0)) == (11.0, 1100.0)


def test_a_start_stop_move_from_a_higher_velocity() -> None:
    run = Trajectory()
    run.run_at(0.0, 100.0, 100.0, 100.0)
    run.move(1.0, 250.0, 20.0, 100.0, 100.0, jerky=True)
    assert run.velocity(1.4) == pytest.approx(60.0)
    assert run.ends_at == pytest.approx(1 + 0.8 + (200 - 48) / 20)
    assert run.velocity(run.ends_at - 0.01) == 20
    assert run.position(run.ends_at) == 250


def test_turns_until_is_the_end_of_the_braking() -> None:
    run = Trajectory()
    run.run_at(0.0, 100.0, 100.0, 100.0)
    run.move(1.0, 0.0, 100.0, 100.0, 100.0)
    assert run.turns_until == pytest.approx(2.0)
    run.move(5.0, 500.0, 100.0, 100.0, 100.0)
    assert run.turns_until == -inf
