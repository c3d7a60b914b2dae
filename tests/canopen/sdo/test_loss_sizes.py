"""The loss matrix for longer values: one frame lost, doubled, late or swapped, and the next transfers begun at once.

`test_loss` is exhaustive up to 63 bytes. Here a sample, the same in every run: sizes of 0 to 2,000 bytes around the
limits of an expedited transfer (4), a segment (7) and a block (7 * 127 = 889), and 100 kB; for each size, kind of
transfer and fault the first and the last three frames, and some in between. Blocks have 127 segments.

A segment of a block download of 100 kB that is overtaken by everything behind it arrives in a later transfer, where it
is a request as good as any other: no server can tell. CAN frames do not overtake each other, so it is left out.
"""

from __future__ import annotations

import random

import pytest

from tests.canopen.sdo.test_loss import FAULTS, SENSIBLE, THEN, Kind, OneFault, transfer
from tests.helpers import some_of

SIZES = (1, 3, 4, 6, 7, 8, 14, 15, 100, 890, 889, 2000)
KINDS = (
    Kind("upload", False, False, SIZES),
    Kind("download", True, False, SIZES),
    Kind("block upload", False, True, SIZES),
    Kind("block download", True, True, SIZES),
)


def check(kind: Kind, length: int, middle: int, edge: int = 3) -> None:
    """Check a transfer with every fault at its first and last frames, and at `middle` others."""
    frames: list[str] = []
    assert transfer(kind, length, blksize=127, frames=frames) == "right"
    count, random_number = len(frames), random.Random(length)
    hits = {*range(min(edge, count)), *range(max(0, count - edge), count)}
    hits.update(random_number.sample(range(count), min(middle, count)))
    for number, hit in enumerate(sorted(hits)):
        for name in FAULTS:
            then = THEN[(number + FAULTS.index(name)) % len(THEN)]
            outcome = transfer(kind, length, OneFault(hit, name), then, blksize=127)
            assert outcome == "right" or outcome in SENSIBLE, (hit, name)


@pytest.mark.long
@pytest.mark.parametrize("length", some_of(SIZES, 10))
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_a_fault_in_a_transfer_of_any_size(kind: Kind, length: int) -> None:
    check(kind, length, middle=2)


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "name", "part"),
    [
        (KINDS[0], "late", 0.4),
        pytest.param(KINDS[0], "swapped", 1.7, marks=pytest.mark.proof),
        (KINDS[1], "lost", 0.3),
        pytest.param(KINDS[1], "doubled", 1.0, marks=pytest.mark.proof),
        (KINDS[2], "lost", 0.1),
        (KINDS[2], "overtaken", 0.5),
        (KINDS[3], "doubled", 0.9),
        (KINDS[3], "late", 0.2),
    ],
    ids=lambda value: value.name if isinstance(value, Kind) else str(value),
)
def test_a_fault_in_a_transfer_of_100_kB(kind: Kind, name: str, part: float) -> None:
    """`part` counts frames: 1 is one for each segment, segmented transfers have 2."""
    fault = OneFault(int(100_000 / 7 * part), name)
    assert transfer(kind, 100_000, fault, THEN[4], blksize=127) in {"right", *SENSIBLE}
