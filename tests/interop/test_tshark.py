"""Wireshark's Modbus dissectors: every function code and every exception, written as pcapng by barewire, read by tshark
and compared field by field with `explain` for the same bytes.

Limits of tshark: it needs RTU frames of at least 5 bytes, so requests without data are compared on TCP and UDP only; it
gives the registers of 14 from the beginning of the group to the end of the frame; of 2B/0D it gives the MEI type only;
and it has no dissector for ASCII.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from barewire.modbus import decode_request
from barewire.modbus.exceptions import EXCEPTIONS
from barewire.rtu import encode as rtu_frame
from barewire.tcp import encode as tcp_frame
from barewire_workbench import explain
from barewire_workbench.recordings.capture import PacketBuilder, file_header, packet_block
from barewire_workbench.recordings.modbus_replay import replay
from barewire_workbench.sniffer import ResponseSeen
from tests.helpers import unhex
from tests.interop.dissector import ALL, PAIRED, RTU, TCP, UNIT, assert_same_fields, tshark
from tests.interop.services import PUBLIC, service

pytestmark = pytest.mark.needs("tshark")

_PAIRS: list[tuple[str, str | None]] = [
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
    ("08 0003 0A00", "08 0003 0A00"),
    ("08 0004 0000", None),  # has no answer
    ("08 000A 0000", "08 000A 0000"),
    *((f"08 {sub:04X} 0000", f"08 {sub:04X} 0107") for sub in range(0x0B, 0x13)),
    ("08 0014 0000", "08 0014 0000"),
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
    ("2B 0E 02 00", "2B 0E 02 02 FF 03 02 00 02 4142 01 01 43"),
    ("2B 0E 03 00", "2B 0E 03 03 00 00 02 00 02 4142 80 02 4344"),
    ("2B 0E 04 80", "2B 0E 04 83 00 00 01 80 02 4142"),
    ("2B 0D 00 1F 1005 00 0000 0008", "2B 0D 00 1F 1005 00 0000 0002 1234"),
    ("2B 0D 01 1F 1005 00 0000 0002 1234", "2B 0D 01 1F 1005 00 0000 0000"),
    ("2B 0D 00 00 1F 1005 00 0000 0008", "2B 0D 00 00 1F 1005 00 0000 0002 1234"),
    *(("03 0000 0001", f"83 {code:02X}") for code in EXCEPTIONS),
    ("2B 0E 05 00", "AB 03"),
    ("2B 0D 00 1F 1005 00 0000 0008", "AB FF 0006 0D EC 06020000"),
]
_DECLINED: list[tuple[str, str | None]] = [
    (request, f"{unhex(request)[0] | 0x80:02X} 02") for request, _ in {pair[0][:2]: pair for pair in _PAIRS}.values()
]
EXCHANGES = [*_PAIRS, *_DECLINED]
MESSAGES = [
    (number, is_answer, unhex(text))
    for number, exchange in enumerate(EXCHANGES)
    for is_answer, text in enumerate(exchange)
    if text is not None
]
"""Number of the exchange, whether the message is its answer, and the PDU."""


def test_the_exchanges_cover_every_function_and_every_exception() -> None:
    good, asked = set(), set()
    for request, response in EXCHANGES:
        pdu, answer = unhex(request), unhex(response or "")
        asked.add(pdu[0])
        if answer[:1] < b"\x80":
            good.add(service(decode_request(pdu)))
        assert explain("tcp", tcp_frame(UNIT, pdu), "request").error is None or request == "2B 0E 05 00"
        assert not answer or explain("tcp", tcp_frame(UNIT, answer), "response").error is None
    assert good == set(PUBLIC)
    answers = {unhex(response) for _, response in EXCHANGES if response}
    assert {answer[1] for answer in answers if answer[0] == 0x83} >= set(EXCEPTIONS)
    assert {answer[0] & 0x7F for answer in answers if answer[0] & 0x80} == asked


def capture(file: Path, wrap: Callable[[PacketBuilder, int, bool, bytes], bytes]) -> bytes:
    """Write every message as a packet to the file; return its bytes."""
    packer, data = PacketBuilder(), file_header()
    for place, (number, is_answer, pdu) in enumerate(MESSAGES, 1):
        data += packet_block(1.0 + place / 100, wrap(packer, number, not is_answer, pdu))
    file.write_bytes(data)
    return data


def assert_all_same(rows: list[dict[str, list[str]]]) -> None:
    """Assert that tshark and `explain` find the same in every message, and in its MBAP header."""
    assert len(rows) == len(MESSAGES)
    for (number, is_answer, pdu), row in zip(MESSAGES, rows):
        assert_same_fields(pdu, "response" if is_answer else "request", row)
        header = [int(row[name][0]) for name in TCP]
        assert header == [UNIT, number, 0, len(pdu) + 1]


@pytest.mark.evidence("tshark", "frames", "tcp", *PUBLIC)
def test_every_message_over_tcp(tmp_path: Path) -> None:
    def wrap(packer: PacketBuilder, number: int, from_client: bool, pdu: bytes) -> bytes:
        return packer.tcp(tcp_frame(UNIT, pdu, number), from_client=from_client)

    file = tmp_path / "tcp.pcapng"
    data = capture(file, wrap)
    rows = tshark(file, ALL + TCP)
    assert_all_same(rows)
    # tshark pairs requests and responses as our sniffer does.
    responses = [event for event in replay(data) if isinstance(event, ResponseSeen)]
    pairs = {round(event.at * 100) - 100: round(event.request.at * 100) - 100 for event in responses if event.request}
    assert pairs == {place: place - 1 for place, (_, is_answer, _) in enumerate(MESSAGES, 1) if is_answer}
    theirs = {place: int(row[PAIRED][0]) for place, row in enumerate(rows, 1) if PAIRED in row}
    assert len(theirs) > 10
    assert theirs.items() <= pairs.items()


@pytest.mark.evidence("tshark", "frames", "udp", *PUBLIC)
def test_every_message_over_udp(tmp_path: Path) -> None:
    def wrap(packer: PacketBuilder, number: int, from_client: bool, pdu: bytes) -> bytes:
        return packer.rtu(
            tcp_frame(UNIT, pdu, number), from_client=from_client
        )  # to the UDP port that the builder uses for RTU

    file = tmp_path / "udp.pcapng"
    capture(file, wrap)
    # tshark takes the server's port from the preference of TCP.
    assert_all_same(tshark(file, ALL + TCP, "-o", "mbudp.udp.port:5020", "-o", "mbtcp.tcp.port:5020"))


@pytest.mark.evidence("tshark", "frames", "rtu", *PUBLIC)
def test_every_message_over_rtu(tmp_path: Path) -> None:
    def wrap(packer: PacketBuilder, number: int, from_client: bool, pdu: bytes) -> bytes:
        return packer.rtu(rtu_frame(UNIT, pdu), from_client=from_client)

    file = tmp_path / "rtu.pcapng"
    frame = rtu_frame(UNIT, MESSAGES[0][2])
    damaged = frame[:-1] + bytes([frame[-1] ^ 1])
    file.write_bytes(capture(file, wrap) + packet_block(99.0, PacketBuilder().rtu(damaged, from_client=True)))
    *rows, last = tshark(file, ALL + RTU, "-o", "mbrtu.udp.port:5020", "-o", "mbrtu.crc_verification:TRUE")
    assert len(rows) == len(MESSAGES)
    for (_, is_answer, pdu), row in zip(MESSAGES, rows):
        if len(pdu) == 1:
            assert row == {}  # too short for tshark; compared over TCP
            continue
        assert_same_fields(pdu, "response" if is_answer else "request", row)
        envelope = [int(row[name][0], 0) for name in RTU]
        assert envelope == [UNIT, int.from_bytes(rtu_frame(UNIT, pdu)[-2:], "big"), 1]
    assert last["mbrtu.crc16.status"] == ["0"]


def test_tshark_finds_no_wrong_checksum_and_no_lost_packet(tmp_path: Path) -> None:
    """The checksums of IP, UDP and TCP are right, and TCP analysis reports no lost or repeated segment."""
    packer = PacketBuilder()
    data = file_header()
    for place, from_client in enumerate((True, False, True, False)):
        data += packet_block(place, packer.tcp(tcp_frame(1, b"\x07" + bytes(place), place), from_client=from_client))
        data += packet_block(place, packer.rtu(rtu_frame(1, b"\x07" + bytes(place)), from_client=from_client))
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
