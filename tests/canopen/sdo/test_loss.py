"""The loss matrix: every single frame of a transfer lost, doubled, late, swapped with the next, or corrupted.

A transfer must end with the right bytes or an error; never with wrong bytes, without an end, or with a channel on which
the next transfer fails.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import pytest

from barewire.canopen import AbortCode, BlockSettings, CanFrame, Channel, SdoAbort, SdoServer, download, upload
from barewire.errors import NoAnswer
from tests.canopen.sdo.sdo_bus import Bus, Fault, Store

VALUE = bytes((7 * place + 1) % 251 for place in range(63))
BLKSIZE = 3
BLOCK = BlockSettings(size=BLKSIZE)
TIMEOUT = 1.0


class Kind(NamedTuple):
    """A kind of transfer, and the lengths of the values to transfer."""

    name: str
    downloads: bool
    block: BlockSettings | bool
    lengths: tuple[int, ...]
    known: bool = True


KINDS = (
    Kind("expedited upload", False, False, (2,)),
    Kind("expedited download", True, False, (2,)),
    Kind("segmented upload", False, False, (5, 20)),
    Kind("segmented download", True, False, (5, 20)),
    Kind("segmented download, size unknown", True, False, (5, 20), known=False),
    Kind("block upload", False, BLOCK, (0, 5, 21, 22, 40, 63)),
    Kind("block download", True, BLOCK, (0, 5, 21, 22, 40, 63)),
    Kind("block download, size unknown", True, BLOCK, (5, 22, 63), known=False),
)
BLOCK_CASES = [(kind, length) for kind in KINDS for length in kind.lengths if kind.block]
CASES = [pytest.param(kind, length, id=f"{kind.name}, {length} bytes") for kind in KINDS for length in kind.lengths]


def transfer(kind: Kind, length: int, fault: Fault | None, trusted: bool = False) -> str | int:
    """Return the result of a transfer with this fault: "right" or its abort code. A second transfer must then work."""
    value = VALUE[:length]
    store = Store()
    store.objects[0x2100, 0] = b"" if kind.downloads else value
    server = SdoServer(5, store, blksize=BLKSIZE)
    bus = Bus(server, fault=fault)
    channel = Channel(5)
    outcome: str | int = "right"
    try:
        if kind.downloads:
            data = value if kind.known else [value[:10], value[10:]]
            bus.run(download(channel, 0x2100, 0, data, block=kind.block, timeout=TIMEOUT))
            assert trusted or store.objects[0x2100, 0] == value
        else:
            got = bus.run(upload(channel, 0x2100, block=kind.block, timeout=TIMEOUT))
            assert trusted or got == value
    except SdoAbort as refusal:
        outcome = refusal.code
    except NoAnswer:
        outcome = AbortCode.TIMED_OUT
    bus.rest(5.0)
    assert server.deadline is None
    assert trusted or store.objects[0x2100, 0] in (b"", value)
    bus.fault = None
    bus.run(download(channel, 0x2100, 0, b"the next", block=kind.block))
    assert bus.run(upload(channel, 0x2100, block=kind.block)) == b"the next"
    return outcome


def frames_of(kind: Kind, length: int) -> list[str]:
    """Return the frames of a transfer without faults."""
    seen: list[str] = []

    def fault(number: int, frame: CanFrame) -> list[tuple[float, CanFrame]]:
        seen.append(frame.data.hex(" ").upper())
        return [(0.0, frame)]

    assert transfer(kind, length, fault) == "right"
    return seen


def faults(kind: Kind, length: int) -> Iterator[tuple[int, str, Fault]]:
    """Yield all faults of a transfer but corruption: the number of the frame, the name of the fault, and the fault."""
    for hit in range(len(frames_of(kind, length))):
        for name, delays in (("lost", []), ("doubled", [0.0, 0.0]), ("late", [1.5 * TIMEOUT]), ("swapped", [0.00015])):

            def fault(
                number: int, frame: CanFrame, hit: int = hit, delays: list[float] = delays
            ) -> list[tuple[float, CanFrame]]:
                return [(delay, frame) for delay in (delays if number == hit else [0.0])]

            yield hit, name, fault


SENSIBLE = {
    AbortCode.TIMED_OUT,
    AbortCode.TOGGLE,
    AbortCode.COMMAND,
    AbortCode.SEQUENCE_NUMBER,
    AbortCode.CRC,
    AbortCode.TOO_LONG,
    AbortCode.TOO_SHORT,
}


@pytest.mark.parametrize(("kind", "length"), CASES)
def test_any_frame_lost_doubled_late_or_swapped(kind: Kind, length: int) -> None:
    for hit, name, fault in faults(kind, length):
        outcome = transfer(kind, length, fault)
        assert outcome == "right" or outcome in SENSIBLE, (hit, name)


@pytest.mark.parametrize(("kind", "length"), BLOCK_CASES)
def test_every_segment_and_every_acknowledgement_may_be_lost(kind: Kind, length: int) -> None:
    """Any frame can be lost without an error, except request, response and start, and the end and its response."""
    frames = frames_of(kind, length)
    first = next(number for number, frame in enumerate(frames) if frame[:2] in ("01", "81"))
    last = len(frames) - 3
    for hit, name, fault in faults(kind, length):
        if first <= hit <= last:
            assert transfer(kind, length, fault) == "right", (hit, name, frames[hit])


def test_the_lost_end_of_a_block_upload_delays_nothing() -> None:
    kind, length = KINDS[5], 40
    last = len(frames_of(kind, length)) - 1
    assert transfer(kind, length, lambda number, frame: [(0.0, frame)] * (number != last)) == "right"


@pytest.mark.parametrize("change", [0x01, 0x80, 0xFF])
@pytest.mark.parametrize(("kind", "length"), CASES)
def test_any_byte_of_any_frame_corrupted(kind: Kind, length: int, change: int) -> None:
    """A CRC prevents wrong bytes. Requests, responses and transfers without blocks have none, so their bytes may be
    wrong (46h is a valid response in place of C6h), but every transfer ends, and the next one works."""
    for hit in range(len(frames_of(kind, length))):
        for position in range(8):

            def fault(
                number: int, frame: CanFrame, hit: int = hit, position: int = position
            ) -> list[tuple[float, CanFrame]]:
                data = bytearray(frame.data)
                data[position] ^= change
                return [(0.0, frame._replace(data=bytes(data)) if number == hit else frame)]

            transfer(kind, length, fault, trusted=not kind.block or hit < 2)
