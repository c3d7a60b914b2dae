"""Recordings of CAN as other programs and people write them. Those of python-can are written here by python-can; the
older trace files are as the documentation of PEAK has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import can
import pytest
from can.io import CSVWriter, Printer, TRCWriter
from hypothesis import given, strategies as st

from barewire.canopen.frame import CanFrame, ErrorFrame, FdFrame
from barewire_workbench.monitor.recording import is_can_recording, is_timed, read_recording
from barewire_workbench.recordings.model import Recorded, Unread
from tests.helpers import modest

BEGAN = 1_700_000_000.5
FRAMES = ["605#4041600000000000", "585#4B41600037060000", "705#R1", "18FF0001#0102", "080#"]


def written(writer: Any, file: Path, *, remote: bool = True) -> bytes:
    output = writer(str(file))
    for place, text in enumerate(FRAMES):
        frame = CanFrame.parse(text)
        if frame.remote and not remote:
            continue
        output(can.Message(timestamp=BEGAN + place / 1000, arbitration_id=frame.id, is_extended_id=frame.extended,
                           data=frame.data, is_remote_frame=frame.remote, dlc=frame.dlc, channel="can0",
                           is_rx=place > 0))  # fmt: skip
    output.stop()
    return file.read_bytes()


@pytest.mark.parametrize(("writer", "ending"), [(Printer, "txt"), (CSVWriter, "csv"), (TRCWriter, "trc")])
def test_what_python_can_writes(writer: Any, ending: str, tmp_path: Path) -> None:
    data = written(writer, tmp_path / f"bus.{ending}", remote=ending != "trc")  # its trace files have no remote frames
    assert is_can_recording(data)
    assert is_timed(data)
    items = [item for item in read_recording(data) if isinstance(item, Recorded)]
    expected = [text for text in FRAMES if ending != "trc" or "#R" not in text]
    assert [str(item.frame) for item in items] == expected
    assert [round(item.at - BEGAN, 4) for item in items] == [FRAMES.index(text) / 1000 for text in expected]
    assert items[0].sent is (None if ending == "csv" else True)
    assert items[-1].sent is (None if ending == "csv" else False)


@pytest.mark.parametrize(
    ("line", "frame", "at"),
    [
        ("     1)      1841 0605  8  40 41 60 00 00 00 00 00", "605#4041600000000000", 1.841),
        ("     1)      1059.9  Rx         0605  8  40 41 60 00 00 00 00 00", "605#4041600000000000", 1.0599),
        ("     1)      1059.9 1  Tx        0605 -  8  40 41 60 00 00 00 00 00", "605#4041600000000000", 1.0599),
        ("     1)      1059.9  Rx     18FF0001  2  01 02", "18FF0001#0102", 1.0599),
        ("     1)      1059.9  Rx         0705  1  RTR", "705#R1", 1.0599),
    ],
)
def test_older_trace_files(line: str, frame: str, at: float) -> None:
    items = list(read_recording(f";\n;   Message Number\n;\n{line}\n".encode()))
    assert [(str(item.frame), round(item.at, 6)) for item in items if isinstance(item, Recorded)] == [(frame, at)]


def test_kinds_of_trace_lines() -> None:
    text = (
        ";$FILEVERSION=2.1\n;$STARTTIME=25569.0\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"
        "  1  10.000 RR  1  0705 Rx -  1\n"
        "  2  20.000 FD  1  0123 Rx -  2  AA BB\n"
        "  3  30.000 ER  1     - Rx -  5  04 00 02 00 00\n"
        "  4  40.000 ST  1     - Rx -  4  00 00 00 08\n"
        "  5  50.000 DT  1  0705 Rx -  2  05\n"
        "nonsense\n"
    )
    items = list(read_recording(text.encode()))
    frames = [item.frame for item in items if isinstance(item, Recorded)]
    assert [type(frame) for frame in frames] == [CanFrame, FdFrame, ErrorFrame]
    assert [item.line for item in items if isinstance(item, Unread)] == [8, 9]


def test_lines_of_the_printer_that_cannot_be_read() -> None:
    good = "Timestamp: 1.500000    ID:      705    S Rx                DL:  1    05     Channel: can0"
    items = list(read_recording(f"{good}\nrubbish\n{good.replace('DL:  1', 'DL:  2')}\n".encode()))
    assert [type(item) for item in items] == [Recorded, Unread, Unread]


@modest
@given(st.lists(st.text(alphabet=" 0123456789abRxTDS,=#:)(;$.-", max_size=50), max_size=4))
def test_any_lines(lines: list[str]) -> None:
    for head in (
        ";$FILEVERSION=2.1\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n",
        "timestamp,arbitration_id,extended,remote,error,dlc,data\n",
    ):
        for item in read_recording((head + "\n".join(lines)).encode()):
            assert item.at >= 0


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("182#4007\n\n202#0600\n", ["182#4007", "202#0600"]),
        ("60B   [8]  40 0A 10 00 00 00 00 00\n", ["60B#400A100000000000"]),
        ("082 40 81 10 12 47 00 fd 00\n", ["082#4081101247 00FD00".replace(" ", "")]),
        ("\t67F Tx SD  8  23 14 10 00 00 00 00 00\n", ["67F#2314100000000000"]),
        ("26.07.22 : 15:47:14.042 : Test CAN : CAN1  586 Rx SD  2  4F 01\n", ["586#4F01"]),
        ("Standard ID: 0x351       DLC: 4  Data: 0x44 0x02 0x64 0x00\n", ["351#44026400"]),
        ("Extended ID: 0x18FF0001  DLC: 2  Data: 0x44 0x02\n", ["18FF0001#4402"]),
        (
            "Sending :  <701> (3)      b'021001'\nReceiving : 1627616055.0 <781> (2) b'0650'\n",
            ["701#021001", "781#0650"],
        ),
    ],
)
def test_the_forms_of_notes(text: str, frames: list[str]) -> None:
    data = text.encode()
    assert is_can_recording(data)
    assert not is_timed(data)
    assert [str(item.frame) for item in read_recording(data) if isinstance(item, Recorded)] == frames


@pytest.mark.parametrize(
    "text",
    ["01 03 00 00 00 0A C5 CD", "182#40070\nand something else", "", "[01][03]", ":010300000001FB", "0103 0000 000A"],
)
def test_other_lines_are_no_notes(text: str) -> None:
    assert not is_can_recording(text.encode())


def test_a_frame_that_cannot_be_read_has_its_line() -> None:
    first, second = read_recording(b"705 [1] 05\n705 [2] 05")
    assert isinstance(first, Recorded)
    assert isinstance(second, Unread)
    assert second.line == 2


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
