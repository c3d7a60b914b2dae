"""Node guarding and life guarding, both sides, in virtual time."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    CanFrame,
    Guard,
    GuardedNode,
    GuardEvent,
    GuardingMaster,
    LifeEvent,
    LocalNode,
    NmtState,
    ObjectDictionary,
    guarding_request,
    standard_objects,
)
from barewire.errors import EncodeError


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
