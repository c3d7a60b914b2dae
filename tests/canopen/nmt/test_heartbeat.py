"""Heartbeat: the state byte, its producer, its consumer."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    CanFrame,
    HeartbeatConsumer,
    HeartbeatProducer,
    NmtState,
    NodeState,
    consumer_entry,
    guarding_request,
)
from barewire.errors import DecodeError, EncodeError


# The two tables of the AZ3's guide: 4.3.1 (with the toggle bit of guarding) and 4.4 (heartbeat).
@pytest.mark.parametrize(
    ("byte", "name", "toggle"),
    [
        ("00", "initialising", False),
        ("04", "stopped", False),
        ("84", "stopped", True),
        ("05", "operational", False),
        ("85", "operational", True),
        ("7F", "pre-operational", False),
        ("FF", "pre-operational", True),
        ("2A", "state 2Ah", False),
    ],
)
def test_state_byte(byte: str, name: str, toggle: bool) -> None:
    state = NodeState.decode(CanFrame.parse(f"70F#{byte}"))
    assert (state.node, state.name, state.toggle) == (15, name, toggle)
    assert str(state.encode()) == f"70F#{byte}"
    assert state.is_boot_up is (byte == "00")


def test_bytes_behind_the_state_are_ignored() -> None:
    assert NodeState.decode(CanFrame.parse("705#0500")).state == 5


@pytest.mark.parametrize("text", ["705#", "705#R1", "00000705#05", "585#05", "700#05"])
def test_frames_without_a_state_raise(text: str) -> None:
    with pytest.raises(DecodeError):
        NodeState.decode(CanFrame.parse(text))


def test_guarding_request() -> None:
    assert str(guarding_request(5)) == "705#R1"


# 1016h as the AZ3's parameter list has it.
@pytest.mark.parametrize(
    ("word", "entry"),
    [(134072, (2, 3.0)), (68536, (1, 3.0)), (0, None), (0x00050000, None), (0x000003E8, None)],
)
def test_consumer_entries(word: int, entry: tuple[int, float] | None) -> None:
    assert consumer_entry(word) == entry


def test_producer_has_absolute_times_and_sends_no_bursts() -> None:
    producer = HeartbeatProducer(5)
    producer.set_period(1.0, 0.0)
    assert str(producer.boot_up(0.0)) == "705#00"
    producer.state = NmtState.PRE_OPERATIONAL
    assert producer.feed(None, 0.999) == []
    assert [str(frame) for frame in producer.feed(None, 1.25)] == ["705#7F"]
    assert producer.deadline == 2.0  # not 2.25
    assert len(producer.feed(None, 7.5)) == 1  # six heartbeats late, one is sent
    assert producer.deadline == 8.0


def test_producer_without_period_sends_nothing_until_it_has_one() -> None:
    producer = HeartbeatProducer(5)
    producer.boot_up(0.0)
    assert producer.deadline is None
    assert producer.feed(None, 100.0) == []
    producer.state = NmtState.OPERATIONAL
    producer.set_period(0.5, 100.0)
    assert [str(frame) for frame in producer.feed(None, 100.0)] == ["705#05"]
    producer.set_period(0.5, 100.1)  # the same again does not start anew
    assert producer.deadline == 100.5
    producer.set_period(0.0, 100.2)
    assert producer.deadline is None


def kinds(consumer: HeartbeatConsumer, text: str | None, now: float) -> list[tuple[int, str]]:
    frame = None if text is None else CanFrame.parse(text)
    return [(event.node, event.kind) for event in consumer.feed(frame, now)]


def test_consumer_reports_every_change_once() -> None:
    consumer = HeartbeatConsumer({5: 1.5})
    assert consumer.liveness(5) == "unknown"
    assert consumer.state(5) is None
    assert kinds(consumer, "705#7F", 0.0) == [(5, "active")]
    assert kinds(consumer, "705#7F", 1.0) == []
    assert kinds(consumer, "705#05", 2.0) == [(5, "state")]
    assert consumer.deadline == 3.5
    assert kinds(consumer, None, 3.4) == []
    assert kinds(consumer, None, 3.5) == [(5, "lost")]
    assert kinds(consumer, None, 99.0) == []
    assert (consumer.liveness(5), consumer.state(5)) == ("lost", NmtState.OPERATIONAL)
    assert kinds(consumer, "705#05", 100.0) == [(5, "active")]
    assert kinds(consumer, "705#00", 100.5) == [(5, "rebooted")]
    assert consumer.liveness(5) == "unknown"
    assert consumer.deadline is None  # a boot-up message starts no watch
    assert kinds(consumer, "705#7F", 101.0) == [(5, "active")]


def test_consumer_reports_a_late_node_as_lost_and_then_active() -> None:
    consumer = HeartbeatConsumer({5: 1.0})
    consumer.feed(CanFrame.parse("705#05"), 0.0)
    assert kinds(consumer, "705#05", 5.0) == [(5, "lost"), (5, "active")]


def test_consumer_follows_all_nodes_but_monitors_only_those_with_a_time() -> None:
    consumer = HeartbeatConsumer({5: 1.0})
    assert kinds(consumer, "706#00", 0.0) == [(6, "booted")]
    assert kinds(consumer, "706#7F", 0.1) == [(6, "active")]
    assert consumer.deadline is None
    assert kinds(consumer, "00000705#05", 0.2) == []
    assert kinds(consumer, "705#R1", 0.3) == []


def test_consumer_times_are_checked() -> None:
    with pytest.raises(EncodeError):
        HeartbeatConsumer({0: 1.0})
    with pytest.raises(EncodeError):
        HeartbeatConsumer({5: 0.0})


def test_an_expected_node_is_lost_without_any_heartbeat() -> None:
    consumer = HeartbeatConsumer({5: 1.0})
    consumer.expect(5, 3.0)
    assert consumer.deadline == 3.0
    assert kinds(consumer, None, 3.0) == [(5, "lost")]
    consumer.expect(5, 10.0)
    assert kinds(consumer, "705#7F", 9.0) == [(5, "active")]
    assert consumer.deadline == 10.0  # its heartbeat time, from now on


def test_a_new_time_restarts_monitoring() -> None:
    consumer = HeartbeatConsumer({5: 1.0, 6: 1.0})
    for node in ("705", "706"):
        kinds(consumer, f"{node}#05", 0.0)
    consumer.watch({5: 2.0, 6: 1.0})
    assert (consumer.liveness(5), consumer.liveness(6)) == ("unknown", "active")
    assert kinds(consumer, None, 1.0) == [(6, "lost")]
    consumer.watch({})
    assert consumer.deadline is None
