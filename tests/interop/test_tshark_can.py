"""Wireshark's CANopen dissector as a stranger: every kind of single frame, in a capture with link type 227, read by
tshark and compared field by field with what we say of the same bytes.

What tshark cannot: segments of a block transfer, which only their order makes what they are; and it takes a value of
an expedited transfer for four bytes always, so the bytes are compared up to the length that `n` tells. It has no field
for the remote frame of node guarding but the frame's own, and none for error registers and abort codes in words.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from barewire.canopen import AbortCode, CanFrame, LssService
from barewire.canopen.lss import ANSWERS, REQUESTS
from barewire.explain import Explanation, explain
from barewire.explain.can_recording import CanKeeper, read_recording
from barewire.explain.recorded import Recorded
from tests.explain.can_run import recorded

pytestmark = pytest.mark.needs("tshark")

SDO_REQUESTS = [
    *(
        "2F0020010500",
        "2B4060000F00",
        "27002000010203",
        "23FF600010270000",
        "2200200001020304",
        "2108100010",
        "20081000",
    ),
    *(
        "00434F4E",
        "1D42",
        "0F",
        "404160",
        "60",
        "70",
        "80416000000004 05",
        "A008100014",
        "A4081000142A",
        "A3",
        "A2147F",
        "A1",
    ),
    *("C00021", "C2002100 10", "C400210", "C6002100 0A", "C1589C", "DD0000", "D1589C"),
]
SDO_ANSWERS = [
    *(
        "600020",
        "20",
        "30",
        "4F0020000 5",
        "4B41600037 06",
        "4700200001 0203",
        "43001000910 10F",
        "42001000010203",
        "41081000 10",
    ),
    *(
        "40081000",
        "004341",
        "1D42",
        "0F",
        "A0002100 7F",
        "A4002100 7F",
        "A2027F",
        "A1",
        "C0081000",
        "C608100010",
        "C1589C",
        "D5F343",
    ),
]
OTHERS = [
    *(f"000#{command}{node}" for command in ("01", "02", "80", "81", "82") for node in ("00", "05", "7F")),
    *("080#", "080#01", "080#F0", "100#000000000000", "100#952CB3024D39", "100#FF5B26059F3C"),
    *(
        f"085#{code}{register}0102030405"
        for code in ("3081", "0000", "1042", "50FF")
        for register in ("00", "11", "81")
    ),
    *(f"705#{state}" for state in ("00", "04", "05", "7F", "84", "85", "FF")),
    *(
        f"{number:03X}#0102030405"
        for base in (0x180, 0x200, 0x280, 0x300, 0x380, 0x400, 0x480, 0x500)
        for number in (base + 5,)
    ),
]
LSS = [
    *(
        f"7E5#{code:02X}{rest}"
        for code in sorted(REQUESTS)
        for rest in ("01020304050607",)
        if code != LssService.FASTSCAN
    ),
    *("7E5#0400000000000000", "7E5#0401000000000000", "7E5#51443322111F0102", "7E5#5100000000800000"),
    *(f"7E4#{code:02X}0102030400000000"[:20] for code in sorted(ANSWERS)),
]


def sdo(number: str, text: str) -> str:
    return f"{number}#{text.replace(' ', '').ljust(16, '0')}"


FRAMES = [
    *(sdo("605", text) for text in SDO_REQUESTS),
    *(sdo("585", text) for text in SDO_ANSWERS),
    *(sdo("585", f"80416000{int(code).to_bytes(4, 'little').hex()}") for code in AbortCode),
    *OTHERS,
    *LSS,
]

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


def service_of(said: Explanation) -> str:
    title = said.fields[0].meaning
    return next((name for name in ("SDO", "LSS", "NMT", "SYNC", "TIME", "EMCY") if title.startswith(name)), "")


def drawn(said: Explanation) -> dict[str, int]:
    """The letters of the command byte, as our sentence about it has them: '(scs 2, n 2, e 1, s 1)'."""
    inside = said.fields[1].meaning.partition("(")[2].partition(")")[0]
    return {letter: int(value) for letter, _, value in (part.partition(" ") for part in inside.split(", "))}


def number(text: str) -> int:
    return {"True": 1, "False": 0}[text] if text in ("True", "False") else int(text, 0)


def test_every_kind_of_single_frame(tmp_path: Path) -> None:
    keeper, file = CanKeeper("a.pcapng"), tmp_path / "can.pcapng"
    frames = [CanFrame.parse(text) for text in FRAMES]
    file.write_bytes(keeper.start + b"".join(keeper.put(1 + at / 100, "can0", one) for at, one in enumerate(frames)))
    rows = dissected(file)
    assert len(rows) == len(frames)
    compared: set[str] = set()
    for frame, row in zip(frames, rows):
        said = explain("can", frame)
        assert said.error is None, (str(frame), said.verdict)
        assert number(row["can.id"]) == frame.id
        assert int(row["can.len"]) == len(frame.data)
        service, mine = service_of(said), {}
        for field in said.fields[1:]:
            for name in (NUMBERS.get(service, {}).get(field.name), *PARTS.get(field.name, ())):
                if name is not None and f"canopen.{name}" in row:
                    mine[f"canopen.{name}"] = field.value
        theirs = {name: number(row[name]) for name in mine}
        assert theirs == mine, (str(frame), said.lines(), row)
        compared |= set(mine)
        compared |= shared(frame, said, row)
    everything = {f"canopen.{name}" for table in NUMBERS.values() for name in table.values()}
    everything |= {f"canopen.{name}" for names in PARTS.values() for name in names}
    everything |= {f"canopen.{name}" for name in (*BITS.values(), "sdo.ccs", "sdo.scs")}
    assert everything - compared == set()


def shared(frame: CanFrame, said: Explanation, row: dict[str, str]) -> set[str]:
    """What is told in other shapes: the bits of the command byte, bytes, and the state with its toggle bit."""
    found: set[str] = set()
    if frame.id >> 7 == 0xE and frame.data:
        if "canopen.nmt_guard.state" in row:
            assert number(row["canopen.nmt_guard.state"]) == frame.data[0] & 0x7F
            assert number(row["canopen.nmt_guard.toggle"]) in (frame.data[0] >> 7, frame.data[0] & 0x80)
        return found
    data = bytes.fromhex(row.get("canopen.pdo.data.bytes", "").replace(":", ""))
    if data:
        assert data == frame.data
    info = bytes.fromhex(row.get("canopen.em.err_field", "").replace(":", ""))
    if info:
        assert info == frame.data[3:]
    if service_of(said) != "SDO":
        return found
    letters = drawn(said)
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
    value = next((field for field in said.fields if field.name == "data"), None)
    if value is not None and "canopen.sdo.data.bytes" in row:
        theirs = bytes.fromhex(row["canopen.sdo.data.bytes"].replace(":", ""))
        assert theirs[: value.length] == frame.data[value.offset : value.offset + value.length]
    return found


def test_remote_extended_and_foreign_frames(tmp_path: Path) -> None:
    keeper, file = CanKeeper("a.pcapng"), tmp_path / "can.pcapng"
    texts = ["705#R1", "00000605#4041", "1FFFFFFF#R8", "7FF#"]
    file.write_bytes(keeper.start + b"".join(keeper.put(1.0, "can0", CanFrame.parse(text)) for text in texts))
    rows = dissected(file)
    flags = [tuple(number(row[f"can.flags.{name}"]) for name in ("xtd", "rtr", "err")) for row in rows]
    assert flags == [(0, 1, 0), (1, 0, 0), (1, 1, 0), (0, 0, 0)]
    assert [number(row["can.id"]) for row in rows] == [0x705, 0x605, 0x1FFFFFFF, 0x7FF]


def test_what_tshark_writes_we_read(tmp_path: Path) -> None:
    """A capture through tshark's own writer, in both forms of file, is the same run."""
    keeper, file = CanKeeper("a.pcapng"), tmp_path / "run.pcapng"
    frames = [(round(at, 6), frame) for at, frame in recorded()[:400]]
    file.write_bytes(keeper.start + b"".join(keeper.put(at, "can0", frame) for at, frame in frames))
    for form in ("pcapng", "pcap"):
        other = tmp_path / f"other.{form}"
        command = ["tshark", "-r", str(file), "-F", form, "-w", str(other)]
        subprocess.run(command, capture_output=True, timeout=60, check=True)
        told = [item for item in read_recording(other.read_bytes()) if isinstance(item, Recorded)]
        assert [(round(item.at, 6), item.frame) for item in told] == frames
