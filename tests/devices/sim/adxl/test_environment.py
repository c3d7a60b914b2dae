"""The soft starter in its environment: every status, delays and limits, inputs, a small motor, another address."""

from __future__ import annotations

import pytest

from barewire.devices.sim import MachineUnits, simulator
from barewire.modbus.messages.diagnostics import ReadExceptionStatus, ReadExceptionStatusResponse
from barewire.modbus.messages.registers import WriteSingleRegister
from tests.devices.sim.adxl.adxl_bench import set_parameter, starter
from tests.devices.sim.bench import Bench


@pytest.fixture
def bench() -> Bench:
    return Bench(simulator("adxl"))


def test_every_status_of_table_2_can_be_reached(bench: Bench) -> None:
    machine, seen = starter(bench), {}

    def look() -> None:
        status = bench.read("Status")
        seen[int(status)] = bench.parameter("Status").values[int(status)]

    def until(seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            bench.now = round(bench.now + 0.1, 6)
            look()

    look()
    machine.preheats = True
    look()
    machine.preheats, machine.selects_motor = False, True
    look()
    assert bench.refused(WriteSingleRegister(0x1001, 1)) == 4  # no motor is chosen yet
    machine.selects_motor = False
    machine.motor.start_delay, machine.motor.kick_time, machine.motor.torque_limit = 1.0, 0.5, 0.75
    bench.write("Motor start command", 1)
    look()
    until(15.0)
    machine.inhibited = True
    look()
    machine.trip("PHASE LOSS", bench.now)  # inhibited: an event and nothing else
    assert (bench.read("Status"), machine.events.texts[-1].split(" ", 1)[1]) == (11, "INHIBITED PHASE LOSS")
    machine.inhibited = False
    bench.write("Motor stop command", 1)
    until(10.0)
    machine.trip("THERMAL PROTECTION", bench.now)
    look()
    machine.clear(bench.now)
    machine.supply(False, bench.now)
    look()
    assert seen == bench.parameter("Status").values  # all fifteen, with the words of the table


def test_a_delay_and_a_kick_come_before_the_ramp(bench: Bench) -> None:
    motor = starter(bench).motor
    motor.start_delay, motor.kick_time = 1.0, 0.5
    bench.write("Motor start command", 1)
    assert (bench.read("Status"), bench.read("L1 current"), bench.read("Output 1")) == (3, 0, False)
    bench.now = 1.0
    assert (bench.read("Status"), bench.read("L1 current"), bench.read("Output 1")) == (4, 75.0, True)
    bench.now = 1.5
    assert bench.read("Status") == 5
    bench.now = 11.5
    assert bench.read("Status") == 8
    bench.machine.power_cycle(20.0)
    bench.now = 30.0
    bench.write("Motor start command", 1)
    bench.write("Motor stop command", 1)  # nothing turns yet: ready at once
    assert bench.read("Status") == 2


def test_a_torque_limit_holds_the_torque_and_takes_current_with_it(bench: Bench) -> None:
    starter(bench).motor.torque_limit = 0.75
    bench.write("Motor start command", 1)
    bench.now = 8.0
    assert (bench.read("Status"), bench.read("Torque")) == (7, 75.0)
    free = Bench(simulator("adxl"))
    free.write("Motor start command", 1)
    free.now = 8.0
    assert float(bench.read("L1 current")) < float(free.read("L1 current"))
    assert float(free.read("Torque")) > 75


def test_c15_simulates_a_small_motor_until_the_next_power_on(bench: Bench) -> None:
    bench.ask(WriteSingleRegister(0x2FEF, 14))
    bench.write("Motor start command", 1)
    statuses = set()
    for second in range(1, 11):
        bench.now = float(second)
        statuses.add(bench.read("Status"))
    assert statuses == {5, 11}  # the limit is never reached; running, the protections are inhibited
    assert bench.read("L1 current") == pytest.approx(0.8 * 30 * 0.05)
    starter(bench).trip("UNDERCURRENT", 12.0)
    bench.now = 12.0
    assert bench.read("Status") == 11
    bench.ask(WriteSingleRegister(0x2F02, 5))
    bench.now = 20.0
    bench.write("Motor start command", 1)
    bench.now = 40.0
    assert bench.read("Status") == 9
    assert bench.read("L1 current") == pytest.approx(24.0)


def test_inputs_limits_and_remotes(bench: Bench) -> None:
    machine = starter(bench)
    machine.close(1, True, 1.0)
    bench.now = 1.0
    assert (bench.read("Input 1"), bench.read("Status")) == (True, 5)
    bench.now = 20.0
    assert bench.ask(ReadExceptionStatus()) == ReadExceptionStatusResponse(0b0100_0001)
    machine.close(2, True, 20.0)
    assert bench.read("Status") == 10
    machine.close(2, False, 30.0)
    bench.now = 30.0
    assert (bench.read("Status"), bench.ask(ReadExceptionStatus())) == (2, ReadExceptionStatusResponse(0b0001_1001))
    machine.limits, machine.remotes = 0b1010, 0b0101
    assert [bench.read(f"Limit {place}") for place in (1, 2, 3, 4)] == [False, True, False, True]
    assert [bench.read(f"Remote {place}") for place in (1, 2, 3, 4)] == [True, False, True, False]
    bench.write("C06 Reset LIM variables with memory", 5)
    assert [bench.read(f"Limit {place}") for place in (1, 2, 3, 4)] == [False] * 4
    assert machine.service_hours == pytest.approx(24.0 / 3600)
    bench.write("C04 Reset the motor's hour meter", 3)
    assert machine.service_hours == pytest.approx(24.0 / 3600)
    bench.write("C01 Reset maintenance service interval", 0)
    assert machine.service_hours == 0


def test_a_new_node_address_takes_effect_after_the_reboot(bench: Bench) -> None:
    set_parameter(bench, 8, 1, 17)
    assert list(MachineUnits(bench.machine)) == [1]
    bench.write("Save and reboot", 5)
    assert list(MachineUnits(bench.machine)) == [17]
    assert list(MachineUnits(bench.machine, 255, 0)) == [17, 255, 0]
    assert list(MachineUnits(simulator("adxl", unit=4))) == [4]
