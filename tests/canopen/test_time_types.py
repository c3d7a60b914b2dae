"""TIME_OF_DAY, TIME_DIFFERENCE and UNICODE_STRING: on the wire, as values, in the dictionary and in a PDO."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from typing import Any

import pytest

from barewire.canopen import AbortCode, Entry, MappedObject, ObjectDictionary, PdoMapping, SdoAbort
from barewire.canopen.datatypes import BY_CODE, DAY, TimeDifference, TimeOfDay, object_codec
from barewire.errors import DecodeError, EncodeError


def wire(type: str, value: Any) -> str:
    codec: Any = object_codec(type)
    return str(codec.encode(value).hex(" ").upper())


@pytest.mark.parametrize(
    ("type", "value", "data", "number"),
    [
        ("time_of_day", datetime(1984, 1, 1), "00 00 00 00 00 00", 0),
        ("time_of_day", datetime(1984, 1, 2, 0, 0, 1), "E8 03 00 00 01 00", DAY + 1000),
        ("time_of_day", datetime(2026, 11, 21, 23, 59, 59, 999000), "FF 5B 26 05 31 3D", 15665 * DAY + DAY - 1),
        ("time_difference", timedelta(days=2, milliseconds=1), "01 00 00 00 02 00", 2 * DAY + 1),
        ("time_difference", timedelta(days=65535), "00 00 00 00 FF FF", 65535 * DAY),
    ],
)
def test_encode_and_decode(type: str, value: Any, data: str, number: int) -> None:
    assert wire(type, value) == wire(type, number) == data
    decoded: Any = object_codec(type).decode(bytes.fromhex(data))
    assert decoded == number
    assert (decoded.datetime if type == "time_of_day" else decoded.timedelta) == value


def test_values_out_of_range_raise() -> None:
    for type, value in (
        ("time_of_day", datetime(1983, 12, 31)),
        ("time_of_day", timedelta(1)),
        ("time_difference", datetime(2000, 1, 1)),
        ("time_difference", timedelta(-1)),
        ("time_difference", 65536 * DAY),
        ("time_difference", 1.5),
    ):
        with pytest.raises(EncodeError):
            wire(type, value)
    for data, reason in (("00", "short"), ("00" * 7, "long"), ("005C26050000", "value")):
        with pytest.raises(DecodeError) as caught:
            object_codec("time_of_day").decode(bytes.fromhex(data))
        assert caught.value.reason == reason
    # The four void bits have no meaning.
    assert object_codec("time_difference").decode(bytes.fromhex("010000F00000")) == 1


def test_a_time_zone_is_ignored() -> None:
    here = datetime(2026, 1, 1, 12, tzinfo=timezone(timedelta(hours=2)))
    assert TimeOfDay.of(here).datetime == datetime(2026, 1, 1, 12)
    assert repr(TimeDifference(1500)) == "TimeDifference(0:00:01.500000)"


def test_time_types_in_the_dictionary() -> None:
    objects = ObjectDictionary(
        [
            Entry(0x2000, 0, "started", "time_of_day", "rw", 0, minimum=DAY),
            Entry(0x2001, 0, "title", "unicode", "rw"),
        ]
    )
    objects.write(0x2000, 0, bytes.fromhex("E80300000100"))
    started = objects.get(0x2000)
    assert isinstance(started, TimeOfDay)
    assert started.datetime == datetime(1984, 1, 2, 0, 0, 1)
    with pytest.raises(SdoAbort) as caught:
        objects.write(0x2000, 0, bytes(6))
    assert caught.value.code == AbortCode.TOO_LOW
    assert objects.read(0x2001, 0) == b""
    objects.write(0x2001, 0, "Ω≥".encode("utf-16-le"))
    assert objects.get(0x2001) == "Ω≥"
    with pytest.raises(SdoAbort) as caught:
        objects.write(0x2001, 0, b"\0")
    assert caught.value.code == AbortCode.TOO_SHORT


def test_unicode_keeps_lone_surrogates() -> None:
    codec = object_codec("unicode")
    assert codec.encode(codec.decode(b"\x00\xd8")) == b"\x00\xd8"
    with pytest.raises(EncodeError):
        codec.encode(5)


def test_time_types_in_a_pdo() -> None:
    mapping = PdoMapping(
        [MappedObject(0x2000, 0, 48, "time_of_day", "at"), MappedObject(0x2001, 0, 16, "u16", "speed")]
    )
    data = mapping.pack({"at": DAY + 1000, "speed": 7})
    assert data.hex(" ").upper() == "E8 03 00 00 01 00 07 00"
    assert mapping.unpack(data) == {"at": DAY + 1000, "speed": 7}
    with pytest.raises(EncodeError, match="expected 48"):
        PdoMapping([MappedObject(0x2000, 0, 32, "time_of_day")])


def test_the_table_has_every_basic_type_of_the_standard() -> None:
    reserved = {0x0E, 0x17}
    assert set(BY_CODE) == set(range(0x01, 0x1C)) - reserved


def test_find_an_entry_by_name() -> None:
    objects = ObjectDictionary(
        [
            Entry(0x1A00, 1, "entry 1", "u32", object_name="TPDO1 mapping"),
            Entry(0x1A01, 1, "entry 1", "u32", object_name="TPDO2 mapping"),
            Entry(0x6041, 0, "Status  Word", "u16"),
        ]
    )
    assert objects.find("status word").index == 0x6041
    assert objects.find("TPDO2 Mapping.entry 1").index == 0x1A01
    with pytest.raises(EncodeError, match="in several places: 1A00h:01 TPDO1 mapping, 1A01h:01 TPDO2 mapping"):
        objects.find("entry 1")
    with pytest.raises(EncodeError, match="no object is called 'speed'"):
        objects.find("speed")
