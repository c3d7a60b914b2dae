"""How the line of a listener finds frames again: behind noise, damaged frames and wrong counts, in linear time."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, strategies as st

from barewire.modbus import Adu, Noise
from barewire.modbus.framing import LineEvent
from barewire.rtu import RtuLine, decode, encode
from barewire.rtu.shape import Role
from tests.helpers import feed_all, frames_of, modest, noise_of, silence, unhex
from tests.rtu.test_line import CHARACTER, CUSTOM, DAMAGED, PATIENCE, REPLY, RESPONSES, ROLES, WHOLE, line_of


def damaged(frame: bytes) -> bytes:
    return frame[:-1] + bytes([frame[-1] ^ 1])


def test_a_good_frame_directly_behind_a_damaged_one_is_found_at_once() -> None:
    line = line_of("listener")
    events = line.feed(damaged(REPLY) + RESPONSES["exception"], 1.0)
    assert events == [
        Noise(damaged(REPLY), "checksum", f"{len(REPLY)} bytes that are not a frame before a good one"),
        decode(RESPONSES["exception"]),
    ]


def test_a_damaged_frame_is_reported_with_the_expected_crc() -> None:
    line = line_of()
    assert line.feed(damaged(REPLY), 1.0) == []
    right, wrong = (frame[-2:].hex(" ").upper() for frame in (REPLY, damaged(REPLY)))
    assert silence(line) == [Noise(damaged(REPLY), "checksum", f"CRC is {wrong}, should be {right}")]


@pytest.mark.parametrize("length", range(1, len(REPLY)))
def test_half_a_frame_and_then_a_whole_one(length: int) -> None:
    """With silence between them, and without (a unit that began its response again)."""
    for pause in (0.002, 2 * PATIENCE):
        line = line_of("listener")
        events = feed_all(line, [(REPLY[:length], 1.0), (REPLY, 1.0 + pause)]) + silence(line)
        assert frames_of(events) == [decode(REPLY)]
        assert b"".join(event.data for event in noise_of(events)) == REPLY[:length]


@pytest.mark.parametrize("noise", ["FF 41", "FF 03 FA", "01 10 00 00 00 7B F6"])
def test_silence_finds_every_frame_behind_a_wrong_count(noise: str) -> None:
    """The noise announces a long frame (or one without an end), so nothing is decided before the silence."""
    first, second, third = RESPONSES["registers"], RESPONSES["exception"], RESPONSES["coils"]
    line = line_of("listener")
    events = line.feed(unhex(noise) + first + second, 1.0) + line.feed(third + b"\xff", 1.001) + silence(line)
    assert frames_of(events) == [decode(first), decode(second), decode(third)]
    assert [event.data for event in noise_of(events)] == [unhex(noise), b"\xff"]


def test_behind_noise_and_a_good_frame_silence_ends_an_unknown_function() -> None:
    line = line_of("listener")
    events = line.feed(unhex("FF 41") + REPLY + CUSTOM, 1.0) + silence(line)
    assert frames_of(events) == [decode(REPLY), decode(CUSTOM)]


def test_a_frame_is_found_behind_more_noise_than_a_frame_is_long() -> None:
    for noise in (bytes(1000), b"\xff" * 1000, b"\x01\x41" * 500):
        line = line_of("listener")
        events = line.feed(noise, 1.0) + line.feed(REPLY, 1.001) + silence(line)
        assert frames_of(events) == [decode(REPLY)]


def test_endless_noise_is_reported_in_parts() -> None:
    line = line_of()
    events = [event for place in range(100) for event in line.feed(b"\x01\x41" * 8, 1.0 + place / 1000)]
    assert {event.reason for event in noise_of(events)} == {"long"}
    assert {event.text for event in noise_of(events)} == {"more than 256 bytes and no frame in them"}
    assert len(line.held) == 256


def frames_and_rest(events: list[LineEvent], held: bytes) -> list[Adu | bytes]:
    """Return the frames, and the bytes between them, joined across events."""
    parts: list[Adu | bytes] = [b""]
    for event in [*events, Noise(held, "short")]:
        if isinstance(event, Adu):
            parts += [event, b""]
        else:
            last = parts.pop()
            assert isinstance(last, bytes)
            parts.append(last + event.data)
    return parts


@modest
@given(st.lists(st.one_of(WHOLE, DAMAGED, st.binary(max_size=300)), max_size=5), st.sampled_from(ROLES), st.randoms())
def test_the_same_frames_whatever_the_chunks(parts: list[bytes], role: Role, dice: Random) -> None:
    """Only the bytes and the silence decide where frames are, not the batches in which an adapter delivers them."""
    data = b"".join(parts)
    received = []
    for longest in (1, 3, 40):
        line, events, start, now = line_of(role, units=(1,)), list[LineEvent](), 0, 1.0
        while start < len(data):
            size = dice.randint(1, longest)
            now += CHARACTER * size
            events += line.feed(data[start : start + size], now)
            start += size
        received.append(frames_and_rest(events + silence(line), line.held))
    assert received[0] == received[1] == received[2]


def test_noise_byte_by_byte_costs_linear_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also with a full buffer. The test counts how often a place is checked; it does not measure time."""
    checks = 0
    original = RtuLine._check

    def counted(line: RtuLine, at: int, may_wait: bool = False) -> tuple[int | None, int]:
        nonlocal checks
        checks += 1
        return original(line, at, may_wait)

    monkeypatch.setattr(RtuLine, "_check", counted)
    for role in ROLES:
        line, dice, checks = line_of(role, units=(1,)), Random(1), 0
        for place in range(3000):
            line.feed(dice.randbytes(1), 1.0 + place * CHARACTER)
            assert len(line._places) <= 2 * 256
        assert checks < 6 * 3000


# Where frames may begin and end ------------------------------------------------------------------------------------


def test_a_frame_inside_a_frame_without_a_known_length_is_part_of_it() -> None:
    line, frame = line_of(), encode(1, b"\x41" + REPLY)
    assert line.feed(frame, 1.0) == []
    assert silence(line) == [decode(frame)]


def test_a_response_that_lost_the_last_zero_of_its_crc_is_noise() -> None:
    """Its CRC is right without that byte too."""
    frame = encode(1, unhex("03 02 0131"))
    assert frame[-1] == 0
    line = line_of()
    assert line.feed(frame[:-1], 1.0) == []
    text = "6 bytes, then silence: the last byte is missing, a 00 of the CRC"
    assert silence(line) == [Noise(frame[:-1], "short", text)]


@pytest.mark.parametrize("count", [255, 256, 257, 258])
def test_a_line_holds_as_many_bytes_as_the_longest_frame(count: int) -> None:
    line = line_of()
    noise = noise_of(line.feed(b"\xff" * count, 1.0))
    assert [len(event.data) for event in noise] == [count - 256] * (count > 256)
    assert len(line.held) == min(count, 256)


def test_a_strict_line_takes_two_frames_without_silence_between_them_for_noise() -> None:
    line = line_of(strict=True)
    assert line.feed(REPLY + REPLY, 1.0) == []
    assert [event.data for event in noise_of(silence(line))] == [REPLY + REPLY]


@pytest.mark.parametrize(("count", "at_once"), [(255, False), (256, True)])
def test_no_frame_is_longer_than_256_bytes_so_a_full_line_is_searched(count: int, at_once: bool) -> None:
    """The first two bytes are a function without a known length, which otherwise only silence ends."""
    line = line_of("listener")
    data = unhex("01 41") + bytes(count - 2 - len(REPLY)) + REPLY
    assert frames_of(line.feed(data, 1.0)) == [decode(REPLY)] * at_once
    assert frames_of(silence(line)) == [decode(REPLY)] * (not at_once)


def test_a_line_searches_as_soon_as_the_count_of_the_first_message_is_too_long() -> None:
    """55 10 looks like a request to write registers, whose seventh byte is its byte count.

    A listener waits for the eighth byte too, which would end a response."""
    inside = encode(0x10, b"\x07")
    data = b"\x55" + inside + b"\x00\xff\x00\x00"
    line = line_of("listener")
    found = [number for number in range(len(data)) if frames_of(line.feed(data[number : number + 1], 1.0))]
    assert found == [7]


def test_a_response_is_counted_even_if_as_a_request_it_would_be_too_long() -> None:
    """The first byte of its CRC stands where a request has its byte count."""
    frames = (encode(2, b"\x10" + address.to_bytes(2, "big") + b"\x00\x02") for address in range(0x10000))
    frame = next(frame for frame in frames if frame[6] == 0xFF)
    assert line_of("listener").feed(frame, 1.0) == [decode(frame)]
