"""Heartbeats, and node guarding with life guarding, both sides, in virtual time."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    CanFrame,
    Guard,
    GuardedNode,
    GuardEvent,
    GuardingMaster,
    HeartbeatConsumer,
    HeartbeatProducer,
    LifeEvent,
    LocalNode,
    NmtState,
    NodeState,
    ObjectDictionary,
    consumer_entry,
    guarding_request,
    standard_objects,
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
    [(134072, (2, 3.0)), (68536, (1, 3.0)), (0, None), (0x00050000, None), (0x000003E8, None), (0x008503E8, None)],
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


def feed(master: GuardingMaster, text: str | None, now: float) -> list[str]:
    output = master.feed(None if text is None else CanFrame.parse(text), now)
    return [f"{item.kind} {item.node}" if isinstance(item, GuardEvent) else str(item) for item in output]


def test_the_master_polls_every_guard_time_and_expects_a_toggling_bit() -> None:
    master = GuardingMaster({5: Guard(1.0, 2)}, 0.0)
    assert feed(master, None, 0.0) == ["705#R1"]
    assert feed(master, "705#FF", 0.01) == ["answered 5"]  # either toggle bit: the node may have been guarded before
    assert master.deadline == 1.0
    assert feed(master, None, 1.0) == ["705#R1"]
    assert feed(master, "705#7F", 1.01) == []
    assert feed(master, None, 2.0) == ["705#R1"]
    assert feed(master, "705#85", 2.01) == ["state 5"]
    assert master.state(5) == NmtState.OPERATIONAL


def test_a_response_with_the_wrong_toggle_bit_does_not_count() -> None:
    master = GuardingMaster({5: Guard(1.0, 2)}, 0.0)
    feed(master, None, 0.0)
    feed(master, "705#05", 0.01)
    feed(master, None, 1.0)
    assert feed(master, "705#05", 1.01) == ["toggle 5"]
    assert feed(master, None, 2.0) == ["705#R1"]
    assert feed(master, None, 2.01) == ["lost 5"]
    assert master.state(5) is None
    assert feed(master, "705#85", 2.02) == ["answered 5"]


def test_a_boot_up_resets_the_toggle_bit() -> None:
    master = GuardingMaster({5: Guard(1.0)}, 0.0)
    feed(master, None, 0.0)
    assert feed(master, "705#05", 0.01) == ["answered 5"]
    assert feed(master, "705#00", 0.5) == ["booted 5"]
    assert feed(master, None, 1.0) == ["705#R1"]
    assert feed(master, "705#7F", 1.01) == ["state 5"]


def test_a_silent_node_is_lost_once_and_still_polled() -> None:
    master = GuardingMaster({5: Guard(1.0, 3)}, 0.0)
    sent = [feed(master, None, float(second)) for second in range(6)]
    assert sent == [["705#R1"], ["705#R1"], ["705#R1"], ["lost 5", "705#R1"], ["705#R1"], ["705#R1"]]


def test_requests_to_many_nodes_are_spread() -> None:
    master = GuardingMaster({node: Guard(1.0) for node in (1, 2, 3, 4)}, 0.0)
    assert [feed(master, None, quarter / 4) for quarter in range(5)] == [
        ["701#R1"],
        ["702#R1"],
        ["703#R1"],
        ["704#R1"],
        ["701#R1"],
    ]
    assert feed(master, "706#05", 1.1) == []  # not a guarded node
    assert feed(master, "00000701#05", 1.1) == []


def test_guards_are_checked() -> None:
    for guard in (Guard(0.0), Guard(1.0, 0)):
        with pytest.raises(EncodeError):
            GuardingMaster({5: guard}, 0.0)
    with pytest.raises(EncodeError):
        GuardingMaster({0: Guard(1.0)}, 0.0)


def test_life_guarding_starts_with_the_first_request() -> None:
    node = GuardedNode(5)
    node.life_time = 2.0
    assert node.deadline is None
    node.feed(guarding_request(5), 10.0)
    assert node.deadline == 12.0
    assert node.feed(None, 12.0) == [LifeEvent("lost", 12.0)]
    assert node.feed(None, 99.0) == []
    assert node.feed(guarding_request(5), 100.0)[0] == LifeEvent("resolved", 100.0)
    node.reset()
    assert node.deadline is None


def device() -> LocalNode:
    device = LocalNode(5, ObjectDictionary(standard_objects()))
    device.start(0.0)
    return device


def feed_device(device: LocalNode, text: str | None, now: float = 0.0) -> list[str]:
    return [str(frame) for frame in device.feed(None if text is None else CanFrame.parse(text), now)]


def test_a_device_responds_with_its_state_and_a_toggle_bit() -> None:
    node = device()
    assert feed_device(node, "705#R1") == ["705#7F"]
    feed_device(node, "000#0105")
    assert feed_device(node, "705#R1") == ["705#85"]
    feed_device(node, "000#0205")
    assert feed_device(node, "705#R1") == ["705#04"]
    assert feed_device(node, "000#8205") == ["705#00"]
    assert feed_device(node, "705#R1") == ["705#7F"]
    assert feed_device(node, "00000705#R1") == feed_device(node, "706#R1") == feed_device(node, "705#05") == []


def test_heartbeat_replaces_guarding() -> None:
    node = device()
    node.objects.set(0x1017, 0, 1000)
    assert feed_device(node, "705#R1", 0.0) == ["705#7F"]  # the first heartbeat, not a response
    assert feed_device(node, "705#R1", 0.5) == []
    node.objects.set(0x1017, 0, 0)
    assert feed_device(node, "705#R1", 0.6) == ["705#7F"]


@pytest.mark.parametrize(
    ("behaviour", "state"), [(0, NmtState.PRE_OPERATIONAL), (1, NmtState.OPERATIONAL), (2, NmtState.STOPPED)]
)
def test_life_guarding_sends_8130h_and_follows_1029h(behaviour: int, state: NmtState) -> None:
    node = device()
    node.objects.set(0x100C, 0, 500)
    node.objects.set(0x100D, 0, 3)
    node.objects.set(0x1029, 1, behaviour)
    feed_device(node, "000#0105")
    feed_device(node, "705#R1", 10.0)
    assert node.deadline == 11.5
    assert feed_device(node, None, 11.4) == []
    assert feed_device(node, None, 11.5) == ["085#3081110000000000"]
    assert node.state is state
    assert node.objects.get(0x1001) == 0x11
    sent = feed_device(node, "705#R1", 20.0)
    assert ("085#0000000000000000" in sent) is (state is not NmtState.STOPPED)
    assert node.objects.get(0x1001) == 0
