"""Cyclic frames in virtual time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from barewire.canopen import (
    BootSlave,
    CanFrame,
    CyclicProducer,
    Guard,
    GuardingMaster,
    NetworkList,
    NmtCommand,
    SyncProducer,
    activate_bit_timing,
    boot_network,
    fastscan,
    scan,
    send_nmt,
)
from barewire.errors import EncodeError
from tests.helpers import every_case, refused

INF = float("inf")
ONE, TWO = CanFrame.parse("301#01"), CanFrame.parse("302#02")


def sent(producer: CyclicProducer, *times: float) -> list[str]:
    return [str(frame) for now in times for frame in producer.feed(None, now)]


def test_frames_take_turns_at_absolute_times() -> None:
    producer = CyclicProducer(0.1, ONE, TWO)
    assert producer.deadline is None
    assert sent(producer, 4.9) == []
    producer.start(5.0)
    assert sent(producer, 5.0, 5.04, 5.1, 5.27, 5.3) == ["301#01", "302#02", "301#01", "302#02"]
    assert producer.deadline == pytest.approx(5.4)
    producer.stop()
    assert (producer.deadline, sent(producer, 6.0)) == (None, [])
    producer.start(7.0)
    assert sent(producer, 7.0) == ["301#01"]


def test_what_was_due_during_a_pause_is_counted_and_not_sent_later() -> None:
    producer = CyclicProducer(0.1, ONE)
    producer.start(0.0)
    assert sent(producer, 0.0, 0.55, 0.56) == ["301#01", "301#01"]
    assert producer.missed == 4
    assert producer.deadline == pytest.approx(0.6)


def test_new_frames_are_sent_from_the_next_time_on() -> None:
    producer = CyclicProducer(0.1, ONE, TWO, ONE)
    producer.start(0.0)
    assert sent(producer, 0.0, 0.1) == ["301#01", "302#02"]
    producer.update(TWO)
    assert sent(producer, 0.21, 0.31) == ["302#02", "302#02"]


def test_a_tiny_period_sends_one_frame_a_call() -> None:
    producer = CyclicProducer(1e-300, ONE)
    producer.start(1e9)
    assert [len(producer.feed(None, 1e9 + step)) for step in range(3)] == [1, 1, 1]


@pytest.mark.parametrize("period", [0, -1.0, float("nan"), float("inf")])
def test_a_wrong_period_is_refused(period: float) -> None:
    with refused(EncodeError, f"period {period} s: expected a number of seconds above 0"):
        CyclicProducer(period, ONE)


@pytest.mark.parametrize("frames", [(), ("301#01",), (None,), (CanFrame(0x800),), (CanFrame(1, bytes(9)),)])
def test_wrong_frames_are_refused(frames: Any) -> None:
    with pytest.raises(EncodeError):
        CyclicProducer(0.1, *frames)
    producer = CyclicProducer(0.1, ONE)
    with pytest.raises(EncodeError):
        producer.update(*frames)
    assert producer.frames == (ONE,)


@pytest.mark.parametrize("overflow", [0, 2, 240])
def test_a_sync_producer_tells_all_its_frames(overflow: int) -> None:
    producer = SyncProducer(0.01, overflow=overflow, key=(0x99, True))
    assert producer.frames == tuple(producer.next_frame() for _ in range(max(1, overflow)))


@every_case(
    ("call", "wrong"),
    [
        (lambda seconds: next(activate_bit_timing(seconds)), (INF, -0.0001, 65.5354)),
        (lambda seconds: GuardingMaster({5: Guard(seconds)}, 0.0), (INF, 0.0)),
        (lambda seconds: BootSlave(5, guard_time=seconds), (INF, -1.0)),
        (lambda seconds: BootSlave(5, heartbeat=seconds), (-1.0,)),
        (lambda seconds: next(send_nmt(NmtCommand.START, 5, ask_every=seconds)), (INF, -1.0, 0.0)),
        (lambda seconds: next(scan([5], gap=seconds)), (-1.0,)),
        (lambda seconds: next(scan([5], listen=seconds)), (-1.0,)),
        (lambda seconds: next(boot_network(NetworkList([]), listen=seconds)), (-1.0,)),
        (lambda seconds: next(fastscan(floor=seconds)), (-1.0,)),
    ],
)
def test_what_is_no_time_is_refused_before_anything_is_sent(
    call: Callable[[float], object], wrong: tuple[float, ...]
) -> None:
    for seconds in (float("nan"), *wrong):
        with pytest.raises(EncodeError):
            call(seconds)
