"""Faults of single CAN frames are found with their proof; good frames, and what is not proved, yield nothing."""

from __future__ import annotations

from random import Random

import pytest

from barewire.canopen import CanFrame
from barewire.canopen.frame import ErrorFrame
from barewire.canopen.sdo.messages import ExpeditedDownload, ExpeditedUpload, InitiateUpload
from barewire.devices import load
from barewire_workbench.diagnosis.can import diagnose_can
from barewire_workbench.monitor import of_device
from barewire_workbench.monitor.pdos import PdoTracker
from tests.helpers import every_case
from tests.workbench.monitor.recorded_run import DRIVE, recorded

AZ3 = of_device(load("az3"), DRIVE)

FAULTS = {
    "605#4341600000000000": ("sdo-read-command", "605#4041600000000000 is SDO request to node 5: initiate upload"),
    "67F#4B00100000000000": ("sdo-read-command", "67F#4000100000000000 is"),
    "605#2B40600007": ("sdo-size", "605#2B40600007: 5 bytes, 4 before the data"),
    "585#4341600037": ("sdo-size", "585#4341600037: 5 bytes"),
    "605#40416000": ("cut-frame", "605#4041600000000000 is SDO request to node 5"),
    "585#60406000": ("cut-frame", "585#6040600000000000 is SDO answer from node 5"),
    "085#1042080000000000": ("emcy-register", "the register 08h says temperature"),
    "085#1042000000000000": ("emcy-register", "the register 00h says no error"),
    "085#1042490000000000": ("emcy-register", "the register 49h"),
    "600#4000100000000000": ("foreign-cob-id", "for node 1: 601#4000100000000000 is SDO request to node 1"),
    "580#4300100091010F00": ("foreign-cob-id", "for node 1: 581#4300100091010F00 is SDO answer"),
    "6E5#00": ("foreign-cob-id", "6E5#00; CiA 301"),
    "000#0501": ("role", "000#0105 is NMT: start, node 5"),
    "000#0500": ("state", "000#0100 is NMT"),
    "705#01": ("state", "705#05 is error control from node 5: operational"),
}
WITH_THE_DEVICE = {
    "605#2340600006000000": ("sdo-size", "6040h:00 CONTROL WORD of node 5 is u16"),
    "605#4060410000000000": ("address-byte-order", "605#4041600000000000 is 6041h:00 STATUS WORD"),
    "605#4B41600037060000": ("role", "585#4B41600037060000 is SDO answer from node 5"),
    "185#37": ("short-pdo", "185#37, "),
}
GOOD = (
    *("605#4041600000000000", "585#4B41600037060000", "605#2B40600006000000", "705#05", "705#00", "705#7F", "000#0105"),
    *("085#1042090000000000", "085#0000000000000000", "085#0000010000000000", "080#", "080#05", "100#000000000000"),
    *("185#0102", "200#0102", "001#", "705#R", "1FFFFFFF#00", "605#8041600000000206", "605#", "600#01", "605#60"),
    *("605#43414243444546", "605#4301020304050607", "7E5#0401000000000000"),
)  # fmt: skip


@every_case("text", FAULTS)
def test_a_fault_is_found_with_the_frame_that_was_meant(text: str) -> None:
    findings = diagnose_can(CanFrame.parse(text))
    code, proof = FAULTS[text]
    assert (findings[0].code, proof in findings[0].proof) == (code, True), findings


@pytest.mark.parametrize("text", WITH_THE_DEVICE)
def test_the_description_of_a_node_shows_more_faults(text: str) -> None:
    frame = CanFrame.parse(text)
    code, proof = WITH_THE_DEVICE[text]
    found = diagnose_can(frame, PdoTracker((AZ3,)))[0]
    assert (found.code, proof in found.proof) == (code, True), found
    assert code not in {finding.code for finding in diagnose_can(frame)}


@every_case("text", GOOD)
def test_good_frames_and_frames_that_prove_nothing_have_no_finding(text: str) -> None:
    assert diagnose_can(CanFrame.parse(text)) == []


def test_a_command_byte_that_a_device_is_known_to_use_is_no_fault() -> None:
    frame = CanFrame.parse("605#4B41600000000000")
    assert diagnose_can(frame)[0].code == "sdo-read-command"
    assert diagnose_can(frame, PdoTracker((AZ3,)), {DRIVE: AZ3.commands}) == []


def test_an_error_frame_alone_proves_nothing() -> None:
    assert diagnose_can(ErrorFrame(0x88)) == []


def test_good_frames_of_every_service_have_no_finding() -> None:
    pdos, dialects = PdoTracker((AZ3,)), {DRIVE: AZ3.commands}
    assert [(str(frame), found) for _, frame in recorded() if (found := diagnose_can(frame, pdos, dialects))] == []


def test_random_good_sdo_frames_have_no_finding() -> None:
    random = Random(15)
    for _ in range(2000):
        node, index, sub = random.randint(1, 127), random.randint(0x1000, 0xBFFF), random.randint(0, 255)
        value = random.randbytes(random.randint(1, 4))
        for identifier, data in (
            (0x600 + node, InitiateUpload(index, sub).encode()),
            (0x600 + node, ExpeditedDownload(index, sub, value).encode()),
            (0x580 + node, ExpeditedUpload(index, sub, value).encode()),
        ):
            assert diagnose_can(CanFrame(identifier, data)) == []
