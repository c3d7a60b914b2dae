"""Every homing method of the manual, from inside and outside the switch, with the edge that it must find."""

from __future__ import annotations

from math import inf

import pytest

from barewire.devices.sim.csd_mt.environment import Span
from tests.devices.sim.bench import HOMING, CsdBench
from tests.helpers import every_case

SWITCH = Span(30_000.0, 31_000.0)
INDEX = 700.0
FAST, SLOW, RAMP = 40_000, 3200, 100_000  # table 17


@pytest.fixture
def bench() -> CsdBench:
    return ready(0.0)


def ready(start: float, method: int = 0, **registers: int) -> CsdBench:
    """Return a drive that is enabled in homing mode, with its shaft at `start`."""
    bench = CsdBench()
    bench.drive.environment.inputs[0] = SWITCH
    bench.drive.environment.index = INDEX
    bench.drive.slip(start, 0.0)
    bench.put(Homing_Speed_During_Search_for_Switch=FAST, Homing_Speed_During_Search_for_Zero=SLOW)
    bench.put(Homing_Acceleration=RAMP, Homing_Method=method, Input_Config=0b11110, Homing_Offset=1000)
    for name, value in registers.items():
        bench.write(name.replace("_", " "), value)
    bench.enable(HOMING)
    bench.now = 1.0
    return bench


def first_index(after: float, direction: int) -> float:
    """Return where the first index pulse in this direction begins."""
    turn = 12_800
    if direction > 0:
        return after + (INDEX - after) % turn
    return after - (after - INDEX - 8) % turn  # from above, a pulse of 8 steps begins at its upper end


# Where each method starts to search, and where it must end. Methods 3 and 4 look upwards, 5 and 6 downwards.
ENDS = {19: SWITCH.low, 20: SWITCH.low, 21: SWITCH.high, 22: SWITCH.high}
LAST_DIRECTION = {19: -1, 20: 1, 21: 1, 22: -1}
STARTS = {19: 0.0, 20: 0.0, 21: 60_000.0, 22: 60_000.0}


@every_case("method", [3, 4, 5, 6, 19, 20, 21, 22])
@every_case("in_the_switch", [False, True])
def test_a_search_ends_at_its_edge(method: int, in_the_switch: bool) -> None:
    as_switch = method if method > 6 else method + 16
    bench = ready(30_500.0 if in_the_switch else STARTS[as_switch], method)
    assert bench.control(0x1F) == "0237"
    assert bench.status(1.1) == "0237"
    assert bench.status(100.0) == "1637"  # homing completed, and reached
    direction = LAST_DIRECTION[as_switch]
    edge = ENDS[as_switch] if method > 6 else first_index(ENDS[as_switch], direction)
    assert bench.drive.shaft.position(100.0) == pytest.approx(edge, abs=0.01)
    assert bench.position() == 1000  # "this is the position indicated as +1000"
    # The counter counts on from there.
    bench.write("Mode of Operation", 1)
    bench.write("Target Position", 0)
    bench.control(0x0F, 0x1F)
    bench.settle()
    assert bench.drive.shaft.position(bench.now) == pytest.approx(edge - 1000, abs=0.01)


def test_the_search_as_figure_31_draws_it(bench: CsdBench) -> None:
    """Fast to the switch with a ramp, past it while braking, slowly back."""
    bench.put(Homing_Method=19, Velocity_Total_Sample=1)
    bench.control(0x1F)
    seen = 1 + FAST / RAMP / 2 + SWITCH.low / FAST  # a ramp costs half of its time
    assert bench.velocity(1.2) == pytest.approx(20_000, abs=100)
    assert bench.velocity(seen - 0.01) == FAST
    stands = seen + FAST / RAMP
    assert bench.velocity(stands - 0.1) == pytest.approx(10_000, abs=100)
    beyond = SWITCH.low + FAST**2 / RAMP / 2
    assert beyond > SWITCH.high
    assert bench.velocity(stands + 0.01) == -SLOW
    ends = stands + (beyond - SWITCH.low) / SLOW
    assert bench.status(ends - 0.01) == "0237"
    assert bench.status(ends + 0.01) == "1637"


def test_methods_35_and_37_home_where_the_shaft_stands() -> None:
    for method in (35, 37):
        bench = ready(5.0, method)
        assert bench.control(0x1F) == "1637"
        assert bench.position() == 1000


@pytest.mark.parametrize(("method", "wall", "back"), [(-1, -20_000.0, 1), (-2, 20_000.0, -1)])
def test_homing_against_a_mechanical_stop(method: int, wall: float, back: int) -> None:
    bench = ready(0.0, method, Auto_Sync_Enable=2, Hard_Stop_Homing_Disengaging_Steps=200)
    bench.drive.environment.walls = Span(-20_000.0, 20_000.0)
    bench.control(0x1F)
    assert bench.status(20.0) == "1637"
    assert bench.drive.shaft.position(20.0) == pytest.approx(wall + 200 * back, abs=0.01)
    assert bench.position() == 1000


def test_homing_against_a_mechanical_stop_needs_auto_sync() -> None:
    bench = ready(0.0, -1)
    assert bench.control(0x1F) == "0237"
    assert bench.position(10.0) == 0


def test_a_search_without_switch_or_speed_never_ends(bench: CsdBench) -> None:
    bench.write("Homing Method", 0)
    assert bench.control(0x1F) == "0237"  # no method
    assert bench.position(2.0) == 0
    bench.put(Homing_Method=19, Input_Config=31)  # I0 is not the proximity input
    bench.control(0x0F, 0x1F)
    assert bench.status(20.0) == "0237"
    assert int(bench.position()) > 600_000
    bench.control(0x10F)
    assert bench.status(30.0) == "0637"  # halted: not completed
    bench = ready(0.0, 19, Homing_Speed_During_Search_for_Zero=0)  # the default
    bench.control(0x1F)
    assert bench.status(1000.0) == "0237"


def test_there_is_no_index_pulse_without_encoder() -> None:
    bench = ready(0.0, 3, Following_Error_Reaction_Code=17)
    bench.control(0x1F)
    assert bench.status(60.0) == "0237"


def test_a_limit_switch_ends_the_search(bench: CsdBench) -> None:
    bench.drive.environment.inputs[2] = Span(-inf, 20_000.0)  # the positive limit is before the switch
    bench.put(Homing_Method=19, Input_Config=0b11010)
    bench.control(0x1F)
    assert bench.status(10.0) == "0E37"
    stands = bench.position()
    assert stands == pytest.approx(20_000 + FAST**2 / RAMP / 2, abs=1)
    assert bench.control(0x0F, 0x1F) == "0E37"  # it cannot be begun from here
    assert bench.position(20.0) == stands


def test_a_new_mode_ends_the_search(bench: CsdBench) -> None:
    bench.put(Homing_Method=19)
    bench.control(0x1F)
    bench.now = 1.5
    bench.write("Mode of Operation", 1)
    bench.control(0x0F)
    stands = bench.position(5.0)
    assert bench.position(50.0) == stands


def test_a_second_start_does_not_restart_the_search(bench: CsdBench) -> None:
    bench.put(Homing_Method=19)
    bench.control(0x1F)
    bench.now = 1.2
    bench.control(0x0F, 0x1F)
    bench.now = 3.0  # beyond the switch, on the slow way back
    bench.control(0x0F, 0x1F)
    assert bench.status(30.0) == "1637"
    assert bench.drive.shaft.position(30.0) == pytest.approx(SWITCH.low, abs=0.01)
