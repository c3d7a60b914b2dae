"""Gaps in the recording and losses on the bus: every frame of each transfer and random frames of a run are removed."""

from __future__ import annotations

import random
from binascii import crc_hqx
from collections.abc import Callable, Sequence
from functools import cache

import pytest

from barewire.canopen import BlockSettings, CanFrame, Channel, ErrorFrame, SdoAbort, download, upload
from barewire.canopen.frame import AnyFrame
from barewire.devices import load
from barewire.errors import NoAnswer
from barewire_workbench.monitor import CanMonitor, KnownNode, event_line, of_device
from barewire_workbench.monitor.events import (
    Gap,
    Loss,
    MonitorEvent,
    NodeReport,
    SdoTransferReport,
    SyncReport,
    Violation,
)
from barewire_workbench.recordings.model import Dropped
from tests.canopen.virtual_bus import VirtualBus, never
from tests.helpers import part_or_whole
from tests.workbench.monitor.recorded_run import DRIVE, PLAIN, of, plain, recorded

VALUE = bytes(range(1, 100))
Timed = list[tuple[float, CanFrame]]
Bus = Callable[[VirtualBus, Channel], None]


def expedited(bus: VirtualBus, channel: Channel) -> None:
    bus.run(upload(channel, 0x6000, 0))
    bus.run(download(channel, 0x6001, 0, b"\x10\x00"))


def segments_up(bus: VirtualBus, channel: Channel) -> None:
    bus.run(upload(channel, 0x1008, 0, block=False))


def segments_down(bus: VirtualBus, channel: Channel) -> None:
    bus.run(download(channel, 0x2100, 0, VALUE[:30], block=False))


def block_down(bus: VirtualBus, channel: Channel) -> None:
    bus.run(download(channel, 0x2100, 0, VALUE, block=True))


def block_up(bus: VirtualBus, channel: Channel) -> None:
    bus.run(upload(channel, 0x1008, 0, block=BlockSettings(size=2)))


TRANSFERS = [expedited, segments_up, segments_down, block_down, block_up]


def carried_out(kind: Bus, lose: Callable[[int, CanFrame], bool] = never) -> Timed:
    """Return the frames on the bus: the transfer, and one more after it."""
    bus = VirtualBus(lose=lose)
    node = plain()
    bus.add(node, sent=node.start(0.0))
    bus.pass_time(0.1)
    channel = Channel(PLAIN)
    for step in (kind, expedited):
        try:
            step(bus, channel)
        except (NoAnswer, SdoAbort):
            bus.pass_time(1.0)
        bus.pass_time(0.1)
    bus.pass_time(5.0)
    return sorted(((now, CanFrame.parse(text)) for now, text in bus.log), key=lambda pair: pair[0])


@cache
def whole(kind: Bus) -> tuple[tuple[float, CanFrame], ...]:
    return tuple(carried_out(kind))


def events_of(
    frames: Sequence[tuple[float, AnyFrame | Dropped]], known: Sequence[KnownNode] = ()
) -> list[MonitorEvent]:
    monitor, events = CanMonitor(known), list[MonitorEvent]()
    for now, frame in frames:
        events += monitor.feed(frame, now)
    return events + monitor.end(frames[-1][0] + 10)


@pytest.mark.parametrize("kind", TRANSFERS)
def test_a_complete_recording_has_no_gap_loss_or_violation(kind: Bus) -> None:
    events = events_of(whole(kind))
    assert of(Gap, events) + of(Loss, events) + of(Violation, events) == []
    assert {report.outcome for report in of(SdoTransferReport, events)} == {"done"}
    assert all(
        report.data is not None and not (report.missing or report.again or report.lost)
        for report in of(SdoTransferReport, events)
    )


@pytest.mark.parametrize("kind", TRANSFERS)
def test_a_frame_missing_in_the_recording_is_no_loss_and_no_violation(kind: Bus) -> None:
    """Both sides received the frame, so no rule was broken and nothing was lost on the bus."""
    frames = whole(kind)
    values = {report.data for report in of(SdoTransferReport, events_of(frames))}
    for place in range(1, len(frames)):
        events = events_of([*frames[:place], *frames[place + 1 :]])
        lines = [event_line(event) for event in events]
        assert of(Violation, events) + of(Loss, events) == [], (place, lines)
        found = of(SdoTransferReport, events)
        # No value is invented, and an incomplete transfer is marked.
        assert {report.data for report in found if report.outcome == "done"} - {None} <= values, (place, lines)
        assert all(
            report.missing or report.outcome != "done" or report.data is not None or report.began is None
            for report in found
        ), (place, lines)
        if len(found) == len(of(SdoTransferReport, events_of(frames))) and all(
            report.outcome == "done" and report.data is not None for report in found
        ):
            assert any(report.missing or report.began is None for report in found), (place, lines)


@pytest.mark.parametrize("kind", TRANSFERS)
def test_a_frame_lost_on_the_bus_is_no_gap_and_no_violation(kind: Bus) -> None:
    """The frame reached no receiver. The recording is complete, and no rule was broken."""
    count = len(whole(kind))
    values = {report.data for report in of(SdoTransferReport, events_of(whole(kind)))}
    for place in range(2, count + 1):
        frames = carried_out(kind, lambda number, frame, lost=place: number == lost)  # type: ignore[misc]
        events = events_of(frames)
        lines = [event_line(event) for event in events]
        assert of(Violation, events) + of(Gap, events) == [], (place, lines)
        found = of(SdoTransferReport, events)
        assert {report.data for report in found if report.outcome == "done"} <= values, (place, lines)
        # If only an acknowledgement was lost, the one repeated after the time-out is the first one received.
        slow = [report for report in found if report.began is not None and report.at - report.began > 0.5]
        lossy = slow + [
            report for report in found if report.lost or report.again or report.outcome != "done" or report.late
        ]
        losses = of(Loss, events)
        assert lossy or losses, (place, lines)


def events_of_lines(*lines: str, step: float = 0.001) -> list[MonitorEvent]:
    """Return the events of frames at regular times."""
    return events_of([(place * step, CanFrame.parse(line)) for place, line in enumerate(lines)])


BLOCK = ("609#C6002100 0A000000", "589#A4002100 04000000")
PARTS = ("609#01 30313233343536", "609#82 37383900000000")


def test_a_segment_that_is_recorded_but_not_acknowledged_is_a_loss() -> None:
    """The segment is recorded but not acknowledged, so the bus or the receiver lost it."""
    lines = [*BLOCK, *PARTS, "589#A2010400 00000000", "609#81 37383900000000", "589#A2010400 00000000"]
    events = events_of_lines(
        *(line.replace(" ", "") for line in [*lines, "609#D1589C0000000000", "589#A100000000000000"])
    )
    (done,) = of(SdoTransferReport, events)
    assert (done.outcome, done.data, done.crc, done.lost, done.again) == ("done", b"0123456789", "ok", 1, 1)
    assert [loss.evidence for loss in of(Loss, events)] == [
        "acknowledged up to 1 of 2: segment 2, which is in the recording, did not arrive"
    ]
    assert of(Gap, events) + of(Violation, events) == []


def test_segments_after_an_early_acknowledgement_belong_to_the_old_block() -> None:
    """Some servers acknowledge at the first gap; segments that the client sent meanwhile belong to the old block."""
    value = bytes(range(1, 36))
    parts = [value[start : start + 7].hex() for start in range(0, 35, 7)]
    lines = [
        *("609#C600210023000000", "589#A400210005000000", f"609#01{parts[0]}", f"609#03{parts[2]}"),
        *("589#A201050000000000", f"609#04{parts[3]}", f"609#85{parts[4]}"),
        *(f"609#{number:02X}{part}" for number, part in zip((1, 2, 3, 0x84), parts[1:])),
        *("589#A204050000000000", f"609#C1{_crc(value)}0000000000", "589#A100000000000000"),
    ]
    events = events_of_lines(*lines)
    (done,) = of(SdoTransferReport, events)
    assert (done.data, done.crc, done.lost) == (value, "ok", 1)
    assert of(Gap, events) + of(Violation, events) == []


def _crc(value: bytes) -> str:
    return crc_hqx(value, 0).to_bytes(2, "little").hex()


# Holes in time ---------------------------------------------------------------------------------------------------


def beats(node: int, period: float, until: float, start: float = 0.0) -> Timed:
    count = int((until - start) / period) + 1
    return [(start + place * period, CanFrame.parse(f"{0x700 + node:X}#05")) for place in range(count)]


def merged(*rows: Timed) -> Timed:
    return sorted((pair for row in rows for pair in row), key=lambda pair: pair[0])


def without(frames: Timed, begin: float, end: float) -> Timed:
    return [(now, frame) for now, frame in frames if not begin <= now < end]


def test_two_nodes_silent_at_once_are_a_gap_in_the_recording() -> None:
    frames = without(merged(beats(5, 1.0, 30), beats(6, 0.7, 30)), 10.0, 18.0)
    (gap,) = of(Gap, events_of(frames))
    assert (round(gap.since or 0, 1), gap.evidence[:12]) == (9.8, "2 heartbeats")
    assert not [report for report in of(NodeReport, events_of(frames)[:-1]) if report.kind == "missing"][:-2]


def test_one_silent_node_is_missing() -> None:
    frames = merged(without(beats(5, 1.0, 30), 10.0, 18.0), beats(6, 0.7, 38))
    events = events_of(frames)
    assert of(Gap, events) == []
    kinds = [(report.kind, round(report.at, 3)) for report in of(NodeReport, events) if report.node == 5]
    lines = [pair for pair in kinds if pair[0] != "beat"]
    assert lines == [("heard", 0.0), ("missing", 11.5), ("back", 18.0), ("missing", 32.5)]


def test_every_silent_node_is_missing_if_time_is_fed() -> None:
    """A caller that feeds None has received without a break."""
    monitor, events = CanMonitor(), list[MonitorEvent]()
    for now, frame in merged(beats(5, 1.0, 5), beats(6, 0.7, 5)):
        events += monitor.feed(frame, now)
    while (due := monitor.deadline) is not None:
        events += monitor.feed(None, due)
    events += monitor.feed(CanFrame.parse("705#05"), 30.0)
    assert of(Gap, events) == []
    assert [report.node for report in of(NodeReport, events) if report.kind == "missing"] == [6, 5]


def test_a_silent_transfer_and_a_silent_node_are_a_gap() -> None:
    frames = without(beats(5, 1.0, 30), 10.0, 18.0)
    frames += [(9.5, CanFrame.parse("609#4008100000000000")), (9.6, CanFrame.parse("589#4108100015000000"))]
    events = events_of(merged(frames))
    (gap,) = of(Gap, events)
    assert gap.evidence.startswith("1 heartbeat, 1 transfer: all silent at once")
    assert [report.outcome for report in of(SdoTransferReport, events)] == ["cut"]


def test_a_sync_counter_that_jumps_is_a_gap_or_a_violation_by_its_time() -> None:
    def sync(now: float, number: int) -> tuple[float, CanFrame]:
        return now, CanFrame(0x80, bytes([number]))

    frames = [sync(place / 100, place % 10 + 1) for place in range(20)]
    incomplete = frames[:12] + frames[15:]
    (gap,) = of(Gap, events_of(incomplete))
    assert gap.frames == 3
    jump = frames[:12] + [sync(now, frame.data[0] % 10 + 1) for now, frame in frames[12:]]
    assert [report.rule for report in of(Violation, events_of(jump))] == ["SYNC-COUNTER"]
    assert of(Gap, events_of(jump)) == []
    summary = [report for report in of(SyncReport, events_of(frames)) if report.kind == "summary"]
    assert (summary[0].beats, round(summary[0].period or 0, 6)) == (20, 0.01)


def test_losses_reported_by_the_recorder_are_gaps() -> None:
    ask, take = CanFrame.parse("609#4008100000000000"), CanFrame.parse("589#4B08100015000000")
    overrun = ErrorFrame(0x04, b"\0\1\0\0\0\0\0\0")
    for item, frames in ((Dropped(0.0, "can0", 7), 7), (Dropped(0.0, "can0", 0), None), (overrun, None)):
        events = events_of([(0.0, ask), (0.1, item), (0.2, take)])
        (gap,) = of(Gap, events)
        assert gap.frames == frames


def test_a_clock_that_goes_back_is_a_gap() -> None:
    frames = [*beats(5, 1.0, 10), (2.0, CanFrame.parse("705#05")), (3.0, CanFrame.parse("705#05"))]
    events = events_of(frames)
    (gap,) = of(Gap, events)
    assert gap.evidence == "the clock goes back by 8.000 s"
    assert all(report.kind != "missing" for report in of(NodeReport, events) if report.at <= 3.0)
    mixed = events_of([*beats(5, 1.0, 10), (9.9, CanFrame.parse("080#"))])
    assert of(Gap, mixed) == []


def test_a_repeated_request_is_only_an_unanswered_transfer() -> None:
    """The same request again may be a poll, so only the missing answer is reported."""
    events = events_of_lines("605#4041600000000000", "605#4041600000000000", "585#4B41600037060000")
    assert [report.outcome for report in of(SdoTransferReport, events)] == ["unanswered", "done"]
    assert of(Gap, events) + of(Loss, events) + of(Violation, events) == []


def test_a_late_answer_is_marked() -> None:
    monitor = CanMonitor()
    events = monitor.feed(CanFrame.parse("605#4041600000000000"), 0.0)
    events += monitor.feed(None, 3.0)
    events += monitor.feed(CanFrame.parse("585#4B41600037060000"), 3.5)
    assert [(report.outcome, report.late, report.began) for report in of(SdoTransferReport, events)] == [
        ("unanswered", False, 0.0),
        ("done", True, 0.0),
    ]


@pytest.mark.parametrize("start", range(1, 12))
def test_a_recording_that_begins_within_a_block(start: int) -> None:
    """Segments are not taken for other messages, although their numbers look like commands."""
    frames = list(whole(block_down))[start:]
    events = events_of(frames)
    first, *others = of(SdoTransferReport, events)
    assert of(Violation, events) == []
    assert (first.manner, first.began, first.data) == ("block", None, None) or start == 1
    assert [report.manner for report in others] == ["expedited", "expedited"]


# Random frames of a long run

DEPEND_ON_ONE_FRAME = {"PDO-NOT-OPERATIONAL", "GUARD-TOGGLE", "HEARTBEAT-TOGGLE", "SYNC-COUNTER"}
"""Rules that depend on a single frame, such as a start command, a guarding request or a SYNC, which may be missing."""


def transferred(events: list[MonitorEvent]) -> set[tuple[object, ...]]:
    """Return the values that were read and written, as far as they are reported."""
    complete = [
        report for report in of(SdoTransferReport, events) if report.outcome == "done" and report.data is not None
    ]
    return {
        (report.node, report.index, report.sub, report.direction, report.data)
        for report in complete
        if report.index is not None
    }


@pytest.mark.parametrize("runs", part_or_whole(3, 15))
@pytest.mark.parametrize("length", [1, 2, 3, 10, 50])
def test_frames_taken_out_of_a_recording_break_no_sdo_rule(length: int, runs: int) -> None:
    known = [of_device(load("az3"), DRIVE)]
    dice, frames = random.Random(length), recorded()[:1900]  # up to the long block transfers, and some frames more
    values, gaps = transferred(events_of(frames, known)), 0
    for _ in range(runs):
        begin = dice.randrange(len(frames) - length)
        events = events_of(frames[:begin] + frames[begin + length :], known)
        assert of(Loss, events) == []
        assert {event.rule for event in of(Violation, events)} <= DEPEND_ON_ONE_FRAME
        assert transferred(events) <= values  # no value is invented
        gaps += bool(of(Gap, events))
    assert gaps > runs // 6
