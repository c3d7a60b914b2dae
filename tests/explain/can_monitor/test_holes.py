"""Frames taken out of a recording in which nothing was wrong: that is a gap, and never anybody's fault.

A hole may swallow all that would show it. What a transfer carries is then not told, and no rule of SDO is said to be
broken. Four rules stand on one frame that may have been in the hole: a start command, a question of guarding, a SYNC.
"""

from __future__ import annotations

import random
from functools import cache

import pytest

from barewire.canopen import CanFrame
from barewire.devices import load
from barewire.explain.can_monitor import CanMonitor, of_device
from barewire.explain.can_monitor.events import Gap, Loss, MonitorEvent, SdoTransferReport, Violation
from tests.explain.can_monitor.can_run import DRIVE, recorded

UNAVOIDABLE = {"PDO-NOT-OPERATIONAL", "GUARD-TOGGLE", "HEARTBEAT-TOGGLE", "SYNC-COUNTER"}


def listen(frames: list[tuple[float, CanFrame]]) -> list[MonitorEvent]:
    listener, events = CanMonitor([of_device(load("az3"), DRIVE)]), list[MonitorEvent]()
    for at, frame in frames:
        events += listener.feed(frame, at)
    return events + listener.end(frames[-1][0])


def carried(events: list[MonitorEvent]) -> set[tuple[object, ...]]:
    """What was read and written, as far as it is told."""
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
    """The run up to the long transfers in blocks, and a little more."""
    return tuple(recorded()[:1900])


@cache
def whole() -> frozenset[tuple[object, ...]]:
    return frozenset(carried(listen(list(run()))))


@pytest.mark.parametrize("length", [1, 2, 3, 10, 50])
def test_a_hole_is_nobodys_fault(length: int) -> None:
    dice, frames = random.Random(length), list(run())
    seen = 0
    for _ in range(15):
        at = dice.randrange(len(frames) - length)
        events = listen(frames[:at] + frames[at + length :])
        assert [one for one in events if isinstance(one, Loss)] == []
        assert {one.rule for one in events if isinstance(one, Violation)} <= UNAVOIDABLE
        assert carried(events) <= whole()
        seen += any(isinstance(one, Gap) for one in events)
    assert seen > 2
