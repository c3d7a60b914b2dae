"""Wireshark's dissectors as a stranger: every function code and every exception, written by us as pcapng, read by
tshark and compared field by field with what we say of the same bytes.

What tshark cannot: RTU frames of 4 bytes (it wants 5), so requests without data are compared on TCP only; it gives the
registers of 14 from the group's beginning to the end of the frame; and of 2B/0D it tells the MEI type only.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from barewire.explain import explain
from barewire.explain.packets import Packer
from barewire.explain.pcapng import header, packet
from barewire.explain.replay import replay
from barewire.modbus.exceptions import EXCEPTIONS
from barewire.modbus.functions import known
from barewire.modbus.sniff import Answered
from barewire.rtu import encode as rtu_frame
from barewire.tcp import encode as tcp_frame
from tests.helpers import unhex

pytestmark = pytest.mark.needs("tshark")

UNIT = 17
EXCHANGES = [
    ("01 0013 0013", "01 03 CD6B05"),
    ("02 00C4 0016", "02 03 ACDB35"),
    ("03 006B 0003", "03 06 022B 0000 0064"),
    ("04 0008 0001", "04 02 000A"),
    ("05 00AC FF00", "05 00AC FF00"),
    ("06 0001 0003", "06 0001 0003"),
    ("07", "07 6D"),
    ("08 0000 A537", "08 0000 A537"),
    ("08 0001 FF00", "08 0001 FF00"),
    ("08 0002 0000", "08 0002 00A5"),
    ("08 000A 0000", "08 000A 0000"),
    *((f"08 {sub:04X} 0000", f"08 {sub:04X} 0107") for sub in range(0x0B, 0x13)),
    ("0B", "0B FFFF 0108"),
    ("0C", "0C 08 0000 0108 0121 2000"),
    ("0F 0013 000A 02 CD01", "0F 0013 000A"),
    ("10 0001 0002 04 000A 0102", "10 0001 0002"),
    ("11", "11 03 41 FF 42"),
    ("14 0E 06 0004 0001 0002 06 0003 0009 0002", "14 0C 05 06 0DFE 0020 05 06 33CD 0040"),
    ("15 0D 06 0004 0007 0003 06AF 04BE 100D", "15 0D 06 0004 0007 0003 06AF 04BE 100D"),
    ("16 0004 00F2 0025", "16 0004 00F2 0025"),
    ("17 0003 0006 000E 0003 06 00FF 00FE 00FD", "17 0C 00FE 0ACD 0001 0003 000D 00FF"),
    ("18 04DE", "18 0006 0002 01B8 1284"),
    ("2B 0E 01 00", "2B 0E 01 01 FF 02 02 00 03 414243 01 02 4445"),
    ("2B 0E 04 80", "2B 0E 04 83 00 00 01 80 02 4142"),
    ("2B 0D 00 1F 1005 00 0000 0008", "2B 0D 00 1F 1005 00 0000 0002 1234"),
    *(("03 0000 0001", f"83 {code:02X}") for code in EXCEPTIONS),
    ("2B 0E 05 00", "AB 03"),
]

# Our name of a field -> tshark's. What is not here is told by both as bytes.
NUMBERS = {
    "function_code": "func_code",
    "address": "reference_num",
    "read_address": "read_reference_num",
    "read_quantity": "read_word_cnt",
    "write_address": "write_reference_num",
    "write_quantity": "write_word_cnt",
    "fifo_count": "word_cnt",
    "event_count": "ev_count",
    "message_count": "ev_msg_count",
    "event": "event",
    "sub_function": "diagnostic_code",
    "and_mask": "and_mask",
    "or_mask": "or_mask",
    "exception_code": "exception_code",
    "mei_type": "mei",
    "read_code": "read_device_id",
    "object_id": "object_id",
    "conformity": "conformity_level",
    "more_follows": "more_follows",
    "next_object": "next_object_id",
    "number_of_objects": "num_objects",
    "object_length": "objects_len",
    "reference_type": "reference_type",
}
ALL = sorted(
    {f"modbus.{name}" for name in NUMBERS.values()}
    | {f"modbus.{name}" for name in ("word_cnt", "bit_cnt", "byte_cnt", "byte_cnt_16", "reference_num_32", "data")}
    | {f"modbus.{name}" for name in ("ev_status", "regval_uint16", "bitval", "request_frame")}
    | {f"modbus.{name}" for name in ("object_str_value", "object_value")}
    | {
        f"modbus.diagnostic.{name}"
        for name in (
            *("return_query_data.request", "return_query_data.echo", "restart_communication_option"),
            *("return_diag_register", "clear_ctr_diag_reg", "bus_message_count", "bus_comm_error_count"),
            *("bus_exception_error_count", "slave_message_count", "no_slave_response_count", "slave_nak_count"),
            *("slave_busy_count", "bus_char_overrun_count"),
        )
    }
)  # fmt: skip
RTU = ["mbrtu.unit_id", "mbrtu.crc16", "mbrtu.crc16.status"]
PAIRED = "modbus.request_frame"
"""In a response: the number of its request's frame. It is not given for every function."""
TCP = ["mbtcp.unit_id", "mbtcp.trans_id", "mbtcp.prot_id", "mbtcp.len"]


def tshark(file: Path, fields: list[str], *options: str) -> list[dict[str, list[str]]]:
    """What it says of each packet: the fields that are there, each with all its values."""
    command = ["tshark", "-r", str(file), "-T", "fields", *options, "-E", "aggregator=|"]
    for field in fields:
        command += ["-e", field]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    rows = [line.split("\t") for line in done.stdout.splitlines()]
    return [{field: value.split("|") for field, value in zip(fields, row) if value} for row in rows]


def ours(pdu: bytes, role: str) -> tuple[dict[str, list[int]], int]:
    """Our fields of a message under tshark's names, and how many bytes they are; what both tell as bytes is not."""
    covered = 0
    found: dict[str, list[int]] = {}
    code = pdu[0] & 0x7F
    groups: list[int] = []
    for field in explain("tcp", tcp_frame(UNIT, pdu), role).fields[4:]:
        value, name = field.value, field.name.replace(" ", "_")
        if name == "quantity":
            name = "bit_cnt" if code in (0x01, 0x02, 0x0F) else "word_cnt"
        elif name == "byte_count":
            name = "byte_cnt_16" if code == 0x18 else "" if code == 0x11 else "byte_cnt"
        elif name == "status" and code != 0x07:
            name = "ev_status"
        elif name == "length":
            name = "byte_cnt" if code == 0x14 and role == "response" else "word_cnt"
        elif name.startswith("register_") and code in (0x03, 0x04, 0x10):
            name = "regval_uint16"
        elif name in ("file", "record"):
            assert isinstance(value, int)
            groups.append(value)
            covered += field.length
            continue
        else:
            name = NUMBERS.get(name, "")
        if name:
            assert isinstance(value, int), field
            covered += field.length
            found.setdefault(f"modbus.{name}", []).append(value & 0x7F if name == "func_code" else value)
    if groups:
        found["modbus.reference_num_32"] = [file << 16 | record for file, record in zip(groups[::2], groups[1::2])]
    return found, covered


def agree(pdu: bytes, role: str, theirs: dict[str, list[str]]) -> None:
    """Whether tshark and we say the same of a message."""
    mine, covered = ours(pdu, role)
    numbers = {key: [int(value, 0) for value in theirs.get(key, [])] for key in mine}
    assert numbers == mine
    left = {key: values for key, values in theirs.items() if key not in mine and key.startswith("modbus.")}
    left.pop(PAIRED, None)
    code = pdu[0]
    if bits := left.pop("modbus.bitval", None):
        packed = int.from_bytes(pdu[2:], "little")
        assert bits == [str(packed >> place & 1) for place in range(len(bits))]
    if texts := left.pop("modbus.object_str_value", None):
        fields = explain("tcp", tcp_frame(UNIT, pdu), role).fields
        assert texts == [field.value for field in fields if field.name == "object value"]
    if raw := left.pop("modbus.object_value", None):  # the objects that are the device's own
        assert pdu.hex().endswith(raw[0])
    if code == 0x08:
        ((key, (value,)),) = left.items()
        is_bytes = key == "modbus.data" or "query_data" in key
        assert (int(value, 16) if is_bytes else int(value, 0)) == int.from_bytes(pdu[3:], "big")
    elif code == 0x14 and role == "response":
        assert [values[:8] for values in left["modbus.data"]] == ["0dfe0020", "33cd0040"]
    elif left:
        # What it gives as bytes are the last ones of the message.
        ((key, (value,)),) = left.items()
        assert key == "modbus.data"
        twice = 1 if pdu[:2] == b"\x2b\x0d" else 0  # the MEI type is told as a number, too
        assert bytes.fromhex(value) == pdu[covered - twice :]
    elif not bits and not texts and not raw:
        assert covered == len(pdu)


def test_nothing_is_left_out() -> None:
    pdus = [unhex(request) for request, _ in EXCHANGES]
    codes = {(pdu[0], pdu[1] if pdu[0] == 0x2B else None) for pdu in pdus}
    assert {request.function_code for request in known()} <= {code for code, _ in codes}
    assert {(0x2B, 0x0D), (0x2B, 0x0E)} <= codes
    for request, response in EXCHANGES:
        assert explain("tcp", tcp_frame(UNIT, unhex(request)), "request").error is None or request == "2B 0E 05 00"
        assert explain("tcp", tcp_frame(UNIT, unhex(response)), "response").error is None


def test_every_message_over_tcp(tmp_path: Path) -> None:
    packer, data, pdus = Packer(), header(), list[bytes]()
    for number, exchange in enumerate(EXCHANGES):
        for is_answer, text in enumerate(exchange):
            pdus.append(unhex(text))
            frame = tcp_frame(UNIT, pdus[-1], number)
            data += packet(1.0 + len(pdus) / 100, packer.tcp(frame, from_client=not is_answer))
    file = tmp_path / "tcp.pcapng"
    file.write_bytes(data)
    rows = tshark(file, ALL + TCP)
    assert len(rows) == len(pdus)
    for place, (pdu, row) in enumerate(zip(pdus, rows)):
        agree(pdu, "response" if place % 2 else "request", row)
        header_said = [int(row[name][0]) for name in TCP]
        assert header_said == [UNIT, place // 2, 0, len(pdu) + 1]
    # Its pairs are ours.
    told = [event for event in replay(data) if isinstance(event, Answered)]
    pairs = {round(event.at * 100) - 100: round(event.to.at * 100) - 100 for event in told if event.to}
    assert pairs == {place: place - 1 for place in range(2, len(pdus) + 1, 2)}
    theirs = {place: int(row[PAIRED][0]) for place, row in enumerate(rows, 1) if PAIRED in row}
    assert len(theirs) > 10
    assert theirs.items() <= pairs.items()


def test_every_message_over_rtu(tmp_path: Path) -> None:
    packer, data, frames = Packer(), header(), list[bytes]()
    for exchange in EXCHANGES:
        for is_answer, text in enumerate(exchange):
            frames.append(rtu_frame(UNIT, unhex(text)))
            data += packet(1.0 + len(frames) / 100, packer.rtu(frames[-1], from_client=not is_answer))
    damaged = frames[0][:-1] + bytes([frames[0][-1] ^ 1])
    data += packet(99.0, packer.rtu(damaged, from_client=True))
    file = tmp_path / "rtu.pcapng"
    file.write_bytes(data)
    *rows, last = tshark(file, ALL + RTU, "-o", "mbrtu.udp.port:5020", "-o", "mbrtu.crc_verification:TRUE")
    assert len(rows) == len(frames)
    for place, (frame, row) in enumerate(zip(frames, rows)):
        if len(frame) == 4:
            assert row == {}  # too short for it; compared over TCP
            continue
        agree(frame[1:-2], "response" if place % 2 else "request", row)
        said = [int(row[name][0], 0) for name in RTU]
        assert said == [UNIT, int.from_bytes(frame[-2:], "big"), 1]
    assert last["mbrtu.crc16.status"] == ["0"]


def test_checksums_of_packets(tmp_path: Path) -> None:
    """Nothing that we write is painted red: IP, UDP and TCP are right, and nothing is taken for lost or repeated."""
    packer = Packer()
    data = header()
    for place, from_client in enumerate((True, False, True, False)):
        data += packet(place, packer.tcp(tcp_frame(1, b"\x07" + bytes(place), place), from_client=from_client))
        data += packet(place, packer.rtu(rtu_frame(1, b"\x07" + bytes(place)), from_client=from_client))
    file = tmp_path / "sums.pcapng"
    file.write_bytes(data)
    names = ["ip.checksum.status", "udp.checksum.status", "tcp.checksum.status", "tcp.analysis.flags"]
    checks = [f"{name}.check_checksum:TRUE" for name in ("ip", "udp", "tcp")]
    rows = tshark(file, names, *(word for check in checks for word in ("-o", check)))
    assert [row for row in rows if any(value != ["1"] for value in row.values())] == []
    assert [sorted(row) for row in rows] == [
        ["ip.checksum.status", "tcp.checksum.status"],
        ["ip.checksum.status", "udp.checksum.status"],
    ] * 4
