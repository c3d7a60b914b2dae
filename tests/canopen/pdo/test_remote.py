"""The PDOs of another device: their configuration, read and written by SDO in the safe order, and their values."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    CanFrame,
    Channel,
    Entry,
    LocalNode,
    ObjectDictionary,
    PdoConfig,
    PdoConfigPolicy,
    SdoAbort,
    SdoServer,
    mapping_of,
    pdos_of,
    read_pdo,
    write_pdo,
)
from barewire.canopen.pdo.remote import PdoConsumer, RemotePdo, remote_pdo
from barewire.errors import DecodeError, EncodeError
from tests.canopen.sdo.sdo_bus import Bus, Store
from tests.canopen.virtual_bus import VirtualBus
from tests.helpers import every_case

TPDO1 = PdoConfig("TPDO", 1, (0x60410010, 0x60640020), type=1, inhibit=10, event_timer=500, sync_start=3)


def bus_with(*pdos: PdoConfig) -> tuple[VirtualBus, LocalNode]:
    objects = [
        Entry(0x6040, 0, "controlword", "u16", "rw", 0),
        Entry(0x6041, 0, "statusword", "u16", "ro", 0x0637),
        Entry(0x6064, 0, "position", "i32", "ro", -2),
    ]
    bus, device = VirtualBus(), LocalNode(5, ObjectDictionary(objects), pdos)
    bus.add(device, sent=device.start(0.0))
    bus.pass_time(0.01)
    return bus, device


def writes(bus: VirtualBus) -> list[str]:
    """Return the objects written, in order, as `1800:1=80000185`."""
    found = []
    for _, text in bus.log:
        frame = CanFrame.parse(text)
        if frame.id == 0x605 and frame.data[0] in (0x23, 0x2B, 0x2F):
            index, value = int.from_bytes(frame.data[1:3], "little"), int.from_bytes(frame.data[4:], "little")
            found.append(f"{index:X}:{frame.data[3]}={value:X}")
    return found


def test_a_written_configuration_is_read_back() -> None:
    bus, _ = bus_with(PdoConfig("TPDO", 1, ()), PdoConfig("RPDO", 1, (0x60400010,)))
    bus.run(write_pdo(5, TPDO1))
    read = bus.run(read_pdo(5, "TPDO", 1))
    assert read == PdoConfig("TPDO", 1, TPDO1.mapping, type=1, cob_id=0x185, inhibit=10, event_timer=500, sync_start=3)
    assert bus.run(read_pdo(5, "RPDO", 1)).cob_id == 0x205
    bus.inject("000#0105", bus.now)
    bus.inject("080#03", bus.now)
    assert "185#3706FEFFFFFF" in bus.pass_time(0.1)


def test_the_writes_are_in_the_safe_order() -> None:
    bus, _ = bus_with(PdoConfig("TPDO", 1, (0x60410010,), cob_id=0x195))
    bus.run(write_pdo(5, TPDO1))
    mapping = ["1A00:0=0", "1A00:1=60410010", "1A00:2=60640020", "1A00:0=2"]
    parameters = ["1800:2=1", "1800:3=A", "1800:5=1F4", "1800:6=3"]
    assert writes(bus) == ["1800:1=80000195", *mapping, *parameters, "1800:1=185"]
    bus.log.clear()
    bus.run(write_pdo(5, TPDO1, policy=PdoConfigPolicy(order="first")))
    assert writes(bus) == ["1800:1=80000185", *parameters, *mapping, "1800:1=185"]


def test_skip_equal_does_not_write_equal_values() -> None:
    bus, _ = bus_with(TPDO1)
    bus.run(write_pdo(5, TPDO1, policy=PdoConfigPolicy(skip_equal=True)))
    assert writes(bus) == ["1800:1=80000185", "1800:1=185"]


class Locked:
    """A device whose mapping is constant and whose record ends at the transmission type."""

    deadline = None

    def __init__(self) -> None:
        self.objects = ObjectDictionary(
            [
                Entry(0x1800, 1, "COB-ID", "u32", "rw", 0x185),
                Entry(0x1800, 2, "type", "u8", "rw", 255),
                Entry(0x1A00, 0, "entries", "u8", "const", 1),
                Entry(0x1A00, 1, "entry", "u32", "const", 0x60410010),
                Entry(0x1A01, 0, "entries", "u8", "const", 255),
                Entry(0x1801, 1, "COB-ID", "u32", "rw", 0x285),
                Entry(0x1801, 2, "type", "u8", "rw", 255),
            ]
        )
        self.server = SdoServer(5, self.objects)

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        return self.server.feed(frame, now)


@pytest.mark.parametrize(
    "policy", [PdoConfigPolicy(), PdoConfigPolicy(mapping="fixed"), PdoConfigPolicy(skip_equal=True)]
)
def test_a_constant_mapping_is_compared(policy: PdoConfigPolicy) -> None:
    bus, device = VirtualBus(), Locked()
    bus.add(device)
    bus.run(write_pdo(5, PdoConfig("TPDO", 1, (0x60410010,), type=1), policy=policy))
    assert (device.objects.get(0x1800, 1), device.objects.get(0x1800, 2)) == (0x185, 1)
    assert bus.run(read_pdo(5, "TPDO", 1)).event_timer == 0
    with pytest.raises(EncodeError, match="TPDO1 maps 60410010 and cannot be changed; expected nothing") as caught:
        bus.run(write_pdo(5, PdoConfig("TPDO", 1, ()), policy=policy))
    assert caught.value.__notes__ == ["TPDO1 of node 5 is left switched off"]
    assert device.objects.get(0x1800, 1) == 0x80000185


def test_a_missing_sub_index_raises_if_its_value_is_not_0() -> None:
    bus, device = VirtualBus(), Locked()
    bus.add(device)
    with pytest.raises(SdoAbort, match="1800h:05: 0609 0011h"):
        bus.run(write_pdo(5, PdoConfig("TPDO", 1, (0x60410010,), event_timer=100)))
    with pytest.raises(SdoAbort, match="0601 0002h"):
        bus.run(write_pdo(5, PdoConfig("TPDO", 1, (0x60410010,)), policy=PdoConfigPolicy(mapping="variable")))
    with pytest.raises(SdoAbort):
        bus.run(read_pdo(5, "RPDO", 1))
    assert bus.run(read_pdo(5, "TPDO", 2)).multiplexed == "DAM"
    device.objects.set(0x1A01, 0, 65)
    with pytest.raises(DecodeError, match="1A01h:00 = 65: expected"):
        bus.run(read_pdo(5, "TPDO", 2))


def test_an_impossible_mapping_raises_before_anything_is_sent() -> None:
    bus, _ = bus_with(TPDO1)
    with pytest.raises(EncodeError, match="80 bits"):
        bus.run(write_pdo(5, PdoConfig("TPDO", 1, (0x60410010, 0x60640020, 0x60640020))))
    assert writes(bus) == []


def test_mapping_with_names_and_placeholders() -> None:
    objects = ObjectDictionary([Entry(0x6041, 0, "statusword", "u16"), Entry(0x6064, 0, "position", "i32")])
    words = (0x60410010, 0x00050008, 0x2FFF0004, 0x60640014, 0x60640008, 0x60410008)
    mapping = mapping_of(PdoConfig("TPDO", 1, words), objects)
    assert mapping.unpack(bytes.fromhex("3706 AA F5FFFF FF 12")) == {
        "statusword": 0x0637,
        "2FFFh:00": 5,
        "position": -1,
        "6064h:00": -1,
        "6041h:00": 0x12,
    }


def test_pdos_of_a_dictionary() -> None:
    pdos = [
        PdoConfig("RPDO", 1, (0x60400010,), event_timer=7),
        PdoConfig("TPDO", 2, (0x60410010,), type=1, cob_id=0x1A0),
        PdoConfig("TPDO", 5, ()),
    ]
    _, device = bus_with(*pdos)
    device.objects.replace(Entry(0x1A01, 0, "entries", "u8", "rw", 1))
    found = pdos_of(device.objects, 5)
    assert [(pdo.direction, pdo.number, pdo.mapping, pdo.type, pdo.cob_id) for pdo in found] == [
        ("RPDO", 1, (0x60400010,), 255, None),  # its own identifier, whatever the node-ID will be
        ("TPDO", 2, (0x60410010,), 1, 0x1A0),
        ("TPDO", 5, (), 255, 0x80000000),
    ]
    device.objects.replace(Entry(0x1A01, 0, "entries", "u8", "rw", 0xFE))
    multiplexed = pdos_of(device.objects, 5)[1]
    assert (multiplexed.number, multiplexed.mapping, multiplexed.multiplexed) == (2, (), "SAM")
    device.objects.replace(Entry(0x1A01, 0, "entries", "u8", "rw", 0xF0))  # neither a number of entries nor a word
    assert [pdo.number for pdo in pdos_of(device.objects, 5)] == [1, 5]


def test_mapping_entries_beyond_the_number_in_use_are_kept() -> None:
    """An EDS may have four entries of which two are mapped: a master raises the number, and maps them all."""
    words = (0x60000008, 0x60010008, 0x60020008, 0x60030008)
    objects = ObjectDictionary(
        [
            *(Entry(0x6000 + n, 0, f"input {n}", "u8", "ro") for n in range(4)),
            Entry(0x1800, 1, "COB-ID", "u32", "rw", 0x185),
            Entry(0x1800, 2, "type", "u8", "rw", 1),
            Entry(0x1A00, 0, "number", "u8", "rw", 2),
            *(Entry(0x1A00, sub, f"entry {sub}", "u32", "rw", word) for sub, word in enumerate(words, start=1)),
        ]
    )
    (pdo,) = pdos_of(objects, 5)
    assert (pdo.mapping, pdo.unused, pdo.slots) == (words[:2], words[2:], 4)
    assert "unused=" in repr(pdo)
    device = LocalNode(5, objects, [pdo])
    assert [device.objects.get(0x1A00, sub) for sub in range(5)] == [2, *words]
    device.start(0.0)
    for text in ("605#2300180185010080", "605#2F001A0004000000", "605#2300180185010000", "000#0105"):
        device.feed(CanFrame.parse(text), 0.1)
    assert [str(frame) for frame in device.feed(CanFrame.parse("080#"), 0.2)] == ["185#00000000"]


def _communication(sub: int, type: str, access: str, default: object) -> Entry:
    return Entry(0x1800, sub, f"sub-index {sub}", type, access, default)  # type: ignore[arg-type]


def test_a_record_has_the_sub_indices_of_its_description() -> None:
    """An EDS may have a TPDO without inhibit time: a node made of it has none either, and 1800h:00 says so."""
    described = [
        _communication(0, "u8", "const", 2),
        _communication(1, "u32", "rw", 0x185),
        _communication(2, "u8", "rw", 1),
        Entry(0x1A00, 0, "number", "u8", "rw", 0),
    ]
    objects = ObjectDictionary(described)
    LocalNode(5, objects, pdos_of(objects, 5)).start(0.0)
    assert {sub: objects.get(0x1800, sub) for sub in objects.subs(0x1800)} == {0: 2, 1: 0x185, 2: 1}

    objects = ObjectDictionary([*described, _communication(5, "u16", "rw", 30)])
    LocalNode(5, objects, pdos_of(objects, 5)).start(0.0)
    assert {sub: objects.get(0x1800, sub) for sub in objects.subs(0x1800)} == {0: 5, 1: 0x185, 2: 1, 5: 30}


def test_numbers_of_a_pdo_that_are_not_numbers_count_as_0() -> None:
    """An EDS may give the number of mapped objects a wrong data type."""
    for type, value in (("octets", b"\x01"), ("f32", float("inf")), ("string", "x")):
        objects = ObjectDictionary([_communication(1, "u32", "rw", 0x185), Entry(0x1A00, 0, "n", type, "rw", value)])
        (pdo,) = pdos_of(objects, 5)
        assert pdo.mapping == ()


def test_a_remote_pdo_with_names_of_a_dictionary() -> None:
    store = Store()
    record = {(0x1800, 1): "85010000", (0x1800, 2): "FF", (0x1800, 3): "0000", (0x1A00, 0): "02"}
    record |= {(0x1A00, 1): "10004160", (0x1A00, 2): "08000620"}
    store.objects |= {place: bytes.fromhex(text) for place, text in record.items()}
    objects = ObjectDictionary([Entry(0x6041, 0, "statusword", "u16"), Entry(0x2006, 0, "mode", "i8")])
    bus = Bus(SdoServer(5, store))
    store.objects |= {(0x1800, 5): bytes(2), (0x1800, 6): bytes(1)}
    remote = bus.run(remote_pdo(Channel(5), "TPDO", 1, objects))
    assert remote.key == (0x185, False)
    assert remote.decode(CanFrame.parse("185#3706FF")) == {"statusword": 0x0637, "mode": -1}
    listener = PdoConsumer([remote])
    assert listener.deadline is None
    (good,) = listener.feed(CanFrame.parse("185#3706FF"), 1.5)
    (bad,) = listener.feed(CanFrame.parse("185#3706"), 2.5)
    assert (good.values, good.node, good.at) == ({"statusword": 0x0637, "mode": -1}, 5, 1.5)
    assert (bad.values, bad.data, bad.why) == (None, bytes.fromhex("3706"), "3 bytes are mapped, got 2")
    assert listener.feed(CanFrame.parse("186#3706FF"), 3.0) == listener.feed(CanFrame.parse("185#R3"), 3.0) == []


def test_a_pdo_that_is_switched_off_raises() -> None:
    with pytest.raises(EncodeError, match="RPDO5 of node 5 is switched off"):
        RemotePdo.of(5, PdoConfig("RPDO", 5, (0x60400010,)))


RESTRICTED = (0x000, 0x07F, 0x101, 0x180, 0x585, 0x605, 0x6E0, 0x705, 0x7E5)


@every_case("identifier", RESTRICTED)
def test_a_pdo_with_a_restricted_cob_id_is_not_on(identifier: int) -> None:
    """A description without a DefaultValue of 1804h:01 has COB-ID 0: with 0080h as data it would be an NMT command."""
    objects = ObjectDictionary(
        [
            Entry(0x2000, 0, "level", "u16", "rw", 0x0080),
            Entry(0x1804, 1, "COB-ID", "u32", "rw", identifier),
            Entry(0x1804, 2, "type", "u8", "rw", 255),
            Entry(0x1A04, 0, "number", "u8", "rw", 1),
            Entry(0x1A04, 1, "entry", "u32", "rw", 0x2000_0010),
        ]
    )
    with pytest.raises(EncodeError, match=f"TPDO5: COB-ID {identifier:03X}h is restricted"):
        LocalNode(5, objects, pdos_of(objects, 5))
    refused: list[str] = []
    device = LocalNode(5, objects, pdos_of(objects, 5, refused=refused))
    assert refused == [f"TPDO5: COB-ID {identifier:03X}h is restricted [CiA 301], so the PDO cannot be on"]
    device.start(0.0)
    assert device.feed(CanFrame.parse("000#0105"), 0.1) == []
    # A master gives it an identifier of its own, and the mapping that was left out.
    sent = []
    for text in ("605#23041A0110000020", "605#2F041A0001000000", "605#2304180185020000"):
        sent += [str(frame) for frame in device.feed(CanFrame.parse(text), 0.2)]
    assert [text[:6] for text in sent] == ["585#60", "585#60", "585#60", "285#80"]


@every_case("word", [0x8000_0000, 0x2000_0000, 0x2000_0605, 0x285, 0x6DF])
def test_a_pdo_that_is_off_or_has_a_legal_cob_id_is_made(word: int) -> None:
    bus_with(PdoConfig("TPDO", 1, (0x60410010,), cob_id=word))
    if not word >> 31:
        assert RemotePdo.of(5, PdoConfig("RPDO", 1, (0x60400010,), cob_id=word)).key[0] == word & 0x1FFF_FFFF


def test_a_pdo_without_objects_may_have_any_cob_id() -> None:
    """It is never sent, and descriptions have many of them."""
    bus, _ = bus_with(PdoConfig("TPDO", 5, (), cob_id=0), PdoConfig("RPDO", 5, (), cob_id=0))
    bus.run(write_pdo(5, PdoConfig("TPDO", 5, (0x60410010,), cob_id=0x1A0)))
    assert bus.run(read_pdo(5, "TPDO", 5)).cob_id == 0x1A0


def test_a_cob_id_that_the_device_itself_sets_switches_the_pdo_off_too() -> None:
    _, device = bus_with(PdoConfig("TPDO", 1, (0x60410010,), type=1))
    device.feed(CanFrame.parse("000#0105"), 1.0)
    assert [str(frame) for frame in device.feed(CanFrame.parse("080#"), 1.0)] == ["185#3706"]
    device.objects.set(0x1800, 1, 0)
    device.feed(CanFrame.parse("000#8005"), 2.0)
    device.feed(CanFrame.parse("000#0105"), 2.0)
    assert device.feed(CanFrame.parse("080#"), 2.0) == []


@every_case("identifier", RESTRICTED)
def test_an_rpdo_with_a_restricted_cob_id_is_not_sent(identifier: int) -> None:
    with pytest.raises(
        EncodeError, match=f"RPDO1 of node 5 cannot be sent: its COB-ID {identifier:03X}h is restricted"
    ):
        RemotePdo.of(5, PdoConfig("RPDO", 1, (0x60400010,), cob_id=identifier))
    # What a node sends is received, wherever it sends it.
    RemotePdo.of(5, PdoConfig("TPDO", 1, (0x60410010,), cob_id=identifier))
