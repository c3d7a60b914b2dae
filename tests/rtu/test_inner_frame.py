"""A damaged frame whose data spell another whole frame: a client or server takes nothing of it before the silence."""

from __future__ import annotations

import pytest

from barewire.modbus import Adu
from barewire.rtu import RtuLine, Timing, decode, encode
from barewire.rtu.crc import crc16
from barewire.rtu.shape import Role
from tests.helpers import frames_of, silence

TIMING = Timing.of(19200)
INNER = encode(1, bytes.fromhex("0302 0063"))
WRITE = encode(1, bytes.fromhex("06 0001 0063"))


def line_of(role: Role) -> RtuLine:
    return RtuLine(TIMING, role=role, units=(1,) if role == "server" else ())


def outer(inner: bytes) -> bytes:
    data = inner + bytes(len(inner) % 2)
    return encode(2, bytes([3, len(data)]) + data)


@pytest.mark.parametrize(("role", "inner"), [("client", INNER), ("server", WRITE)])
def test_no_single_damaged_bit_or_lost_byte_delivers_the_inner_frame(role: Role, inner: bytes) -> None:
    frame = outer(inner)
    flipped = [(int.from_bytes(frame, "big") ^ 1 << bit).to_bytes(len(frame), "big") for bit in range(8 * len(frame))]
    lost = [frame[:at] + frame[at + 1 :] for at in range(len(frame))]
    for damaged in flipped + lost:
        for cut in range(len(damaged)):
            line = line_of(role)
            events = line.feed(damaged[:cut], 1.0) + line.feed(damaged[cut:], 1.016) + silence(line)
            assert decode(inner) not in frames_of(events), (damaged.hex(" "), cut)


@pytest.mark.parametrize("role", ["client", "server"])
@pytest.mark.parametrize("stray", [b"\x00", b"\xff"])
def test_a_frame_behind_one_stray_byte_is_taken_at_the_silence(role: Role, stray: bytes) -> None:
    frame = INNER if role == "client" else WRITE
    line = line_of(role)
    assert line.feed(stray + frame, 1.0) == []
    assert frames_of(silence(line)) == [decode(frame)]


def test_no_single_byte_has_the_crc_with_which_a_frame_behind_it_is_good() -> None:
    assert all(crc16(bytes([byte])) != 0xFFFF for byte in range(256))


@pytest.mark.parametrize("role", ["client", "server"])
def test_after_more_bytes_than_a_frame_has_nothing_is_taken_before_the_silence(role: Role) -> None:
    line, frame = line_of(role), INNER if role == "client" else WRITE
    events = line.feed(b"\x01\x41" * 300, 1.0) + line.feed(frame, 1.001) + line.feed(b"\x55" * 300, 1.002)
    assert frames_of(events + silence(line)) == []
    later = line.feed(frame, 2.0)
    assert later == [Adu(1, frame[1:-2])]
