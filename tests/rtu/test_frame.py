"""Encoding and decoding one whole RTU frame; character times, and the silences t1.5 and t3.5."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.errors import DecodeError, EncodeError
from barewire.modbus import Adu
from barewire.rtu import Timing, character_bits, decode, encode
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


# Times

US = 1e-6


@pytest.mark.parametrize(
    ("baudrate", "bits", "character", "t15", "t35"),
    [
        (1200, 11, 9166.667, 13750.0, 32083.333),
        (9600, 11, 1145.833, 1718.75, 4010.417),
        (9600, 10, 1041.667, 1562.5, 3645.833),
        (19200, 11, 572.917, 859.375, 2005.208),
        (19200, 10, 520.833, 781.25, 1822.917),
        (19201, 11, 572.887, 750.0, 1750.0),
        (38400, 11, 286.458, 750.0, 1750.0),
        (115200, 11, 95.486, 750.0, 1750.0),
        (115200, 10, 86.806, 750.0, 1750.0),
    ],
)
def test_times_follow_the_characters_up_to_19200_and_are_fixed_above(
    baudrate: int, bits: int, character: float, t15: float, t35: float
) -> None:
    timing = Timing.of(baudrate, bits)
    assert timing == pytest.approx((character * US, t15 * US, t35 * US), rel=1e-5)


def test_a_full_frame_takes_as_long_as_its_characters() -> None:
    assert Timing.of(9600).duration(256) == pytest.approx(0.29333, abs=1e-5)
    assert Timing.of(115200).duration(256) == pytest.approx(0.02444, abs=1e-5)
    assert Timing.of(9600).duration(0) == 0.0


@pytest.mark.parametrize("baudrate", [0, -9600])
def test_a_baudrate_that_is_not_positive_is_refused(baudrate: int) -> None:
    with refused(EncodeError, f"baudrate {baudrate}: expected a positive number"):
        Timing.of(baudrate)


@pytest.mark.parametrize("bits", [6, 13])
def test_other_than_7_to_12_bits_per_character_is_refused(bits: int) -> None:
    with refused(EncodeError, f"{bits} bits per character: expected 7..12"):
        Timing.of(9600, bits)


@pytest.mark.parametrize(
    ("data_bits", "parity", "stop_bits", "bits"),
    [(8, "e", 1, 11), (8, "O", 1, 11), (8, "n", 1, 10), (8, "N", 1.5, 11), (7, "N", 2, 10), (8, "E", 2, 12)],
)
def test_the_bits_of_a_character(data_bits: int, parity: str, stop_bits: float, bits: int) -> None:
    assert character_bits(data_bits, parity, stop_bits) == bits
