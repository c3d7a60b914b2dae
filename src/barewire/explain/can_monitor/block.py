"""A block transfer overheard: which segments came, which were acknowledged, and what follows from the difference.

        heard in the recording     acknowledged        so
        1 2 3 4                    4                   all is well
        1 2   4                    4                   3 was on the bus, and is not in the recording
        1 2 3 4                    2                   3 was lost on its way to the receiver: 3 and 4 come again
        1 2   4                    2                   3 was lost on the bus, for everybody

The receiver alone knows what arrived, so nothing is judged before its acknowledgement. [CiA 301, SDO block]
"""

from __future__ import annotations

from typing import Literal

from barewire.canopen.sdo.messages.block import (
    BLOCK_MAX,
    LAST,
    BlockAck,
    BlockEnd,
    BlockEnded,
    InitiateBlockDownload,
    InitiateBlockUpload,
    StartBlockUpload,
)
from barewire.canopen.sdo.messages.initiate import ExpeditedDownload, InitiateDownload, InitiateUpload
from barewire.canopen.sdo.messages.segment import SEGMENT
from barewire.explain.can_monitor.events import Gap, Loss
from barewire.explain.can_monitor.transfer import OpenTransfer, SdoSide

PAUSE = 0.3
"""After so many seconds of silence, what looks like a new request is one, though a segment could look the same."""

_REQUESTS = (InitiateUpload, ExpeditedDownload, InitiateDownload, InitiateBlockDownload, InitiateBlockUpload)

Told = Gap | Loss | tuple[str, str]
"""An event, or a rule that was broken and how."""


class BlockTracker:
    """The segments of one transfer. A machine: `feed` says whether a frame was its own; `told` is what it noticed."""

    def __init__(
        self, transfer: OpenTransfer, node: int, sender: SdoSide, blksize: int | None, *, crc: bool | None
    ) -> None:
        self.transfer = transfer
        self.node = node
        self.sender = sender
        self.blksize = blksize or BLOCK_MAX
        self._knows_size = blksize is not None
        self._short = 0  # a block was acknowledged here, before its end: it was the last one, or its rest was lost
        self.crc = crc  # whether both sides calculate one; None: nobody heard
        self.state: Literal["ready", "segments", "end", "ended", "over"] = "segments"
        self.blocks = 0
        self.told: list[Told] = []
        self._parts: dict[int, bytes] = {}
        self._final = 0
        self._tail = 0  # of a block that was acknowledged early: the number that was sent last
        self._pending = b""  # what was acknowledged last: how much of it counts is told at the end
        self._acknowledged = -1
        self._repeats = 0  # acknowledgements that could be repetitions, or be for blocks that nobody recorded

    @property
    def expects(self) -> int:
        """The number of the segment that would come next."""
        return max(self._parts, default=0) + 1

    def feed(self, speaker: SdoSide, data: bytes, now: float) -> bool:
        """Whether the frame belongs to this transfer; when all is over, `state` says so."""
        if data[0] == LAST:
            return False  # 80h is an abort: there is no segment 0
        return self._sent(data, now) if speaker == self.sender else self._answered(data, now)

    def _sent(self, data: bytes, now: float) -> bool:
        if self.state == "ready":
            self._lacks(1, "segments come, and the start of the block upload is not in the recording", now, data=False)
            self.state = "segments"
        ends = BlockEnd.pattern.matches(data[0]) and not any(data[3:])
        if self.state == "segments":
            if self._short and not self._parts and ends and data[0] & ~LAST > 1:
                self.state = "end"  # so it was the last block, and the segment that said so was not heard
            elif self._final and ends:
                self._lacks(1, "the end is said, and the last acknowledgement is not in the recording", now, data=False)
                self._commit(self._final)
                self.state = "end"
            elif self._is_new_request(data, now):
                return False
            else:
                self._segment(data, now)
                return True
        if self.state == "end":
            if self._parts.get(data[0] & ~LAST) == data[1:]:
                self.transfer.again += 1
                return True
            if BlockEnd.pattern.matches(data[0]):
                self._end(BlockEnd.decode(data.ljust(3, b"\0")), now)
                return True
        return False

    def _is_new_request(self, data: bytes, now: float) -> bool:
        """In a download the client sends the segments, and may have begun something else that looks alike."""
        late = self.transfer.gapped or now - self.transfer.heard > PAUSE
        if self.sender == "server" or not late or data[0] & ~LAST == self.expects:
            return False
        return any(kind.pattern.matches(data[0]) for kind in _REQUESTS)

    def _segment(self, data: bytes, now: float) -> None:
        number, body = data[0] & ~LAST, data[1:].ljust(SEGMENT, b"\0")
        if not 1 <= number <= self.blksize:
            self.told.append(("SDO-BLOCK-SEQNO", f"segment {number} came: the block has 1 to {self.blksize}"))
            return
        if self._tail and number == self._tail + 1 and number > 1:
            self._tail = number  # sent before the sender heard the early acknowledgement
            return
        self._tail = 0
        if self._short:
            self.transfer.lost += 1
            text = f"acknowledged at {self._short}, before the end of the block: nobody heard the rest of it"
            self.told.append(Loss(now, self.node, 1, text))
            self._short = 0
        held = self._parts.get(number)
        if held == body:
            self.transfer.again += 1
            return
        if held is not None:
            if number == 1:
                self._lacks(1, "a new block begins, and no acknowledgement is in the recording", now, data=False)
            else:  # how much of the block before was acknowledged is as unknown as how this one began
                text = f"segment {number} again, with other bytes: the beginning of its block is not in the recording"
                self._lacks(number, text, now)
            self._commit(max(self._parts))
            self._parts, self._final = {}, 0
        self._parts[number] = body
        if data[0] & LAST:
            self._final = number

    def _answered(self, data: bytes, now: float) -> bool:
        if StartBlockUpload.pattern.matches(data[0]) and self.sender == "server":
            if self.state == "ready":
                self.state = "segments"
            return True
        if BlockAck.pattern.matches(data[0]) and len(data) >= 3:
            if self.state in ("segments", "ready"):
                self.state = "segments"
                self._ack(data[1], data[2], now)
            return True
        if BlockEnded.pattern.matches(data[0]):
            if self.state != "ended":
                text = "the receiver has everything, and what was said before that is not in the recording"
                self._lacks(1, text, now, data=self.state != "end")
                self._finish(self._trimmed(), told="unknown")
            self.state = "over"
            return True
        return False

    def _ack(self, number: int, blksize: int, now: float) -> None:
        transfer, sent, limit = self.transfer, max(self._parts, default=0), self._final or self.blksize
        if not 1 <= blksize <= BLOCK_MAX:
            self.told.append(("SDO-BLOCK-SIZE", f"a next block of {blksize} segments is wanted"))
            blksize = self.blksize
        if number > limit:
            text = f"segment {number} is acknowledged, and the block has {limit}"
            self.told.append(("SDO-BLOCK-ACK", text))
            return
        if not self._parts and (number == self._acknowledged or not number):
            self._repeats += 1
            transfer.lost += 1
            self.told.append(Loss(now, self.node, 1, "the acknowledgement is said again: nothing came after it"))
            return
        gone = [place for place in range(1, number + 1) if place not in self._parts]
        if gone:
            which = f"segment{'s' if len(gone) > 1 else ''} {', '.join(map(str, gone[:8]))}"
            self._lacks(len(gone), f"{which} of {number} acknowledged ones: not in the recording", now)
        if number < max(sent, self._final):
            again = sent - number
            transfer.lost += 1
            transfer.again += again
            heard = "is in the recording" if number + 1 in self._parts else "nobody heard"
            text = f"acknowledged up to {number} of {sent}: segment {number + 1}, which {heard}, did not arrive"
            self.told.append(Loss(now, self.node, 1, text))
            self._tail = sent
        elif not self._final and number < self.blksize and self._knows_size:
            self._short = number
        self._commit(number)
        self._acknowledged = number
        self.blksize, self._knows_size = blksize, True
        if self._final and number == self._final:
            self.state = "end"
        else:
            self._parts, self._final = {}, 0

    def _lacks(self, frames: int, evidence: str, now: float, *, data: bool = True) -> None:
        self.transfer.lacks(frames, data=data)
        self.told.append(Gap(now, None, frames, evidence, self.node))

    def _commit(self, number: int) -> None:
        """The segments up to this one are the receiver's. The block before them counts as a whole."""
        self.blocks += 1
        chunk = b"".join(self._parts[place] for place in range(1, number + 1) if place in self._parts)
        if chunk:
            self.transfer.take(self._pending)
            self._pending = chunk

    def _trimmed(self) -> bytes:
        """What counts of the last block if only the size tells it."""
        size = self.transfer.size
        return self._pending if size is None else self._pending[: max(0, size - self.transfer.count)]

    def _end(self, end: BlockEnd, now: float) -> None:
        self._finish(self._pending[: len(self._pending) - end.unused])
        transfer = self.transfer
        if not self.crc:
            agrees = self.crc is None and transfer.whole and end.crc and end.crc == transfer.crc
            transfer.crc_told = "unused" if self.crc is False else "ok" if agrees else "unknown"
        elif transfer.whole and not self._doubtful():
            transfer.crc_told = "ok" if end.crc == transfer.crc else "wrong"
            if end.crc != transfer.crc and transfer.size is not None and transfer.count < transfer.size:
                # Whole blocks may lack, and nothing in what is left shows it: length and CRC do, both of them.
                missing = -(-(transfer.size - transfer.count) // SEGMENT)
                text = f"{transfer.count} of {transfer.size} bytes, and the CRC is that of others"
                self._lacks(missing, f"{text}: not all segments are in the recording", now)
                transfer.crc_told = "unknown"
            elif end.crc != transfer.crc and not transfer.gapped:
                self.told.append(
                    ("SDO-BLOCK-CRC", f"the CRC is {end.crc:04X}h, of the bytes it is {transfer.crc:04X}h")
                )
        else:
            transfer.crc_told = "unknown"
        self.state = "ended"

    def _doubtful(self) -> bool:
        """Whether an acknowledgement that seemed to be a repetition was for a block that nobody recorded."""
        transfer = self.transfer
        if self._repeats and transfer.size is not None and transfer.count < transfer.size:
            transfer.whole = False
        return not transfer.whole

    def _finish(self, rest: bytes, *, told: Literal["", "unknown"] = "") -> None:
        self.transfer.take(rest)
        self.transfer.crc_told = told
        self._pending = b""
