"""The LRC: the bytes and their LRC sum to zero."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.ascii import lrc
from tests.helpers import modest, unhex


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
