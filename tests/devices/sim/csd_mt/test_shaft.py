"""The shaft of the stepper drive: lost steps, the reactions in registers 1084 to 1086, walls and loads, Auto Sync."""

from __future__ import annotations

from math import inf

import pytest

from barewire.devices.sim.csd_mt.environment import Span
from barewire.modbus.messages.registers import WriteSingleRegister
from tests.devices.sim.bench import VELOCITY, CsdBench, moving

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


# Walls and load


def test_a_motor_against_a_wall_loses_steps(bench: CsdBench) -> None:
    bench.drive.environment.walls = Span(-inf, 30_000)
    moving(bench)
    at_wall = 1 + 0.2 + (30_000 - 2000) / 20_000
    detected = at_wall + 192 / 20_000
    assert bench.status(detected - 0.001) == "1237"
    assert bench.position() == 30_000
    assert bench.status(detected + 0.001) == "3237"
    bench.settle()
    assert bench.position() == 30_000
    bench.put(Target_Position=0)
    bench.control(0x0F, 0x1F)
    bench.settle()
    assert (bench.position(), bench.control(0x0F)) == (0, "0637")


def test_a_wall_is_not_detected_without_encoder(bench: CsdBench) -> None:
    bench.drive.environment.walls = Span(-inf, 30_000)
    moving(bench, Following_Error_Reaction_Code=17)
    bench.settle()
    assert (bench.position(), bench.drive.shaft.position(bench.now)) == (100_000, 30_000)
    bench.put(Target_Position=90_000)
    bench.control(0x0F, 0x1F)
    bench.settle()
    assert (bench.position(), bench.drive.shaft.position(bench.now)) == (90_000, 20_000)


def test_a_motor_faster_than_the_load_allows_stands(bench: CsdBench) -> None:
    bench.drive.environment.pull_out = 15_000
    moving(bench, Following_Error_Reaction_Code=2)
    assert bench.status(1.14) == "1237"
    assert bench.status(1.2) == "0218"
    assert bench.position() == pytest.approx(15_000**2 / 100_000 / 2, abs=1)  # it has not moved since


# Auto Sync


def test_auto_sync_recovers_lost_steps(bench: CsdBench) -> None:
    """Slower than the command while the load is too much, faster after that."""
    bench.drive.environment.pull_out = 15_000
    moving(bench, Auto_Sync_Enable=2, Enable_SW_bit_14=1)
    bench.now = 3.0
    assert bench.velocity() == 15_000
    assert bench.status() == "5237"
    assert int(bench.read("Digital Input")) >> 23 & 1
    bench.settle()
    assert bench.status() == "5237"  # the command is there, the shaft is not
    assert int(bench.position()) < 90_000
    bench.now += 2.0
    assert bench.status() == "1637"
    assert bench.position() == 100_000
    assert not int(bench.read("Digital Input")) >> 23


def test_auto_sync_gives_up_at_its_window(bench: CsdBench) -> None:
    bench.drive.environment.walls = Span(-inf, 30_000)
    moving(bench, Auto_Sync_Enable=1, Auto_Sync_Window=5000, Following_Error_Reaction_Code=2)
    at_wall = 1 + 0.2 + (30_000 - 2000) / 20_000
    assert bench.status(at_wall + 0.24) == "1237"
    assert int(bench.read("Digital Input")) >> 23 & 1
    assert bench.status(at_wall + 0.26) == "0218"


def test_auto_sync_with_reaction_1_resets_bit_13_when_recovered(bench: CsdBench) -> None:
    bench.drive.environment.walls = Span(-inf, 30_000)
    moving(bench, target=40_000, Auto_Sync_Enable=1, Auto_Sync_Window=5000, Following_Error_Reaction_Code=1)
    bench.settle()
    assert bench.status() == "3237"
    bench.put(Target_Position=-15_000)
    bench.control(0x0F, 0x5F)
    bench.settle()
    assert (bench.status(), bench.position()) == ("1637", 25_000)


def test_auto_sync_does_not_correct_a_small_lag(bench: CsdBench) -> None:
    bench.write("Auto Sync Enable", 1)
    bench.enable()
    bench.drive.slip(60, 1.0)
    assert bench.position(1.0) == 60
    bench.drive.slip(70, 2.0)
    assert bench.position(2.1) == 60  # more than one full step is corrected
    assert bench.drive.shaft.in_step
    bench.put(Target_Position=100_000)
    bench.control(0x1F)
    bench.drive.slip(100, 3.0)  # in motion the limit is two
    bench.settle()
    assert bench.position() == 100_160


def test_auto_sync_can_be_switched_in_motion(bench: CsdBench) -> None:
    bench.drive.environment.pull_out = 15_000
    moving(bench, Following_Error_Reaction_Code=1)
    assert bench.velocity(2.0) == 0
    bench.write("Auto Sync Enable", 1)
    assert bench.velocity(3.0) == 15_000
    bench.write("Auto Sync Enable", 0)
    assert bench.velocity(4.0) == 0
    bench.settle()
    bench.status()
    assert bench.drive.shaft.in_step  # the command stands, and the shaft is in step again


def test_auto_sync_with_kv_0_recovers_nothing(bench: CsdBench) -> None:
    bench.put(Auto_Sync_Enable=1, Auto_Sync_Kv=0)
    bench.enable()
    bench.drive.slip(1000, 1.0)
    assert bench.position(100.0) == 1000
    bench.write("Position Error Reset", 1)  # with Auto Sync, it does not reset the offset
    assert bench.drive.axis.trajectory.position(100.0) == 0


# Without current


def test_the_shaft_coasts_without_current(bench: CsdBench) -> None:
    bench.drive.environment.friction = 10_000
    moving(bench)
    bench.now = 3.0
    bench.control(0x07)
    assert bench.velocity(4.0) == pytest.approx(10_000, abs=10)
    assert bench.position(10.0) == 38_000 + 20_000
    bench.enable()
    assert bench.position() == 58_000  # and from there it goes on
    bench.control(0x1F)
    bench.settle()
    assert bench.position() == 100_000


def test_the_current_is_not_switched_on_while_the_shaft_turns_too_fast(bench: CsdBench) -> None:
    bench.put(Power_Up_Speed_Limit=1000)
    bench.drive.environment.friction = 1000
    bench.drive.turn(5000, 0.0)
    bench.now = 1.0
    assert bench.control(0x06, 0x0F) == "0218"
    assert bench.read("Error Code") == 0x8400
    assert bench.control(0x80) == "0270"
    bench.now = 4.5  # 500 step/s
    bench.control(0x06, 0x0F)
    assert bench.status(5.0) == "0637"
    bench.drive.turn(5000, 5.0)  # with current it cannot be turned
    assert bench.velocity(6.0) == 0


def test_a_wrong_encoder_count_is_a_following_error(bench: CsdBench) -> None:
    bench.drive.environment.encoder = 4000
    moving(bench)
    bench.now = 2.0
    assert bench.status() == "3637"  # it seems to run away
    bench.ask(WriteSingleRegister(1040, 0x06))
    bench.write("Encoder Count Per Revolution", 4000)
    bench.enable()
    bench.now = 3.0
    bench.control(0x1F)
    bench.settle()
    assert (bench.position(), bench.control(0x0F)) == (100_000, "0637")


def test_a_motor_without_encoder_has_a_following_error(bench: CsdBench) -> None:
    bench.drive.environment.encoder = 0
    moving(bench)
    assert bench.status(2.0) == "3637"
    assert bench.position() == 0


def test_an_impossible_environment_does_not_hang(bench: CsdBench) -> None:
    bench.drive.environment.walls = Span(100.0, -100.0)
    bench.drive.environment.pull_out = 0.0
    moving(bench)
    assert bench.status(2.0)[2:] == "37"
