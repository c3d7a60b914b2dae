"""Follows segmented SDO transfers; the toggle bit shows missing and repeated frames.   [CiA 301, SDO segments]

client  60  70  60  70          server  00  10  00  11          the bit alternates, the answer repeats it

next bit, no answer in between    the answer is missing in the recording, because the client needs it to go on
same bit and same bytes again     a frame was lost on the bus, and the segment is repeated
bit not alternated                if the other side goes on, two frames are missing in the recording;
                                  if it aborts with 0503 0000h, a rule was broken
"""

from __future__ import annotations

from barewire.canopen.sdo.messages import NextSegment, SdoSegment, SegmentTaken
from barewire_workbench.monitor.channel_state import ChannelState
from barewire_workbench.monitor.events import Loss
from barewire_workbench.monitor.transfer import OpenTransfer, SdoSide


def feed_segment(
    channel: ChannelState, sender: SdoSide, message: NextSegment | SdoSegment | SegmentTaken, now: float
) -> None:
    """Take a frame of a segmented transfer, in either direction."""
    uploads = isinstance(message, NextSegment) or (sender == "server" and isinstance(message, SdoSegment))
    transfer = _transfer(channel, "upload" if uploads else "download", message)
    if isinstance(message, NextSegment):
        _upload_requested(channel, transfer, message.toggle, now)
    elif isinstance(message, SegmentTaken):
        _download_confirmed(channel, transfer, message.toggle)
    elif sender == "server":
        _uploaded(channel, transfer, message)
    else:
        _downloaded(channel, transfer, message, now)


def _transfer(channel: ChannelState, direction: str, message: NextSegment | SdoSegment | SegmentTaken) -> OpenTransfer:
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
    if _continues(channel.interrupted, direction, message):
        channel.go_on_interrupted()
        assert channel.open is not None
        return channel.open
    unrecorded = channel.begin_unrecorded("upload" if direction == "upload" else "download", "segmented")
    unrecorded.toggle = message.toggle
    unrecorded.next_sender = "client" if isinstance(message, NextSegment) else "server"
    if isinstance(message, SdoSegment) and direction == "download":
        unrecorded.next_sender = "client"
    return unrecorded


def _continues(
    interrupted: tuple[OpenTransfer, object] | None,
    direction: str,
    message: NextSegment | SdoSegment | SegmentTaken,
) -> bool:
    """Return whether the frame is the next one of the transfer that another request interrupted."""
    if interrupted is None or interrupted[1] is not None:
        return False
    transfer = interrupted[0]
    sender = "server" if isinstance(message, SegmentTaken) else "client"
    if isinstance(message, SdoSegment) and direction == "upload":
        sender = "server"
    return (transfer.manner, transfer.direction, transfer.toggle, transfer.next_sender) == (
        *("segmented", direction, message.toggle),
        sender,
    )


def _repeated(channel: ChannelState, transfer: OpenTransfer, how: str, now: float) -> None:
    """Report a repeated segment or request: a frame was lost on the bus."""
    transfer.repeats += 1
    transfer.lost += 1
    channel.events.append(Loss(now, channel.node, 1, f"the segment is {how} again: it or its answer did not arrive"))


def _upload_requested(channel: ChannelState, transfer: OpenTransfer, toggle: int, now: float) -> None:
    """Take the client's request for the next segment."""
    if transfer.next_sender == "server":
        if toggle == transfer.toggle:
            _repeated(channel, transfer, "requested", now)
            return
        text = "the next segment is requested, but the last one is not in the recording"
        channel.report_missing(transfer, 1, text, "SDO-OVERLAP", data=True)
    elif toggle != transfer.toggle and not transfer.doubt:
        transfer.doubt = "toggle"
    transfer.toggle, transfer.next_sender = toggle, "server"


def _uploaded(channel: ChannelState, transfer: OpenTransfer, segment: SdoSegment) -> None:
    """Take a segment from the server."""
    if transfer.next_sender == "client":
        if segment.toggle != transfer.toggle:
            if segment.data == transfer.previous:
                transfer.repeats += 1
            else:
                channel.violation("SDO-TOGGLE", "a segment that was not requested, with the toggle bit of the last one")
            return
        text = "a segment arrives, but the request for it is not in the recording"
        channel.report_missing(transfer, 1, text, "SDO-UNASKED", data=False)
    elif segment.toggle != transfer.toggle:
        text = f"requested with toggle bit {transfer.toggle}, answered with {segment.toggle}"
        channel.violation("SDO-TOGGLE", text)
        return
    channel.settle_doubt(transfer)
    transfer.previous = segment.data
    transfer.take(segment.data)
    transfer.toggle, transfer.next_sender = segment.toggle ^ 1, "client"
    if segment.last:
        channel.done(transfer)


def _downloaded(channel: ChannelState, transfer: OpenTransfer, segment: SdoSegment, now: float) -> None:
    """Take a segment from the client."""
    if transfer.next_sender == "server":
        if segment.toggle == transfer.toggle and segment.data == transfer.previous:
            _repeated(channel, transfer, "sent", now)
            return
        if segment.toggle == transfer.toggle:
            text = "another segment with the same toggle bit: the segment between them and two answers are missing"
            channel.report_missing(transfer, 3, text, "SDO-TOGGLE", data=True)
        else:
            text = "the next segment arrives, but the last answer is not in the recording"
            channel.report_missing(transfer, 1, text, "SDO-OVERLAP", data=False)
    elif segment.toggle != transfer.toggle:
        if segment.data == transfer.previous:
            _repeated(channel, transfer, "sent", now)
            transfer.toggle, transfer.next_sender = segment.toggle, "server"
            return
        transfer.doubt = transfer.doubt or "toggle"
    transfer.previous = segment.data
    transfer.take(segment.data)
    transfer.last_sent = segment.last
    transfer.toggle, transfer.next_sender = segment.toggle, "server"


def _download_confirmed(channel: ChannelState, transfer: OpenTransfer, toggle: int) -> None:
    """Take the server's confirmation of a segment."""
    if transfer.next_sender == "client":
        if toggle != transfer.toggle:
            transfer.repeats += 1
            return
        channel.report_missing(
            transfer, 1, "a segment is confirmed that is not in the recording", "SDO-UNASKED", data=True
        )
    elif toggle != transfer.toggle:
        channel.violation("SDO-TOGGLE", f"sent with toggle bit {transfer.toggle}, answered with {toggle}")
        return
    channel.settle_doubt(transfer)
    transfer.toggle, transfer.next_sender = toggle ^ 1, "client"
    if transfer.last_sent:
        channel.done(transfer)
