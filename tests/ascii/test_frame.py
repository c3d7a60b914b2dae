"""Encoding and decoding one whole ASCII frame, and its LRC."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.ascii import decode, encode, lrc
from barewire.errors import DecodeError, EncodeError
from barewire.modbus import Adu
from tests.helpers import every_case, modest, readable, refused, unhex


@modest
@given(st.integers(0, 255), st.binary(min_size=1, max_size=253))
def test_decode_returns_what_was_encoded_in_upper_and_lower_case(unit: int, pdu: bytes) -> None:
    frame = encode(unit, pdu)
    assert frame == frame.upper()
    assert decode(frame) == decode(frame.lower()) == Adu(unit, pdu)
    assert len(frame) == 2 * len(pdu) + 7


@modest
@given(
    st.one_of(
        st.binary(max_size=20),
        st.text(":0123456789ABCDEFabcdef\r\n", max_size=20).map(str.encode),
        st.binary(min_size=1, max_size=253).map(lambda pdu: encode(7, pdu).lower()),
    )
)
def test_any_characters_decode_or_raise_decode_error(data: bytes) -> None:
    adu = readable(decode, data)
    if adu is not None:
        assert encode(adu.unit, adu.pdu) == data.upper()


def test_the_longest_frame_has_513_characters() -> None:
    assert len(encode(1, bytes(253))) == 513


@pytest.mark.parametrize(("unit", "pdu"), [(-1, b"\x07"), (256, b"\x07"), (1, b""), (1, bytes(254))])
def test_a_unit_or_pdu_out_of_range_is_refused(unit: int, pdu: bytes) -> None:
    with refused(EncodeError, "expected"):
        encode(unit, pdu)


@every_case(
    ("data", "reason", "at", "text"),
    [
        (b"", "delimiter", 0, "begins with ':'"),
        (b"0107F8\r\n", "delimiter", 0, "begins with ':'"),
        (b":", "delimiter", 1, "ends with CR LF"),
        (b":0107F8", "delimiter", 5, "ends with CR LF"),
        (b":0107F8\n", "delimiter", 6, "ends with CR LF"),
        (b":0107F8\r", "delimiter", 6, "ends with CR LF"),
        (b":0107F8\n\r", "delimiter", 7, "ends with CR LF"),
        (b":01g7F8\r\n", "character", 3, "'g' is not a hexadecimal digit"),
        (b":01\x007F8\r\n", "character", 3, "00h is not a hexadecimal digit"),
        (b":01\xb17F8\r\n", "character", 3, "B1h is not a hexadecimal digit"),
        (b":01 7F8\r\n", "character", 3, "' ' is not a hexadecimal digit"),
        (b":\r\n", "short", 3, "at least 9 characters, got 3"),
        (b":01FF\r\n", "short", 7, "at least 9 characters, got 7"),
        (b":0107F\r\n", "short", 8, "at least 9 characters, got 8"),
        (b":0107F80\r\n", "short", 8, "7 digits: the last byte has only one"),
        (b":" + b"0" * 512 + b"\r\n", "long", 513, "at most 513 characters, got 515"),
        (b":0107F9\r\n", "checksum", 5, "LRC is F9, should be F8"),
    ],
)
def test_an_invalid_frame_is_refused_with_reason_and_place(data: bytes, reason: str, at: int, text: str) -> None:
    with refused(DecodeError, text) as caught:
        decode(data)
    assert isinstance(caught.value, DecodeError)
    assert (caught.value.reason, caught.value.at) == (reason, at)


def test_a_known_frame() -> None:
    assert encode(17, unhex("03 006B 0003")) == b":1103006B00037E\r\n"


# The LRC ---------------------------------------------------------------------------------------------------------


@modest
@given(st.binary(max_size=255))
def test_the_bytes_and_their_lrc_sum_to_zero(data: bytes) -> None:
    assert 0 <= lrc(data) <= 0xFF
    assert (sum(data) + lrc(data)) & 0xFF == 0


@pytest.mark.parametrize(
    ("data", "right"),
    [
        ("02 07", 0xF7),
        ("01 03 00 00 00 01", 0xFB),
        ("11 03 00 6B 00 03", 0x7E),
        ("01 83 02", 0x7A),
        ("01 08 00 00 A5 37", 0x1B),
        ("", 0x00),
        ("FF", 0x01),
        ("80 80", 0x00),
    ],
)
def test_published_frames_have_this_checksum(data: str, right: int) -> None:
    assert lrc(unhex(data)) == right
