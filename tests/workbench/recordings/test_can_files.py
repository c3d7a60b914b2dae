"""Recordings as files: held against python-can's own readers, in odd forms, and damaged."""

from __future__ import annotations

import json
import random
import re
import struct
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import can
import pytest

from barewire.canopen import CanFrame, ErrorFrame, FdFrame
from barewire.canopen.frame import AnyFrame
from barewire_workbench.monitor import event_as_dict, event_line
from barewire_workbench.monitor.recording import (
    CanRecordingWriter,
    is_can_recording,
    is_timed,
    read_recording,
    replay_can,
)
from barewire_workbench.recordings.can_texts import read_asc
from barewire_workbench.recordings.candump import log_line
from barewire_workbench.recordings.capture import SOCKETCAN, to_packet
from barewire_workbench.recordings.model import FD_LENGTHS, Dropped, Recorded, RecordedItem, Unread
from tests.helpers import part_or_whole
from tests.workbench.recordings.test_blf import blf, classical, container
from tests.workbench.recordings.test_can_text_forms import BEGAN, MIXED, frames, message

READERS = {"log": can.CanutilsLogReader, "asc": can.ASCReader, "blf": can.BLFReader}
WRITERS = {"log": can.CanutilsLogWriter, "asc": can.ASCWriter, "blf": can.BLFWriter}


def random_frames(count: int, seed: int) -> list[AnyFrame]:
    dice = random.Random(seed)
    made: list[AnyFrame] = []
    for _ in range(count):
        extended = dice.random() < 0.3
        number = dice.randrange(0x2000_0000 if extended else 0x800)
        if dice.random() < 0.3:
            made.append(FdFrame(number, dice.randbytes(dice.choice(FD_LENGTHS)), extended, dice.randrange(4)))
        elif dice.random() < 0.2:
            made.append(CanFrame(number, b"", extended, True, dice.randrange(9)))
        else:
            made.append(CanFrame(number, dice.randbytes(dice.randrange(9)), extended))
    return made


def shown(frame: AnyFrame) -> tuple[Any, ...]:
    """Return the comparable parts of a frame; the ASC of python-can drops the requested length of a remote frame."""
    if isinstance(frame, ErrorFrame):
        return ("error",)
    fd = isinstance(frame, FdFrame)
    flags = frame.flags if isinstance(frame, FdFrame) else 0
    return frame.id, frame.extended, fd, not fd and getattr(frame, "remote", False), flags, frame.data


def shown_by_python_can(message: can.Message) -> tuple[Any, ...]:
    if message.is_error_frame:
        return ("error",)
    flags = (message.bitrate_switch | message.error_state_indicator << 1) if message.is_fd else 0
    return (
        # The ASC reader of python-can takes a CAN FD frame without data for a remote frame, which CAN FD does not have.
        *(
            message.arbitration_id,
            message.is_extended_id,
            message.is_fd,
            message.is_remote_frame and not message.is_fd,
            flags,
        ),
        b"" if message.is_remote_frame else bytes(message.data),
    )


@pytest.mark.parametrize("form", READERS)
def test_random_frames_are_read_as_python_can_reads_them(form: str, tmp_path: Path) -> None:
    """Random frames in one file: kind, identifier, data, flags and times are those that python-can reads."""
    file = tmp_path / f"run.{form}"
    made = random_frames(600, seed=len(form))
    if form != "log":
        made.insert(300, ErrorFrame(0x80))
    with WRITERS[form](str(file)) as writer:
        for place, frame in enumerate(made):
            writer.on_message_received(message(BEGAN + place / 1000, frame))
    ours = [item for item in read_recording(file.read_bytes()) if isinstance(item, Recorded)]
    with READERS[form](str(file)) as reader:
        messages = list(reader)
    assert (
        [shown(item.frame) for item in ours]
        == [shown_by_python_can(message) for message in messages]
        == [shown(frame) for frame in made]
    )
    began = ours[0].at - float(messages[0].timestamp)
    assert all(abs(item.at - began - float(message.timestamp)) < 2e-6 for item, message in zip(ours, messages))
    if form != "asc":
        assert [item.frame.dlc for item in ours if isinstance(item.frame, CanFrame)] == [
            message.dlc for message in messages if not message.is_fd and not message.is_error_frame
        ]


# Text and captures of others -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252"])
def test_names_and_comments_in_windows_1252_are_read(encoding: str) -> None:
    text = "date Sam Nov 14 2023\nbase hex  timestamps absolute\n// Prüfstand für Öfen\n 0.5 1  705  Rx   d 1 05\n"
    for data in (text.encode(encoding), "# Prüfstand\n(1.5) can0 705#05\n".encode(encoding)):
        assert is_can_recording(data)
        assert [str(item.frame) for item in read_recording(data) if isinstance(item, Recorded)] == ["705#05"]


ASC_OF_OLD = """\
date Wed Apr 16 09:21:13 2014
base dec  timestamps relative
// version 7.0.0
internal events logged
   0.500000 1  1797            Rx   d 1 5
   0.250000 1  418119424x      Tx   d 2 255 16
   0.250000 2  1797            Rx   r
// 0.0 1 1797 Rx d 1 5
"""
ASC_OF_NOW = """\
date Mon Jan 2 03:04:05.678 pm 2023
base hex  timestamps absolute
no internal events logged
// version 13.0.0
Begin TriggerBlock Mon Jan 2 03:04:05.678 pm 2023
   0.000000 Start of measurement
   0.100000 1  705             Rx   d 1 05  Length = 114015 BitCount = 59 ID = 1797
   0.200000 CANFD   1 Rx        123                                   1 0 9 12 {twelve}   13 130   303000 {rest}
   0.300000 CANFD   1 Tx   18EBFF00x  Name_1                          0 1 f 64 {zeros}  130000  130   204000 {rest}
   0.400000 CANFD   1 Rx        605                            0 0 8  8 40 41 60 00 00 00 00 00   130000  130   0 {rest}
   0.500000 1  ErrorFrame
   0.600000 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%
End TriggerBlock
""".format(
    twelve="00 01 02 03 04 05 06 07 08 09 0a 0b",
    zeros=" ".join(["00"] * 64),
    rest="0 46500250 4b140250 20011736 2001040d",
)


def test_asc_files_of_several_versions_are_read() -> None:
    old = [item for item in read_asc(ASC_OF_OLD) if isinstance(item, Recorded)]
    assert [(item.at, item.bus, str(item.frame)) for item in old] == [
        (0.5, "1", "705#05"), (0.75, "1", "18EBFF00#FF10"), (1.0, "2", "705#R"),
    ]  # fmt: skip
    now = list(read_asc(ASC_OF_NOW))
    assert [str(item.frame) for item in now if isinstance(item, Recorded)] == [
        *("705#05", "123##1000102030405060708090A0B", "18EBFF00##2" + "00" * 64, "605#4041600000000000"),
        str(ErrorFrame(0x80)),
    ]
    assert len(now) == 5


@pytest.mark.parametrize("order", "<>")
def test_a_capture_of_several_interfaces_in_both_byte_orders_is_read(order: str) -> None:
    def block(kind: int, body: bytes) -> bytes:
        body += bytes(-len(body) % 4)
        size = struct.pack(f"{order}I", len(body) + 12)
        return struct.pack(f"{order}I", kind) + size + body + size

    def described(name: bytes, unit: int, offset: int) -> bytes:
        options = struct.pack(f"{order}HH", 2, len(name)) + name + bytes(-len(name) % 4)
        options += struct.pack(f"{order}HHB3x", 9, 1, unit) + struct.pack(f"{order}HHq", 14, 8, offset) + bytes(4)
        return block(1, struct.pack(f"{order}HHI", SOCKETCAN, 0, 0) + options)

    frame = to_packet(CanFrame.parse("705#05"))
    size = len(frame)
    data = block(0x0A0D0D0A, struct.pack(f"{order}IHHq", 0x1A2B3C4D, 1, 0, -1))
    data += described(b"can0", 6, 1_700_000_000) + described(b"vcan10", 0x8A, -5)  # microseconds; 1/1024 s
    data += block(6, struct.pack(f"{order}5I", 0, 0, 1_500_000, size, size) + frame)
    data += block(6, struct.pack(f"{order}5I", 1, 0, 7 * 1024, size, size) + frame)
    data += block(2, struct.pack(f"{order}HHIIII", 0, 3, 0, 2_000_000, size, size) + frame)  # of old: 3 lost before it
    data += block(0xBAD, b"an unknown block")
    assert [item[:2] for item in read_recording(data)] == [
        *((1_700_000_001.5, "can0"), (2.0, "vcan10"), (1_700_000_002.0, "can0"), (1_700_000_002.0, "can0")),
    ]
    assert Dropped(1_700_000_002.0, "can0", 3) in list(read_recording(data))
    *_, last = read_recording(data + block(6, struct.pack(f"{order}5I", 9, 0, 0, size, size) + frame))
    assert isinstance(last, Unread)
    assert "interface 9" in last.why


@pytest.mark.parametrize("stamp", ["inf", "nan", "1e99", "-1.5", "1_0", "9" * 400, "9" * 13])
def test_an_invalid_time_is_unread(stamp: str) -> None:
    text = f"(1.0) can0 705#05\n({stamp}) can0 705#7F\n ({stamp})  can0  705   [1]  7F\n(2.0) can0 705#05\n"
    items = list(read_recording(text.encode()))
    assert [type(item) for item in items] == [Recorded, Unread, Unread, Recorded]
    asc = f"base hex  timestamps absolute\n 1.0 1  705  Rx d 1 05\n {stamp}.0 1  705  Rx d 1 7F\n"
    assert [type(item) for item in read_asc(asc)] == [Recorded, Unread]


BUSMASTER = """\
***BUSMASTER Ver 3.2.2***
***PROTOCOL CAN***
***{mode}***
***<Time><Tx/Rx><Channel><CAN ID><Type><DLC><DataBytes>***
{rows}
***[STOP LOGGING SESSION]***
"""


@pytest.mark.parametrize(
    ("mode", "rows", "expected"),
    [
        (
            "SYSTEM MODE",
            "23:59:59:9990 Tx 1 0x605 s 2 40 41\n0:0:0:0010 Rx 2 0x18EBFF00 x 1 FF",
            [(86399.999, "1", "605#4041", True), (86400.001, "2", "18EBFF00#FF", False)],
        ),
        (
            "ABSOLUTE MODE",
            "00:00:01:5000 Rx 1 0x705 sr 1\n00:00:01:5001 Rx 1 0x1000000 xr 0",
            [(1.5, "1", "705#R1", False), (1.5001, "1", "01000000#R", False)],
        ),
        (
            "RELATIVE MODE",
            "00:00:01:5000 Rx 1 0x705 s 1 05\n00:00:00:5000 Rx 1 0x705 s 0 05",  # bytes of the frame before
            [(1.5, "1", "705#05", False), (2.0, "1", "705#", False)],
        ),
        ("DEC", "00:00:06:9840 Rx 1 1413 s 2 075 065", [(6.984, "1", "585#4B41", False)]),
    ],
)
def test_logs_of_busmaster_are_read_in_all_modes(
    mode: str, rows: str, expected: list[tuple[float, str, str, bool]]
) -> None:
    text = BUSMASTER.format(mode=mode, rows=rows)
    posted = re.sub(r"(?m)^\*{3}(.*)\*{3}$", r"**_\1**_", text)  # Markdown makes that of it
    for log in (text, posted, f"The log is attached.\n{text}"):
        assert is_can_recording(log.encode())
        assert is_timed(log.encode())
        items = list(read_recording(log.encode()))
        assert [(round(item.at, 6), item.bus, str(item.frame), item.sent) for item in items] == expected  # type: ignore[union-attr]


# Damaged -------------------------------------------------------------------------------------------------------------


@cache
def seeds() -> dict[str, bytes]:
    run = [*frames()[:60], *((BEGAN + 30 + place, frame) for place, frame in enumerate(MIXED))]
    keeper = CanRecordingWriter("a.pcapng")
    capture = keeper.start + b"".join(keeper.put(at, f"can{place % 3}", frame) for place, (at, frame) in enumerate(run))
    asc = ["base hex  timestamps absolute"]
    asc += [f"{at - BEGAN:9.6f} 1  {frame.id:X} Rx d {frame.dlc} {frame.data.hex(' ')}" for at, frame in frames()[:60]]
    rows = [
        f"0:0:{at - BEGAN:02.0f}:0 Rx 1 0x{frame.id:X} s {frame.dlc} {frame.data.hex(' ')}"
        for at, frame in frames()[:60]
    ]
    objects = [classical(frame.id, frame.data, at=round((at - BEGAN) * 1e9)) for at, frame in frames()[:60]]
    return {
        "candump": "\n".join(log_line(at, "can0", frame) for at, frame in run).encode(),
        "screen": b"\n".join(b" (%f)  can0  705   [2]  0%d 7F" % (at, at % 9) for at in range(60)),
        "asc": "\n".join(asc).encode(),
        "busmaster": BUSMASTER.format(mode="HEX", rows="\n".join(rows)).encode(),
        "blf": blf(container(b"".join(objects[:30])), container(b"".join(objects[30:]), packing=0)),
        "pcapng": capture,
    }


BITS = [b"\xff\xff\xff\xff", bytes(4), b"9999", b"-1.5", b"nan", b"1e99", b"\n", b"#", b"(", b"\x1b[31m", b"\xd9\xa1"]


def damaged(data: bytes, dice: random.Random) -> bytes:
    for _ in range(dice.choice((1, 1, 3, 10))):
        at, how = dice.randrange(len(data) + 1), dice.randrange(4)
        cut = dice.choice((0, 1, 4, 40, 4000))
        put = (b"", dice.randbytes(dice.choice((1, 4))), dice.choice(BITS), data[at : at + 30])[how]
        data = data[:at] + put + data[at + cut :]
    return data


@pytest.mark.parametrize("runs", part_or_whole(40, 150))
@pytest.mark.parametrize("form", ["candump", "screen", "asc", "busmaster", "blf", "pcapng"])
def test_a_damaged_recording_is_read_as_far_as_possible(form: str, runs: int) -> None:
    """Every item has a line and JSON, and can be written again; nothing raises, and reading ends."""
    dice, keeper = random.Random(form), CanRecordingWriter("a.pcapng")
    whole, read = seeds()[form], 0
    for _ in range(runs):
        data = damaged(whole, dice)
        if not is_can_recording(data):
            continue
        items: Iterable[RecordedItem] = list(read_recording(data))
        read += 1
        assert len(list(items)) <= len(data)
        for item in items:
            if isinstance(item, Recorded):
                keeper.put(item.at, item.bus, item.frame)
        for _, event in replay_can(items):
            assert "\n" not in event_line(event)
            json.dumps(event_as_dict(event), allow_nan=False)
    assert read > runs / 2
