"""The framing of an RTU line by count, CRC and silence, with the default pauses and the strict ones.

Where equality matters, times are powers of two: one character takes 1/2048 s, so that sums are exact.
"""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given, strategies as st

from barewire.errors import EncodeError
from barewire.modbus import Adu, Noise
from barewire.modbus.messages.registry import measure_request
from barewire.rtu import RtuLine, Timing, crc16, decode, encode
from barewire.rtu.shape import Role
from tests.helpers import (
    Chunk,
    accounts_for_every_byte,
    chunked,
    deliveries,
    every_case,
    feed_all,
    frames_of,
    modest,
    noise_of,
    refused,
    silence,
    spaced,
    unhex,
)

CHARACTER = 1 / 2048
EXACT = Timing(CHARACTER, 1.5 * CHARACTER, 3.5 * CHARACTER)
PATIENCE = 1 / 32

REQUESTS = {
    "read coils": encode(1, unhex("01 0013 0013")),
    "read inputs": encode(1, unhex("02 00C4 0016")),
    "read registers": encode(1, unhex("03 006B 0003")),
    "write coil": encode(1, unhex("05 00AC FF00")),
    "write register": encode(1, unhex("06 0001 0003")),
    "exception status": encode(1, unhex("07")),
    "write coils": encode(1, unhex("0F 0013 000A 02 CD01")),
    "write registers": encode(1, unhex("10 0001 0002 04 000A0102")),
    "server id": encode(1, unhex("11")),
    "identification": encode(1, unhex("2B 0E 01 00")),
    "the longest": encode(1, unhex("10 0000 007B F6") + bytes(range(246))),
}
RESPONSES = {
    "coils": encode(1, unhex("01 03 CD6B05")),
    "registers": encode(1, unhex("03 06 022B 0000 0064")),
    "input register": encode(1, unhex("04 02 000A")),
    "coil written": encode(1, unhex("05 00AC FF00")),
    "exception status": encode(1, unhex("07 6D")),
    "registers written": encode(1, unhex("10 0001 0002")),
    "server id": encode(1, unhex("11 03 01 FF 41")),
    "identification": encode(1, unhex("2B 0E 01 01 00 00 02 00 03 54454D 01 03 415A33")),
    "exception": encode(1, unhex("83 02")),
    "the longest": encode(1, unhex("03 FA") + bytes(range(250))),
}
RECEIVED_BY: list[tuple[Role, dict[str, bytes]]] = [
    ("client", RESPONSES),
    ("server", REQUESTS),
    ("listener", REQUESTS),
    ("listener", RESPONSES),
]
RECEIVED = [
    pytest.param(role, frame, id=f"{role}-{name}") for role, table in RECEIVED_BY for name, frame in table.items()
]


def line_of(role: Role = "client", *, strict: bool = False, units: tuple[int, ...] = ()) -> RtuLine:
    return RtuLine(EXACT, role=role, units=units, patience=None if strict else PATIENCE)


def at_line_speed(parts: list[bytes], start: float = 1.0) -> list[tuple[bytes, float]]:
    """Deliver the parts without pauses, each at the time when its last character has arrived."""
    now, chunks = start, []
    for part in parts:
        now += EXACT.duration(len(part))
        chunks.append((part, now))
    return chunks


# Delivery in any pieces ------------------------------------------------------------------------------------------


@every_case(("role", "frame"), RECEIVED)
def test_a_frame_is_the_same_however_it_is_delivered(role: Role, frame: bytes) -> None:
    for parts in deliveries(frame):
        line = line_of(role)
        assert feed_all(line, spaced(parts, 0.002)) == [decode(frame)], parts
        assert line.deadline is None


@every_case(("role", "frame"), RECEIVED)
def test_a_strict_line_receives_a_frame_without_gaps(role: Role, frame: bytes) -> None:
    for parts in deliveries(frame):
        line = line_of(role, strict=True)
        for data, now in at_line_speed(parts):
            assert line.feed(data, now) == [], "only silence ends a frame"
        assert silence(line) == [decode(frame)], parts


@every_case(("role", "frame"), RECEIVED)
def test_two_frames_glued_together_are_two(role: Role, frame: bytes) -> None:
    for parts in deliveries(frame + frame) if len(frame) < 40 else [[frame + frame], [frame + frame[:9], frame[9:]]]:
        assert feed_all(line_of(role), spaced(parts, 0.002)) == [decode(frame)] * 2, parts


@every_case("noise", ["00", "FF", "FF FF FF", "01 03", "01 03 FA", "00 41", "01 83 02 00 00", "2B 0E 01"])
@every_case(("role", "frame"), RECEIVED)
def test_noise_before_a_frame_hides_it_only_from_a_client_or_server(role: Role, frame: bytes, noise: str) -> None:
    """They take it behind stray bytes 00 and FF. Other noise may be a damaged frame, and the frame a part of it."""
    expected = [decode(frame)] if role == "listener" or noise in ("00", "FF", "FF FF FF") else []
    for parts in deliveries(frame) if len(frame) < 40 else [[frame]]:
        line = line_of(role)
        events = feed_all(line, spaced([unhex(noise), *parts], 0.002)) + silence(line)
        assert frames_of(events) == expected
        assert b"".join(found.data for found in noise_of(events)) == unhex(noise) + frame * (not expected)


@every_case(("role", "frame"), RECEIVED)
def test_noise_behind_a_frame_does_not_change_the_frame(role: Role, frame: bytes) -> None:
    line = line_of(role)
    assert line.feed(frame + b"\xff\x00", 1.0) == [decode(frame)]
    assert silence(line) == [Noise(b"\xff\x00", "short", "2 bytes, then silence")]


# Every byte is accounted for -------------------------------------------------------------------------------------

WHOLE = st.sampled_from([*REQUESTS.values(), *RESPONSES.values(), encode(9, unhex("41 0102"))])
DAMAGED = st.builds(lambda frame, cut: frame[:cut] + b"\xff" + frame[cut:], WHOLE, st.integers(0, 12))
TRAFFIC = st.lists(st.one_of(WHOLE, DAMAGED, st.binary(max_size=8)), max_size=4).map(b"".join)
ROLES: list[Role] = ["client", "server", "listener"]


@modest
@given(chunked(st.one_of(st.binary(max_size=40), TRAFFIC), 2 * PATIENCE), st.sampled_from(ROLES), st.booleans())
def test_every_byte_is_in_a_frame_in_noise_or_held(chunks: list[Chunk], role: Role, strict: bool) -> None:
    accounts_for_every_byte(line_of(role, strict=strict, units=(1,)), chunks, lambda adu: encode(*adu[:2]), bound=256)


@modest
@given(st.binary(max_size=2000), st.sampled_from(ROLES), st.booleans())
def test_endless_noise_is_reported_and_not_accumulated(data: bytes, role: Role, strict: bool) -> None:
    line = line_of(role, strict=strict)
    accounts_for_every_byte(
        line, spaced([data[start : start + 50] for start in range(0, len(data), 50)], 0.0001), encode_again, 256
    )
    silence(line)
    assert line.held == b""


def encode_again(adu: Adu) -> bytes:
    return encode(adu.unit, adu.pdu)


# Silence, with the default pauses --------------------------------------------------------------------------------

REPLY = RESPONSES["registers"]


@pytest.mark.parametrize(
    ("gap", "frames"),
    [(PATIENCE - CHARACTER, [decode(REPLY)]), (PATIENCE, []), (PATIENCE + CHARACTER, [])],
    ids=["shorter", "as long", "longer"],
)
def test_a_pause_inside_a_frame_is_accepted_up_to_the_patience(gap: float, frames: list[Adu]) -> None:
    line = line_of()
    events = line.feed(REPLY[:5], 1.0)
    events += line.feed(REPLY[5:], 1.0 + gap + EXACT.duration(len(REPLY) - 5))
    assert frames_of(events + silence(line)) == frames


def test_a_long_response_delivered_in_two_batches_is_one_frame() -> None:
    timing = Timing.of(115200)
    frame = RESPONSES["the longest"]
    line = RtuLine(timing)
    assert line.feed(frame[:100], 1.0) == []
    assert line.feed(frame[100:], 1.0 + 0.016 + timing.duration(155)) == [decode(frame)]


def test_patience_is_at_least_t35() -> None:
    slow = Timing.of(300)
    assert RtuLine(slow, patience=0.001).gap == slow.t35


@pytest.mark.parametrize("patience", [-1.0, -0.001])
def test_a_negative_patience_is_refused(patience: float) -> None:
    with refused(EncodeError, "expected seconds, 0 or more, or None to be strict") as refusal:
        RtuLine(EXACT, patience=patience)
    assert isinstance(refusal.value, EncodeError)
    assert refusal.value.field == "patience"


def test_half_a_frame_ends_exactly_at_the_deadline() -> None:
    line = line_of()
    line.feed(REPLY[:5], 1.0)
    assert line.deadline == 1.0 + PATIENCE
    assert line.feed(None, line.deadline - CHARACTER) == []
    assert line.held == REPLY[:5]
    assert line.feed(None, line.deadline) == [
        Noise(
            REPLY[:5], "checksum", f"CRC is 02 2B, should be {crc16(REPLY[:3]).to_bytes(2, 'little').hex(' ').upper()}"
        )
    ]
    assert line.held == b""
    assert line.deadline is None


@pytest.mark.parametrize("data", [None, b""])
def test_feeding_no_bytes_gives_no_events(data: bytes | None) -> None:
    line = line_of()
    assert line.feed(data, 5.0) == []
    assert (line.held, line.deadline, line.quiet_at) == (b"", None, float("-inf"))


def test_each_byte_postpones_the_deadline() -> None:
    line = line_of()
    line.feed(REPLY[:1], 1.0)
    line.feed(REPLY[1:2], 1.0 + PATIENCE / 2)
    assert line.deadline == 1.0 + PATIENCE / 2 + PATIENCE


def test_a_time_before_the_last_byte_does_not_shorten_the_silence() -> None:
    line = line_of()
    line.feed(REPLY[:1], 2.0)
    line.feed(REPLY[1:2], 1.5)
    assert line.deadline == 2.0 + PATIENCE


@pytest.mark.parametrize("strict", [True, False])
@pytest.mark.parametrize("pdu", [b"\x41" + bytes(252), b"\x03\xfb" + bytes(251)])
def test_a_frame_of_256_bytes_is_received(pdu: bytes, strict: bool) -> None:
    """By silence, or at once if its count is known and the line is not strict."""
    line, frame = line_of(strict=strict), encode(1, pdu)
    at_once = pdu[0] == 3 and not strict
    assert line.feed(frame, 1.0) == [decode(frame)] * at_once
    assert silence(line) == [decode(frame)] * (not at_once)
    assert line.role == "client"


# Sending ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("strict", [True, False])
def test_quiet_at_is_t35_after_the_last_byte_sent_or_received(strict: bool) -> None:
    line = line_of(strict=strict)
    line.sent(1.0)
    assert line.quiet_at == 1.0 + EXACT.t35
    line.feed(REPLY, 2.0)
    assert line.quiet_at == 2.0 + EXACT.t35
    line.sent(1.5)
    assert line.quiet_at == 2.0 + EXACT.t35


def test_silence_does_not_postpone_quiet_at() -> None:
    line = line_of()
    line.feed(REPLY, 1.0)
    line.feed(None, 9.0)
    assert line.quiet_at == 1.0 + EXACT.t35


def test_answers_compares_the_unit_of_the_request() -> None:
    line = line_of()
    assert line.request(7, unhex("03 0000 0001")) == encode(7, unhex("03 0000 0001"))
    assert line.answers(Adu(7, b"\x03"))
    assert not line.answers(Adu(8, b"\x03"))


def test_a_response_has_the_unit_of_its_request() -> None:
    assert line_of("server").response(Adu(7, b"\x03"), unhex("83 02")) == encode(7, unhex("83 02"))


# Frames without a known length -----------------------------------------------------------------------------------

CUSTOM = encode(1, unhex("41 01 02 03 04 05"))


@pytest.mark.parametrize("role", ROLES)
def test_silence_ends_a_frame_with_an_unknown_function(role: Role) -> None:
    for parts in deliveries(CUSTOM):
        line = line_of(role)
        assert feed_all(line, spaced(parts, 0.002)) == []
        assert silence(line) == [decode(CUSTOM)]


def test_silence_ends_a_frame_with_an_unknown_mei_type() -> None:
    line, frame = line_of("server"), encode(1, unhex("2B 0C 00 1F 1005 00 0000 0008"))
    assert feed_all(line, spaced([frame[:2], frame[2:]], 0.002)) == []
    assert silence(line) == [decode(frame)]


def test_a_frame_with_a_wrong_byte_count_and_a_good_crc_is_a_frame() -> None:
    """The line delivers it, and the server declines it (exception 03)."""
    for pdu in ("10 0001 0002 05 000A0102", "10 0001 0002 03 000A0102", "03 0001"):
        line = line_of("server", units=(1,))
        assert line.feed(encode(1, unhex(pdu)), 1.0) == []
        assert silence(line) == [Adu(1, unhex(pdu))]


@every_case("length", [0, 1, 2, 3, 250])
@every_case("role", ROLES)
def test_query_data_of_any_length_is_received(role: Role, length: int) -> None:
    """Two bytes of query data are the counted length; any other number is ended by silence."""
    frame = encode(1, unhex("08 0000") + b"\xa5" * length)
    for parts in ([frame], [frame[:5], frame[5:]]):
        line = line_of(role)
        assert feed_all(line, spaced(parts, 0.002)) + silence(line) == [decode(frame)]


def test_the_longest_frame_of_an_unknown_function() -> None:
    line, frame = line_of("server"), encode(1, b"\x41" + bytes(range(252)))
    assert feed_all(line, spaced([frame[:128], frame[128:]], 0.002)) + silence(line) == [decode(frame)]


# Traffic of other units ------------------------------------------------------------------------------------------

OURS = encode(1, unhex("03 0000 0001"))
OTHER_TRAFFIC = [
    encode(2, unhex("03 006B 0003")),
    encode(2, unhex("03 06 022B 0000 0064")),
    encode(3, unhex("10 0001 0002 04 000A0102")),
    encode(3, unhex("10 0001 0002")),
    encode(4, unhex("01 0013 0013")),
    encode(4, unhex("81 02")),
    encode(5, unhex("04 0000 0001")),  # without a response
]


@every_case("step", [0.0, 0.002, 2 * PATIENCE])
@every_case("count", range(len(OTHER_TRAFFIC) + 1))
def test_a_server_receives_its_request_after_traffic_of_other_units(count: int, step: float) -> None:
    line = line_of("server", units=(1,))
    frames = [*OTHER_TRAFFIC[:count], OURS]
    assert feed_all(line, spaced(frames, step)) == [decode(frame) for frame in frames]


@pytest.mark.parametrize("lost", range(1, 9))
def test_a_server_takes_no_request_directly_after_part_of_another_units_response(lost: int) -> None:
    """The request may be data of the damaged response."""
    line = line_of("server", units=(1,))
    events = feed_all(line, [(OTHER_TRAFFIC[1][lost:], 1.0), (OURS, 1.004)]) + silence(line)
    assert frames_of(events) == []
    assert line.feed(OURS, 11.0) == [decode(OURS)]


def request_that_begins_like_a_response(unit: int) -> bytes:
    """A write of 123 registers whose first 8 bytes are, by accident, a whole response with a good CRC."""
    for address in range(0x10000):
        head = bytes([unit, 0x10]) + address.to_bytes(2, "big") + unhex("007B")
        low, high = crc16(head).to_bytes(2, "little")
        if low == 0xF6:  # the byte count of 123 registers
            return encode(unit, head[1:] + bytes([0xF6, high]) + bytes(245))
    raise AssertionError("no such request among 65536")


def test_a_long_request_to_an_own_unit_is_one_frame() -> None:
    frame = request_that_begins_like_a_response(1)
    assert len(frame) == 255
    assert crc16(frame[:8]) == 0
    for parts in ([frame], [frame[:8], frame[8:]], [frame[:200], frame[200:]]):
        line = line_of("server", units=(1,))
        assert feed_all(line, spaced(parts, 0.002)) == [decode(frame)]


def test_an_echo_of_the_request_is_noise_for_a_client() -> None:
    """On a line that echoes, an `EchoLine` takes the request out. Without it the response is found at the silence."""
    line = line_of()
    request = line.request(1, unhex("03 006B 0003"))
    events = line.feed(request + REPLY, 1.0)
    assert events == []
    events = silence(line)
    assert frames_of(events) == [decode(REPLY)]
    assert noise_of(events)[0].data == request


@pytest.mark.parametrize(("role", "strict"), [*product(ROLES, [True, False])])
def test_bytes_too_short_for_a_frame_are_noise(role: Role, strict: bool) -> None:
    for length in range(1, 4):
        line = line_of(role, strict=strict)
        line.feed(b"\x01" * length, 1.0)
        size = "1 byte" if length == 1 else f"{length} bytes"
        assert silence(line) == [Noise(b"\x01" * length, "short", f"{size}, then silence")]


def test_the_longest_request_is_counted() -> None:
    assert measure_request(decode(REQUESTS["the longest"]).pdu) == 252


def test_a_line_is_that_of_a_client_by_default() -> None:
    assert repr(RtuLine(Timing.of(19200))) == "<RtuLine: client>"


# The strict pauses: a gap above t1.5 makes a frame noise, t3.5 ends it


@pytest.mark.parametrize(
    ("characters", "whole"),
    [(0.0, True), (1.0, True), (1.5, True), (2.0, False), (3.0, False)],
)
def test_strict_a_gap_above_t15_makes_the_frame_noise(characters: float, whole: bool) -> None:
    line = line_of("server", strict=True)
    frame = REQUESTS["read registers"]
    assert line.feed(frame[:3], 1.0) == []
    assert line.feed(frame[3:], 1.0 + characters * CHARACTER + EXACT.duration(len(frame) - 3)) == []
    spoiled = Noise(frame, "silence", "a gap above 1.5 characters inside the frame")
    assert silence(line) == [decode(frame) if whole else spoiled]


@pytest.mark.parametrize("characters", [3.5, 4.0, 100.0])
def test_strict_a_gap_of_t35_ends_a_frame_without_feeding_none(characters: float) -> None:
    line = line_of("server", strict=True)
    frame = REQUESTS["read registers"]
    later = 1.0 + characters * CHARACTER + EXACT.duration(len(frame))
    assert line.feed(frame, 1.0) == []
    assert line.feed(frame, later) == [decode(frame)]
    assert silence(line) == [decode(frame)]


@every_case("baudrate", [1200, 9600, 19200, 38400, 115200])
@every_case("start", [0.1, 1234.5678, 86400.1, 1e6 / 3])
def test_gaps_of_exactly_t15_and_t35_count_as_such_at_every_baudrate_and_time(baudrate: int, start: float) -> None:
    """A gap of exactly t1.5 is allowed and one of exactly t3.5 ends a frame, in spite of rounded sums."""
    timing = Timing.of(baudrate)
    line = RtuLine(timing, role="server", patience=None)
    frame = REQUESTS["read registers"]
    first = start + timing.duration(3)
    second = first + timing.t15 + timing.duration(len(frame) - 3)
    third = second + timing.t35 + timing.duration(len(frame))
    events = line.feed(frame[:3], first) + line.feed(frame[3:], second) + line.feed(frame, third)
    assert events + silence(line) == [decode(frame)] * 2


def test_strict_an_invalid_frame_does_not_affect_the_next() -> None:
    line = line_of("server", strict=True)
    frame = REQUESTS["read registers"]
    line.feed(frame[:3], 1.0)
    line.feed(frame[3:], 1.0 + 2 * CHARACTER + EXACT.duration(len(frame) - 3))
    assert frames_of(silence(line)) == []
    line.feed(frame, 2.0)
    assert silence(line) == [decode(frame)]


def test_strict_does_not_search_behind_noise() -> None:
    line = line_of("server", strict=True)
    line.feed(b"\xff" + REQUESTS["read registers"], 1.0)
    assert [event.reason for event in noise_of(silence(line))] == ["checksum"]


def test_strict_reports_that_a_frame_was_too_long() -> None:
    line = line_of("server", strict=True)
    events = line.feed(bytes(300), 1.0) + silence(line)
    assert [(len(event.data), event.reason, event.text) for event in noise_of(events)] == [
        (44, "long", "more than 256 bytes without silence"),
        (256, "long", "more than 256 bytes without silence"),
    ]
