"""Segments overheard: what the toggle bit tells somebody who only listens.   [CiA 301, SDO segments]

client  60  70  60  70          server  00  10  00  11          the bit alternates, the answer repeats it

the next bit, and no answer was heard     the answer is not in the recording, or they would not go on
the same bit and bytes again              the bus lost something, and it is said again
the bit did not alternate                 two frames are not in the recording if the other side goes on;
                                          a broken rule if it aborts with 0503 0000h
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from barewire.canopen.sdo.messages.segment import NextSegment, SdoSegment, SegmentTaken
from barewire.explain.can_monitor.events import Loss
from barewire.explain.can_monitor.transfer import OpenTransfer, SdoSide
from barewire.explain.can_monitor.unheard import begin_unheard

if TYPE_CHECKING:
    from barewire.explain.can_monitor.channel import SdoTracker


def hear_segment(
    channel: SdoTracker, speaker: SdoSide, message: NextSegment | SdoSegment | SegmentTaken, now: float
) -> None:
    """A frame of a transfer in segments, in either direction."""
    uploads = isinstance(message, NextSegment) or (speaker == "server" and isinstance(message, SdoSegment))
    transfer = _transfer(channel, "upload" if uploads else "download", message)
    if isinstance(message, NextSegment):
        _asked(channel, transfer, message.toggle, now)
    elif isinstance(message, SegmentTaken):
        _taken(channel, transfer, message.toggle)
    elif speaker == "server":
        _answered(channel, transfer, message)
    else:
        _sent(channel, transfer, message, now)


def _transfer(channel: SdoTracker, direction: str, message: NextSegment | SdoSegment | SegmentTaken) -> OpenTransfer:
    """The transfer that the frame belongs to; a new one without a beginning if there is none."""
    transfer = channel.open
    asked = transfer is not None and transfer.asked
    if transfer is not None and transfer.direction == direction and transfer.block is None:
        if not asked and transfer.manner == "segmented":
            return transfer
        if asked and not (direction == "download" and transfer.manner != "segmented"):
            # The peers have gone on from the request, so its answer was on the bus.
            channel.lack(
                transfer, 1, "segments come, and the answer to the request is not in the recording", data=False
            )
            transfer.asked, transfer.manner, transfer.turn = b"", "segmented", "client"
            return transfer
    begun = begin_unheard(channel, "upload" if direction == "upload" else "download", "segmented")
    begun.toggle = message.toggle
    begun.turn = "client" if isinstance(message, NextSegment) else "server"
    if isinstance(message, SdoSegment) and direction == "download":
        begun.turn = "client"
    return begun


def _again(channel: SdoTracker, transfer: OpenTransfer, what: str, now: float) -> None:
    transfer.again += 1
    transfer.lost += 1
    channel.out.append(Loss(now, channel.node, 1, f"{what} again: it, or what was said to it, did not arrive"))


def _pair_missing(channel: SdoTracker, transfer: OpenTransfer) -> None:
    """The toggle bit did not alternate, and the other side did not mind."""
    transfer.doubt = ""
    channel.lack(transfer, 2, "the toggle bit stays and both go on: a segment and its answer are missing", data=True)


def _asked(channel: SdoTracker, transfer: OpenTransfer, toggle: int, now: float) -> None:
    """The client asks for the next segment."""
    if transfer.turn == "server":
        if toggle == transfer.toggle:
            _again(channel, transfer, "the segment is asked for", now)
            return
        channel.lack(transfer, 1, "the next segment is asked for, and the last one is not in the recording", data=True)
    elif toggle != transfer.toggle and not transfer.doubt:
        transfer.doubt = "toggle"
    transfer.toggle, transfer.turn = toggle, "server"


def _answered(channel: SdoTracker, transfer: OpenTransfer, segment: SdoSegment) -> None:
    """The server sends a segment."""
    if transfer.turn == "client":
        if segment.toggle != transfer.toggle:
            if segment.data == transfer.previous:
                transfer.again += 1
            else:
                channel.broken("SDO-TOGGLE", "a segment that nobody asked for, with the bit of the last one")
            return
        channel.lack(transfer, 1, "a segment comes, and the request for it is not in the recording", data=False)
    elif segment.toggle != transfer.toggle:
        channel.broken("SDO-TOGGLE", f"asked with the bit {transfer.toggle}, answered with {segment.toggle}")
        return
    if transfer.doubt == "toggle":
        _pair_missing(channel, transfer)
    elif transfer.doubt == "unasked":
        transfer.doubt = ""
        channel.lack(transfer, 1, "segments, and the beginning of the transfer is not in the recording", data=True)
    transfer.previous = segment.data
    transfer.take(segment.data)
    transfer.toggle, transfer.turn = segment.toggle ^ 1, "client"
    if segment.last:
        channel.done()


def _sent(channel: SdoTracker, transfer: OpenTransfer, segment: SdoSegment, now: float) -> None:
    """The client sends a segment."""
    if transfer.turn == "server":
        if segment.toggle == transfer.toggle:
            _again(channel, transfer, "the segment is sent", now)
            return
        channel.lack(transfer, 1, "the next segment comes, and the last answer is not in the recording", data=False)
    elif segment.toggle != transfer.toggle:
        if segment.data == transfer.previous:
            _again(channel, transfer, "the segment is sent", now)
            transfer.toggle, transfer.turn = segment.toggle, "server"
            return
        transfer.doubt = transfer.doubt or "toggle"
    transfer.previous = segment.data
    transfer.take(segment.data)
    transfer.last = segment.last
    transfer.toggle, transfer.turn = segment.toggle, "server"


def _taken(channel: SdoTracker, transfer: OpenTransfer, toggle: int) -> None:
    """The server has taken a segment."""
    if transfer.turn == "client":
        if toggle != transfer.toggle:
            transfer.again += 1
            return
        channel.lack(transfer, 1, "a segment is confirmed that is not in the recording", data=True)
    elif toggle != transfer.toggle:
        channel.broken("SDO-TOGGLE", f"sent with the bit {transfer.toggle}, answered with {toggle}")
        return
    if transfer.doubt == "toggle":
        _pair_missing(channel, transfer)
    elif transfer.doubt == "unasked":
        transfer.doubt = ""
        channel.lack(transfer, 1, "segments, and the beginning of the transfer is not in the recording", data=True)
    transfer.toggle, transfer.turn = toggle ^ 1, "client"
    if transfer.last:
        channel.done()
