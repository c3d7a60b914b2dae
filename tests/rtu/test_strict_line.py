"""The framing of an RTU line with the strict pauses: t1.5 ends a frame as noise, t3.5 ends it."""

from __future__ import annotations

import pytest

from barewire.modbus import Noise
from barewire.rtu import RtuLine, Timing, decode
from tests.helpers import frames_of, noise_of, silence
from tests.rtu.test_line import CHARACTER, EXACT, REQUESTS, line_of


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


@pytest.mark.parametrize("baudrate", [1200, 9600, 19200, 38400, 115200])
@pytest.mark.parametrize("start", [0.1, 1234.5678, 86400.1, 1e6 / 3])
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
