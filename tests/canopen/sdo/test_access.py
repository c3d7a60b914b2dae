"""The objects of another device as values, by name; further SDO servers of a node, and `block="auto"`."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    AbortCode,
    Channel,
    Entry,
    LocalNode,
    ObjectDictionary,
    SdoAbort,
    SdoServer,
    download,
    read_object,
    standard_objects,
    upload,
)
from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.sdo.client import find_channel, write_object
from barewire.codecs import Value
from barewire.conversation import play
from barewire.errors import DecodeError, EncodeError
from tests.canopen.sdo.sdo_bus import Bus, Store
from tests.canopen.virtual_bus import VirtualBus


def entries() -> list[Entry]:
    return [
        *standard_objects(name="thing"),
        Entry(0x2000, 0, "speed", "i32", maximum=1000),
        Entry(0x2001, 2, "gain", "f32"),
        Entry(0x2002, 0, "text", "string", default="as it was"),
        Entry(0x2003, 0, "on", "bool"),
        Entry(0x2004, 0, "log", "domain", default=b""),
    ]


def bus() -> tuple[VirtualBus, LocalNode]:
    bus, device = VirtualBus(), LocalNode(5, ObjectDictionary(entries()))
    bus.add(device, sent=device.start(0.0))
    return bus, device


@pytest.mark.parametrize(
    ("place", "value"),
    [("Speed", -1500), ((0x2001, 2), 0.25), ("text", "another one"), (0x2003, True), ("log", bytes(range(200)))],
)
@pytest.mark.parametrize("block", [False, True])
def test_objects_are_written_and_read_as_values(place: str | int | tuple[int, int], value: Value, block: bool) -> None:
    line, device = bus()
    known = ObjectDictionary(entries())
    line.run(write_object(5, known, place, value, block=block))
    assert device.objects[place] == value
    assert line.run(read_object(5, known, place, block=block)) == value


def test_errors_of_dictionary_device_and_type() -> None:
    line, device = bus()
    known = ObjectDictionary(entries())
    for value in (1 << 31, "fast", 1.5):
        with pytest.raises(EncodeError, match=r"speed: .*i32"):
            write_object(5, known, "speed", value)
    for place in ("spedd", 0x2005, (0x2000, 1)):
        with pytest.raises(EncodeError):
            read_object(5, known, place)
    with pytest.raises(SdoAbort) as refusal:
        line.run(write_object(5, known, "speed", 1001))
    assert refusal.value.code == AbortCode.TOO_HIGH
    device.objects.replace(Entry(0x2000, 0, "speed", "i16"))
    with pytest.raises(DecodeError) as odd:
        line.run(read_object(5, known, "speed"))
    assert odd.value.__notes__ == ["speed is i32 in the dictionary, but the device sent this"]


CHANNEL = CobEntry(0x1234565, extended=True), CobEntry(0x6E5)


def test_a_second_server_has_its_own_channel() -> None:
    first, second = Store(), Store()
    words = [entry.pack().to_bytes(4, "little") for entry in CHANNEL]
    first.objects |= {(0x1201, 1): words[0], (0x1201, 2): words[1]}
    bus = Bus(SdoServer(5, first), SdoServer(5, second, cob_ids=CHANNEL))
    default = Channel(5)
    channel = bus.run(find_channel(default, 2))
    assert (channel.request_id, channel.request_extended, channel.response_id) == (0x1234565, True, 0x6E5)
    value = bytes(range(200))
    bus.run_all(download(default, 0x2100, 0, b"first"), download(channel, 0x2100, 0, value, block=True))
    assert (first.objects[0x2100, 0], second.objects[0x2100, 0]) == (b"first", value)
    assert bus.run_all(upload(channel, 0x2100, block="auto"), upload(default, 0x2100)) == [value, b"first"]
    assert play(find_channel(default, 1), lambda frame, now: [])[0] is default


def test_a_server_that_is_missing_or_not_in_use() -> None:
    store = Store()
    bus = Bus(SdoServer(5, store))
    with pytest.raises(SdoAbort, match="1201h:01: 0602 0000h"):
        bus.run(find_channel(Channel(5), 2))
    store.objects |= {(0x1201, 1): bytes.fromhex("00000080"), (0x1201, 2): bytes.fromhex("00000080")}
    with pytest.raises(EncodeError, match="SDO server 2 of node 5 is not in use"):
        bus.run(find_channel(Channel(5), 2))
    with pytest.raises(EncodeError, match=r"expected 1\.\.128"):
        find_channel(Channel(5), 129)


# block="auto"


def test_auto_requests_blocks_for_long_values() -> None:
    store, channel = Store(), Channel(5)
    bus = Bus(SdoServer(5, store))
    for length, first in ((4, "C 23"), (28, "C 21"), (29, "C C6")):
        bus.log.clear()
        bus.run(download(channel, 0x2100, 0, bytes(length), block="auto"))
        assert bus.log[0].startswith(first)
        bus.log.clear()
        assert bus.run(upload(channel, 0x2100, block="auto")) == bytes(length)
        assert bus.log[0] == "C A4 00 21 00 7F 1C 00 00"
        assert bus.log[1].startswith("S C6" if length > 28 else "S 4")
    bus.log.clear()
    bus.run(download(channel, 0x2100, 0, iter([b"some", b"thing"]), block="auto"))
    assert bus.log[0].startswith("C C4")


@pytest.mark.parametrize("downloads", [False, True])
def test_auto_requests_blocks_once_of_a_server_without_them(downloads: bool) -> None:
    store, channel = Store(), Channel(5)
    store.objects[0x2100, 0] = bytes(100)
    bus = Bus(SdoServer(5, store, blksize=0))
    for asked in (True, False):
        bus.log.clear()
        if downloads:
            bus.run(download(channel, 0x2100, 0, bytes(100), block="auto"))
        else:
            assert bus.run(upload(channel, 0x2100, block="auto")) == bytes(100)
        assert (bus.log[1][:4] == "S 80") is asked
