"""The servo drive on its two buses and after restarts: status word, TPDOs, addresses, saved parameters."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.canopen import CanFrame
from barewire.codecs import Value
from barewire.devices.cia402 import State
from barewire.devices.sim import MachineUnits, simulator
from barewire.errors import EncodeError
from barewire.modbus.messages.coils import ReadCoils, ReadDiscreteInputs, WriteMultipleCoils, WriteSingleCoil
from barewire.modbus.messages.identification import ReadDeviceIdentification, ReportServerId
from barewire.modbus.messages.registers import ReadHoldingRegisters, ReadInputRegisters, WriteSingleRegister
from tests.devices.sim.bench import Bench, az3_bench, drive, enable
from tests.devices.sim.wires import CanopenWire, ModbusWire, canopen, rtu


@pytest.fixture
def bench() -> Bench:
    return az3_bench()


def states(bench: Bench) -> list[int]:
    """Return those of the coils 80 to 89 that are on."""
    answer = bench.ask(ReadCoils(80, 10))
    assert answer is not None
    word = int.from_bytes(answer.encode()[2:], "little")
    return [80 + bit for bit in range(10) if word >> bit & 1]


def test_both_buses_show_one_value(bench: Bench) -> None:
    bench.write("TARGET VELOCITY", -250)
    assert bench.upload(0x60FF) == (-250).to_bytes(4, "little", signed=True)
    assert bench.download(0x206A, 1, bytes.fromhex("CDCC8C3F")) == 0  # 1.1, the number of the guide
    assert bench.words(40, 2) == (0xCCCD, 0x3F8C)
    assert bench.read("V REF SETPOINT") == pytest.approx(1.1)
    assert bench.download(0x6040, 0, b"\x06\x00") == 0
    assert bench.read("STATUS WORD") == 0x1231
    assert bench.upload(0x6041) == b"\x31\x12"
    assert bench.download(0x6041, 0, b"\x00\x00") == 0x0601_0002


def test_both_sdo_dialects_are_answered(bench: Bench) -> None:
    bench.write("CONTROL WORD", 0x06)
    assert bench.frames("601#4040600000000000") == ["581#4B40600006000000"]
    assert bench.frames("601#4340600000000000") == ["581#4340600006000000"]  # the example of the guide, 4.3.1
    assert bench.frames("601#234060000F000000") == ["581#6040600000000000"]


def test_each_state_has_its_coil(bench: Bench) -> None:
    seen = [states(bench)]
    for word in (0x06, 0x07, 0x0F):
        bench.write("CONTROL WORD", word)
        seen.append(states(bench))
        assert bench.upload(0x201B) == (1 << seen[-1][0] - 80).to_bytes(2, "little")
    assert seen == [[82], [83], [84], [85]]
    assert bench.refused(WriteSingleCoil(85, False)) == 2
    assert bench.refused(WriteSingleCoil(10, True)) == 2  # bit 10 of 2018h is not described
    # A write of the whole word changes only the writable bits.
    assert bench.download(0x201B, 0, b"\xff\x01") == 0
    assert states(bench) == [80, 85]


def test_coils_are_bits_of_words(bench: Bench) -> None:
    bench.ask(WriteMultipleCoils(3, (1, 0, 1)))
    assert bench.upload(0x2018) == b"\x28\x00"
    assert bench.download(0x2018, 0, b"\x10\x44") == 0  # bit 10 has no coil, and is kept
    answer = bench.ask(ReadCoils(0, 10))
    assert answer is not None
    assert answer.encode().hex(" ") == "01 02 10 00"
    assert (bench.read("TORQUE LIMIT ON"), bench.upload(0x2018)) == (True, b"\x10\x44")


def test_a_ramp_to_the_target_velocity(bench: Bench) -> None:
    enable(bench, mode=None)
    bench.now = 10.0
    bench.write("TARGET VELOCITY", 500)  # rpm, with 1000 rpm/s
    bench.now = 10.25
    assert bench.read("VELOCITY ACTUAL VALUE") == 250
    assert bench.read("STATUS WORD") == 0x0237
    ramping = float(bench.read("TORQUE ACTUAL VALUE NM"))
    bench.now = 10.5
    assert bench.read("STATUS WORD") == 0x0637
    bench.now = 11.5
    assert bench.read("POSITION ACTUAL VALUE") == round(1.25 * 500 / 60 * 8192)
    assert 0 < float(bench.read("TORQUE ACTUAL VALUE NM")) < ramping
    assert float(bench.read("RMS CURRENT")) > 0
    bench.write("CONTROL WORD", 0x02)  # a quick stop ends in switch on disabled by itself
    assert states(bench) == [86]
    bench.now = 12.1
    assert states(bench) == [82]
    assert bench.read("VELOCITY ACTUAL VALUE") == 0


def test_position_mode_and_torque_mode(bench: Bench) -> None:
    bench.write("MODES OF OPERATION", 1)
    enable(bench, mode=None)
    bench.write("TARGET POSITION", 81_920)  # ten revolutions at 1000 rpm, which is a triangle: 2 sqrt(S/A) = 1.549 s
    bench.write("CONTROL WORD", 0x1F)
    bench.now = 1.54
    assert bench.read("STATUS WORD") == 0x1237
    bench.now = 1.56
    assert (bench.read("STATUS WORD"), bench.read("POSITION ACTUAL VALUE")) == (0x1637, 81_920)
    bench.write("MODES OF OPERATION", 4)
    bench.write("TARGET TORQUE", 500)  # with 1000 ‰/s
    bench.now = 1.81
    assert bench.read("TORQUE ACTUAL VALUE") == 250
    bench.now = 5.0
    assert (bench.read("TORQUE ACTUAL VALUE"), bench.read("RMS CURRENT")) == (500, 8.0)


def test_sync_transfers_process_data(bench: Bench) -> None:
    assert bench.frames("080#") == []  # not operational yet
    assert bench.frames("000#0101") == []
    assert bench.read("NODE STATE") == 5
    for word in ("0600", "0700", "0F00"):
        assert bench.frames(f"201#{word}E8030000") == []
        before = bench.read("CONTROL WORD")
        sent = bench.frames("080#")
        assert before != bench.read("CONTROL WORD") == int(word[:2], 16)  # type 0: taken at SYNC
        assert [frame[:3] for frame in sent] == ["181", "281", "381", "481"]
    assert bench.read("TARGET VELOCITY") == 1000
    bench.now = 0.5
    first = next(frame for frame in bench.frames("080#") if frame.startswith("181"))
    assert first.startswith("181#3702F401")  # status word, 500 rpm


def test_the_heartbeat_has_its_period_and_stops(bench: Bench) -> None:
    adapter = drive(bench).canopen
    assert adapter is not None
    assert adapter.deadline == 1.0
    bench.now = 1.0
    assert bench.frames() == ["701#7F"]
    bench.write("HEART BEAT TIME", 0)
    bench.now = 5.0
    assert bench.frames() == []
    assert adapter.deadline is None
    bench.write("HEART BEAT TIME", 500)
    assert adapter.deadline == 5.0  # written over Modbus, followed on CAN
    assert bench.frames() == ["701#7F"]
    assert adapter.deadline == 5.5


def test_a_fault_is_reported_on_both_buses(bench: Bench) -> None:
    enable(bench, mode=None)
    bench.write("TARGET VELOCITY", 1000)
    bench.now = 5.0
    drive(bench).fault(0x3210, 5.0)
    assert states(bench) == [88]
    assert "081#1032050000000000" in bench.frames()
    bench.now = 6.1
    assert (states(bench), bench.read("ERROR CODE 1"), bench.upload(0x1001)) == ([87], 0x3210, b"\x05")
    assert (bench.read("ERROR REGISTER"), bench.upload(0x2069)) == (5, b"\x05\x00")  # generic, and voltage
    bench.write("RESET ERROR", True)
    assert states(bench) == [87]  # the cause is still there
    drive(bench).solve(6.2)
    bench.write("RESET ERROR", True)
    assert (states(bench), bench.read("RESET ERROR")) == ([82], False)
    assert bench.frames() == ["081#0000000000000000"]


def test_each_reset_restores_its_part(bench: Bench) -> None:
    bench.write("SPEED KP", 0.5)
    bench.write("HEART BEAT TIME", 0)
    bench.frames()
    assert bench.frames("000#8201") == ["701#00"]  # communication: 1000h to 1FFFh
    assert (bench.read("SPEED KP"), bench.read("HEART BEAT TIME")) == (0.5, 1000)
    bench.write("STORE ALL PARAMETERS", 0x65766173)
    bench.write("SPEED KP", 0.75)
    assert bench.frames("000#8101") == ["701#00"]
    assert bench.read("SPEED KP") == 0.5  # as stored
    bench.write("READY TO SWITCH ON AT STARTUP", True)
    bench.write("STORE ALL PARAMETERS", 0x65766173)
    bench.write("SOFTWARE RESET", True)
    assert drive(bench).axis.state is State.READY_TO_SWITCH_ON
    assert bench.frames() == ["701#00"]


def test_monitor_variables(bench: Bench) -> None:
    bench.write("CHANNEL_SEL_1", 5)
    bench.write("CHANNEL_SEL_2", 80)
    assert bench.words(0) == (80 << 8 | 5,)
    assert (bench.read("MONITOR VAR 1"), bench.read("MONITOR VAR 2")) == (48.0, 0.0)


def test_reset_position_sets_the_position_to_0(bench: Bench) -> None:
    enable(bench, mode=None)
    bench.write("TARGET VELOCITY", 500)
    bench.now = 2.0
    assert bench.read("POSITION ACTUAL VALUE") != 0
    bench.write("RESET POSITION", True)
    assert bench.read("POSITION ACTUAL VALUE") == 0


def test_identification(bench: Bench) -> None:
    answer = bench.ask(ReadDeviceIdentification())
    assert answer is not None
    assert answer.encode().hex(" ") == "2b 0e 01 01 00 00 03 00 03 54 45 4d 01 03 41 5a 33 02 04 31 2e 38 34"
    assert bench.refused(ReadDeviceIdentification(4, 0)) == 3


def test_refusals(bench: Bench) -> None:
    assert bench.refused(ReadDiscreteInputs(0, 1)) == 1
    assert bench.refused(ReadHoldingRegisters(0, 125)) == 3  # at most 124
    assert bench.refused(ReadInputRegisters(200, 1)) == 2
    assert bench.refused(WriteSingleRegister(197, 248)) == 3  # no such address
    assert bench.refused(WriteSingleRegister(500, 0)) == 2


def test_the_drive_can_enable_itself_at_power_on(bench: Bench) -> None:
    bench.write("OPERATION ENABLE AT STARTUP", True)
    bench.write("STORE ALL PARAMETERS", 0x65766173)
    bench.machine.power_cycle(1.0)
    bench.now = 1.0
    assert states(bench) == [85]
    assert bench.refused(ReportServerId()) == 1


@pytest.mark.parametrize(
    "arguments", [(0x3210, 1.5), (12816.0, 1), (0x12345, 1), (0x3210, 999), ("3210h", 1), (0x3210, -1)]
)
def test_an_error_that_is_no_number_of_an_emergency_is_refused_and_not_recorded(arguments: tuple[Any, Any]) -> None:
    bench = az3_bench()
    assert bench.machine.canopen is not None
    with pytest.raises(EncodeError, match="expected a whole number in"):
        bench.machine.canopen.error(*arguments)
    assert bench.frames("080#") == []
    assert bench.upload(0x1001) == b"\x00"
    bench.machine.canopen.error(0x3210, 5)
    assert bench.frames() == ["081#1032050000000000"]


SAVE = 0x65766173


# The status word through three transports


def test_the_status_word_is_the_same_through_rtu_sdo_and_tpdo1() -> None:
    over_rtu, over_can = rtu("az3"), canopen("az3")
    assert isinstance(over_rtu, ModbusWire)
    assert isinstance(over_can, CanopenWire)
    # Both use one machine, that of the RTU server.
    over_can.machine = over_rtu.machine
    adapter, find = over_rtu.machine.canopen, over_rtu.machine.device.find
    assert adapter is not None
    adapter.feed(CanFrame.parse("000#0101"), 0.0)
    seen = []
    for word, target in ((0, 0), (6, 0), (7, 0), (15, 0), (15, 500), (15, 500), (2, 500), (0x80, 0)):
        over_rtu.write({find("CONTROL WORD"): word, find("TARGET VELOCITY"): target})
        over_rtu.now += 0.3
        over_can.now = over_rtu.now
        words: list[Value] = [over_can.read(find("STATUS WORD"))]
        (tpdo1,) = [sent for sent in adapter.feed(CanFrame.parse("080#"), over_rtu.now) if sent.id == 0x181]
        words.append(int.from_bytes(tpdo1.data[:2], "little"))
        words.append(over_rtu.read(find("STATUS WORD")))
        assert len(set(words)) == 1, words
        seen.append(words[0])
    assert seen == [0x1270, 0x1231, 0x1233, 0x1637, 0x0237, 0x0637, 0x0217, 0x1270]


def test_a_tpdo_of_type_255_is_sent_on_change(bench: Bench) -> None:
    assert bench.download(0x1800, 1, (0x8000_0181).to_bytes(4, "little")) == 0
    assert bench.download(0x1800, 2, b"\xff") == 0
    assert bench.download(0x1800, 3, (500).to_bytes(2, "little")) == 0  # 50 ms of inhibit time
    assert bench.download(0x1800, 1, (0x181).to_bytes(4, "little")) == 0
    first = bench.frames("000#0101")
    assert [frame[:3] for frame in first if frame.startswith("18")] in ([], ["181"])
    bench.now = 1.0
    bench.frames()
    bench.write("CONTROL WORD", 6)
    assert [frame for frame in bench.frames() if frame.startswith("181")] == ["181#3112000000000000"]
    bench.now = 1.01
    bench.write("CONTROL WORD", 7)
    assert [frame for frame in bench.frames() if frame.startswith("181")] == []  # inhibited
    bench.now = 1.05
    assert [frame for frame in bench.frames() if frame.startswith("181")] == ["181#3312000000000000"]
    bench.now = 1.3
    assert [frame for frame in bench.frames() if frame.startswith("181")] == []  # nothing changed


def test_a_missing_heartbeat_of_the_master_is_detected(bench: Bench) -> None:
    # As delivered the drive watches nodes 1 and 2 for 3 s, from their first heartbeat on.
    assert bench.frames("702#05") == []
    bench.now = 2.9
    assert [frame for frame in bench.frames() if frame.startswith("081")] == []
    bench.now = 3.1
    assert [frame[:11] for frame in bench.frames() if frame.startswith("081")] == ["081#3081110"[:11]]


# Resets


def test_a_new_node_id_takes_effect_at_the_next_reset(bench: Bench) -> None:
    bench.write("BOOT CAN NODE", 9)
    assert bench.upload(0x200D) == b"\x01"
    assert bench.frames("000#8201") == ["709#00"]  # reset communication: settings without an object are kept
    assert bench.upload_at(9, 0x200D) == b"\x09"
    assert bench.upload_at(9, 0x1800, 1) == (0x189).to_bytes(4, "little")
    assert bench.frames("601#4041600000000000") == []
    assert bench.frames("000#8109") == ["701#00"]  # reset node: unsaved values are lost
    bench.write("BOOT CAN NODE", 127)
    bench.write("STORE ALL PARAMETERS", SAVE)
    assert bench.frames("000#8101") == ["77F#00"]
    bench.write("SOFTWARE RESET", True)
    assert bench.frames() == ["77F#00"]


def test_a_drive_without_node_id_is_silent_on_can_and_answers_on_modbus(bench: Bench) -> None:
    bench.write("BOOT CAN NODE", 0)
    assert bench.frames("000#8200") == []
    bench.now = 5.0
    assert bench.frames("080#") == []
    assert bench.read("BOOT CAN NODE READ ONLY") == 0
    bench.write("SOFTWARE RESET", True)
    assert bench.frames() == ["701#00"]


def test_a_new_bit_rate_takes_effect_at_the_next_reset(bench: Bench) -> None:
    adapter = drive(bench).canopen
    assert adapter is not None
    adapter.bus_bitrate = 125_000
    assert bench.download(0x2068, 0, b"\x07\x00") == 0
    assert (bench.read("CAN BIT RATE"), bench.read("CAN BITRATE INDEX"), adapter.bitrate) == (7, 5, 125_000)
    assert bench.frames("000#8201") == []  # it now uses another bit rate than this bus
    assert (bench.read("CAN BITRATE INDEX"), adapter.bitrate, adapter.deadline) == (7, 500_000, None)
    bench.now = 3.0
    assert bench.frames("601#4041600000000000") == []
    adapter.bus_bitrate = 500_000  # a bus of the new bit rate
    assert "701#7F" in bench.frames()
    bench.write("CAN BIT RATE", 200)
    bench.write("STORE ALL PARAMETERS", SAVE)
    bench.machine.power_cycle(4.0)
    assert (adapter.bitrate, bench.read("CAN BITRATE INDEX")) == (125_000, 5)  # the guide has no rate with number 200


def test_node_bit_rate_and_unit_at_delivery() -> None:
    machine = simulator("az3", node=5, bitrate=1_000_000, unit=3)
    assert [machine.store[name] for name in ("BOOT CAN NODE", "CAN BIT RATE", "MODBUS ADDRESS")] == [5, 9, 3]
    assert list(MachineUnits(machine)) == [3]
    machine.power_cycle(1.0)
    assert list(MachineUnits(machine)) == [3]
    assert machine.canopen is not None
    assert (machine.canopen.bitrate, machine.canopen.node.node) == (1_000_000, 5)


def test_a_new_modbus_address_takes_effect_at_the_next_reset() -> None:
    wire = rtu("az3")
    find = wire.machine.device.find
    wire.write({find("MODBUS ADDRESS"): 17, find("STORE ALL PARAMETERS"): SAVE})
    assert wire.read(find("BOOT MODBUS NODE")) == 1
    wire.write({find("SOFTWARE RESET"): True})
    assert wire.machine.address == 17
    assert wire.read(find("MODBUS ADDRESS")) == 17  # requested at the new address


# What is kept


def test_pdo_records_are_saved_with_the_rest(bench: Bench) -> None:
    def remap() -> None:
        assert bench.download(0x1803, 1, (0x8000_0481).to_bytes(4, "little")) == 0
        assert bench.download(0x1803, 2, b"\xfe") == 0
        assert bench.download(0x1A03, 0, b"\x00") == 0
        assert bench.download(0x1A03, 1, (0x6064_0020).to_bytes(4, "little")) == 0
        assert bench.download(0x1A03, 0, b"\x01") == 0
        assert bench.download(0x1803, 1, (0x481).to_bytes(4, "little")) == 0

    def mapped() -> tuple[bytes | int, ...]:
        return bench.upload(0x1803, 2), bench.upload(0x1A03, 0), bench.upload(0x1A03, 1)

    as_delivered, changed = mapped(), (b"\xfe", b"\x01", (0x6064_0020).to_bytes(4, "little"))
    remap()
    bench.machine.power_cycle(1.0)
    bench.frames()
    assert mapped() == as_delivered
    remap()
    assert bench.download(0x1010, 1, b"save") == 0
    bench.machine.power_cycle(2.0)
    assert bench.frames() == ["701#00"]
    assert mapped() == changed
    # The COB-ID as delivered was not saved as a number: it follows the node-ID.
    bench.write("BOOT CAN NODE", 4)
    assert bench.frames("000#8201") == ["704#00"]
    assert bench.upload_at(4, 0x1803, 1) == (0x484).to_bytes(4, "little")
    assert bench.upload_at(4, 0x1A03, 1) == changed[2]
    bench.write("EEPROM PARAMETERS CLEANING", True)
    bench.machine.power_cycle(3.0)
    bench.frames()
    assert mapped() == as_delivered


def test_each_cleaning_deletes_its_part(bench: Bench) -> None:
    bench.write("SPEED KP", 0.5)
    bench.write("STORE ALL PARAMETERS", SAVE)
    drive(bench).fault(0x5441, 0.0)
    drive(bench).solve(0.0)
    bench.machine.power_cycle(1.0)
    assert (bench.read("SPEED KP"), bench.read("ERROR CODE 1")) == (0.5, 0x5441)  # the log survives the power-off
    bench.write("EEPROM DIAGNOSTIC LOG CLEANING", True)
    assert (bench.read("SPEED KP"), bench.read("ERROR CODE 1")) == (0.5, 0)
    bench.write("EEPROM TOTAL CLEANING", True)
    assert bench.read("EEPROM TOTAL CLEANING") is False
    assert bench.read("SPEED KP") == 0.5
    bench.machine.power_cycle(2.0)
    assert bench.read("SPEED KP") == pytest.approx(0.001)


def test_only_the_signature_stores_the_parameters() -> None:
    """CiA 301, object 1010h: with a wrong signature the device refuses to store, abort code 0800 0020h."""
    bench = az3_bench()
    bench.write("TARGET TORQUE", 5)
    for word in (0, 1, 0x65766172, 0xFFFF_FFFF):
        assert bench.download(0x1010, 1, word.to_bytes(4, "little")) == 0x0800_0020
        assert bench.refused(bench.writes("STORE ALL PARAMETERS", word)) == 3
    assert bench.machine.store.saved == {}
    assert bench.download(0x1010, 1, b"save") == 0
    assert bench.machine.store.saved != {}
