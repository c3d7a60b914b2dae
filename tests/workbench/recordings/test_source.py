"""Recordings of packets and frames that come piece by piece: the same items as of the whole, each as soon as it is
there."""

from __future__ import annotations

import struct
import tracemalloc
from collections import deque
from collections.abc import Callable, Iterator

import pytest

from barewire.canopen import CanFrame
from barewire.errors import DecodeError
from barewire.rtu import encode as rtu_frame
from barewire.tcp import encode as tcp_frame
from barewire_workbench.diagnosis.can_log import CanLogDiagnosis
from barewire_workbench.diagnosis.modbus_log import ModbusLogDiagnosis
from barewire_workbench.monitor.recording import CanRecordingWriter, read_recording
from barewire_workbench.recordings.capture import (
    SOCKETCAN,
    Packet,
    PacketBuilder,
    file_header,
    interface_block,
    packet_block,
    to_packet,
)
from barewire_workbench.recordings.modbus_log import read_modbus_log, read_modbus_parts, reader
from barewire_workbench.recordings.modbus_log.reader import is_can_capture, read_segments
from barewire_workbench.recordings.modbus_replay import replay_parts
from barewire_workbench.recordings.model import Recorded, Unread
from barewire_workbench.recordings.source import PART, START, RecordingSource
from tests.helpers import part_or_whole, refused, unhex
from tests.workbench.recordings.test_blf import blf, classical, container

READ, VALUES = unhex("03 0000 0002"), unhex("03 04 0017 0007")


def modbus_capture(exchanges: int) -> bytes:
    packer, blocks = PacketBuilder(), [file_header()]
    for number in range(exchanges):
        for after, pdu in ((0.0, READ), (0.01, VALUES)):
            blocks.append(packet_block(number + after, packer.rtu(rtu_frame(1, pdu), from_client=pdu is READ)))
    return b"".join(blocks)


def can_capture(frames: int) -> bytes:
    writer = CanRecordingWriter("bus.pcapng")
    return writer.start + b"".join(writer.put(at / 100, "can0", CanFrame(0x705, b"\5")) for at in range(frames))


def can_blf(frames: int) -> bytes:
    pieces = (container(b"".join(classical(0x705, b"\5") for _ in range(100)), packing=0) for _ in range(frames // 100))
    return blf(*pieces)


def read_exchanges(source: RecordingSource) -> Iterator[object]:
    parts = read_modbus_parts(source)
    return replay_parts(next(parts), parts)


FORMS: dict[str, tuple[Callable[[int], bytes], Callable[[RecordingSource], Iterator[object]]]] = {
    "Modbus in pcapng": (modbus_capture, read_exchanges),
    "CAN in pcapng": (can_capture, read_recording),
    "CAN in BLF": (can_blf, read_recording),
}
"""How a recording of so many exchanges or frames is made and read."""


@pytest.mark.parametrize("size", [1, 7, 144, 1000])
@pytest.mark.parametrize("form", FORMS)
def test_a_recording_in_pieces_has_the_same_items(form: str, size: int) -> None:
    """144 bytes are the header of a BLF file: what is read first may end with it."""
    make, read = FORMS[form]
    data = make(200)
    first = max(24, size)  # enough to know the form
    pieces = iter([data[:first], *(data[at : at + size] for at in range(first, len(data), size))])
    whole = list(read(RecordingSource.of(data)))
    assert len(whole) > 190
    assert list(read(RecordingSource(lambda _: next(pieces, b"")))) == whole


@pytest.mark.parametrize("form", FORMS)
def test_the_first_item_is_there_before_the_rest_is_read(form: str) -> None:
    make, read = FORMS[form]
    data, position = make(4_000 if make is modbus_capture else 20_000), 0

    def take(size: int) -> bytes:
        nonlocal position
        position += size
        return data[position - size : position]

    items = read(RecordingSource(take))
    next(items)
    assert position <= START + 2 * PART < len(data)


@pytest.mark.parametrize("counts", part_or_whole((2_000, 4_000, 2 * PART), (5_000, 20_000, 4 * PART)))
@pytest.mark.parametrize("form", FORMS)
def test_the_memory_does_not_grow_with_the_recording(form: str, counts: tuple[int, int, int]) -> None:
    """Items that are kept take more than the bound, also those of the part."""
    make, read = FORMS[form]
    exchanges, frames, bound = counts
    data = make(exchanges if make is modbus_capture else frames)
    peaks = []
    for size in (len(data) // 4, len(data)):
        source = RecordingSource.of(data[:size])  # what is cut off is an Unread
        tracemalloc.start()
        deque(read(source), maxlen=0)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < peaks[0] + bound


def test_a_modbus_capture_that_is_cut_off_is_read_up_to_there() -> None:
    data = modbus_capture(3)
    parts = list(read_modbus_parts(RecordingSource.of(data[:-5])))
    *good, bad = [item for part in parts for item in part.items]
    assert [item.line for item in good] == [1, 2, 3, 4, 5]
    assert isinstance(bad, Unread)
    assert (bad.line, bad.why) == (6, f"the capture is cut off or damaged at byte {len(data) - 84}")
    with refused(DecodeError, "damaged at byte 48"):
        next(read_modbus_parts(RecordingSource.of(data[:60])))


def test_a_block_of_a_length_that_none_has_is_not_read() -> None:
    asked = list[int]()

    def take(size: int) -> bytes:
        asked.append(size)
        return bytes(size)

    source = RecordingSource.of(file_header() + struct.pack("<II", 6, 0x7FFF_FFFC) + bytes(4))
    source._read = take
    (found,) = source.packets
    assert isinstance(found[1], DecodeError)
    assert asked == []


def test_the_first_packet_of_a_protocol_shows_which_recording_it_is() -> None:
    other = packet_block(0.0, bytes(60))
    modbus, can = modbus_capture(1), can_capture(1)
    can_behind = interface_block(SOCKETCAN) + packet_block(2.0, to_packet(CanFrame(0x705, b"\5")), 1)
    for data, is_can in ((modbus, False), (can, True), (file_header() + other * 5000 + can_behind, True)):
        source = RecordingSource.of(data)
        assert is_can_capture(source) is is_can
        if is_can:
            assert [item.bus for item in read_recording(source) if isinstance(item, Recorded)] in (["can0"], ["1"])
    source = RecordingSource.of(modbus + can_behind)
    assert not is_can_capture(source)
    *pieces, left_out = [item for part in read_modbus_parts(source) for item in part.items]
    assert [item.line for item in pieces] == [1, 2]
    assert left_out == Unread(0.01, 0, "1 packet of CAN left out: the capture is read as Modbus", "")


def test_no_packet_of_a_capture_is_left_out_without_a_word() -> None:
    """A capture is read as what its first packet is; the others are counted."""
    other, can = packet_block(3.0, bytes(60)), packet_block(2.0, to_packet(CanFrame(0x705, b"\5")), 1)
    modbus = packet_block(4.0, PacketBuilder().tcp(tcp_frame(1, READ, 1), from_client=True))
    interfaces = file_header() + interface_block(SOCKETCAN, "can0")
    first_modbus, first_can = interfaces + modbus + can + other + can, interfaces + can + modbus + other + other
    words = {
        first_modbus: [
            "2 packets of CAN left out: the capture is read as Modbus",
            "1 packet holds neither Modbus nor CAN",
        ],
        first_can: ["1 packet of Modbus left out: the capture is read as CAN", "2 packets hold neither Modbus nor CAN"],
    }
    read = [item for part in read_modbus_parts(RecordingSource.of(first_modbus)) for item in part.items]
    assert [item.why for item in read if isinstance(item, Unread)] == words[first_modbus]
    assert [item.why for item in read_recording(first_can) if isinstance(item, Unread)] == words[first_can]
    bus = CanLogDiagnosis()
    assert [found for item in read_recording(first_can) for found in bus.feed(item)] == []
    line = ModbusLogDiagnosis(read_modbus_log(first_modbus))
    assert list(line.findings()) == []
    verdicts = [verdict for _, verdict in (*bus.verdicts(), *line.verdicts()) if verdict.code == "not-seen"]
    assert [verdict.evidence.partition(";")[0] for verdict in verdicts] == [
        "1 packet of Modbus left out: the capture is read as CAN",
        "2 packets of CAN left out: the capture is read as Modbus",
    ]


@pytest.mark.parametrize("connections", part_or_whole(5_000, 20_000))
def test_connections_whose_order_is_known_are_bounded(connections: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The reassembly forgets the connections that are silent the longest: in `make test` a quarter of all."""
    monkeypatch.setattr(reader, "_DIRECTIONS", reader._DIRECTIONS * connections // 20_000)
    whole, port = PacketBuilder().tcp(tcp_frame(1, READ, 1), from_client=True), 34
    packets = (
        (number, Packet(number, whole[:port] + struct.pack(">H", 1024 + number) + whole[port + 2 :]))
        for number in range(1, connections)
    )
    tracemalloc.start()
    assert sum(1 for _ in read_segments(packets, {502})) == connections - 1
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 400 * connections
