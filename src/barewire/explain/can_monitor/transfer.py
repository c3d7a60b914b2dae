"""An SDO transfer that is going on, as somebody sees it who only listens; and how much of all of them is remembered."""

from __future__ import annotations

from binascii import crc_hqx
from typing import TYPE_CHECKING, Literal

from barewire.explain.can_monitor.events import SdoTransferReport, TransferDirection, TransferManner, TransferOutcome

if TYPE_CHECKING:
    from barewire.explain.can_monitor.block import BlockTracker

SdoSide = Literal["client", "server"]

VALUE_MAX = 1 << 20
"""So many bytes of one value are held; of a longer one they are counted only."""
HELD_MAX = 16 << 20
"""So many bytes of all values under way are held."""


class HeldBytes:
    """How many bytes are held by all transfers together; `refused` counts those that found no room."""

    def __init__(self, limit: int = HELD_MAX) -> None:
        self.limit = limit
        self.used = 0
        self.refused = 0

    def take(self, count: int) -> bool:
        """Room for so many more, or not."""
        if self.used + count > self.limit:
            self.refused += count
            return False
        self.used += count
        return True


def object_name(index: int | None, sub: int | None) -> str:
    """An object as people write it.

    >>> object_name(0x6041, 0), object_name(None, None)
    ('6041h:00', 'an object')
    """
    return "an object" if index is None else f"{index:04X}h:{sub or 0:02X}"


class OpenTransfer:
    """What is known so far. `began` is None where the beginning is not in the recording."""

    __slots__ = (
        *(
            "again",
            "answers",
            "asked",
            "began",
            "blksize",
            "block",
            "count",
            "crc",
            "crc_asked",
            "crc_told",
            "data",
            "direction",
            "doubt",
        ),
        *("gapped", "heard", "held", "index", "last", "lost", "manner", "memory", "missing", "previous", "size", "sub"),
        *("switch", "toggle", "turn", "whole"),
    )

    def __init__(
        self,
        direction: TransferDirection,
        manner: TransferManner,
        place: tuple[int, int] | None,
        began: float | None,
        memory: HeldBytes,
    ) -> None:
        self.direction = direction
        self.manner: TransferManner = manner
        self.index = None if place is None else place[0]
        self.sub = None if place is None else place[1]
        self.began = began
        self.memory = memory
        self.heard = 0.0
        self.asked = b""  # the request, while no answer to it was heard
        self.answers: tuple[type, ...] = ()
        self.turn: SdoSide = "server"
        self.toggle = 0  # of the segment that is under way, or comes next
        self.last = False  # the last segment was sent
        self.previous = b""
        self.switch: int | None = None
        self.blksize: int | None = None  # that the client wants
        self.block: BlockTracker | None = None
        self.size: int | None = None
        self.data = bytearray()
        self.count = 0
        self.crc = 0
        self.crc_asked: bool | None = None  # whether the client can calculate one; None: not heard
        self.crc_told: Literal["ok", "wrong", "unused", "unknown", ""] = ""
        self.whole = began is not None
        self.held = True
        self.gapped = False
        self.doubt: Literal["", "toggle", "unasked"] = ""
        self.again = self.lost = self.missing = 0

    def __str__(self) -> str:
        return object_name(self.index, self.sub)

    def take(self, data: bytes) -> None:
        """The next bytes of the value."""
        self.count += len(data)
        self.crc = crc_hqx(data, self.crc)
        if self.held and (self.count > VALUE_MAX or not self.memory.take(len(data))):
            self.forget()
        if self.held:
            self.data += data

    def forget(self) -> None:
        """Hold the value no longer."""
        self.memory.used -= len(self.data)
        self.data.clear()
        self.held = False

    def lacks(self, frames: int, *, data: bool = True) -> None:
        """So many frames are not in the recording; with `data`, bytes of the value were in them."""
        self.missing += frames
        if data:
            self.whole = False

    def closed(
        self,
        at: float,
        node: int,
        channel: int,
        outcome: TransferOutcome,
        *,
        abort: int | None = None,
        by: SdoSide | None = None,
    ) -> SdoTransferReport:
        """The transfer as an event. What it held is free again."""
        proved = self.crc_told == "ok" or (self.size is not None and self.size == self.count)
        known = self.held and self.whole and (proved or not self.gapped)
        event = SdoTransferReport(
            *(at, node, channel, self.direction, self.manner, self.index, self.sub, outcome, self.began),
            data=bytes(self.data) if known and (self.count or outcome == "done") else None,
            count=self.count,
            size=self.size,
            abort=abort,
            by=by or "",
            crc=self.crc_told,
            blocks=0 if self.block is None else self.block.blocks,
            again=self.again,
            lost=self.lost,
            missing=self.missing,
        )
        self.forget()
        return event
