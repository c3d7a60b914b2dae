"""The sniffers, in virtual time: missing frames, ambiguous frames and noise never shift the pairs."""

from __future__ import annotations

from typing import NamedTuple

import pytest
from hypothesis import given, strategies as st

from barewire.ascii import AsciiLine, encode as ascii_frame
from barewire.errors import EncodeError
from barewire.modbus import Noise, ReadHoldingRegisters, ReadHoldingRegistersResponse
from barewire.modbus.framing import Line
from barewire.rtu import RtuLine, Timing, encode
from barewire.tcp import TcpLine, encode as tcp_frame
from barewire_workbench.sniffer import (
    OPEN_LIMIT,
    AmbiguousFrame,
    NoiseSeen,
    NumberedSniffer,
    RecordingEnds,
    RequestSeen,
    ResponseMissing,
    ResponseSeen,
    Sniffer,
    SnifferEvent,
    shapes,
)
from tests.helpers import modest, refused, unhex

TIMING = Timing.of(19200)
READ, VALUES = "03 0000 0002", "03 04 0017 0007"
WRITE = "06 0001 0003"


class Frame(NamedTuple):
    """A frame of a dialogue: the time of its end, its unit, and the index of its exchange in the dialogue."""

    at: float
    unit: int
    pdu: bytes
    exchange: int
    is_request: bool


def sniffer(window: float = 1.0) -> Sniffer:
    return Sniffer(RtuLine(TIMING, role="listener"), window=window)


def feed_frames(listener: Sniffer, frames: list[tuple[float, int, str]]) -> list[SnifferEvent]:
    """Feed frames (time, unit, PDU), and return the events."""
    return overhear(listener, [Frame(now, unit, unhex(pdu), 0, True) for now, unit, pdu in frames])


def overhear(listener: Sniffer, frames: list[Frame]) -> list[SnifferEvent]:
    """Feed frames and the time between them, and return the events."""
    events: list[SnifferEvent] = []
    for frame in frames:
        events += silence(listener, frame.at)
        events += listener.feed(encode(frame.unit, frame.pdu), frame.at)
    events += silence(listener, float("inf"))
    return events


def silence(listener: Sniffer, until: float) -> list[SnifferEvent]:
    events: list[SnifferEvent] = []
    while (deadline := listener.deadline) is not None and deadline < until:
        events += listener.feed(None, deadline)
        assert listener.deadline is None or listener.deadline > deadline
    return events


def names(events: list[SnifferEvent]) -> list[str]:
    return [type(event).__name__ for event in events]


def test_a_request_and_its_response() -> None:
    asked, answer = feed_frames(sniffer(), [(1.0, 1, READ), (1.25, 1, VALUES)])
    assert asked == RequestSeen(1, unhex(READ), 1.0, ReadHoldingRegisters(0, 2))
    assert isinstance(answer, ResponseSeen)
    assert answer.message == ReadHoldingRegistersResponse((0x17, 7))
    assert (answer.request, answer.seconds, answer.late) == (asked, 0.25, False)


def test_an_exception_response_is_a_response() -> None:
    _, answer = feed_frames(sniffer(), [(1.0, 1, READ), (1.25, 1, "83 02")])
    assert isinstance(answer, ResponseSeen)
    assert answer.request is not None
    # Also to a request that cannot be decoded, because its quantity is 0.
    asked, answer = feed_frames(sniffer(), [(1.0, 1, "03 0000 0000"), (1.25, 1, "83 03")])
    assert isinstance(asked, RequestSeen)
    assert asked.message is None
    assert isinstance(answer, ResponseSeen)
    assert answer.request == asked


def test_a_broadcast_expects_no_response() -> None:
    (event,) = feed_frames(sniffer(), [(1.0, 0, WRITE)])
    assert isinstance(event, RequestSeen)
    assert event.unit == 0


def test_a_missing_response_is_reported_after_the_window() -> None:
    asked, silent = feed_frames(sniffer(window=0.5), [(1.0, 1, READ)])
    assert silent == ResponseMissing(asked, 1.5)  # type: ignore[arg-type]


def test_a_response_without_its_request() -> None:
    first, asked, second = feed_frames(sniffer(), [(1.0, 1, VALUES), (1.1, 2, READ), (1.2, 2, VALUES)])
    assert isinstance(first, ResponseSeen)
    assert first.request is None
    assert first.seconds is None
    assert isinstance(second, ResponseSeen)
    assert second.request == asked


def test_a_response_behind_the_window_has_no_request_and_is_not_late() -> None:
    """No next request was sent. A log whose times are whole seconds has many such responses."""
    for at in (2.0, 2.5):
        listener = sniffer()
        events = listener.feed(encode(1, unhex(READ)), 1.0) + silence(listener, 2.5)
        events += listener.feed(encode(1, unhex(VALUES)), at)
        assert names(events) == ["RequestSeen", "ResponseMissing", "ResponseSeen"]
        assert (events[2].request, events[2].late) == (None, False)  # type: ignore[union-attr]


def test_a_response_of_another_length_is_not_paired() -> None:
    events = feed_frames(sniffer(), [(1.0, 1, READ), (1.1, 1, "03 02 0017")])
    assert names(events) == ["RequestSeen", "ResponseMissing", "ResponseSeen"]
    assert events[2].request is None  # type: ignore[union-attr]


def test_a_late_response_is_distinguished_from_that_of_the_next_unit() -> None:
    events = feed_frames(sniffer(), [(1.0, 1, READ), (1.3, 2, READ), (1.35, 1, VALUES), (1.4, 2, VALUES)])
    assert names(events) == ["RequestSeen", "ResponseMissing", "RequestSeen", "ResponseSeen", "ResponseSeen"]
    late, answer = events[3], events[4]
    assert isinstance(late, ResponseSeen)
    assert isinstance(answer, ResponseSeen)
    assert (late.request, late.late, answer.request, answer.late) == (events[0], True, events[2], False)


def test_of_two_responses_that_fit_two_requests_the_first_is_the_late_one() -> None:
    """A unit answers in order, also if the time for the first response was over before the second request."""
    for second in (1.3, 2.3):
        frames = [(1.0, 1, READ), (second, 1, "03 0010 0002"), (second + 0.03, 1, VALUES), (second + 0.06, 1, VALUES)]
        events = feed_frames(sniffer(), frames)
        requests = [event for event in events if isinstance(event, RequestSeen)]
        answers = [event for event in events if isinstance(event, ResponseSeen)]
        assert [(answer.request, answer.late, answer.older) for answer in answers] == [
            (requests[0], True, None),
            (requests[1], False, None),
        ]


def test_one_response_that_fits_two_requests_names_the_older_one() -> None:
    frames = [(1.0, 1, READ), (1.3, 1, "03 0010 0002"), (1.305, 1, VALUES), (1.5, 2, READ), (1.6, 2, VALUES)]
    events = feed_frames(sniffer(), frames)
    answers = [event for event in events if isinstance(event, ResponseSeen)]
    assert [(answer.request.at, answer.older and answer.older.at) for answer in answers if answer.request] == [
        (1.3, 1.0),
        (1.5, None),
    ]
    assert [event.at for event in events] == [1.0, 1.3, 1.3, 1.305, 1.5, 1.6]
    # A request that is repeated asks the same, so it does not matter which of the two is answered.
    repeated = feed_frames(sniffer(), [(1.0, 1, READ), (1.3, 1, READ), (1.305, 1, VALUES)])
    assert names(repeated) == ["RequestSeen", "ResponseMissing", "RequestSeen", "ResponseSeen"]
    assert repeated[3].older is None  # type: ignore[union-attr]


def test_a_damaged_response_is_not_awaited() -> None:
    listener = sniffer()
    events = listener.feed(encode(1, unhex(READ)), 1.0)
    events += listener.feed(encode(1, unhex(VALUES))[:-1] + b"\0", 1.1) + silence(listener, 1.3)
    events += listener.feed(encode(1, unhex("03 0010 0002")), 1.3) + listener.feed(encode(1, unhex(VALUES)), 1.4)
    assert names(events) == ["RequestSeen", "NoiseSeen", "ResponseMissing", "RequestSeen", "ResponseSeen"]
    assert events[4].older is None  # type: ignore[union-attr]


def test_a_response_that_fits_two_requests_waits_for_the_next_frame_only() -> None:
    listener = sniffer()
    asked = [(1.0, READ), (1.3, "03 0010 0002"), (1.305, VALUES)]
    events = [event for at, pdu in asked for event in listener.feed(encode(1, unhex(pdu)), at)]
    assert names(events) == ["RequestSeen", "ResponseMissing", "RequestSeen"]
    events = listener.feed(b"\xff\x00\x55", 1.35) + silence(listener, 1.4)
    assert events == []  # the noise waits, too
    assert names(listener.end(1.4)) == ["ResponseSeen", "NoiseSeen"]
    assert listener.deadline is None


def test_a_response_behind_that_to_the_next_request_has_its_request() -> None:
    """Two masters: the second one gets its response first."""
    events = feed_frames(sniffer(), [(1.0, 1, READ), (1.004, 2, READ), (1.02, 2, VALUES), (1.024, 1, VALUES)])
    assert pairs(events) == [(1.004, 1.02), (1.0, 1.024)]
    assert [event.late for event in events if isinstance(event, ResponseSeen)] == [False, True]


# Writes and their echoes -------------------------------------------------------------------------------------------


def pairs(events: list[SnifferEvent]) -> list[tuple[float, ...]]:
    """Return the times of each exchange; one time for an ambiguous frame."""
    found: list[tuple[float, ...]] = []
    for event in events:
        if isinstance(event, ResponseSeen):
            found.append((event.request.at, event.at) if event.request else (event.at,))
        elif isinstance(event, AmbiguousFrame):
            found.append((event.at,))
    return found


@pytest.mark.parametrize(
    ("times", "exchanges"),
    [
        ([1.0, 1.1], [(1.0, 1.1)]),
        ([1.0, 1.1, 2.0, 2.1], [(1.0, 1.1), (2.0, 2.1)]),
        ([1.0, 1.5, 1.6, 2.0, 2.1], [(1.0,), (1.5, 1.6), (2.0, 2.1)]),
        ([1.0, 1.1, 1.6, 2.0, 2.1], [(1.0, 1.1), (1.6,), (2.0, 2.1)]),
        ([1.0], [(1.0,)]),
        ([1.0, 2.5], [(1.0,), (2.5,)]),
    ],
)
def test_equal_frames_are_paired_by_time(times: list[float], exchanges: list[tuple[float, ...]]) -> None:
    assert pairs(feed_frames(sniffer(), [(now, 1, WRITE) for now in times])) == exchanges


def test_equal_frames_of_a_slow_unit_are_paired_by_its_response_time() -> None:
    """Earlier reads took 300 ms; the client sends its next request after 20 ms."""
    frames = [(0.0, 1, READ), (0.3, 1, VALUES)]
    frames += [(0.32 * place + after, 1, WRITE) for place in range(1, 4) for after in (0.0, 0.3)]
    events = pairs(feed_frames(sniffer(), frames))
    assert [round(end - start, 6) for start, end in events] == [0.3] * 4


def test_an_exception_response_to_a_write() -> None:
    events = feed_frames(sniffer(), [(1.0, 1, WRITE), (1.1, 1, "86 02")])
    assert pairs(events) == [(1.0, 1.1)]


def test_a_write_of_another_value_is_not_paired() -> None:
    events = feed_frames(sniffer(), [(1.0, 1, WRITE), (1.1, 1, "06 0001 0004"), (1.2, 1, "06 0001 0004")])
    assert pairs(events) == [(1.0,), (1.1, 1.2)]


def test_unknown_functions_are_paired_by_their_code() -> None:
    listener = sniffer()
    events = feed_frames(listener, [(1.0, 1, "41 01"), (1.2, 1, "41 99 98")])
    assert names(events) == ["RequestSeen", "ResponseSeen"]
    assert events[1].request == events[0]  # type: ignore[union-attr]


# Lost frames -------------------------------------------------------------------------------------------------------

EXCHANGES = [
    ("03 0000 0002", "03 04 0017 0007"),
    ("03 0000 0001", "03 02 0017"),
    ("01 0000 0009", "01 02 FF01"),
    ("04 0005 0001", "84 02"),
    ("06 0001 0003", "06 0001 0003"),
    ("06 0001 0004", "06 0001 0004"),
    ("05 0002 FF00", "05 0002 FF00"),
    ("10 0000 0001 02 0001", "10 0000 0001"),
    ("08 0000 1234", "08 0000 1234"),
    ("16 0004 00F2 0025", "16 0004 00F2 0025"),
    ("17 0000 0001 0000 0001 02 0001", "17 02 0009"),
    ("2B 0E 04 00", "2B 0E 04 81 00 00 01 00 01 41"),
    ("11", "11 02 01 FF"),
]


@st.composite
def dialogues(draw: st.DrawFn) -> tuple[list[Frame], int]:
    """Exchanges with several units, and the index of a dropped frame. Responses come faster than new requests."""
    frames: list[Frame] = []
    now = 1.0
    for number in range(draw(st.integers(2, 8))):
        unit, (request, response) = draw(st.integers(1, 3)), draw(st.sampled_from(EXCHANGES))
        frames.append(Frame(now, unit, unhex(request), number, True))
        now += draw(st.sampled_from((0.005, 0.02, 0.09)))
        frames.append(Frame(now, unit, unhex(response), number, False))
        now += draw(st.sampled_from((0.15, 0.4)))
    return frames, draw(st.integers(0, len(frames) - 1))


@modest
@given(dialogues())
def test_a_dropped_frame_does_not_shift_the_pairs(drawn: tuple[list[Frame], int]) -> None:
    frames, dropped = drawn
    kept = [frame for place, frame in enumerate(frames) if place != dropped]
    events = overhear(sniffer(), kept)
    assert_attributed(events, kept)
    ambiguous = [event.at for event in events if isinstance(event, AmbiguousFrame)]
    assert all(frame.exchange == frames[dropped].exchange for frame in kept if frame.at in ambiguous)


@modest
@given(dialogues(), st.sets(st.integers(0, 15)))
def test_with_pauses_longer_than_the_window_anything_may_be_missing(
    drawn: tuple[list[Frame], int], missing: set[int]
) -> None:
    frames = [frame._replace(at=frame.at + 2 * frame.exchange) for frame in drawn[0]]
    kept = [frame for place, frame in enumerate(frames) if place not in missing]
    assert_attributed(overhear(sniffer(), kept), kept)


def assert_attributed(events: list[SnifferEvent], kept: list[Frame]) -> None:
    """Each frame is reported once, as request or response, with its own request if that was received."""
    by_time = {frame.at: frame for frame in kept}
    reported = []
    for event in events:
        assert not isinstance(event, NoiseSeen)
        frame = by_time[event.request.at if isinstance(event, ResponseMissing | RecordingEnds) else event.at]
        exchange = [partner for partner in kept if partner.exchange == frame.exchange]
        if isinstance(event, ResponseMissing | RecordingEnds):
            assert exchange == [frame]
            assert frame.is_request
            continue
        reported.append(event.at)
        assert (event.unit, event.pdu) == (frame.unit, frame.pdu)
        if isinstance(event, RequestSeen):
            assert frame.is_request
        elif isinstance(event, ResponseSeen):
            assert not frame.is_request
            asked = [partner.at for partner in exchange if partner.is_request]
            assert asked == ([event.request.at] if event.request else [])
        else:
            assert exchange == [frame]
    assert sorted(reported) == [frame.at for frame in kept]


# Noise, other lines, bounds ----------------------------------------------------------------------------------------


def test_noise_is_reported_and_the_pair_is_kept() -> None:
    listener = sniffer()
    events = listener.feed(encode(1, unhex(READ)), 1.0)
    events += listener.feed(b"\xff\x00\x55", 1.02) + silence(listener, 1.2)
    events += listener.feed(encode(1, unhex(VALUES)), 1.2)
    assert names(events) == ["RequestSeen", "NoiseSeen", "ResponseSeen"]
    assert isinstance(events[1], NoiseSeen)
    assert events[1].noise.data == b"\xff\x00\x55"
    assert events[2].request == events[0]  # type: ignore[union-attr]


def test_nothing_expires_while_a_frame_is_arriving() -> None:
    listener, answer = sniffer(window=0.5), encode(1, unhex(VALUES))
    events = listener.feed(encode(1, unhex(READ)), 1.0) + listener.feed(answer[:4], 1.49)
    assert listener.deadline is not None
    assert listener.deadline > 1.5
    assert names(events + listener.feed(None, 1.5) + listener.feed(answer[4:], 1.5)) == ["RequestSeen", "ResponseSeen"]


def test_an_ascii_line() -> None:
    listener = Sniffer(AsciiLine())
    events = listener.feed(ascii_frame(1, unhex(READ)), 1.0) + listener.feed(ascii_frame(1, unhex(VALUES)), 1.1)
    assert names(events) == ["RequestSeen", "ResponseSeen"]


def test_the_end_reports_what_is_undecided() -> None:
    listener = sniffer()
    events = listener.feed(encode(1, unhex(READ)), 1.0) + listener.feed(b"\x01\x03", 1.01)
    assert names(events + listener.end(1.01)) == ["RequestSeen", "NoiseSeen", "RecordingEnds"]
    assert listener.deadline is None
    listener = sniffer()
    events = listener.feed(encode(1, unhex(READ)), 1.0)
    assert names(events + listener.end(2.0)) == ["RequestSeen", "ResponseMissing"]  # the window is over


def test_noise_waits_for_an_undecided_frame() -> None:
    """The first frame is known to be a request when the window is over; the noise after it was reported before it."""
    listener = sniffer()
    events = listener.feed(encode(1, unhex(WRITE)), 1.0) + listener.feed(b"\xff\x00", 1.1)
    events += listener.feed(None, 1.2)
    assert events == []
    events += listener.feed(encode(2, unhex(READ)), 1.3)
    assert names(events) == ["AmbiguousFrame", "NoiseSeen", "RequestSeen"]
    assert [event.at for event in events] == sorted(event.at for event in events)


def test_a_stated_direction_decides_about_equal_frames() -> None:
    frame = encode(1, unhex(WRITE))
    listener = sniffer()
    assert names(listener.feed(frame, 1.0, True) + listener.feed(frame, 1.1, False)) == ["RequestSeen", "ResponseSeen"]
    assert names(sniffer().feed(frame, 1.0, False)) == ["ResponseSeen"]
    assert names(sniffer().feed(encode(1, unhex(READ)), 1.0, False)) == ["RequestSeen"]  # it can be nothing else


def test_a_recording_can_say_that_nothing_came() -> None:
    listener = sniffer()
    events = listener.feed(encode(1, unhex(READ)), 1.0)
    assert names(events + listener.give_up(1.2) + listener.end(1.3)) == ["RequestSeen", "ResponseMissing"]


@modest
@given(st.lists(st.tuples(st.one_of(st.none(), st.binary(max_size=40)), st.floats(0, 2)), max_size=20))
def test_any_bytes_are_reported_and_never_raise(chunks: list[tuple[bytes | None, float]]) -> None:
    for line in (RtuLine(TIMING, role="listener"), AsciiLine()):
        listener, now, fed, events = Sniffer(line), 0.0, b"", list[SnifferEvent]()
        for data, step in chunks:
            now += step
            fed += data or b""
            events += listener.feed(data, now)
        events += listener.end(now + 10)
        if isinstance(line, RtuLine):
            assert sorted(b"".join(_bytes(event) for event in events)) == sorted(fed)


def _bytes(event: SnifferEvent) -> bytes:
    if isinstance(event, NoiseSeen):
        return event.noise.data
    return b"" if isinstance(event, ResponseMissing | RecordingEnds) else encode(event.unit, event.pdu)


@pytest.mark.parametrize(
    ("pdu", "expected"),
    [
        (READ, (True, False)),
        (VALUES, (False, True)),
        ("83 02", (False, True)),
        (WRITE, (True, True)),
        ("41 00", (True, True)),
        ("01 0300 0008", (True, True)),  # coils from 0300h on, or three bytes of them
        ("03 0000 0000", (True, False)),  # a quantity of 0, and a length that fits
    ],
)
def test_shapes(pdu: str, expected: tuple[bool, bool]) -> None:
    assert shapes(unhex(pdu)) == expected


def test_a_window_of_0_is_refused() -> None:
    with refused(EncodeError, "window 0: expected seconds, above 0"):
        sniffer(window=0)


# Numbered ----------------------------------------------------------------------------------------------------------


def lines() -> tuple[Line, Line]:
    return TcpLine(), TcpLine()


def test_numbered_responses_in_any_order() -> None:
    listener = NumberedSniffer(*lines())
    events = listener.feed(True, tcp_frame(1, unhex(READ), 1) + tcp_frame(1, unhex(WRITE), 2), 1.0)
    events += listener.feed(False, tcp_frame(1, unhex(WRITE), 2) + tcp_frame(1, unhex(VALUES), 1), 1.1)
    events += listener.feed(False, tcp_frame(1, unhex(VALUES), 9), 1.2)
    assert [event.request and event.request.transaction for event in events if isinstance(event, ResponseSeen)] == [
        2,
        1,
        None,
    ]


def test_numbered_missing_responses_noise_and_the_limit_of_open_requests() -> None:
    listener = NumberedSniffer(*lines())
    events: list[SnifferEvent] = []
    for number in range(OPEN_LIMIT + 3):
        events += listener.feed(True, tcp_frame(1, unhex(READ), number), 1.0)
    assert names(events).count("ResponseMissing") == 3
    assert names(listener.feed(True, tcp_frame(1, unhex(READ), 5), 1.0)) == ["ResponseMissing", "RequestSeen"]
    events = listener.feed(False, unhex("0001 0007 0000"), 2.5)
    assert names(events) == ["ResponseMissing"] * OPEN_LIMIT + ["NoiseSeen"]
    assert listener.end(3.0) == []
    assert isinstance(events[-1], NoiseSeen)
    assert isinstance(events[-1].noise, Noise)
