"""The cases of an EDS: our device passes with its own EDS, and each departure fails the cases that name it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import pytest

from barewire.canopen import CanFrame, Entry, LocalNode
from barewire.canopen.eds import EdsItem, EdsObject
from barewire_workbench.conform.canopen.probe import probe
from barewire_workbench.live.canopen_conformance import case_names, cases
from tests.canopen.virtual_bus import VirtualBus
from tests.helpers import every_case, part_or_whole
from tests.workbench.conform.canopen.described import MORE, OBJECTS, described_with, device
from tests.workbench.conform.canopen.devices import NODE, bus_with, failures, run_after_reset


def failed_of(
    node: LocalNode,
    objects: Mapping[int, EdsObject] = OBJECTS,
    bus: VirtualBus | None = None,
    groups: tuple[str, ...] = ("OD-",),
) -> dict[str, str]:
    """Return the failures of the cases of the EDS."""
    bus = bus or bus_with(node)
    subject = bus.run(probe(NODE, timeout=0.1, objects=objects))
    return failures(bus, subject, prefixes=groups, objects=objects)


@pytest.mark.parametrize("groups", part_or_whole(("OD-", "RPD", "TPD"), ("",)))
def test_our_device_passes_with_its_own_eds(groups: tuple[str, ...]) -> None:
    """The cases of the EDS, and those of the PDOs that they map; and of all groups with `-m proof`."""
    bus = bus_with(device())
    subject = bus.run(probe(NODE, timeout=0.1, objects=OBJECTS))
    assert failures(bus, subject, prefixes=groups, objects=OBJECTS) == {}
    made = [case for case in cases(subject, OBJECTS) if case.name.startswith("OD-")]
    counted = Counter(case.name.split("-")[1] for case in made if not case.lacks)
    written = {"DEFAULT", "ACCESS", "WRITE", "LENGTH", "LIMIT", "RANGE"}
    assert set(counted) == {"READ", "SUB", "TYPE", "ABSENT", *written, "RPDO", "TPDO"}
    assert all(count >= 2 for count in counted.values()), counted
    assert all(case.clause.startswith(("CiA 301", "CiA 306")) for case in made)
    assert len({case.name for case in made}) == len(made)
    assert {case.name for case in made} <= set(case_names(OBJECTS))


def test_a_gentle_run_only_reads() -> None:
    subject = bus_with(device()).run(probe(NODE, timeout=0.1, objects=OBJECTS))
    for case in cases(subject, OBJECTS):
        if case.effect == "reads":
            sent = [CanFrame.parse(text) for step in case.steps for text in step.sends]
            assert not any(frame.data[:1] and frame.data[0] & 0xE0 == 0x20 for frame in sent if frame.id == 0x605)
    reading = {case.name.rpartition("-")[0] for case in cases(subject, OBJECTS) if case.effect == "reads"}
    assert {"OD-READ", "OD-SUB", "OD-ABSENT"} <= reading
    assert not reading & {"OD-DEFAULT", "OD-ACCESS", "OD-WRITE"}


def changed(place: tuple[int, int], **changes: object) -> Entry:
    """Return an entry of the device, changed."""
    (entry,) = (entry for entry in MORE if (entry.index, entry.sub) == place)
    return replace(entry, **changes)  # type: ignore[arg-type]


SPEED = (0x2000, 0)


@pytest.mark.parametrize("also", part_or_whole((), ("OD-",)))
@every_case(
    ("make", "found"),
    [
        (partial(device, changed(SPEED, type="u32")), {"OD-READ-2000:00"}),
        (partial(device, changed((0x2002, 0), type="u32")), {"OD-READ-2002:00"}),
        (partial(device, changed(SPEED, access="ro")), {"OD-WRITE-2000:00"}),
        (partial(device, changed(SPEED, default=30)), {"OD-DEFAULT-2000:00"}),
        (partial(device, changed((0x2003, 0), default="as repaired")), {"OD-DEFAULT-2003:00"}),
        (partial(device, changed((0x2006, 0), default="abc")), {"OD-DEFAULT-2006:00"}),
        (partial(device, changed(SPEED, minimum=None)), {"OD-LIMIT-2000:00"}),
        (partial(device, changed(SPEED, maximum=2000)), {"OD-LIMIT-2000:00"}),
        (partial(device, changed((0x2001, 0), minimum=None)), {"OD-LIMIT-2001:00"}),
        (partial(device, changed((0x2004, 0), maximum=None)), {"OD-LIMIT-2004:00"}),
        (partial(device, changed((0x2005, 0), minimum=None)), {"OD-LIMIT-2005:00"}),
        (partial(device, changed((0x2005, 0), maximum=None)), {"OD-LIMIT-2005:00"}),
        (partial(device, changed((0x2002, 0), access="rw")), {"OD-ACCESS-2002:00"}),
        (partial(device, changed((0x2004, 0), access="rw")), {"OD-READ-2004:00"}),
        (partial(device, changed((0x2006, 0), access="rw")), {"OD-ACCESS-2006:00"}),
        (partial(device, changed((0x2010, 2), access="rw")), {"OD-ACCESS-2010:02"}),
        (partial(device, missing=((0x2002, 0),)), {"OD-READ-2002:00"}),
        (partial(device, missing=((0x2010, 1),)), {"OD-READ-2010:01"}),
        (partial(device, missing=((0x2010, 4),)), {"OD-READ-2010:04", "OD-DEFAULT-2010:00"}),
        (partial(device, Entry(0x2010, 3, "third", "u8")), {"OD-SUB-2010"}),
        (partial(device, Entry(0x1002, 0, "status", "u32", "ro", 1)), {"OD-ABSENT-1002"}),
        (partial(device, Entry(0x6041, 0, "statusword", "u16", "ro", 0x637, mappable=())), {"OD-TPDO-6041:00"}),
        (partial(device, changed((0x2010, 1), mappable=("RPDO",))), {"OD-RPDO-2010:01"}),
        (partial(device, changed((0x2007, 0), mappable=("TPDO",))), {"OD-TPDO-2007:00"}),
    ],
)
def test_a_departure_from_the_eds_fails_the_case_that_names_it(
    make: Callable[[], LocalNode], found: set[str], also: tuple[str, ...]
) -> None:
    """No other case of its group fails, and none of all groups with `-m proof`."""
    groups = {name.rpartition("-")[0] for name in found}
    assert set(failed_of(make(), groups=(*groups, *also))) == found


def test_a_value_of_another_length_that_is_accepted_is_found() -> None:
    """The device takes the first two of three bytes, and fills one byte up; then its value is restored."""
    node = device()

    class Lax:
        deadline = None

        def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
            if frame is not None and frame.key == (0x600 + NODE, False) and frame.data[1:4] == b"\x00\x20\x00":
                frame = frame._replace(data=b"\x2b" + frame.data[1:]) if frame.data[0] in (0x27, 0x2F) else frame
            return node.feed(frame, now)

    bus = VirtualBus()
    bus.add(Lax(), sent=node.start(0.0))
    assert set(failed_of(node, bus=bus)) == {"OD-LENGTH-2000:00"}
    assert node.objects.get(0x2000) == 20


def test_a_mapping_that_the_eds_forbids_and_one_that_it_allows() -> None:
    assert set(failed_of(device(), described_with(0x6041, 0, pdo=False))) == {"OD-TPDO-6041:00"}
    assert set(failed_of(device(), described_with(0x2007, 0, pdo=True))) == {"OD-TPDO-2007:00"}


def test_values_that_the_device_computes_or_that_differ_from_device_to_device_are_not_compared() -> None:
    """A serial number, a measured value, an object with ObjFlags 2 (not to be read), one with 1 (not to be written)."""
    node = device(Entry(0x1018, 4, "serial number", "u32", "ro", 99), changed((0x2002, 0), default=8))
    assert failed_of(node) == {}
    subject = bus_with(device()).run(probe(NODE, timeout=0.1, objects=OBJECTS))
    silent = {case.name for case in cases(subject, described_with(*SPEED, flags=2))}
    assert not {name for name in silent if name.endswith("2000:00") and name.startswith(("OD-READ", "OD-DEFAULT"))}
    kept = {case.name for case in cases(subject, described_with(*SPEED, flags=1)) if case.name.endswith("2000:00")}
    assert kept == {"OD-READ-2000:00", "OD-DEFAULT-2000:00", "OD-RPDO-2000:00", "OD-TPDO-2000:00"}


def test_defaults_with_the_node_id() -> None:
    item = OBJECTS[0x1014].item()
    assert isinstance(item, EdsItem)
    from barewire.canopen.eds import Formula

    assert failed_of(device(), described_with(0x1014, 0, default=Formula(0x80))) == {}
    assert set(failed_of(device(), described_with(0x1014, 0, default=Formula(0x81)))) == {"OD-DEFAULT-1014:00"}


def dummy_failures(node: LocalNode, dummies: tuple[int, ...]) -> set[str]:
    """Return the failures of the cases of these dummies, and check that there is one for each."""
    bus = bus_with(node)
    subject = bus.run(probe(NODE, timeout=0.1, objects=OBJECTS))
    made = [case for case in cases(subject, OBJECTS, dummies) if case.name.startswith("OD-DUMMY-")]
    assert [case.name for case in made] == [f"OD-DUMMY-{code:04X}" for code in dummies]
    return {case.name for case in made if run_after_reset(bus, subject, case).failure is not None}


def test_dummies_that_the_eds_allows_can_be_mapped_with_their_width() -> None:
    assert dummy_failures(device(), (1, 2, 3, 4, 5, 6, 7)) == set()
    assert dummy_failures(device(), ()) == set()


@pytest.mark.parametrize(
    ("old", "new", "passes"),
    [("585#600016010000", "585#80001601410004", False), ("585#80001601410004", "585#600016010000", True)],
    ids=["dummies are refused", "any width is accepted"],
)
def test_a_device_that_refuses_dummies_departs_and_one_that_accepts_any_width_does_not(
    old: str, new: str, passes: bool
) -> None:
    """The length in a mapping entry may be used to verify the mapping (CiA 301, object 1600h), but need not be."""
    node = device()

    class Other:
        deadline = None

        def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
            sent = [str(answer) for answer in node.feed(frame, now)]
            if frame is not None and str(frame).startswith("605#23001601"):
                sent = [text.replace(old, new).ljust(20, "0")[:20] for text in sent]
            return [CanFrame.parse(text) for text in sent]

    bus = VirtualBus()
    bus.add(Other(), sent=node.start(0.0))
    subject = bus.run(probe(NODE, timeout=0.1, objects=OBJECTS))
    (case,) = (case for case in cases(subject, OBJECTS, (5,)) if case.name == "OD-DUMMY-0005")
    assert (run_after_reset(bus, subject, case).failure is None) is passes
