"""What a count tells that no CRC can: that the end of a frame is missing."""

from __future__ import annotations

import pytest

from barewire.modbus import Noise
from barewire.rtu import RtuLine, Timing, crc16, decode, encode
from barewire.rtu.shape import Role, Shape
from tests.helpers import silence, unhex

TIMING = Timing.of(19200)


def ending_with_zero(begin: str, count: int = 1) -> bytes:
    """A frame that begins like this, with two bytes more such that its CRC ends with so many 00."""
    for number in range(0x10000):
        frame = encode(1, unhex(begin) + number.to_bytes(2, "big"))
        if frame[-count:] == bytes(count) and frame[-1 - count]:
            return frame
    raise AssertionError("there is one among 65536")


@pytest.mark.parametrize("strict", [False, True])
@pytest.mark.parametrize(
    ("role", "begin"),
    [("server", "06 0001"), ("server", "10 0001 0001 02"), ("client", "03 02"), ("listener", "06 0001")],
)
def test_a_frame_that_lost_the_00_at_its_end_is_noise(role: Role, begin: str, strict: bool) -> None:
    for count in (1, 2):
        frame = ending_with_zero(begin, count)
        cut = frame[:-count]
        assert crc16(cut) == 0
        line = RtuLine(TIMING, role=role, units=(1,), patience=None if strict else 0.03)
        events = line.feed(cut, 1.0) + silence(line)
        assert events == [
            Noise(cut, "short", f"{len(cut)} bytes, then silence: the last byte is missing, a 00 of the CRC")
        ]
        assert line.feed(frame, 2.0) + silence(line) == [decode(frame)]


@pytest.mark.parametrize(
    ("role", "pdu", "is_whole"),
    [
        ("server", "03 0001", True),
        ("server", "10 0001 0002 05 000A0102", True),
        ("server", "41 01", True),
        ("server", "08 0000 A5", True),
        ("server", "08 0000", True),
        ("client", "83 02", True),
        ("client", "03 02 0001", True),
        ("client", "03 04 0001", False),
        ("client", "07", False),
    ],
    ids=[
        "a count that cannot be made good",
        "a byte count that lies",
        "nobody can count it",
        "query data of one byte",
        "query data of none",
        "an exception",
        "an answer",
        "two bytes short, and readable with them",
        "a request where an answer is awaited",
    ],
)
def test_is_whole_with_a_good_crc(role: Role, pdu: str, is_whole: bool) -> None:
    assert Shape(role, (1,)).is_whole(encode(1, unhex(pdu))) is is_whole


def test_a_bad_crc_is_never_whole() -> None:
    shape = Shape("server", (1,))
    frame = encode(1, unhex("03 0000 0001"))
    assert shape.is_whole(frame)
    for at in range(len(frame)):
        assert not shape.is_whole(frame[:at] + bytes([frame[at] ^ 1]) + frame[at + 1 :])
        assert not shape.is_whole(frame[:at])
    assert not shape.is_whole(bytes(300))
