"""The byte count shows that the end of a frame is missing where the CRC cannot."""

from __future__ import annotations

import pytest

from barewire.modbus import Noise
from barewire.rtu import RtuLine, Timing, crc16, decode, encode
from barewire.rtu.shape import Role, Shape
from tests.helpers import silence, unhex

TIMING = Timing.of(19200)


def ending_with_zero(begin: str, count: int = 1) -> bytes:
    """Return a frame that begins like this, with two more bytes chosen so that its CRC ends with `count` bytes 00."""
    for number in range(0x10000):
        frame = encode(1, unhex(begin) + number.to_bytes(2, "big"))
        if frame[-count:] == bytes(count) and frame[-1 - count]:
            return frame
    raise AssertionError("no such frame among 65536")


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
        "too short to decode with any bytes of the CRC",
        "a wrong byte count",
        "an unknown function, without a known length",
        "query data of one byte",
        "query data of no byte",
        "an exception",
        "a response",
        "two bytes short, and decodable with two of the CRC",
        "a request where a response is expected",
    ],
)
def test_is_whole_with_a_good_crc(role: Role, pdu: str, is_whole: bool) -> None:
    assert Shape(role, (1,)).is_whole(encode(1, unhex(pdu))) is is_whole


def test_a_bad_crc_is_never_whole() -> None:
    shape = Shape("server", (1,))
    frame = encode(1, unhex("03 0000 0001"))
    assert shape.is_whole(frame)
    for place in range(len(frame)):
        assert not shape.is_whole(frame[:place] + bytes([frame[place] ^ 1]) + frame[place + 1 :])
        assert not shape.is_whole(frame[:place])
    assert not shape.is_whole(bytes(300))
