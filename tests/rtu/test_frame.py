"""Encoding and decoding one whole RTU frame."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.errors import DecodeError, EncodeError
from barewire.modbus import Adu
from barewire.rtu import decode, encode
from tests.helpers import modest, readable, refused, unhex


@modest
@given(st.integers(0, 255), st.binary(min_size=1, max_size=253))
def test_decode_returns_what_was_encoded(unit: int, pdu: bytes) -> None:
    assert decode(encode(unit, pdu)) == Adu(unit, pdu)
    assert len(encode(unit, pdu)) == len(pdu) + 3


@modest
@given(st.one_of(st.binary(max_size=300), st.binary(min_size=1, max_size=253).map(lambda pdu: encode(7, pdu))))
def test_any_bytes_decode_or_raise_decode_error(data: bytes) -> None:
    adu = readable(decode, data)
    if adu is not None:
        assert encode(adu.unit, adu.pdu) == data


@pytest.mark.parametrize("unit", [-1, 256])
def test_a_unit_outside_one_byte_is_refused(unit: int) -> None:
    with refused(EncodeError, f"unit {unit}: expected 0..255"):
        encode(unit, b"\x07")


@pytest.mark.parametrize("length", [0, 254])
def test_a_pdu_of_other_than_1_to_253_bytes_is_refused(length: int) -> None:
    with refused(EncodeError, f"a PDU of {length} bytes: expected 1..253"):
        encode(1, bytes(length))


@pytest.mark.parametrize(
    ("data", "reason", "at", "text"),
    [
        (b"", "short", 0, "an RTU frame has at least 4 bytes, got 0"),
        (b"\x01\x07\x41", "short", 3, "an RTU frame has at least 4 bytes, got 3"),
        (bytes(257), "long", 256, "an RTU frame has at most 256 bytes, got 257"),
        (unhex("01 83 02 F1 C0"), "checksum", 3, "CRC is F1 C0, should be C0 F1"),
    ],
)
def test_an_invalid_frame_is_refused_with_reason_and_place(data: bytes, reason: str, at: int, text: str) -> None:
    with refused(DecodeError, text) as caught:
        decode(data)
    assert isinstance(caught.value, DecodeError)
    assert (caught.value.reason, caught.value.at) == (reason, at)
