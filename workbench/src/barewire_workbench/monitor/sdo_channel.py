"""The frames of the SDO channels of a bus, assembled into transfers.   [CiA 301, SDO]

        605h  client -> server     585h  server -> client          one transfer at a time on a channel

The meaning of a frame depends on the frames before it, so this is a machine with the state of both sides. A frame that
does not fit has one of three causes; often the next frame of the other side decides which:

    the recording lacks a frame     both sides go on, so both have it                            Gap
    the bus lost a frame            one side sends the same again                                Loss
    a side broke a rule             the other side aborts, or nothing else can explain it        Violation

A recording may begin in the middle of a transfer:

    answer without a request        late, if the transfer was given up; or the request is not in the recording
    consecutive numbers, one side   a block: no other transfer has two frames of one side in a row
    A2, C1, A1                      the end of a block transfer

The toggle bit of segments:

    client  60  70  60  70          server  00  10  00  11          the bit alternates, the answer repeats it

    next bit, no answer in between    the answer is missing in the recording, because the client needs it to go on
    same bit and same bytes again     a frame was lost on the bus, and the segment is repeated
    bit not alternated                if the other side goes on, two frames are missing in the recording;
                                      if it aborts with 0503 0000h, a rule was broken
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Literal, NamedTuple

from barewire.canopen.abort_codes import AbortCode, abort_text
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.messages import (
    BLOCK_MAX,
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
    decode_one_of,
    has_reserved_bits,
)
from barewire.errors import DecodeError
from barewire_workbench.monitor.events import (
    Gap,
    Loss,
    MonitorEvent,
    SdoTransferReport,
    TransferDirection,
    TransferManner,
    TransferOutcome,
    Violation,
    object_name,
)
from barewire_workbench.monitor.pdos import PdoTracker
from barewire_workbench.monitor.sdo_transfer import (
    CLIENT_MESSAGES,
    SERVER_MESSAGES,
    TRANSFER_OF,
    BlockTracker,
    HeldBytes,
    InitiateAnswer,
    InitiateRequest,
    OpenTransfer,
    SdoSide,
)

# Reserved bytes: those behind the data of a transfer are not reserved, they may have any value ----------------------


_FIRST: dict[type, int] = {
    InitiateUpload: 4,
    DownloadInitiated: 4,
    NextSegment: 1,
    SegmentTaken: 1,
    InitiateBlockUpload: 6,
    StartBlockUpload: 1,
    BlockDownloadInitiated: 5,
    BlockAck: 3,
    BlockEnd: 3,
    BlockEnded: 1,
}
"""Message -> its first reserved byte."""
_SIZED = (InitiateDownload, UploadInitiated, InitiateBlockDownload, BlockUploadInitiated)
"""Messages whose bytes 4 to 7 are the size, or reserved if none is announced."""


def reserved_byte(message: SdoMessage, data: bytes) -> int | None:
    """Return the position of the first reserved byte that is not 0; None if all are.

    >>> reserved_byte(InitiateUpload(0x1000, 0), bytes.fromhex("4000100000000100"))
    6
    """
    first = _FIRST.get(type(message), 8)
    if isinstance(message, _SIZED) and message.size is None:
        first = 4
    return next((place for place in range(first, len(data)) if data[place]), None)


# One channel --------------------------------------------------------------------------------------------------------


_PROMPT = 0.1
"""Seconds after a frame of a transfer in which its client cannot have given it up after a time-out."""

GIVE_UP = 3.0
"""Seconds without a frame after which a transfer is given up."""

_UNANSWERED = "a block transfer goes on, but the answer to its request is not in the recording"
_MESSAGES: dict[SdoSide, tuple[type[SdoMessage], ...]] = {"client": CLIENT_MESSAGES, "server": SERVER_MESSAGES}


class SdoTracker:
    """One channel of one node. A machine: its frames in, events out.

    `dialect` has command bytes with reserved bits set that the device is known to use.
    """

    def __init__(
        self, node: int, channel: int, held: HeldBytes, give_up: float = GIVE_UP, dialect: Iterable[int] = ()
    ) -> None:
        self.node, self.channel = node, channel  # the COB-ID of the requests
        self._held, self._give_up = held, give_up
        self._reserved = set(dialect)  # command bytes whose reserved bits are not reported, or not again
        self.open: OpenTransfer | None = None
        self.block: BlockTracker | None = None  # of the open transfer
        self.given_up: OpenTransfer | None = None  # the last one without an end: its answer may be late
        self.interrupted: tuple[OpenTransfer, BlockTracker | None] | None = None  # another request came in its middle
        self._last_transfer: tuple[tuple[int, int] | None, TransferOutcome] = None, "cut"  # that is over
        self._has_frames = False  # since the start, or since a gap in the recording
        self._last_frame = (False, b"")  # whether the client sent it, and its data
        self._run = 0  # consecutive frames of one side, each with the next higher number
        self.now, self.frame = 0.0, ""
        self._doubted = ""  # what arrived without a beginning
        self.events: list[MonitorEvent] = []
        self._held_back: list[MonitorEvent] = []

    @property
    def under_way(self) -> bool:
        """Whether a transfer is under way."""
        return self.open is not None

    @property
    def deadline(self) -> float | None:
        """When the transfer under way is given up."""
        transfer = self.open
        return None if transfer is None else transfer.last_frame_at + self._give_up

    def feed(self, from_client: bool, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """Take a frame of the client or of the server."""
        data = frame.data
        self.now, self.frame = now, str(frame)
        if len(data) != 8:
            self.violation("SDO-LENGTH", f"{len(data)} bytes")
        if data:
            self._take("client" if from_client else "server", data)
            if self.open is not None:
                self.open.last_frame_at = now
        before = self._last_frame[1] if self._last_frame[0] == from_client else b""
        self._run = self._run + 1 if data and before and data[0] & 0x7F == before[0] + 1 else 0
        self._has_frames, self._last_frame = True, (from_client, data)
        return self.take_events()

    def pass_time(self, now: float) -> list[MonitorEvent]:
        """Give up a transfer whose deadline has passed."""
        deadline, transfer = self.deadline, self.open
        if deadline is not None and transfer is not None and now >= deadline:
            self.now = deadline
            self.release()
            self.close(_outcome_of_silence(transfer))
        return self.take_events()

    def interrupt(self) -> None:
        """Note a gap in the recording: the transfer under way may go on after it, or may have ended in it."""
        if self.open is not None:
            self.open.gapped = True
        self.given_up, self.interrupted, self._has_frames = None, None, False

    def end(self, now: float) -> list[MonitorEvent]:
        """End the recording: report the transfer under way as cut."""
        self.now = now
        self.close("cut")
        self.release()
        return self.take_events()

    def takes_segment(self, from_client: bool, data: bytes) -> bool:
        """Return whether this frame, coming now, would be a segment of a block."""
        block = self.block
        if block is None or block.state != "segments" or not data or data[0] == 0x80:
            return False
        return block.data_sender == ("client" if from_client else "server")

    # Frames

    def _take(self, sender: SdoSide, data: bytes) -> None:
        if self._continues_unrecorded_block(sender, data):
            transfer = self.begin_unrecorded("upload" if sender == "server" else "download", "block")
            self.begin_blocks(transfer, sender)
        self.release()
        self._begin_unanswered_block(sender, data)
        if self.continues_interrupted_block(sender, data):
            self.go_on_interrupted()
        block = self.block
        if block is not None:
            belongs = block.feed(sender, data, self.now)
            self.collect_findings(block)
            if belongs:
                if sender != block.data_sender or block.state == "ended":
                    self._check_reserved(decode_one_of(data, _MESSAGES[sender]), data)
                    self.release()
                if block.state == "over":
                    self.done(block.transfer)
                return
        try:
            message = decode_one_of(data, _MESSAGES[sender])
        except DecodeError as error:
            if error.reason == "function":
                self.violation("SDO-COMMAND", f"{data[0]:02X}h is not a command of the {sender}")
            return
        self._check_reserved(message, data)
        if isinstance(message, Abort):
            self._aborted(sender, message)
        elif isinstance(message, InitiateAnswer):
            self._answered(message)
        elif isinstance(message, InitiateRequest):
            self._begin(message, data)
        elif isinstance(message, NextSegment | SdoSegment | SegmentTaken):
            _feed_segment(self, sender, message)
        else:
            self._unmatched_block_message(sender, message, data)

    def _check_reserved(self, message: SdoMessage, data: bytes) -> None:
        """Hold back a violation for reserved bits or bytes that are not 0: the next frame may show that this was a
        segment of a block that began in a gap of the recording."""
        texts = []
        if has_reserved_bits(message.pattern, data[0]) and data[0] not in self._reserved:
            self._reserved.add(data[0])
            standard = message.pattern.encode(**message.pattern.decode(data[0]))
            texts = [f"{data[0]:02X}h instead of {standard:02X}h"]
        place = reserved_byte(message, data)
        if place is not None:
            texts.append(f"byte {place} behind the command {data[0]:02X}h is reserved, and not 0")
        for text in texts:
            self._held_back.append(Violation(self.now, "SDO-RESERVED", self.node, text, self.frame))

    # The transfer under way

    def begin(self, transfer: OpenTransfer) -> OpenTransfer:
        """Make this the transfer under way."""
        self.open, self.block = transfer, None
        return transfer

    def begin_unrecorded(self, direction: TransferDirection, manner: TransferManner) -> OpenTransfer:
        """Begin a transfer whose beginning is not in the recording."""
        if self.open is not None and self.open.began is not None:
            self.close("cut")
        elif self.open is not None:
            self.open.forget()
        self._held_back = []
        transfer = self.begin(OpenTransfer(direction, manner, None, None, self._held))
        transfer.doubt = "unasked" if self._has_frames else ""
        self._doubted = "segments" if manner == "segmented" else "a message of a block transfer"
        return transfer

    def begin_blocks(
        self, transfer: OpenTransfer, data_sender: SdoSide, blksize: int | None = None, *, crc: bool | None = None
    ) -> BlockTracker:
        """Go on with the transfer in blocks. None stands for a value that is not in the recording."""
        self.block = BlockTracker(transfer, self.node, data_sender, blksize, crc=crc)
        return self.block

    def collect_findings(self, block: BlockTracker) -> None:
        """Move the findings of the block tracker to the events."""
        for finding in block.findings:
            if isinstance(finding, Gap | Loss):
                self.events.append(finding)
            else:
                self.violation(*finding)
        block.findings = []

    def violation(self, rule: str, text: str) -> None:
        """Report that this frame breaks a rule."""
        self.events.append(Violation(self.now, rule, self.node, text, self.frame))

    def report_missing(self, transfer: OpenTransfer, frames: int, evidence: str, rule: str, *, data: bool) -> None:
        """Report frames that are not in the recording; with `data`, they carried bytes of the value. `rule` is broken
        if the recording is complete."""
        transfer.note_missing(frames, data=data)
        self.gap(frames, evidence, rule)

    def settle_doubt(self, transfer: OpenTransfer) -> None:
        """Report a suspected violation as a gap: nothing proves it, so frames may be missing in the recording."""
        if transfer.doubt == "toggle":
            text = "the toggle bit is not the next one and both sides go on: a segment and its answer are missing"
            self.report_missing(transfer, 2, text, "SDO-TOGGLE", data=True)
        elif transfer.doubt == "unasked":
            text = f"{self._doubted}, but the beginning of the transfer is not in the recording"
            self.report_missing(transfer, 1, text, "SDO-UNASKED", data=True)
        transfer.doubt = ""

    def gap(self, frames: int, evidence: str, rule: str) -> None:
        """Report frames that are not in the recording; `rule` is broken if it is complete."""
        self.events.append(Gap(self.now, None, frames, evidence, self.node, rule))

    def note_overlap(self, transfer: OpenTransfer, requested: str) -> None:
        """Note a request in the middle of a transfer that has neither ended nor timed out."""
        if transfer.request or transfer.gapped or transfer.began is None:
            return
        self.interrupted = transfer, self.block
        if self.now - transfer.last_frame_at < _PROMPT:
            text = f"{requested} is requested, but the end of the transfer of {transfer} is not in the recording"
            self.gap(1, text, "SDO-OVERLAP")

    def continues_interrupted_block(self, sender: SdoSide, data: bytes) -> bool:
        """Return whether this is the next segment of a block upload that another request interrupted."""
        block = None if self.interrupted is None else self.interrupted[1]
        if block is None or self.block is not None or (self.open is not None and not self.open.request):
            return False
        return sender == block.data_sender == "server" and 1 < block.expects == data[0] & 0x7F

    def go_on_interrupted(self) -> None:
        """Make the interrupted transfer the one under way again: a frame of it came after the other request."""
        assert self.interrupted is not None
        transfer, block = self.interrupted
        text = f"{transfer} goes on after another request: two transfers at once on one channel"
        self.violation("SDO-OVERLAP", text)
        self.close("cut")
        self.open, self.block, self.interrupted = transfer, block, None

    def done(self, transfer: OpenTransfer) -> None:
        """End the transfer as successful."""
        size = transfer.size
        if size is not None and size != transfer.count and transfer.complete and not transfer.gapped:
            self.violation("SDO-SIZE", f"{size} bytes announced, {transfer.count} transferred")
        self.close("done")

    def close(self, outcome: TransferOutcome, *, abort: int | None = None, by: SdoSide | None = None) -> None:
        """Report the transfer under way, if there is one, and drop it."""
        transfer, block = self.open, self.block
        if transfer is None:
            return
        self.settle_doubt(transfer)
        self.open = self.block = None
        self._last_transfer = transfer.place, outcome
        blocks = 0 if block is None else block.blocks
        report = transfer.report(self.now, self.node, self.channel, outcome, blocks=blocks, abort=abort, by=by)
        self.events.append(report)
        self.given_up = transfer if outcome in ("unanswered", "left") else None

    def release(self) -> None:
        """Emit the events held back, which are now certain."""
        self.events += self._held_back
        self._held_back = []

    def take_events(self) -> list[MonitorEvent]:
        """Return the events since the last call."""
        events, self.events = self.events, []
        return events

    # Requests and answers

    def _begin(self, request: InitiateRequest, data: bytes) -> None:
        if self.open is not None:
            self.note_overlap(self.open, object_name(request.index, request.sub))
            self.close(_outcome_of_silence(self.open) if self.open.request else "cut")
        direction, manner, answers = TRANSFER_OF[type(request)]
        new = self.begin(OpenTransfer(direction, manner, (request.index, request.sub), self.now, self._held))
        new.request, new.answers = data, answers
        if isinstance(request, ExpeditedDownload):
            new.take(request.data)
        elif isinstance(request, InitiateDownload | InitiateBlockDownload):
            new.size = request.size
            new.client_crc = request.crc if isinstance(request, InitiateBlockDownload) else None
        elif isinstance(request, InitiateBlockUpload):
            new.switch, new.client_crc, new.blksize = request.switch, request.crc, request.blksize or BLOCK_MAX
            self._check_blksize(request.blksize)

    def _check_blksize(self, blksize: int) -> None:
        if not 1 <= blksize <= BLOCK_MAX:
            self.violation("SDO-BLOCK-SIZE", f"blocks of {blksize} segments are requested")

    def _answered(self, answer: InitiateAnswer) -> None:
        place = (answer.index, answer.sub)
        transfer, given_up = self.open, self.given_up
        if transfer is None or not transfer.request:
            self._unmatched_answer(answer)
        elif place != transfer.place:
            if given_up is not None and given_up.place == place and isinstance(answer, given_up.answers):
                text = f"the answer about {object_name(*place)} comes after the request for {transfer}"
                self.violation("SDO-OVERLAP", text)
                self.given_up = None
            else:
                text = f"the request is for {transfer}, the answer is about {object_name(*place)}"
                self.violation("SDO-MUX", text)
        elif not isinstance(answer, transfer.answers):
            text = f"the request is {transfer.direction} ({transfer.manner}) of {transfer}"
            self.violation("SDO-WRONG-SCS", text)
        else:
            transfer.request, transfer.next_sender = b"", "client"
            self._go_on(transfer, answer)

    def _go_on(self, transfer: OpenTransfer, answer: InitiateAnswer) -> None:
        """Take a possible answer to the request: the value, or the way in which it will be transferred."""
        if isinstance(answer, ExpeditedUpload | UploadInitiated) and transfer.manner == "block":
            self._check_switch(transfer, answer)
        match answer:
            case ExpeditedUpload():
                transfer.manner = "expedited"
                transfer.take(answer.data)
                self.done(transfer)
            case UploadInitiated():
                transfer.manner, transfer.size = "segmented", answer.size
            case DownloadInitiated():
                if transfer.manner == "expedited":
                    self.done(transfer)
            case BlockUploadInitiated():
                transfer.manner, transfer.size = "block", answer.size
                crc = transfer.client_crc and answer.crc if answer.crc else False
                self.begin_blocks(transfer, "server", transfer.blksize, crc=crc).state = "ready"
            case BlockDownloadInitiated():
                self._check_blksize(answer.blksize)
                size = answer.blksize if 1 <= answer.blksize <= BLOCK_MAX else BLOCK_MAX
                transfer.manner = "block"
                crc = transfer.client_crc and answer.crc if answer.crc else False
                self.begin_blocks(transfer, "client", size, crc=crc)

    def _check_switch(self, transfer: OpenTransfer, answer: ExpeditedUpload | UploadInitiated) -> None:
        """Check that a block upload may be answered as an ordinary one: it has no more bytes than the client said."""
        size = len(answer.data) if isinstance(answer, ExpeditedUpload) else answer.size
        if transfer.switch is not None and (not transfer.switch or (size or 0) > transfer.switch):
            text = f"an ordinary upload of {size} bytes, but the protocol switch is {transfer.switch}"
            self.violation("SDO-BLOCK-SWITCH", text)

    def _aborted(self, sender: SdoSide, abort: Abort) -> None:
        place = (abort.index, abort.sub)
        if abort.code not in tuple(AbortCode):
            self.violation("SDO-ABORT-CODE", abort_text(abort.code))
        if self.open is None:
            self._unmatched_abort(sender, abort)
        elif self.open.place not in (None, place):
            text = f"the transfer is of {self.open}, the abort is about {object_name(*place)}"
            self.violation("SDO-MUX", text)
        elif self.open.doubt == "toggle" and abort.code == AbortCode.TOGGLE:
            self.open.doubt = ""
            self.violation("SDO-TOGGLE", "the client did not alternate the toggle bit, and the server aborted")
        elif self.open.doubt == "unasked" and abort.code == AbortCode.COMMAND:
            self.open.doubt = ""
            self.violation("SDO-UNASKED", "a segment outside a transfer, and the server aborted")
        self.close("aborted", abort=abort.code, by=sender)

    def _unmatched_abort(self, sender: SdoSide, abort: Abort) -> None:
        """Begin the transfer of an abort that comes while none is under way."""
        place = (abort.index, abort.sub)
        given_up = self.given_up if self.given_up is not None and self.given_up.place == place else None
        direction: TransferDirection = "unknown" if given_up is None else given_up.direction
        self.begin(OpenTransfer(direction, "unknown", place, None, self._held))
        # A client that did not receive the last answer aborts a transfer that is over for the server, and one whose
        # request was lost aborts after its time-out. Both sides abort if both wait in vain.
        last_place, outcome = self._last_transfer
        follows = last_place == place and (sender == "client" or outcome != "done")
        follows = follows or (sender == "client" and abort.code == AbortCode.TIMED_OUT)
        if self._has_frames and given_up is None and not follows:
            self.gap(1, "an abort, but no transfer is under way in the recording", "SDO-UNASKED")

    # Transfers whose beginning is not in the recording

    def _continues_unrecorded_block(self, sender: SdoSide, data: bytes) -> bool:
        """Return whether consecutive frames of one side have consecutive numbers, as only the segments of a block do.

        Two are enough, except while another transfer is under way that may have ended unrecorded. Then a third is
        needed, unless the first would break a rule.
        """
        transfer = self.open
        from_client, previous = self._last_frame
        enough = (transfer is None and not self.given_up) or (transfer is not None and transfer.began is None)
        enough = enough or self._run > 0 or bool(self._held_back)
        if not enough or not previous or self.block is not None:
            return False
        return from_client == (sender == "client") and previous[0] < 0x7F and data[0] & 0x7F == previous[0] + 1

    def _begin_unanswered_block(self, sender: SdoSide, data: bytes) -> None:
        """Begin a block whose answer is not in the recording: the client sends segments, so it has received it."""
        transfer = self.open
        if transfer is None or not transfer.request or (transfer.manner, transfer.direction) != ("block", "download"):
            return
        if sender == "client" and data[0] in (0x01, 0x81):
            self.report_missing(transfer, 1, _UNANSWERED, "SDO-UNASKED", data=False)
            transfer.request = b""
            self.begin_blocks(transfer, "client")

    def _unmatched_answer(self, answer: InitiateAnswer) -> None:
        """Take an answer without a request: it is late, or the request is not in the recording."""
        first, place = not self._has_frames, (answer.index, answer.sub)
        late = self.given_up if self.open is None else None
        if late is not None and (late.place != place or not isinstance(answer, late.answers)):
            late = None
        self.close("cut")
        manner: TransferManner = "expedited" if isinstance(answer, ExpeditedUpload) else "segmented"
        upload = isinstance(answer, ExpeditedUpload | UploadInitiated | BlockUploadInitiated)
        direction: TransferDirection = "upload" if upload else "download"
        began = None if late is None else late.began
        new = self.begin(OpenTransfer(direction, manner, place, began, self._held))
        new.next_sender = "client"
        if late is not None:
            self.given_up = None
            new.manner, new.size, new.switch = late.manner, late.size, late.switch
        elif not first:
            new.missing = 1
            self.gap(1, "an answer, but its request is not in the recording", "SDO-UNASKED")
        new.complete = upload or late is not None
        if isinstance(answer, DownloadInitiated) and late is None:
            new.manner = "unknown"  # the value was in the request, or follows in segments
        before = len(self.events)
        self._go_on(new, answer)
        reported = self.events[before:]
        if late is not None:
            late_reports = [replace(event, late=True) if isinstance(event, SdoTransferReport) else event
                            for event in reported]  # fmt: skip
            self.events[before:] = [*self._held_back, *late_reports]
            self._held_back = []
        elif first:  # the next frame may show that it is a segment of a block
            self._held_back += reported
            del self.events[before:]

    def _unmatched_block_message(self, sender: SdoSide, message: SdoMessage, data: bytes) -> None:
        """Take a message of a block transfer while none is under way."""
        transfer = self.open
        if transfer is not None and transfer.request:
            if sender == "client":  # it goes on, so it received the answer; the server may go on without the client
                self.report_missing(transfer, 1, _UNANSWERED, "SDO-UNASKED", data=False)
            transfer.request, transfer.manner = b"", "block"
        else:
            receives = isinstance(message, BlockAck | BlockEnded | StartBlockUpload)
            upload = sender == "client" if receives else isinstance(message, BlockEnd) and sender == "server"
            transfer = self.begin_unrecorded("upload" if upload else "download", "block")
        block = self.begin_blocks(transfer, "server" if transfer.direction == "upload" else "client")
        if isinstance(message, BlockEnd | BlockEnded):
            block.state = "end"
            transfer.complete = False
        elif isinstance(message, StartBlockUpload):
            block.state = "ready"
        block.feed(sender, data, self.now)
        self.collect_findings(block)
        if block.state == "over":
            self.done(transfer)


# Segments ---------------------------------------------------------------------------------------------------------
#
# What a frame shows follows from whether it is its side's turn, and whether its toggle bit is the next one; in three of
# the cases also from whether it carries the bytes of the segment before.

_SegmentKind = Literal["request", "upload", "download", "confirmation"]


class _Lacking(NamedTuple):
    """The frame fits if so many frames before it are not in the recording. `rule` is broken if it lacks none."""

    frames: int
    evidence: str
    rule: str
    data: bool  # whether the frames carried bytes of the value


class _Breach(NamedTuple):
    """The frame breaks the rule of the toggle bit. The text may name the `expected` and the `received` one."""

    text: str


_OTHER_TOGGLE = "with toggle bit {expected}, answered with {received}"

# A frame "fits"; is "doubtful" until the other side goes on or aborts; was sent again because one was "lost" on the
# bus; or is a "repetition" that says nothing about the recording.
_SEGMENT_STEPS: dict[tuple[_SegmentKind, bool, bool], str | _Lacking | _Breach] = {
    # kind, its turn, next toggle bit
    ("request", True, True): "fits",
    ("request", True, False): "doubtful",
    ("request", False, True): "lost",
    ("request", False, False): _Lacking(
        1, "the next segment is requested, but the last one is not in the recording", "SDO-OVERLAP", data=True
    ),
    ("upload", True, True): "fits",
    ("upload", True, False): _Breach(f"requested {_OTHER_TOGGLE}"),
    ("upload", False, True): _Lacking(
        1, "a segment arrives, but the request for it is not in the recording", "SDO-UNASKED", data=False
    ),
    ("upload", False, False): _Breach("a segment that was not requested, with the toggle bit of the last one"),
    ("download", True, True): "fits",
    ("download", True, False): "doubtful",
    ("download", False, True): _Lacking(
        3,
        "another segment with the same toggle bit: the segment between them and two answers are missing",
        "SDO-TOGGLE",
        data=True,
    ),
    ("download", False, False): _Lacking(
        1, "the next segment arrives, but the last answer is not in the recording", "SDO-OVERLAP", data=False
    ),
    ("confirmation", True, True): "fits",
    ("confirmation", True, False): _Breach(f"sent {_OTHER_TOGGLE}"),
    ("confirmation", False, True): _Lacking(
        1, "a segment is confirmed that is not in the recording", "SDO-UNASKED", data=True
    ),
    ("confirmation", False, False): "repetition",
}
_SAME_BYTES_STEPS = {
    ("upload", False, False): "repetition",
    ("download", True, False): "lost",
    ("download", False, True): "lost",
}


def _feed_segment(channel: SdoTracker, sender: SdoSide, message: NextSegment | SdoSegment | SegmentTaken) -> None:
    """Take a frame of a segmented transfer, in either direction."""
    kind: _SegmentKind = "upload" if sender == "server" else "download"
    if not isinstance(message, SdoSegment):
        kind = "request" if isinstance(message, NextSegment) else "confirmation"
    transfer = _segmented_transfer(channel, sender, "upload" if kind in ("request", "upload") else "download", message)
    state = kind, transfer.next_sender == sender, message.toggle == transfer.toggle
    step = _SEGMENT_STEPS[state]
    if isinstance(message, SdoSegment) and message.data == transfer.previous:
        step = _SAME_BYTES_STEPS.get(state, step)
    if isinstance(step, _Breach):
        channel.violation("SDO-TOGGLE", step.text.format(expected=transfer.toggle, received=message.toggle))
    elif step == "repetition":
        transfer.repeats += 1
    elif step == "lost":
        transfer.repeats += 1
        transfer.lost += 1
        how = "requested" if kind == "request" else "sent"
        text = f"the segment is {how} again: it or its answer did not arrive"
        channel.events.append(Loss(channel.now, channel.node, 1, text))
        transfer.toggle, transfer.next_sender = message.toggle, "server"
    else:
        if isinstance(step, _Lacking):
            channel.report_missing(transfer, step.frames, step.evidence, step.rule, data=step.data)
        elif step == "doubtful":
            transfer.doubt = transfer.doubt or "toggle"
        _accept_segment(channel, sender, transfer, message)


def _accept_segment(
    channel: SdoTracker, sender: SdoSide, transfer: OpenTransfer, message: NextSegment | SdoSegment | SegmentTaken
) -> None:
    if sender == "server":
        channel.settle_doubt(transfer)  # the server goes on, so it accepted the doubtful frame
    if isinstance(message, SdoSegment):
        transfer.previous, transfer.last_sent = message.data, message.last
        transfer.take(message.data)
    if sender == "client":
        transfer.toggle, transfer.next_sender = message.toggle, "server"
        return
    transfer.toggle, transfer.next_sender = message.toggle ^ 1, "client"
    if transfer.last_sent:
        channel.done(transfer)


def _segmented_transfer(
    channel: SdoTracker,
    sender: SdoSide,
    direction: TransferDirection,
    message: NextSegment | SdoSegment | SegmentTaken,
) -> OpenTransfer:
    """Return the transfer to which the frame belongs; if there is none, a new one whose beginning was not recorded."""
    transfer = channel.open
    if transfer is not None and transfer.direction == direction and channel.block is None:
        if not transfer.request and transfer.manner == "segmented":
            return transfer
        if transfer.request and not (direction == "download" and transfer.manner != "segmented"):
            # Both sides go on from the request, so its answer was on the bus.
            text = "segments arrive, but the answer to the request is not in the recording"
            channel.report_missing(transfer, 1, text, "SDO-UNASKED", data=False)
            transfer.request, transfer.manner, transfer.next_sender = b"", "segmented", "client"
            return transfer
    interrupted, block = channel.interrupted or (None, None)
    if interrupted is not None and block is None:
        expected = interrupted.manner, interrupted.direction, interrupted.toggle, interrupted.next_sender
        if expected == ("segmented", direction, message.toggle, sender):
            channel.go_on_interrupted()
            return interrupted
    unrecorded = channel.begin_unrecorded(direction, "segmented")
    unrecorded.toggle, unrecorded.next_sender = message.toggle, sender
    return unrecorded


def _outcome_of_silence(transfer: OpenTransfer) -> TransferOutcome:
    """Return the outcome of a transfer that neither side continues."""
    if transfer.gapped or transfer.began is None:
        return "cut"
    return "unanswered" if transfer.next_sender == "server" else "left"


# All channels of a bus ----------------------------------------------------------------------------------------------


CHANNELS_MAX = 512
_OFF_OR_EXTENDED = 0xA000_0000


class SdoChannels:
    """The trackers of all channels, found by the identifier of a frame. A machine.

    `dialects` has command bytes with reserved bits by node; `pdos` has the objects of the nodes.
    """

    def __init__(
        self, held: HeldBytes, give_up: float, dialects: Mapping[int, tuple[int, ...]], pdos: PdoTracker
    ) -> None:
        self._held = held
        self._give_up = give_up
        self._dialects = dialects
        self._pdos = pdos
        self._channels: dict[int, SdoTracker] = {}  # by the COB-ID of the requests
        self._ids: dict[int, tuple[SdoTracker, bool]] = {}
        self._half: dict[tuple[int, int], dict[int, int]] = {}  # the COB-IDs learned of further channels

    def find(self, frame: CanFrame) -> tuple[SdoTracker, bool] | None:
        """Return the channel of a frame, and whether the client sent it."""
        return None if frame.extended else self._ids.get(frame.id)

    def channel(self, node: int, request: int | None = None, answer: int | None = None) -> SdoTracker | None:
        """Return the default channel of a node, or the one with these COB-IDs. None if there are too many."""
        requests, answers = 0x600 + node if request is None else request, 0x580 + node if answer is None else answer
        if requests not in self._channels and len(self._channels) < CHANNELS_MAX:
            tracker = SdoTracker(node, requests, self._held, self._give_up, self._dialects.get(node, ()))
            self._channels[requests] = tracker
            self._ids[requests], self._ids[answers] = (tracker, True), (tracker, False)
        return self._channels.get(requests)

    @property
    def deadline(self) -> float | None:
        """When the first transfer is given up."""
        dues = (channel.deadline for channel in self._channels.values())
        return min((due for due in dues if due is not None), default=None)

    @property
    def under_way(self) -> int:
        """The number of transfers under way."""
        return sum(channel.under_way for channel in self._channels.values())

    def feed(self, channel: SdoTracker, from_client: bool, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """Take a frame of a channel."""
        return self._with_names(channel.feed(from_client, frame, now))

    def pass_time(self, now: float) -> list[MonitorEvent]:
        """Give up the transfers whose deadline has passed."""
        under_way = [channel for channel in self._channels.values() if channel.under_way]
        return self._with_names([event for channel in under_way for event in channel.pass_time(now)])

    def interrupt(self) -> None:
        """Note a gap in the recording."""
        for channel in self._channels.values():
            channel.interrupt()

    def end(self, now: float) -> list[MonitorEvent]:
        """End the recording: report the transfers under way as cut."""
        return self._with_names([event for channel in self._channels.values() for event in channel.end(now)])

    def learn(self, node: int, index: int, sub: int, number: int) -> None:
        """Add a channel from the value of an object 1201h to 127Fh."""
        if not 0x1201 <= index <= 0x127F or sub not in (1, 2):
            return
        half = self._half.setdefault((node, index), {}) if len(self._half) < CHANNELS_MAX else {}
        half[sub] = number
        if len(half) == 2 and not any(word & _OFF_OR_EXTENDED for word in half.values()):
            self.channel(node, half[1] & 0x7FF, half[2] & 0x7FF)

    def _with_names(self, events: list[MonitorEvent]) -> list[MonitorEvent]:
        """Return the events; transfers get the name of their object and their value as text."""
        return [self._with_name(event) if isinstance(event, SdoTransferReport) else event for event in events]

    def _with_name(self, event: SdoTransferReport) -> SdoTransferReport:
        known = self._pdos.object(event.node, event.index, event.sub)
        if known is None:
            return event
        return replace(event, name=known.name, text=known.read(event.data) if event.data is not None else "")
