"""The stepper drive against walls and loads: out of step, recovered by Auto Sync, coasting without current."""

from __future__ import annotations

from math import inf

import pytest

from barewire.devices.sim.csd_mt.environment import Span
from barewire.modbus.messages.registers import WriteSingleRegister
from tests.devices.sim.csd_mt.csd_mt_bench import CsdBench, moving


@pytest.fixture
def bench() -> CsdBench:
    bench = CsdBench()
    bench.write("Velocity Total Sample", 1)
    return bench


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
