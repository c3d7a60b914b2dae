"""SDO overheard: the frames of one channel, put together to transfers.   [CiA 301, SDO]

        605h  client -> server     585h  server -> client          one transfer at a time

A frame means what the one before it makes it mean, so this is a machine with the state of both sides. What does not
fit is one of three things, and which one is often told by what the other side says next:

    the recording lacks a frame     both go on as if it had been there: they heard it            Gap
    the bus lost a frame            one of them says the same again                              Loss
    somebody broke a rule           the other one aborts, or nothing else can explain it         Violation
"""

from __future__ import annotations

from collections.abc import Iterable

from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.aborts import AbortCode, abort_text
from barewire.canopen.sdo.messages.block import (
    BLOCK_MAX,
    BlockDownloadInitiated,
    BlockUploadInitiated,
    InitiateBlockDownload,
    InitiateBlockUpload,
)
from barewire.canopen.sdo.messages.codec import decode_one_of, has_reserved_bits
from barewire.canopen.sdo.messages.initiate import (
    Abort,
    DownloadInitiated,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateDownload,
    UploadInitiated,
)
from barewire.canopen.sdo.messages.segment import NextSegment, SdoSegment, SegmentTaken
from barewire.errors import DecodeError
from barewire.explain.can_monitor.block import BlockTracker
from barewire.explain.can_monitor.events import Gap, Loss, MonitorEvent, TransferDirection, TransferOutcome, Violation
from barewire.explain.can_monitor.message_directions import (
    BEGINS,
    CLIENT_SAYS,
    SERVER_SAYS,
    InitiateAnswer,
    InitiateRequest,
)
from barewire.explain.can_monitor.segments import hear_segment
from barewire.explain.can_monitor.transfer import HeldBytes, OpenTransfer, SdoSide, object_name
from barewire.explain.can_monitor.unheard import (
    answer_to_nobody,
    begin_unheard,
    block_unheard,
    first_segment_of_block,
    is_block_under_way,
)

PATIENCE = 3.0
"""After so many seconds without a word a transfer is given up."""


class SdoTracker:
    """One channel of one node. A machine: its frames in, events out."""

    def __init__(
        self, node: int, channel: int, memory: HeldBytes, patience: float = PATIENCE, dialect: Iterable[int] = ()
    ) -> None:
        self.node, self.channel = node, channel
        self.open: OpenTransfer | None = None
        self.memory, self._patience = memory, patience
        self.heard = False
        self.given_up: OpenTransfer | None = None
        self._reserved = set(dialect)  # command bytes with reserved bits that were told already, or are agreed upon
        self.held_back: list[MonitorEvent] = []
        self.last = (False, b"")
        self.run = 0  # so often in a row the same side has said a frame with the next higher number
        self.now, self._frame = 0.0, ""
        self.out: list[MonitorEvent] = []

    @property
    def deadline(self) -> float | None:
        """When the transfer under way is given up."""
        return None if self.open is None else self.open.heard + self._patience

    def feed(self, asks: bool, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """A frame of the client (`asks`) or of the server."""
        self.now, self._frame = now, str(frame)
        data = frame.data
        if len(data) != 8:
            self.broken("SDO-LENGTH", f"{len(data)} bytes")
        if data:
            self._hear("client" if asks else "server", data)
            if self.open is not None:
                self.open.heard = now
        before = self.last[1] if self.last[0] == asks else b""
        self.run = self.run + 1 if data and before and data[0] & 0x7F == before[0] + 1 else 0
        self.heard, self.last = True, (asks, data)
        return self._told()

    def pass_time(self, now: float) -> list[MonitorEvent]:
        """What was due by now: a transfer that nobody goes on with."""
        deadline = self.deadline
        if deadline is not None and now >= deadline:
            self.now = deadline
            self.release()
            self.close(self._silent_outcome())
        return self._told()

    def interrupt(self) -> None:
        """The recording has a hole here: what is under way may go on behind it, and may have ended in it."""
        if self.open is not None:
            self.open.gapped = True
        self.given_up, self.heard = None, False

    def end(self, now: float) -> list[MonitorEvent]:
        """The recording is over."""
        self.now = now
        self.close("cut")
        self.release()
        return self._told()

    def takes_segment(self, asks: bool, data: bytes) -> bool:
        """Whether this frame, coming now, would be a segment of a block."""
        block = None if self.open is None else self.open.block
        if block is None or block.state != "segments" or not data or data[0] == 0x80:
            return False
        return block.sender == ("client" if asks else "server")

    # What it is

    def _hear(self, speaker: SdoSide, data: bytes) -> None:
        if is_block_under_way(self, speaker, data):
            begun = begin_unheard(self, "upload" if speaker == "server" else "download", "block")
            begun.block = BlockTracker(begun, self.node, speaker, None, crc=None)
        self.release()
        first_segment_of_block(self, speaker, data)
        block = None if self.open is None else self.open.block
        if block is not None and block.feed(speaker, data, self.now):
            self.take_told(block)
            if block.state == "over":
                self.done()
            return
        if block is not None:
            self.take_told(block)
        try:
            message = decode_one_of(data, CLIENT_SAYS if speaker == "client" else SERVER_SAYS)
        except DecodeError as error:
            if error.reason == "function":
                self.broken("SDO-COMMAND", f"{data[0]:02X}h is no command of the {speaker}")
            return
        if has_reserved_bits(message.pattern, data[0]) and data[0] not in self._reserved:
            self._reserved.add(data[0])
            standard = message.pattern.encode(**message.pattern.decode(data[0]))
            text = f"{data[0]:02X}h for what the standard says with {standard:02X}h"
            # The next frame may show that this was a segment of a block that began in a hole of the recording.
            self.held_back.append(Violation(self.now, "SDO-RESERVED", self.node, text, self._frame))
        if isinstance(message, Abort):
            self._aborted(speaker, message)
        elif isinstance(message, InitiateAnswer):
            self._answered(message)
        elif isinstance(message, InitiateRequest):
            self._begin(message, data)
        elif isinstance(message, NextSegment | SdoSegment | SegmentTaken):
            hear_segment(self, speaker, message, self.now)
        else:
            block_unheard(self, speaker, message, data)

    def release(self) -> None:
        """What was held back was what it seemed."""
        self.out += self.held_back
        self.held_back = []

    def _told(self) -> list[MonitorEvent]:
        out, self.out = self.out, []
        return out

    def take_told(self, block: BlockTracker) -> None:
        """What the segments of a block have shown."""
        for told in block.told:
            if isinstance(told, Gap | Loss):
                self.out.append(told)
            else:
                self.broken(*told)
        block.told = []

    # Beginnings

    @property
    def _current(self) -> OpenTransfer:
        assert self.open is not None
        return self.open

    def _begin(self, request: InitiateRequest, data: bytes) -> None:
        if self.open is not None:
            self.close(self._silent_outcome() if self.open.asked else "cut")
        direction, manner, answers = BEGINS[type(request)]
        self.open = new = OpenTransfer(direction, manner, (request.index, request.sub), self.now, self.memory)
        new.asked, new.answers = data, answers
        if isinstance(request, ExpeditedDownload):
            new.take(request.data)
        elif isinstance(request, InitiateDownload | InitiateBlockDownload):
            new.size = request.size
            new.crc_asked = request.crc if isinstance(request, InitiateBlockDownload) else None
        elif isinstance(request, InitiateBlockUpload):
            new.switch, new.crc_asked, new.blksize = request.switch, request.crc, request.blksize or BLOCK_MAX
            if not 1 <= request.blksize <= BLOCK_MAX:
                self.broken("SDO-BLOCK-SIZE", f"blocks of {request.blksize} segments are wanted")

    def _answered(self, answer: InitiateAnswer) -> None:
        transfer = self.open
        place = answer.index, answer.sub
        if transfer is None or not transfer.asked:
            answer_to_nobody(self, answer)
            return
        if place != (transfer.index, transfer.sub):
            given = self.given_up
            if given is not None and (given.index, given.sub) == place and isinstance(answer, given.answers):
                text = f"the answer about {object_name(*place)} comes after the request for {transfer}"
                self.broken("SDO-OVERLAP", text)
                self.given_up = None
            else:
                self.broken("SDO-MUX", f"asked for {transfer}, the answer is about {object_name(*place)}")
            return
        if not isinstance(answer, transfer.answers):
            self.broken("SDO-WRONG-SCS", f"{transfer.direction} ({transfer.manner}) of {transfer} asked for")
            return
        transfer.asked, transfer.turn = b"", "client"
        self.go_on(transfer, answer)

    def go_on(self, transfer: OpenTransfer, answer: InitiateAnswer) -> None:
        """The answer that the request wants: the value, or how it will come."""
        if isinstance(answer, ExpeditedUpload | UploadInitiated) and transfer.manner == "block":
            size = len(answer.data) if isinstance(answer, ExpeditedUpload) else answer.size
            if transfer.switch is not None and (not transfer.switch or (size or 0) > transfer.switch):
                text = f"an ordinary answer of {size} bytes, and the protocol switch is {transfer.switch}"
                self.broken("SDO-BLOCK-SWITCH", text)
        match answer:
            case ExpeditedUpload():
                transfer.manner = "expedited"
                transfer.take(answer.data)
                self.done()
            case UploadInitiated():
                transfer.manner, transfer.size = "segmented", answer.size
            case DownloadInitiated():
                if transfer.manner == "expedited":
                    self.done()
            case BlockUploadInitiated():
                crc = transfer.crc_asked and answer.crc if answer.crc else False
                transfer.manner, transfer.size = "block", answer.size
                transfer.block = BlockTracker(transfer, self.node, "server", transfer.blksize, crc=crc)
                transfer.block.state = "ready"
            case BlockDownloadInitiated():
                if not 1 <= answer.blksize <= BLOCK_MAX:
                    self.broken("SDO-BLOCK-SIZE", f"blocks of {answer.blksize} segments are wanted")
                size = answer.blksize if 1 <= answer.blksize <= BLOCK_MAX else BLOCK_MAX
                crc = transfer.crc_asked and answer.crc if answer.crc else False
                transfer.manner = "block"
                transfer.block = BlockTracker(transfer, self.node, "client", size, crc=crc)

    # Ends

    def _aborted(self, speaker: SdoSide, abort: Abort) -> None:
        if abort.code not in tuple(AbortCode):
            self.broken("SDO-ABORT-CODE", abort_text(abort.code))
        transfer = self.open
        if transfer is None:
            place, given = (abort.index, abort.sub), self.given_up
            late = given is not None and (given.index, given.sub) == place
            direction: TransferDirection = given.direction if late and given is not None else "unknown"
            self.open = OpenTransfer(direction, "unknown", place, None, self.memory)
        else:
            doubt = transfer.doubt
            if doubt == "toggle" and abort.code == AbortCode.TOGGLE:
                self.broken("SDO-TOGGLE", "the client did not alternate the bit, and the server says so")
            if doubt == "unasked" and abort.code == AbortCode.COMMAND:
                self.broken("SDO-UNASKED", "a segment without a transfer, and the server says so")
        self.close("aborted", abort=abort.code, by=speaker)

    def done(self) -> None:
        """The transfer has come to its good end."""
        one = self._current
        if one.size is not None and one.size != one.count and one.whole and not one.gapped:
            self.broken("SDO-SIZE", f"{one.size} bytes announced, {one.count} came")
        self.close("done")

    def _silent_outcome(self) -> TransferOutcome:
        transfer = self._current
        if transfer.gapped or transfer.began is None:
            return "cut"
        return "unanswered" if transfer.turn == "server" else "left"

    def close(self, outcome: TransferOutcome, *, abort: int | None = None, by: SdoSide | None = None) -> None:
        transfer, self.open = self.open, None
        if transfer is None:
            return
        self.out.append(transfer.closed(self.now, self.node, self.channel, outcome, abort=abort, by=by))
        self.given_up = transfer if outcome in ("unanswered", "left") else None

    # What the segments tell, too

    def broken(self, rule: str, text: str) -> None:
        """A rule was broken by this frame."""
        self.out.append(Violation(self.now, rule, self.node, text, self._frame))

    def lack(self, transfer: OpenTransfer, frames: int, evidence: str, *, data: bool) -> None:
        """So many frames are not in the recording."""
        transfer.lacks(frames, data=data)
        self.out.append(Gap(self.now, None, frames, evidence, self.node))
