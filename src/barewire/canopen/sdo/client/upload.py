"""Read an object of another node.   [CiA 301, SDO upload]

client                                         server
40 | 6041h | 00 | 00 00 00 00      ->
                                   <-          4B | 6041h | 00 | 37 06 00 00          the value itself
                                   <-          80 | 6041h | 00 | 00 00 02 06          or an abort: SdoAbort

40 | 1008h | 00 | 00 00 00 00      ->
                                   <-          41 | 1008h | 00 | 10 00 00 00          16 bytes, in segments
60 | 00 ...                        ->
                                   <-          00 | 43 41 4E 6F 70 65 6E
70 | 00 ...                        ->                                                 and so on, toggling
                                   <-          10 | 44 65 6D 6F 50 49 43
60 | 00 ...                        ->
                                   <-          0B | 33 32 00 00 00 00 00              the last one, 2 bytes

A4 | 1008h | 00 | 7F 00 00 00      ->          in blocks: see `block_transfer`
"""

from __future__ import annotations

from collections.abc import Callable

from barewire.canopen.abort_codes import AbortCode, ProtocolViolation, SdoAbort
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.block_transfer import FRAME, BlockReceiver
from barewire.canopen.sdo.client.block_options import BlockMode, BlockSettings, block_options
from barewire.canopen.sdo.client.channel import Channel, channel_to
from barewire.canopen.sdo.client.transfer import ABORT, ClientTransfer
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.canopen.sdo.messages import (
    BLOCK_UPLOAD_RESPONSES,
    UPLOAD_RESPONSES,
    BlockUploadInitiated,
    BlockUploadResponse,
    ExpeditedUpload,
    InitiateBlockUpload,
    InitiateUpload,
    NextSegment,
    SdoSegment,
    StartBlockUpload,
)
from barewire.canopen.sdo.stream import LIMIT, Incoming, SdoProgress
from barewire.conversation import DEFAULT_TIMEOUT, Conversation, Heard, Listen

EMPTY_SEGMENTS = 16
"""Segments without data, one after the other, after which an upload ends: such a server would never end it."""


def upload(
    node: int | Channel,
    index: int,
    sub: int = 0,
    *,
    timeout: float = DEFAULT_TIMEOUT,
    size: int | None = None,
    dialect: SdoDialect | None = None,
    block: BlockMode = False,
    limit: int | None = LIMIT,
    progress: SdoProgress | None = None,
) -> Conversation[CanFrame, bytes]:
    """Read the bytes of object `index`:`sub`, little-endian as received, as many as the server indicated.

        timeout    seconds to wait for each response
        size       bytes of the object's type, if known; used if the dialect requests an object by its size, and if the
                   server responds with 42h, four bytes without their number: the low `size` bytes are then the value
        dialect    the SDO dialect of the server
        block      request a block transfer, which is several times faster for long values; with "auto" the server
                   decides by the length
        limit      a longer value, in bytes, is refused; None: no limit
        progress   called with the number of bytes so far and their total, None if it is unknown

    A size that the server indicated is never changed here, see `fit`. Responses with 42h are counted in
    `Channel.counters.unsized`.

    >>> from barewire.conversation import play
    >>> server = lambda frame, now: [(now + 0.001, CanFrame.parse("585#4B41600037060000"))]
    >>> play(upload(5, 0x6041), server)
    (b'7\\x06', 0.001)

    Raise EncodeError at once for arguments that cannot be encoded; in the conversation SdoAbort and NoAnswer.
    """
    parts: list[bytes] = []
    count = upload_to(
        node,
        index,
        sub,
        parts.append,
        timeout=timeout,
        size=size,
        dialect=dialect,
        block=block,
        limit=limit,
        progress=progress,
    )
    return _joined(parts, count)


def rest_of_upload(
    channel: Channel, index: int, sub: int, *, timeout: float, size: int | None, limit: int | None, sent_at: float
) -> Conversation[CanFrame, bytes]:
    """Return the rest of an upload whose request was sent without a conversation: it listens for the response."""
    parts: list[bytes] = []
    request = InitiateUpload(index, sub, channel.dialect.read_command(size))
    transfer = ClientTransfer(channel, "upload", index, sub, timeout, sent_at)

    def incoming(announced: int | None) -> Incoming:
        return Incoming(parts.append, announced, limit=limit)

    return _joined(parts, transfer.run(_upload(transfer, request, size, None, incoming)))


def _joined(parts: list[bytes], count: Conversation[CanFrame, int]) -> Conversation[CanFrame, bytes]:
    yield from count
    return parts[0] if len(parts) == 1 else b"".join(parts)


def upload_to(
    node: int | Channel,
    index: int,
    sub: int,
    sink: Callable[[bytes], object],
    *,
    timeout: float = DEFAULT_TIMEOUT,
    size: int | None = None,
    dialect: SdoDialect | None = None,
    block: BlockMode = False,
    limit: int | None = None,
    progress: SdoProgress | None = None,
) -> Conversation[CanFrame, int]:
    """Read an object as `upload` does, but pass each part to `sink` as it arrives; return the number of bytes.

    The value is valid only when the conversation has returned: size and CRC are checked at the end.

    >>> from barewire.conversation import play
    >>> server = lambda frame, now: [(now + 0.001, CanFrame.parse("585#4B41600037060000"))]
    >>> play(upload_to(5, 0x6041, 0, lambda part: print(part.hex())), server)
    3706
    (2, 0.001)
    """
    channel = channel_to(node, dialect)
    request = InitiateUpload(index, sub, channel.dialect.read_command(size))
    request.encode()
    options = block_options(block, channel)
    if options is not None:
        InitiateBlockUpload(index, sub, options.size, options.switch).encode()
    transfer = ClientTransfer(channel, "upload", index, sub, timeout)

    def incoming(announced: int | None) -> Incoming:
        return Incoming(sink, announced, limit=limit, progress=progress)

    return transfer.run(_upload(transfer, request, size, options, incoming))


def _upload(
    transfer: ClientTransfer,
    request: InitiateUpload,
    size: int | None,
    options: BlockSettings | None,
    incoming: Callable[[int | None], Incoming],
) -> Conversation[CanFrame, int]:
    response: BlockUploadResponse
    if options is None:
        response = yield from transfer.request(request, UPLOAD_RESPONSES)
    else:
        response = yield from _request_blocks(transfer, request, options)
    if isinstance(response, ExpeditedUpload):
        data = response.data if response.indicated or size is None else response.data[:size]
        value = incoming(len(data))
        value.add(data)
        return value.count
    value = incoming(response.size)
    if isinstance(response, BlockUploadInitiated) and options is not None:
        crc = options.crc and response.crc
        yield from _in_blocks(transfer, options, crc, value)
    else:
        yield from _in_segments(transfer, value)
    return value.count


def _request_blocks(
    transfer: ClientTransfer, request: InitiateUpload, options: BlockSettings
) -> Conversation[CanFrame, BlockUploadResponse]:
    """Request blocks. A server without block transfers sends an abort, or the response to an ordinary upload."""
    index, sub = request.index, request.sub
    initiate = InitiateBlockUpload(index, sub, options.size, options.switch, options.crc)
    transfer.requests_blocks = True
    try:
        response = yield from transfer.request(initiate, BLOCK_UPLOAD_RESPONSES)
    except SdoAbort as refusal:
        if not options.falls_back or refusal.code != AbortCode.COMMAND:
            raise
        transfer.channel.blocks = transfer.requests_blocks = False
        return (yield from transfer.request(request, UPLOAD_RESPONSES))
    if not isinstance(response, BlockUploadInitiated) and not options.falls_back:
        announced = len(response.data) if isinstance(response, ExpeditedUpload) else response.size
        if announced is None or announced > options.switch:
            raise ProtocolViolation(AbortCode.COMMAND, "an ordinary upload came instead of the requested blocks")
    return response


def _in_segments(transfer: ClientTransfer, value: Incoming) -> Conversation[CanFrame, None]:
    toggle, first, last, empty = 0, True, False, 0
    while not last:
        segment = yield from transfer.request(NextSegment(toggle), (SdoSegment,))
        if segment.toggle != toggle and not first:
            # A bus may deliver a frame twice: this can be the previous response again.
            transfer.channel.counters.late += 1
            segment = yield from transfer.response((SdoSegment,))
        if segment.toggle != toggle:
            raise ProtocolViolation(
                AbortCode.TOGGLE, f"the response has toggle bit {segment.toggle}, the request has {toggle}"
            )
        value.add(segment.data)
        empty = 0 if segment.data else empty + 1
        if empty == EMPTY_SEGMENTS and not segment.last:
            raise ProtocolViolation(AbortCode.GENERAL, f"{empty} segments in a row have no data, and none is the last")
        toggle, first, last = toggle ^ 1, False, segment.last
    value.end()


def _in_blocks(
    transfer: ClientTransfer, options: BlockSettings, crc: bool, value: Incoming
) -> Conversation[CanFrame, None]:
    transfer.in_blocks = True
    yield from transfer.send_request(StartBlockUpload().encode())
    channel = transfer.channel
    identifier, extended = channel.response_id, channel.response_extended
    receiver = BlockReceiver(value, options.size, crc=crc, timeout=transfer.timeout, now=transfer.now)
    accept, accepted = receiver.accept, 0
    listen = Listen(receiver.deadline)
    heard: Heard[CanFrame] = Heard(None, transfer.now)
    try:
        while not receiver.over:
            heard = yield listen
            frame = heard.item
            if (
                frame is not None
                and frame.id == identifier
                and frame.extended == extended
                and not frame.remote
                and accept(frame.data, heard.now)
            ):
                accepted += 1  # the path of nearly every frame; a later deadline is noticed when the old one has passed
                continue
            transfer.now = heard.now
            data = None if frame is None else channel.receive(frame)
            if data is not None and (len(data) < FRAME or data[0] == ABORT):
                data = _padded(transfer, data)
            for response in receiver.feed(data, heard.now):
                yield from transfer.send_request(response)
            if listen.until != receiver.deadline:
                listen = Listen(receiver.deadline)
    finally:
        transfer.now = max(transfer.now, heard.now)
        channel.counters.responses += accepted


def _padded(transfer: ClientTransfer, data: bytes) -> bytes | None:
    """Pad a segment that a device has sent without its trailing zeros. Raise SdoAbort if the frame is an abort.

    Return None for a frame without data, or an abort that cannot be decoded.
    """
    if not data:
        transfer.channel.counters.garbled += 1
        return None
    checked = transfer.check_abort(data)
    if checked is None or len(checked) == FRAME:
        return checked
    transfer.channel.counters.short += 1
    return checked.ljust(FRAME, b"\0")
