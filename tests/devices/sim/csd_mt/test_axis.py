"""Motion of the stepper drive: durations of profiles, set-points in motion, halt, velocity mode."""

from __future__ import annotations

from math import sqrt

import pytest

from barewire.devices.cia402 import State
from barewire.modbus.messages.registers import WriteMultipleRegisters
from tests.devices.sim.bench import VELOCITY, CsdBench


@pytest.mark.parametrize("relative", [False, True])
@pytest.mark.parametrize(
    ("way", "velocity", "rate", "lasts"),
    [
        (240_000, 90_000, 140_000, 240_000 / 90_000 + 90_000 / 140_000),  # trapezoid: PV² < PA·ΔS
        (-240_000, 100_000, 80_000, 240_000 / 100_000 + 100_000 / 80_000),  # the example of table 15, downwards
        (50_000, 90_000, 140_000, 2 * sqrt(50_000 / 140_000)),  # triangle
        (240_000, 16_000, 140_000, 240_000 / 16_000),  # start-stop, up to 16000 step/s
        (240_000, 16_001, 140_000, 240_000 / 16_001 + 16_001 / 140_000),
    ],
)
def test_the_duration_of_a_movement_follows_the_formula(
    bench: CsdBench, way: int, velocity: int, rate: int, lasts: float, relative: bool
) -> None:
    bench.enable()
    bench.put(Target_Position=way, Profile_Velocity=velocity, Profile_Acceleration=rate, Profile_Deceleration=2000)
    bench.now = 10.0
    assert bench.control(0x5F if relative else 0x1F) == "1237"  # acknowledged, not reached
    assert bench.control(0x0F) == "0237"
    assert bench.status(10 + lasts - 0.001) == "0237"
    assert bench.status(10 + lasts + 0.001) == "0637"
    assert bench.position() == way
    # The same again: a relative movement goes on, an absolute one is there.
    bench.control(0x5F if relative else 0x1F)
    bench.settle()
    assert bench.position() == (2 * way if relative else way)


def test_velocity_and_status_during_a_trapezoid(bench: CsdBench) -> None:
    bench.enable()
    bench.put(Target_Position=240_000, Profile_Velocity=90_000, Profile_Acceleration=140_000)
    bench.now = 10.0
    bench.control(0x1F)
    top = 90_000 / 140_000
    assert bench.position(10 + top) == round(90_000**2 / 140_000 / 2)
    assert bench.velocity(10 + top + 0.002) == 90_000
    bench.put(Velocity_Total_Sample=100)
    slows = 10 + 240_000 / 90_000  # and the mean of 0.1 to 0.2 s after that
    assert bench.velocity(slows + 0.2) == pytest.approx(90_000 - 140_000 * 0.15, abs=1)


def test_an_absolute_move_counts_from_the_shown_position(bench: CsdBench) -> None:
    """The counter wraps: from 2147483000 it is 1000 steps up to -2147483296, and a long way down."""
    bench.drive.axis.rest_at(2_147_483_000.0, 0.0)
    bench.enable()
    bench.put(Target_Position=1000, Profile_Velocity=16_000)
    bench.control(0x5F)
    bench.settle()
    assert bench.position() == 2_147_484_000 - 2**32
    bench.control(0x0F)
    bench.put(Target_Position=-2_147_483_000)
    began = bench.now
    bench.control(0x1F)
    assert bench.settle() - began == pytest.approx(296 / 16_000)
    assert bench.position() == -2_147_483_000


def test_set_points_in_motion(bench: CsdBench) -> None:
    bench.enable()
    bench.put(Target_Position=100_000)
    bench.control(0x1F, 0x0F)
    bench.now = 1.0
    bench.put(Target_Position=200_000)
    bench.control(0x1F, 0x0F)  # bit 5 is 0: not before the target is reached
    bench.now = 2.0
    bench.control(0x3F, 0x2F)  # at once
    bench.settle()
    assert bench.position() == 200_000
    # A relative movement keeps the overall starting point as its reference, and a change of bit 6 is ignored.
    bench.put(Target_Position=50_000)
    bench.now = 100.0
    bench.control(0x6F, 0x7F, 0x6F)
    bench.now = 100.5
    bench.put(Target_Position=80_000)
    bench.control(0x3F, 0x2F)
    assert bench.refused(WriteMultipleRegisters(1044, (0, 0))) == 3  # velocity 0 while it runs
    bench.put(Profile_Velocity=400_000)  # at once
    bench.settle()
    assert bench.now < 102
    assert bench.position() == 280_000


def test_without_bit_5_a_new_velocity_waits(bench: CsdBench) -> None:
    bench.enable()
    bench.put(Target_Position=300_000, Profile_Velocity=100_000)
    bench.now = 1.0
    bench.control(0x1F)
    bench.now = 2.0
    bench.put(Profile_Velocity=50_000)
    assert bench.velocity(2.5) == 100_000
    assert bench.settle() == pytest.approx(1 + 300_000 / 100_000 + 100_000 / 640_000)


def test_a_set_point_behind_the_shaft_stops_it_first(bench: CsdBench) -> None:
    """And "the motion cannot be changed in case of a stop and restart operation"."""
    bench.enable()
    bench.put(Target_Position=500_000, Profile_Velocity=100_000, Profile_Acceleration=100_000)
    bench.now = 1.0
    bench.control(0x1F, 0x2F)
    bench.put(Target_Position=0)
    bench.now = 3.0  # 150000 on, and a second needed to stop
    assert bench.control(0x3F, 0x2F)[0] == "0"
    bench.now = 3.5
    bench.put(Target_Position=900_000, Profile_Velocity=200_000)
    assert bench.control(0x3F) == "0237"  # not acknowledged, not taken
    bench.control(0x2F)
    assert bench.position(4.0) == 200_000
    assert bench.control(0x3F, 0x2F)[0] == "0"
    bench.settle()
    assert bench.position() == 900_000


def test_a_new_ramp_waits_for_the_next_movement(bench: CsdBench) -> None:
    bench.enable()
    bench.put(Profile_Velocity=100_000, Profile_Acceleration=100_000, Target_Position=300_000)
    bench.put(Profile_Deceleration=2_000)  # without effect here: 1072 is for profile velocity
    bench.now = 1.0
    bench.control(0x2F, 0x3F)
    bench.now = 2.5
    bench.put(Profile_Acceleration=1_000_000, Profile_Velocity=50_000)
    assert bench.velocity(3.002) == 50_000
    ends_at = bench.drive.axis.trajectory.ends_at
    assert bench.velocity(ends_at - 0.25) == pytest.approx(25_000, abs=100)


def test_slowing_down_below_the_start_stop_speed(bench: CsdBench) -> None:
    bench.enable()
    bench.put(Profile_Velocity=50_000, Profile_Acceleration=50_000, Target_Position=100_000)
    bench.now = 1.0
    bench.control(0x2F, 0x3F)
    bench.now = 2.0
    bench.put(Profile_Velocity=10_000)
    assert bench.velocity(2.4) == pytest.approx(30_000, abs=50)  # with a ramp down
    ends_at = bench.drive.axis.trajectory.ends_at
    assert bench.velocity(ends_at - 0.001) == 10_000  # and none at the end
    bench.settle()
    assert bench.position() == 100_000


@pytest.mark.parametrize(("word", "stops"), [(0x10F, "0637"), (0x02, "0617")])
def test_halt_and_quick_stop(bench: CsdBench, word: int, stops: str) -> None:
    bench.enable()
    bench.put(Target_Position=100_000, Profile_Acceleration=24_000)
    bench.now = 1.0
    bench.control(0x1F)
    bench.now = 3.0
    assert bench.control(word) == f"0{int(stops[1], 16) & 0xB:X}{stops[2:]}"  # bit 10 only when the motor stands
    assert bench.status(3.99) == f"02{stops[2:]}"
    assert bench.status(4.01) == stops
    stands = bench.position()
    assert stands == 12_000 + 24_000 + 12_000
    went_on = bench.control(0x0F)
    assert went_on == ("0237" if word == 0x10F else "0637")  # halt: target reached falls, the movement is not completed
    assert bench.position(50.0) == stands
    bench.control(0x1F)
    bench.settle()
    assert bench.position() == 100_000


def test_no_set_point_while_it_stops(bench: CsdBench) -> None:
    bench.enable()
    bench.put(Target_Position=100_000, Profile_Acceleration=24_000)
    bench.now = 1.0
    bench.control(0x2F, 0x3F)
    bench.now = 3.0
    bench.control(0x12F)
    bench.now = 3.1
    assert bench.control(0x02F, 0x03F) == "0237"
    bench.now = 5.0
    assert bench.position() == 48_000


def test_profile_velocity(bench: CsdBench) -> None:
    bench.enable(VELOCITY)
    bench.put(Profile_Acceleration=100_000, Profile_Deceleration=50_000, Velocity_Total_Sample=2)
    bench.now = 10.0
    bench.put(Target_Velocity=200_000)
    assert bench.velocity(11.001) == 100_000
    assert bench.status() == "0237"
    assert bench.status(12.1) == "0637"
    assert bench.position() == 220_000
    bench.now = 20.0
    bench.put(Target_Velocity=-100_000)  # "and even the direction": 4 s down, 1 s up again
    assert bench.velocity(23.001) == 50_000
    assert bench.velocity(24.501) == -50_000
    assert bench.velocity(26.0) == -100_000
    bench.put(Max_Motor_Speed=20_000)
    assert bench.velocity(40.0) == -20_000
    bench.control(0x02)
    assert bench.velocity(41.0) == 0
    assert bench.drive.axis.state is State.QUICK_STOP_ACTIVE


def test_windows_of_profile_velocity(bench: CsdBench) -> None:
    bench.enable(VELOCITY)
    bench.put(Profile_Acceleration=100_000, Velocity_Window=1000, Velocity_Window_Time=200)
    bench.put(Velocity_Threshold=500, Velocity_Threshold_Time=0)
    bench.now = 10.0
    bench.put(Target_Velocity=100_000)
    assert bench.status(10.004) == "1237"  # zero speed: below 500 step/s
    assert bench.status(10.006) == "0237"
    assert bench.status(11.18) == "0237"  # within 1000 step/s since 10.99 s
    assert bench.status(11.20) == "0637"


def test_profile_velocity_halts_and_continues(bench: CsdBench) -> None:
    bench.enable(VELOCITY)
    bench.put(Target_Velocity=64_000)
    bench.now = 1.0
    bench.control(0x10F)
    assert bench.status(2.0) == "1637"  # zero speed, as the halt commands
    bench.control(0x0F)
    assert bench.velocity(3.0) == 64_000


def test_the_ramp_bit(bench: CsdBench) -> None:
    bench.enable()
    bench.put(Enable_SW_bit_15=1, Target_Position=100_000)
    assert bench.control(0x1F) == "9237"
    assert bench.status(1.0) == "1237"
    ends_at = bench.drive.axis.trajectory.ends_at
    assert bench.status(ends_at - 0.001) == "9237"


def test_the_direction_can_be_turned_round(bench: CsdBench) -> None:
    bench.put(Revolution_Direction=1, Target_Position=5000)
    bench.enable()
    bench.control(0x1F)
    bench.settle()
    assert bench.position() == 5000
    assert bench.drive.shaft.position(bench.now) == -5000


def test_reading_often_changes_nothing() -> None:
    """The same commands give the same result with a tick every 10 ms and without one."""

    def run(often: bool) -> list[object]:
        bench = CsdBench()
        bench.drive.environment.walls = bench.drive.environment.walls._replace(high=60_000)
        bench.enable()
        bench.put(Target_Position=90_000, Touch_Probe_Function=0x15, Following_Error_Reaction_Code=2)
        bench.control(0x1F)
        while often and bench.now < 10.0:
            bench.status(bench.now + 0.01)
        bench.now = 10.0
        names = (
            "Status Word",
            "Position Actual Value",
            "Touch Probe Positive Value",
            "Drive Alarm Time 0",
            "Error Code",
        )
        return [bench.read(name) for name in names]

    assert run(often=True) == run(often=False)
    assert run(often=False)[4] == 0x8611
