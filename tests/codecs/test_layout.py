"""Layouts, which pack, unpack, measure and explain named fields; and bit patterns."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.codecs import BitPattern, Field, Layout
from barewire.errors import DecodeError, EncodeError
from tests.helpers import every_case, modest, refused, unhex

FIXED = Layout(">BHH", "function_code", "address", "quantity")
COUNTED = Layout(">BHB", "function_code", "address", "byte_count", tail="data", count="byte_count")
OPEN = Layout(">B", "function_code", tail="data")


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ((256, 0, 0), "function_code = 256: expected a whole number in 0..255"),
        ((3, -1, 0), "address = -1: expected a whole number in 0..65535"),
        ((3, 0, 65536), "quantity = 65536: expected a whole number in 0..65535"),
        ((3, 1.5, 0), "address = 1.5: expected a whole number in 0..65535"),
    ],
)
def test_a_value_that_does_not_fit_is_named(values: tuple[int, ...], text: str) -> None:
    with refused(EncodeError, text):
        FIXED.pack(*values)


@pytest.mark.parametrize(
    ("length", "text"),
    [
        (0, "function_code is byte 0, but there are only 0"),
        (1, "address needs bytes 1..2, but there are only 1"),
        (2, "address needs bytes 1..2, but there are only 2"),
        (4, "quantity needs bytes 3..4, but there are only 4"),
    ],
)
def test_short_data_is_refused_with_the_incomplete_field(length: int, text: str) -> None:
    with refused(DecodeError, text) as caught:
        FIXED.unpack(unhex("03006B0003")[:length])
    assert isinstance(caught.value, DecodeError)
    assert (caught.value.reason, caught.value.at) == ("short", length)


def test_long_data_is_refused_at_the_first_extra_byte() -> None:
    with refused(DecodeError, "2 bytes are left over behind quantity") as caught:
        FIXED.unpack(unhex("03006B0003 FFFF"))
    assert isinstance(caught.value, DecodeError)
    assert (caught.value.reason, caught.value.at) == ("long", 5)


@pytest.mark.parametrize("data", ["10 0001 02 AA", "10 0001 02 AABBCC", "10 0001 02"])
def test_a_wrong_count_is_refused_at_the_count_field(data: str) -> None:
    there = len(unhex(data)) - 4
    with refused(DecodeError, f"byte_count is 2, but {there} bytes of data follow") as caught:
        COUNTED.unpack(unhex(data))
    assert isinstance(caught.value, DecodeError)
    assert (caught.value.reason, caught.value.at) == ("length", 3)


def test_a_tail_without_count_takes_all_remaining_bytes() -> None:
    assert OPEN.unpack(unhex("41")) == (0x41, b"")
    assert OPEN.unpack(unhex("41 0102")) == (0x41, b"\x01\x02")
    assert OPEN.measure(unhex("41 0102")) is None


def test_a_measured_length_without_a_count_does_not_depend_on_the_bytes() -> None:
    assert {FIXED.measure(bytes(length)) for length in range(9)} == {5}


def test_a_measured_length_grows_once_when_the_count_has_arrived() -> None:
    whole = unhex("10 0001 04 01020304")
    assert [COUNTED.measure(whole[:length]) for length in range(9)] == [4, 4, 4, 4, 8, 8, 8, 8, 8]


@modest
@given(st.integers(0, 255), st.integers(0, 0xFFFF), st.binary(max_size=255))
def test_packed_values_are_unpacked_measured_and_covered_by_fields(code: int, address: int, tail: bytes) -> None:
    data = COUNTED.pack(code, address, len(tail), tail=tail)
    assert COUNTED.unpack(data) == (code, address, len(tail), tail)
    assert COUNTED.measure(data) == len(data)
    places = [place for field in COUNTED.fields(data) for place in range(field.offset, field.offset + field.length)]
    assert places == list(range(len(data)))


def test_fields_go_as_far_as_the_bytes() -> None:
    assert [field.name for field in COUNTED.fields(unhex("10 0001"))] == ["function_code", "address"]
    assert COUNTED.fields(b"") == []


def test_field_offsets_may_begin_at_another_number() -> None:
    assert FIXED.fields(unhex("03 006B"), at=7) == [Field(7, 1, "function_code", 3), Field(8, 2, "address", 0x6B)]


def test_a_little_endian_layout_reads_its_fields_as_it_packs_them() -> None:
    little = Layout("<BHB", "command", "index", "byte_count", tail="data", count="byte_count")
    data = little.pack(0x40, 0x6041, 2, tail=b"\x37\x06")
    assert data == unhex("40 41 60 02 37 06")
    assert little.unpack(data)[1] == 0x6041
    assert little.fields(data)[1] == Field(1, 2, "index", 0x6041)


def test_a_little_endian_count_is_measured_as_such() -> None:
    counted = Layout("<H", "byte_count", tail="data", count="byte_count")
    assert counted.measure(unhex("04 00")) == 6


# Bit patterns ----------------------------------------------------------------------------------------------------

INITIATED = BitPattern("010- nnes")


@every_case("byte", range(256))
def test_a_pattern_matches_a_byte_exactly_if_its_fixed_bits_match(byte: int) -> None:
    right = byte >> 5 == 0b010
    assert INITIATED.matches(byte) is right
    if right:
        fields = {"n": byte >> 2 & 3, "e": byte >> 1 & 1, "s": byte & 1}
        assert INITIATED.decode(byte) == fields
        assert INITIATED.encode(**fields) == byte & ~0x10  # the reserved bit is read, never written
    else:
        with refused(DecodeError, f"{byte:02X}h is not 010- nnes") as caught:
            INITIATED.decode(byte)
        assert isinstance(caught.value, DecodeError)
        assert caught.value.reason == "function"


def test_fields_not_given_are_zero() -> None:
    assert INITIATED.encode() == 0x40


@pytest.mark.parametrize(("letter", "value", "limit"), [("n", 4, 3), ("n", -1, 3), ("s", 2, 1)])
def test_a_field_that_does_not_fit_is_named(letter: str, value: int, limit: int) -> None:
    with refused(EncodeError, f"{letter} = {value}: expected 0..{limit}"):
        INITIATED.encode(**{letter: value})


def test_an_unknown_letter_is_named() -> None:
    with refused(EncodeError, "'010- nnes' has no field 't'"):
        INITIATED.encode(t=1)


@pytest.mark.parametrize("pattern", ["", "010", "010- nnes0"])
def test_a_pattern_has_eight_places(pattern: str) -> None:
    with refused(EncodeError, "expected 8 places"):
        BitPattern(pattern)


def test_the_bits_of_a_field_lie_together() -> None:
    with refused(EncodeError, "the bits of 'n' do not lie together"):
        BitPattern("010n 0n00")
