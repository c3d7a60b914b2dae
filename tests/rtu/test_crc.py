"""The CRC: the definition and its two faster forms, compared with crcmod."""

from __future__ import annotations

from collections.abc import Callable

import crcmod.predefined
import pytest
from hypothesis import given, strategies as st

from barewire.rtu.crc import crc16, crc16_bit_by_bit, crc16_folded, crc16_table
from tests.helpers import modest, unhex

reference = crcmod.predefined.mkCrcFun("modbus")


Form = Callable[[bytes | bytearray], int]
FORMS: list[Form] = [crc16, crc16_bit_by_bit, crc16_table, crc16_folded]


@pytest.mark.parametrize("form", FORMS)
@modest
@given(st.binary(max_size=256))
def test_each_form_equals_crcmod(form: Form, data: bytes) -> None:
    assert form(data) == reference(data)


@pytest.mark.parametrize("form", FORMS)
def test_each_form_accepts_every_byte_and_every_length(form: Form) -> None:
    for byte in range(256):
        assert form(bytes([byte])) == reference(bytes([byte]))
    for length in range(601):
        row = bytes((37 * place + length) & 0xFF for place in range(length))
        for data in (row, bytes(length), b"\xff" * length):
            assert form(data) == form(bytearray(data)) == reference(data)


@modest
@given(
    st.integers(601, 20_000).flatmap(
        lambda length: st.randoms(use_true_random=False).map(lambda r: r.randbytes(length))
    )
)
def test_folding_equals_the_table_beyond_the_longest_frame(data: bytes) -> None:
    assert crc16(data) == crc16_folded(data) == crc16_bit_by_bit(data) == crc16_table(data) == reference(data)


@pytest.mark.parametrize("length", [0xFFFF, 0x10000, 0x10001, 0x20003])
def test_folding_accepts_more_than_a_block(length: int) -> None:
    data = bytes(range(251)) * (length // 251 + 1)
    assert crc16_folded(data[:length]) == crc16_table(data[:length]) == reference(data[:length])


@pytest.mark.parametrize(
    ("frame", "crc"),
    [
        ("02 07", "41 12"),
        ("01 03 00 00 00 01", "84 0A"),
        ("11 03 00 6B 00 03", "76 87"),
        ("01 83 02", "C0 F1"),
        ("01 08 00 00 A5 37", "DA 8D"),
        ("00 06 00 00 12 34", "85 6C"),
        ("01 2B 0E 01 00", "70 77"),
        ("", "FF FF"),
    ],
)
def test_published_frames_have_this_checksum(frame: str, crc: str) -> None:
    assert crc16(unhex(frame)).to_bytes(2, "little") == unhex(crc)


@modest
@given(st.binary(max_size=254))
def test_the_crc_of_a_frame_with_its_crc_is_zero(data: bytes) -> None:
    assert crc16(data + crc16(data).to_bytes(2, "little")) == 0


@modest
@given(st.binary(min_size=2, max_size=256), st.data())
def test_every_single_bit_error_is_detected(body: bytes, data: st.DataObject) -> None:
    frame = bytearray(body + crc16(body).to_bytes(2, "little"))
    bit = data.draw(st.integers(0, 8 * len(frame) - 1))
    frame[bit // 8] ^= 1 << bit % 8
    assert crc16(frame) != 0
