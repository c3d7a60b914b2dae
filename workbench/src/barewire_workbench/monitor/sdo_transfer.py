"""One SDO transfer in the monitor: its state, the messages that begin it, and its blocks.   [CiA 301, SDO]

        request                 transfer                possible answers
        initiate upload         upload, expedited       the value, or the announcement of segments
        initiate download       download, expedited     confirmation (expedited: the value is in the request)
        initiate block ...      upload or download      confirmation; a block upload may be answered as an ordinary one

The bytes that all transfers hold together are bounded (`HeldBytes`).

Only the acknowledgement of a block shows which segments arrived, so a block is judged there:

        in the recording           acknowledged        conclusion
        1 2 3 4                    4                   nothing is missing
        1 2   4                    4                   3 was on the bus, and is not in the recording
        1 2 3 4                    2                   3 was lost on its way to the receiver: 3 and 4 are sent again
        1 2   4                    2                   3 was lost on the bus
"""

from __future__ import annotations

from binascii import crc_hqx
from typing import Literal

from barewire.canopen.sdo.messages import (
    BLOCK_MAX,
    BLOCK_UPLOAD_RESPONSES,
    LAST,
    SEGMENT,
    UPLOAD_RESPONSES,
    Abort,
    BlockAck,
    BlockDownloadInitiated,
    BlockEnd,
    BlockEnded,
    BlockUploadInitiated,
    DownloadInitiated,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateBlockDownload,
    InitiateBlockUpload,
    InitiateDownload,
    InitiateUpload,
    NextSegment,
    SdoMessage,
    SdoSegment,
    SegmentTaken,
    StartBlockUpload,
    UploadInitiated,
)
from barewire_workbench.monitor.events import (
    Gap,
    Loss,
    SdoTransferReport,
    TransferDirection,
    TransferManner,
    TransferOutcome,
    object_name,
)

SdoSide = Literal["client", "server"]

InitiateRequest = InitiateUpload | ExpeditedDownload | InitiateDownload | InitiateBlockUpload | InitiateBlockDownload
InitiateAnswer = ExpeditedUpload | UploadInitiated | DownloadInitiated | BlockUploadInitiated | BlockDownloadInitiated

TRANSFER_OF: dict[type, tuple[TransferDirection, TransferManner, tuple[type, ...]]] = {
    InitiateUpload: ("upload", "expedited", UPLOAD_RESPONSES),
    ExpeditedDownload: ("download", "expedited", (DownloadInitiated,)),
    InitiateDownload: ("download", "segmented", (DownloadInitiated,)),
    InitiateBlockUpload: ("upload", "block", BLOCK_UPLOAD_RESPONSES),
    InitiateBlockDownload: ("download", "block", (BlockDownloadInitiated,)),
}
"""Request -> direction and kind of the transfer that it begins, and its possible answers."""
CLIENT_MESSAGES: tuple[type[SdoMessage], ...] = (
    *(InitiateUpload, ExpeditedDownload, InitiateDownload, NextSegment, SdoSegment, Abort),
    *(InitiateBlockUpload, InitiateBlockDownload, StartBlockUpload, BlockAck, BlockEnd, BlockEnded),
)
SERVER_MESSAGES: tuple[type[SdoMessage], ...] = (
    *(ExpeditedUpload, UploadInitiated, DownloadInitiated, SdoSegment, SegmentTaken, Abort),
    *(BlockUploadInitiated, BlockDownloadInitiated, BlockAck, BlockEnd, BlockEnded),
)

VALUE_MAX = 1 << 20
"""The longest value that is held, in bytes; of a longer one the bytes are only counted."""
HELD_MAX = 16 << 20
"""The most bytes that all transfers under way hold together."""


class HeldBytes:
    """The number of bytes held by all transfers together; `refused` counts bytes above the limit."""

    def __init__(self, limit: int = HELD_MAX) -> None:
        self.limit = limit
        self.used = 0
        self.refused = 0

    def take(self, count: int) -> bool:
        """Reserve `count` more bytes; return False if they exceed the limit."""
        if self.used + count > self.limit:
            self.refused += count
            return False
        self.used += count
        return True


class OpenTransfer:
    """The state of one transfer. `began` is None if its beginning is not in the recording."""

    def __init__(
        self,
        direction: TransferDirection,
        manner: TransferManner,
        place: tuple[int, int] | None,
        began: float | None,
        held: HeldBytes,
    ) -> None:
        self.direction = direction
        self.manner: TransferManner = manner
        self.place = place  # index and sub-index
        self.began = began
        self.last_frame_at = 0.0
        self.request = b""  # until its answer arrives
        self.answers: tuple[type, ...] = ()  # that the request can have
        self.next_sender: SdoSide = "server"
        self.toggle = 0  # of the segment that is under way, or comes next
        self.last_sent = False  # whether the last segment of a download was sent
        self.previous = b""  # the data of the segment before
        self.switch: int | None = None  # the protocol switch threshold of a block upload
        self.blksize: int | None = None  # that the client requested
        self.size: int | None = None  # as announced
        self.count = 0
        self.data = bytearray()
        self.crc = 0
        self.client_crc: bool | None = None  # whether the client supports a CRC; None if its request was not recorded
        self.crc_result: Literal["ok", "wrong", "unused", "unknown", ""] = ""
        self.complete = began is not None  # no byte of the value is missing so far
        self.gapped = False  # the recording has a gap within this transfer
        self.doubt: Literal["", "toggle", "unasked"] = ""  # a fault that the next frame proves or disproves
        self.repeats = self.lost = self.missing = 0
        self._held = held
        self._holds = True

    def __str__(self) -> str:
        return object_name(*(self.place or (None, None)))

    def take(self, data: bytes) -> None:
        """Append the next bytes of the value."""
        self.count += len(data)
        self.crc = crc_hqx(data, self.crc)
        if self._holds and (self.count > VALUE_MAX or not self._held.take(len(data))):
            self.forget()
        if self._holds:
            self.data += data

    def forget(self) -> None:
        """Release the bytes that are held; later ones are only counted."""
        self._held.used -= len(self.data)
        self.data.clear()
        self._holds = False

    def note_missing(self, frames: int, *, data: bool = True) -> None:
        """Count frames that are not in the recording; with `data`, they carried bytes of the value."""
        self.missing += frames
        if data:
            self.complete = False

    def report(
        self,
        at: float,
        node: int,
        channel: int,
        outcome: TransferOutcome,
        *,
        blocks: int = 0,
        abort: int | None = None,
        by: SdoSide | None = None,
    ) -> SdoTransferReport:
        """End the transfer and return its report. The bytes that it held are released."""
        proved = self.crc_result == "ok" or (self.size is not None and self.size == self.count)
        known = self._holds and self.complete and (proved or not self.gapped)
        index, sub = self.place or (None, None)
        report = SdoTransferReport(
            *(at, node, channel, self.direction, self.manner, index, sub, outcome, self.began),
            data=bytes(self.data) if known and (self.count or outcome == "done") else None,
            count=self.count,
            size=self.size,
            abort=abort,
            by=by or "",
            crc=self.crc_result,
            blocks=blocks,
            again=self.repeats,
            lost=self.lost,
            missing=self.missing,
        )
        self.forget()
        return report


# Blocks -------------------------------------------------------------------------------------------------------------


_PAUSE = 0.3
"""Seconds of silence after which a frame counts as a request, although a segment of a block could look the same."""

_REQUESTS = (InitiateUpload, ExpeditedDownload, InitiateDownload, InitiateBlockDownload, InitiateBlockUpload)

BlockFinding = Gap | Loss | tuple[str, str]
"""A gap, a loss, or a broken rule with a text."""


class BlockTracker:
    """The segments of one transfer. `feed` returns whether a frame belongs to it; `findings` collects its findings.

    `blksize` and `crc` are None if the frame that announces them is not in the recording.
    """

    def __init__(
        self, transfer: OpenTransfer, node: int, data_sender: SdoSide, blksize: int | None, *, crc: bool | None
    ) -> None:
        self.transfer = transfer
        self.node = node
        self.data_sender = data_sender
        self.blksize = blksize or BLOCK_MAX
        self.crc = crc  # whether both sides use one
        self.state: Literal["ready", "segments", "end", "ended", "over"] = "segments"
        self.blocks = 0
        self.findings: list[BlockFinding] = []
        self._has_size = blksize is not None
        self._short = 0  # a block was acknowledged up to here, before its end: it is the last one, or its rest is lost
        self._parts: dict[int, bytes] = {}  # the segments of this block by number
        self._final = 0  # the number of the last segment, if it is in this block
        self._tail = 0  # the last number sent of a block that was acknowledged early
        self._pending = b""  # the block acknowledged last: the end of the transfer decides how many of its bytes count
        self._acknowledged = -1
        self._now = 0.0  # the time of the frame that is taken
        self._repeats = 0  # acknowledgements that are repetitions, or are for blocks that are not in the recording

    @property
    def expects(self) -> int:
        """The number of the next segment."""
        return max(self._parts, default=0) + 1

    def feed(self, sender: SdoSide, data: bytes, now: float) -> bool:
        """Take a frame; return False if it does not belong to this transfer. `state` is "over" after the last one."""
        self._now = now
        if data[0] == LAST:
            return False  # 80h is an abort: there is no segment 0
        return self._from_sender(data) if sender == self.data_sender else self._from_receiver(data)

    def _from_sender(self, data: bytes) -> bool:
        if self.state == "ready":
            self._lacks(1, "segments arrive, but the start of the block upload is not in the recording")
            self.state = "segments"
        # The last segment can look like the end of the transfer if its number is above 40h; the end has five zeros.
        ends = BlockEnd.pattern.matches(data[0]) and not any(data[3:])
        if self.state == "segments":
            if self._short and not self._parts and ends and data[0] & ~LAST > 1:
                self.state = "end"  # it was the last block, and its last segment is not in the recording
            elif self._final and ends:
                self._lacks(1, "the transfer ends, but the last acknowledgement is not in the recording")
                self._commit(self._final)
                self.state = "end"
            elif self._is_new_request(data):
                return False
            else:
                self._segment(data)
                return True
        if self.state == "end":
            if self._parts.get(data[0] & ~LAST) == data[1:]:
                self.transfer.repeats += 1
                return True
            if BlockEnd.pattern.matches(data[0]):
                self._end(BlockEnd.decode(data.ljust(3, b"\0")))
                return True
        return False

    def _is_new_request(self, data: bytes) -> bool:
        """Return whether a frame of a download begins another transfer: some requests look like segments."""
        late = self.transfer.gapped or self._now - self.transfer.last_frame_at > _PAUSE
        if self.data_sender == "server" or not late or data[0] & ~LAST == self.expects:
            return False
        return any(request.pattern.matches(data[0]) for request in _REQUESTS)

    def _segment(self, data: bytes) -> None:
        number, body = data[0] & ~LAST, data[1:].ljust(SEGMENT, b"\0")
        if not 1 <= number <= self.blksize:
            self.findings.append(("SDO-BLOCK-SEQNO", f"segment {number}: the block has 1 to {self.blksize}"))
            return
        if self._tail and number == self._tail + 1 and number > 1:
            self._tail = number  # sent before the early acknowledgement reached the sender
            return
        self._tail = 0
        if self._short:
            text = f"acknowledged up to {self._short}, before the end of the block: the rest of it was lost"
            self._note_loss(text)
            self._short = 0
        held = self._parts.get(number)
        if held == body:
            self.transfer.repeats += 1
            return
        if held is not None:
            if number == 1:
                self._lacks(1, "a new block begins, but no acknowledgement is in the recording")
            else:  # neither the end of the block before nor the beginning of this one is in the recording
                text = f"segment {number} again, with other bytes: the beginning of its block is not in the recording"
                self._lacks(number, text, data=True)
            self._commit(max(self._parts))
            self._parts, self._final = {}, 0
        self._parts[number] = body
        if data[0] & LAST:
            self._final = number

    def _from_receiver(self, data: bytes) -> bool:
        if StartBlockUpload.pattern.matches(data[0]) and self.data_sender == "server":
            if self.state == "ready":
                self.state = "segments"
            return True
        if BlockAck.pattern.matches(data[0]) and len(data) >= 3:
            if self.state in ("segments", "ready"):
                self.state = "segments"
                self._ack(data[1], data[2])
            return True
        if BlockEnded.pattern.matches(data[0]):
            if self.state != "ended":
                text = "the receiver confirms the end, but the frames before that are not in the recording"
                self._lacks(1, text, data=self.state != "end")
                self._finish(self._trimmed(), crc_result="unknown")
            self.state = "over"
            return True
        return False

    def _ack(self, number: int, blksize: int) -> None:
        transfer, sent, limit = self.transfer, max(self._parts, default=0), self._final or self.blksize
        if not 1 <= blksize <= BLOCK_MAX:
            self.findings.append(("SDO-BLOCK-SIZE", f"a next block of {blksize} segments is requested"))
            blksize = self.blksize
        if number > limit:
            self.findings.append(("SDO-BLOCK-ACK", f"segment {number} is acknowledged, but the block has {limit}"))
            return
        if not self._parts and (number == self._acknowledged or not number):
            self._repeats += 1
            self._note_loss("the acknowledgement is repeated: no segment came after it")
            return
        missing = [segment for segment in range(1, number + 1) if segment not in self._parts]
        if missing:
            which = f"segment{'s' if len(missing) > 1 else ''} {', '.join(map(str, missing[:8]))}"
            self._lacks(len(missing), f"{which} of {number} acknowledged ones: not in the recording", data=True)
        if number < max(sent, self._final):
            transfer.repeats += sent - number
            where = "is in the recording" if number + 1 in self._parts else "is not in the recording"
            text = f"acknowledged up to {number} of {sent}: segment {number + 1}, which {where}, did not arrive"
            self._note_loss(text)
            self._tail = sent
        elif not self._final and number < self.blksize and self._has_size:
            self._short = number
        self._commit(number)
        self._acknowledged = number
        self.blksize, self._has_size = blksize, True
        if self._final and number == self._final:
            self.state = "end"
        else:
            self._parts, self._final = {}, 0

    def _note_loss(self, evidence: str) -> None:
        self.transfer.lost += 1
        self.findings.append(Loss(self._now, self.node, 1, evidence))

    def _lacks(self, frames: int, evidence: str, *, data: bool = False) -> None:
        self.transfer.note_missing(frames, data=data)
        rule = "SDO-BLOCK-SEQNO" if data else "SDO-UNASKED"
        self.findings.append(Gap(self._now, None, frames, evidence, self.node, rule))

    def _commit(self, number: int) -> None:
        """Count all bytes up to this segment: the receiver has acknowledged it."""
        self.blocks += 1
        chunk = b"".join(self._parts[segment] for segment in range(1, number + 1) if segment in self._parts)
        if chunk:
            self.transfer.take(self._pending)
            self._pending = chunk

    def _trimmed(self) -> bytes:
        """Return the bytes of the last block that count, if only the announced size shows how many."""
        size = self.transfer.size
        return self._pending if size is None else self._pending[: max(0, size - self.transfer.count)]

    def _end(self, end: BlockEnd) -> None:
        self._finish(self._pending[: len(self._pending) - end.unused])
        transfer = self.transfer
        if not self.crc:
            agrees = self.crc is None and transfer.complete and end.crc and end.crc == transfer.crc
            transfer.crc_result = "unused" if self.crc is False else "ok" if agrees else "unknown"
        elif transfer.complete and not self._lacks_blocks():
            transfer.crc_result = "ok" if end.crc == transfer.crc else "wrong"
            if end.crc != transfer.crc and transfer.size is not None and transfer.count < transfer.size:
                # Whole blocks may be missing, which no sequence number shows; length and CRC together do.
                missing = -(-(transfer.size - transfer.count) // SEGMENT)
                text = f"{transfer.count} of {transfer.size} bytes, and the CRC does not match them"
                self._lacks(missing, f"{text}: not all segments are in the recording", data=True)
                transfer.crc_result = "unknown"
            elif end.crc != transfer.crc and not transfer.gapped:
                text = f"the CRC is {end.crc:04X}h, computed from the bytes it is {transfer.crc:04X}h"
                self.findings.append(("SDO-BLOCK-CRC", text))
        else:
            transfer.crc_result = "unknown"
        self.state = "ended"

    def _lacks_blocks(self) -> bool:
        """Return whether an acknowledgement that looked repeated was for a block that is not in the recording."""
        transfer = self.transfer
        if self._repeats and transfer.size is not None and transfer.count < transfer.size:
            transfer.complete = False
        return not transfer.complete

    def _finish(self, rest: bytes, *, crc_result: Literal["", "unknown"] = "") -> None:
        self.transfer.take(rest)
        self.transfer.crc_result = crc_result
        self._pending = b""
