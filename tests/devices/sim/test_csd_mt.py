"""The stepper drive: states and status words as printed, profiles that last as the formula says, memory and faults."""

from __future__ import annotations

import pytest

from barewire.devices.cia402 import State
from barewire.devices.sim import CsdMt, simulator
from barewire.modbus.bits import ReadCoils
from barewire.modbus.registers import (
    ReadHoldingRegisters,
    ReadInputRegisters,
    WriteMultipleRegisters,
    WriteSingleRegister,
)
from tests.devices.sim.bench import Bench

STATUS, CONTROL = 1001, 1040


@pytest.fixture
def bench() -> Bench:
    return Bench(simulator("csd-mt"))


def drive(bench: Bench) -> CsdMt:
    assert isinstance(bench.machine, CsdMt)
    return bench.machine


def status(bench: Bench, now: float | None = None) -> str:
    bench.now = bench.now if now is None else now
    return f"{bench.words(STATUS)[0]:04X}"


def control(bench: Bench, *words: int) -> str:
    for word in words:
        bench.ask(WriteSingleRegister(CONTROL, word))
    return status(bench)


def enabled(bench: Bench, mode: int = 1) -> None:
    bench.write("Mode of Operation", mode)
    control(bench, 0x06, 0x07, 0x0F)


def test_status_words_as_printed(bench: Bench) -> None:
    assert status(bench) == "0270"
    drive(bench).supply(False, 0.0)
    assert control(bench, 0x06) == "0221"  # no high voltage
    assert control(bench, 0x07) == "0221"
    drive(bench).supply(True, 1.0)
    assert status(bench, 1.4) == "0231"
    assert control(bench, 0x07) == "0231"  # not yet 500 ms
    bench.now = 1.5
    assert control(bench, 0x07) == "0233"
    assert control(bench, 0x0F) == "0637"
    assert control(bench, 0x06, 0x0F) == "0637"  # "the direct sequence can be done"
    assert control(bench, 0x02) == "0617"  # quick stop: it stays there
    assert status(bench, 10.0) == "0617"
    assert control(bench, 0x0F) == "0637"  # transition 16
    assert control(bench, 0x00) == "0270"


def test_profile_velocity_status_words(bench: Bench) -> None:
    bench.write("Mode of Operation", 3)
    assert [control(bench, word) for word in (0x06, 0x07, 0x0F)] == ["1231", "1233", "1637"]
    assert bench.read("Mode of Operation Display") == 3


def test_a_trapezoid_lasts_as_long_as_the_formula_says(bench: Bench) -> None:
    enabled(bench)
    for name, value in (("Target Position", 240_000), ("Profile Velocity", 90_000), ("Profile Acceleration", 140_000)):
        bench.write(name, value)
    bench.now = 10.0
    assert control(bench, 0x5F) == "1237"  # relative; acknowledged, not reached
    assert control(bench, 0x0F) == "0237"
    ends = 10 + 240_000 / 90_000 + 90_000 / 140_000
    bench.now = 10 + 90_000 / 140_000
    assert bench.read("Velocity Actual Value") == 90_000
    assert bench.read("Position Actual Value") == round(90_000**2 / 140_000 / 2)
    assert status(bench, ends - 0.001) == "0237"
    assert status(bench, ends + 0.001) == "0637"
    assert bench.read("Position Actual Value") == 240_000
    # Below 16000 steps per second a move is start-stop; absolute this time, and back.
    bench.write("Target Position", 230_000)
    bench.write("Profile Velocity", 10_000)
    bench.now = 20.0
    control(bench, 0x1F)
    bench.now = 20.5
    assert (bench.read("Position Actual Value"), bench.read("Velocity Actual Value")) == (235_000, -10_000)
    bench.now = 21.0
    assert bench.read("Position Actual Value") == 230_000


def test_set_points_on_the_way(bench: Bench) -> None:
    enabled(bench)
    bench.write("Target Position", 100_000)
    control(bench, 0x1F, 0x0F)
    bench.now = 1.0
    bench.write("Target Position", 200_000)
    control(bench, 0x1F, 0x0F)  # bit 5 is 0: not before the target is reached
    bench.now = 2.0
    control(bench, 0x3F, 0x2F)  # at once
    bench.now = 100.0
    assert bench.read("Position Actual Value") == 200_000
    # A relative movement keeps the overall starting point as its reference.
    bench.write("Target Position", 50_000)
    control(bench, 0x6F, 0x7F, 0x6F)
    bench.now = 100.5
    bench.write("Target Position", 80_000)
    control(bench, 0x7F, 0x6F)
    assert bench.refused(WriteMultipleRegisters(1044, (0, 0))) == 3  # velocity 0 while it runs
    bench.write("Profile Velocity", 400_000)
    assert drive(bench).axis.way.ends_at < 102
    bench.now = 102.0
    assert bench.read("Position Actual Value") == 280_000


def test_halt(bench: Bench) -> None:
    enabled(bench)
    bench.write("Target Position", 100_000)
    control(bench, 0x1F)
    bench.now = 1.0
    assert control(bench, 0x10F) == "0237"
    assert status(bench, 2.0) == "0637"
    stands = bench.read("Position Actual Value")
    assert control(bench, 0x0F) == "0237"  # target reached falls, the movement is not completed
    bench.now = 50.0
    assert bench.read("Position Actual Value") == stands


def test_profile_velocity(bench: Bench) -> None:
    enabled(bench, 3)
    bench.write("Profile Acceleration", 100_000)
    bench.write("Profile Deceleration", 50_000)
    bench.now = 10.0
    bench.write("Target Velocity", 200_000)
    bench.now = 11.0
    assert (bench.read("Velocity Actual Value"), status(bench)) == (100_000, "0237")
    assert status(bench, 12.1) == "0637"
    assert bench.read("Position Actual Value") == 220_000
    bench.now = 20.0
    bench.write("Target Velocity", -100_000)  # "and even the direction": 4 s down, 1 s up again
    bench.now = 24.0
    assert bench.read("Velocity Actual Value") == 0
    bench.now = 25.0
    assert bench.read("Velocity Actual Value") == -100_000
    bench.write("Max Motor Speed", 20_000)
    bench.now = 40.0
    assert bench.read("Velocity Actual Value") == -20_000
    control(bench, 0x02)
    bench.now = 41.0
    assert (bench.read("Velocity Actual Value"), drive(bench).axis.state) == (0, State.QUICK_STOP_ACTIVE)


def test_homing(bench: Bench) -> None:
    enabled(bench, 6)
    bench.write("Homing Offset", 1000)
    bench.write("Homing Method", 35)
    assert status(bench) == "0637"
    assert control(bench, 0x1F) == "1637"
    assert bench.read("Position Actual Value") == 1000
    drive(bench).home_at = 33_000.0
    bench.write("Homing Method", 19)
    bench.write("Homing Acceleration", 16_001)
    bench.now = 1.0
    assert control(bench, 0x0F, 0x1F) == "0237"
    lasts = 32_000 / 16_001 + 1
    assert status(bench, 1 + lasts - 0.01) == "0237"
    assert status(bench, 1 + lasts + 0.01) == "1637"
    assert bench.read("Position Actual Value") == 1000


def test_32_bits_take_effect_with_the_second_word(bench: Bench) -> None:
    bench.ask(WriteSingleRegister(1042, 0x5678))
    assert bench.read("Target Position") == 0
    bench.ask(WriteSingleRegister(1043, 0x1234))
    assert bench.read("Target Position") == 0x12345678
    assert bench.words(1042, 2) == (0x5678, 0x1234)
    bench.ask(WriteSingleRegister(1162, 0))  # big-endian, at once
    assert bench.words(1042, 2) == (0x1234, 0x5678)
    bench.ask(WriteMultipleRegisters(1042, (0xFFFF, 0xFFFE)))
    assert bench.machine.store["Target Position"] == -2
    answer = bench.ask(ReadInputRegisters(1042, 2))
    assert answer is not None
    assert answer.encode().hex() == "0404fffffffe"


def test_faults(bench: Bench) -> None:
    enabled(bench)
    drive(bench).fault(0x2130, 65.0)
    bench.now = 65.0
    assert (status(bench), bench.read("Error Code"), bench.read("Error Register")) == ("0218", 0x2130, 1)
    assert (bench.read("Drive Alarm Time 0"), bench.read("Drive Alarm Code 0")) == (65, 0x2130)
    assert control(bench, 0x80) == "0218"  # the cause is still there
    drive(bench).solve(66.0)
    assert control(bench, 0x80) == "0218"  # no rising edge
    assert control(bench, 0x00, 0x80) == "0270"
    assert (bench.read("Error Code"), bench.read("Error Register")) == (0, 0)
    drive(bench).supply(False, 70.0)
    enabled(bench)
    assert drive(bench).axis.state is State.READY_TO_SWITCH_ON
    bench.write("Reset Error Logs", 1)
    assert bench.read("Drive Alarm Code 0") == 0


def test_a_following_error_brakes_first(bench: Bench) -> None:
    enabled(bench, 3)
    bench.write("Target Velocity", 64_000)
    bench.now = 10.0
    assert status(bench) == "0637"
    drive(bench).fault(0x8611, 10.0)
    assert status(bench, 10.05) == "201F"
    assert status(bench, 10.5) == "1218"


def test_temperature(bench: Bench) -> None:
    enabled(bench)
    bench.write("Enable SW bit 7", 1)
    assert bench.refused(WriteSingleRegister(1107, 1)) == 3  # not both
    drive(bench).service.ambient = 90.0
    assert status(bench, 600.0) == "06B7"
    drive(bench).service.ambient = 110.0
    assert status(bench, 3000.0) == "0298"
    assert bench.read("Error Code") == 0x4310
    drive(bench).service.ambient = 20.0
    assert status(bench, 9000.0) == "0218"
    assert control(bench, 0x80) == "0270"
    assert bench.read("Drive Temperature") == 22


def test_memory(bench: Bench) -> None:
    bench.write("Current Ratio", 50)
    bench.write("IP Address fourth octet", 77)
    bench.write("Target Position", 5)
    bench.ask(WriteSingleRegister(1260, 0x6173))
    assert bench.read("Save All Parameters") == 0
    bench.machine.power_cycle(2.0)  # too early: "keep the control power on more than 5 seconds"
    assert bench.read("Current Ratio") == 70
    bench.now = 3.0
    bench.write("Current Ratio", 50)
    bench.write("IP Address fourth octet", 77)
    bench.ask(WriteSingleRegister(1260, 0x6173))
    bench.machine.power_cycle(9.0)
    bench.now = 9.0
    read = [bench.read(name) for name in ("Current Ratio", "IP Address fourth octet", "Target Position")]
    assert read == [50, 10, 0]
    bench.ask(WriteSingleRegister(1261, 0x6F6C))
    assert bench.read("Current Ratio") == 70
    assert bench.refused(WriteSingleRegister(1261, 1)) == 3
    assert bench.refused(WriteSingleRegister(1260, 0x2000)) == 0  # between the signatures nothing acts


def test_the_watchdog_of_messages(bench: Bench) -> None:
    bench.write("Counter Watchdog", 500)
    enabled(bench)
    assert status(bench, 0.4) == "0637"
    assert status(bench, 0.8) == "0637"
    assert status(bench, 2.0) == "0218"


def test_refusals(bench: Bench) -> None:
    assert bench.refused(ReadCoils(0, 1)) == 1
    assert bench.refused(ReadHoldingRegisters(1003, 1)) == 2
    assert bench.refused(WriteSingleRegister(STATUS, 1)) == 2
    assert bench.refused(WriteSingleRegister(1041, 2)) == 3  # no such mode
    assert bench.refused(WriteSingleRegister(1085, 3)) == 3
    enabled(bench)
    assert bench.refused(WriteSingleRegister(1085, 17)) == 4  # below Operation Enabled only


def test_outputs(bench: Bench) -> None:
    bench.write("Set Output", 0b11111)
    assert bench.read("Digital Output") == 0b11011 << 16  # O2 tells of a fault
    bench.write("Output Config", 0x27)
    enabled(bench)
    assert bench.read("Digital Output") == 0b11111 << 16 | 1  # the brake is released, on O1
    drive(bench).service.inputs = 0b1010
    assert bench.read("Digital Input") == 0b1010 << 16


def test_the_clock_may_begin_anywhere(bench: Bench) -> None:
    bench.now = 1e6
    enabled(bench)
    drive(bench).fault(0x2130, 1e6 + 12)
    bench.now = 1e6 + 12
    assert bench.read("Drive Alarm Time 0") == 12


def test_power_fails_under_way(bench: Bench) -> None:
    enabled(bench)
    drive(bench).supply(False, 1.0)
    bench.now = 1.0
    assert (status(bench), bench.read("Error Code")) == ("0208", 0x5100)
    drive(bench).supply(True, 2.0)
    assert bench.read("Error Code") == 0
    assert control(bench, 0x80) == "0270"


def test_the_first_enabling_can_reset_the_position(bench: Bench) -> None:
    drive(bench).axis.rest_at(777.0, 0.0)
    bench.write("Reset Encoder On First Power Up", 1)
    enabled(bench)
    assert bench.read("Position Actual Value") == 0


def test_the_ramp_bit(bench: Bench) -> None:
    enabled(bench)
    bench.write("Enable SW bit 15", 1)
    bench.write("Target Position", 100_000)
    assert control(bench, 0x1F) == "9237"
    assert status(bench, 1.0) == "1237"


def test_no_homing_without_a_method(bench: Bench) -> None:
    enabled(bench, 6)
    assert control(bench, 0x1F) == "0237"


def test_velocity_halts_and_goes_on(bench: Bench) -> None:
    enabled(bench, 3)
    bench.write("Target Velocity", 64_000)
    bench.now = 1.0
    control(bench, 0x10F)
    assert status(bench, 2.0) == "1637"  # zero speed, and that is what halt wanted
    control(bench, 0x0F)
    bench.now = 3.0
    assert bench.read("Velocity Actual Value") == 64_000


def test_a_new_ramp_waits_for_the_next_movement(bench: Bench) -> None:
    enabled(bench)
    bench.write("Profile Velocity", 100_000)
    bench.write("Profile Acceleration", 100_000)
    bench.write("Profile Deceleration", 2_000)  # of no account here: 1072 is for profile velocity
    bench.write("Target Position", 300_000)
    control(bench, 0x1F)
    bench.now = 1.5
    bench.write("Profile Acceleration", 1_000_000)
    bench.write("Profile Velocity", 50_000)  # acts at once
    bench.now = 2.0
    assert bench.read("Velocity Actual Value") == 50_000
    before = drive(bench).axis.way.ends_at
    bench.now = before - 0.25
    assert bench.read("Velocity Actual Value") == 25_000
