"""SDO overheard from the middle: transfers whose beginning is not in the recording.

        answer without a request      late, if we gave the request up; or the request was not recorded
        numbered frames of one side   a block under way: nothing but a block has two frames of one side in a row
        A2, C1, A1                    the last words of a block transfer

The first frame of a channel that could be anything is held back until the next one shows that it was what it seemed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from barewire.canopen.sdo.messages.block import (
    BlockAck,
    BlockEnd,
    BlockEnded,
    BlockUploadInitiated,
    StartBlockUpload,
)
from barewire.canopen.sdo.messages.codec import SdoMessage
from barewire.canopen.sdo.messages.initiate import DownloadInitiated, ExpeditedUpload, UploadInitiated
from barewire.explain.can_monitor.block import BlockTracker
from barewire.explain.can_monitor.events import Gap, SdoTransferReport, TransferDirection, TransferManner
from barewire.explain.can_monitor.message_directions import InitiateAnswer
from barewire.explain.can_monitor.transfer import OpenTransfer, SdoSide

if TYPE_CHECKING:
    from barewire.explain.can_monitor.channel import SdoTracker


def is_block_under_way(channel: SdoTracker, speaker: SdoSide, data: bytes) -> bool:
    """Two frames of one side behind each other, numbered so. Nothing but a block does that.

    Three, or a first one that would be odd, where a transfer is under way whose end may be what is not recorded.
    """
    last_asks, last = channel.last
    first = (channel.open is None and not channel.given_up) or (channel.open is not None and channel.open.began is None)
    first = first or channel.run > 0 or bool(channel.held_back)
    if not first or not last or (channel.open is not None and channel.open.block is not None):
        return False
    return last_asks == (speaker == "client") and last[0] < 0x7F and data[0] & 0x7F == last[0] + 1


UNANSWERED = "a block transfer goes on, and the answer to its request is not in the recording"


def first_segment_of_block(channel: SdoTracker, speaker: SdoSide, data: bytes) -> None:
    """The client begins to send segments, so it has heard the answer to its request, which is not in the recording."""
    transfer = channel.open
    if transfer is None or not transfer.asked or transfer.manner != "block" or transfer.direction != "download":
        return
    if speaker == "client" and data[0] in (0x01, 0x81):
        channel.lack(transfer, 1, UNANSWERED, data=False)
        transfer.asked = b""
        transfer.block = BlockTracker(transfer, channel.node, "client", None, crc=None)


def begin_unheard(channel: SdoTracker, direction: TransferDirection, manner: TransferManner) -> OpenTransfer:
    """A transfer whose beginning is not in the recording."""
    if channel.open is not None and channel.open.began is not None:
        channel.close("cut")
    elif channel.open is not None:
        channel.open.forget()
    channel.held_back = []
    channel.open = OpenTransfer(direction, manner, None, None, channel.memory)
    channel.open.doubt = "unasked" if channel.heard else ""
    return channel.open


def answer_to_nobody(channel: SdoTracker, answer: InitiateAnswer) -> None:
    """An answer without a request: late, or the request is not in the recording."""
    given, late = channel.given_up, False
    if given is not None and (given.index, given.sub) == (answer.index, answer.sub):
        late = channel.open is None and isinstance(answer, given.answers)
    first = not channel.heard
    if channel.open is not None:
        channel.close("cut")
    manner: TransferManner = "expedited" if isinstance(answer, ExpeditedUpload) else "segmented"
    upload = isinstance(answer, ExpeditedUpload | UploadInitiated | BlockUploadInitiated)
    began = given.began if late and given is not None else None
    new = OpenTransfer("upload" if upload else "download", manner, (answer.index, answer.sub), began, channel.memory)
    new.turn = "client"
    channel.open = new
    if late and given is not None:
        channel.given_up = None
        new.manner, new.size, new.switch = given.manner, given.size, given.switch
    elif not first:
        new.missing = 1
        channel.out.append(Gap(channel.now, None, 1, "an answer, and no request is in the recording", channel.node))
    new.whole = upload or late
    if isinstance(answer, DownloadInitiated) and not late:
        new.manner = "unknown"  # the value was in the request, or follows in segments
    before = len(channel.out)
    channel.go_on(new, answer)
    if late or first:
        told, channel.out[before:] = channel.out[before:], []
        channel.held_back += [
            replace(one, late=late) if isinstance(one, SdoTransferReport) and late else one for one in told
        ]
        if late:
            channel.release()


def block_unheard(channel: SdoTracker, speaker: SdoSide, message: SdoMessage, data: bytes) -> None:
    """A word of a block transfer, and none is under way."""
    if channel.open is not None and channel.open.asked:
        transfer = channel.open
        if speaker == "client":  # it goes on, so it has heard the answer; the server may be alone with it
            channel.lack(transfer, 1, UNANSWERED, data=False)
        transfer.asked, transfer.manner = b"", "block"
    else:
        ends = isinstance(message, BlockEnd)
        receives = isinstance(message, BlockAck | BlockEnded | StartBlockUpload)
        upload = (receives and speaker == "client") or (ends and speaker == "server")
        transfer = begin_unheard(channel, "upload" if upload else "download", "block")
    sender: SdoSide = "server" if transfer.direction == "upload" else "client"
    transfer.block = BlockTracker(transfer, channel.node, sender, None, crc=None)
    if isinstance(message, BlockEnd | BlockEnded):
        transfer.block.state = "end"
        transfer.whole = False
    elif isinstance(message, StartBlockUpload):
        transfer.block.state = "ready"
    transfer.block.feed(speaker, data, channel.now)
    channel.take_told(transfer.block)
    if transfer.block.state == "over":
        channel.done()
