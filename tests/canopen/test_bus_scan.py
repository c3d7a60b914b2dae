"""Scanning a bus: nodes are found with their evidence, and no others."""

from __future__ import annotations

from itertools import pairwise

import pytest

from barewire.canopen import CanFrame, Entry, LocalNode, ObjectDictionary, scan, standard_objects
from barewire.errors import EncodeError
from tests.canopen.virtual_bus import VirtualBus


def add(bus: VirtualBus, node: int, *, heartbeat: int = 0, device_type: int = 0x20192) -> LocalNode:
    device = LocalNode(node, ObjectDictionary(standard_objects(heartbeat=heartbeat, device_type=device_type)))
    bus.add(device, 0.003, device.start(bus.now))
    return device


def test_127_nodes_with_few_requests_at_a_time() -> None:
    bus = VirtualBus()
    for node in (1, 5, 127):
        add(bus, node)
    bus.pass_time(0.1)
    requested: list[int] = []
    result = bus.run(scan(outstanding=4, gap=0.002, timeout=0.05, progress=lambda node, result: requested.append(node)))
    assert list(result.nodes) == [1, 5, 127]
    assert {node.why for node in result.nodes.values()} == {"answered"}
    assert result.nodes[5].device_type == 0x20192
    assert result.nodes[5].answered_after == pytest.approx(0.0035)
    assert requested == list(range(1, 128))
    times = [time for time, text in bus.log if text.startswith("6") or text[:2] == "67"]
    assert min(later - sooner for sooner, later in pairwise(times)) >= 0.002 - 1e-9
    for time in times:
        assert sum(time - 0.05 < other <= time for other in times) <= 4 + 3  # three were answered at once


def test_a_stopped_node_is_found_by_its_heartbeat() -> None:
    bus = VirtualBus()
    add(bus, 5, heartbeat=500)
    bus.inject("000#0205", 0.0)
    bus.pass_time(0.1)
    assert list(bus.run(scan([5])).nodes) == []
    node = bus.run(scan([5], listen=0.6)).nodes[5]
    assert node.state is not None
    assert (node.state.name, node.device_type) == ("stopped", None)
    assert node.why.startswith("heartbeat")


def test_evidence_of_every_kind() -> None:
    bus = VirtualBus()
    for text in ("701#00", "701#7F", "702#05", "702#05", "083#3081110200000000", "584#4F00200005000000"):
        bus.inject(text, 0.001)
    result = bus.run(scan(ask=False, listen=0.1))
    assert {number: node.why for number, node in result.nodes.items()} == {
        1: "boot-up, heartbeat",
        2: "heartbeat (2 times)",
        3: "emergency",
        4: "SDO response to another client",
    }
    assert result.nodes[3].emergency is not None
    assert result.frames == 6
    assert [text for _, text in bus.log if text[:1] == "6"] == []  # no request was sent


def test_frames_of_other_protocols_are_not_evidence() -> None:
    bus = VirtualBus()
    for tick in range(100):
        for text in ("00000581#4300100092010200", "00000701#05", "00000081#0010010000000000", "18FEF100#FFFFFFFF",
                     "702#R1", "582#R8", "583#", "704#", "085#00", "185#1122", "123#00"):  # fmt: skip
            bus.inject(text, tick / 200)
    result = bus.run(scan(range(1, 10), timeout=0.02))
    assert result.nodes == {}
    assert result.extended > 10
    assert result.unknown > 10


def test_aborts_and_segmented_responses_are_evidence_too() -> None:
    class Odd:
        deadline = None

        def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
            answers = {0x605: "585#8000100000000206", 0x606: "586#4100100010000000"}
            return [CanFrame.parse(answers[frame.id])] if frame is not None and frame.id in answers else []

    bus = VirtualBus()
    bus.add(Odd())
    result = bus.run(scan([5, 6]))
    assert result.nodes[5].abort == 0x06020000
    assert (result.nodes[6].device_type, result.nodes[6].why) == (None, "answered")
    assert bus.log[-1][1] == "606#8000100000000008"  # the transfer is aborted


def test_node_ids_are_checked() -> None:
    with pytest.raises(EncodeError):
        VirtualBus().run(scan([0]))


def test_a_scan_ends_on_a_busy_bus() -> None:
    """The scan ends however many frames arrive."""
    bus = VirtualBus()
    objects = ObjectDictionary([Entry(0x1000, 0, "device type", "u32", "const", 0)])
    device = LocalNode(9, objects)
    bus.add(device, sent=device.start(0.0))
    for tick in range(5000):
        bus.inject("185#1122334455667788", tick / 2000)
    result = bus.run(scan(range(1, 20), timeout=0.05))
    assert list(result.nodes) == [9]
