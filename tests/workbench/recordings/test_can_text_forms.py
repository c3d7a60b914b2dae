"""One run of a bus in every form of recording: the same events each time, and every kind of frame."""

from __future__ import annotations

import struct
import subprocess
from collections.abc import Iterator
from functools import cache
from itertools import cycle, pairwise
from pathlib import Path
from typing import Any

import can
import pytest

from barewire.canopen import CanFrame, ErrorFrame, FdFrame
from barewire.canopen.frame import AnyFrame
from barewire.devices import load
from barewire_workbench.monitor import event_as_dict, of_device
from barewire_workbench.monitor.recording import CanRecordingWriter, is_can_recording, read_recording, replay_can
from barewire_workbench.recordings.blf import read_blf
from barewire_workbench.recordings.candump import log_line, parse_frame, read_candump
from barewire_workbench.recordings.capture import SOCKETCAN, file_header, packet_block, to_packet
from barewire_workbench.recordings.model import Dropped, Recorded, RecordedItem, Unread
from tests.helpers import unhex
from tests.workbench.monitor.recorded_run import DRIVE, recorded

BEGAN = 1_700_000_000.0
MIXED: list[AnyFrame] = [
    CanFrame.parse("605#4041600000000000"),
    CanFrame.parse("705#R1"),
    CanFrame.parse("080#"),
    CanFrame.parse("18EBFF00#0102"),
    CanFrame.parse("00000605#R8"),
    FdFrame(0x123, bytes(range(12)), flags=1),
    FdFrame(0x18EBFF00, bytes(64), extended=True, flags=2),
    ErrorFrame(0x04, unhex("0001 0000 0000 0000")),
]


@cache
def frames() -> tuple[tuple[float, CanFrame], ...]:
    """Return the run without its fastscan, which is long; times to the microsecond, as files have them."""
    return tuple((BEGAN + round(at, 6), frame) for at, frame in recorded()[:1500])


def events(items: Iterator[RecordedItem]) -> list[dict[str, Any]]:
    """Return the events as dicts, with times since the first frame."""
    found = [event_as_dict(event) for _, event in replay_can(items, [of_device(load("az3"), DRIVE)])]
    first = found[0]["at"]
    for event in found:
        for key in ("at", "began", "since", "seconds", "period", "shortest", "longest"):
            if isinstance(event.get(key), float):
                whole = event[key] - (first if key in ("at", "began", "since") else 0)
                event[key] = round(whole, 5)
        event["text"] = "" if "ago" in str(event.get("text")) else event.get("text")
    return found


@cache
def expected() -> list[dict[str, Any]]:
    return events(iter([Recorded(at, "can0", frame) for at, frame in frames()]))


def columns(at: str, frame: CanFrame) -> str:
    identifier = f"{frame.id:08X}" if frame.extended else f"{frame.id:03X}"
    data = "remote request" if frame.remote else frame.data.hex(" ").upper()
    return f"{at}  can0  {identifier}   [{frame.dlc}]  {data}"


def candump_log() -> str:
    return "\n".join(log_line(at, "can0", frame) for at, frame in frames())


def candump_with_directions() -> str:
    return "\n".join(f"{log_line(at, 'can0', frame)} {'RT'[place % 2]}" for place, (at, frame) in enumerate(frames()))


def candump_absolute() -> str:
    return "\n".join(columns(f" ({at:017.6f})", frame) for at, frame in frames())


def candump_zero() -> str:
    return "\n".join(columns(f" ({at - BEGAN:010.6f})", frame) for at, frame in frames())


def candump_delta() -> str:
    times = [at for at, _ in frames()]
    steps = [0.0, *(after - before for before, after in pairwise(times))]
    return "\n".join(columns(f" ({step:010.6f})", frame) for step, (_, frame) in zip(steps, frames()))


def candump_dates() -> str:
    def stamp(at: float) -> str:
        seconds = at - BEGAN + 20  # 2023-11-14 22:13:20 UTC
        return f" (2023-11-14 22:13:{int(seconds):02}.{round(seconds % 1 * 1e6):06})"

    return "\n".join(columns(stamp(at), frame) for at, frame in frames())


def candump_in_colours() -> str:
    lines = [columns(f" ({at:017.6f})", frame) for at, frame in frames()]
    escapes = cycle(["\x1b", "^[", "\\e"])  # the others are how editors and shells show it
    return "\n".join(line.replace("can0", f"{escape}[32mcan0{escape}[0m") for line, escape in zip(lines, escapes))


def candump_swapped() -> str:
    lines = []
    for at, frame in frames():
        data = "`".join(f"{byte:02X}" for byte in reversed(frame.data))
        body = "remote request" if frame.remote else data
        lines.append(f" ({at:017.6f})  can0  {frame.id:03X}   [{frame.dlc}]  {body}")
    return "\n".join(lines)


def candump_binary() -> str:
    lines = []
    for at, frame in frames():
        data = "remote request" if frame.remote else " ".join(f"{byte:08b}" for byte in frame.data)
        lines.append(f" ({at:017.6f})  can0  {frame.id:03X}   [{frame.dlc}]  {data}")
    return "\n".join(lines)


def candump_with_text() -> str:
    lines = [columns(f" ({at:017.6f})", frame) for at, frame in frames()]
    return "\n".join(line if "remote" in line else f"{line}   '..@A`..'" for line in lines)


def candump_extra() -> str:
    return "\n".join(columns(f" ({at:017.6f})", frame).replace("can0", "can0  RX - -") for at, frame in frames())


def asc() -> str:
    lines = ["date Tue Nov 14 22:13:20.000 2023", "base hex  timestamps absolute", "internal events logged"]
    lines += ["// version 9.0.0", "Begin Triggerblock Tue Nov 14 22:13:20.000 2023", "   0.000000 Start of measurement"]
    for at, frame in frames():
        body = f"r {frame.dlc}" if frame.remote else f"d {frame.dlc} {frame.data.hex(' ').upper()}"
        rest = "" if frame.remote else f"  Length = 0 BitCount = {len(frame.data) * 8} ID = {frame.id}"
        lines.append(f"{at - BEGAN:11.6f} 1  {frame.id:<15X} Rx   {body}{rest}")
    lines.insert(40, "   0.500000 1  Statistic: D 12 R 0 XD 0 XR 0 E 0 O 0 B 1.35%")
    return "\n".join([*lines, "End TriggerBlock"])


def asc_relative_decimal() -> str:
    lines = ["date Tue Nov 14 22:13:20.000 2023", "base dec  timestamps relative", "no internal events logged"]
    before = BEGAN
    for at, frame in frames():
        body = f"r {frame.dlc}" if frame.remote else f"d {frame.dlc} {' '.join(map(str, frame.data))}"
        lines.append(f"{at - before:11.6f} 1  {frame.id:<15} Rx   {body}")
        before = at
    return "\n".join(lines)


def message(at: float, frame: AnyFrame) -> can.Message:
    if isinstance(frame, ErrorFrame):
        return can.Message(timestamp=at, is_error_frame=True, arbitration_id=frame.classes, channel=0)
    if isinstance(frame, FdFrame):
        return can.Message(
            timestamp=at, arbitration_id=frame.id, is_extended_id=frame.extended, data=frame.data, is_fd=True,
            bitrate_switch=bool(frame.flags & 1), error_state_indicator=bool(frame.flags & 2), channel=0,
        )  # fmt: skip
    return can.Message(
        timestamp=at, arbitration_id=frame.id, is_extended_id=frame.extended, is_remote_frame=frame.remote,
        dlc=frame.dlc, data=None if frame.remote else frame.data, channel=0,
    )  # fmt: skip


TEXTS = [
    candump_log, candump_with_directions, candump_absolute, candump_zero, candump_delta, candump_dates,
    candump_in_colours, candump_swapped, candump_binary, candump_with_text, candump_extra, asc, asc_relative_decimal,
]  # fmt: skip


@pytest.mark.parametrize("form", TEXTS)
def test_every_text_format_gives_the_same_events(form: Any) -> None:
    data = form().encode()
    assert is_can_recording(data)
    assert events(read_recording(data)) == expected()
    assert [event for event in expected() if event["event"] in ("unread", "gap", "loss")] == []
    assert {event["event"] for event in expected()} >= {"sdo", "node", "nmt", "emcy", "sync", "time", "pdo", "mapping"}


@pytest.mark.parametrize("name", ["bus.pcapng", "bus.log"])
def test_written_recordings_give_the_same_events(name: str) -> None:
    keeper = CanRecordingWriter(name)
    data = keeper.start + b"".join(keeper.put(at, "can0", frame) for at, frame in frames())
    assert is_can_recording(data)
    assert events(read_recording(data)) == expected()


def test_pcap_gives_the_same_events() -> None:
    data = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, SOCKETCAN)
    for at, frame in frames():
        body = to_packet(frame)
        micros = round(at * 1e6)
        data += struct.pack("<4I", micros // 1_000_000, micros % 1_000_000, len(body), len(body)) + body
    assert events(read_recording(data)) == expected()


def test_blf_of_python_can_gives_the_same_events(tmp_path: Path) -> None:
    file = tmp_path / "bus.blf"
    with can.BLFWriter(str(file)) as writer:
        for at, frame in frames():
            writer.on_message_received(message(at, frame))
    data = file.read_bytes()
    assert is_can_recording(data)
    assert events(read_blf(data)) == expected()


def test_asc_of_python_can_gives_the_same_events(tmp_path: Path) -> None:
    file = tmp_path / "bus.asc"
    with can.ASCWriter(str(file)) as writer:
        for at, frame in frames():
            writer.on_message_received(message(at, frame))
    assert events(read_recording(file.read_bytes())) == expected()


@pytest.mark.needs("candump")
@pytest.mark.parametrize("options", [[], ["-4"], ["-n"], ["-f"], ["-r"]])
def test_asc_of_log2asc_gives_the_same_events(options: list[str], tmp_path: Path) -> None:
    """Rounded to 100 us with -4, so only the values are compared."""
    file = tmp_path / "bus.log"
    file.write_text(candump_log() + "\n")
    done = subprocess.run(
        ["log2asc", "-I", str(file), *options, "can0"], capture_output=True, timeout=30, check=True
    ).stdout

    def values(found: list[dict[str, Any]]) -> list[Any]:
        return [
            (event["event"], event.get("data"), event.get("values"))
            for event in found
            if event["event"] in ("sdo", "pdo")
        ]

    assert values(events(read_recording(done))) == values(expected())


# Every kind of frame -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("frame", MIXED, ids=str)
def test_every_kind_of_frame_is_written_and_read(frame: AnyFrame) -> None:
    assert parse_frame(log_line(1.5, "can0", frame).split()[-1]) == frame
    for name in ("a.pcapng", "a.log"):
        keeper = CanRecordingWriter(name)
        (item,) = read_recording(keeper.start + keeper.put(1.5, "vcan7", frame))
        assert item == Recorded(1.5, "vcan7", frame, 1)
    for link, before in ((113, 14), (276, 0)):
        kind = b"\x00\x0d" if isinstance(frame, FdFrame) else b"\x00\x0c"
        head = bytes(before) + kind if link == 113 else kind + bytes(18)
        data = file_header(link) + packet_block(1.5, head + to_packet(frame))
        (item,) = read_recording(data)
        assert isinstance(item, Recorded)
        assert item.frame == frame


def test_every_kind_of_frame_in_blf_and_asc(tmp_path: Path) -> None:
    for name in ("a.blf", "a.asc"):
        file = tmp_path / name
        with can.BLFWriter(str(file)) if name == "a.blf" else can.ASCWriter(str(file)) as writer:
            for place, frame in enumerate(MIXED):
                writer.on_message_received(message(BEGAN + place, frame))
        data = file.read_bytes()
        items = read_blf(data) if name == "a.blf" else read_recording(data)
        found = [item.frame for item in items if isinstance(item, Recorded)]
        wanted = [frame for frame in MIXED if not isinstance(frame, ErrorFrame)]
        assert [frame for frame in found if not isinstance(frame, ErrorFrame)] == wanted
        assert sum(isinstance(frame, ErrorFrame) for frame in found) == 1


CANDUMP = """\
  can0  705   [1]  05
 (1.000000)  can0  20000004   [8]  00 01 00 00 00 00 00 00   ERRORFRAME
\tcontroller-problem{rx-overflow}
 (1.100000)  can0  123  [12]  00 01 02 03 04 05 06 07 08 09 0A 0B
 (1.200000)  can0  123   {F}  00 01 02 03 04 05 06 07
 (1.300000)  can1       605   [8]  40 41 60 00 00 00 00 00   '@A`.....'
DROPCOUNT: dropped 3 CAN frames on 'can1' socket (total drops 7)
(1.400000) can0 123#1122334455667788_E
# a remark
"""


def test_the_screen_output_of_candump_is_read() -> None:
    items = list(read_candump(CANDUMP))
    assert [str(item.frame) for item in items if isinstance(item, Recorded)] == [
        *("705#05", "ErrorFrame(classes=4, data=b'\\x00\\x01\\x00\\x00\\x00\\x00\\x00\\x00')"),
        *("123##0000102030405060708090A0B", "123#0001020304050607", "605#4041600000000000", "123#1122334455667788"),
    ]
    assert [item for item in items if isinstance(item, Dropped)] == [Dropped(1.3, "can1", 3)]
    assert {item.bus for item in items if isinstance(item, Recorded)} == {"can0", "can1"}


def test_several_buses_have_monitors_of_their_own() -> None:
    lines = ["(1.0) can0 605#4041600000000000", "(1.1) can1 585#4B41600037060000", "(1.2) can0 585#4B41600038060000"]
    found = list(replay_can(read_recording("\n".join(lines).encode())))
    assert {
        (bus, event_as_dict(event).get("data")) for bus, event in found if event_as_dict(event)["event"] == "sdo"
    } == {
        ("can0", "3806"),
        ("can1", "3706"),
    }
    assert {bus for bus, _ in replay_can(read_recording("\n".join(lines).encode()), bus="can1")} == {"can1"}
    many = "\n".join(f"(1.0) can{number} 705#05" for number in range(80))
    assert sum(isinstance(event, Unread) for _, event in replay_can(read_recording(many.encode()))) == 16


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("(10.5)  can2  080  [0](10.75)  can2  1B4  [1]  60\n", [(10.5, "can2", "080#"), (10.75, "can2", "1B4#60")]),
        ("(10.5)  can2  1B4   [2]  **60 92**\n", [(10.5, "can2", "1B4#6092")]),
        ("(10.5)  can2  1B4   [2]  60 92`\n", [(10.5, "can2", "1B4#6092")]),
        ("01:00:10.8857 18EAFFF9 [3] 00 EE 00 (TX)\n", [(3610.8857, "can0", "18EAFFF9#00EE00")]),
        ("01:00:10.8857 can1 605 [1] 40\n", [(3610.8857, "can1", "605#40")]),
    ],
)  # fmt: skip
def test_lines_of_candump_as_they_are_posted(text: str, expected: list[tuple[float, str, str]]) -> None:
    items = [item for item in read_recording(text.encode()) if isinstance(item, Recorded)]
    assert [(round(item.at, 6), item.bus, str(item.frame)) for item in items] == expected
