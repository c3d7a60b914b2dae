"""Write an object of another node.   [CiA 301, SDO download]

client                                         server
2B | 6040h | 00 | 0F 00 00 00      ->
                                   <-          60 | 6040h | 00 | 00 00 00 00          done
                                   <-          80 | 6040h | 00 | 30 00 09 06          or an abort: SdoAbort

21 | 2100h | 00 | 09 00 00 00      ->                                                 9 bytes, in segments
                                   <-          60 | 2100h | 00 | 00 00 00 00
00 | 30 31 32 33 34 35 36          ->
                                   <-          20 | 00 ...                            and so on, toggling
1B | 37 38 00 00 00 00 00          ->                                                 the last one, 2 bytes
                                   <-          30 | 00 ...                            done

C6 | 2100h | 00 | 09 00 00 00      ->          in blocks: see `block`
"""

from __future__ import annotations

from collections.abc import Iterable

from barewire.canopen.abort_codes import AbortCode, ProtocolViolation, SdoAbort
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.block_transfer import BURST, BlockSender
from barewire.canopen.sdo.client.block_options import BlockMode, BlockSettings, block_options
from barewire.canopen.sdo.client.channel import Channel, channel_to
from barewire.canopen.sdo.client.transfer import ClientTransfer
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.canopen.sdo.messages import (
    RECEIVER_MESSAGES,
    SEGMENT,
    BlockDownloadInitiated,
    DownloadInitiated,
    ExpeditedDownload,
    InitiateBlockDownload,
    InitiateDownload,
    SdoSegment,
    SegmentTaken,
)
from barewire.canopen.sdo.stream import Outgoing, SdoProgress
from barewire.conversation import DEFAULT_TIMEOUT, Conversation, Heard, Listen
from barewire.errors import EncodeError


def download(
    node: int | Channel,
    index: int,
    sub: int,
    data: bytes | Iterable[bytes],
    *,
    timeout: float = DEFAULT_TIMEOUT,
    size: int | None = None,
    indicated: bool = True,
    dialect: SdoDialect | None = None,
    block: BlockMode = False,
    progress: SdoProgress | None = None,
) -> Conversation[CanFrame, None]:
    """Write `data`, little-endian, to object `index`:`sub`.

        data        1 to 4 bytes are sent in one frame, more (or none) in segments or blocks; it may also be an iterable
                    of pieces, which are read as they are sent
        timeout     seconds to wait for each response
        size        the sum of the pieces in bytes, if it is known
        indicated   False: the request does not state the size; of four bytes the server uses as many low ones as its
                    object has (22h), of segments as many as arrive
        dialect     the SDO dialect of the server
        block       request a block transfer, which is several times faster for long values
        progress    called with the number of bytes so far and their total, None if it is unknown

    The request is never repeated: after NoAnswer it is unknown whether the server has written the value.

    >>> from barewire.conversation import play
    >>> server = lambda frame, now: [(now + 0.001, CanFrame.parse("585#6040600000000000"))]
    >>> play(download(5, 0x6040, 0, b"\\x0f\\x00"), server)
    (None, 0.001)

    Raise EncodeError at once for arguments that cannot be encoded; in the conversation SdoAbort and NoAnswer, and
    EncodeError if the pieces are not `size` bytes.
    """
    channel = channel_to(node, dialect)
    transfer = ClientTransfer(channel, "download", index, sub, timeout)
    if isinstance(data, str):
        raise EncodeError(f"{data!r} is text: an object takes bytes, or pieces of bytes")
    if not isinstance(data, Iterable):
        expected = "an object takes bytes, as many as its type has, such as (1500).to_bytes(4, 'little')"
        raise EncodeError(f"{data!r} is not bytes: {expected}")
    if isinstance(data, (bytes, bytearray, memoryview)):
        whole = bytes(data)
        options = block_options(block, channel, len(whole))
        if options is None and 1 <= len(whole) <= 4 and (indicated or len(whole) == 4):
            request = ExpeditedDownload(index, sub, whole, indicated)
            request.encode()
            return transfer.run(_in_one_frame(transfer, request))
        data, size = (whole,), len(whole)
    else:
        options = block_options(block, channel, size)
    announced = InitiateDownload(index, sub, size if indicated else None)
    announced.encode()
    value = Outgoing(data, size, progress)
    if options is None:
        return transfer.run(_in_segments(transfer, announced, value))
    return transfer.run(_in_blocks(transfer, announced, options, value))


def rest_of_download(
    channel: Channel, index: int, sub: int, data: bytes, *, timeout: float, sent_at: float
) -> Conversation[CanFrame, None]:
    """Return the rest of a download whose only request was sent without a conversation: it listens for the response."""
    transfer = ClientTransfer(channel, "download", index, sub, timeout, sent_at)
    return transfer.run(_in_one_frame(transfer, ExpeditedDownload(index, sub, data)))


def _in_one_frame(transfer: ClientTransfer, request: ExpeditedDownload) -> Conversation[CanFrame, None]:
    yield from transfer.request(request, (DownloadInitiated,))


def _in_segments(transfer: ClientTransfer, request: InitiateDownload, value: Outgoing) -> Conversation[CanFrame, None]:
    yield from transfer.request(request, (DownloadInitiated,))
    toggle, first, last = 0, True, False
    while not last:
        data = value.take(SEGMENT)
        last = value.exhausted
        taken = yield from transfer.request(SdoSegment(toggle, data, last), (SegmentTaken,))
        if taken.toggle != toggle and not first:
            # A bus may deliver a frame twice: this can be the previous response again.
            transfer.channel.counters.late += 1
            taken = yield from transfer.response((SegmentTaken,))
        if taken.toggle != toggle:
            raise ProtocolViolation(
                AbortCode.TOGGLE, f"the response has toggle bit {taken.toggle}, the segment has {toggle}"
            )
        toggle, first = toggle ^ 1, False


def _in_blocks(
    transfer: ClientTransfer, request: InitiateDownload, options: BlockSettings, value: Outgoing
) -> Conversation[CanFrame, None]:
    initiate = InitiateBlockDownload(request.index, request.sub, request.size, options.crc)
    transfer.requests_blocks = True
    try:
        response = yield from transfer.request(initiate, (BlockDownloadInitiated,))
    except SdoAbort as refusal:
        if not options.falls_back or refusal.code != AbortCode.COMMAND:
            raise
        transfer.channel.blocks = transfer.requests_blocks = False
        return (yield from _in_segments(transfer, request, value))
    crc = options.crc and response.crc
    sender = BlockSender(value, response.blksize, crc=crc, timeout=transfer.timeout, burst=BURST, now=transfer.now)
    frames = sender.feed(None, transfer.now)
    while not sender.over:
        if frames:
            sent: Heard[CanFrame] = yield transfer.send_all(frames)
            transfer.now = sent.now
        transfer.until = transfer.now + transfer.timeout
        # In the middle of a block the deadline is now: read a waiting frame if there is one, and go on.
        heard: Heard[CanFrame] = yield Listen(sender.deadline)
        transfer.now = heard.now
        try:
            data = None if heard.item is None else transfer.receive(heard.item)
        except SdoAbort:
            # The server may mistake the segments still in transit for requests, and respond to them.
            transfer.stay_quiet()
            raise
        message = None if data is None else transfer.channel.decode(data, RECEIVER_MESSAGES)
        frames = sender.feed(message, heard.now)
