"""The devices that the conformance battery is run against in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from barewire.canopen import (
    CanFrame,
    Entry,
    LocalNode,
    LssAddress,
    LssSlave,
    ObjectDictionary,
    PdoConfig,
    standard_objects,
)
from barewire.canopen.conformance.battery import cases, needs_reset, prepare, run_case
from barewire.canopen.conformance.model import NodeCase, NodeOutcome, Subject
from barewire.canopen.conformance.probe import probe
from barewire.canopen.eds import EdsObject
from barewire.devices.sim import simulator
from tests.canopen.virtual_bus import Participant, VirtualBus

NODE = 5
LARGE = (0x2100, 0)
ADDRESS = LssAddress(0x0000_0360, 0x1234, 0x0001_0002, 7)


def plain(*more: Entry) -> LocalNode:
    """Return a device with the objects that most cases need, and `more`."""
    objects = [
        *standard_objects(ADDRESS, device_type=0x0002_0192, name="barewire plain device", servers=4),
        Entry(0x1020, 1, "configuration date", "u32", "rw", 0),
        Entry(0x1020, 2, "configuration time", "u32", "rw", 0),
        *(
            Entry(index, sub, "COB-ID of an SDO client", "u32", "rw", 0x8000_0000)
            for index in (0x1280, 0x1281, 0x1282)
            for sub in (1, 2)
        ),
        Entry(0x1010, 1, "save all", "u32", "rw", 1),
        Entry(0x1011, 1, "restore all", "u32", "rw", 1),
        Entry(*LARGE, "anything", "domain", "rw", b""),
        Entry(0x6040, 0, "controlword", "u16", "rw", 0),
        Entry(0x6041, 0, "statusword", "u16", "ro", 0x0637),
        *more,
    ]
    pdos = [PdoConfig("RPDO", 1, (0x60400010,)), PdoConfig("TPDO", 1, (0x60410010,), type=1)]
    return LocalNode(NODE, ObjectDictionary(objects), pdos, lss=LssSlave(ADDRESS))


def az3() -> Participant:
    """Return the simulated drive."""
    node = simulator("az3", 0.0, node=NODE).canopen
    assert node is not None
    return node


def bus_with(device: Participant) -> VirtualBus:
    """Return a bus on which the device has been switched on."""
    bus = VirtualBus()
    bus.add(device, sent=device.start(0.0) if isinstance(device, LocalNode) else [])
    bus.pass_time(0.01)
    return bus


def subject_of(make: Callable[[], Participant], large: tuple[int, int] | None = None) -> Subject:
    """Return the result of probing such a device."""
    return bus_with(make()).run(probe(NODE, timeout=0.1, large=large))


def run_after_reset(
    bus: VirtualBus, subject: Subject, case: NodeCase, previous: NodeOutcome | None = None
) -> NodeOutcome:
    """Run one case, after a reset if it needs one."""
    if needs_reset(case, previous):
        bus.run(prepare(subject, after=previous and previous.case))
    return bus.run(run_case(case))


class FaultyDevice:
    """A device with some wrong or missing answers."""

    def __init__(
        self, device: LocalNode, change: Callable[[LocalNode, CanFrame | None, list[CanFrame]], list[CanFrame]]
    ):
        self.device = device
        self.change = change

    @property
    def deadline(self) -> float | None:
        return self.device.deadline

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        return self.change(self.device, frame, self.device.feed(frame, now))


def failures(
    bus: VirtualBus,
    subject: Subject,
    *,
    prefixes: tuple[str, ...] = ("",),
    objects: Mapping[int, EdsObject] | None = None,
) -> dict[str, str]:
    """Return the failures of the whole battery against one device that is not switched off, by the name of the case."""
    found: dict[str, str] = {}
    previous = None
    for case in cases(subject, objects):
        if case.lacks or case.effect == "power" or not case.name.startswith(prefixes):
            continue
        previous = run_after_reset(bus, subject, case, previous)
        if previous.failure is not None:
            found[case.name] = previous.failure
    return found
