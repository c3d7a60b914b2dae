"""The servo drive on its buses and after restarts: status word, TPDOs, addresses, saved parameters."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame
from barewire.codecs import Value
from barewire.devices.sim import MachineUnits, simulator
from tests.devices.sim.az3.az3_bench import az3_bench, drive
from tests.devices.sim.bench import Bench
from tests.devices.sim.wires import CanopenWire, ModbusWire, canopen, rtu

SAVE = 0x65766173


@pytest.fixture
def bench() -> Bench:
    return az3_bench()


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
