"""Text of a fixed length: padding, encodings, and values that do not fit."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.codecs import Text
from barewire.errors import DecodeError, EncodeError
from tests.helpers import modest, refused


@modest
@given(st.text(st.characters(codec="latin-1"), max_size=12).filter(lambda text: not text.endswith("\0")))
def test_decoded_text_equals_the_encoded_text(text: str) -> None:
    assert Text(12).decode(Text(12).encode(text)) == text


@modest
@given(st.binary(min_size=8, max_size=8))
def test_latin_1_decodes_any_bytes(data: bytes) -> None:
    assert Text(8).decode(data).encode("latin-1").ljust(8, b"\0") == data


def test_the_given_padding_is_used() -> None:
    spaces = Text(6, pad=b" ")
    assert spaces.encode("AZ3") == b"AZ3   "
    assert spaces.decode(b"AZ3   ") == "AZ3"
    assert spaces.decode(b"AZ3 \0\0") == "AZ3"
    assert Text(6).decode(b"AZ3   ") == "AZ3   "


def test_padding_at_the_front_is_kept() -> None:
    assert Text(6).decode(b"\0AZ3\0\0") == "\0AZ3"


def test_text_too_long_is_refused_not_cut() -> None:
    with refused(EncodeError, "'OVERTEMP' takes 8 bytes, there is room for 4"):
        Text(4).encode("OVERTEMP")


def test_length_is_counted_in_bytes() -> None:
    with refused(EncodeError, "'ää' takes 4 bytes, there is room for 3"):
        Text(3, "utf-8").encode("ää")


def test_a_character_outside_the_encoding_is_named() -> None:
    with refused(EncodeError, "character '€' of '12 €' is not in latin-1"):
        Text(8).encode("12 €")


def test_bytes_outside_the_encoding_are_refused_with_their_place() -> None:
    with refused(DecodeError, "not ascii text") as caught:
        Text(4, "ascii").decode(b"AB\xff\0")
    assert isinstance(caught.value, DecodeError)
    assert (caught.value.reason, caught.value.at) == ("character", 2)


@pytest.mark.parametrize("value", [7, 1.5, b"AZ3", True])
def test_a_value_that_is_not_text_is_refused(value: float | bytes) -> None:
    with refused(EncodeError, f"{value!r} is not text"):
        Text(4).encode(value)


@pytest.mark.parametrize(("length", "reason"), [(3, "short"), (5, "long"), (0, "short")])
def test_a_wrong_number_of_bytes_is_refused(length: int, reason: str) -> None:
    with refused(DecodeError, f"text takes 4 bytes, got {length}") as caught:
        Text(4).decode(bytes(length))
    assert isinstance(caught.value, DecodeError)
    assert caught.value.reason == reason


@pytest.mark.parametrize(("size", "pad"), [(0, b"\0"), (-1, b"\0"), (4, b""), (4, b"ab")])
def test_a_text_codec_without_room_or_padding_is_refused(size: int, pad: bytes) -> None:
    with refused(EncodeError, "expected 1 byte or more, and one byte of padding"):
        Text(size, pad=pad)
