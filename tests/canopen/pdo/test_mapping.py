"""PDO mapping: which bits of a frame are which object."""

from __future__ import annotations

import pytest
from hypothesis import given, settings, strategies as st

from barewire.canopen import MappedObject, PdoMapping
from barewire.codecs import Value
from barewire.errors import DecodeError, EncodeError


def row(*entries: tuple[str | None, int]) -> PdoMapping:
    """Return a mapping of invented objects called a, b, c ..., each (type, bits)."""
    return PdoMapping(
        MappedObject(0x2000 + place, 0, bits, type_, "abcdefgh"[place]) for place, (type_, bits) in enumerate(entries)
    )


@pytest.mark.parametrize(
    ("entries", "values", "data"),
    [
        ([("u8", 4), ("u8", 8), ("u8", 4)], [5, 0xAB, 0xC], "B5 CA"),
        ([("bool", 1), ("bool", 1), ("u16", 16)], [True, False, 0x1234], "D1 48 00"),
        ([("i8", 4), ("u8", 8), ("u8", 4)], [-8, 0x11, 7], "18 71"),
        ([("u32", 20), ("u16", 12)], [0x12345, 0x678], "45 23 81 67"),
        ([("i24", 24), ("u8", 8)], [-1, 1], "FF FF FF 01"),
        ([("u40", 40), ("u24", 24)], [0x123456789A, 0xFFFFFF], "9A 78 56 34 12 FF FF FF"),
        ([("u8", 8), ("u16", 16), ("i32", 32)], [0x0F, 0x6041, -100000], "0F 41 60 60 79 FE FF"),
        ([("f64", 64)], [1.5], "00 00 00 00 00 00 F8 3F"),
        ([("bool", 1), ("f32", 32)], [True, 1.1], "9B 99 19 7F 00"),
        ([("string", 24), ("u8", 8)], [b"AZ3", 1], "41 5A 33 01"),
        ([("u64", 64)], [2**64 - 1], "FF FF FF FF FF FF FF FF"),
        ([("u8", 3)], [5], "05"),
        ([], [], ""),
    ],
)
def test_pack_and_unpack(entries: list[tuple[str, int]], values: list[Value], data: str) -> None:
    mapping = row(*entries)
    named = dict(zip("abcdefgh", values))
    assert mapping.pack(named) == bytes.fromhex(data)
    assert mapping.unpack(bytes.fromhex(data)) == {
        name: pytest.approx(value, rel=1e-6) if isinstance(value, float) else value for name, value in named.items()
    }


CONTROL = MappedObject(0x6040, 0, 16, "u16", "controlword")
STATUS = MappedObject(0x6041, 0, 16, "u16", "statusword")
ERROR = MappedObject(0x2069, 0, 16, "u16", "error")


# The factory settings of the AZ3, guide 4.5.1.
@pytest.mark.parametrize(
    ("entries", "values", "data"),
    [
        ((CONTROL, MappedObject(0x60FF, 0, 32, "i32", "x")), (15, -25000), "0F 00 58 9E FF FF"),
        ((CONTROL, MappedObject(0x607A, 0, 32, "i32", "x")), (31, 25000), "1F 00 A8 61 00 00"),
        ((CONTROL, MappedObject(0x206A, 1, 32, "f32", "x")), (15, 1.5), "0F 00 00 00 C0 3F"),
        ((CONTROL, MappedObject(0x6071, 0, 16, "i16", "x")), (15, -5), "0F 00 FB FF"),
        (
            (
                STATUS,
                MappedObject(0x2005, 0, 16, "i16", "v"),
                MappedObject(0x2002, 0, 16, "i16", "i"),
                MappedObject(0x2006, 0, 16, "i16", "p"),
            ),
            (0x0637, -1000, 25, 1),
            "37 06 18 FC 19 00 01 00",
        ),
        ((STATUS, MappedObject(0x6064, 0, 32, "i32", "x"), ERROR), (0x0637, -2, 3), "37 06 FE FF FF FF 03 00"),
        ((STATUS, MappedObject(0x606C, 0, 32, "i32", "x"), ERROR), (0x0637, 25000, 0), "37 06 A8 61 00 00 00 00"),
        ((STATUS, MappedObject(0x6077, 0, 16, "i16", "x"), ERROR), (0x0637, -5, 0), "37 06 FB FF 00 00"),
    ],
)
def test_the_eight_pdos_of_the_az3(entries: tuple[MappedObject, ...], values: tuple[Value, ...], data: str) -> None:
    mapping = PdoMapping(entries)
    named = dict(zip((entry.name for entry in entries), values))
    assert mapping.pack(named) == bytes.fromhex(data)
    assert mapping.unpack(bytes.fromhex(data)) == named


def test_mapping_entries_as_32_bit_words() -> None:
    # The eight PDOs again as the guide prints them: index, sub-index, bits in hexadecimal.
    assert CONTROL.word == 0x60400010
    assert MappedObject.of_word(0x206A0120, "f32") == MappedObject(0x206A, 1, 32, "f32")


def test_dummies_and_unknown_objects_never_move_an_offset() -> None:
    mapping = PdoMapping([MappedObject(0x0005, 0, 8), MappedObject(0x2ABC, 3, 4), MappedObject(0x0001, 0, 4), STATUS])
    assert mapping.unpack(bytes.fromhex("FF A5 37 06")) == {"2ABCh:03": 5, "statusword": 0x0637}
    assert mapping.pack({"statusword": 0x0637}) == bytes.fromhex("00 00 37 06")
    assert mapping.pack({"2ABCh:03": 15}) == bytes.fromhex("00 0F 00 00")
    whole_bytes = PdoMapping([MappedObject(0x0006, 0, 16), STATUS])
    assert whole_bytes.unpack(bytes.fromhex("FFFF 3706")) == {"statusword": 0x0637}
    assert whole_bytes.pack({"statusword": 0x0637}) == bytes.fromhex("0000 3706")


def test_64_entries_of_one_bit() -> None:
    mapping = PdoMapping(MappedObject(0x2000, sub, 1, "bool") for sub in range(64))
    values: dict[str, Value] = {f"2000h:{sub:02X}": sub % 3 == 0 for sub in range(64)}
    assert mapping.unpack(mapping.pack(values)) == values


def test_the_same_object_twice_is_one_value() -> None:
    mapping = PdoMapping([STATUS, STATUS])
    assert mapping.pack({"statusword": 1}) == bytes.fromhex("0100 0100")
    assert mapping.unpack(bytes.fromhex("0100 0100")) == {"statusword": 1}


@pytest.mark.parametrize(
    ("entries", "text"),
    [
        ([MappedObject(0x2000, sub, 1) for sub in range(65)], "at most 64"),
        ([MappedObject(0x2000, 0, 64), MappedObject(0x2001, 0, 1)], "65 bits"),
        ([MappedObject(0x2000, 0, 0)], "expected 1..64"),
        ([MappedObject(0x2000, 0, 16, "f32")], "expected 32"),
        ([MappedObject(0x2000, 0, 17, "u16")], "at most 16"),
        ([MappedObject(0x2000, 0, 12, "string")], "whole bytes"),
        ([MappedObject(0x2000, 0, 8, "u9")], "type 'u9'"),
        ([MappedObject(0x2000, 0, 8, "u8", "a"), MappedObject(0x2001, 0, 8, "u8", "a")], "called 'a'"),
    ],
)
def test_impossible_mappings_raise(entries: list[MappedObject], text: str) -> None:
    with pytest.raises(EncodeError, match=text):
        PdoMapping(entries)


@pytest.mark.parametrize(
    ("type_", "bits", "value"),
    [
        ("u16", 16, 65536),
        ("u16", 16, -1),
        ("i8", 4, 8),
        ("i8", 4, -9),
        ("bool", 1, 2),
        ("u8", 8, 1.5),
        ("u8", 8, "1"),
        ("u16", 12, float("inf")),
        ("f32", 32, 1e39),
        ("string", 16, "abc"),
        ("string", 16, 5),
    ],
)
def test_values_that_do_not_fit_name_their_object(type_: str, bits: int, value: Value) -> None:
    with pytest.raises(EncodeError):
        row((type_, bits)).pack({"a": value})


def test_an_unknown_name_raises() -> None:
    with pytest.raises(EncodeError, match="'b' is not in this PDO: it has a"):
        row(("u8", 8)).pack({"a": 1, "b": 2})
    with pytest.raises(EncodeError, match="it has nothing"):
        PdoMapping([]).pack({"b": 2})


def test_data_of_another_length_raises() -> None:
    for data, reason, at in ((b"\1", "short", 1), (b"\1\2\3", "long", 2)):
        with pytest.raises(DecodeError) as caught:
            row(("u16", 16)).unpack(data)
        assert (caught.value.reason, caught.value.at) == (reason, at)


@settings(max_examples=60)
@given(st.data())
def test_unpack_inverts_pack(data: st.DataObject) -> None:
    entries, values, used = [], {}, 0
    for place in range(data.draw(st.integers(1, 12))):
        bits = data.draw(st.integers(1, 16))
        if used + bits > 64:
            break
        used += bits
        signed = data.draw(st.booleans())
        mapped = MappedObject(0x2000 + place, 0, bits, "i16" if signed else "u16")
        low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
        entries.append(mapped)
        values[mapped.name] = data.draw(st.integers(low, high))
    mapping = PdoMapping(entries)
    packed = mapping.pack(dict(values))
    assert len(packed) == (used + 7) // 8
    assert mapping.unpack(packed) == values
