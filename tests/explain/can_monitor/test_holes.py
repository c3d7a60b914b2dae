"""Frames taken out of a faultless recording: a gap, but no violation of an SDO rule and no invented value.

A hole may contain every frame that would show it. Four rules depend on a single frame that may be in the hole, such as
a start command, a guarding request or a SYNC; only these may be reported.
"""

from __future__ import annotations

import random
from functools import cache

import pytest

from barewire.canopen import CanFrame
from barewire.devices import load
from barewire.explain.can_monitor import CanMonitor, of_device
from barewire.explain.can_monitor.events import Gap, Loss, MonitorEvent, SdoTransferReport, Violation
from tests.explain.can_monitor.recorded_run import DRIVE, recorded

DEPEND_ON_ONE_FRAME = {"PDO-NOT-OPERATIONAL", "GUARD-TOGGLE", "HEARTBEAT-TOGGLE", "SYNC-COUNTER"}


def listen(frames: list[tuple[float, CanFrame]]) -> list[MonitorEvent]:
    monitor, events = CanMonitor([of_device(load("az3"), DRIVE)]), list[MonitorEvent]()
    for at, frame in frames:
        events += monitor.feed(frame, at)
    return events + monitor.end(frames[-1][0])


def carried(events: list[MonitorEvent]) -> set[tuple[object, ...]]:
    """The values that were read and written, as far as they are reported."""
    return {
        (one.node, one.index, one.sub, one.direction, one.data)
        for one in events
        if isinstance(one, SdoTransferReport)
        and one.outcome == "done"
        and one.data is not None
        and one.index is not None
    }


@cache
def run() -> tuple[tuple[float, CanFrame], ...]:
    """The run up to the long block transfers, and some frames more."""
    return tuple(recorded()[:1900])


@cache
def whole() -> frozenset[tuple[object, ...]]:
    return frozenset(carried(listen(list(run()))))


@pytest.mark.parametrize("length", [1, 2, 3, 10, 50])
def test_frames_taken_out_of_a_recording_break_no_sdo_rule(length: int) -> None:
    dice, frames = random.Random(length), list(run())
    seen = 0
    for _ in range(15):
        at = dice.randrange(len(frames) - length)
        events = listen(frames[:at] + frames[at + length :])
        assert [one for one in events if isinstance(one, Loss)] == []
        assert {one.rule for one in events if isinstance(one, Violation)} <= DEPEND_ON_ONE_FRAME
        assert carried(events) <= whole()
        seen += any(isinstance(one, Gap) for one in events)
    assert seen > 2
