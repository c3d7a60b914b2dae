"""The loss matrix: every single frame of a transfer lost, doubled, late, swapped with the next, or corrupted.

A transfer must end with the right bytes or an error; never with wrong bytes, or without an end. The next transfers
begin at once, without a rest of the bus, and must be right: of the same object and of another one, in one frame, in
segments and in blocks. Exhaustive for values of these sizes, at most 63 bytes: all frames of all kinds of transfers,
all five faults (`loss`), all six sequences that follow on a server with blocks of 3 segments, three with 127 segments.
`test_loss_sizes` has longer values.
"""

from __future__ import annotations

import pytest

from barewire.canopen import AbortCode
from tests.canopen.sdo.loss import BLKSIZE, BLOCK, FAULTS, THEN, Corrupted, Kind, OneFault, transfer

KINDS = (
    Kind("expedited upload", False, False, (2,)),
    Kind("expedited download", True, False, (2,)),
    Kind("segmented upload", False, False, (0, 5, 20)),
    Kind("segmented download", True, False, (0, 5, 20)),
    Kind("segmented download, size unknown", True, False, (5, 20), known=False),
    Kind("block upload", False, BLOCK, (0, 5, 21, 22, 40, 63)),
    Kind("block download", True, BLOCK, (0, 5, 21, 22, 40, 63)),
    Kind("block download, size unknown", True, BLOCK, (5, 22, 63), known=False),
)
BLOCK_CASES = [(kind, length) for kind in KINDS for length in kind.lengths if kind.block]
CASES = [pytest.param(kind, length, id=f"{kind.name}, {length} bytes") for kind in KINDS for length in kind.lengths]


def frames_of(kind: Kind, length: int, blksize: int = BLKSIZE) -> list[str]:
    """Return the frames of a transfer without faults."""
    frames: list[str] = []
    assert transfer(kind, length, frames=frames, blksize=blksize) == "right"
    return frames


SENSIBLE = {
    AbortCode.TIMED_OUT,
    AbortCode.TOGGLE,
    AbortCode.COMMAND,
    AbortCode.SEQUENCE_NUMBER,
    AbortCode.CRC,
    AbortCode.TOO_LONG,
    AbortCode.TOO_SHORT,
}


@pytest.mark.long
@pytest.mark.parametrize("blksize", [BLKSIZE, 127])
@pytest.mark.parametrize(("kind", "length"), CASES)
def test_any_frame_lost_doubled_late_or_swapped(kind: Kind, length: int, blksize: int) -> None:
    for hit in range(len(frames_of(kind, length, blksize))):
        for name in FAULTS:
            for number, then in enumerate(THEN if blksize == BLKSIZE else THEN[hit % 2 :: 2]):
                outcome = transfer(kind, length, OneFault(hit, name), then, blksize=blksize)
                assert outcome == "right" or outcome in SENSIBLE, (hit, name, number)


@pytest.mark.parametrize(("kind", "length"), BLOCK_CASES)
def test_every_segment_and_every_acknowledgement_may_be_lost(kind: Kind, length: int) -> None:
    """Any frame can be lost without an error, except request, response and start, and the end and its response."""
    frames = frames_of(kind, length)
    first = next(number for number, frame in enumerate(frames) if frame[:2] in ("01", "81"))
    for hit in range(first, len(frames) - 2):
        for name in ("lost", "doubled", "overtaken", "swapped"):
            assert transfer(kind, length, OneFault(hit, name)) == "right", (hit, name, frames[hit])


def test_the_lost_end_of_a_block_upload_delays_nothing() -> None:
    kind, length = KINDS[5], 40
    last = len(frames_of(kind, length)) - 1
    assert transfer(kind, length, OneFault(last, "lost")) == "right"


@pytest.mark.parametrize("change", [0x01, 0x80, 0xFF])
@pytest.mark.parametrize(("kind", "length"), CASES)
def test_any_byte_of_any_frame_corrupted(kind: Kind, length: int, change: int) -> None:
    """A CRC prevents wrong bytes. Requests, responses and transfers without blocks have none, so their bytes may be
    wrong (46h is a valid response in place of C6h), but every transfer ends, and the next one works."""
    for hit in range(len(frames_of(kind, length))):
        for position in range(8):
            fault = Corrupted(hit, position, change)
            transfer(kind, length, fault, trusted=not kind.block or hit < 2)
