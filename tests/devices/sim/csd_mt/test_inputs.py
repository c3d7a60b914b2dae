"""Inputs of the stepper drive: limit switches, start and halt, touch probe."""

from __future__ import annotations

from math import inf

import pytest

from barewire.devices.sim.csd_mt.environment import Span
from tests.devices.sim.bench import HOMING, VELOCITY, CsdBench

LIMITS = Span(-10_000.0, 50_000.0)


def with_limits(bench: CsdBench) -> None:
    """Wire limit switches to I1 and I2 that are ON between their positions."""
    bench.drive.environment.inputs[1] = Span(LIMITS.low, inf)
    bench.drive.environment.inputs[2] = Span(-inf, LIMITS.high)
    bench.put(Input_Config=0b11001, Profile_Acceleration=100_000, Profile_Deceleration=100_000)


def press(bench: CsdBench, number: int, on: bool) -> None:
    """Set the level of an input."""
    bench.drive.tick(bench.now)
    bench.drive.environment.inputs[number] = on


def test_digital_input_shows_levels_and_functions(bench: CsdBench) -> None:
    assert bench.read("Digital Input") == 0
    for number in (1, 3, 4):
        press(bench, number, True)
    assert bench.read("Digital Input") == 0b1010 << 16  # I4 has no bit
    bench.write("Input Config", 0)  # all special: proximity, limits, touch probe
    assert bench.read("Digital Input") == 0b1010 << 16 | 0b001
    press(bench, 0, True)
    press(bench, 2, True)
    assert bench.read("Digital Input") == 0b1111 << 16 | 0b111


def test_a_switch_changes_when_the_shaft_passes(bench: CsdBench) -> None:
    bench.write("Input Config", 30)
    bench.put(Target_Position=40_000, Profile_Velocity=10_000)
    bench.enable()
    bench.now = 1.0
    bench.control(0x1F)
    home = bench.drive.environment.inputs[0]
    assert isinstance(home, Span)
    for place, on in ((home.low - 5, 0), (home.low + 5, 1), (home.high - 5, 1), (home.high + 5, 0)):
        bench.now = 1 + place / 10_000
        assert bench.read("Digital Input") == on << 16 | on << 2


# Limit switches


@pytest.mark.parametrize("direction", [1, -1])
def test_a_limit_switch_stops_the_shaft(bench: CsdBench, direction: int) -> None:
    with_limits(bench)
    edge = LIMITS.high if direction > 0 else LIMITS.low
    bench.put(Target_Position=direction * 200_000, Profile_Velocity=20_000)
    bench.enable()
    bench.now = 1.0
    assert bench.control(0x1F) == "1237"
    bench.control(0x0F)
    assert bench.status(10.0) == "0E37"  # internal limit active, and stopped as by a halt
    stands = edge + direction * 20_000**2 / 100_000 / 2
    assert bench.position() == stands
    # "Movements in previous direction are inhibited until limit switch is ON"
    bench.control(0x1F, 0x0F)
    assert bench.position(20.0) == stands
    # "can run only in the opposite direction"
    bench.put(Target_Position=0)
    bench.control(0x1F, 0x0F)
    bench.settle()
    assert bench.position() == 0
    assert bench.status() == "0637"
    bench.put(Target_Position=direction * 5000)
    bench.control(0x1F, 0x0F)
    bench.settle()
    assert bench.position() == direction * 5000


def test_a_limit_switch_in_profile_velocity(bench: CsdBench) -> None:
    with_limits(bench)
    bench.enable(VELOCITY)
    bench.put(Target_Velocity=40_000)
    assert bench.status(10.0) == "1E37"
    assert bench.position() == LIMITS.high + 8000
    bench.put(Target_Velocity=-40_000)
    assert bench.velocity(10.5) == -40_000
    bench.put(Target_Velocity=0)
    assert bench.status(11.5) == "1637"
    # A switch that is pressed by hand, and released.
    press(bench, 1, False)
    bench.put(Target_Velocity=-1000)
    assert bench.velocity(12.0) == 0
    press(bench, 1, True)
    assert bench.velocity(13.0) == -1000


def test_a_limit_switch_that_is_not_wired_is_off(bench: CsdBench) -> None:
    bench.write("Input Config", 0b11001)
    bench.enable()
    assert bench.status() == "0E37"
    bench.put(Target_Position=1000)
    bench.control(0x1F)
    assert bench.position(5.0) == 0
    bench.write("Input Config", 31)  # general purpose: free again
    bench.control(0x0F, 0x1F)
    bench.settle()
    assert bench.position() == 1000


# Start and halt


@pytest.mark.parametrize(("code", "number", "relative"), [(m, (m - 1) // 2, m % 2 == 0) for m in range(1, 9)])
def test_an_input_starts_a_set_point(bench: CsdBench, code: int, number: int, relative: bool) -> None:
    press(bench, 0, False)
    bench.write("Control Word from I/O", code)
    bench.put(Target_Position=5000)
    bench.enable()
    for turn in (1, 2):
        press(bench, number, True)
        assert bench.status() in ("1237", "1637")  # acknowledged
        bench.settle()
        assert bench.position() == (5000 * turn if relative else 5000)
        bench.now += 1.0
        assert bench.position() == (5000 * turn if relative else 5000)  # a new transition is necessary
        press(bench, number, False)
        assert bench.status() == "0637"


def test_an_input_starts_nothing_below_operation_enabled(bench: CsdBench) -> None:
    bench.write("Control Word from I/O", 3)
    bench.put(Target_Position=5000)
    bench.control(0x06, 0x07)
    press(bench, 1, True)
    bench.now = 1.0
    bench.enable()
    assert bench.position(5.0) == 0


@pytest.mark.parametrize(("code", "number"), [(0x12, 0), (0x32, 1), (0x52, 2), (0x72, 3)])
def test_an_input_halts_the_shaft(bench: CsdBench, code: int, number: int) -> None:
    press(bench, 0, False)
    bench.write("Control Word from I/O", code)
    bench.put(Target_Position=100_000)
    bench.enable()
    bench.now = 1.0
    bench.control(0x1F)
    bench.now = 2.0
    press(bench, number, True)
    assert bench.status(3.0) == "1637"
    stands = bench.position()
    assert 0 < int(stands) < 100_000
    bench.control(0x0F, 0x1F)
    assert bench.position(4.0) == stands  # as long as it is halted
    press(bench, number, False)
    assert bench.status(4.1) == "0237"
    bench.control(0x0F, 0x1F)
    bench.settle()
    assert bench.position() == 100_000


def test_an_input_runs_and_stops_profile_velocity(bench: CsdBench) -> None:
    bench.write("Control Word from I/O", 7)
    bench.put(Target_Velocity=20_000)
    bench.enable(VELOCITY)
    assert bench.velocity(2.0) == 0
    press(bench, 3, True)
    assert bench.velocity(3.0) == 20_000
    press(bench, 3, False)
    assert bench.velocity(4.0) == 0
    assert bench.read("Target Velocity") == 20_000
    bench.write("Control Word from I/O", 0)  # disabled: the mode runs by itself
    assert bench.velocity(5.0) == 20_000


# Touch probe


def probing(bench: CsdBench, function: int) -> None:
    bench.drive.environment.inputs[3] = Span(10_000.0, 11_000.0)
    bench.put(Input_Config=0b10111, Touch_Probe_Function=function, Target_Position=40_000, Profile_Velocity=10_000)
    bench.enable()
    bench.now = 1.0
    bench.control(0x1F)


def probe(bench: CsdBench) -> tuple[object, ...]:
    names = ("Touch Probe Status", "Touch Probe Positive Value", "Touch Probe Negative Value")
    return tuple(bench.read(name) for name in names)


def test_touch_probe_on_the_positive_edge(bench: CsdBench) -> None:
    probing(bench, 0x11)
    assert probe(bench) == (0x01, 0, 0)
    bench.now = 2.05
    assert probe(bench) == (0x83, 10_000, 0)
    bench.now = 6.0
    assert probe(bench) == (0x03, 10_000, 0)
    bench.put(Target_Position=0)
    bench.control(0x0F, 0x1F)
    bench.settle()
    assert probe(bench) == (0x03, 10_000, 0)  # the first stays
    bench.write("Touch Probe Function", 0)
    assert probe(bench) == (0, 0, 0)
    bench.write("Touch Probe Function", 0x11)
    assert probe(bench) == (0x01, 0, 0)


def test_touch_probe_on_the_negative_edge(bench: CsdBench) -> None:
    probing(bench, 0x21)
    bench.now = 9.0
    assert probe(bench) == (0x05, 0, 11_000)


def test_touch_probe_on_the_index(bench: CsdBench) -> None:
    bench.drive.environment.index = 500.0
    probing(bench, 0x15)
    bench.now = 9.0
    assert probe(bench) == (0x43, 500, 0)
    bench.write("Touch Probe Function", 0)
    bench.write("Touch Probe Function", 0x25)
    bench.put(Target_Position=0)
    bench.control(0x0F, 0x1F)
    bench.settle()
    assert probe(bench)[2] == 500 + 3 * 12_800  # downwards the pulse ends at its lower end


def test_the_next_index_pulse_may_be_below_the_last_one(bench: CsdBench) -> None:
    bench.enable()
    bench.drive.slip(-0.001, 1.0)  # at the lower end of the pulse at 0
    bench.put(Touch_Probe_Function=0x25, Target_Position=-20_000)
    bench.control(0x1F)
    bench.settle()
    assert probe(bench) == (0x45, 0, -12_800)


def test_the_touch_probe_needs_its_input_function(bench: CsdBench) -> None:
    probing(bench, 0x11)
    bench.write("Input Config", 31)
    bench.now = 9.0
    assert probe(bench) == (0x01, 0, 0)


def test_start_and_halt_inputs_do_not_act_on_homing(bench: CsdBench) -> None:
    bench.write("Control Word from I/O", 0x31)
    bench.write("Homing Method", 35)
    bench.enable(HOMING)
    press(bench, 0, True)
    press(bench, 1, True)
    assert bench.status() == "0637"
    assert bench.control(0x1F) == "1637"


def test_an_index_pulse_for_homing_does_not_trigger_the_touch_probe(bench: CsdBench) -> None:
    bench.put(
        Input_Config=0b10110, Homing_Method=3, Homing_Speed_During_Search_for_Zero=3200, Touch_Probe_Function=0x11
    )
    bench.enable(HOMING)
    bench.control(0x1F)
    assert bench.status(60.0) == "1637"
    assert probe(bench) == (0x01, 0, 0)
