"""The SDO server: a machine that responds to frames from an object dictionary.   [CiA 301, SDO]

        received on 600h+n                            sent on 580h+n
        ------------------                            --------------
        40  upload                                    4F 4B 47 43   the value, 1 to 4 bytes
                                                      41            a longer (or empty) value follows in segments
        2F 2B 27 23  download, size indicated         60            written
        22           download, size not indicated     60            written: as many low bytes as the object has
        21 20        download in segments             60            ready for the first segment
        A4 A0        upload in blocks                 C6            ready, waiting for the start
        C6 C4 C2 C0  download in blocks               A4            ready for the first block
        80  abort                                     nothing: an abort is never answered
        any other command                             80  0504 0001h, with the object of that frame
        not 8 bytes, remote, other identifier         nothing: counted

There is one transfer at a time; four kinds take more than one frame:

        SegmentedUpload      60 70 ...           -> 00 10 ... the bytes             the value at the time of the request
        SegmentedDownload    00 10 ... bytes     -> 20 30                           written to the dictionary at the end
        BlockUpload          A3, A2, A1          -> 01 02 03 ..., C1                with a BlockSender
        BlockDownload        01 02 03 ..., C1    -> A2, A1                          with a BlockReceiver

A request for another one replaces it: its client has given up the first, or a late request began one for which no
client waits. Inside a block such a frame is a segment. Any other frame that is not the next one ends the transfer with
0504 0001h. If the client sends nothing for `timeout` seconds, it ends with 0504 0000h.

CAN may deliver a frame twice. A repeat of the frame that ended the last transfer is ignored for `timeout` seconds: an
abort for it would reach the client in its next transfer.

The dictionary refuses an access by raising SdoAbort, and the server sends its code. Reserved bits in a command are
ignored, as the standard requires, and counted as a deviation; so read requests that repeat the command of the response
(4F, 4B, 43) are served too.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from barewire.canopen.abort_codes import AbortCode, ProtocolViolation, SdoAbort
from barewire.canopen.cob_ids import CobEntry, default_sdo_channel
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.block_transfer import BURST, BlockReceiver, BlockSender, check_blksize
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.canopen.sdo.messages import (
    ABORT,
    BLOCK_MAX,
    LAST,
    OBJECT_LAYOUT,
    RECEIVER_MESSAGES,
    SEGMENT,
    Abort,
    BlockDownloadInitiated,
    BlockEnded,
    BlockUploadInitiated,
    DownloadInitiated,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateBlockDownload,
    InitiateBlockUpload,
    InitiateDownload,
    InitiateUpload,
    M,
    NextSegment,
    SdoRequest,
    SdoSegment,
    SegmentTaken,
    StartBlockUpload,
    UploadInitiated,
    decode_one_of,
    decode_sdo_request,
    has_reserved_bits,
)
from barewire.canopen.sdo.stream import LIMIT, Incoming, Outgoing
from barewire.conversation import DEFAULT_TIMEOUT
from barewire.errors import BarewireError, DecodeError, EncodeError

_BLOCK_ENDED = BlockEnded().encode()
_Write = Callable[[bytes], None]
"""Writes a whole value, or refuses it by raising SdoAbort."""


class ObjectStore(Protocol):
    """The part of an object dictionary that a server uses. Its methods raise SdoAbort to refuse an access."""

    def size(self, index: int, sub: int) -> int | None:
        """Return the number of bytes of the object, None if it varies."""

    def read(self, index: int, sub: int) -> bytes:
        """Return the value, little-endian."""

    def may_write(self, index: int, sub: int, size: int | None) -> None:
        """Raise SdoAbort if a download of `size` bytes (None: unknown) would be refused whatever its bytes are.

        It is called before a download in segments or blocks, so that no megabyte is transferred in vain."""

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Write a value."""


@dataclass(slots=True)
class ServerCounters:
    """Counts what a server received and sent."""

    requests: int = 0  # frames of 8 bytes from the client
    wrong_length: int = 0  # frames with a DLC other than 8, ignored
    unknown_command: int = 0
    reserved_bits: int = 0  # requests served although reserved bits were set
    aborts_received: int = 0
    aborts_sent: int = 0
    timed_out: int = 0  # of `aborts_sent`: because the client sent nothing for too long
    strays: int = 0  # ignored: segments after the abort of a block download, repeats of the last frame of a transfer
    replaced: int = 0  # transfers that a request for another one ended


class ServerTransfer(Protocol):
    """A transfer that has begun. A machine: at its `deadline` it must be fed None.

    For a frame that is not allowed in its present state `feed` raises ProtocolViolation or SdoAbort.
    """

    over: bool

    @property
    def deadline(self) -> float: ...

    @property
    def next_segment(self) -> int:
        """The number of the next block segment; 0 if none is expected."""

    def gives_way(self, data: bytes) -> bool:
        """Return whether a frame that looks like the request for a new transfer is one, and replaces this transfer."""

    def accept(self, data: bytes, now: float) -> bool:
        """Accept the next segment inside a block, which needs no response; see `BlockReceiver`."""

    def feed(self, data: bytes | None, now: float) -> list[bytes]: ...


def _expect(data: bytes, *types: type[M]) -> M:
    """Decode a message of one of these types; any other frame ends the transfer."""
    try:
        return decode_one_of(data, types)
    except DecodeError as error:
        raise ProtocolViolation(AbortCode.COMMAND, error.text) from None


def _check_timeout(now: float, deadline: float) -> list[bytes]:
    if now >= deadline:
        raise ProtocolViolation(AbortCode.TIMED_OUT, "the client was silent")
    return []


class _Responding:
    """A transfer that responds to every frame, so no frame is accepted in silence, and none can be two things."""

    __slots__ = ("_timeout", "deadline", "over")
    next_segment = 0

    def __init__(self, timeout: float, now: float) -> None:
        self._timeout = timeout
        self.deadline = now + timeout
        self.over = False

    def gives_way(self, data: bytes) -> bool:
        return True

    def accept(self, data: bytes, now: float) -> bool:
        return False


class _Segmented(_Responding, ABC):
    __slots__ = ("_toggle",)

    def __init__(self, timeout: float, now: float) -> None:
        super().__init__(timeout, now)
        self._toggle = 0

    def feed(self, data: bytes | None, now: float) -> list[bytes]:
        """Return the response to a request, which has the same toggle bit."""
        if data is None:
            return _check_timeout(now, self.deadline)
        response = self._response(data)
        self._toggle ^= 1
        self.deadline = now + self._timeout
        return [response]

    def _check_toggle(self, toggle: int) -> None:
        if toggle != self._toggle:
            raise ProtocolViolation(AbortCode.TOGGLE, f"toggle bit {toggle} came, {self._toggle} is next")

    @abstractmethod
    def _response(self, data: bytes) -> bytes: ...


class SegmentedUpload(_Segmented):
    """An upload in segments."""

    __slots__ = ("_value",)

    def __init__(self, value: bytes, timeout: float, now: float) -> None:
        super().__init__(timeout, now)
        self._value = Outgoing((value,), len(value))

    def _response(self, data: bytes) -> bytes:
        toggle = _expect(data, NextSegment).toggle
        self._check_toggle(toggle)
        part = self._value.take(SEGMENT)
        self.over = self._value.exhausted
        return SdoSegment(toggle, part, self.over).encode()


class SegmentedDownload(_Segmented):
    """A download in segments. The last one is confirmed after the value is written."""

    __slots__ = ("_buffer", "_value", "_write")

    def __init__(self, write: _Write, size: int | None, limit: int, timeout: float, now: float) -> None:
        super().__init__(timeout, now)
        self._buffer = bytearray()
        self._value = Incoming(self._buffer.extend, size, limit=limit)
        self._write = write

    def _response(self, data: bytes) -> bytes:
        segment = _expect(data, SdoSegment)
        self._check_toggle(segment.toggle)
        self._value.add(segment.data)
        if segment.last:
            self._value.end()
            self._write(bytes(self._buffer))
        self.over = segment.last
        return SegmentTaken(segment.toggle).encode()


class BlockUpload(_Responding):
    """An upload in blocks, which begins with the start message of the client."""

    __slots__ = ("_blksize", "_crc", "_sender", "_value")

    def __init__(self, value: bytes, blksize: int, crc: bool, timeout: float, now: float) -> None:
        super().__init__(timeout, now)
        self._value = value
        self._blksize = blksize
        self._crc = crc
        self._sender: BlockSender | None = None

    @property
    def ended(self) -> bool:
        """Whether the end is sent, and only the A1 of the client is missing."""
        return self._sender is not None and self._sender.ended

    def feed(self, data: bytes | None, now: float) -> list[bytes]:
        """Return the next segments, or the end."""
        sender = self._sender
        if sender is None:
            if data is None:
                return _check_timeout(now, self.deadline)
            _expect(data, StartBlockUpload)
            value = Outgoing((self._value,), len(self._value))
            sender = BlockSender(value, self._blksize, crc=self._crc, timeout=self._timeout, burst=BURST, now=now)
            self._sender, data = sender, None
        frames = sender.feed(None if data is None else _expect(data, *RECEIVER_MESSAGES), now)
        self.deadline, self.over = sender.deadline, sender.over
        return frames


class BlockDownload:
    """A download in blocks."""

    __slots__ = ("_buffer", "_receiver", "_write", "accept", "over")

    def __init__(
        self, write: _Write, size: int | None, limit: int, blksize: int, crc: bool, timeout: float, now: float
    ) -> None:
        self._buffer = bytearray()
        value = Incoming(self._buffer.extend, size, limit=limit)
        self._receiver = BlockReceiver(value, blksize, crc=crc, timeout=timeout, now=now)
        self.accept = self._receiver.accept  # the path of nearly every frame, called directly
        self._write = write
        self.over = False

    @property
    def deadline(self) -> float:
        """When the receiver must be fed None."""
        return self._receiver.deadline

    @property
    def next_segment(self) -> int:
        """The number of the next segment; 0 when all of them have arrived."""
        return self._receiver.next_segment

    def gives_way(self, data: bytes) -> bool:
        """Return whether a frame is the request for a new transfer.

        Between segments it is not: 40h is also segment 64, C6h also the last segment 70. Before the first segment
        these are too far ahead to be segments. Only an expedited download is still not taken, because if it were a
        segment after all, its data would be written to some object.
        """
        receiver = self._receiver
        if receiver.untouched:
            return not ExpeditedDownload.pattern.matches(data[0])
        return receiver.complete and not receiver.has(data)

    def feed(self, data: bytes | None, now: float) -> list[bytes]:
        """Return the acknowledgement of a block. The end is acknowledged after the value is written."""
        receiver = self._receiver
        frames = receiver.feed(data, now)
        if receiver.over:
            self._write(bytes(self._buffer))
            self.over = True
        return frames


class SdoServer:
    """An SDO server of a node. A machine.

        dialect   the SDO dialect of the responses
        timeout   seconds after which a transfer ends if the client sends nothing
        limit     the longest value, in bytes, that can be written
        blksize   segments in a block of a download, 1 to 127; 0: no block transfers
        cob_ids   the channel of a further server, client to server first; default: the first channel of the node
        on_failure    called as on_failure("SDO", error) for an error that is not one of barewire; the request is then
                      aborted with 0800 0000h. Without it the error is raised

    >>> from barewire.canopen.object_dictionary import Entry, ObjectDictionary
    >>> server = SdoServer(5, ObjectDictionary([Entry(0x6041, 0, "STATUS WORD", "u16", "ro", 0x0637)]))
    >>> str(server.feed(CanFrame.parse("605#4041600000000000"), 0.0)[0])
    '585#4B41600037060000'
    """

    __slots__ = (
        "_last_frame",
        "_place",
        "_repeat_until",
        "_stray",
        "_stray_until",
        "_transfer",
        "blksize",
        "counters",
        "dialect",
        "limit",
        "objects",
        "on_failure",
        "request_extended",
        "request_id",
        "response_extended",
        "response_id",
        "timeout",
    )  # fmt: skip

    def __init__(
        self,
        node: int,
        objects: ObjectStore,
        dialect: SdoDialect = STANDARD,
        *,
        timeout: float = DEFAULT_TIMEOUT,
        limit: int = LIMIT,
        blksize: int = BLOCK_MAX,
        cob_ids: tuple[CobEntry, CobEntry] | None = None,
        on_failure: Callable[[str, Exception], None] | None = None,
    ) -> None:
        if not 0 <= blksize <= BLOCK_MAX:
            raise EncodeError(f"{blksize} segments in a block: expected 1..{BLOCK_MAX}, or 0 for no blocks")
        request, response = cob_ids or default_sdo_channel(node)
        self.request_id, self.request_extended = request[:2]
        self.response_id, self.response_extended = response[:2]
        self.objects = objects
        self.dialect = dialect
        self.timeout = timeout
        self.limit = limit
        self.blksize = blksize
        self.on_failure = on_failure
        self.reset()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.request_id:X}h, {self.response_id:X}h: {self.objects!r}>"

    @property
    def deadline(self) -> float | None:
        """When the present transfer continues or times out; None without one."""
        return None if self._transfer is None else self._transfer.deadline

    @property
    def receives(self) -> frozenset[tuple[int, bool]]:
        """The (identifier, extended) of the requests."""
        return frozenset({(self.request_id, self.request_extended)})

    def reset(self) -> None:
        """End the transfer and restart the counters, because the node or its communication is reset."""
        self.counters = ServerCounters()
        self.forget()

    def forget(self) -> None:
        """End the present transfer without an abort, because the node may not send any more."""
        self._transfer: ServerTransfer | None = None
        self._place = 0, 0
        self._stray = 0
        self._stray_until = 0.0
        self._last_frame = b""
        self._repeat_until = 0.0

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Return the frames that respond to a frame, or to time passing."""
        if frame is not None and self.accept(frame, now):
            return []
        data = None if frame is None else self._request_data(frame)
        transfer = self._transfer
        try:
            if data is not None:
                responses = self._receive(data, now)
            elif transfer is not None and now >= transfer.deadline:
                responses = self._continue(transfer, None, now)
            else:
                return []
        except Exception as error:
            self._transfer = None
            if self.on_failure is None:
                raise
            self.on_failure("SDO", error)
            responses = self._refuse(AbortCode.GENERAL)
        return CanFrame.each(self.response_id, responses, self.response_extended)

    def accept(self, frame: CanFrame, now: float) -> bool:
        """Accept the next segment inside a block, which needs no response. If it returns False, call `feed`."""
        transfer = self._transfer
        if transfer is None or frame.id != self.request_id or frame.extended != self.request_extended or frame.remote:
            return False
        accepted = transfer.accept(frame.data, now)
        self.counters.requests += accepted
        return accepted

    def _request_data(self, frame: CanFrame) -> bytes | None:
        if frame.id != self.request_id or frame.extended != self.request_extended or frame.remote:
            return None
        if len(frame.data) != 8:
            self.counters.wrong_length += 1
            return None
        self.counters.requests += 1
        return frame.data

    def _receive(self, data: bytes, now: float) -> list[bytes]:
        if self._stray and self._is_stray(data, now):
            return []
        if data[0] == ABORT:
            self.counters.aborts_received += 1
            self._transfer = None
            return []
        transfer = self._transfer
        if data == self._last_frame and self._is_repeat(data, now):
            return []
        if transfer is not None and is_initiate(data) and transfer.gives_way(data):
            self.counters.replaced += 1
            if awaits_end(transfer):
                self._keep_last(_BLOCK_ENDED, now)
            transfer = self._transfer = None
        return self._begin(data, now) if transfer is None else self._continue(transfer, data, now)

    def _is_stray(self, data: bytes, now: float) -> bool:
        """Return whether it is a late segment of an aborted block, which must not be mistaken for a command."""
        if data[0] & ~LAST != self._stray or now >= self._stray_until:
            self._stray = 0
            return False
        self._stray = _following(data)
        self.counters.strays += 1
        return True

    def _keep_last(self, data: bytes, now: float) -> None:
        # It may come again; the A1 of a block upload may come late.
        self._last_frame = data
        self._repeat_until = now + self.timeout

    def _is_repeat(self, data: bytes, now: float) -> bool:
        """Return whether the last frame of the transfer before has come again."""
        transfer = self._transfer
        if now >= self._repeat_until:
            return False
        # During a transfer only an A1 is known to be no part of it.
        if transfer is not None and (data != _BLOCK_ENDED or not transfer.gives_way(data) or awaits_end(transfer)):
            return False
        self.counters.strays += 1
        return True

    def _begin(self, data: bytes, now: float) -> list[bytes]:
        _, index, sub, _ = OBJECT_LAYOUT.unpack(data)
        self._place = index, sub
        try:
            request = decode_sdo_request(data)
        except DecodeError:
            self.counters.unknown_command += 1
            return self._refuse(AbortCode.COMMAND)
        self.counters.reserved_bits += has_reserved_bits(request.pattern, data[0])
        try:
            return [self._serve(request, now)]
        except (SdoAbort, ProtocolViolation) as refusal:
            return self._refuse(refusal.code)
        except BarewireError:
            return self._refuse(AbortCode.GENERAL)  # a hook of the application refused with another exception

    def _continue(self, transfer: ServerTransfer, data: bytes | None, now: float) -> list[bytes]:
        expected = transfer.next_segment
        try:
            responses = transfer.feed(data, now)
        except (SdoAbort, ProtocolViolation) as refusal:
            code = refusal.code
        except BarewireError:
            code = AbortCode.GENERAL
        else:
            if transfer.over:
                self._transfer = None
                if data is not None:
                    self._keep_last(data, now)
            return responses
        self._transfer = None
        self.counters.timed_out += code == AbortCode.TIMED_OUT
        if expected:
            self._stray = expected if data is None else _following(data)
            self._stray_until = now + self.timeout
        elif data is not None and code == AbortCode.COMMAND and is_initiate(data):
            _, index, sub, _ = OBJECT_LAYOUT.unpack(data)
            self._place = index, sub
        return self._refuse(code)

    def _refuse(self, code: int) -> list[bytes]:
        self.counters.aborts_sent += 1
        return [Abort(*self._place, code).encode()]

    def _serve(self, request: SdoRequest, now: float) -> bytes:
        index, sub = request.index, request.sub
        if isinstance(request, InitiateUpload):
            return self._upload(request, self.objects.read(index, sub), now)
        if isinstance(request, ExpeditedDownload):
            self.objects.write(index, sub, self._trimmed(request))
            return DownloadInitiated(index, sub).encode()
        write = partial(self.objects.write, index, sub)
        if isinstance(request, InitiateDownload):
            self._start_download(request, SegmentedDownload(write, request.size, self.limit, self.timeout, now))
            return DownloadInitiated(index, sub).encode()
        if isinstance(request, InitiateBlockUpload) and self.blksize:
            return self._block_upload(request, now)
        if isinstance(request, InitiateBlockDownload) and self.blksize:
            blksize = self.blksize
            transfer = BlockDownload(write, request.size, self.limit, blksize, request.crc, self.timeout, now)
            self._start_download(request, transfer)
            return BlockDownloadInitiated(index, sub, blksize).encode()
        raise SdoAbort(AbortCode.COMMAND, index, sub)

    def _start_download(self, request: InitiateDownload | InitiateBlockDownload, transfer: ServerTransfer) -> None:
        self.objects.may_write(request.index, request.sub, request.size)
        self._transfer = transfer

    def _upload(self, request: InitiateUpload, value: bytes, now: float) -> bytes:
        if 1 <= len(value) <= 4:
            return ExpeditedUpload(request.index, request.sub, self._widened(request, value)).encode()
        self._transfer = SegmentedUpload(value, self.timeout, now)
        return UploadInitiated(request.index, request.sub, len(value)).encode()

    def _block_upload(self, request: InitiateBlockUpload, now: float) -> bytes:
        index, sub = request.index, request.sub
        check_blksize(request.blksize)
        value = self.objects.read(index, sub)
        if request.switch and len(value) <= request.switch:
            return self._upload(InitiateUpload(index, sub), value, now)
        self._transfer = BlockUpload(value, request.blksize, request.crc, self.timeout, now)
        return BlockUploadInitiated(index, sub, len(value)).encode()

    def _trimmed(self, request: ExpeditedDownload) -> bytes:
        """Return the bytes of a download that are the value."""
        # Without an indicated size these are as many as the object has, and also in a dialect that sends every number
        # in four bytes, if the others are zero. Otherwise they are all bytes; the dictionary checks the length.
        data = request.data
        if request.indicated and (self.dialect.lengths == "exact" or len(data) != 4):
            return data
        size = self.objects.size(request.index, request.sub)
        if size is None or size >= len(data) or (request.indicated and data[size:].strip(b"\0")):
            return data
        return data[:size]

    def _widened(self, request: InitiateUpload, data: bytes) -> bytes:
        """Fill the data to the length that the dialect requested: four bytes after 43h, two after 4Bh."""
        if self.dialect.lengths == "exact" or request.command == 0x40:
            return data
        size = {command: size for size, command in self.dialect.read_commands}.get(request.command, 0)
        return data.ljust(size, b"\0")


def awaits_end(transfer: ServerTransfer) -> bool:
    """Return whether only the A1 of the client is missing."""
    return isinstance(transfer, BlockUpload) and transfer.ended


def _following(segment: bytes) -> int:
    """Return the number of the segment after this one; 0 if none follows in this block."""
    return segment[0] + 1 if segment[0] < BLOCK_MAX else 0


def is_initiate(data: bytes) -> bool:
    """Return whether these bytes begin a transfer."""
    try:
        decode_sdo_request(data)
    except DecodeError:
        return False
    return True
