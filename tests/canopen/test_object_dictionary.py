"""The object dictionary and its types: values, rights, limits, hooks, defaults."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from barewire.canopen import AbortCode, Entry, ObjectDictionary, SdoAbort
from barewire.canopen.datatypes import BY_CODE, DATA_TYPES, object_codec
from barewire.codecs import Value
from barewire.errors import DecodeError, EncodeError
from tests.helpers import every_case


@every_case(
    ("type_", "value", "data"),
    [
        ("bool", True, "01"),
        ("u8", 255, "FF"),
        ("i8", -1, "FF"),
        ("u16", 1000, "E803"),  # the guide of the AZ3 prints EBh 03h here
        ("i16", -2, "FEFF"),
        ("u24", 0x332211, "112233"),
        ("i24", -1, "FFFFFF"),
        ("u32", 25000, "A8610000"),
        ("i32", -100000, "6079FEFF"),
        ("u40", 0x123456789A, "9A78563412"),
        ("i48", -2, "FEFFFFFFFFFF"),
        ("u56", 1, "01000000000000"),
        ("u64", 1, "0100000000000000"),
        ("i64", -1, "FFFFFFFFFFFFFFFF"),
        ("f32", 1.5, "0000C03F"),
        ("f64", 1.5, "000000000000F83F"),
        ("string", "AZ3", "415A33"),
        ("octets", b"\1\2", "0102"),
        ("domain", b"", ""),
    ],
)
def test_types_on_the_wire(type_: str, value: Value, data: str) -> None:
    codec = object_codec(type_)
    assert codec.encode(value) == bytes.fromhex(data)
    assert codec.decode(bytes.fromhex(data)) == value


def test_the_type_table_of_the_standard() -> None:
    assert BY_CODE[0x05].standard == "UNSIGNED8"
    assert BY_CODE[0x18].name == "u40"
    assert len({row.code for row in DATA_TYPES}) == len({row.name for row in DATA_TYPES}) == len(DATA_TYPES)
    for row in DATA_TYPES:
        size = object_codec(row.name).size
        assert size == (None if row.bits == 0 else max(1, row.bits // 8))


def test_invalid_values_of_a_type_raise() -> None:
    with pytest.raises(EncodeError):
        object_codec("bool").encode(2)
    with pytest.raises(EncodeError):
        object_codec("string").encode("€")
    with pytest.raises(EncodeError):
        object_codec("octets").encode(5)
    with pytest.raises(EncodeError, match="expected one of"):
        object_codec("u12")
    for data, reason in ((b"", "short"), (b"\0\0", "long"), (b"\2", "value")):
        with pytest.raises(DecodeError) as caught:
            object_codec("bool").decode(data)
        assert caught.value.reason == reason


def refused(objects: ObjectDictionary, index: int, sub: int, data: bytes | None = None) -> int:
    with pytest.raises(SdoAbort) as caught:
        objects.read(index, sub) if data is None else objects.write(index, sub, data)
    assert (caught.value.index, caught.value.sub) == (index, sub)
    return caught.value.code


def test_every_refusal_has_its_own_abort_code() -> None:
    objects = ObjectDictionary(
        [
            Entry(0x2000, 0, "limited", "i16", "rw", 0, minimum=-10, maximum=10),
            Entry(0x2001, 0, "constant", "u8", "const", 1),
            Entry(0x2002, 0, "status", "u8", "ro", 1),
            Entry(0x2003, 0, "command", "u8", "wo", 0),
            Entry(0x2004, 0, "switch", "bool", "rw", False),
            Entry(0x2005, 0, "limited float", "f32", "rw", 0.0, minimum=-1.0, maximum=1.0),
            Entry(0x2006, 0, "name", "string", "rw", "", maximum=4),
        ]
    )
    assert refused(objects, 0x3000, 0) == AbortCode.NO_OBJECT
    assert refused(objects, 0x2000, 1) == AbortCode.NO_SUB
    assert refused(objects, 0x2003, 0) == AbortCode.WRITE_ONLY
    assert refused(objects, 0x2001, 0, b"\1") == AbortCode.READ_ONLY
    assert refused(objects, 0x2002, 0, b"\1") == AbortCode.READ_ONLY
    assert refused(objects, 0x2000, 0, b"\x0b\0") == AbortCode.TOO_HIGH
    assert refused(objects, 0x2000, 0, b"\xf5\xff") == AbortCode.TOO_LOW
    assert refused(objects, 0x2000, 0, b"\1") == AbortCode.TOO_SHORT
    assert refused(objects, 0x2000, 0, b"\1\0\0") == AbortCode.TOO_LONG
    assert refused(objects, 0x2004, 0, b"\2") == AbortCode.INVALID_VALUE
    assert refused(objects, 0x2005, 0, bytes.fromhex("0000C07F")) == AbortCode.INVALID_VALUE
    assert refused(objects, 0x2006, 0, b"12345") == AbortCode.TOO_LONG
    assert objects.get(0x2000) == 0


def test_get_and_set_check_types_but_no_rights() -> None:
    objects = ObjectDictionary([Entry(0x6041, 0, "status word", "u16", "ro", 0)])
    objects.set(0x6041, 0, 0x0637)
    assert objects.read(0x6041, 0) == bytes.fromhex("3706")
    with pytest.raises(EncodeError):
        objects.set(0x6041, 0, 70000)
    with pytest.raises(SdoAbort):
        objects.set(0x6042, 0, 0)


def test_on_read_and_on_write() -> None:
    seen: list[Value] = []

    def on_write(value: Value) -> None:
        if value == 13:
            raise SdoAbort(AbortCode.DEVICE_STATE, 0x2000, 0)
        seen.append(value)

    objects = ObjectDictionary(
        [
            Entry(0x2000, 0, "watched", "u8", "rw", 0, on_write=on_write),
            Entry(0x2001, 0, "measured", "f32", "ro", on_read=lambda: 229.75),
        ]
    )
    objects.write(0x2000, 0, b"\7")
    assert refused(objects, 0x2000, 0, b"\x0d") == AbortCode.DEVICE_STATE
    assert (seen, objects.get(0x2000)) == ([7], 7)
    assert objects.read(0x2001, 0) == bytes.fromhex("00C06543")


def test_sub_indices_are_listed_and_counted() -> None:
    objects = ObjectDictionary(
        [
            Entry(0x1018, 2, "product", "u32", "ro", 2),
            Entry(0x1018, 1, "vendor", "u32", "ro", 1),
            Entry(0x1000, 0, "type", "u32"),
        ]
    )
    assert objects.subs(0x1018) == (0, 1, 2)
    assert objects.read(0x1018, 0) == b"\2"
    assert objects.subs(0x2000) == ()
    assert [(entry.index, entry.sub) for entry in objects] == [(0x1000, 0), (0x1018, 0), (0x1018, 1), (0x1018, 2)]
    assert (0x1018, 2) in objects
    assert (0x1018, 3) not in objects


def test_invalid_entries_raise() -> None:
    with pytest.raises(EncodeError, match="defined twice"):
        ObjectDictionary([Entry(0x2000, 0, "a", "u8"), Entry(0x2000, 0, "b", "u8")])
    with pytest.raises(EncodeError, match="does not fit u8"):
        ObjectDictionary([Entry(0x2000, 0, "a", "u8", default=256)])
    with pytest.raises(EncodeError, match=r"expected 0\.\.FFFFh and 0\.\.FFh"):
        ObjectDictionary([Entry(0x12000, 0, "a", "u8")])


def test_restore_resets_a_range_to_its_defaults() -> None:
    objects = ObjectDictionary(
        [
            Entry(0x1017, 0, "time", "u16", default=1000),
            Entry(0x2000, 0, "a", "u8", default=5),
            Entry(0x2001, 0, "s", "string"),
        ]
    )
    objects.set(0x1017, 0, 1)
    objects.set(0x2000, 0, 1)
    objects.set(0x2001, 0, "x")
    objects.restore(0x1000, 0x1FFF)
    assert (objects.get(0x1017), objects.get(0x2000)) == (1000, 1)
    objects.restore()
    assert (objects.get(0x2000), objects.get(0x2001)) == (5, "")


def test_access_by_name_or_address() -> None:
    objects = ObjectDictionary([Entry(0x1018, 1, "Vendor-ID", "u32", "ro", 7), Entry(0x2000, 0, "speed", "i16")])
    objects["SPEED"] = -5
    objects[0x1018, 1] = 9
    assert (objects[0x2000], objects["speed"], objects["vendor-id"]) == (-5, -5, 9)
    for place, text in (("spedd", "no object is called 'spedd'"), (0x2001, "no object 2001h:00"), ((1, 2), "0001h:02")):
        with pytest.raises(EncodeError, match=text):
            assert objects[place]
    with pytest.raises(EncodeError, match=r"index 'speed': expected a number; by name it is objects\['speed'\]"):
        objects.get("speed")  # type: ignore[arg-type]
    with pytest.raises(EncodeError, match="access 'readwrite': expected one of ro, wo, rw, const"):
        ObjectDictionary([Entry(0x2000, 0, "a", "u8", "readwrite")])  # type: ignore[arg-type]


def test_an_unknown_name_is_answered_with_near_ones() -> None:
    entries = [Entry(0x2000 + n, 0, name, "u8") for n, name in enumerate(("Target speed", "Speed limit", "Torque"))]
    objects = ObjectDictionary(entries)
    for name, text in (
        ("target sped", "no object is called 'target sped'; did you mean 'Target speed'?"),
        ("SPEED", "no object is called 'SPEED'; did you mean 'Speed limit' or 'Target speed'?"),
        ("xyzzy", "no object is called 'xyzzy'"),
    ):
        with pytest.raises(EncodeError) as caught:
            objects.find(name)
        assert str(caught.value).startswith(text)
        assert str(caught.value).endswith(text[-2:])


def test_hook_attaches_functions_to_an_entry() -> None:
    seen: list[Value] = []

    def check(value: Value) -> None:
        if value == 13:
            raise SdoAbort(AbortCode.INVALID_VALUE, 0x2000, 0)

    objects = ObjectDictionary([Entry(0x2000, 0, "speed", "i16", default=7, on_write=check)])
    objects.hook("speed", on_write=seen.append)
    assert objects["speed"] == 7
    objects.write(0x2000, 0, b"\x05\0")
    with pytest.raises(SdoAbort):
        objects.write(0x2000, 0, b"\x0d\0")
    objects["speed"] = 9  # the device itself: no hook
    assert seen == [5]
    objects.hook(0x2000, on_read=lambda: 11)
    objects.write(0x2000, 0, b"\x06\0")
    assert (objects["speed"], seen, objects.computed) == (11, [5, 6], {0x2000})


def test_changes_counts_everything_that_may_change_a_value() -> None:
    objects = ObjectDictionary([Entry(0x2000, 0, "a", "u8"), Entry(0x2001, 0, "b", "u8", on_read=lambda: 1)])
    assert objects.computed == {0x2001}
    before = objects.changes
    changes: list[Callable[[], object]] = [
        lambda: objects.set(0x2000, 0, 1),
        lambda: objects.write(0x2000, 0, b"\2"),
        objects.restore,
        lambda: objects.replace(Entry(0x2000, 0, "a", "u8", on_read=lambda: 3)),
        lambda: objects.add(Entry(0x2002, 0, "c", "u8")),
    ]
    for change in changes:
        change()
        assert objects.changes > before
        before = objects.changes
    assert objects.computed == {0x2000, 0x2001}
    with pytest.raises(SdoAbort):
        objects.write(0x2001, 0, b"")
    assert objects.changes == before


def test_types_may_have_the_names_of_the_standard() -> None:
    objects = ObjectDictionary(
        [
            Entry(0x1008, 0, "name", "VISIBLE_STRING", "const", "pump"),
            Entry(0x2001, 0, "raw", "OCTET_STRING", "rw", b"\1"),
            Entry(0x2002, 0, "speed", "INTEGER16", "rw", -2),
        ]
    )
    assert [entry.type for entry in objects if entry.sub == 0] == ["string", "octets", "i16"]
    assert (objects.read(0x1008, 0), objects.read(0x2002, 0)) == (b"pump", b"\xfe\xff")
    with pytest.raises(EncodeError, match=r"type 'INT16': expected one of bool \(BOOLEAN\), i8 \(INTEGER8\)"):
        ObjectDictionary([Entry(0x2003, 0, "wrong", "INT16")])


async def _deferred_read() -> int:
    return 5


def _deferred_write(value: Value) -> Iterator[None]:
    yield


@pytest.mark.parametrize(
    ("hooks", "text"),
    [
        ({"on_read": _deferred_read}, "2000h:00 on_read = .*: a call returns a coroutine .*; expected def"),
        ({"on_write": _deferred_write}, "2000h:00 on_write = .*: a call returns a generator and runs nothing"),
        ({"on_write": 5}, "2000h:00 on_write = 5: expected a function"),
    ],
    ids=["async def", "generator", "number"],
)
def test_a_function_that_would_not_run_is_refused(hooks: dict[str, Any], text: str) -> None:
    with pytest.raises(EncodeError, match=text):
        Entry(0x2000, 0, "sensor", "u8", **hooks)
    objects = ObjectDictionary([Entry(0x2000, 0, "sensor", "u8")])
    with pytest.raises(EncodeError, match=text):
        objects.hook("sensor", **hooks)
    assert objects.read(0x2000, 0) == b"\0"
