"""Recordings of a CAN bus that cannot be read whole: bad lines, frames that were dropped, files that are cut off."""

from __future__ import annotations

import struct
import time
from pathlib import Path

import can
import pytest

from barewire.canopen import CanFrame
from barewire.canopen.frame import AnyFrame
from barewire.errors import DecodeError
from barewire_workbench.monitor.recording import CanRecordingWriter, is_can_recording, read_recording, replay_can
from barewire_workbench.recordings.blf import read_blf
from barewire_workbench.recordings.can_texts import read_asc
from barewire_workbench.recordings.candump import is_candump
from barewire_workbench.recordings.capture import (
    SOCKETCAN,
    Packet,
    file_header,
    from_packet,
    interface_block,
    packet_block,
    to_packet,
)
from barewire_workbench.recordings.model import Dropped, Recorded, Unread
from tests.helpers import refused, unhex
from tests.workbench.recordings.test_can_text_forms import frames, message


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("(1.0) can0 605#40g1", "not hex"),
        ("(1.0) can0 905#40", "too many bits"),
        ("(1.0) can0 123##", "flags of CAN FD"),
        ("(1.0) can0 123##1AA" + "00" * 64, "at most 64"),
        ("  can0  605   [8]  40 41", "but 2 bytes follow"),
        ("  can0  605   [9]  40 41", "impossible for CAN"),
        ("  can0  605   [2]  40 4", "is not bytes"),
        ("  can0  605   [2]  40 GG", "not bytes in hexadecimal"),
        ("  can0  [2]  40 41", "not a line of candump"),
        ("(noon) can0 605#40", "the text in brackets"),
        ("hello", "not a line of candump"),
    ],
)
def test_a_bad_line_of_candump_is_reported_and_skipped(line: str, why: str) -> None:
    text = f"(0.5) can0 705#05\n{line}\n(2.0) can0 705#7F\n"
    items = list(read_recording(text.encode()))
    assert [None if isinstance(item, Dropped) else item.line for item in items] == [1, 2, 3]
    bad = items[1]
    assert isinstance(bad, Unread)
    assert why in bad.why
    found = [event for _, event in replay_can(iter(items))]
    assert bad in found


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("   1.0 1  605  Rx   d 8 40 41", "the length is 8, but 2 bytes"),
        ("   1.0 1  905  Rx   d 1 40", "expected up to 7FF"),
        ("   1.0 1  605  Rx   d 1 GG", "not bytes in base 16"),
        ("   1.0 1  605  Rx   d", "expected one digit"),
        ("   1.0 CANFD 1 Rx 123  1 0 d 99 00", "at most 64"),
        ("hello", "not a line of an ASC"),
    ],
)
def test_a_bad_line_of_asc_is_reported_and_skipped(line: str, why: str) -> None:
    text = f"base hex  timestamps absolute\n   0.5 1  705  Rx   d 1 05\n{line}\n   2.0 1  705  Rx   d 1 7F\n"
    first, bad, last = read_asc(text)
    assert isinstance(bad, Unread)
    assert (bad.line, isinstance(first, Recorded), isinstance(last, Recorded)) == (3, True, True)
    assert why in bad.why


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("00:00:01:0000 Rx 1 0x605 s 8 40 41", "the length is 8, but 2 bytes"),
        ("00:00:01:0000 Rx 1 0x905 s 1 40", "expected up to 7FF"),
        ("00:00:01:0000 Rx 1 0x605 s 1 GG", "no numbers of base 16"),
        ("00:00:01:0000 Rx 1 0x605 s 1 140", "no numbers of base 16"),
        ("00:00:01:0000 Rx 1 0x605 s 9 00 00 00 00 00 00 00 00 00", "expected 0 to 8"),
        ("00:00:01:0000 Error", "not a line of BUSMASTER"),
    ],
)
def test_a_bad_line_of_busmaster_is_reported_and_skipped(line: str, why: str) -> None:
    good = "00:00:00:5000 Rx 1 0x705 s 1 05"
    first, bad, last = read_recording(f"***BUSMASTER Ver 3.2.2***\n{good}\n{line}\n{good}\n".encode())
    assert isinstance(bad, Unread)
    assert (bad.line, isinstance(first, Recorded), isinstance(last, Recorded)) == (3, True, True)
    assert why in bad.why


def test_frames_dropped_by_the_recorder_are_reported() -> None:
    def with_drops(frame: AnyFrame, drops: int) -> bytes:
        body = to_packet(frame)
        start = struct.pack("<IIIII", 0, 0, 1_500_000, len(body), len(body)) + body + bytes(-len(body) % 4)
        option = struct.pack("<HHQHH", 4, 8, drops, 0, 0)
        size = struct.pack("<I", 12 + len(start) + len(option))
        return struct.pack("<I", 6) + size + start + option + size

    data = file_header(None) + interface_block(SOCKETCAN, "can3") + with_drops(CanFrame.parse("705#05"), 9)
    assert next(read_recording(data)) == Dropped(1.5, "can3", 9)
    overrun = "base hex  timestamps absolute\n 1.0 1  705  Rx d 1 05\n 1.5 CAN 1 Status: overrun\n"
    assert Dropped(1.0, "1", 0) in list(read_asc(overrun))


def test_a_capture_that_is_cut_off_is_read_up_to_there() -> None:
    keeper = CanRecordingWriter("a.pcapng")
    data = keeper.start + b"".join(keeper.put(place, "can0", CanFrame.parse("705#05")) for place in range(3))
    *good, bad = read_recording(data[:-5])
    assert len(good) == 2
    assert isinstance(bad, Unread)
    assert "cut off" in bad.why
    (short,) = read_recording(file_header(SOCKETCAN) + packet_block(1.0, to_packet(CanFrame.parse("705#05"))[:-1]))
    assert isinstance(short, Unread)


def test_a_blf_that_is_cut_off_is_read_up_to_there(tmp_path: Path) -> None:
    file = tmp_path / "bus.blf"
    with can.BLFWriter(str(file)) as writer:
        for at, frame in frames()[:50]:
            writer.on_message_received(message(at, frame))
    data = file.read_bytes()
    for cut in (10, 100, 144, 150, len(data) // 2, len(data) - 3):
        items = list(read_blf(data[:cut]))
        assert all(isinstance(item, Recorded | Unread) for item in items)
    assert all(isinstance(item, Unread) for item in read_blf(b"LOGG" + bytes(200)))
    (bad,) = read_blf(b"LOGG")
    assert isinstance(bad, Unread)
    assert "damaged" in bad.why


def test_other_files_are_not_recordings_of_can() -> None:
    for data in (
        b"",
        b"12.5 01 03 00 00 00 02 C4 0B",
        b"\xff\xfe",
        file_header() + packet_block(1.0, bytes(60)),
        b"00000000: 0103",
    ):
        assert not is_can_recording(data)
    for data in (b"\xff\xfe\x00", b"12.5 01 03"):
        with pytest.raises(DecodeError):
            list(read_recording(data))
    with refused(DecodeError, "identifier 800h of a base frame"):
        from_packet(Packet(0.0, unhex("00000800 00 000000"), SOCKETCAN))


def test_many_open_brackets_take_no_time_that_grows_with_their_square() -> None:
    began = time.process_time()
    assert not is_candump("(" * 40_000)
    assert time.process_time() - began < 1.0
