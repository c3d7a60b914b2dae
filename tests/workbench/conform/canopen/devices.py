"""The devices that the conformance battery is run against in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from barewire.canopen import (
    CanFrame,
    LocalNode,
)
from barewire.canopen.eds import EdsObject
from barewire.devices.sim import simulator
from barewire_workbench.conform.canopen.battery import all_cases, needs_reset, prepare, run_case
from barewire_workbench.conform.canopen.model import NodeCase, NodeOutcome, Subject
from barewire_workbench.conform.canopen.probe import probe
from barewire_workbench.live.canopen_conformance import FILES
from barewire_workbench.vectors.answers import device_conformance as conformance
from tests.canopen.virtual_bus import Participant, VirtualBus
from tests.workbench.vectors.loaded import VECTORS

ADDRESS, LARGE, NODE = conformance.ADDRESS, conformance.LARGE, conformance.NODE
plain = conformance.plain_device
_CASES = {file.name: file.cases for file in VECTORS.files}
SCRIPTS = [case for name in FILES for case in _CASES[f"canopen/conform-{name}"]]


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
    for case in all_cases(subject, [fields for fields in SCRIPTS if fields["name"].startswith(prefixes)], objects):
        if case.lacks or case.effect == "power" or not case.name.startswith(prefixes):
            continue
        previous = run_after_reset(bus, subject, case, previous)
        if previous.failure is not None:
            found[case.name] = previous.failure
    return found
