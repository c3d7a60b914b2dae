"""The objects of another device as values, by name."""

from __future__ import annotations

import pytest

from barewire.canopen import AbortCode, Entry, LocalNode, ObjectDictionary, SdoAbort, read_object, standard_objects
from barewire.canopen.sdo.client import write_object
from barewire.codecs import Value
from barewire.errors import DecodeError, EncodeError
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
