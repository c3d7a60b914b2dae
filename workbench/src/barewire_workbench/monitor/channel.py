"""The frames of one SDO channel, assembled into transfers.   [CiA 301, SDO]

        605h  client -> server     585h  server -> client          one transfer at a time

The meaning of a frame depends on the frames before it, so this is a machine with the state of both sides. A frame that
does not fit has one of three causes; often the next frame of the other side decides which:

    the recording lacks a frame     both sides go on, so both have it                            Gap
    the bus lost a frame            one side sends the same again                                Loss
    a side broke a rule             the other side aborts, or nothing else can explain it        Violation

A recording may begin in the middle of a transfer:

    answer without a request        late, if the transfer was given up; or the request is not in the recording
    consecutive numbers, one side   a block: no other transfer has two frames of one side in a row
    A2, C1, A1                      the end of a block transfer
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

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
from barewire_workbench.monitor.channel_state import ChannelState
from barewire_workbench.monitor.events import (
    MonitorEvent,
    SdoTransferReport,
    TransferDirection,
    TransferManner,
    TransferOutcome,
    Violation,
)
from barewire_workbench.monitor.reserved import reserved_byte
from barewire_workbench.monitor.segments import feed_segment
from barewire_workbench.monitor.transfer import (
    CLIENT_MESSAGES,
    SERVER_MESSAGES,
    TRANSFER_OF,
    HeldBytes,
    InitiateAnswer,
    InitiateRequest,
    OpenTransfer,
    SdoSide,
    object_name,
)

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
        self.node = node
        self._state = ChannelState(node, channel, held)
        self._give_up = give_up
        self._reserved = set(dialect)  # command bytes whose reserved bits are not reported, or not again

    @property
    def under_way(self) -> bool:
        """Whether a transfer is under way."""
        return self._state.open is not None

    @property
    def deadline(self) -> float | None:
        """When the transfer under way is given up."""
        transfer = self._state.open
        return None if transfer is None else transfer.last_frame_at + self._give_up

    def feed(self, from_client: bool, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """Take a frame of the client or of the server."""
        state, data = self._state, frame.data
        state.now, state.frame = now, str(frame)
        if len(data) != 8:
            state.violation("SDO-LENGTH", f"{len(data)} bytes")
        if data:
            self._take("client" if from_client else "server", data)
            if state.open is not None:
                state.open.last_frame_at = now
        before = state.last_frame[1] if state.last_frame[0] == from_client else b""
        state.run = state.run + 1 if data and before and data[0] & 0x7F == before[0] + 1 else 0
        state.has_frames, state.last_frame = True, (from_client, data)
        return state.take_events()

    def pass_time(self, now: float) -> list[MonitorEvent]:
        """Give up a transfer whose deadline has passed."""
        deadline, transfer = self.deadline, self._state.open
        if deadline is not None and transfer is not None and now >= deadline:
            self._state.now = deadline
            self._state.release()
            self._state.close(_outcome_of_silence(transfer))
        return self._state.take_events()

    def interrupt(self) -> None:
        """Note a gap in the recording: the transfer under way may go on after it, or may have ended in it."""
        if self._state.open is not None:
            self._state.open.gapped = True
        self._state.given_up, self._state.interrupted, self._state.has_frames = None, None, False

    def end(self, now: float) -> list[MonitorEvent]:
        """End the recording: report the transfer under way as cut."""
        self._state.now = now
        self._state.close("cut")
        self._state.release()
        return self._state.take_events()

    def takes_segment(self, from_client: bool, data: bytes) -> bool:
        """Return whether this frame, coming now, would be a segment of a block."""
        block = self._state.block
        if block is None or block.state != "segments" or not data or data[0] == 0x80:
            return False
        return block.data_sender == ("client" if from_client else "server")

    # Frames

    def _take(self, sender: SdoSide, data: bytes) -> None:
        state = self._state
        if self._continues_unrecorded_block(sender, data):
            transfer = state.begin_unrecorded("upload" if sender == "server" else "download", "block")
            state.begin_blocks(transfer, sender)
        state.release()
        self._begin_unanswered_block(sender, data)
        if state.continues_interrupted_block(sender, data):
            state.go_on_interrupted()
        block = state.block
        if block is not None:
            belongs = block.feed(sender, data, state.now)
            state.collect_findings(block)
            if belongs:
                if sender != block.data_sender or block.state == "ended":
                    self._check_reserved(decode_one_of(data, _MESSAGES[sender]), data)
                    state.release()
                if block.state == "over":
                    state.done(block.transfer)
                return
        try:
            message = decode_one_of(data, _MESSAGES[sender])
        except DecodeError as error:
            if error.reason == "function":
                state.violation("SDO-COMMAND", f"{data[0]:02X}h is not a command of the {sender}")
            return
        self._check_reserved(message, data)
        if isinstance(message, Abort):
            self._aborted(sender, message)
        elif isinstance(message, InitiateAnswer):
            self._answered(message)
        elif isinstance(message, InitiateRequest):
            self._begin(message, data)
        elif isinstance(message, NextSegment | SdoSegment | SegmentTaken):
            feed_segment(state, sender, message, state.now)
        else:
            self._unmatched_block_message(sender, message, data)

    def _check_reserved(self, message: SdoMessage, data: bytes) -> None:
        """Hold back a violation for reserved bits or bytes that are not 0: the next frame may show that this was a
        segment of a block that began in a gap of the recording."""
        state, texts = self._state, []
        if has_reserved_bits(message.pattern, data[0]) and data[0] not in self._reserved:
            self._reserved.add(data[0])
            standard = message.pattern.encode(**message.pattern.decode(data[0]))
            texts = [f"{data[0]:02X}h instead of {standard:02X}h"]
        place = reserved_byte(message, data)
        if place is not None:
            texts.append(f"byte {place} behind the command {data[0]:02X}h is reserved, and not 0")
        for text in texts:
            state.held_back.append(Violation(state.now, "SDO-RESERVED", self.node, text, state.frame))

    # Requests and answers

    def _begin(self, request: InitiateRequest, data: bytes) -> None:
        state = self._state
        if state.open is not None:
            state.interrupt(state.open, object_name(request.index, request.sub))
            state.close(_outcome_of_silence(state.open) if state.open.request else "cut")
        direction, manner, answers = TRANSFER_OF[type(request)]
        new = state.begin(OpenTransfer(direction, manner, (request.index, request.sub), state.now, state.held))
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
            self._state.violation("SDO-BLOCK-SIZE", f"blocks of {blksize} segments are requested")

    def _answered(self, answer: InitiateAnswer) -> None:
        state, place = self._state, (answer.index, answer.sub)
        transfer, given = state.open, state.given_up
        if transfer is None or not transfer.request:
            self._unmatched_answer(answer)
        elif place != (transfer.index, transfer.sub):
            if given is not None and (given.index, given.sub) == place and isinstance(answer, given.answers):
                text = f"the answer about {object_name(*place)} comes after the request for {transfer}"
                state.violation("SDO-OVERLAP", text)
                state.given_up = None
            else:
                text = f"the request is for {transfer}, the answer is about {object_name(*place)}"
                state.violation("SDO-MUX", text)
        elif not isinstance(answer, transfer.answers):
            text = f"the request is {transfer.direction} ({transfer.manner}) of {transfer}"
            state.violation("SDO-WRONG-SCS", text)
        else:
            transfer.request, transfer.next_sender = b"", "client"
            self._go_on(transfer, answer)

    def _go_on(self, transfer: OpenTransfer, answer: InitiateAnswer) -> None:
        """Take a possible answer to the request: the value, or the way in which it will be transferred."""
        state = self._state
        if isinstance(answer, ExpeditedUpload | UploadInitiated) and transfer.manner == "block":
            size = len(answer.data) if isinstance(answer, ExpeditedUpload) else answer.size
            if transfer.switch is not None and (not transfer.switch or (size or 0) > transfer.switch):
                text = f"an ordinary upload of {size} bytes, but the protocol switch is {transfer.switch}"
                state.violation("SDO-BLOCK-SWITCH", text)
        match answer:
            case ExpeditedUpload():
                transfer.manner = "expedited"
                transfer.take(answer.data)
                state.done(transfer)
            case UploadInitiated():
                transfer.manner, transfer.size = "segmented", answer.size
            case DownloadInitiated():
                if transfer.manner == "expedited":
                    state.done(transfer)
            case BlockUploadInitiated():
                transfer.manner, transfer.size = "block", answer.size
                crc = transfer.client_crc and answer.crc if answer.crc else False
                state.begin_blocks(transfer, "server", transfer.blksize, crc=crc).state = "ready"
            case BlockDownloadInitiated():
                self._check_blksize(answer.blksize)
                size = answer.blksize if 1 <= answer.blksize <= BLOCK_MAX else BLOCK_MAX
                transfer.manner = "block"
                crc = transfer.client_crc and answer.crc if answer.crc else False
                state.begin_blocks(transfer, "client", size, crc=crc)

    def _aborted(self, sender: SdoSide, abort: Abort) -> None:
        state = self._state
        if abort.code not in tuple(AbortCode):
            state.violation("SDO-ABORT-CODE", abort_text(abort.code))
        if state.open is None:
            place, given = (abort.index, abort.sub), state.given_up
            late = given is not None and (given.index, given.sub) == place
            direction: TransferDirection = given.direction if late and given is not None else "unknown"
            state.begin(OpenTransfer(direction, "unknown", place, None, state.held))
            # A client that did not receive the last answer aborts a transfer that is over for the server, and one whose
            # request was lost aborts after its time-out. Both sides abort if both wait in vain.
            last_place, outcome = state.last_transfer
            follows = last_place == place and (sender == "client" or outcome != "done")
            follows = follows or (sender == "client" and abort.code == AbortCode.TIMED_OUT)
            if state.has_frames and not late and not follows:
                state.gap(1, "an abort, but no transfer is under way in the recording", "SDO-UNASKED")
        elif state.open.index is not None and (abort.index, abort.sub) != (state.open.index, state.open.sub):
            text = f"the transfer is of {state.open}, the abort is about {object_name(abort.index, abort.sub)}"
            state.violation("SDO-MUX", text)
        elif state.open.doubt == "toggle" and abort.code == AbortCode.TOGGLE:
            state.open.doubt = ""
            state.violation("SDO-TOGGLE", "the client did not alternate the toggle bit, and the server aborted")
        elif state.open.doubt == "unasked" and abort.code == AbortCode.COMMAND:
            state.open.doubt = ""
            state.violation("SDO-UNASKED", "a segment outside a transfer, and the server aborted")
        state.close("aborted", abort=abort.code, by=sender)

    # Transfers whose beginning is not in the recording

    def _continues_unrecorded_block(self, sender: SdoSide, data: bytes) -> bool:
        """Return whether consecutive frames of one side have consecutive numbers, as only the segments of a block do.

        Two are enough, except while another transfer is under way that may have ended unrecorded. Then a third is
        needed, unless the first would break a rule.
        """
        state, transfer = self._state, self._state.open
        from_client, last = state.last_frame
        enough = (transfer is None and not state.given_up) or (transfer is not None and transfer.began is None)
        enough = enough or state.run > 0 or bool(state.held_back)
        if not enough or not last or state.block is not None:
            return False
        return from_client == (sender == "client") and last[0] < 0x7F and data[0] & 0x7F == last[0] + 1

    def _begin_unanswered_block(self, sender: SdoSide, data: bytes) -> None:
        """Begin a block whose answer is not in the recording: the client sends segments, so it has received it."""
        transfer = self._state.open
        if transfer is None or not transfer.request or (transfer.manner, transfer.direction) != ("block", "download"):
            return
        if sender == "client" and data[0] in (0x01, 0x81):
            self._state.report_missing(transfer, 1, _UNANSWERED, "SDO-UNASKED", data=False)
            transfer.request = b""
            self._state.begin_blocks(transfer, "client")

    def _unmatched_answer(self, answer: InitiateAnswer) -> None:
        """Take an answer without a request: it is late, or the request is not in the recording."""
        state = self._state
        given, first = state.given_up, not state.has_frames
        matches = given is not None and (given.index, given.sub) == (answer.index, answer.sub)
        late = given if given is not None and matches and state.open is None else None
        late = late if late is not None and isinstance(answer, late.answers) else None
        state.close("cut")
        manner: TransferManner = "expedited" if isinstance(answer, ExpeditedUpload) else "segmented"
        upload = isinstance(answer, ExpeditedUpload | UploadInitiated | BlockUploadInitiated)
        direction: TransferDirection = "upload" if upload else "download"
        began = None if late is None else late.began
        new = state.begin(OpenTransfer(direction, manner, (answer.index, answer.sub), began, state.held))
        new.next_sender = "client"
        if late is not None:
            state.given_up = None
            new.manner, new.size, new.switch = late.manner, late.size, late.switch
        elif not first:
            new.missing = 1
            state.gap(1, "an answer, but its request is not in the recording", "SDO-UNASKED")
        new.complete = upload or late is not None
        if isinstance(answer, DownloadInitiated) and late is None:
            new.manner = "unknown"  # the value was in the request, or follows in segments
        before = len(state.events)
        self._go_on(new, answer)
        if late is not None or first:
            answered, state.events[before:] = state.events[before:], []
            state.held_back += [
                replace(event, late=late is not None) if isinstance(event, SdoTransferReport) else event
                for event in answered
            ]
            if late is not None:
                state.release()

    def _unmatched_block_message(self, sender: SdoSide, message: SdoMessage, data: bytes) -> None:
        """Take a message of a block transfer while none is under way."""
        state, transfer = self._state, self._state.open
        if transfer is not None and transfer.request:
            if sender == "client":  # it goes on, so it received the answer; the server may go on without the client
                state.report_missing(transfer, 1, _UNANSWERED, "SDO-UNASKED", data=False)
            transfer.request, transfer.manner = b"", "block"
        else:
            receives = isinstance(message, BlockAck | BlockEnded | StartBlockUpload)
            upload = sender == "client" if receives else isinstance(message, BlockEnd) and sender == "server"
            transfer = state.begin_unrecorded("upload" if upload else "download", "block")
        block = state.begin_blocks(transfer, "server" if transfer.direction == "upload" else "client")
        if isinstance(message, BlockEnd | BlockEnded):
            block.state = "end"
            transfer.complete = False
        elif isinstance(message, StartBlockUpload):
            block.state = "ready"
        block.feed(sender, data, state.now)
        state.collect_findings(block)
        if block.state == "over":
            state.done(transfer)


def _outcome_of_silence(transfer: OpenTransfer) -> TransferOutcome:
    """Return the outcome of a transfer that neither side continues."""
    if transfer.gapped or transfer.began is None:
        return "cut"
    return "unanswered" if transfer.next_sender == "server" else "left"
