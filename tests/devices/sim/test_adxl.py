"""The soft starter: a start and its measures, menus, commands, events, reboot; environment; the manual's examples."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.ascii import AsciiLine, frame as ascii_frame
from barewire.devices.sim import Adxl, MachineUnits, simulator
from barewire.devices.sim.adxl import REBOOT_TAKES, EventList
from barewire.modbus.adu import Adu
from barewire.modbus.messages.diagnostics import ReadExceptionStatus, ReadExceptionStatusResponse
from barewire.modbus.messages.identification import ReadDeviceIdentification, ReportServerId
from barewire.modbus.messages.registers import (
    ReadHoldingRegisters,
    ReadInputRegisters,
    WriteMultipleRegisters,
    WriteSingleRegister,
)
from barewire.modbus.server.server import Server
from barewire.rtu import RtuLine, Timing, decode, encode
from barewire.tcp import TcpLine, frame as tcp_frame
from tests.devices.sim.bench import Bench


def starter(bench: Bench) -> Adxl:
    assert isinstance(bench.machine, Adxl)
    return bench.machine


def set_parameter(bench: Bench, menu: int, number: int, value: int) -> None:
    bench.write("Menu number selection", menu)
    bench.write("Parameter number selection", number)
    bench.write("Parameter value", value)


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


# The example of the manual: set P01.04 to 10 s, steps 1 to 4. The answers to 1, 2 and 3 are echoes.
STEPS = [
    ("01 06 4F FF 00 01 6E EE", True),
    ("01 06 50 01 00 04 C8 C9", True),
    ("01 06 50 03 00 0A E8 CD", True),
    ("01 06 2F 02 00 05 E0 DD", False),
]


def test_the_parameter_setting_example_byte_for_byte(bench: Bench) -> None:
    assert bench.machine.modbus is not None
    server = Server(RtuLine(Timing.of(9600, bits=10), role="server", units={1}), {1: bench.machine.modbus}, serial=True)
    starter(bench).menus.values[1, 0, 4] = 30
    for second, (frame, answered) in enumerate(STEPS):
        replies = server.feed(bytes.fromhex(frame), float(second))
        assert [reply.data.hex(" ").upper() for reply in replies] == ([frame] if answered else [])
    assert starter(bench).menus.saved[1, 0, 4] == 10
    # Rebooting: exception 06, then everything as saved.
    request = encode(1, ReadInputRegisters(0x0FB1, 2).encode())
    (busy,) = server.feed(request, 4.0)
    assert decode(busy.data) == Adu(1, bytes.fromhex("8406"))
    (answer,) = server.feed(request, 3.0 + REBOOT_TAKES)
    assert decode(answer.data) == Adu(1, bytes.fromhex("0404000000F5"))
    assert answer.data.hex(" ").upper() == "01 04 04 00 00 00 F5 3B C3"  # the manual prints this CRC


ENVELOPES: dict[str, tuple[Any, Any, bool]] = {
    "ascii": (AsciiLine, lambda pdu: ascii_frame.encode(1, pdu), True),
    "tcp": (TcpLine, lambda pdu: tcp_frame.encode(1, pdu, 0x2A), False),
}


@pytest.mark.parametrize("envelope", ENVELOPES)
def test_the_same_example_in_the_other_envelopes(bench: Bench, envelope: str) -> None:
    line, frame, serial = ENVELOPES[envelope]
    server = Server(line(), MachineUnits(bench.machine), serial=serial)
    requests = [bytes.fromhex(rtu)[1:-2] for rtu, _ in STEPS]
    replies = [
        b"".join(reply.data for reply in server.feed(frame(pdu), float(second))) for second, pdu in enumerate(requests)
    ]
    assert replies == [*map(frame, requests[:3]), b""]
    assert (
        replies[0]
        == {
            "ascii": b":01064FFF0001AA\r\n",
            "tcp": bytes.fromhex("002A 0000 0006 01 06 4FFF 0001"),
        }[envelope]
    )
    assert starter(bench).menus.saved[1, 0, 4] == 10


def test_the_procedure_for_reading_events_byte_for_byte(bench: Bench) -> None:
    """Table 4, steps 1 to 4, in the frames of RTU."""
    server = Server(
        RtuLine(Timing.of(9600, bits=10), role="server", units={1}), MachineUnits(bench.machine), serial=True
    )
    now = [1.0]

    def answer_to(pdu: str) -> str:
        now[0] += 1.0
        (reply,) = server.feed(encode(1, bytes.fromhex(pdu)), now[0])
        return decode(reply.data).pdu.hex(" ").upper()

    answer_to("06 10 01 00 01")  # start the motor: a second event
    assert answer_to("04 50 2F 00 01") == "04 02 02 02"  # 1: two are stored (MSB), the second was the last (LSB)
    assert answer_to("06 50 2F 00 00") == "06 50 2F 00 00"  # 2: the first one, number 0
    first, second = answer_to("04 50 31 00 1C"), answer_to("04 50 31 00 1C")  # 3, and 4: the next by the same step
    texts = [bytes.fromhex(answer)[2:].rstrip(b"\0 ").decode() for answer in (first, second)]
    assert texts == ["00000000 POWER ON", "00000000 MOTOR START COMMAND"]
    assert [len(bytes.fromhex(answer)) for answer in (first, second)] == [2 + 56] * 2
    assert answer_to("04 50 31 00 1C") == "84 04"  # nothing is left
    assert answer_to("06 50 2F 00 01") == "06 50 2F 00 01"  # 4: or any other event, by step 2
    assert answer_to("04 50 31 00 1C") == second
