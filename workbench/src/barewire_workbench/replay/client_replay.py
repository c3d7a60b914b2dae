"""Plays a recording against the SDO client of barewire, in virtual time: the client makes the transfers that were
recorded, gets the recorded responses, and its requests are compared with the recorded ones.

        recording     605#4008100000000000   585#4108100009000000   605#6000000000000000   585#0074...   605#70...
                      the client sent it     the node sent it       the client sent it                   the client
                             |                      |                      |                                |
        our client    605#4008100000000000   <- gets it             605#6000000000000000   <- gets it    605#60...
                      same                                          same                                 different

The first request of a recorded transfer says what is asked: the object, the direction, expedited or in segments or in
blocks, the block size, whether a size and a CRC are announced. The data of a download is the recorded one. Our client
sends its own frames from there on, and it gets a response when it has sent as many requests as the recorded client
before it, at the recorded time. Each transfer begins on a channel of its own, so that no difference follows from the
one before. A transfer whose beginning is not in the recording, or with a gap that the recorder reports, is left out.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import inf, nextafter
from typing import NamedTuple

from barewire.canopen.cob_ids import check_node
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.client import BlockSettings, download, upload
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.canopen.sdo.messages import (
    Abort,
    ExpeditedDownload,
    InitiateBlockUpload,
    InitiateDownload,
    InitiateUpload,
    SdoRequest,
    decode_sdo_request,
)
from barewire.conversation import DEFAULT_TIMEOUT, Conversation, Heard, Listen, Send, SendAll
from barewire.errors import BarewireError, DecodeError, EncodeError
from barewire_workbench.monitor.events import SdoTransferReport
from barewire_workbench.monitor.monitor import CanMonitor
from barewire_workbench.recordings.model import Dropped, Recorded, RecordedItem, Unread
from barewire_workbench.replay.played import Comparer, Played, PlayedOutcome

_STEP = 0.001
_PIECE = 889  # a block of 127 segments
_STEPS_MAX = 1_000_000
"""How often a client sends or listens at most in one transfer."""
_ABORT = b"\x80"


class _ChannelFrame(NamedTuple):
    """A recorded frame of the channel, at a time that no other item has."""

    at: float
    item: Recorded
    frame: CanFrame


class _Transfer(NamedTuple):
    """A recorded transfer: its frames, and what the monitor found. `is_cut`: the recording ends in it."""

    frames: list[_ChannelFrame]
    report: SdoTransferReport
    is_cut: bool


def _padded(data: bytes, size: int) -> Iterator[bytes]:
    """Yield the data, and zeros for what was not sent before an abort. Pieces are never sent expedited.

    A recording may announce up to 4 GiB, so the zeros are made as they are sent.
    """
    yield data
    for at in range(len(data), size, _PIECE):
        yield bytes(min(_PIECE, size - at))


class ClientReplay:
    """Compares our SDO client with the one that a recording shows on the default SDO channel of a node.

    `timeout` is that of our client, in seconds. Give all items to `play`.

    >>> lines = "605#4000100000000000", "585#4300100091010F00"
    >>> items = [Recorded(place / 10, "can0", CanFrame.parse(line)) for place, line in enumerate(lines)]
    >>> [(played.outcome, str(played.sent)) for played in ClientReplay(5).play(items)]
    [('same', '605#4000100000000000')]
    """

    def __init__(self, node: int, *, timeout: float = DEFAULT_TIMEOUT, timed: bool = True) -> None:
        self.node = check_node(node)
        self.timeout = timeout
        self.timed = timed
        self._comparer = Comparer()
        self.counts = self._comparer.counts
        self.transfers = 0
        """The transfers that the client made."""
        self.received = 0
        """The recorded responses that it received."""
        self.left_out = 0
        """The transfers that are not whole in the recording, or begin with a request that the client does not send."""

    def play(self, items: Sequence[RecordedItem]) -> Iterator[Played]:
        """Make the recorded transfers, one after the other, and yield the comparison of each request."""
        for transfer in self._transfers(items):
            conversation = self._ask(transfer)
            if conversation is None:
                self.left_out += 1
                continue
            self.transfers += 1
            differs = False
            for played in self._compare(conversation, transfer):
                yield self._comparer.note(played, follows=differs)
                differs = differs or played.outcome != "same"

    # The recorded transfers

    def _transfers(self, items: Sequence[RecordedItem]) -> Iterator[_Transfer]:
        """Yield the transfers on the channel with all their frames; count those that are not whole."""
        frames, reports, losses = self._channel(items)
        times = [frame.at for frame in frames]
        begun: dict[int, SdoTransferReport] = {}  # place of the first frame -> the transfer
        for report in reports:
            place = len(times) if report.began is None else bisect_left(times, report.began)
            if place < len(times) and times[place] == report.began:
                begun[place] = report
        self.left_out += len(reports) - len(begun)
        for start, following in pairwise([*sorted(begun), len(frames)]):
            report = begun[start]
            is_over = report.outcome in ("done", "aborted") and not report.late
            end = min(following, bisect_right(times, report.at)) if is_over else following
            if any(times[start] < loss <= report.at for loss in losses):
                self.left_out += 1
            else:
                is_cut = report.outcome in ("cut", "unanswered", "left") and following == len(frames)
                yield _Transfer(frames[start:end], report, is_cut)

    def _channel(
        self, items: Sequence[RecordedItem]
    ) -> tuple[list[_ChannelFrame], list[SdoTransferReport], list[float]]:
        """Return the frames of the channel, the transfers that the monitor sees in them, and when frames were lost."""
        monitor, frames, reports = CanMonitor(), list[_ChannelFrame](), list[SdoTransferReport]()
        first, now, losses = items[0].at if items else 0.0, -1.0, list[float]()
        for place, item in enumerate(items):
            if isinstance(item, Unread):
                continue
            # Each item has a time of its own, so that a time of the monitor leads back to one frame.
            now = max(item.at - first if self.timed else place * _STEP, nextafter(now, inf))
            if isinstance(item, Dropped):
                losses.append(now)
                reports += self._of_channel(monitor.feed(item, now))
            elif isinstance(item.frame, CanFrame):
                if item.frame.key in ((0x600 + self.node, False), (0x580 + self.node, False)) and not item.frame.remote:
                    frames.append(_ChannelFrame(now, item, item.frame))
                reports += self._of_channel(monitor.feed(item.frame, now))
        reports += self._of_channel(monitor.end(now))
        return frames, reports, losses

    def _of_channel(self, events: Sequence[object]) -> list[SdoTransferReport]:
        reports = [event for event in events if isinstance(event, SdoTransferReport)]
        return [report for report in reports if (report.node, report.channel) == (self.node, 0x600 + self.node)]

    # What our client is asked to do

    def _ask(self, transfer: _Transfer) -> Conversation[CanFrame, object] | None:
        """Return the same transfer of our client, None if it has none that begins so."""
        frames = [frame for _, _, frame in transfer.frames]
        answers = [frame.data for frame in frames if frame.id == 0x580 + self.node]
        try:
            request = decode_sdo_request(frames[0].data)
            return self._conversation(request, transfer.report, is_refused=bool(answers) and answers[0][:1] == _ABORT)
        except (DecodeError, EncodeError):
            return None

    def _conversation(
        self, request: SdoRequest, report: SdoTransferReport, *, is_refused: bool
    ) -> Conversation[CanFrame, object] | None:
        command = request.command if isinstance(request, InitiateUpload) else 0x40
        dialect = STANDARD if command == 0x40 else SdoDialect("recorded", ((4, command),))
        channel = Channel(self.node, dialect, own_frames=False)
        if isinstance(request, InitiateUpload):
            return upload(channel, request.index, request.sub, timeout=self.timeout, limit=None)
        if isinstance(request, InitiateBlockUpload):
            # After a refusal the recorded client asked again in its own way: that is the next transfer.
            blocks = BlockSettings(request.blksize, request.crc, request.switch, not is_refused)
            return upload(channel, request.index, request.sub, timeout=self.timeout, limit=None, block=blocks)
        if isinstance(request, ExpeditedDownload):
            data, indicated = request.data, request.indicated
            return download(channel, request.index, request.sub, data, timeout=self.timeout, indicated=indicated)
        if isinstance(request, Abort) or (report.data is None and report.count):
            return None
        mode = False if isinstance(request, InitiateDownload) else BlockSettings(crc=request.crc, falls_back=False)
        return download(
            channel,
            request.index,
            request.sub,
            _padded(report.data or b"", request.size or 0),
            timeout=self.timeout,
            size=request.size,
            indicated=request.size is not None,
            block=mode,
        )

    # The comparison

    def _compare(self, conversation: Conversation[CanFrame, object], transfer: _Transfer) -> Iterator[Played]:
        """Run our client against the recorded responses, and yield its requests beside the recorded ones."""
        requests = deque((n, entry) for n, entry in enumerate(transfer.frames) if entry[2].id == 0x600 + self.node)
        responses = deque((n, entry) for n, entry in enumerate(transfer.frames) if entry[2].id != 0x600 + self.node)
        now, answer = transfer.frames[0][0], None
        offset = transfer.frames[0][1].at - now
        heard: Heard[CanFrame] | None = None
        for _ in range(_STEPS_MAX):
            try:
                step: Send[CanFrame] | SendAll[CanFrame] | Listen = (
                    next(conversation) if heard is None else conversation.send(heard)
                )
            except (StopIteration, BarewireError):
                break
            heard = Heard(None, now)
            if isinstance(step, Listen):
                if responses and (not requests or responses[0][0] < requests[0][0]):
                    at, _, frame = responses[0][1]
                    if at <= max(step.until, now):
                        responses.popleft()
                        self.received += 1
                        now, answer = max(now, at), frame
                        heard = Heard(frame, now)
                        continue
                now = max(now, step.until)
                heard = Heard(None, now)
                continue
            for sent in step.items:
                if requests:
                    at, item, recorded = requests.popleft()[1]
                    now = max(now, at)
                    outcome: PlayedOutcome = "same" if sent == recorded else "different"
                    yield Played(item.at, outcome, "sdo", recorded, sent, answer, item.line, sender="client")
                elif not transfer.is_cut:
                    yield Played(now + offset, "extra", "sdo", None, sent, answer, 0, sender="client")
            heard = Heard(None, now)
        for _, (_, item, recorded) in requests:
            yield Played(item.at, "missing", "sdo", recorded, None, answer, item.line, sender="client")
