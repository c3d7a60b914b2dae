"""The log of the CANopen conformance test tool: its frames, who sent them, and what is not a frame."""

from __future__ import annotations

import pytest

from barewire_workbench.monitor.recording import is_can_recording, is_timed, read_recording
from barewire_workbench.recordings.model import Recorded, Unread

HEAD = """
General	: ### Prepare DUT for test #####################
Test Notice	: Reset node (wait for 5000[ms])
"""
LOG = f"""{HEAD}Test CAN	: CAN1  000 Tx SD  2  81 04
Test Notice	: Bootup message received
Test CAN	: CAN1  704 Rx SD  1  00
Test CAN	: CAN1  080 Tx SD  0
Test Notice	: SDO 07: Valid abort codes are 05040001h or 08000000h
Test CAN	: CAN1  604 Tx SD  8  E0 00 10 00 00 00 00 00
Test CAN	: CAN2  18EF0001 Rx ED  2  01 02
Test CAN	: CAN1  704 Tx SR  1
"""


def test_the_frames_and_who_sent_them() -> None:
    assert is_can_recording(LOG.encode())
    assert not is_timed(LOG.encode())
    items = list(read_recording(LOG.encode()))
    assert all(isinstance(item, Recorded) for item in items)
    assert [(item.bus, str(item.frame), item.sent, item.line) for item in items if isinstance(item, Recorded)] == [
        *(("CAN1", "000#8104", True, 4), ("CAN1", "704#00", False, 6), ("CAN1", "080#", True, 7)),
        *(("CAN1", "604#E000100000000000", True, 9), ("CAN2", "18EF0001#0102", False, 10)),
        ("CAN1", "704#R1", True, 11),
    ]
    assert [round(item.at, 3) for item in items] == [0.001, 0.002, 0.003, 0.004, 0.005, 0.006]


@pytest.mark.parametrize(
    "line",
    [
        *("CAN1  704 Rx SD  2  00", "CAN1  904 Rx SD  1  00", "CAN1  704 Rx SD  9  00 00 00 00 00 00 00 00 00"),
        *("CAN1  704 Rx SD  1  0G", "CAN1  704 Rx SD  1  0", "CAN1  704 Zx SD  1  00", "CAN1", ""),
    ],
)
def test_a_line_that_is_no_frame_is_reported_with_its_number(line: str) -> None:
    items = list(read_recording(f"{LOG}Test CAN	: {line}\n".encode()))
    assert isinstance(items[-1], Unread)
    assert (items[-1].line, len(items)) == (12, 7)


def test_other_text_is_not_this_log() -> None:
    assert not is_can_recording(HEAD.encode())
    assert not is_can_recording(b"Test CAN	: the bus is off")
    assert is_timed(b"(1.5) can0 705#05")
    assert not is_timed(b"  can0  705   [1]  05\n")
