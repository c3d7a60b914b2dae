"""Captures, logs and dumps, written and read, also those of other programs; damaged ones raise one clear error."""

from __future__ import annotations

import json
import struct
from typing import Any

import pytest
from hypothesis import given, strategies as st

from barewire.ascii import encode as ascii_frame
from barewire.errors import BarewireError, DecodeError, EncodeError
from barewire.rtu import encode as rtu_frame
from barewire.tcp import encode as tcp_frame
from barewire_workbench.frames.modbus_exchanges import Exchanges, exchange_as_dict
from barewire_workbench.recordings.capture import (
    Packet,
    PacketBuilder,
    file_header,
    is_capture,
    modbus_payload,
    packet_block,
    read_packets,
)
from barewire_workbench.recordings.modbus_log import LoggedBytes, read_modbus_log
from barewire_workbench.recordings.modbus_log.octets import STEP, Chunk, parse_log
from barewire_workbench.recordings.modbus_replay import replay
from barewire_workbench.sniffer import (
    AmbiguousFrame,
    NoiseSeen,
    RequestSeen,
    ResponseMissing,
    ResponseSeen,
    SnifferEvent,
)
from tests.helpers import modest, refused, unhex

READ, VALUES = unhex("03 0000 0002"), unhex("03 04 0017 0007")


def names(events: list[SnifferEvent]) -> list[str]:
    return [type(event).__name__ for event in events]


# Files of packets --------------------------------------------------------------------------------------------------


@modest
@given(st.lists(st.tuples(st.integers(0, 2**50), st.binary(max_size=70)), max_size=5))
def test_written_packets_are_read_back(packets: list[tuple[int, bytes]]) -> None:
    file = file_header() + b"".join(packet_block(micros / 1e6, data) for micros, data in packets)
    assert is_capture(file)
    assert [(round(packet.at * 1e6), packet.data) for packet in read_packets(file)] == packets


def section(order: str, link: int, resolution: int, *packets: tuple[int, bytes]) -> bytes:
    """Return a file of another program: either byte order, an option for the unit of time, an unknown block."""

    def block(kind: int, body: bytes) -> bytes:
        body += bytes(-len(body) % 4)
        size = struct.pack(f"{order}I", len(body) + 12)
        return struct.pack(f"{order}I", kind) + size + body + size

    options = struct.pack(f"{order}HHBxxxHH", 9, 1, resolution, 0, 0)
    file = block(0x0A0D0D0A, struct.pack(f"{order}IHHq", 0x1A2B3C4D, 1, 0, -1))
    file += block(1, struct.pack(f"{order}HHI", link, 0, 0) + options) + block(0xBAD, b"what?")
    for ticks, data in packets:
        file += block(6, struct.pack(f"{order}5I", 0, ticks >> 32, ticks & 0xFFFFFFFF, len(data), len(data)) + data)
    return file + block(3, struct.pack(f"{order}I", 3) + b"abc")


@pytest.mark.parametrize("order", ["<", ">"])
def test_pcapng_files_of_other_programs_are_read(order: str) -> None:
    for resolution, ticks in ((9, 1_500_000_000), (0x80 | 10, 1536)):
        found = read_packets(section(order, 101, resolution, (ticks, b"xyz")))
        assert found == [Packet(1.5, b"xyz", 101), Packet(0.0, b"abc", 101)]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("magic", "fraction"), [(0xA1B2C3D4, 500_000), (0xA1B23C4D, 500_000_000)])
def test_pcap_files_are_read(order: str, magic: int, fraction: int) -> None:
    file = struct.pack(f"{order}IHHiIII", magic, 2, 4, 0, 0, 65535, 1)
    file += struct.pack(f"{order}4I", 7, fraction, 3, 3) + b"abc"
    assert is_capture(file)
    assert read_packets(file) == [Packet(7.5, b"abc", 1)]
    for cut in (10, 30, len(file) - 1):
        with pytest.raises(DecodeError):
            read_packets(file[:cut])


def test_a_capture_that_is_cut_off_or_invalid_is_refused() -> None:
    file = file_header() + packet_block(1.0, b"abcdef")
    for cut in range(len(file_header()) + 1, len(file)):
        with refused(DecodeError, "is cut off or damaged"):
            read_packets(file[:cut])
    with refused(DecodeError, "neither a pcapng nor a pcap file"):
        read_packets(struct.pack("<III", 0xBAD, 12, 12))
    with refused(DecodeError, "without its magic number"):
        read_packets(b"\x0a\x0d\x0d\x0a" + struct.pack("<II", 16, 99) + struct.pack("<I", 16))
    assert read_packets(b"") == []


@modest
@given(st.binary(max_size=120), st.booleans())
def test_any_bytes_are_a_capture_or_a_clear_error(data: bytes, begins: bool) -> None:
    for kind in (file_header() + data if begins else data, b"\xd4\xc3\xb2\xa1" + data):
        try:
            list(replay(kind))
        except BarewireError:
            continue


# Packets -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("from_client", [True, False])
def test_modbus_frames_in_packets(from_client: bool) -> None:
    carried = modbus_payload(Packet(1.0, PacketBuilder().rtu(b"frame", from_client=from_client)))
    assert carried is not None
    assert (carried.protocol, carried.from_client, carried.data) == ("rtu", from_client, b"frame")
    carried = modbus_payload(Packet(1.0, PacketBuilder().tcp(b"frame", from_client=from_client)))
    assert carried is not None
    assert (carried.protocol, carried.from_client, carried.data) == ("tcp", from_client, b"frame")
    assert carried.connection == (unhex("7F000001"), 50000, unhex("7F000002"), 502)


def test_other_link_types_carry_ip() -> None:
    whole = PacketBuilder().tcp(b"frame", from_client=True)
    ip = whole[14:]
    for link, before in ((101, b""), (0, bytes(4)), (113, bytes(16)), (276, bytes(20)), (1, whole[:12])):
        data = before + (unhex("8100 0005 0800") if link == 1 else b"") + ip
        carried = modbus_payload(Packet(1.0, data, link))
        assert carried is not None
        assert carried.data == b"frame"


def test_packets_without_modbus_are_skipped() -> None:
    whole = PacketBuilder().tcp(b"frame", from_client=True)
    for data, link in (
        (whole, 147),  # an unknown link type
        (whole[:12] + b"\x86\xdd" + whole[14:], 1),  # IPv6
        (whole[:20], 1),
        (whole[:20] + b"\x20\x00" + whole[22:], 1),  # a fragment
        (whole[:23] + b"\x01" + whole[24:], 1),  # ICMP
        (PacketBuilder(1502).tcp(b"frame", from_client=True), 1),
        (whole[:54], 1),  # a segment without data
    ):
        assert modbus_payload(Packet(1.0, data, link)) is None


# Recordings --------------------------------------------------------------------------------------------------------


def capture(*frames: tuple[float, bytes]) -> bytes:
    return file_header() + b"".join(packet_block(at, data) for at, data in frames)


def test_a_capture_of_rtu_is_decoded() -> None:
    packer = PacketBuilder()
    file = capture(
        (1.0, packer.rtu(rtu_frame(1, READ), from_client=True)),
        (1.1, packer.rtu(rtu_frame(1, VALUES), from_client=False)),
        (1.2, packer.rtu(b"\xff\x00", from_client=True)),
        (1.3, packer.rtu(rtu_frame(2, READ), from_client=True)),
    )
    assert names(list(replay(file))) == ["RequestSeen", "ResponseSeen", "NoiseSeen", "RequestSeen", "RecordingEnds"]


def test_a_capture_of_tcp_with_segments_out_of_order_repeated_and_missing() -> None:
    packer = PacketBuilder()
    requests = [packer.tcp(tcp_frame(1, READ, number), from_client=True) for number in range(4)]
    answers = [packer.tcp(tcp_frame(1, VALUES, number), from_client=False) for number in range(4)]
    order = [requests[0], answers[0], requests[2], requests[1], requests[1], answers[1], answers[2], b"", requests[3]]
    events = list(replay(capture(*((place / 100, data) for place, data in enumerate(order)))))
    assert [(type(event).__name__, getattr(event, "transaction", None)) for event in events] == [
        ("RequestSeen", 0), ("ResponseSeen", 0), ("RequestSeen", 1), ("RequestSeen", 2),
        ("ResponseSeen", 1), ("ResponseSeen", 2), ("RequestSeen", 3), ("RecordingEnds", None),
    ]  # fmt: skip
    many = [packer.tcp(tcp_frame(1, READ, number), from_client=True) for number in range(100)]
    events = list(replay(capture(*((place / 1000, data) for place, data in enumerate(many) if place != 5))))
    assert names(events).count("RequestSeen") == 99


def header(transaction: int, protocol: int, length: int) -> bytes:
    return struct.pack(">HHH", transaction, protocol, length)


@pytest.mark.parametrize(
    ("damaged", "noise"),
    [
        (header(1, 1, 7) + b"\1" + VALUES, 13),  # another protocol
        (header(1, 0, 0x0107) + b"\1" + VALUES, 13),  # lengths that none has
        (header(1, 0, 0x0700) + b"\1" + VALUES, 13),
        (header(1, 0, 0) + b"\1" + VALUES, 13),
        (header(1, 0, 9) + b"\1" + VALUES, 13),  # more than what follows
        (header(1, 0, 200) + b"\1" + VALUES, 13),
        (header(1, 0, 6) + b"\1" + VALUES, 13),  # less: the message is whole, and not what the header says
        (header(1, 1, 7) + b"\1" + VALUES + tcp_frame(1, VALUES, 7), 13),  # and a good frame in the same segment
        (b"GET / HTTP/1.1\r\n\r\n", 18),
    ],
)  # fmt: skip
def test_behind_a_wrong_header_the_next_frames_are_read(damaged: bytes, noise: int) -> None:
    packer, file = PacketBuilder(), list[tuple[float, bytes]]()
    for number in range(4):
        answer = damaged if number == 1 else tcp_frame(1, VALUES, number)
        file.append((1.0 + number, packer.tcp(tcp_frame(1, READ, number), from_client=True)))
        file.append((1.1 + number, packer.tcp(answer, from_client=False)))
    events = list(replay(capture(*file)))
    answered = [event.transaction for event in events if isinstance(event, ResponseSeen) and event.request]
    assert answered == [0, 2, 3]
    assert sum(len(event.noise.data) for event in events if isinstance(event, NoiseSeen)) == noise


def test_a_frame_in_two_segments_is_whole_also_if_the_second_begins_like_a_header() -> None:
    """Registers 0000h 0000h 0006h 0103h: the second segment looks like the header of a request."""
    packer, answer = PacketBuilder(), tcp_frame(1, unhex("03 0C 0001 0002 0000 0006 0103 0000"), 1)
    parts = [packer.tcp(part, from_client=False) for part in (answer[:11], answer[11:])]
    asked = packer.tcp(tcp_frame(1, unhex("03 0000 0006"), 1), from_client=True)
    events = list(replay(capture((1.0, asked), (1.1, parts[0]), (1.2, parts[1]))))
    assert names(events) == ["RequestSeen", "ResponseSeen"]


def test_the_port_of_the_server_can_be_given() -> None:
    file = capture((1.0, PacketBuilder(1502).tcp(tcp_frame(1, READ, 1), from_client=True)))
    assert list(replay(file)) == []
    assert names(list(replay(file, ports={1502}))) == ["RequestSeen", "RecordingEnds"]


FRAME = rtu_frame(1, READ)


@pytest.mark.parametrize(
    ("text", "chunks"),
    [
        (f"12.345678 {FRAME.hex(' ')}", [Chunk(12.345678, FRAME)]),
        (f"(1.5) {FRAME.hex()}\n[2] > 0x01,0x03", [Chunk(1.5, FRAME), Chunk(2.0, b"\x01\x03")]),
        ("10:31:18.25 RX: 01 03", [Chunk(37878.25, b"\x01\x03")]),
        ("# a remark\n\n01 03\n83 02 # and one", [Chunk(0.0, b"\x01\x03"), Chunk(STEP, b"\x83\x02")]),
        ("00000000: 0103 0000 0002  ......\n00000006: c40b  ..", [Chunk(0.0, FRAME)]),
        (
            "00000000  01 03 00 00 00 02 c4 0b  01 03 04 00 17 00 07 00  |.........|\n00000010  01  |.|\n00000011",
            None,
        ),
        (":0103", [Chunk(0.0, b":0103\r\n")]),
        ("", []),
    ],
)
def test_logs_and_dumps(text: str, chunks: list[Chunk] | None) -> None:
    if chunks is None:
        (chunk,) = parse_log(text.rpartition("\n")[0]).chunks
        assert chunk.data == FRAME + unhex("01 03 04 0017 0007 00 01")
    else:
        assert parse_log(text).chunks == chunks


def test_an_unreadable_line_is_reported_with_its_number() -> None:
    with refused(DecodeError, "line 2: 'X' at 3 is not a hexadecimal digit"):
        parse_log("01 03\n01 X3")


def test_the_characters_of_a_dump_are_not_read_as_bytes() -> None:
    """The digits and letters at the end of a full line of xxd could be bytes in hexadecimal, too."""
    (chunk,) = parse_log("00000000: 3031 3233 3435 3637 3839 4142 4344 4546  0123456789ABCDEF").chunks
    assert chunk.data == b"0123456789ABCDEF"
    with refused(DecodeError, "neither a capture nor text"):
        replay(b"\xff\xfe\x00")


def dump_of(data: bytes) -> bytes:
    """The bytes as `xxd` shows them."""
    rows = (f"{at:08x}: {data[at : at + 16].hex(' ', 2)}  ................\n" for at in range(0, len(data), 16))
    return "".join(rows).encode()


def test_an_offset_of_a_dump_that_is_a_frame_by_itself_is_an_offset() -> None:
    """01 B0 is the CRC of 00 00: the line at 1B0h was read as an exchange, and no other line of the dump at all."""
    data = b"".join(rtu_frame(1, pdu) for _ in range(100) for pdu in (READ, VALUES))
    log = read_modbus_log(dump_of(data))
    assert log.form == "bytes"
    assert b"".join(item.data for item in log.items if isinstance(item, LoggedBytes)) == data
    assert names(list(replay(dump_of(data)))) == ["RequestSeen", "ResponseSeen"] * 100


def test_a_response_that_is_a_request_without_its_last_byte() -> None:
    log = b"16.35 01 03 00 00 00 02 C4 0B\n16.36 01 03 04 00 F0 00 00 FA 00\n"
    asked, answered = replay(log)
    assert isinstance(answered, ResponseSeen)
    assert (answered.request, answered.pdu.hex()) == (asked, "030400f00000")


def test_a_log_of_rtu_and_one_of_ascii() -> None:
    log = f"1.0 {FRAME.hex(' ')}\n1.1 {rtu_frame(1, VALUES).hex(' ')}\n5.0 {FRAME.hex(' ')}\n9.0 FF"
    events = list(replay(log.encode()))
    assert names(events) == ["RequestSeen", "ResponseSeen", "RequestSeen", "ResponseMissing", "NoiseSeen"]
    text = b"".join(ascii_frame(1, pdu).replace(b"\r\n", b"\n") for pdu in (READ, VALUES))
    assert names(list(replay(text))) == ["RequestSeen", "ResponseSeen"]


# As text ----------------------------------------------------------------------------------------------------------


def shown(text: str) -> list[str]:
    lines = Exchanges()
    return [*map(str, [line for event in replay(text.encode()) for line in lines.feed(event)] + lines.end())]


@pytest.mark.parametrize(
    ("log", "lines"),
    [
        (["1.0 1 0300000002", "1.1 1 030400170007"],
         ["1.000000  unit 1  Read Holding Registers, 2 from 0000h -> 23 7, after 100.0 ms"]),
        (["1.0 1 0600010003", "1.1 1 0600010003"],
         ["1.000000  unit 1  Write Single Register, 3 to 0001h -> done, after 100.0 ms"]),
        (["1.0 1 10000000010200FF", "1.1 1 1000000001"],
         ["1.000000  unit 1  Write Multiple Registers, 1 from 0000h -> done, after 100.0 ms"]),
        (["1.0 1 0300000002", "1.1 1 8302"],
         ["1.000000  unit 1  Read Holding Registers, 2 from 0000h -> exception 02 (illegal data address), "
          "after 100.0 ms"]),
        (["1.0 1 0100000009", "1.1 1 0102FF01"],
         ["1.000000  unit 1  Read Coils, 9 from 0000h -> 02 FF 01, after 100.0 ms"]),
        (["1.0 0 0600010003"], ["1.000000  all     Write Single Register, 3 to 0001h (broadcast)"]),
        (["1.0 1 0600010003"],
         ["1.000000  unit 1  Write Single Register, 3 to 0001h -> seen once: the request or its echo"]),
        (["1.0 1 030400170007"], ["1.000000  unit 1  (request not seen) -> Read Holding Registers, 2 registers"]),
        (["1.0 1 0300000002"], ["1.000000  unit 1  Read Holding Registers, 2 from 0000h -> the recording ends here"]),
        (["1.0 1 0300000002", "3.0 1 0300000002"],
         ["1.000000  unit 1  Read Holding Registers, 2 from 0000h -> no answer",
          "3.000000  unit 1  Read Holding Registers, 2 from 0000h -> the recording ends here"]),
        (["1.0 1 0300000001", "1.3 2 0300000001", "1.4 1 03020001", "1.5 2 03020002"],
         ["1.000000  unit 1  Read Holding Registers, 1 from 0000h -> no answer",
          "1.300000  unit 2  Read Holding Registers, 1 from 0000h -> 2, after 200.0 ms",
          "1.400000  unit 1  Read Holding Registers, 1 from 0000h -> 1, late: 400.0 ms after its request, and after "
          "the next one"]),
    ],
)  # fmt: skip
def test_a_line_for_each_exchange(log: list[str], lines: list[str]) -> None:
    rows = [line.split() for line in log]
    text = "\n".join(f"{at} {rtu_frame(int(unit), unhex(pdu)).hex()}" for at, unit, pdu in rows)
    assert shown(text) == lines


def test_noise_has_a_line() -> None:
    assert shown("1.0 FF 00 55") == ["1.030000  noise   FF 00 55 (3 bytes, then silence)"]


def test_events_for_programs() -> None:
    lines = [(1.0, 1, "03 0000 0001"), (1.5, 1, "83 02"), (3.0, 1, "06 0001 0003"), (9.0, 0, "06 0001 0003")]
    log = "\n".join(f"{at} {rtu_frame(unit, unhex(pdu)).hex()}" for at, unit, pdu in lines)
    events = list(replay(f"{log}\n9.5 FF 00".encode()))
    assert names(events) == ["RequestSeen", "ResponseSeen", "AmbiguousFrame", "RequestSeen", "NoiseSeen"]
    dicts = [json.loads(json.dumps(exchange_as_dict(event))) for event in events]
    assert [event["event"] for event in dicts] == ["request", "response", "half", "broadcast", "noise"]
    assert dicts[0]["fields"] == {"function_code": 3, "address": 0, "quantity": 1}
    assert (dicts[1]["exception"], dicts[1]["request_at"], dicts[1]["seconds"]) == (2, 1.0, 0.5)
    assert dicts[4]["data"] == "ff00"


@modest
@given(st.integers(0, 255), st.binary(min_size=1, max_size=253), st.booleans())
def test_any_exchange_has_a_line_and_a_dict(unit: int, pdu: bytes, answered: bool) -> None:
    request = RequestSeen(unit, pdu, 1.0)
    response = ResponseSeen(unit, pdu, 2.0, request=request if answered else None)
    events: list[SnifferEvent] = [request, response, AmbiguousFrame(unit, pdu, 1.0), ResponseMissing(request, 2.0)]
    for event in events:
        assert bool(Exchanges().feed(event)) == (event is not request or unit == 0)
        assert json.loads(json.dumps(exchange_as_dict(event)))["unit"] == unit


# IPv6 --------------------------------------------------------------------------------------------------------------


def over_ipv6(frame: bytes, from_client: bool, *extensions: tuple[int, bytes], version: int = 6) -> bytes:
    """Return a packet over IPv6 instead of IPv4: the TCP or UDP segment stays as it is."""
    segment = frame[34:]
    kind, inner = frame[23], segment
    for number, content in reversed(extensions):
        size = len(content) // 8 if number == 44 else (len(content) + 2 - 8) // 8
        inner = bytes([kind, 0 if number == 44 else size]) + content + inner
        kind = number
    client, server = unhex("FE80" + "00" * 13 + "01"), unhex("FE80" + "00" * 13 + "02")
    source, target = (client, server) if from_client else (server, client)
    head = bytes([version << 4, 0, 0, 0]) + len(inner).to_bytes(2, "big") + bytes([kind, 64]) + source + target
    return bytes(12) + b"\x86\xdd" + head + inner


def test_an_exchange_over_ipv6() -> None:
    packer, data = PacketBuilder(), file_header()
    for place, (pdu, from_client) in enumerate([(READ, True), (VALUES, False)]):
        packet_data = packer.tcp(tcp_frame(1, pdu, 7), from_client=from_client)
        data += packet_block(1.0 + place / 10, over_ipv6(packet_data, from_client))
    request, response = replay(data)
    assert isinstance(response, ResponseSeen)
    assert (response.request, response.pdu) == (request, VALUES)


@pytest.mark.parametrize("extension", [(0, bytes(6)), (60, bytes(14)), (43, bytes(6)), (44, bytes(6))])
def test_extension_headers_of_ipv6_are_skipped(extension: tuple[int, bytes]) -> None:
    whole = over_ipv6(PacketBuilder().rtu(b"frame", from_client=False), False, extension, (0, bytes(6)))
    carried = modbus_payload(Packet(1.0, whole))
    assert carried is not None
    assert (carried.protocol, carried.from_client, carried.data) == ("rtu", False, b"frame")
    assert carried.connection[0] == unhex("FE80" + "00" * 13 + "01")
    for link, before in ((101, 0), (0, 4), (113, 16), (276, 20)):
        other = modbus_payload(Packet(1.0, bytes(before) + whole[14:], link))
        assert other is not None
        assert other.data == b"frame"


def test_ipv6_fragments_and_others_are_skipped() -> None:
    whole = PacketBuilder().tcp(b"frame", from_client=True)
    fragment = over_ipv6(whole, True, (44, unhex("0001 0000 0001")))
    for data in (fragment, over_ipv6(whole, True, version=4), over_ipv6(whole, True)[:50], over_ipv6(whole, True)[:20]):
        assert modbus_payload(Packet(1.0, data)) is None
    assert modbus_payload(Packet(1.0, over_ipv6(whole, True, (0, bytes(6)))[:58])) is None


@modest
@given(st.binary(max_size=90), st.sampled_from([0, 43, 44, 60, 6, 17]))
def test_any_bytes_of_ipv6(data: bytes, kind: int) -> None:
    modbus_payload(Packet(0.0, bytes(12) + b"\x86\xdd\x60" + bytes(5) + bytes([kind]) + data))


# RTU or ASCII --------------------------------------------------------------------------------------------------------


def log(*pieces: bytes) -> bytes:
    return "\n".join(f"{place}.0 {piece.hex(' ')}" for place, piece in enumerate(pieces, start=1)).encode()


ASCII_READ = ascii_frame(1, bytes.fromhex("03 0000 0002"))
ASCII_VALUES = ascii_frame(1, bytes.fromhex("03 04 0017 0007"))
TEXT_REGISTERS = rtu_frame(1, bytes.fromhex("03 20") + b"12:34:56:0A:0B\r\n:010300000001FB\r")


@pytest.mark.parametrize(
    ("pieces", "protocol"),
    [
        ((ASCII_READ, ASCII_VALUES), "ascii"),
        ((ASCII_READ[4:], ASCII_READ, ASCII_VALUES), "ascii"),  # begins in the middle of a frame
        ((ASCII_VALUES[7:],), "ascii"),  # and ends before another frame
        ((b"\xff\x00", ASCII_READ, b"\x80", ASCII_VALUES), "ascii"),  # noise
        ((rtu_frame(1, bytes.fromhex("03 0000 0002")), rtu_frame(1, bytes.fromhex("03 04 0017 0007"))), "rtu"),
        ((TEXT_REGISTERS, TEXT_REGISTERS), "rtu"),  # most bytes are characters of ASCII frames
        ((b":", rtu_frame(1, bytes.fromhex("03 0000 0002"))), "rtu"),
    ],
)
def test_rtu_or_ascii_is_judged_by_all_bytes_of_a_recording(pieces: tuple[bytes, ...], protocol: Any) -> None:
    events = list(replay(log(*pieces)))
    assert events == list(replay(log(*pieces), protocol=protocol))
    assert events != list(replay(log(*pieces), protocol="rtu" if protocol == "ascii" else "ascii"))


def test_a_capture_has_a_protocol_for_each_packet() -> None:
    with pytest.raises(EncodeError, match="in a capture each packet has its own"):
        replay(file_header(), protocol="rtu")
