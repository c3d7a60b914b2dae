"""Recordings of packets and frames that come piece by piece: the same items as of the whole, each as soon as it is
there."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from barewire.canopen import CanFrame
from barewire.rtu import encode as rtu_frame
from barewire_workbench.monitor.recording import CanRecordingWriter, read_recording
from barewire_workbench.recordings.modbus_log.reader import read_modbus_parts
from barewire_workbench.recordings.modbus_packets import PacketBuilder
from barewire_workbench.recordings.modbus_replay import replay_parts
from barewire_workbench.recordings.pcapng import file_header, packet_block
from barewire_workbench.recordings.source import PART, START, RecordingSource
from tests.helpers import unhex
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
    data, position = make(40_000), 0

    def take(size: int) -> bytes:
        nonlocal position
        position += size
        return data[position - size : position]

    items = read(RecordingSource(take))
    next(items)
    assert position <= START + 2 * PART < len(data)
