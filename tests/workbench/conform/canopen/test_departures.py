"""Devices with one departure each: only the cases that name the cause fail, since the battery undoes what it writes."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, Entry, LocalNode, NmtCommand
from barewire.codecs import Value
from barewire_workbench.conform.canopen.battery import all_cases, prepare, run_case
from barewire_workbench.conform.canopen.probe import probe
from tests.canopen.virtual_bus import VirtualBus
from tests.helpers import part_or_whole, some_of
from tests.workbench.conform.canopen.devices import LARGE, NODE, SCRIPTS, FaultyDevice, bus_with, failures, plain

pytestmark = pytest.mark.long

BOOT_UP = CanFrame(0x700 + NODE, b"\0")
KEPT = {"NMT-17", "RPD-19", "TPD-19", "SYN-05", "CHN-06", "CHN-08", "CHN-12", "CHN-13", "CFG-02", "STO-03"}
"""The cases of what a reset of the communication restores."""
COMMUNICATION, WHOLE = NmtCommand.RESET_COMMUNICATION, NmtCommand.RESET_NODE


class SelfStarting:
    """A device that enters OPERATIONAL `delay` seconds after each boot-up message, as NMT autostart does."""

    def __init__(self, device: LocalNode, delay: float = 0.0) -> None:
        self.device = device
        self.delay = delay
        self.starts: float | None = None

    @property
    def deadline(self) -> float | None:
        dues = [due for due in (self.device.deadline, self.starts) if due is not None]
        return min(dues, default=None)

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        sent = self.device.feed(frame, now)
        if BOOT_UP in sent:
            self.starts = now + self.delay
        if self.starts is not None and now >= self.starts:
            self.starts = None
            sent += self.device.feed(CanFrame(0, bytes([NmtCommand.START, NODE])), now)
        return sent


class Keeping(FaultyDevice):
    """A device that keeps the values of 1000h to 1FFFh over these resets."""

    def __init__(self, device: LocalNode, *commands: NmtCommand) -> None:
        super().__init__(device, lambda device, received, sent: sent)
        self.resets = [CanFrame(0, bytes([command, NODE])) for command in commands]

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        kept = settings(self.device) if frame in self.resets else {}
        sent = super().feed(frame, now)
        for place, value in kept.items():
            self.device.objects.set(*place, value)
        return [*sent, *self.device.feed(None, now)]


def settings(device: LocalNode) -> dict[tuple[int, int], Value]:
    """Return the communication objects that can be written, and their values."""
    entries = [entry for entry in device.objects if entry.index < 0x2000 and entry.access == "rw"]
    places = [(entry.index, entry.sub) for entry in entries if entry.on_read is None]
    return {place: device.objects.get(*place) for place in places}


def switched_on(machine: SelfStarting | Keeping) -> VirtualBus:
    """Return a bus with this device, which has sent its boot-up message."""
    assert machine.device.start(0.0) == [BOOT_UP]
    return bus_with(machine)


def failed_of(machine: SelfStarting | Keeping, groups: tuple[str, ...] = ("",)) -> set[str]:
    """Return the names of the cases that fail, of the whole battery or of these groups."""
    bus = switched_on(machine)
    subject = bus.run(probe(NODE, timeout=0.1, large=LARGE))
    return set(failures(bus, subject, prefixes=groups))


part_or_all_groups = pytest.mark.parametrize("groups", part_or_whole(("NMT", "HB-", "STO", "CHN", "RND"), ("",)))
"""The groups that name the causes; `test_a_device_that_keeps_values_over_any_reset` runs the others, too."""


@part_or_all_groups
@pytest.mark.parametrize("delay", some_of([0.005, 0.0], 1))
def test_a_device_that_starts_itself(delay: float, groups: tuple[str, ...]) -> None:
    assert failed_of(SelfStarting(plain(), delay), groups) == {"NMT-19"}


@part_or_all_groups
def test_a_device_that_starts_itself_as_1f80h_allows_passes(groups: tuple[str, ...]) -> None:
    startup = Entry(0x1F80, 0, "NMT startup", "u32", "rw", 0)
    assert failed_of(SelfStarting(plain(startup)), groups) == set()


@part_or_all_groups
def test_1f80h_with_bit_2_forbids_to_start(groups: tuple[str, ...]) -> None:
    startup = Entry(0x1F80, 0, "NMT startup", "u32", "rw", 4)
    assert failed_of(SelfStarting(plain(startup)), groups) == {"NMT-19"}


def test_a_device_that_keeps_values_over_any_reset() -> None:
    assert failed_of(Keeping(plain(), COMMUNICATION, WHOLE)) == {*KEPT, "NMT-18", "STO-07"}


@part_or_all_groups
@pytest.mark.parametrize(("command", "found"), [(COMMUNICATION, KEPT), (WHOLE, {"NMT-18", "STO-07"})])
def test_a_device_that_keeps_values_over_one_reset(
    command: NmtCommand, found: set[str], groups: tuple[str, ...]
) -> None:
    assert failed_of(Keeping(plain(), command), groups) == {name for name in found if name.startswith(groups)}


@part_or_all_groups
def test_channels_that_are_on_are_switched_off_before_their_can_ids_are_restored(groups: tuple[str, ...]) -> None:
    """Our device refuses another CAN-ID while a channel is on."""
    device = plain()
    for sub, word in ((1, 0x6B0), (2, 0x6B1)):
        device.objects.set(0x1201, sub, word)
        device.objects.set(0x1280, sub, word)
    assert failed_of(Keeping(device, COMMUNICATION), groups) == {name for name in KEPT if name.startswith(groups)}
    assert [device.objects.get(index, sub) for index in (0x1201, 0x1280) for sub in (1, 2)] == [0x6B0, 0x6B1] * 2


@pytest.mark.parametrize(
    "name", ["SYN-04", "TPD-37", "RPD-14", "RPD-18", "HBC-07", "EMC-10", "GRD-06", "CHN-01", "RND-02"]
)
def test_what_a_case_writes_is_undone(name: str) -> None:
    """Also without a reset that restores it, all communication objects have their values again."""
    device = plain()
    bus = switched_on(Keeping(device, COMMUNICATION))
    subject = bus.run(probe(NODE, timeout=0.1, large=LARGE))
    made = all_cases(subject, [fields for fields in SCRIPTS if fields["name"] == name])  # and those at random
    (case,) = (case for case in made if case.name == name)
    bus.run(prepare(subject))
    before = settings(device)
    bus.run(run_case(case))
    assert settings(device) != before
    bus.run(prepare(subject, after=case))
    assert settings(device) == before
