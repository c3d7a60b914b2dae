"""Bits of a word, halves of a register, packed rows."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.codecs import get_bit, get_field, get_half, pack_bits, set_bit, set_field, set_half, unpack_bits
from barewire.codecs.bits import Half
from barewire.errors import DecodeError, EncodeError
from tests.helpers import modest, refused, unhex


@pytest.mark.parametrize("width", [8, 16, 32])
def test_each_bit_is_set_and_cleared_alone(width: int) -> None:
    full = (1 << width) - 1
    for bit in range(width):
        assert set_bit(0, bit, True, width) == 1 << bit
        assert set_bit(full, bit, False, width) == full ^ 1 << bit
        assert [get_bit(1 << bit, place, width) for place in range(width)] == [place == bit for place in range(width)]


@pytest.mark.parametrize(("bit", "width"), [(-1, 16), (16, 16), (8, 8), (32, 32)])
def test_a_bit_that_does_not_exist_is_refused(bit: int, width: int) -> None:
    text = f"bit {bit} does not exist in {width} bits: expected 0..{width - 1}"
    with refused(EncodeError, text):
        get_bit(0, bit, width)
    with refused(EncodeError, text):
        set_bit(0, bit, True, width)


@modest
@given(st.integers(0, 0xFFFF), st.integers(0, 0xFF), st.sampled_from(["L", "H"]))
def test_a_half_is_changed_and_the_other_kept(word: int, value: int, half: Half) -> None:
    other: Half = "H" if half == "L" else "L"
    changed = set_half(word, half, value)
    assert get_half(changed, half) == value
    assert get_half(changed, other) == get_half(word, other)


@pytest.mark.parametrize("value", [-1, 256])
def test_a_value_too_large_for_half_a_register_is_refused(value: int) -> None:
    with refused(EncodeError, f"{value} does not fit half a register: expected 0..255"):
        set_half(0, "L", value)


def test_an_unknown_half_is_refused() -> None:
    text = "half 'M': expected L (low byte) or H (high byte)"
    with refused(EncodeError, text):
        get_half(0, "M")  # type: ignore[arg-type]
    with refused(EncodeError, text):
        set_half(0, "M", 0)  # type: ignore[arg-type]


@modest
@given(st.lists(st.booleans(), max_size=2000))
def test_unpacked_bits_equal_the_packed_bits(bits: list[bool]) -> None:
    packed = pack_bits(bits)
    assert len(packed) == (len(bits) + 7) // 8
    assert list(unpack_bits(packed, len(bits))) == bits
    assert not any(unpack_bits(packed)[len(bits) :])


@pytest.mark.parametrize(
    ("bits", "packed"),
    [("", ""), ("1", "01"), ("00000001", "80"), ("000000001", "00 01"), ("1011001111010110101", "CD 6B 05")],
)
def test_the_first_bit_is_the_lowest_of_the_first_byte(bits: str, packed: str) -> None:
    row = [int(bit) for bit in bits]
    assert pack_bits(row) == unhex(packed)
    assert unpack_bits(unhex(packed), len(row)) == tuple(map(bool, row))


def test_more_bits_than_the_bytes_hold_is_short() -> None:
    with refused(DecodeError, "9 bits do not fit into 1 bytes") as caught:
        unpack_bits(b"\xff", 9)
    assert isinstance(caught.value, DecodeError)
    assert (caught.value.reason, caught.value.at) == ("short", 1)


@modest
@given(st.integers(0, 0xFFFF), st.integers(0, 15), st.integers(1, 16), st.integers(0, 0xFFFF))
def test_a_field_is_changed_and_its_neighbours_are_kept(word: int, low: int, bits: int, value: int) -> None:
    bits = min(bits, 16 - low)
    value &= (1 << bits) - 1
    changed = set_field(word, low, bits, value)
    assert get_field(changed, low, bits) == value
    assert set_field(changed, low, bits, get_field(word, low, bits)) == word


@pytest.mark.parametrize(("low", "bits"), [(-1, 2), (15, 2), (0, 17), (3, 0)])
def test_a_field_outside_the_word_is_refused(low: int, bits: int) -> None:
    with pytest.raises(EncodeError, match="do not exist in 16 bits"):
        get_field(0, low, bits)


def test_a_number_too_large_for_its_field_is_refused() -> None:
    with pytest.raises(EncodeError, match=r"9 does not fit 3 bits: expected 0\.\.7"):
        set_field(0, 4, 3, 9)
