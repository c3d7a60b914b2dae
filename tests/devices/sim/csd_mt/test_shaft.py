"""The shaft of the stepper drive: lost steps, and the reactions in registers 1084 to 1086."""

from __future__ import annotations

import pytest

from tests.devices.sim.csd_mt.csd_mt_bench import VELOCITY, CsdBench, moving


@pytest.fixture
def bench() -> CsdBench:
    bench = CsdBench()
    bench.write("Velocity Total Sample", 1)
    return bench


# The window, and the three reactions


@pytest.mark.parametrize(("window", "steps"), [(0, 32), (1, 64), (2, 128), (3, 192), (4, 256), (5, 320)])
def test_the_encoder_window(bench: CsdBench, window: int, steps: int) -> None:
    bench.write("Encoder Window", window)
    bench.enable()
    bench.drive.slip(steps - 1, 1.0)
    assert bench.status(1.0) == "0637"
    assert bench.position() == steps - 1  # the position of the encoder
    bench.drive.slip(-2 * steps, 2.0)
    assert bench.status(2.0) == "2637"


def test_reaction_0_stops_with_the_ramp(bench: CsdBench) -> None:
    moving(bench)
    bench.drive.slip(-300, 3.0)
    assert bench.status(3.0) == "3237"
    assert bench.status(3.19) == "3237"
    assert bench.status(3.21) == "3637"  # reached when the motor stops
    assert bench.position() == 38_000 + 2000 - 300
    assert (bench.read("Error Code"), bench.read("Drive Alarm Code 0")) == (0, 0)
    assert bench.control(0x0F) == "2637"  # bit 13 stays until the next run
    assert bench.control(0x1F) == "1237"
    bench.settle()
    assert bench.position() == 100_000  # the way was from where the shaft is


def test_reaction_0_stops_a_run_without_ramp_at_once(bench: CsdBench) -> None:
    moving(bench)
    bench.settle()
    bench.put(Profile_Velocity=10_000, Target_Position=0)
    bench.control(0x0F, 0x1F)
    began = bench.now
    bench.drive.slip(1000, began + 1.0)
    assert bench.status(began + 1.001) == "3637"
    assert bench.position() == pytest.approx(91_000, abs=1)


def test_reaction_1_continues_the_run(bench: CsdBench) -> None:
    moving(bench, Following_Error_Reaction_Code=1)
    bench.drive.slip(-300, 3.0)
    bench.settle()
    assert bench.control(0x0F) == "2637"  # all steps are done, the position is not reached
    assert bench.position() == 99_700
    assert bench.control(0x1F) == "2637"  # "must be reset to run in absolute coordinates"
    bench.control(0x0F)
    bench.put(Target_Position=-1000)
    assert bench.control(0x5F) == "3237"  # in relative ones it runs, and bit 13 stays
    bench.settle()
    assert bench.position() == 98_700
    bench.write("Position Error Reset", 1)
    assert bench.control(0x0F) == "0637"
    bench.put(Target_Position=100_000, Position_Error_Reset=0)
    bench.control(0x1F)
    bench.settle()
    assert bench.position() == 100_000


def test_reaction_1_ends_with_the_current(bench: CsdBench) -> None:
    moving(bench, Following_Error_Reaction_Code=1)
    bench.drive.slip(-300, 3.0)
    bench.settle()
    assert bench.control(0x07) == "0233"
    bench.enable()
    bench.control(0x1F)
    bench.settle()
    assert (bench.position(), bench.control(0x0F)) == (100_000, "0637")


def test_reaction_2_is_a_fault(bench: CsdBench) -> None:
    moving(bench, Following_Error_Reaction_Code=2)
    bench.drive.slip(-300, 3.0)
    assert bench.status(3.0) == "0218"
    assert (bench.read("Error Code"), bench.read("Drive Alarm Code 0")) == (0x8611, 0x8611)
    assert bench.control(0x80) == "0270"  # it is over, so it can be reset
    assert bench.read("Error Code") == 0


def test_reaction_2_in_profile_velocity(bench: CsdBench) -> None:
    bench.write("Following Error Reaction Code", 2)
    bench.enable(VELOCITY)
    bench.put(Target_Velocity=64_000)
    assert bench.status(5.0) == "0637"
    bench.drive.slip(-300, 5.0)
    assert bench.status(5.0) == "201F"  # A: bit 13, no remote, current off
    assert not bench.drive.shaft.has_current
    assert bench.status(5.15) == "201F"
    assert bench.status(5.17) == "1218"  # C: 64000 step/s at 400000 step/s² of friction
    assert bench.control(0x80) == "1270"


def test_reaction_17_ignores_the_encoder(bench: CsdBench) -> None:
    moving(bench, Following_Error_Reaction_Code=17)
    bench.drive.slip(-5000, 3.0)
    assert bench.velocity(3.1) == 20_000  # what is commanded
    bench.settle()
    assert bench.control(0x0F) == "0637"
    assert bench.position() == 100_000
    assert bench.drive.shaft.position(bench.now) == 95_000
    bench.write("Position Error Reset", 1)  # ignored
    assert bench.position() == 100_000


# Position Error Reset


def test_the_encoder_takes_the_step_counter(bench: CsdBench) -> None:
    moving(bench)
    bench.drive.slip(-100, 3.0)
    bench.settle()
    assert bench.position() == 99_900
    bench.write("Position Error Reset", 2)
    assert bench.position() == 100_000
    bench.drive.slip(-100, bench.now)
    bench.write("Position Error Reset", 1)  # the other way: the command takes the position of the encoder
    assert bench.position() == 99_900
    bench.put(Target_Position=100)
    bench.control(0x0F, 0x5F)
    bench.settle()
    assert bench.position() == 100_000


def test_a_reset_in_motion_renumbers_the_target_too(bench: CsdBench) -> None:
    bench.enable()
    bench.put(Target_Position=100_000, Profile_Velocity=20_000)
    bench.now = 1.0
    bench.control(0x2F, 0x3F)
    bench.drive.slip(-100, 2.0)
    bench.now = 2.0
    bench.write("Position Error Reset", 1)
    bench.put(Profile_Velocity=50_000)
    bench.settle()
    assert bench.position() == 99_900


def test_reaction_0_on_a_ramp_stops_with_a_ramp(bench: CsdBench) -> None:
    """It is slow there, but no start-stop run."""
    moving(bench)
    bench.drive.slip(-300, 1.1)
    assert bench.velocity(1.15) == pytest.approx(5000, abs=100)
    assert bench.velocity(1.25) == 0


def test_position_error_reset_acts_in_operation_enabled_only(bench: CsdBench) -> None:
    moving(bench, Following_Error_Reaction_Code=1)
    bench.drive.slip(-300, 3.0)
    bench.settle()
    bench.control(0x02)
    bench.write("Position Error Reset", 1)
    assert bench.status() == "2617"
