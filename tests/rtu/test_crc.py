"""The CRC: definition, table, and crcmod as referee."""

from __future__ import annotations

import crcmod.predefined
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barewire.rtu.crc import crc16, crc16_bit_by_bit
from tests.helpers import modest, unhex

referee = crcmod.predefined.mkCrcFun("modbus")


@modest
@given(st.binary(max_size=256))
def test_the_table_is_the_definition_and_the_referee_agrees(data: bytes) -> None:
    assert crc16(data) == crc16_bit_by_bit(data) == referee(data)


@pytest.mark.parametrize("byte", range(256))
def test_every_entry_of_the_table(byte: int) -> None:
    assert crc16(bytes([byte])) == crc16_bit_by_bit(bytes([byte])) == referee(bytes([byte]))


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
def test_frames_that_are_known(frame: str, crc: str) -> None:
    assert crc16(unhex(frame)).to_bytes(2, "little") == unhex(crc)


@modest
@given(st.binary(max_size=254))
def test_a_frame_with_its_own_crc_leaves_nothing(data: bytes) -> None:
    assert crc16(data + crc16(data).to_bytes(2, "little")) == 0


@modest
@given(st.binary(min_size=2, max_size=256), st.data())
def test_one_wrong_bit_never_passes(body: bytes, data: st.DataObject) -> None:
    frame = bytearray(body + crc16(body).to_bytes(2, "little"))
    bit = data.draw(st.integers(0, 8 * len(frame) - 1))
    frame[bit // 8] ^= 1 << bit % 8
    assert crc16(frame) != 0
