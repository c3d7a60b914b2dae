"""Multiplexed PDOs: their frames, scanner and dispatcher lists, sending and receiving, configuration."""

from __future__ import annotations

from dataclasses import replace

import pytest

from barewire.canopen import (
    CanFrame,
    Entry,
    LocalNode,
    ObjectDictionary,
    PdoConfig,
    PdoConfigPolicy,
    RemotePdo,
    read_pdo,
    standard_objects,
    write_pdo,
)
from barewire.canopen.pdo.config import pdos_of
from barewire.canopen.pdo.multiplexed import Mpdo, dispatcher_list, scanner_list
from barewire.errors import DecodeError, EncodeError
from tests.canopen.virtual_bus import VirtualBus

SCANNER, DISPATCHER = 0x1FA0, 0x1FD0


def objects(*more: Entry) -> ObjectDictionary:
    values = [Entry(0x6401, sub, f"input {sub}", "i16", "rw", sub) for sub in range(1, 5)]
    places = [Entry(0x2000, sub, f"place {sub}", "i16", "rw") for sub in range(1, 5)]
    return ObjectDictionary(
        [
            *standard_objects(),
            *values,
            *places,
            Entry(0x2100, 0, "long", "u64", "rw"),
            Entry(0x2101, 0, "text", "string", "rw"),
            Entry(0x2102, 0, "percent", "u8", "rw", 5, maximum=100),
            *more,
        ]
    )


def scanner(*words: int) -> list[Entry]:
    return [Entry(SCANNER, sub, "scanner", "u32", "rw", word) for sub, word in enumerate(words, start=1)]


def dispatcher(*words: int) -> list[Entry]:
    return [Entry(DISPATCHER, sub, "dispatcher", "u64", "rw", word) for sub, word in enumerate(words, start=1)]


def node(number: int, pdo: PdoConfig, *more: Entry) -> LocalNode:
    device = LocalNode(number, objects(*more), [pdo])
    device.start(0.0)
    device.feed(CanFrame.parse(f"000#01{number:02X}"), 0.0)
    return device


def feed(device: LocalNode, text: str | None, now: float = 0.0) -> list[str]:
    return [str(frame) for frame in device.feed(None if text is None else CanFrame.parse(text), now)]


# The frame


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (Mpdo("SAM", 5, 0x6401, 1, b"\x01\x00"), "185#0501640101000000"),
        (Mpdo("DAM", 5, 0x6040, 0, b"\x0f\x00\x00\x00"), "185#854060000F000000"),
        (Mpdo("DAM", 0, 0x2000, 0xFF, b"\x01\x02\x03\x04"), "185#800020FF01020304"),
        (Mpdo("DAM", 127, 0xFFFF, 1, b""), "185#FFFFFF0100000000"),
    ],
)
def test_encode_and_decode(message: Mpdo, text: str) -> None:
    frame = message.encode((0x185, False))
    assert str(frame) == text
    again = Mpdo.decode(frame)
    assert again.pack() == frame.data
    assert (again.addressing, again.node, again.index, again.sub) == (
        message.addressing,
        message.node,
        message.index,
        message.sub,
    )


def test_invalid_messages_raise() -> None:
    for text in ("185#", "185#05016401010000", "185#R8", "185#0001640101000000"):
        with pytest.raises(DecodeError):
            Mpdo.decode(CanFrame.parse(text))
    for wrong in (Mpdo("SAM", 0, 1, 1, b""), Mpdo("DAM", 128, 1, 1, b""), Mpdo("DAM", -1, 1, 1, b"")):
        with pytest.raises(EncodeError, match="node"):
            wrong.pack()
    for wrong in (Mpdo("DAM", 1, 1, 1, bytes(5)), Mpdo("DAM", 1, 0x10000, 1, b""), Mpdo("DAM", 1, 1, 256, b"")):
        with pytest.raises(EncodeError):
            wrong.pack()


def test_scanner_and_dispatcher_lists() -> None:
    both = objects(
        *scanner(0x01_6401_02, 0, 0x03_6401_01, 0xFF_2000_FE),
        *dispatcher(0x02_2000_01_6401_03_07, 0, 0x00_2102_00_6041_00_08, 0x01_2000_01_6401_03_07),
    )
    assert scanner_list(both) == [(0x6401, 2), (0x6401, 1), (0x6401, 3), (0x2000, 0xFE), (0x2000, 0xFF)]
    assert dispatcher_list(both) == {
        (7, 0x6401, 3): (0x2000, 1),
        (7, 0x6401, 4): (0x2000, 2),
        (8, 0x6041, 0): (0x2102, 0),
    }


# Source addressing


def test_a_sam_producer_sends_everything_once_and_then_changes() -> None:
    source = node(7, PdoConfig("TPDO", 1, (), multiplexed="SAM"), *scanner(0x02_6401_01, 0x01_2100_00, 0x01_5000_00))
    sent = [text for _ in range(5) for text in feed(source, None)]
    # The first was sent with the start command; objects that are too long or missing are counted and left out.
    assert sent == ["187#0701640202000000"]
    assert source.pdo.refused == 2
    assert source.deadline is None
    source.objects.set(0x6401, 2, -2)
    assert feed(source, None, 1.0) == ["187#07016402FEFF0000"]
    assert feed(source, None, 2.0) == []
    assert feed(source, "187#R8", 2.0) == feed(source, "080#", 2.0) == []


def test_messages_are_an_inhibit_time_apart() -> None:
    source = node(7, PdoConfig("TPDO", 1, (), inhibit=100, multiplexed="SAM"), *scanner(0x03_6401_01))
    assert (feed(source, None, 0.005), source.deadline) == ([], 0.01)
    assert feed(source, None, 0.01) == ["187#0701640202000000"]
    assert feed(source, None, 0.02) == ["187#0701640303000000"]
    assert source.deadline is None


def test_a_sam_consumer_stores_what_its_dispatcher_list_names() -> None:
    source = node(7, PdoConfig("TPDO", 1, (), multiplexed="SAM"), *scanner(0x04_6401_01))
    into = PdoConfig("RPDO", 1, (), cob_id=0x187, multiplexed="SAM")
    listener = node(5, into, *dispatcher(0x02_2000_03_6401_01_07, 0x01_2102_00_6401_04_07, 0x01_2101_00_6401_03_08))
    stranger = node(6, into, *dispatcher(0x01_2000_01_6401_01_09))
    bus = VirtualBus()
    for device in (source, listener, stranger):
        bus.add(device)
    for sub, value in enumerate((100, -200, 300, 400), start=1):
        source.objects.set(0x6401, sub, value)
    bus.pass_time(1.0)
    assert [listener.objects.get(0x2000, sub) for sub in (1, 2, 3, 4)] == [0, 0, 100, -200]
    assert (listener.objects.get(0x2102), listener.pdo.refused) == (5, 1)  # 400 exceeds the limit
    assert [stranger.objects.get(0x2000, sub) for sub in (1, 2, 3, 4)] == [0, 0, 0, 0]
    assert listener.errors.active == stranger.errors.active == ()


# Destination addressing


def test_a_dam_consumer_stores_messages_for_it_and_for_all() -> None:
    device = node(5, PdoConfig("RPDO", 1, (), cob_id=0x187, multiplexed="DAM"))
    for text in ("187#85002001FEFF0000", "187#800020020300FFFF", "187#8600200304000000", "187#0500200304000000"):
        assert feed(device, text) == []
    assert [device.objects.get(0x2000, sub) for sub in (1, 2, 3)] == [-2, 3, 0]
    assert feed(device, "187#8501210041424344") == []
    assert device.objects.get(0x2101) == "ABCD"


def test_a_missing_destination_is_reported_as_8230h() -> None:
    device = node(5, PdoConfig("RPDO", 1, (), cob_id=0x187, multiplexed="DAM"))
    assert feed(device, "187#8500500100000000") == ["085#3082110050010000"]
    assert feed(device, "187#8600500100000000") == []
    assert feed(device, "187#8500210001000000") == []  # u64 does not fit: the error is active already
    assert feed(device, "187#8500200101000000") == ["085#0000000000000000"]
    assert feed(device, "187#85002001010000") == ["085#1082110708000000"]
    assert feed(device, "187#8500200102000000") == ["085#0000000000000000"]
    assert device.objects.get(0x2000, 1) == 2


def test_a_communication_object_is_no_destination_unless_it_can_be_mapped() -> None:
    """1017h keeps its value and is reported as missing; an EDS may allow to map one."""
    heartbeat = Entry(0x1017, 0, "heartbeat time", "u16", "rw", 1000)
    for mappable, value, answers in ((None, 1000, ["085#3082111710000000"]), (("RPDO",), 5, [])):
        objects = ObjectDictionary([replace(heartbeat, mappable=mappable)])  # type: ignore[arg-type]
        device = LocalNode(5, objects, [PdoConfig("RPDO", 1, (), cob_id=0x187, multiplexed="DAM")])
        device.start(0.0)
        device.feed(CanFrame.parse("000#0105"), 0.0)
        sent = [str(frame) for frame in device.feed(CanFrame.parse("187#8517100005000000"), 0.1)]
        assert [text for text in sent if text.startswith("085")] == answers
        assert device.objects.get(0x1017) == value


def test_send_mpdo_to_another_node() -> None:
    source = node(7, PdoConfig("TPDO", 1, (), inhibit=100, multiplexed="DAM"))
    device = node(5, PdoConfig("RPDO", 1, (), cob_id=0x187, multiplexed="DAM"))
    frames = source.pdo.send_mpdo(1, Mpdo("DAM", 5, 0x2000, 1, b"\x01\x00"), 0.0)
    frames += source.pdo.send_mpdo(1, Mpdo("DAM", 0, 0x2000, 2, b"\x02\x00"), 0.0)
    assert [str(frame) for frame in frames] == ["187#8500200101000000"]
    assert source.deadline == 0.01
    for frame in frames + source.feed(None, 0.01):
        device.feed(frame, 0.01)
    assert [device.objects.get(0x2000, sub) for sub in (1, 2)] == [1, 2]
    for _ in range(100):
        source.pdo.send_mpdo(1, Mpdo("DAM", 5, 0x2000, 1, b""), 0.01)
    assert source.pdo.refused == 100 - 32
    for number, message in ((2, Mpdo("DAM", 5, 1, 1, b"")), (1, Mpdo("SAM", 5, 1, 1, b""))):
        with pytest.raises(EncodeError, match="is not a DAM MPDO in use"):
            source.pdo.send_mpdo(number, message, 0.0)
    feed(source, "000#8007")
    with pytest.raises(EncodeError, match="is not a DAM MPDO in use"):
        source.pdo.send_mpdo(1, Mpdo("DAM", 5, 1, 1, b""), 0.0)


# The records


def test_an_mpdo_is_configured_by_sdo_and_read_from_a_dictionary() -> None:
    device = LocalNode(5, objects(*scanner(0x01_6401_01)), [PdoConfig("TPDO", 1, (), type=1)])
    device.start(0.0)
    ok = "585#6000{}0000000000"
    assert feed(device, "605#2F001A00FE000000") == ["585#80001A0000000106"]  # it is on
    feed(device, "605#2300180185010080")
    assert feed(device, "605#2F001A00FE000000") == ["585#80001A0042000406"]  # with SYNC there is none
    feed(device, "605#2F001802FE000000")
    for number in ("FC", "FD"):
        assert feed(device, f"605#2F001A00{number}000000") == ["585#80001A0042000406"]
    assert feed(device, "605#2F001A00FE000000") == [ok.format("1A")]
    assert feed(device, "605#2300180185010000") == ["585#6000180100000000"]
    assert feed(device, "000#0105") == ["185#0501640101000000"]
    assert [(pdo.multiplexed, pdo.count) for pdo in pdos_of(device.objects, 5)] == [("SAM", 0xFE)]


def test_a_type_that_an_mpdo_cannot_have_is_refused() -> None:
    device = node(7, PdoConfig("TPDO", 1, (), multiplexed="SAM"), *scanner(0x01_6401_01))
    for number in ("00", "01", "F0", "FC", "FD"):
        assert feed(device, f"607#2F001802{number}000000") == ["587#8000180230000906"]
    assert feed(device, "607#2F001802FE000000")[0] == "587#6000180200000000"
    for type in (1, 252, 253):
        with pytest.raises(EncodeError, match=f"TPDO1 is multiplexed: expected type 254 or 255, not {type}"):
            LocalNode(7, objects(), [PdoConfig("TPDO", 1, (), type=type, multiplexed="SAM")])
    with pytest.raises(EncodeError, match="TPDO1 is multiplexed: expected no mapping"):
        PdoConfig("TPDO", 1, (0x20000110,), multiplexed="DAM")


@pytest.mark.parametrize(
    "policy", [PdoConfigPolicy(), PdoConfigPolicy(skip_equal=True), PdoConfigPolicy(order="first")]
)
def test_an_mpdo_is_read_and_written_by_a_master(policy: PdoConfigPolicy) -> None:
    device = LocalNode(7, objects(*scanner(0x01_6401_01)), [PdoConfig("TPDO", 1, (0x64010110,), type=1)])
    bus = VirtualBus()
    bus.add(device, sent=device.start(0.0))
    wanted = PdoConfig("TPDO", 1, (), type=254, cob_id=0x187, inhibit=100, multiplexed="SAM")
    bus.run(write_pdo(7, wanted, policy=policy))
    assert bus.run(read_pdo(7, "TPDO", 1)) == wanted
    bus.run(write_pdo(7, wanted, policy=policy))
    assert "187#0701640101000000" in [str(frame) for frame in device.feed(CanFrame.parse("000#0107"), bus.now)]
    with pytest.raises(EncodeError, match="TPDO1 of node 7 is a multiplexed PDO"):
        RemotePdo.of(7, wanted)
    device.feed(CanFrame.parse("000#8007"), bus.now)
    plain = PdoConfig("TPDO", 1, (0x64010110,), type=254, cob_id=0x187)
    bus.run(write_pdo(7, plain, policy=policy))
    assert bus.run(read_pdo(7, "TPDO", 1)) == plain
