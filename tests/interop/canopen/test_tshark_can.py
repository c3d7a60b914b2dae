"""Wireshark's CANopen dissector: every kind of single frame, in a capture with link type 227, read by tshark and
compared field by field with `explain` for the same bytes.

Limits of tshark: it does not dissect segments of a block transfer, which depend on their position, nor the start of one
with a CRC. It always gives four bytes for the value of an expedited transfer, so the bytes are compared up to the
length from `n`. It has no field for the remote frame of node guarding but the frame's own, and none for error registers
and abort codes in words.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from barewire.canopen import CanFrame
from barewire_workbench import Explanation, explain
from barewire_workbench.monitor.recording import CanRecordingWriter, read_recording
from barewire_workbench.recordings.model import Recorded
from tests.interop.canopen.can_frames import FRAMES
from tests.workbench.monitor.recorded_run import recorded

pytestmark = pytest.mark.needs("tshark")

# Our name of a field -> tshark's, by service.
NUMBERS: dict[str, dict[str, str]] = {
    "NMT": {"command": "nmt_ctrl.cd", "node": "nmt_ctrl.node_id"},
    "SYNC": {"counter": "sync.counter"},
    "TIME": {"milliseconds": "time_stamp_ms", "days": "time_stamp_days"},
    "EMCY": {"error code": "em.err_code", "error register": "em.err_reg"},
    "SDO": {
        "command": "sdo.cmd",
        "index": "sdo.main_idx",
        "sub-index": "sdo.sub_idx",
        "abort code": "sdo.abort_code",
        "sequence": "sdo.ackseq",
        "block size": "sdo.blksize",
        "protocol switch": "sdo.pst",
    },
    "LSS": {
        "service": "lss.cs",
        "mode": "lss.switch.mode",
        "node-ID": "lss.nid",
        "table": "lss.bt.tbl_selector",
        "entry": "lss.bt.tbl_index",
        "delay": "lss.abt_delay",
        "number": "lss.fastscan.id",
        "bit check": "lss.fastscan.check",
        "LSS sub": "lss.fastscan.sub",
        "LSS next": "lss.fastscan.next",
        "details": "lss.spec_err",
    },
}
PARTS = {
    "vendor-ID": ("lss.addr.vendor",),
    "product code": ("lss.addr.product",),
    "revision": ("lss.addr.revision", "lss.addr.revision_low", "lss.addr.revision_high"),
    "serial number": ("lss.addr.serial", "lss.addr.serial_low", "lss.addr.serial_high"),
    "result": ("lss.conf_id.err_code", "lss.conf_bt.err_code", "lss.store_conf.err_code"),
}
OTHERS = ("sdo.ccs", "sdo.scs", "em.err_field", "pdo.data.bytes", "nmt_guard.state", "nmt_guard.toggle")
UNDISSECTED = ["605#C4", "605#C6", "585#A4", "605#A4", "585#C6", "080#"]
"""Frames without a dissected field in tshark 4.0: the start of a block transfer with a CRC, a SYNC without counter."""
BITS = {"n": "sdo.n", "e": "sdo.e", "s": "sdo.s", "t": "sdo.toggle", "c": "sdo.c"}
FIELDS = [
    *("can.id", "can.len", "can.flags.xtd", "can.flags.rtr", "can.flags.err", "canopen.cob_id"),
    *sorted({f"canopen.{name}" for table in NUMBERS.values() for name in table.values()}),
    *sorted({f"canopen.{name}" for names in PARTS.values() for name in names}),
    *(f"canopen.{name}" for name in BITS.values()),
    *("canopen.sdo.ccs", "canopen.sdo.scs", "canopen.sdo.data.bytes", "canopen.nmt_guard.toggle"),
    *("canopen.nmt_guard.state", "canopen.em.err_field", "canopen.pdo.data.bytes", "canopen.sdo.crc_support"),
]


def dissected(file: Path) -> list[dict[str, str]]:
    command = ["tshark", "-r", str(file), "-d", "can.subdissector,canopen", "-T", "fields", "-E", "occurrence=f"]
    for field in FIELDS:
        command += ["-e", field]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    rows = [line.split("\t") for line in done.stdout.splitlines()]
    return [{field: value for field, value in zip(FIELDS, row) if value} for row in rows]


def service_of(explanation: Explanation) -> str:
    title = explanation.fields[0].meaning
    return next((name for name in ("SDO", "LSS", "NMT", "SYNC", "TIME", "EMCY") if title.startswith(name)), "")


def command_bits(explanation: Explanation) -> dict[str, int]:
    """Return the bits of the command byte, by their letters in our explanation: '(scs 2, n 2, e 1, s 1)'."""
    inside = explanation.fields[1].meaning.partition("(")[2].partition(")")[0]
    return {letter: int(value) for letter, _, value in (part.partition(" ") for part in inside.split(", "))}


def number(text: str) -> int:
    return {"True": 1, "False": 0}[text] if text in ("True", "False") else int(text, 0)


@pytest.mark.evidence("tshark", "frames", "file", *FRAMES)
def test_every_kind_of_single_frame(tmp_path: Path, exchanged: set[str]) -> None:
    writer, file = CanRecordingWriter("a.pcapng"), tmp_path / "can.pcapng"
    frames = [(service, CanFrame.parse(text)) for service, texts in FRAMES.items() for text in texts]
    file.write_bytes(
        writer.start + b"".join(writer.put(1 + at / 100, "can0", one) for at, (_, one) in enumerate(frames))
    )
    rows = dissected(file)
    assert len(rows) == len(frames)
    compared: set[str] = set()
    undissected: list[str] = []
    for (service, frame), row in zip(frames, rows):
        found = compared_fields(frame, row)
        if not found:
            undissected.append(str(frame))
        compared |= found
        exchanged.add(service)
    all_fields = {f"canopen.{name}" for table in NUMBERS.values() for name in table.values()}
    all_fields |= {f"canopen.{name}" for names in PARTS.values() for name in names}
    all_fields |= {f"canopen.{name}" for name in (*BITS.values(), *OTHERS)}
    assert all_fields - compared == set()
    assert [text[:6] for text in undissected] == UNDISSECTED


def compared_fields(frame: CanFrame, row: dict[str, str]) -> set[str]:
    """Return the fields of tshark that our explanation has too, and assert that their values are equal."""
    explanation = explain("can", frame)
    assert explanation.error is None, (str(frame), explanation.verdict)
    assert number(row["can.id"]) == frame.id
    assert int(row["can.len"]) == len(frame.data)
    service, mine = service_of(explanation), {}
    for field in explanation.fields[1:]:
        for name in (NUMBERS.get(service, {}).get(field.name), *PARTS.get(field.name, ())):
            if name is not None and f"canopen.{name}" in row:
                mine[f"canopen.{name}"] = field.value
    theirs = {name: number(row[name]) for name in mine}
    assert theirs == mine, (str(frame), explanation.lines(), row)
    return {*mine, *shared(frame, explanation, row)}


def shared(frame: CanFrame, explanation: Explanation, row: dict[str, str]) -> set[str]:
    """Return the fields in other forms: bits of the command byte, bytes, and the state with its toggle bit."""
    found: set[str] = set()
    if frame.id >> 7 == 0xE and frame.data:
        if "canopen.nmt_guard.state" in row:
            assert number(row["canopen.nmt_guard.state"]) == frame.data[0] & 0x7F
            assert number(row["canopen.nmt_guard.toggle"]) in (frame.data[0] >> 7, frame.data[0] & 0x80)
            found |= {"canopen.nmt_guard.state", "canopen.nmt_guard.toggle"}
        return found
    data = bytes.fromhex(row.get("canopen.pdo.data.bytes", "").replace(":", ""))
    if data:
        assert data == frame.data
        assert explanation.fields[0].meaning.partition(" ")[0][1:4] == "PDO"
        found.add("canopen.pdo.data.bytes")
    info = bytes.fromhex(row.get("canopen.em.err_field", "").replace(":", ""))
    if info:
        assert info == frame.data[3:]
        found.add("canopen.em.err_field")
    if service_of(explanation) != "SDO":
        return found
    letters = command_bits(explanation)
    specifier = "ccs" if "ccs" in letters else "scs" if "scs" in letters else None
    if specifier is not None and f"canopen.sdo.{specifier}" in row:
        assert number(row[f"canopen.sdo.{specifier}"]) == letters[specifier]
        found.add(f"canopen.sdo.{specifier}")
    for letter, name in BITS.items():
        place = f"canopen.{name}"
        if letter in letters and place in row:
            assert number(row[place]) == letters[letter], (str(frame), letter, row)
            found.add(place)
    if "canopen.sdo.crc_support" in row and "c" in letters:
        assert number(row["canopen.sdo.crc_support"]) == letters["c"]
    value = next((field for field in explanation.fields if field.name == "data"), None)
    if value is not None and "canopen.sdo.data.bytes" in row:
        theirs = bytes.fromhex(row["canopen.sdo.data.bytes"].replace(":", ""))
        assert theirs[: value.length] == frame.data[value.offset : value.offset + value.length]
    return found


def test_remote_and_extended_frames_keep_their_flags(tmp_path: Path) -> None:
    writer, file = CanRecordingWriter("a.pcapng"), tmp_path / "can.pcapng"
    texts = ["705#R1", "00000605#4041", "1FFFFFFF#R8", "7FF#"]
    file.write_bytes(writer.start + b"".join(writer.put(1.0, "can0", CanFrame.parse(text)) for text in texts))
    rows = dissected(file)
    flags = [tuple(number(row[f"can.flags.{name}"]) for name in ("xtd", "rtr", "err")) for row in rows]
    assert flags == [(0, 1, 0), (1, 0, 0), (1, 1, 0), (0, 0, 0)]
    assert [number(row["can.id"]) for row in rows] == [0x705, 0x605, 0x1FFFFFFF, 0x7FF]


def test_barewire_reads_captures_written_by_tshark(tmp_path: Path) -> None:
    """A capture rewritten by tshark, as pcapng and as pcap, has the same frames at the same times."""
    writer, file = CanRecordingWriter("a.pcapng"), tmp_path / "run.pcapng"
    frames = [(round(at, 6), frame) for at, frame in recorded()[:400]]
    file.write_bytes(writer.start + b"".join(writer.put(at, "can0", frame) for at, frame in frames))
    for form in ("pcapng", "pcap"):
        other = tmp_path / f"other.{form}"
        command = ["tshark", "-r", str(file), "-F", form, "-w", str(other)]
        subprocess.run(command, capture_output=True, timeout=60, check=True)
        found = [item for item in read_recording(other.read_bytes()) if isinstance(item, Recorded)]
        assert [(round(item.at, 6), item.frame) for item in found] == frames
