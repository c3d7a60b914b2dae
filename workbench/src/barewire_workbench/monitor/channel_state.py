"""The state of one SDO channel, which its trackers share: the transfer under way, and the events of the last frame.

        channel      determines the message of a frame     |
        segments     takes frames of segmented transfers   |--> ChannelState: open transfer, block, events
        block        takes frames of block transfers; its findings are collected by `collect_findings`

The first frame of a channel may be ambiguous; its events are held back until the next frame settles it.
"""

from __future__ import annotations

from barewire_workbench.monitor.block import BlockTracker
from barewire_workbench.monitor.events import (
    Gap,
    Loss,
    MonitorEvent,
    TransferDirection,
    TransferManner,
    TransferOutcome,
    Violation,
)
from barewire_workbench.monitor.transfer import HeldBytes, OpenTransfer, SdoSide

_PROMPT = 0.1
"""Seconds after a frame of a transfer in which its client cannot have given it up after a time-out."""


class ChannelState:
    """One channel of one node. `channel` is the COB-ID of the requests."""

    def __init__(self, node: int, channel: int, held: HeldBytes) -> None:
        self.node, self.channel, self.held = node, channel, held
        self.open: OpenTransfer | None = None
        self.block: BlockTracker | None = None  # of the open transfer
        self.given_up: OpenTransfer | None = None  # the last one without an end: its answer may be late
        self.interrupted: tuple[OpenTransfer, BlockTracker | None] | None = None  # another request came in its middle
        self.last_transfer: tuple[tuple[int | None, int | None], TransferOutcome] = (None, None), "cut"  # that is over
        self.has_frames = False  # since the start, or since a gap in the recording
        self.last_frame = (False, b"")  # whether the client sent it, and its data
        self.run = 0  # consecutive frames of one side, each with the next higher number
        self.now, self.frame = 0.0, ""
        self.doubted = ""  # what arrived without a beginning
        self.events: list[MonitorEvent] = []
        self.held_back: list[MonitorEvent] = []

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
        self.held_back = []
        transfer = self.begin(OpenTransfer(direction, manner, None, None, self.held))
        transfer.doubt = "unasked" if self.has_frames else ""
        self.doubted = "segments" if manner == "segmented" else "a message of a block transfer"
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
            text = f"{self.doubted}, but the beginning of the transfer is not in the recording"
            self.report_missing(transfer, 1, text, "SDO-UNASKED", data=True)
        transfer.doubt = ""

    def gap(self, frames: int, evidence: str, rule: str) -> None:
        """Report frames that are not in the recording; `rule` is broken if it is complete."""
        self.events.append(Gap(self.now, None, frames, evidence, self.node, rule))

    def interrupt(self, transfer: OpenTransfer, requested: str) -> None:
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
        self.last_transfer = (transfer.index, transfer.sub), outcome
        blocks = 0 if block is None else block.blocks
        report = transfer.report(self.now, self.node, self.channel, outcome, blocks=blocks, abort=abort, by=by)
        self.events.append(report)
        self.given_up = transfer if outcome in ("unanswered", "left") else None

    def release(self) -> None:
        """Emit the events held back, which are now certain."""
        self.events += self.held_back
        self.held_back = []

    def take_events(self) -> list[MonitorEvent]:
        """Return the events since the last call."""
        events, self.events = self.events, []
        return events
