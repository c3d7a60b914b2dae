"""Devices with unusual behaviour that the standard allows, seen in devices of others: no case fails because of it."""

from __future__ import annotations

import pytest

from barewire.canopen import AbortCode, CanFrame, Entry, LocalNode, SdoAbort
from barewire.canopen.lss.messages import REQUEST_KEY
from barewire.codecs import Value
from barewire_workbench.conform.canopen.probe import probe
from barewire_workbench.live.canopen_conformance import cases
from tests.canopen.virtual_bus import Participant
from tests.workbench.conform.canopen.described import described_with
from tests.workbench.conform.canopen.devices import LARGE, NODE, FaultyDevice, bus_with, failures, plain

ALARM = CanFrame.parse("085#0081101800000000")


def switched_on() -> LocalNode:
    """Return a device that has sent its boot-up message."""
    device = plain()
    assert [str(frame) for frame in device.start(0.0)] == ["705#00"]
    return device


def failed(device: Participant, *prefixes: str) -> dict[str, str]:
    """Return the failures of the cases with these beginnings of names, and check that none of them is left out."""
    bus = bus_with(device)
    subject = bus.run(probe(NODE, timeout=0.1, large=LARGE))
    wanted = [case for case in cases(subject) if case.name.startswith(prefixes)]
    assert wanted
    assert not [case.name for case in wanted if case.lacks]
    return failures(bus, subject, prefixes=prefixes)


def test_a_domain_that_accepts_only_ascending_bytes() -> None:
    """CANopenNode's demo device verifies that a domain gets 00h, 01h, 02h and so on."""

    def verify(value: Value) -> None:
        assert isinstance(value, bytes)
        if value != bytes(number & 0xFF for number in range(len(value))):
            raise SdoAbort(AbortCode.INVALID_VALUE, *LARGE)

    device = plain(Entry(0x2200, 0, "ascending", "domain", "rw", b"", on_write=verify))
    bus = bus_with(device)
    subject = bus.run(probe(NODE, timeout=0.1, large=(0x2200, 0)))
    assert failures(bus, subject, prefixes=("SEG-4", "BLK-5")) == {}


def test_a_device_that_aborts_a_repeated_last_segment_of_a_block() -> None:
    """After its acknowledgement a server expects the end of the transfer: 0504 0001h for anything else."""
    last: list[CanFrame | None] = [None]

    def change(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
        again = received is not None and received == last[0] and received.data[:1] == b"\x81"
        if received is not None:
            last[0] = received
        if not again:
            return sent
        device.feed(CanFrame.parse("605#8000000000000008"), 0.0)
        return [CanFrame.parse("585#8017100001000405")]

    assert failed(FaultyDevice(switched_on(), change), "BLK-3", "BLK-4") == {}


class MissingSync:
    """A device that reports a missing SYNC as an emergency, 0.15 s after it has ended its own."""

    def __init__(self) -> None:
        self.device = switched_on()
        self.due: float | None = None

    @property
    def deadline(self) -> float | None:
        return min((due for due in (self.device.deadline, self.due) if due is not None), default=None)

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        if frame is not None and str(frame).startswith("605#2305100080000000"):
            self.due = now + 0.15
        sent = self.device.feed(frame, now)
        if self.due is not None and now >= self.due:
            self.due = None
            sent = [*sent, ALARM]
        return sent


def test_an_emergency_because_of_a_missing_sync_is_not_a_sync() -> None:
    assert failed(MissingSync(), "SYN-0") == {}


def test_a_device_whose_clock_runs_a_little_fast_misses_an_rpdo_a_little_early() -> None:
    """An event timer of 100 ms runs out after 95 ms."""

    class Fast:
        device = switched_on()

        @property
        def deadline(self) -> float | None:
            return self.device.deadline

        def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
            if frame is not None and str(frame) == "605#2B00140564000000":
                frame = CanFrame.parse("605#2B0014055F000000")
            return self.device.feed(frame, now)

    assert failed(Fast(), "RPD-40") == {}


def test_a_device_without_the_lss_service_identify_remote_slave() -> None:
    """It is found by its LSS address; the three cases of the service are left out, all others run."""

    def change(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
        return [frame for frame in sent if not str(frame).startswith("7E4#4F")]

    bus = bus_with(FaultyDevice(switched_on(), change))
    subject = bus.run(probe(NODE, timeout=0.1))
    left_out = {case.name: case.lacks for case in cases(subject) if case.name.startswith("LSS") and case.lacks}
    assert left_out == dict.fromkeys(("LSS-10", "LSS-11", "LSS-12"), "LSS identify remote slave")
    assert failures(bus, subject, prefixes=("LSS",)) == {}


def test_a_device_that_does_not_answer_to_bit_rates() -> None:
    """The service configure bit timing is optional: CANopenNode ignores it where a program cannot set the rate."""

    def change(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
        return [frame for frame in sent if not str(frame).startswith("7E4#13")]

    assert failed(FaultyDevice(switched_on(), change), "LSS-1") == {}


def test_a_device_that_is_selected_by_the_parts_of_its_lss_address_in_any_order() -> None:
    """The standard has one order, and does not say what a device does that gets another."""
    parts: dict[int, CanFrame] = {}

    def change(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
        if received is None or received.key != (0x7E5, False) or not received.data:
            return sent
        if received.data[0] == 0x04:
            parts.clear()
        elif 0x40 <= received.data[0] <= 0x43:
            parts[received.data[0]] = received
        if len(parts) < 4 or sent:
            return sent
        ordered = [parts[number] for number in sorted(parts)]
        return [answer for frame in ordered for answer in device.feed(frame, 0.0)]

    assert failed(FaultyDevice(switched_on(), change), "LSS-0") == {}


def test_a_domain_that_is_a_variable_has_its_case_of_sub_indices() -> None:
    """The value of a domain, which may be long, is not read beforehand."""
    bus = bus_with(plain())
    objects = described_with(*LARGE, type="domain")
    subject = bus.run(probe(NODE, timeout=0.1, objects=objects))
    (case,) = (case for case in cases(subject, objects) if case.name == f"OD-SUB-{LARGE[0]:04X}")
    assert not case.lacks


class OneLssFrame:
    """A device with room for one LSS request, which its main loop takes every `period` seconds, as in CANopenNode."""

    def __init__(self, device: LocalNode, period: float) -> None:
        self.device = device
        self.period = period
        self.request: CanFrame | None = None
        self.taken_at = float("inf")

    @property
    def deadline(self) -> float | None:
        return min(self.taken_at, float("inf") if self.device.deadline is None else self.device.deadline)

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        if frame is None or frame.key != REQUEST_KEY:
            sent = self.device.feed(frame, now)
        else:
            sent, self.request = [], frame
            self.taken_at = min(self.taken_at, (now // self.period + 1) * self.period)
        if now >= self.taken_at:
            sent += self.device.feed(self.request, now)
            self.request, self.taken_at = None, float("inf")
        return sent


@pytest.mark.parametrize("period", [0.001, 0.003, 0.007, 0.012])
def test_a_device_with_room_for_one_lss_request(period: float) -> None:
    """A request that follows at once replaces the one before, which the device never sees."""
    assert failed(OneLssFrame(switched_on(), period), "LSS") == {}
