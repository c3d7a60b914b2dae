"""What goes wrong on a CAN bus, in the notations in which people post it: the cause is named, and no other one."""

from __future__ import annotations

import pytest

from barewire.canopen.frame import AnyFrame, CanFrame, ErrorFrame
from barewire_workbench.diagnosis.can_log import CanLogDiagnosis
from barewire_workbench.monitor.recording import is_can_recording, read_recording
from barewire_workbench.recordings.model import Recorded
from tests.workbench.diagnosis.can_notations import CAN_NOTATIONS, posted


def frames(*texts: str) -> list[AnyFrame]:
    return [CanFrame.parse(text) for text in texts]


READ = frames("605#4018100100000000", "585#4318100103000000")
NO_ACKNOWLEDGE: list[AnyFrame] = [ErrorFrame(0x88, bytes.fromhex("0000801900008000"))] * 5
CAUSES: dict[str, tuple[list[AnyFrame], set[str]]] = {
    "good": (READ + frames("705#05"), {"nothing-wrong"}),
    "good, of 29 bits": (frames("0CF00400#F87D7D0000000000", "1CE726A0#A87D69FFE60C0000"), {"not-seen"}),
    "read refused": (READ + frames("605#4000300000000000", "585#8000300000000206"), {"refused"}),
    "emergency without its register": (READ + frames("085#1023000000000000"), {"emcy-register", "nothing-proved"}),
    "no node-ID added": (READ + frames("580#4341600000000000"), {"foreign-cob-id", "nothing-proved"}),
    "a command for a state": (READ + frames("705#01"), {"state", "nothing-proved"}),
    "nobody acknowledges": (NO_ACKNOWLEDGE, {"not-acknowledged"}),
    "stuff errors": ([ErrorFrame(0x0C, bytes.fromhex("0030040000000000"))] * 5, {"bit-rate"}),
    "LSS store refused": (frames("7E5#0401000000000000", "7E5#1700000000000000", "7E4#1701000000000000"), {"refused"}),
}


@pytest.mark.parametrize("notation", CAN_NOTATIONS)
def test_frames_are_read_in_every_notation(notation: str) -> None:
    for sent, _ in CAUSES.values():
        text = posted(sent, notation).encode()
        assert is_can_recording(text)
        assert [item.frame for item in read_recording(text) if isinstance(item, Recorded)] == sent


@pytest.mark.parametrize("notation", CAN_NOTATIONS)
@pytest.mark.parametrize("cause", CAUSES)
def test_a_cause_is_named_and_no_other_one(cause: str, notation: str) -> None:
    sent, right = CAUSES[cause]
    diagnosis = CanLogDiagnosis()
    found = [finding for item in read_recording(posted(sent, notation).encode()) for finding in diagnosis.feed(item)]
    found += diagnosis.end()
    codes = {finding.finding.code for finding in found} | {verdict.code for _, verdict in diagnosis.verdicts()}
    assert codes == right


@pytest.mark.parametrize(
    "text",
    [
        "slave id: 1 data: 01 03 00 00 00 02 C4 0B",
        "unit ID 130, bytes: 01 03 00 00",
        "Tx:000001-01 03 00 00 00 02 C4 0B\nRx:000002-01 83 02 C0 F1",
        "00000010  01 03 00 00 00 02 c4 0b\n0000: 01 03 04 00 17",
        "see issue abc#12 of 2024, client id 605: data 12 of 13, transaction id: 0x605, len 6",
        "request 1234 4 registers from 0x100 2 times, at 605 8 o'clock",
        "100 4 01 03 00 00 00 02",
    ],
)
def test_texts_of_modbus_are_none_of_can(text: str) -> None:
    assert not is_can_recording(text.encode())
