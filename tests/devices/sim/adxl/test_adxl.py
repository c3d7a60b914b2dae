"""The soft starter: duration of a start, measures, menus, commands, events, reboot."""

from __future__ import annotations

import pytest

from barewire.devices.sim import simulator
from barewire.devices.sim.adxl import EventList
from barewire.modbus.messages.diagnostics import ReadExceptionStatus, ReadExceptionStatusResponse
from barewire.modbus.messages.identification import ReadDeviceIdentification, ReportServerId
from barewire.modbus.messages.registers import (
    ReadHoldingRegisters,
    ReadInputRegisters,
    WriteMultipleRegisters,
    WriteSingleRegister,
)
from tests.devices.sim.adxl.adxl_bench import set_parameter, starter
from tests.devices.sim.bench import Bench


@pytest.fixture
def bench() -> Bench:
    return Bench(simulator("adxl"))


def test_a_start_lasts_as_long_as_p01_04(bench: Bench) -> None:
    set_parameter(bench, 1, 4, 20)
    bench.now = 100.0
    bench.ask(WriteSingleRegister(0x1001, 1))  # printed 1002h
    seen: list[tuple[float, object]] = []
    for tenth in range(0, 230):
        bench.now = 100 + tenth / 10
        status = bench.read("Status")
        if not seen or seen[-1][1] != status:
            seen.append((tenth / 10, status))
    assert [status for _, status in seen] == [5, 6, 5, 8, 9]
    assert seen[3] == (20.0, 8)  # the ramp is over exactly after the acceleration time
    assert seen[4] == (21.0, 9)


def test_measures_follow_the_motor(bench: Bench) -> None:
    assert (bench.read("L1 current"), bench.read("Thyristors temperature"), bench.read("Start counter")) == (0, 24.5, 0)
    bench.write("Motor start command", 1)
    bench.now = 5.0
    assert bench.read("L1 current") == 75.0  # 2.5 times 30 A: the limit
    assert 24.5 < float(bench.read("Thyristors temperature")) < 40
    assert bench.ask(ReadExceptionStatus()) == ReadExceptionStatusResponse(0b0100_0000)
    bench.now = 3600.0
    assert bench.read("Status") == 9
    assert bench.read("Total power factor") == 0.86
    kilowatts = float(bench.read("Total active power"))
    assert kilowatts == pytest.approx(14.3, abs=0.1)
    assert sum(float(bench.read(f"L{line} active power")) for line in (1, 2, 3)) == pytest.approx(kilowatts, abs=0.001)
    assert float(bench.read("Total active energy")) == pytest.approx(kilowatts, abs=0.1)
    assert bench.read("Motor hour meter") == pytest.approx(1.0)
    assert bench.read("Thyristors temperature") == 24.5  # cooled down while the bypass carries the current
    assert bench.read("Start counter") == 1
    bench.write("Motor stop command", 1)
    assert bench.read("Status") == 10
    bench.now += 5.0
    assert bench.read("Status") == 12
    assert bench.refused(WriteSingleRegister(0x1001, 1)) == 4  # it still turns
    bench.now += 2.0
    assert bench.read("Status") == 2


def test_ticking_more_often_changes_almost_nothing() -> None:
    seldom, often = Bench(simulator("adxl")), Bench(simulator("adxl"))
    for bench in (seldom, often):
        bench.write("Motor start command", 1)
    for step in range(1, 1001):
        often.now = step * 0.02
        often.read("Status")
    seldom.now = 20.0
    seldom.read("Status")
    rare, frequent = starter(seldom).motor, starter(often).motor
    assert (rare.energy, rare.thyristors, rare.thermal) == pytest.approx(
        (frequent.energy, frequent.thyristors, frequent.thermal), 1e-3
    )


def test_unsaved_parameters_are_lost_at_power_off(bench: Bench) -> None:
    set_parameter(bench, 1, 4, 33)
    bench.machine.power_cycle(1.0)
    assert starter(bench).menus.values[1, 0, 4] == 10


def test_menu_parameters_are_selected_read_and_written(bench: Bench) -> None:
    set_parameter(bench, 8, 4, 2)
    assert bench.read("Parameter value") == 2
    assert bench.refused(WriteSingleRegister(0x5003, 3)) == 3  # stop bits: 1 or 2
    bench.write("Parameter number selection", 77)
    assert bench.refused(WriteSingleRegister(0x5003, 1)) == 2
    assert bench.refused(ReadInputRegisters(0x5003, 1)) == 2
    assert bench.refused(ReadHoldingRegisters(0x4FFF, 1)) == 2  # settings are read with 04 only
    bench.write("C13 Save a copy of the setup parameters", 12)
    bench.write("C12 Restore the factory default settings", 11)
    assert starter(bench).menus.values[8, 0, 4] == 1
    bench.write("C14 Restore a copy of the setup parameters", 13)
    assert starter(bench).menus.values[8, 0, 4] == 2


def test_each_command_acts_on_the_counter_that_it_names(bench: Bench) -> None:
    bench.write("Motor start command", 1)
    bench.now = 1000.0
    bench.read("Status")
    for value, name in (
        (1, "Motor thermal status"),
        (2, "Start counter"),
        (3, "Motor hour meter"),
        (4, "Total active energy"),
    ):
        assert bench.read(name)
        bench.ask(WriteSingleRegister(0x2FEF, value))
        assert bench.read(name) == 0
    assert bench.refused(WriteSingleRegister(0x2FEF, 6)) == 3  # C07 does not exist
    assert bench.refused(WriteSingleRegister(0x2FEF, 13)) == 4  # no copy to restore


def test_events_are_counted_and_read_one_after_the_other(bench: Bench) -> None:
    bench.write("Motor start command", 1)
    assert bench.words(0x502F, 1, "input") == (0x0202,)
    bench.write("Event index", 0)
    assert bench.read("Event description") == "00000000 POWER ON"
    assert bench.read("Event description") == "00000000 MOTOR START COMMAND"  # the index moved on by itself
    assert bench.refused(ReadInputRegisters(0x5031, 28)) == 4
    assert bench.refused(ReadInputRegisters(0x5031, 27)) == 3
    assert bench.refused(ReadInputRegisters(0x5032, 1)) == 3
    assert bench.refused(WriteSingleRegister(0x502F, 2)) == 3
    for _ in range(EventList.SIZE):
        bench.write("C01 Reset maintenance service interval", 0)
    assert bench.words(0x502F, 1, "input") == (EventList.SIZE << 8 | 2,)
    bench.write("C16 Reset the events list", 15)
    assert bench.words(0x502F, 1, "input") == (0,)


def test_function_codes(bench: Bench) -> None:
    answer = bench.ask(ReportServerId())
    assert answer is not None
    assert answer.encode().hex(" ") == "11 08 01 02 00 00 05 00 00 00"
    assert bench.words(0x0FB1, 2, "input") == (0, 245)
    third = bench.ask(ReadHoldingRegisters(0x0FB1, 2))
    assert third is not None
    assert third.encode().hex(" ") == "03 04 00 00 00 f5"
    assert bench.refused(WriteMultipleRegisters(0x4FFF, (1,))) == 1
    assert bench.refused(ReadDeviceIdentification()) == 1
    assert bench.refused(WriteSingleRegister(0x0FB1, 1)) == 2


def test_line_failure_and_alarm_stop_the_motor(bench: Bench) -> None:
    bench.write("Motor start command", 1)
    starter(bench).trip("THERMAL PROTECTION", 3.0)
    bench.now = 3.0
    assert (bench.read("Status"), bench.read("L1 current"), bench.read("Output 3")) == (13, 0, True)
    assert bench.refused(WriteSingleRegister(0x1001, 1)) == 4
    starter(bench).clear(4.0)
    starter(bench).supply(False, 4.0)
    bench.now = 10.0
    assert (bench.read("Status"), bench.read("Frequency")) == (0, 0)
    starter(bench).supply(True, 10.0)
    assert bench.read("Status") == 2
