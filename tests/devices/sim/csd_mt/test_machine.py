"""The stepper drive: states, the printed status words, faults; the S4 with its inputs of table 21 and Safe Torque Off.

Its environment: set by text; and random ones, in which reading the drive changes nothing.
"""

from __future__ import annotations

from math import inf

import pytest
from hypothesis import given, settings, strategies as st

from barewire.devices.cia402 import State
from barewire.devices.sim import simulator
from barewire.devices.sim.csd_mt.environment import Span
from barewire.errors import EncodeError
from barewire.modbus.messages.registers import (
    ReadInputRegisters,
    WriteMultipleRegisters,
    WriteSingleRegister,
)
from barewire.modbus.server.server import Server
from barewire.tcp import TcpLine
from tests.devices.sim.bench import HOMING, STATUS, VELOCITY, CsdBench


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


@pytest.fixture
def s4() -> CsdBench:
    bench = CsdBench()
    bench.drive.environment.model = "S4"
    return bench


@pytest.mark.parametrize(
    ("config", "first", "second"),
    [
        (0x05, "negative limit", "touch probe"),
        (0x06, "proximity", "touch probe"),
        (0x07, "", "touch probe"),
        (0x09, "negative limit", "positive limit"),
        (0x0A, "proximity", "positive limit"),
        (0x0B, "", "positive limit"),
        (0x0D, "negative limit", ""),
        (0x0E, "proximity", ""),
        (0x0F, "", ""),
    ],
)
def test_the_two_inputs_have_the_meanings_of_table_21(s4: CsdBench, config: int, first: str, second: str) -> None:
    s4.drive.environment.inputs = [True, True, True, True, True]
    s4.put(Input_Config=config, Touch_Probe_Function=0x11)
    bits = {"negative limit": 1, "positive limit": 2, "proximity": 4}
    word = bits.get(first, 0) | bits.get(second, 0)
    assert s4.read("Digital Input") == 0b11 << 16 | word
    assert bool(int(s4.read("Touch Probe Status")) & 0x80) is (second == "touch probe")
    s4.drive.environment.inputs = [False, False, False, False, False]
    limited = "limit" in first + second
    assert s4.status() == ("0A70" if limited else "0270")


def test_an_s4_has_three_outputs(s4: CsdBench) -> None:
    s4.put(Output_Config=0x1F, Set_Output=0b11111)
    assert s4.read("Digital Output") == 0b111 << 16


def test_safe_torque_off_takes_the_current_without_an_error(s4: CsdBench) -> None:
    s4.put(Input_Config=0x8F, Target_Position=100_000)
    s4.enable()
    s4.now = 1.0
    s4.control(0x1F)
    s4.status(2.0)
    s4.drive.environment.sto = (False, True)  # one input without voltage is enough
    assert s4.status(2.5) == "0270"
    assert s4.read("Digital Input") == 1 << 24
    assert not s4.drive.shaft.has_current
    s4.control(0x06, 0x0F)
    assert s4.status(4.0) == "0233"  # no current is allowed
    s4.drive.environment.sto = (False, False)
    s4.drive.environment.sto = (True, True)
    s4.control(0x07, 0x0F)
    assert s4.status(5.0) == "0637"
    assert s4.read("Digital Input") == 0


def test_only_the_s4_has_safe_torque_off() -> None:
    bench = CsdBench()
    bench.drive.environment.sto = (False, False)
    bench.enable()
    assert bench.drive.shaft.has_current


def test_the_environment_is_set_by_text() -> None:
    drive = simulator("csd-mt")
    environment = drive.environment
    for text in ("I1=-5000:", "i2=:9000", "I4=ON", "walls = -100:100", "encoder=4000", "friction=5", "index=1.5"):
        drive.set_environment(text)
    assert environment.inputs[1:] == [Span(-5000.0, inf), Span(-inf, 9000.0), False, True]
    assert (environment.walls, environment.encoder, environment.friction, environment.index) == (
        Span(-100.0, 100.0),
        4000,
        5.0,
        1.5,
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("I5=on", "expected NAME=VALUE with a name of I0, I1, I2, I3, I4, walls, pull-out"),
        ("walls", "expected LOW:HIGH, the lower one first, behind =, found ''"),
        ("I0=maybe", "expected on, off, or LOW:HIGH for a switch behind =, found 'maybe'"),
        ("I0=5:1", "expected on, off, or LOW:HIGH for a switch behind =, found '5:1'"),
        ("I0=a:1", "expected on, off, or LOW:HIGH for a switch behind =, found 'a:1'"),
        ("volts=nan", "expected a number behind ="),
        ("encoder=inf", "expected a whole number from 0 behind ="),
        ("model=95", "expected 94 or S4 behind ="),
    ],
)
def test_an_environment_setting_with_an_error_is_refused(text: str, message: str) -> None:
    with pytest.raises(EncodeError, match=message):
        simulator("csd-mt").set_environment(text)


def test_the_environment_can_switch_the_power_section_off() -> None:
    bench = CsdBench()
    bench.drive.set_environment("volts=0")
    assert bench.control(0x06, 0x07) == "0221"


# Random environments with random writes

PLACES = st.sampled_from([-inf, -40_000.0, -3.0, 0.0, 8.0, 500.0, 12_800.0, 30_000.0, inf])
WALLS = st.builds(Span, st.sampled_from([-inf, -40_000.0, -3.0]), st.sampled_from([inf, 30_000.0, 8.0]))
WIRES = st.booleans() | st.builds(Span, PLACES, PLACES)
CONTROLS = [0x00, 0x02, 0x06, 0x07, 0x0F, 0x1F, 0x2F, 0x3F, 0x5F, 0x80, 0x10F]
WORDS = st.one_of(
    st.tuples(st.just(1040), st.sampled_from(CONTROLS)),
    st.tuples(st.just(1041), st.sampled_from([1, 3, 6])),
    st.tuples(st.just(1050), st.sampled_from([3, 4, 5, 6, 19, 20, 21, 22, 35, 0xFFFE, 0xFFFF])),
    st.tuples(st.just(1066), st.sampled_from([0, 0x11, 0x15, 0x21, 0x25])),
    st.tuples(st.just(1067), st.sampled_from([0, 1, 2, 0x31, 7])),
    st.tuples(st.just(1085), st.sampled_from([0, 1, 2, 17])),
    st.tuples(st.just(1086), st.sampled_from([0, 1, 2])),
    st.tuples(st.just(1088), st.integers(0, 31)),
    st.tuples(st.just(1089), st.sampled_from([0x1B, 0x27])),
    st.tuples(st.sampled_from([1092, 1108, 1114]), st.integers(0, 1)),
    st.tuples(st.just(1097), st.sampled_from([0, 0, 0, 5000])),
)
PAIRS = st.one_of(
    st.tuples(st.just(1042), st.sampled_from([0, 5, 30_000, 200_000, 0xFFFF_0000])),
    st.tuples(st.just(1044), st.sampled_from([0, 3000, 24_000, 300_000])),
    st.tuples(st.just(1048), st.sampled_from([0, 3000, 100_000, 0xFFFF_0000])),
    st.tuples(st.just(1054), st.sampled_from([0, 1600])),
)
SLIPS = st.tuples(st.just(0), st.sampled_from([-5000, -100, 70, 300]))
STEPS = st.lists(st.tuples(WORDS | PAIRS | SLIPS, st.sampled_from([0.0, 0.01, 0.3, 2.0, 1000.0])), max_size=15)


def enabled(inputs: list[Span | bool], walls: Span, pull_out: float, encoder: int) -> CsdBench:
    bench = CsdBench()
    environment = bench.drive.environment
    environment.inputs, environment.walls = list(inputs), walls
    environment.pull_out, environment.encoder = pull_out, encoder
    bench.write("Homing Speed During Search for Zero", 3200)
    bench.enable()
    return bench


def carry_out(bench: CsdBench, steps: list[tuple[tuple[int, int], float]], ticks: int) -> list[object]:
    """Return the observable registers after every step, with `ticks` more ticks in every pause."""
    seen: list[object] = []
    for (address, value), pause in steps:
        if address == 0:
            bench.drive.slip(value, bench.now)
        elif address in (1042, 1044, 1048, 1054):
            bench.refused(WriteMultipleRegisters(address, (value & 0xFFFF, value >> 16)))
        else:
            bench.refused(WriteSingleRegister(address, value))
        began = bench.now
        for tick in range(ticks):
            bench.drive.tick(began + pause * tick / ticks)
        bench.now = began + pause
        bench.drive.tick(bench.now)
        seen.append((bench.words(1001)[0], bench.words(1007), bench.words(1014, 4), bench.words(1008, 2)))
        seen.append(round(bench.drive.shaft.position(bench.now) / 4))
    return seen


@settings(max_examples=40)
@given(
    st.lists(WIRES, min_size=5, max_size=5),
    WALLS,
    st.sampled_from([inf, inf, 20_000.0]),
    st.sampled_from([400, 400, 4000, 0]),
    STEPS,
)
def test_reading_often_changes_nothing(
    inputs: list[Span | bool],
    walls: Span,
    pull_out: float,
    encoder: int,
    steps: list[tuple[tuple[int, int], float]],
) -> None:
    rare = carry_out(enabled(inputs, walls, pull_out, encoder), steps, 0)
    often = carry_out(enabled(inputs, walls, pull_out, encoder), steps, 3)
    assert rare == often
