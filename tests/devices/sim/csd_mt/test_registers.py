"""The registers of the stepper drive that do not move it: temperature, memory, outputs, small ones."""

from __future__ import annotations

import pytest

from barewire.modbus.messages.coils import ReadCoils
from barewire.modbus.messages.registers import ReadHoldingRegisters, WriteSingleRegister
from tests.devices.sim.bench import STATUS, VELOCITY, CsdBench


@pytest.fixture
def bench() -> CsdBench:
    return CsdBench()


# Temperature


def test_temperature_warns_and_trips(bench: CsdBench) -> None:
    bench.enable()
    bench.write("Enable SW bit 7", 1)
    assert bench.refused(WriteSingleRegister(1107, 1)) == 3  # not both
    bench.drive.environment.ambient = 90.0
    assert bench.status(1000.0) == "06B7"
    bench.drive.environment.ambient = 110.0
    assert bench.status(3000.0) == "0298"
    assert bench.read("Error Code") == 0x4310
    assert int(bench.read("Drive Alarm Time 0")) < 2000  # when it became too hot, not when it was read
    assert bench.control(0x80) == "0298"
    bench.drive.environment.ambient = 90.0
    bench.status(6000.0)
    assert bench.control(0x00, 0x80) == "0298"  # below 98 °C again, but not below the warning
    bench.drive.environment.ambient = 20.0
    assert bench.status(9000.0) == "0218"
    assert bench.control(0x00, 0x80) == "0270"
    assert bench.read("Drive Temperature") == 22
    bench.write("Read Temperature", 1)
    assert bench.read("Read Temperature") == 0


def test_a_threshold_below_the_warning_does_not_hang(bench: CsdBench) -> None:
    bench.drive.environment.ambient = 60.0
    bench.write("Drive Fault Temperature", 50)
    assert bench.status(5000.0) == "0218"
    assert bench.read("Error Code") == 0x4310


def test_the_current_is_reduced_at_standstill(bench: CsdBench) -> None:
    assert bench.drive.thermal.current == 0
    bench.put(Target_Position=100_000, Current_Ratio=100, Current_Reduction_Ratio=25)
    bench.enable()
    bench.control(0x1F)
    assert bench.drive.thermal.current == 4  # of motor code 1544h
    ends_at = bench.settle()
    assert bench.drive.thermal.current == 4
    bench.status(ends_at + 0.081)
    assert bench.drive.thermal.current == 1
    bench.write("Auto Sync Enable", 1)  # "current reduction disabled"
    assert bench.drive.thermal.current == 4
    bench.write("Auto Sync Enable", 3)
    assert bench.drive.thermal.current == 1
    bench.write("Auto Sync Kv", 0)
    bench.drive.slip(1000, bench.now)  # a gap that is not recovered
    assert bench.drive.thermal.current == 1
    bench.write("Auto Sync Enable", 2)  # "not working to recover an excessive position gap"
    assert bench.drive.thermal.current == 4


# Memory


def test_parameters_are_saved_after_five_seconds(bench: CsdBench) -> None:
    bench.write("Current Ratio", 50)
    bench.write("IP Address fourth octet", 77)
    bench.write("Target Position", 5)
    bench.write("User Data RAM", 99)
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
    assert [*read, bench.read("User Data RAM")] == [50, 10, 0, 0]
    bench.write("IP Address fourth octet", 77)
    bench.ask(WriteSingleRegister(1260, 0x1111))
    bench.machine.power_cycle(15.0)
    bench.now = 15.0
    assert bench.read("IP Address fourth octet") == 77
    bench.ask(WriteSingleRegister(1261, 0x6F6C))
    assert bench.read("Current Ratio") == 70
    assert bench.refused(WriteSingleRegister(1261, 1)) == 3
    for word in (0, 0x2222, 0x6172, 0xFFFF):  # "only executed when a specific signature is written"
        assert bench.refused(WriteSingleRegister(1260, word)) == 3
    bench.machine.power_cycle(30.0)
    bench.now = 30.0
    assert (bench.read("Current Ratio"), bench.read("IP Address fourth octet")) == (70, 77)


def test_power_off_stops_the_drive_and_leaves_the_shaft(bench: CsdBench) -> None:
    bench.enable()
    bench.put(Target_Position=100_000)
    bench.control(0x1F)
    bench.machine.power_cycle(2.0)
    bench.now = 2.0
    assert (bench.status(), bench.position()) == ("0270", 0)
    assert not bench.drive.shaft.has_current
    assert bench.drive.shaft.position(2.0) > 10_000  # the mechanics stay where they were


# Small registers


def test_refusals(bench: CsdBench) -> None:
    assert bench.refused(ReadCoils(0, 1)) == 1
    assert bench.refused(ReadHoldingRegisters(1003, 1)) == 2
    assert bench.refused(WriteSingleRegister(STATUS, 1)) == 2
    assert bench.refused(WriteSingleRegister(1041, 2)) == 3  # no such mode
    assert bench.refused(WriteSingleRegister(1085, 3)) == 3
    bench.write("Following Error Reaction Code", 17)
    assert bench.refused(WriteSingleRegister(1108, 1)) == 3  # no Auto Sync without encoder
    bench.write("Following Error Reaction Code", 0)
    bench.write("Encoder Count Per Revolution", 4000)
    assert bench.refused(WriteSingleRegister(1086, 2)) == 3
    bench.enable()
    assert bench.refused(WriteSingleRegister(1085, 17)) == 4  # below Operation Enabled only
    assert bench.refused(WriteSingleRegister(1089, 0x27)) == 4  # the brake is chosen before
    assert bench.refused(WriteSingleRegister(1089, 0x1F)) == 0
    assert bench.refused(WriteSingleRegister(1092, 1)) == 4


def test_digital_output_shows_brake_and_fault(bench: CsdBench) -> None:
    bench.write("Set Output", 0b11111)
    assert bench.read("Digital Output") == 0b11011 << 16  # O2 shows a fault
    bench.write("Output Config", 0x27)
    assert bench.read("Digital Output") == 0b11101 << 16  # O1 is the brake, locked
    bench.enable()
    assert bench.read("Digital Output") == 0b11111 << 16 | 1
    bench.drive.fault(0x2130, 1.0)
    bench.now = 1.0
    assert bench.read("Digital Output") == 0b11101 << 16
    bench.write("Output Config", 0x23)
    assert bench.read("Digital Output") == 0b11101 << 16  # O2 is the fault now
    bench.drive.solve(1.0)
    bench.control(0x80)
    assert bench.read("Digital Output") == 0b11001 << 16


def test_the_clock_may_begin_anywhere() -> None:
    bench = CsdBench(1e6)
    bench.enable()
    bench.drive.fault(0x2130, 1e6 + 12)
    bench.now = 1e6 + 12
    assert bench.read("Drive Alarm Time 0") == 12


def test_the_first_enabling_can_reset_the_position(bench: CsdBench) -> None:
    bench.drive.axis.rest_at(777.0, 0.0)
    assert bench.position() == 777
    bench.write("Reset Encoder On First Power Up", 1)
    bench.enable()
    assert bench.position() == 0
    bench.put(Target_Position=500)
    bench.control(0x1F)
    bench.settle()
    bench.control(0x06, 0x0F)  # the first time only
    assert bench.position(bench.now + 0.3) == 500
    bench.control(0x06)
    bench.write("Step Revolution", 12_800)  # register 1114: resets too
    assert bench.position() == 0


def test_the_first_enabling_may_run_at_once(bench: CsdBench) -> None:
    bench.put(Reset_Encoder_On_First_Power_Up=1, Target_Velocity=20_000)
    bench.enable(VELOCITY)
    assert bench.velocity(5.0) == 20_000


def test_enabling_with_a_halt(bench: CsdBench) -> None:
    bench.put(Mode_of_Operation=VELOCITY, Target_Velocity=20_000)
    bench.control(0x06, 0x07, 0x10F)
    assert (bench.status(5.0), bench.velocity()) == ("1637", 0)
    bench.control(0x0F)
    assert bench.velocity(10.0) == 20_000


def test_another_encoder_resets_the_position(bench: CsdBench) -> None:
    bench.drive.axis.rest_at(777.0, 0.0)
    bench.write("Encoder Count Per Revolution", 4000)
    assert bench.position() == 0
    bench.drive.environment.encoder = 4000
    bench.enable()
    bench.put(Target_Position=500)
    bench.control(0x1F)
    bench.settle()
    bench.write("Encoder Count Per Revolution", 4000)  # with the current on: when it is off again
    assert bench.position() == 500
    bench.control(0x06)
    assert bench.position() == 0


def test_identity(bench: CsdBench) -> None:
    assert bench.words(1250, 3) == (0x0200, 0x0000, 0x0094)
    bench.write("Motor Code", 0x17E2)
    assert bench.words(1117, 4) == (2, 1400, 700, 1)
