"""The stepper drive: states, the printed status words, faults."""

from __future__ import annotations

import pytest

from barewire.devices.cia402 import State
from barewire.modbus.messages.registers import (
    ReadInputRegisters,
    WriteMultipleRegisters,
    WriteSingleRegister,
)
from barewire.modbus.server.server import Server
from barewire.tcp import TcpLine
from tests.devices.sim.csd_mt.csd_mt_bench import HOMING, STATUS, VELOCITY, CsdBench


@pytest.fixture
def bench() -> CsdBench:
    return CsdBench()


def test_the_enable_sequence_shows_the_printed_status_words(bench: CsdBench) -> None:
    assert bench.status() == "0270"
    bench.drive.supply(False, 0.0)
    assert bench.control(0x06) == "0221"  # no high voltage
    assert bench.control(0x07) == "0221"
    bench.drive.supply(True, 1.0)
    assert bench.status(1.4) == "0231"
    assert bench.control(0x07) == "0231"  # not yet 500 ms
    bench.now = 1.5
    assert bench.control(0x07) == "0233"
    assert bench.control(0x0F) == "0233"  # the current comes with a delay (register 1096)
    assert bench.status(1.72) == "0233"
    assert bench.status(1.74) == "0637"
    assert bench.control(0x06, 0x0F) == "0233"  # "the direct sequence can be done"
    assert bench.status(2.0) == "0637"
    assert bench.control(0x02) == "0617"  # quick stop: it stays there
    assert bench.status(10.0) == "0617"
    assert bench.control(0x0F) == "0637"  # transition 16, the current was on
    assert bench.control(0x00) == "0270"


@pytest.mark.parametrize(("mode", "words"), [(VELOCITY, ["1231", "1233", "1637"]), (HOMING, ["0231", "0233", "0637"])])
def test_status_words_of_the_other_modes(bench: CsdBench, mode: int, words: list[str]) -> None:
    bench.write("Mode of Operation", mode)
    assert [bench.control(word) for word in (0x06, 0x07)] == words[:2]
    bench.control(0x0F)
    assert bench.status(1.0) == words[2]
    assert bench.read("Mode of Operation Display") == mode


def test_enabling_with_a_target_velocity_shows_1237(bench: CsdBench) -> None:
    """The third word that the manual prints: zero speed, not the target velocity."""
    bench.put(Target_Velocity=100_000, Profile_Acceleration=2000)
    bench.enable(VELOCITY)
    assert bench.status() == "1237"


def test_the_enable_sequence_over_modbus_tcp(bench: CsdBench) -> None:
    assert bench.machine.modbus is not None
    server = Server(TcpLine(), {1: bench.machine.modbus}, serial=False)
    replies = []
    for number, (word, now) in enumerate([(0x06, 1.0), (0x07, 2.0), (0x0F, 3.0)]):
        write = bytes.fromhex(f"{2 * number:04x} 0000 0006 01 06 0410 {word:04x}")
        assert [reply.data for reply in server.feed(write, now)] == [write]
        read = bytes.fromhex(f"{2 * number + 1:04x} 0000 0006 01 03 03e9 0001")
        replies += [reply.data.hex(" ") for reply in server.feed(read, now + 0.5)]
    assert replies == [
        "00 01 00 00 00 05 01 03 02 02 31",
        "00 03 00 00 00 05 01 03 02 02 33",
        "00 05 00 00 00 05 01 03 02 06 37",
    ]


TO: dict[State, tuple[int, ...]] = {
    State.SWITCH_ON_DISABLED: (),
    State.READY_TO_SWITCH_ON: (0x06,),
    State.SWITCHED_ON: (0x06, 0x07),
    State.OPERATION_ENABLED: (0x06, 0x0F),
    State.QUICK_STOP_ACTIVE: (0x06, 0x0F, 0x02),
    State.FAULT: (),
}
COMMANDS = {
    "shutdown": 0x06,
    "switch on": 0x07,
    "enable": 0x0F,
    "disable voltage": 0x00,
    "quick stop": 0x02,
    "reset": 0x80,
}
TABLE_11 = {  # state: where each command leads; what is not listed leaves the state as it is
    State.SWITCH_ON_DISABLED: {"shutdown": State.READY_TO_SWITCH_ON},
    State.READY_TO_SWITCH_ON: {
        "switch on": State.SWITCHED_ON,
        "enable": State.OPERATION_ENABLED,
        "disable voltage": State.SWITCH_ON_DISABLED,
        "quick stop": State.SWITCH_ON_DISABLED,
    },
    State.SWITCHED_ON: {
        "shutdown": State.READY_TO_SWITCH_ON,
        "enable": State.OPERATION_ENABLED,
        "disable voltage": State.SWITCH_ON_DISABLED,
        "quick stop": State.SWITCH_ON_DISABLED,
    },
    State.OPERATION_ENABLED: {
        "shutdown": State.READY_TO_SWITCH_ON,
        "switch on": State.SWITCHED_ON,
        "disable voltage": State.SWITCH_ON_DISABLED,
        "quick stop": State.QUICK_STOP_ACTIVE,
    },
    State.QUICK_STOP_ACTIVE: {"disable voltage": State.SWITCH_ON_DISABLED, "enable": State.OPERATION_ENABLED},
    State.FAULT: {"reset": State.SWITCH_ON_DISABLED},
}
TABLE_12 = {
    State.SWITCH_ON_DISABLED: 0b110_0000,
    State.READY_TO_SWITCH_ON: 0b010_0001,
    State.SWITCHED_ON: 0b010_0011,
    State.OPERATION_ENABLED: 0b010_0111,
    State.QUICK_STOP_ACTIVE: 0b000_0111,
    State.FAULT: 0b000_1000,
}


@pytest.mark.parametrize("state", TO, ids=lambda state: state.value)
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_in_every_state_leads_to_the_state_in_table_11(
    bench: CsdBench, state: State, command: str
) -> None:
    """Tables 11 and 12."""
    for word in TO[state]:
        bench.control(word)
        bench.now += 0.3
    if state is State.FAULT:
        bench.drive.fault(0x2130, bench.now)
        bench.drive.solve(bench.now)
    bench.status()
    assert bench.drive.axis.state is state
    bench.control(COMMANDS[command])
    bench.now += 0.3
    after = TABLE_11[state].get(command, state)
    word = bench.words(STATUS)[0]
    assert (bench.drive.axis.state, word & 0b110_1111) == (after, TABLE_12[after])


def test_current_and_brake_switch_with_their_delays(bench: CsdBench) -> None:
    bench.put(Output_Config=0x27, Brake_Delay_Current_ON=200, Brake_Delay_Unlock=50, Brake_Delay_Azio_Ready=120)
    bench.put(Brake_Delay_Lock=300)

    def seen(now: float) -> tuple[bool, bool, str]:
        word = bench.status(now)
        brake = bench.words(1010, 2)[0] & 1
        assert (bench.words(1010, 2)[1] >> 1 & 1) == brake  # O1, and bit 0
        return bench.drive.shaft.has_current, bool(brake), word

    bench.control(0x06, 0x0F)
    assert seen(0.19) == (False, False, "0233")
    assert seen(0.21) == (True, False, "0233")
    assert seen(0.26) == (True, True, "0233")
    assert seen(0.33) == (True, True, "0637")
    bench.control(0x07)  # transition 5: the brake first
    assert seen(0.62) == (True, False, "0637")
    assert seen(0.64) == (False, False, "0233")
    # Another command replaces one that is still being carried out.
    bench.control(0x0F)
    bench.now = 0.9
    assert bench.control(0x06) == "0231"
    assert seen(5.0) == (False, False, "0231")
    bench.control(0x0F)
    assert seen(6.0) == (True, True, "0637")
    bench.control(0x07)
    bench.now = 6.2
    bench.control(0x0F)
    assert seen(9.0) == (True, True, "0637")
    # "ON in Operation Enabled state only"
    bench.control(0x02)
    assert seen(9.1) == (True, False, "0617")


def test_a_motion_waits_until_the_drive_is_ready(bench: CsdBench) -> None:
    bench.put(Mode_of_Operation=1, Target_Position=5000)
    bench.control(0x06, 0x07, 0x0F, 0x1F)
    assert bench.status(1.0) == "0637"  # the edge of bit 4 came too early
    bench.control(0x0F, 0x1F)
    bench.settle()
    assert bench.position() == 5000


def test_the_mode_changes_in_four_states_only(bench: CsdBench) -> None:
    bench.enable(VELOCITY)
    bench.control(0x02)
    bench.write("Mode of Operation", 1)
    assert bench.read("Mode of Operation Display") == 3  # not in quick stop active
    bench.control(0x0F)
    assert bench.read("Mode of Operation Display") == 1


def test_a_32_bit_value_takes_effect_with_its_second_word(bench: CsdBench) -> None:
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


# Faults


def test_a_fault_needs_its_cause_gone_and_a_reset(bench: CsdBench) -> None:
    bench.enable()
    bench.drive.fault(0x2130, 65.0)
    bench.now = 65.0
    assert (bench.status(), bench.read("Error Code"), bench.read("Error Register")) == ("0218", 0x2130, 1)
    assert (bench.read("Drive Alarm Time 0"), bench.read("Drive Alarm Code 0")) == (65, 0x2130)
    assert bench.control(0x80) == "0218"  # the cause is still there
    bench.drive.solve(66.0)
    assert bench.control(0x80) == "0218"  # no rising edge
    assert bench.control(0x00, 0x80) == "0270"
    assert (bench.read("Error Code"), bench.read("Error Register")) == (0, 0)
    bench.drive.supply(False, 70.0)
    bench.now = 70.0
    bench.control(0x06, 0x07, 0x0F)
    assert bench.drive.axis.state is State.READY_TO_SWITCH_ON
    bench.write("Reset Error Logs", 1)
    assert bench.read("Drive Alarm Code 0") == 0


def test_the_log_has_ten_alarms_the_newest_first(bench: CsdBench) -> None:
    bench.status(0.0)
    for second in range(1, 13):
        bench.drive.fault(0x2130 if second % 2 else 0x8400, float(second))
    bench.now = 20.0
    log = bench.words(1220, 20)
    assert log[::2] == tuple(range(12, 2, -1))
    assert log[1:5:2] == (0x8400, 0x2130)
    bench.machine.power_cycle(21.0)  # the memory stays
    bench.now = 21.0
    assert bench.words(1220, 20) == log


def test_a_following_error_brakes_first(bench: CsdBench) -> None:
    bench.enable(VELOCITY)
    bench.write("Target Velocity", 64_000)
    assert bench.status(10.0) == "0637"
    bench.drive.fault(0x8611, 10.0)
    assert bench.status(10.05) == "201F"
    assert bench.status(10.5) == "1218"
    bench.drive.fault(0x8611, 11.0)  # in a fault already: another line of the log
    assert bench.status(11.0) == "1218"


@pytest.mark.parametrize("volts", [0.0, 20.0, 53.0])
def test_a_power_failure_in_motion_is_a_fault(bench: CsdBench, volts: float) -> None:
    bench.enable()
    bench.drive.voltage(volts, 1.0)
    bench.now = 1.0
    assert (bench.status(), bench.read("Error Code")) == ("0208", 0x5100)
    bench.drive.voltage(24.0, 2.0)
    assert bench.read("Error Code") == 0
    assert bench.control(0x80) == "0270"


def test_a_power_failure_without_current_is_no_fault(bench: CsdBench) -> None:
    bench.control(0x06)
    bench.drive.supply(False, 1.0)  # "drive power supply can be disconnected" (transition 6)
    assert bench.status(1.0) == "0221"


def test_the_watchdog_acts_when_no_message_comes(bench: CsdBench) -> None:
    assert bench.refused(WriteSingleRegister(1097, 99)) == 3
    bench.write("Counter Watchdog", 500)
    bench.control(0x06, 0x0F)
    assert bench.status(0.4) == "0637"
    assert bench.status(0.8) == "0637"
    assert bench.status(2.0) == "0218"
    assert (bench.read("Drive Alarm Time 0"), bench.read("Error Code")) == (1, 0)  # at 1.3 s, not at 2
    assert len(bench.drive.context.alarms.entries) == 1
    assert bench.control(0x00, 0x80) == "0270"
    assert bench.status(3.0) == "0218"  # in every state
