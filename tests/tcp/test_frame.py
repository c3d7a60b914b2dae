"""Encoding and decoding one whole Modbus TCP frame."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.errors import DecodeError, EncodeError
from barewire.modbus import Adu
from barewire.tcp import decode, encode
from tests.helpers import modest, readable, refused, unhex


@modest
@given(st.integers(0, 255), st.binary(min_size=1, max_size=253), st.integers(0, 0xFFFF))
def test_decode_returns_what_was_encoded(unit: int, pdu: bytes, transaction: int) -> None:
    assert decode(encode(unit, pdu, transaction)) == Adu(unit, pdu, transaction)


@modest
@given(
    st.one_of(
        st.binary(max_size=300),
        st.binary(max_size=300).map(lambda rest: b"\0\1\0\0\0" + rest),
        st.binary(min_size=1, max_size=253).map(lambda pdu: encode(7, pdu, 1)),
    )
)
def test_any_bytes_decode_or_raise_decode_error(data: bytes) -> None:
    adu = readable(decode, data)
    if adu is not None:
        assert encode(adu.unit, adu.pdu, adu.transaction or 0) == data


@pytest.mark.parametrize(
    ("unit", "pdu", "transaction"),
    [(-1, b"\x07", 0), (256, b"\x07", 0), (1, b"", 0), (1, bytes(254), 0), (1, b"\x07", -1), (1, b"\x07", 0x10000)],
)
def test_a_unit_pdu_or_transaction_out_of_range_is_refused(unit: int, pdu: bytes, transaction: int) -> None:
    with refused(EncodeError, "expected"):
        encode(unit, pdu, transaction)


@pytest.mark.parametrize(
    ("data", "reason", "at", "text"),
    [
        ("", "short", 0, "0 of 7 bytes"),
        ("0001 0000 00", "short", 5, "5 of 7 bytes"),
        ("0001 0000 0002", "short", 6, "length 2 promises 8 bytes, got 6"),
        ("0001 0000 0003 01 07", "short", 8, "length 3 promises 9 bytes, got 8"),
        ("0001 0000 0002 01 07 00", "long", 8, "length 2 ends at byte 8, got 9"),
        ("0001 0001 0002 01 07", "protocol", 2, "protocol identifier is 00 01, Modbus has 00 00"),
        (b"SSH-2.0-OpenSSH".hex(), "protocol", 2, "Modbus has 00 00; the other side speaks SSH"),
        (b"HTTP/1.1 400".hex(), "protocol", 2, "the other side speaks HTTP"),
        ("15 03 01 00 02 02 46", "protocol", 2, "the other side speaks TLS"),
        ("0001 0000 0000 01 07", "length", 4, "length is 00 00 (0): expected 2..254"),
        ("0001 0000 0001 01", "length", 4, "length is 00 01 (1): expected 2..254"),
        ("0001 0000 00FF 01 07", "length", 4, "length is 00 FF (255): expected 2..254"),
    ],
)
def test_an_invalid_frame_is_refused_with_reason_and_place(data: str, reason: str, at: int, text: str) -> None:
    with refused(DecodeError, text) as caught:
        decode(unhex(data))
    assert isinstance(caught.value, DecodeError)
    assert (caught.value.reason, caught.value.at) == (reason, at)


def test_the_longest_frame_has_260_bytes() -> None:
    assert len(encode(1, bytes(253))) == 260
