"""Read and write the objects of another node, as bytes or as values of their type.   [CiA 301, SDO]

Upload                                         server
40 | 6041h | 00 | 00 00 00 00      ->
                                   <-          4B | 6041h | 00 | 37 06 00 00          the value: 0637h
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

Download                                       server
2B | 6040h | 00 | 0F 00 00 00      ->
                                   <-          60 | 6040h | 00 | 00 00 00 00          done
                                   <-          80 | 6040h | 00 | 30 00 09 06          or an abort: SdoAbort

21 | 2100h | 00 | 09 00 00 00      ->                                                 9 bytes, in segments
                                   <-          60 | 2100h | 00 | 00 00 00 00
00 | 30 31 32 33 34 35 36          ->
                                   <-          20 | 00 ...                            and so on, toggling
1B | 37 38 00 00 00 00 00          ->                                                 the last one, 2 bytes
                                   <-          30 | 00 ...                            done

C6 | 2100h | 00 | 09 00 00 00      ->          in blocks

An object dictionary, your own or that of an EDS, gives objects names and types:

        "speed"  --find-->  60FFh:00 i32        DC 05 00 00  <--encode--  1500        write_object
                                                DC 05 00 00  --decode-->  1500        read_object
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias, TypeVar

from barewire.canopen.abort_codes import AbortCode, ProtocolViolation, SdoAbort
from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.block_transfer import BURST, FRAME, BlockReceiver, BlockSender
from barewire.canopen.sdo.channel import NOT_IN_USE, OUT_OF_STEP, SERVER_1, SERVERS_MAX, Channel, channel_to
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.canopen.sdo.messages import (
    ABORT,
    BLOCK_MAX,
    BLOCK_UPLOAD_RESPONSES,
    RECEIVER_MESSAGES,
    SEGMENT,
    UPLOAD_RESPONSES,
    BlockDownloadInitiated,
    BlockUploadInitiated,
    BlockUploadResponse,
    DownloadInitiated,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateBlockDownload,
    InitiateBlockUpload,
    InitiateDownload,
    InitiateUpload,
    M,
    NextSegment,
    SdoSegment,
    SegmentTaken,
    StartBlockUpload,
)
from barewire.canopen.sdo.stream import LIMIT, Incoming, Outgoing, SdoProgress
from barewire.canopen.sdo.transfer import ClientTransfer
from barewire.conversation import DEFAULT_TIMEOUT, Conversation, Heard, Listen
from barewire.errors import BarewireError, DecodeError, EncodeError, NoAnswer

if TYPE_CHECKING:
    from barewire.canopen.object_dictionary import Entry, ObjectDictionary, ObjectRef
    from barewire.codecs import Value

_T = TypeVar("_T")
_SegmentResponse = TypeVar("_SegmentResponse", SdoSegment, SegmentTaken)

EMPTY_SEGMENTS = 16
"""Segments without data, one after the other, after which an upload ends: such a server would never end it."""

_WORTH_IT = 28
"""The longest value, in bytes, that takes no more frames in segments than in blocks."""


class BlockSettings(NamedTuple):
    """Options of a block transfer; `block=True` stands for the defaults.

    size         segments in a block of an upload, 1 to 127; in a download the server decides
    crc          offer a CRC
    switch       protocol switch threshold: the server may send values of at most this many bytes without blocks
    falls_back   continue in segments if the server has no block transfer
    """

    size: int = BLOCK_MAX
    crc: bool = True
    switch: int = 0
    falls_back: bool = True


BlockMode: TypeAlias = BlockSettings | bool | Literal["auto"]
"""True requests blocks, False does not. "auto" requests them for values longer than 28 bytes or of unknown length,
until the server has refused a block transfer."""


def block_options(mode: BlockMode, channel: Channel, length: int | None = None) -> BlockSettings | None:
    """Return the options of a block transfer, None for no block transfer. `length` is that of the value, if known.

    >>> channel = Channel(5)
    >>> block_options(True, channel), block_options(False, channel)
    (BlockSettings(size=127, crc=True, switch=0, falls_back=True), None)
    >>> block_options("auto", channel, 4), block_options("auto", channel)
    (None, BlockSettings(size=127, crc=True, switch=28, falls_back=True))
    """
    if isinstance(mode, BlockSettings):
        return mode
    if isinstance(mode, str) and mode != "auto":
        raise EncodeError(f"block = {mode!r}: expected True, False, 'auto' or BlockSettings")
    if mode != "auto":
        return BlockSettings() if mode else None
    is_short = length is not None and length <= _WORTH_IT
    if is_short or not channel.blocks or channel.dialect.read_commands:
        return None
    return BlockSettings(switch=_WORTH_IT)


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

    With `Channel.retries` an upload that was lost is repeated. A size that the server indicated is never changed here,
    see `fit`. Responses with 42h are counted in
    `Channel.counters.unsized`.

    >>> from barewire.conversation import play
    >>> server = lambda frame, now: [(now + 0.001, CanFrame.parse("585#4B41600037060000"))]
    >>> play(upload(5, 0x6041), server)
    (b'7\\x06', 0.001)

    Raise EncodeError at once for arguments that cannot be encoded; in the conversation SdoAbort and NoAnswer.
    """
    channel = channel_to(node, dialect)
    parts: list[bytes] = []
    attempt = _joined(
        parts,
        upload_to(
            channel,
            index,
            sub,
            parts.append,
            timeout=timeout,
            size=size,
            block=block,
            limit=limit,
            progress=progress,
        ),
    )
    if not channel.retries:
        return attempt
    options = {"timeout": timeout, "size": size, "block": block, "limit": limit, "progress": progress}
    return repeated(partial(_attempt, channel, index, sub, **options), channel.retries, attempt)


def _attempt(channel: Channel, index: int, sub: int, **options: Any) -> Conversation[CanFrame, bytes]:
    parts: list[bytes] = []
    return _joined(parts, upload_to(channel, index, sub, parts.append, **options))


def repeated(
    transfer: Callable[[], Conversation[CanFrame, _T]],
    retries: int,
    first: Conversation[CanFrame, _T] | None = None,
) -> Conversation[CanFrame, _T]:
    """Carry out a transfer that may be repeated; after one that was lost, again. `first` is the first, if it began."""
    attempt = transfer() if first is None else first
    for _ in range(retries):
        try:
            return (yield from attempt)
        except (NoAnswer, SdoAbort) as error:
            if not _is_lost(error):
                raise
        attempt = transfer()
    return (yield from attempt)


def _is_lost(error: BarewireError) -> bool:
    """Return whether a frame of the transfer was lost: the response, or one in the middle of a long value."""
    return isinstance(error, NoAnswer) or getattr(error, "code", None) in OUT_OF_STEP


def rest_of_upload(
    channel: Channel, index: int, sub: int, *, timeout: float, size: int | None, limit: int | None, sent_at: float
) -> Conversation[CanFrame, bytes]:
    """Return the rest of an upload whose request was sent without a conversation: it listens for the response."""
    parts: list[bytes] = []
    request = InitiateUpload(index, sub, channel.dialect.read_command(size))
    transfer = ClientTransfer(channel, "upload", index, sub, timeout, sent_at)
    rest = _joined(parts, transfer.run(_upload(transfer, request, size, None, Incoming(parts.append, limit=limit))))
    again = partial(_attempt, channel, index, sub, timeout=timeout, size=size, limit=limit)
    return repeated(again, channel.retries, rest)


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
    options = block_options(block, channel)
    # Encoded here for the error, which shall come from the call and not from the conversation.
    request.encode()
    if options is not None:
        InitiateBlockUpload(index, sub, options.size, options.switch).encode()
    transfer = ClientTransfer(channel, "upload", index, sub, timeout)
    return transfer.run(_upload(transfer, request, size, options, Incoming(sink, limit=limit, progress=progress)))


def _upload(
    transfer: ClientTransfer, request: InitiateUpload, size: int | None, options: BlockSettings | None, value: Incoming
) -> Conversation[CanFrame, int]:
    response: BlockUploadResponse
    if options is None:
        response = yield from transfer.request(request, UPLOAD_RESPONSES)
    else:
        response = yield from _initiate_block_upload(transfer, request, options)
    if isinstance(response, ExpeditedUpload):
        data = response.data if response.indicated or size is None else response.data[:size]
        value.announce(len(data))
        value.add(data)
        return value.count
    value.announce(response.size)
    if isinstance(response, BlockUploadInitiated) and options is not None:
        yield from _upload_blocks(transfer, options, options.crc and response.crc, value)
    else:
        yield from _upload_segments(transfer, value)
    return value.count


def _initiate_block_upload(
    transfer: ClientTransfer, request: InitiateUpload, options: BlockSettings
) -> Conversation[CanFrame, BlockUploadResponse]:
    """Request blocks. A server without block transfers sends an abort, or the response to an ordinary upload."""
    initiate = InitiateBlockUpload(request.index, request.sub, options.size, options.switch, options.crc)
    response = yield from _request_blocks(transfer, initiate, BLOCK_UPLOAD_RESPONSES, options)
    if response is None:
        return (yield from transfer.request(request, UPLOAD_RESPONSES))
    if not isinstance(response, BlockUploadInitiated) and not options.falls_back:
        announced = len(response.data) if isinstance(response, ExpeditedUpload) else response.size
        if announced is None or announced > options.switch:
            raise ProtocolViolation(AbortCode.COMMAND, "an ordinary upload came instead of the requested blocks")
    return response


def _request_blocks(
    transfer: ClientTransfer,
    initiate: InitiateBlockUpload | InitiateBlockDownload,
    wanted: tuple[type[M], ...],
    options: BlockSettings,
) -> Conversation[CanFrame, M | None]:
    """Return the response to a request for blocks, None if the server has no blocks and segments will do."""
    transfer.requests_blocks = True
    try:
        return (yield from transfer.request(initiate, wanted))
    except SdoAbort as refusal:
        if not options.falls_back or refusal.code != AbortCode.COMMAND:
            raise
    transfer.channel.blocks = transfer.requests_blocks = False
    return None


def _request_segment(
    transfer: ClientTransfer, request: NextSegment | SdoSegment, wanted: type[_SegmentResponse], *, is_first: bool
) -> Conversation[CanFrame, _SegmentResponse]:
    """Return the response to a request of a segmented transfer, which must have the same toggle bit."""
    response = yield from transfer.request(request, (wanted,))
    if response.toggle != request.toggle and not is_first:
        # A bus may deliver a frame twice: this can be the previous response again.
        transfer.channel.counters.late += 1
        response = yield from transfer.response((wanted,))
    if response.toggle != request.toggle:
        text = f"the response has toggle bit {response.toggle}, the request has {request.toggle}"
        raise ProtocolViolation(AbortCode.TOGGLE, text)
    return response


def _upload_segments(transfer: ClientTransfer, value: Incoming) -> Conversation[CanFrame, None]:
    toggle, is_first, is_last, empty = 0, True, False, 0
    while not is_last:
        segment = yield from _request_segment(transfer, NextSegment(toggle), SdoSegment, is_first=is_first)
        value.add(segment.data)
        empty = 0 if segment.data else empty + 1
        if empty == EMPTY_SEGMENTS and not segment.last:
            raise ProtocolViolation(AbortCode.GENERAL, f"{empty} segments in a row have no data, and none is the last")
        toggle, is_first, is_last = toggle ^ 1, False, segment.last
    value.end()


def _upload_blocks(
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
                # The path of nearly every frame. `accept` has moved the deadline, but `listen` may keep the earlier
                # one: when that has passed, `feed` returns nothing and the new one is used.
                accepted += 1
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
            return transfer.run(_download_expedited(transfer, request))
        data, size = (whole,), len(whole)
    else:
        options = block_options(block, channel, size)
    announced = InitiateDownload(index, sub, size if indicated else None)
    announced.encode()
    value = Outgoing(data, size, progress)
    if options is None:
        return transfer.run(_download_segments(transfer, announced, value))
    return transfer.run(_download_blocks(transfer, announced, options, value))


def write_setting(
    channel: Channel, index: int, sub: int, data: bytes, *, timeout: float
) -> Conversation[CanFrame, None]:
    """Write an object for which the same value twice is the same as once; after a lost write read it, and if it has
    another value, or cannot be read, write it again, as often as `Channel.retries`. A plain `download` is never
    repeated: what it writes may be a command."""
    for left in range(channel.retries, -1, -1):
        try:
            return (yield from download(channel, index, sub, data, timeout=timeout))
        except (NoAnswer, SdoAbort) as error:
            if not left or not _is_lost(error):
                raise
        try:
            present = yield from upload(channel, index, sub, size=len(data), timeout=timeout)
        except SdoAbort:
            continue
        if present == data:
            return None


def rest_of_download(
    channel: Channel, index: int, sub: int, data: bytes, *, timeout: float, sent_at: float
) -> Conversation[CanFrame, None]:
    """Return the rest of a download whose only request was sent without a conversation: it listens for the response."""
    transfer = ClientTransfer(channel, "download", index, sub, timeout, sent_at)
    return transfer.run(_download_expedited(transfer, ExpeditedDownload(index, sub, data)))


def _download_expedited(transfer: ClientTransfer, request: ExpeditedDownload) -> Conversation[CanFrame, None]:
    yield from transfer.request(request, (DownloadInitiated,))


def _download_segments(
    transfer: ClientTransfer, request: InitiateDownload, value: Outgoing
) -> Conversation[CanFrame, None]:
    yield from transfer.request(request, (DownloadInitiated,))
    toggle, is_first, is_last = 0, True, False
    while not is_last:
        data = value.take(SEGMENT)
        is_last = value.exhausted
        yield from _request_segment(transfer, SdoSegment(toggle, data, is_last), SegmentTaken, is_first=is_first)
        toggle, is_first = toggle ^ 1, False


def _download_blocks(
    transfer: ClientTransfer, request: InitiateDownload, options: BlockSettings, value: Outgoing
) -> Conversation[CanFrame, None]:
    initiate = InitiateBlockDownload(request.index, request.sub, request.size, options.crc)
    response = yield from _request_blocks(transfer, initiate, (BlockDownloadInitiated,), options)
    if response is None:
        return (yield from _download_segments(transfer, request, value))
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


def read_object(
    node: int | Channel,
    objects: ObjectDictionary,
    place: ObjectRef,
    *,
    timeout: float = DEFAULT_TIMEOUT,
    dialect: SdoDialect | None = None,
    block: BlockMode = False,
) -> Conversation[CanFrame, Value]:
    """Read the value of an object, given by its name, its index, or (index, sub-index).

    >>> from barewire.canopen.object_dictionary import Entry, ObjectDictionary
    >>> from barewire.conversation import play
    >>> objects = ObjectDictionary([Entry(0x60FF, 0, "speed", "i32")])
    >>> server = lambda frame, now: [(now + 0.001, CanFrame.parse("585#43FF600024FAFFFF"))]
    >>> play(read_object(5, objects, "speed"), server)
    (-1500, 0.001)

    Raise EncodeError for an object that the dictionary does not have; in the conversation SdoAbort, NoAnswer, and
    DecodeError for bytes that are not a value of the type.
    """
    entry = objects.at(place)
    transfer = upload(
        node, entry.index, entry.sub, size=entry.codec.size, timeout=timeout, dialect=dialect, block=block
    )
    return decoded(transfer, partial(decoded_value, entry))


def decoded(transfer: Conversation[CanFrame, bytes], decode: Callable[[bytes], _T]) -> Conversation[CanFrame, _T]:
    """Return the conversation of an upload whose result is decoded."""
    data = yield from transfer
    return decode(data)


def write_object(
    node: int | Channel,
    objects: ObjectDictionary,
    place: ObjectRef,
    value: Value,
    *,
    timeout: float = DEFAULT_TIMEOUT,
    dialect: SdoDialect | None = None,
    block: BlockMode = False,
) -> Conversation[CanFrame, None]:
    """Write a value to an object; the device checks access rights and limits.

    Raise EncodeError at once for a value that its type cannot have; in the conversation SdoAbort and NoAnswer.
    """
    entry = objects.at(place)
    data = encoded_value(entry, value)
    return download(node, entry.index, entry.sub, data, timeout=timeout, dialect=dialect, block=block)


def decoded_value(entry: Entry, data: bytes) -> Value:
    """Return the value of this object. Raise DecodeError for bytes that are not of its type."""
    try:
        return entry.codec.decode(data)
    except DecodeError as error:
        error.add_note(f"{entry.name} is {entry.type} in the dictionary, but the device sent this")
        raise


def encoded_value(entry: Entry, value: Value) -> bytes:
    """Return the bytes of a value of this object. Raise EncodeError for a value that its type cannot have."""
    try:
        return entry.codec.encode(value)
    except EncodeError as error:
        raise EncodeError(f"{entry.name}: {error}", entry.name) from None


def find_channel(default: Channel, server: int, *, timeout: float = DEFAULT_TIMEOUT) -> Conversation[CanFrame, Channel]:
    """Return the channel to server number `server` of a device, read over its default channel, which is number 1.

        1201h ... 127Fh, server 2 ... 128:      01  COB-ID client -> server     02  COB-ID server -> client

    Raise SdoAbort if there is no such server, and EncodeError if its channel is not in use: bit 31 of a COB-ID is set,
    or its identifier is restricted, such as 0.
    """
    if not 1 <= server <= SERVERS_MAX:
        raise EncodeError(f"SDO server {server}: expected 1..{SERVERS_MAX}")
    return _find_channel(default, server, timeout)


def _find_channel(default: Channel, server: int, timeout: float) -> Conversation[CanFrame, Channel]:
    if server == 1:
        return default
    index = SERVER_1 + server - 1
    cob_ids = []
    for sub in (1, 2):
        word = yield from upload(default, index, sub, timeout=timeout, size=4)
        cob_ids.append(CobEntry.unpack(int.from_bytes(word[:4], "little")))
    if not all(entry.carries_sdo for entry in cob_ids):
        raise EncodeError(f"SDO server {server} of node {default.node} is not in use: {index:04X}h {NOT_IN_USE}")
    channel = Channel(
        default.node,
        default.dialect,
        cob_ids=(cob_ids[0], cob_ids[1]),
        node_monitor=default.node_monitor,
        own_frames=default.own_frames,
    )
    channel.timeout, channel.retries = default.timeout, default.retries
    return channel
