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


@pytest.mark.parametrize("stray", [b"\x00", b"\xff", b"\xff\x00"], ids=["00", "FF", "FF 00"])
def test_a_request_is_taken_where_stray_bytes_come_before_several_frames(stray: bytes) -> None:
    """A master with pauses shorter than `patience`: two stations are turned on before the silence."""
    line = line_of("server")
    others = encode(2, bytes.fromhex("03 0000 0001")), encode(2, bytes.fromhex("03 02 0005"))
    events = [event for at, frame in enumerate((*others, WRITE)) for event in line.feed(stray + frame, 1.0 + at / 100)]
    assert frames_of(events) == []
    assert frames_of(silence(line)) == [decode(frame) for frame in (*others, WRITE)]


def test_no_single_byte_has_the_crc_with_which_a_frame_behind_it_is_good() -> None:
    assert all(crc16(bytes([byte])) != 0xFFFF for byte in range(256))


@pytest.mark.parametrize("role", ["client", "server"])
def test_after_more_bytes_than_a_frame_has_nothing_is_taken_before_the_silence(role: Role) -> None:
    line, frame = line_of(role), INNER if role == "client" else WRITE
    events = line.feed(b"\x01\x41" * 300, 1.0) + line.feed(frame, 1.001) + line.feed(b"\x55" * 300, 1.002)
    assert frames_of(events + silence(line)) == []
    later = line.feed(frame, 2.0)
    assert later == [Adu(1, frame[1:-2])]


@pytest.mark.parametrize("role", ["server", "listener"])
def test_functions_without_a_known_length_are_told_apart_by_their_crcs(role: Role) -> None:
    """A request and its answer with 5 ms between them, which a patient line cannot be sure of."""
    line, request, answer = line_of(role), encode(2, b"\x41\x07"), encode(2, b"\x41\x07\x09")
    events = line.feed(request, 1.0) + line.feed(answer, 1.010)
    assert events == []
    assert silence(line) == [decode(request), decode(answer)]


def test_a_server_hears_its_request_among_functions_without_a_known_length() -> None:
    """Also if the line is never silent."""
    line, other, now = line_of("server"), encode(2, b"\x41\x07"), 1.0
    events = []
    for _ in range(60):
        for data in (other, WRITE):
            now += 0.010
            events += line.feed(data, now)
    events += silence(line)
    assert frames_of(events) == [decode(other), decode(WRITE)] * 60


def test_the_echo_of_a_request_is_passed_over() -> None:
    line = line_of("client")
    echo = line.request(1, bytes.fromhex("03 0012 0001"))
    events = line.feed(echo, 1.0) + line.feed(INNER, 1.01) + silence(line)
    assert frames_of(events) == [decode(INNER)]


def test_the_data_of_a_frame_cannot_pass_for_frames_behind_stray_bytes() -> None:
    """Of a frame with one damaged bit. Its registers are made for that: the CRC before the inner frame is FFFF."""
    head = next(
        head
        for number in range(1 << 16)
        if crc16(head := bytes.fromhex("02 03 0A") + number.to_bytes(2, "big")) == 0xFFFF
    )
    frame = head + encode(1, b"\x06" + bytes(4))
    assert crc16(frame) == 0, "the CRC of the inner frame is that of the outer one, too"
    for bit in range(8 * len(frame)):
        damaged = (int.from_bytes(frame, "big") ^ 1 << bit).to_bytes(len(frame), "big")
        for line in (line_of("client"), line_of("server")):
            assert frames_of(line.feed(damaged, 1.0) + silence(line)) == []
