"""Fastscan: unknown addresses of one or several devices, response times, lost frames."""

from __future__ import annotations

import random
from functools import partial
from typing import Any

import pytest

from barewire.canopen import (
    AssignedNode,
    CanFrame,
    LocalNode,
    LssAddress,
    LssRefused,
    LssSlave,
    LssState,
    ObjectDictionary,
    assign_node_ids,
    fastscan,
    identify_unconfigured,
)
from barewire.canopen.lss.master import FastscanProgress
from barewire.conversation import Abandoned, Conversation, Send, abort_frames
from barewire.errors import EncodeError, NoAnswer
from tests.canopen.virtual_bus import VirtualBus, never

ADDRESS = LssAddress(0x12345678, 0x9ABCDEF0, 0xFFFFFFFF, 0x00000001)
WORST = LssAddress(0xFFFFFFFF, 0xFFFFFFFF, 0xFFFFFFFF, 0xFFFFFFFF)
ZERO = LssAddress(0, 0, 0, 0)


def add(bus: VirtualBus, address: LssAddress, latency: float = 0.001) -> LocalNode:
    device = LocalNode(None, ObjectDictionary(), lss=LssSlave(address, store=lambda node, rate: True))
    bus.add(device, latency, device.start(0.0))
    return device


@pytest.mark.parametrize("latency", [0.0, 0.0008, 0.005, 0.016])
@pytest.mark.parametrize("address", [ADDRESS, WORST, ZERO], ids=["mixed", "all ones", "all zeros"])
def test_128_bits_in_five_seconds(address: LssAddress, latency: float) -> None:
    bus = VirtualBus()
    device = add(bus, address, latency)
    limit = 5.0 if latency < 0.01 else 8.0  # 16 ms: an adapter that delivers frames in batches
    assert bus.run(fastscan()) == address
    assert bus.now < limit
    assert device.lss is not None
    assert device.lss.state.name == "CONFIGURATION"


def test_a_scan_takes_128_steps_with_the_shortest_time_out() -> None:
    steps: list[FastscanProgress] = []
    bus = VirtualBus()
    add(bus, ADDRESS)
    bus.run(fastscan(progress=steps.append))
    assert len(steps) == 128
    assert [(step.part, step.bit) for step in (steps[0], steps[-1])] == [(0, 31), (3, 0)]
    assert {step.wait for step in steps} == {0.010}
    assert bus.now < 1.6


def test_without_devices_the_result_is_none() -> None:
    bus = VirtualBus()
    assert bus.run(fastscan(timeout=0.1)) is None
    assert bus.now == pytest.approx(0.2)


def test_known_parts_are_confirmed_not_scanned() -> None:
    bus = VirtualBus()
    add(bus, ADDRESS)
    steps: list[FastscanProgress] = []
    known = (ADDRESS.vendor, ADDRESS.product, None, None)
    assert bus.run(fastscan(known, progress=steps.append)) == ADDRESS
    assert {step.part for step in steps} == {2, 3}
    assert [assigned.node for assigned in bus.run(assign_node_ids([5], known))] == [5]


def test_known_parts_that_no_device_has() -> None:
    bus = VirtualBus()
    add(bus, ADDRESS)
    assert bus.run(fastscan((0x360, None, None, None))) is None
    assert bus.run(fastscan((ADDRESS.vendor, 1, None, None))) is None
    with pytest.raises(EncodeError, match="expected 4"):
        bus.run(fastscan((1, 2)))


@pytest.mark.parametrize("latencies", [(0.001, 0.001, 0.001), (0.001, 0.004, 0.009)], ids=["together", "apart"])
def test_several_devices_get_their_node_ids(latencies: tuple[float, ...]) -> None:
    bus = VirtualBus()
    addresses = [ADDRESS, LssAddress(0x12345678, 0x9ABCDEF0, 7, 8), LssAddress(0x12345678, 0x9ABCDEF0, 7, 9)]
    devices = [add(bus, address, latency) for address, latency in zip(addresses, latencies)]
    reported: list[AssignedNode] = []
    result = bus.run(assign_node_ids(range(10, 20), found=reported.append))
    assert result == reported
    assert sorted(assigned.address for assigned in result) == sorted(addresses)
    assert [(assigned.node, assigned.booted) for assigned in result] == [(10, True), (11, True), (12, True)]
    assert sorted(device.node or 0 for device in devices) == [10, 11, 12]


def test_assigning_ends_with_the_last_node_id() -> None:
    bus = VirtualBus()
    for serial in range(3):
        add(bus, LssAddress(1, 2, 3, serial))
    assert len(bus.run(assign_node_ids([5, 6]))) == 2


def with_slave(slave: LssSlave) -> VirtualBus:
    bus, device = VirtualBus(), LocalNode(None, ObjectDictionary(), lss=slave)
    bus.add(device, sent=device.start(0.0))
    return bus


@pytest.mark.parametrize("store", [True, False])
def test_a_device_that_cannot_store_gets_its_node_id(store: bool) -> None:
    slave = LssSlave(ADDRESS)
    assert with_slave(slave).run(assign_node_ids([5], ADDRESS, store=store)) == [AssignedNode(ADDRESS, 5, True, False)]
    assert (slave.node, slave.state) == (5, LssState.WAITING)


def test_a_device_whose_storage_fails_is_not_left_in_configuration() -> None:
    slave = LssSlave(ADDRESS, store=lambda node, rate: False)
    bus = with_slave(slave)
    with pytest.raises(LssRefused, match="no access to storage"):
        bus.run(assign_node_ids([5], ADDRESS))
    bus.run(identify_unconfigured())  # the last frame arrives meanwhile
    assert slave.state is LssState.WAITING


def test_an_assignment_abandoned_at_any_step_leaves_no_device_in_configuration() -> None:
    for steps in range(1, 1000):
        slave = LssSlave(ADDRESS)
        bus = with_slave(slave)
        conversation = assign_node_ids([5], ADDRESS)
        try:
            bus.run(_abandoned(conversation, steps))
        except Abandoned:
            bus.run(identify_unconfigured())  # the last frame arrives meanwhile
            assert slave.state is LssState.WAITING, steps
        else:
            assert steps > 10
            return
    raise AssertionError("it did not end")


def _abandoned(conversation: Conversation[CanFrame, Any], steps: int) -> Conversation[CanFrame, Any]:
    """Run a conversation, and abandon it at this step."""
    step = next(conversation)
    try:
        for _ in range(steps):
            step = conversation.send((yield step))
    except StopIteration as stop:
        return stop.value
    for frame in abort_frames(conversation):
        yield Send(frame)
    raise Abandoned("abandoned")


def is_number(missing: int, number: int, frame: CanFrame) -> bool:
    return number == missing


def test_any_single_lost_frame_does_not_change_the_result() -> None:
    """The right address is found, whichever frame is lost, and the device is in configuration."""
    bus = VirtualBus()
    add(bus, ADDRESS)
    bus.run(fastscan())
    frames = len(bus.log)
    for missing in [*range(1, frames + 1, 3), frames - 1, frames]:
        bus = VirtualBus(lose=partial(is_number, missing))
        device = add(bus, ADDRESS)
        assert bus.run(fastscan()) == ADDRESS, missing
        assert device.lss is not None
        assert device.lss.state.name == "CONFIGURATION"
        assert bus.now < 8.0, missing


@pytest.mark.parametrize("seed", range(10))
def test_two_percent_of_frames_lost(seed: int) -> None:
    generator = random.Random(seed)
    bus = VirtualBus(lose=lambda number, frame: generator.random() < 0.02)
    add(bus, ADDRESS)
    assert bus.run(fastscan()) == ADDRESS


def test_half_of_the_frames_lost_raises() -> None:
    generator = random.Random(1)
    bus = VirtualBus(lose=lambda number, frame: number > 40 and generator.random() < 0.5)
    add(bus, ADDRESS)
    with pytest.raises(NoAnswer, match="found no address"):
        bus.run(fastscan())


def test_frames_of_other_services_are_ignored() -> None:
    bus = VirtualBus(lose=never)
    add(bus, ADDRESS)
    for tick in range(2000):
        for text in ("000007E4#4F00000000000000", "7E4#R8", "705#05", "7E4#4F", "7E4#5000000000000000"):
            bus.inject(text, tick / 1000)
    assert bus.run(fastscan()) == ADDRESS


def test_late_answers_do_not_change_the_result() -> None:
    """A device with some late answers: the time-out adapts, or the confirmation detects the wrong bit."""

    class Slow:
        def __init__(self) -> None:
            self.device = LocalNode(None, ObjectDictionary(), lss=LssSlave(ADDRESS))
            self.device.start(0.0)
            self.waiting: list[tuple[float, CanFrame]] = []
            self.answers = 0

        @property
        def deadline(self) -> float | None:
            return self.waiting[0][0] if self.waiting else None

        def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
            for answer in self.device.feed(frame, now):
                self.answers += 1
                self.waiting.append((now + (0.030 if self.answers % 20 == 0 else 0.001), answer))
            due = [answer for when, answer in self.waiting if when <= now]
            self.waiting = [(when, answer) for when, answer in self.waiting if when > now]
            return due

    bus = VirtualBus()
    bus.add(Slow(), 0.0)
    assert bus.run(fastscan()) == ADDRESS
