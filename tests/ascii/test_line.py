"""The framing of an ASCII line: ':' begins a frame, CR LF ends it, a pause makes it noise."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.ascii import AsciiLine, decode, encode
from barewire.errors import EncodeError
from barewire.modbus import Adu, Noise
from tests.helpers import (
    Chunk,
    accounts_for_every_byte,
    chunked,
    deliveries,
    feed_all,
    frames_of,
    modest,
    noise_of,
    refused,
    silence,
    spaced,
    unhex,
)

SHORT = encode(1, b"\x07")
READ = encode(1, unhex("03 006B 0003"))
LONGEST = encode(1, b"\x03" + bytes(range(252)))
FRAMES = [pytest.param(SHORT, id="short"), pytest.param(READ, id="read"), pytest.param(LONGEST, id="longest")]


@pytest.mark.parametrize("frame", FRAMES)
def test_a_frame_is_the_same_however_it_is_delivered(frame: bytes) -> None:
    for parts in deliveries(frame):
        line = AsciiLine()
        assert feed_all(line, spaced(parts, 0.01)) == [decode(frame)]
        assert (line.held, line.deadline) == (b"", None)


@pytest.mark.parametrize("frame", FRAMES)
def test_two_frames_glued_together_are_two(frame: bytes) -> None:
    for parts in deliveries(frame + READ):
        assert feed_all(AsciiLine(), spaced(parts, 0.01)) == [decode(frame), decode(READ)]


@pytest.mark.parametrize(
    ("noise", "reason", "text"),
    [
        (b"\xff\x00", "delimiter", "no ':' before it"),
        (b"0107F8", "delimiter", "no ':' before it"),
        (b":0107", "delimiter", "':' before the frame ended"),
        (b":", "delimiter", "':' before the frame ended"),
        (b"\r\n", "delimiter", "begins with ':'"),
        (b":0107F9\r\n", "checksum", "LRC is F9, should be F8"),
        (b":01x7F8\r\n", "character", "a hexadecimal digit"),
        (b":01FF\r\n", "short", "at least 9 characters"),
        (b":" + b"0" * 512, "long", "513 characters without CR LF"),
    ],
)
def test_noise_before_a_frame_is_reported_and_does_not_hide_it(noise: bytes, reason: str, text: str) -> None:
    for parts in deliveries(noise + READ):
        first, *rest = feed_all(AsciiLine(), spaced(parts, 0.001))
        assert isinstance(first, Noise)
        assert (first.data, first.reason) == (noise, reason)
        assert text in first.text
        assert rest == [decode(READ)]


def test_a_colon_begins_again() -> None:
    assert frames_of(AsciiLine().feed(b":0103:0107:" + READ, 1.0)) == [decode(READ)]


@pytest.mark.parametrize(("pause", "whole"), [(0.5, True), (0.999, True), (1.0, False), (1.5, False)])
def test_a_pause_of_a_second_ends_a_frame(pause: float, whole: bool) -> None:
    line = AsciiLine()
    events = line.feed(READ[:7], 1.0) + line.feed(READ[7:], 1.0 + pause)
    assert frames_of(events) == ([decode(READ)] if whole else [])
    assert line.held == b""


def test_the_deadline_ends_half_a_frame() -> None:
    line = AsciiLine(character_timeout=5.0)
    line.feed(READ[:7], 1.0)
    line.feed(READ[7:9], 2.0)
    assert line.deadline == 7.0
    assert line.feed(None, 6.9) == []
    assert line.feed(None, 7.0) == [Noise(READ[:9], "silence", "no character for 5 s inside a frame")]
    assert line.deadline is None


def test_with_7_data_bits_the_parity_bit_is_removed() -> None:
    with_parity = bytes(character | character.bit_count() % 2 << 7 for character in READ)
    assert with_parity != READ
    assert AsciiLine(data_bits=7).feed(with_parity, 1.0) == [decode(READ)]
    assert frames_of(AsciiLine(data_bits=8).feed(with_parity, 1.0)) == []


@pytest.mark.parametrize("data_bits", [5, 6, 9])
def test_other_than_7_or_8_data_bits_is_refused(data_bits: int) -> None:
    with refused(EncodeError, f"{data_bits} data bits: ASCII characters have 7 or 8"):
        AsciiLine(data_bits=data_bits)


def test_ascii_needs_no_silence_before_sending() -> None:
    line = AsciiLine()
    line.sent(5.0)
    line.feed(READ, 6.0)
    assert line.quiet_at <= 6.0


def test_answers_compares_the_unit_of_the_request() -> None:
    line = AsciiLine()
    assert line.request(7, b"\x07") == encode(7, b"\x07")
    assert line.answers(Adu(7, b"\x07\x00"))
    assert not line.answers(Adu(8, b"\x07\x00"))


def test_a_response_has_the_unit_of_its_request() -> None:
    assert AsciiLine().response(Adu(7, b"\x07"), unhex("87 01")) == encode(7, unhex("87 01"))


CHARACTERS = st.one_of(
    st.binary(max_size=20),
    st.text(":0123456789ABCDEF\r\n", max_size=20).map(str.encode),
    st.sampled_from([SHORT, READ, READ[:5], READ[5:], LONGEST, b":" + b"0" * 600]),
)


@modest
@given(chunked(CHARACTERS, longest_pause=1.5))
def test_every_byte_is_in_a_frame_in_noise_or_held(chunks: list[Chunk]) -> None:
    accounts_for_every_byte(AsciiLine(), chunks, lambda adu: encode(adu.unit, adu.pdu), bound=512)


@modest
@given(st.binary(max_size=3000))
def test_endless_noise_is_reported_and_not_accumulated(data: bytes) -> None:
    line = AsciiLine()
    events = line.feed(data, 1.0) + silence(line)
    assert line.held == b""
    assert b"".join(event.data for event in noise_of(events)) == data


CHANGED = encode(1, unhex("08 0003 3B00"))
"""A request; twice, it is the request and its response, after which ';' ends the frames of unit 1."""


@modest
@given(st.lists(st.one_of(CHARACTERS, st.sampled_from([CHANGED * 2, READ[:-1] + b";", LONGEST[:-2] + b"0\r\n"]))))
def test_many_bytes_at_once_give_the_events_of_single_bytes(pieces: list[bytes]) -> None:
    """A frame that arrives whole is decoded at once; the result is that of single characters."""
    data = b"".join(pieces)
    at_once, one_by_one = AsciiLine(), AsciiLine()
    events = at_once.feed(data, 1.0)
    assert events == [event for byte in data for event in one_by_one.feed(bytes([byte]), 1.0)]
    assert at_once.held == one_by_one.held
