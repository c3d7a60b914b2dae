"""The loss matrix: every single frame of a transfer lost, doubled, late, swapped with the next, or corrupted.

A transfer must end with the right bytes or an error; never with wrong bytes, or without an end. The next transfers
begin at once, without a rest of the bus, and must be right: of the same object and of another one, in one frame, in
segments and in blocks. Exhaustive for values of these sizes, at most 63 bytes: all frames of all kinds of transfers,
all five faults, all six sequences that follow on a server with blocks of 3 segments, three with 127 segments; in
`make test` one of the sequences behind each fault.
`test_loss_sizes` has longer values.

fault        what happens to a frame
lost         it does not arrive
doubled      it arrives twice
late         it arrives half a time-out after the time-out, and holds up the frames behind it, as on a bus
overtaken    the same, but the frames behind it do not wait, as behind a gateway
swapped      it arrives after the next frame
"""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias

import pytest

from barewire.canopen import AbortCode, BlockSettings, CanFrame, Channel, SdoAbort, SdoServer, download, upload
from barewire.errors import NoAnswer
from tests.canopen.sdo.sdo_bus import FRAME_TIME, Bus, Fault, Store
from tests.helpers import every_case, part_or_whole, some_of

TIMEOUT = 1.0
BLKSIZE = 3
BLOCK = BlockSettings(size=BLKSIZE)
FAULTS = ("lost", "doubled", "late", "overtaken", "swapped")

Block: TypeAlias = BlockSettings | bool
Step: TypeAlias = tuple[Literal["upload", "download"], int, Block]


class Kind(NamedTuple):
    """A kind of transfer, and the lengths of the values to transfer."""

    name: str
    downloads: bool
    block: Block
    lengths: tuple[int, ...]
    known: bool = True


THEN: tuple[tuple[Step, ...], ...] = (
    (("upload", 0x2100, False), ("download", 0x2100, False), ("upload", 0x2100, BLOCK)),
    (("download", 0x2100, False), ("download", 0x2100, False), ("upload", 0x2100, False)),
    (("download", 0x2100, BLOCK), ("upload", 0x2101, False)),
    (("upload", 0x2101, False), ("upload", 0x2100, False)),
    (("download", 0x2101, False), ("download", 0x2100, BLOCK)),
    (("upload", 0x2100, BLOCK), ("download", 0x2101, False)),
)
"""What may follow a transfer: of its object and of another one, in one frame, in segments and in blocks."""


def value_of(length: int) -> bytes:
    """Return the value that is transferred."""
    return bytes((7 * place + 1 + place // 251) % 251 for place in range(length))


class OneFault:
    """The fault `name` at frame `hit` of a transfer. `end` is called when the transfer is over."""

    def __init__(self, hit: int, name: str) -> None:
        self.hit, self.name = hit, name
        self.held_until = 0.0

    def end(self) -> None:
        """Let the frames of the next transfers arrive, behind those that are held up."""
        self.hit = -1

    def on(self, bus: Bus) -> Fault:
        """Return the fault of a bus."""
        delays = {"lost": [], "doubled": [0.0, 0.0], "overtaken": [1.5 * TIMEOUT], "swapped": [1.5 * FRAME_TIME]}

        def fault(number: int, frame: CanFrame) -> list[tuple[float, CanFrame]]:
            if number == self.hit and self.name == "late":
                self.held_until = bus.free_at + 1.5 * TIMEOUT
            elif number == self.hit:
                return [(delay, frame) for delay in delays[self.name]]
            return [(max(0.0, self.held_until - bus.free_at), frame)]

        return fault


class Corrupted(OneFault):
    """The byte at `position` of frame `hit` is another one."""

    def __init__(self, hit: int, position: int, change: int) -> None:
        super().__init__(hit, "corrupted")
        self.position, self.change = position, change

    def on(self, bus: Bus) -> Fault:
        """Return the fault of a bus."""

        def fault(number: int, frame: CanFrame) -> list[tuple[float, CanFrame]]:
            data = bytearray(frame.data)
            data[self.position] ^= self.change
            return [(0.0, frame._replace(data=bytes(data)) if number == self.hit else frame)]

        return fault


def transfer(
    kind: Kind,
    length: int,
    fault: OneFault | None = None,
    then: tuple[Step, ...] = THEN[0],
    *,
    trusted: bool = False,
    blksize: int = BLKSIZE,
    frames: list[str] | None = None,
) -> str | int:
    """Return the result of a transfer with this fault: "right" or its abort code. The ones after it must be right.

    `trusted`: its value is not checked. `frames` gets the data of its frames.
    """
    value = value_of(length)
    store = Store()
    store.objects[0x2100, 0] = b"" if kind.downloads else value
    server = SdoServer(5, store, blksize=blksize)
    bus = Bus(server)
    bus.fault = None if fault is None else fault.on(bus)
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
    assert trusted or store.objects[0x2100, 0] in (b"", value)
    if frames is not None:
        frames += [line[2:] for line in bus.log]
    if fault is not None:
        fault.end()
        if outcome == "right" and bus.now < fault.held_until:
            bus.rest(fault.held_until - bus.now)  # the last frame is late: the next transfer begins behind it
    for number, step in enumerate(then):
        _check_next(bus, channel, store, step, 11 if number % 2 else 2)
    bus.fault = None
    bus.rest(5.0)
    assert server.deadline is None
    _check_next(bus, channel, store, ("upload", 0x2100, False), 0)
    return outcome


def _check_next(bus: Bus, channel: Channel, store: Store, step: Step, size: int) -> None:
    """Make a transfer without a fault, which must be right."""
    verb, index, block = step
    if verb == "download":
        data = bytes(range(100, 100 + size))
        bus.run(download(channel, index, 0, data, block=block, timeout=TIMEOUT))
        assert store.objects[index, 0] == data
    else:
        assert bus.run(upload(channel, index, block=block, timeout=TIMEOUT)) == store.objects[index, 0]


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
BLOCKS_OF_127 = [
    pytest.param(kind, length, 127, id=f"{kind.name}, {length} bytes, 127") for kind, length in BLOCK_CASES
]


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
@pytest.mark.parametrize("share", part_or_whole(len(THEN), 1))
@pytest.mark.parametrize(
    ("kind", "length", "blksize"),
    [*(pytest.param(*case.values, BLKSIZE, id=case.id) for case in CASES), *BLOCKS_OF_127],
)
def test_any_frame_lost_doubled_late_or_swapped(kind: Kind, length: int, blksize: int, share: int) -> None:
    for hit in range(len(frames_of(kind, length, blksize))):
        for place, name in enumerate(FAULTS):
            every = share if blksize == BLKSIZE else max(2, share)
            for number, then in enumerate(THEN[(hit + place) % every :: every]):
                outcome = transfer(kind, length, OneFault(hit, name), then, blksize=blksize)
                assert outcome == "right" or outcome in SENSIBLE, (hit, name, number)


@every_case(("kind", "length"), BLOCK_CASES)
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


@pytest.mark.parametrize("change", some_of([0x80, 0x01, 0xFF], 1))
@every_case(("kind", "length"), CASES)
def test_any_byte_of_any_frame_corrupted(kind: Kind, length: int, change: int) -> None:
    """A CRC prevents wrong bytes. Requests, responses and transfers without blocks have none, so their bytes may be
    wrong (46h is a valid response in place of C6h), but every transfer ends, and the next one works."""
    for hit in range(len(frames_of(kind, length))):
        for position in range(8):
            fault = Corrupted(hit, position, change)
            transfer(kind, length, fault, trusted=not kind.block or hit < 2)
