"""The cases that write application objects: values within the limits of the EDS, put back afterwards."""

from __future__ import annotations

from dataclasses import replace

import pytest

from barewire.canopen import CanFrame, Entry, LocalNode
from barewire.canopen.eds import EdsObject
from barewire_workbench.conform.canopen.battery import prepare
from barewire_workbench.conform.canopen.model import NodeCase
from barewire_workbench.conform.canopen.probe import probe
from barewire_workbench.live.canopen_conformance import cases
from tests.canopen.virtual_bus import VirtualBus
from tests.workbench.conform.canopen.described import MORE, OBJECTS, described_with, device
from tests.workbench.conform.canopen.devices import NODE, FaultyDevice, bus_with, run_after_reset


def application_of(bus: VirtualBus, objects: dict[int, EdsObject] | None = None) -> dict[str, NodeCase]:
    """Return the cases that write application objects, and RND-05, by name."""
    subject = bus.run(probe(NODE, timeout=0.1, objects=objects or OBJECTS))
    made = cases(subject, objects or OBJECTS)
    return {case.name: case for case in made if case.effect == "application" or case.name == "RND-05"}


def written_by(case: NodeCase) -> set[tuple[int, int]]:
    frames = [CanFrame.parse(text) for step in case.steps for text in step.sends]
    initiates = [frame for frame in frames if frame.id == 0x605 and frame.data[0] & 0xE0 == 0x20]
    return {(int.from_bytes(frame.data[1:3], "little"), frame.data[3]) for frame in initiates}


def numbers_of(case: NodeCase) -> list[int]:
    frames = [CanFrame.parse(text) for step in case.steps for text in step.sends]
    return [int.from_bytes(frame.data[4:], "little", signed=True) for frame in frames if frame.data[0] & 0xE3 == 0x23]


def test_values_are_within_the_limits_and_the_controlword_is_never_written() -> None:
    made = application_of(bus_with(device()))
    speeds, offsets = numbers_of(made["OD-RANGE-2000:00"]), numbers_of(made["OD-RANGE-2001:00"])
    assert (speeds[0], speeds[-1]) == (10, 1000)
    assert (offsets[0], offsets[-1]) == (-100, 100)
    assert len(set(speeds)) == 5
    assert all(10 <= speed <= 1000 for speed in speeds)
    assert numbers_of(made["OD-RANGE-2010:01"]) == [1]  # it has no limits: its default
    assert numbers_of(made["OD-RANGE-2008:00"]) == [0, 1]
    assert written_by(made["RND-06"]) >= {(0x2000, 0), (0x2001, 0), (0x2005, 0)}
    assert not {place for case in made.values() for place in written_by(case)} & {(0x6040, 0), (0x2002, 0)}
    assert min(index for case in made.values() for index, _ in written_by(case)) >= 0x2000


def test_objects_that_the_eds_excludes_are_not_written() -> None:
    made = application_of(bus_with(device()), described_with(0x2000, 0, flags=1))
    assert "OD-RANGE-2000:00" not in made
    assert (0x2000, 0) not in written_by(made["RND-06"])


def test_a_limit_that_a_real32_can_only_pass_is_not_written() -> None:
    """The REAL32 nearest to -1E21 is -1.00000002E21, which a right device refuses."""
    described = described_with(0x2005, 0, low=-1e21, high=1e21)
    bus = bus_with(device(Entry(0x2005, 0, "gain", "f32", "rw", 1.5, -1e21, 1e21)))
    subject = bus.run(probe(NODE, timeout=0.1, objects=described))
    case = application_of(bus, described)["OD-RANGE-2005:00"]
    assert run_after_reset(bus, subject, case).failure is None


def test_the_values_before_are_put_back() -> None:
    node = device()
    bus = bus_with(node)
    node.objects.set(0x2000, 0, 333)
    subject = bus.run(probe(NODE, timeout=0.1, objects=OBJECTS))
    before = {(entry.index, entry.sub): node.objects.get(entry.index, entry.sub) for entry in MORE}
    for case in application_of(bus).values():
        assert run_after_reset(bus, subject, case).failure is None
        bus.run(prepare(subject, after=case))
        assert {place: node.objects.get(*place) for place in before} == before


def test_an_eds_without_application_objects_and_a_device_without_them() -> None:
    communication = {index: described for index, described in OBJECTS.items() if index < 0x2000}
    made = application_of(bus_with(device()), communication)
    assert set(made) == {"RND-05", "RND-06"}
    assert made["RND-06"].lacks == "a writable object from 2000h on"


@pytest.mark.parametrize(
    ("changed", "found"),
    [
        (Entry(0x2000, 0, "speed", "u16", "rw", 20, 10, 900), {"OD-RANGE-2000:00", "RND-06"}),
        (Entry(0x2001, 0, "offset", "i32", "rw", -5, -99, 100), {"OD-RANGE-2001:00", "RND-06"}),
        (Entry(0x2000, 0, "speed", "u16", "rw", 20, 10, 1000, on_read=lambda: 20), {"OD-RANGE-2000:00"}),
    ],
    ids=["refuses the upper limit", "refuses the lower limit", "keeps nothing"],
)
def test_a_device_that_departs(changed: Entry, found: set[str]) -> None:
    bus = bus_with(device(changed))
    subject = bus.run(probe(NODE, timeout=0.1, objects=OBJECTS))
    made = application_of(bus)
    assert {name for name, case in made.items() if run_after_reset(bus, subject, case).failure} == found


def test_a_refusal_because_of_other_objects_is_no_failure() -> None:
    def refuses(node: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
        return [CanFrame.parse("585#8000200036000906") if str(f).startswith("585#60002000") else f for f in sent]

    node = device()
    bus = VirtualBus()
    bus.add(FaultyDevice(node, refuses), sent=node.start(0.0))
    subject = bus.run(probe(NODE, timeout=0.1, objects=OBJECTS))
    made = application_of(bus)
    for name in ("OD-RANGE-2000:00", "RND-06"):
        assert run_after_reset(bus, subject, made[name]).failure is None


def test_the_structure_in_sub_index_ff() -> None:
    """A device may have it: 07h and the type of a variable, 08h and that of the elements, 09h and any type."""

    def failed(word: int) -> set[str]:
        node = device(Entry(0x2000, 0xFF, "structure", "u32", "ro", word))
        bus = bus_with(node)
        subject = bus.run(probe(NODE, timeout=0.1, objects=OBJECTS))
        made = [case for case in cases(subject, OBJECTS) if case.name.startswith("OD-TYPE-")]
        assert {"OD-TYPE-1000", "OD-TYPE-2000", "OD-TYPE-2010"} <= {case.name for case in made}
        return {case.name for case in made if run_after_reset(bus, subject, case).failure}

    assert failed(0x0607) == set()
    assert failed(0x0507) == {"OD-TYPE-2000"}
    assert failed(0x0608) == {"OD-TYPE-2000"}
    without = {**OBJECTS, 0x2000: replace(OBJECTS[0x2000], items=())}
    subject = bus_with(device()).run(probe(NODE, timeout=0.1, objects=without))
    assert "OD-TYPE-2000" not in {case.name for case in cases(subject, without)}
