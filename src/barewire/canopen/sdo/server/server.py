"""The server's side of SDO: a machine that answers frames out of an object dictionary.   [CiA 301, SDO]

        heard on 600h+n                               said on 580h+n
        ---------------                               --------------
        40  upload                                    4F 4B 47 43   the value, 1 to 4 bytes
                                                      41            more (or none): it comes in segments
        2F 2B 27 23  download, size told              60            taken
        22           download, size not told          60            taken: the low bytes that the object needs
        21 20        download in segments             60            go on
        A4 A0        upload in blocks                 C6            say start
        C6 C4 C2 C0  download in blocks               A4            go on
        80  abort                                     nothing: an abort is never answered
        any other command                             80  0504 0001h, with the object of the very same frame
        no 8 bytes, remote, another identifier        nothing: counted

There is one transfer at a time (`sessions`). A request in the middle of one ends it with 0504 0001h, and the next is
served; a client that falls silent ends it with 0504 0000h after `timeout` seconds.

What the dictionary refuses, it refuses by raising SdoAbort; the server carries the code out. Reserved bits in a
command are read over, as the standard wants it, and counted as a deviation: that is how the read requests of the
AZ3's guide (4F, 4B, 43) are served.

I know: one node's frames and that there is a dictionary.  I never know: what is in it, NMT states, clocks.
"""

from __future__ import annotations

from functools import partial

from barewire.canopen.cob_ids import CobEntry, cob_id
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.aborts import AbortCode, ProtocolViolation, SdoAbort
from barewire.canopen.sdo.block_transfer import check_blksize
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.canopen.sdo.messages.block import (
    BLOCK_MAX,
    LAST,
    BlockDownloadInitiated,
    BlockUploadInitiated,
    InitiateBlockDownload,
    InitiateBlockUpload,
)
from barewire.canopen.sdo.messages.codec import SdoRequest, decode_sdo_request
from barewire.canopen.sdo.messages.initiate import (
    OBJECT_LAYOUT,
    Abort,
    DownloadInitiated,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateDownload,
    InitiateUpload,
    UploadInitiated,
    has_reserved_bits,
)
from barewire.canopen.sdo.server.sessions import (
    BlockDownload,
    BlockUpload,
    SegmentedDownload,
    SegmentedUpload,
    ServerTransfer,
)
from barewire.canopen.sdo.server.store import ObjectStore, ServerCounters
from barewire.canopen.sdo.stream import LIMIT
from barewire.errors import BarewireError, DecodeError, EncodeError


class SdoServer:
    """The default SDO server of a node. A machine.

    >>> from barewire.canopen.object_dictionary import Entry, ObjectDictionary
    >>> server = SdoServer(5, ObjectDictionary([Entry(0x6041, 0, "STATUS WORD", "u16", "ro", 0x0637)]))
    >>> str(server.feed(CanFrame.parse("605#4041600000000000"), 0.0)[0])
    '585#4B41600037060000'

    `timeout` is how long a client may be silent in a transfer, `limit` the longest value that it may write, `blksize`
    how many segments we want in a row; 0 is a server without block transfers. `cob_ids` is the channel of a further
    server, client to server first; without it the server has the default channel of its node.
    """

    __slots__ = (
        *("answer_id", "counters", "dialect", "objects", "request_id", "timeout", "limit", "blksize"),
        *("answer_extended", "request_extended"),
        *("_place", "_session", "_stray", "_stray_until"),
    )

    def __init__(
        self,
        node: int,
        objects: ObjectStore,
        dialect: SdoDialect = STANDARD,
        *,
        timeout: float = 1.0,
        limit: int = LIMIT,
        blksize: int = BLOCK_MAX,
        cob_ids: tuple[CobEntry, CobEntry] | None = None,
    ) -> None:
        if not 0 <= blksize <= BLOCK_MAX:
            raise EncodeError(f"{blksize} segments in a block: expected 1..{BLOCK_MAX}, or 0 for no blocks")
        self.request_id = cob_id("SDO request", node)
        self.answer_id = cob_id("SDO answer", node)
        self.request_extended = self.answer_extended = False
        if cob_ids is not None:
            self.request_id, self.request_extended = cob_ids[0][:2]
            self.answer_id, self.answer_extended = cob_ids[1][:2]
        self.objects = objects
        self.dialect = dialect
        self.timeout = timeout
        self.limit = limit
        self.blksize = blksize
        self.reset()

    @property
    def deadline(self) -> float | None:
        """When the present transfer wants to go on, or has waited too long."""
        return None if self._session is None else self._session.deadline

    def reset(self) -> None:
        """A reset of the node or of its communication: no transfer, counters begin again."""
        self.counters = ServerCounters()
        self.forget()

    def forget(self) -> None:
        """End the present transfer without a word: the node may not speak any more."""
        self._session: ServerTransfer | None = None
        self._place = 0, 0
        self._stray = 0
        self._stray_until = 0.0

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """What the server says to a frame, or to time passing."""
        if frame is not None and self.accept(frame, now):
            return []
        data, session = None if frame is None else self._ours(frame), self._session
        if data is not None:
            said = self._hear(data, now)
        elif session is not None and now >= session.deadline:
            said = self._go_on(session, None, now)
        else:
            return []
        return CanFrame.each(self.answer_id, said, self.answer_extended)

    def accept(self, frame: CanFrame, now: float) -> bool:
        """Whether that was the next segment inside a block, and nothing is to be said to it. False: it is to be fed."""
        session = self._session
        if session is None or frame.id != self.request_id or frame.extended != self.request_extended or frame.remote:
            return False
        accepted = session.accept(frame.data, now)
        self.counters.requests += accepted
        return accepted

    def _ours(self, frame: CanFrame) -> bytes | None:
        if frame.id != self.request_id or frame.extended != self.request_extended or frame.remote:
            return None
        if len(frame.data) != 8:
            self.counters.wrong_length += 1
            return None
        self.counters.requests += 1
        return frame.data

    def _hear(self, data: bytes, now: float) -> list[bytes]:
        if self._stray and self._is_stray(data, now):
            return []
        if data[0] == Abort.pattern.value:
            self.counters.aborts_received += 1
            self._session = None
            return []
        session = self._session
        if session is not None and session.gives_way and _begins(data):
            session = self._session = None
        return self._begin(data, now) if session is None else self._go_on(session, data, now)

    def _is_stray(self, data: bytes, now: float) -> bool:
        """The rest of a block that we ended: its numbers run on, and read as commands they would do harm."""
        if data[0] & ~LAST != self._stray or now >= self._stray_until:
            self._stray = 0
            return False
        self._stray = _following(data)
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
            return [self._carry_out(request, now)]
        except (SdoAbort, ProtocolViolation) as refusal:
            return self._refuse(refusal.code)
        except BarewireError:
            return self._refuse(AbortCode.GENERAL)  # a hook of the application said no in other words

    def _go_on(self, session: ServerTransfer, data: bytes | None, now: float) -> list[bytes]:
        expected = session.next_segment
        try:
            said = session.feed(data, now)
        except (SdoAbort, ProtocolViolation) as refusal:
            code = refusal.code
        except BarewireError:
            code = AbortCode.GENERAL
        else:
            if session.over:
                self._session = None
            return said
        self._session = None
        self.counters.timed_out += code == AbortCode.TIMED_OUT
        if expected:
            self._stray = expected if data is None else _following(data)
            self._stray_until = now + self.timeout
        elif data is not None and code == AbortCode.COMMAND and _begins(data):
            _, index, sub, _ = OBJECT_LAYOUT.unpack(data)
            self._place = index, sub
        return self._refuse(code)

    def _refuse(self, code: int) -> list[bytes]:
        self.counters.aborts_sent += 1
        return [Abort(*self._place, code).encode()]

    def _carry_out(self, request: SdoRequest, now: float) -> bytes:
        index, sub = request.index, request.sub
        if isinstance(request, InitiateUpload):
            return self._upload(request, self.objects.read(index, sub), now)
        if isinstance(request, ExpeditedDownload):
            self.objects.write(index, sub, self._trimmed(request))
            return DownloadInitiated(index, sub).encode()
        write = partial(self.objects.write, index, sub)
        if isinstance(request, InitiateDownload):
            session: ServerTransfer = SegmentedDownload(write, request.size, self.limit, self.timeout, now)
            answer: DownloadInitiated | BlockDownloadInitiated = DownloadInitiated(index, sub)
        elif isinstance(request, InitiateBlockUpload) and self.blksize:
            return self._block_upload(request, now)
        elif isinstance(request, InitiateBlockDownload) and self.blksize:
            limits = request.size, self.limit, self.blksize
            session = BlockDownload(write, *limits, request.crc, self.timeout, now)
            answer = BlockDownloadInitiated(index, sub, self.blksize)
        else:
            raise SdoAbort(AbortCode.COMMAND, index, sub)
        self.objects.may_write(index, sub, request.size)
        self._session = session
        return answer.encode()

    def _upload(self, request: InitiateUpload, value: bytes, now: float) -> bytes:
        if 1 <= len(value) <= 4:
            return ExpeditedUpload(request.index, request.sub, self._widened(request, value)).encode()
        self._session = SegmentedUpload(value, self.timeout, now)
        return UploadInitiated(request.index, request.sub, len(value)).encode()

    def _block_upload(self, request: InitiateBlockUpload, now: float) -> bytes:
        index, sub = request.index, request.sub
        check_blksize(request.blksize)
        value = self.objects.read(index, sub)
        if request.switch and len(value) <= request.switch:
            return self._upload(InitiateUpload(index, sub), value, now)
        self._session = BlockUpload(value, request.blksize, request.crc, self.timeout, now)
        return BlockUploadInitiated(index, sub, len(value)).encode()

    def _trimmed(self, request: ExpeditedDownload) -> bytes:
        """The bytes of a download that count.

        Without an indicated size those that the object needs. In the dialect that sends every number in four bytes
        the same, if what is cut off is zero. Everything else is as long as it says, and the dictionary judges it.
        """
        data = request.data
        if request.indicated and (self.dialect.lengths == "exact" or len(data) != 4):
            return data
        size = self.objects.size(request.index, request.sub)
        if size is None or size >= len(data) or (request.indicated and data[size:].strip(b"\0")):
            return data
        return data[:size]

    def _widened(self, request: InitiateUpload, data: bytes) -> bytes:
        """In that dialect a request 43h is answered in four bytes and 4Bh in two, whatever the object has."""
        if self.dialect.lengths == "exact" or request.command == 0x40:
            return data
        asked = {command: size for size, command in self.dialect.read_commands}.get(request.command, 0)
        return data.ljust(asked, b"\0")


def _following(segment: bytes) -> int:
    """The number of the segment that a client sends after this one; 0 if none follows in this block."""
    return segment[0] + 1 if segment[0] < BLOCK_MAX else 0


def _begins(data: bytes) -> bool:
    """Whether a client that says this begins a transfer."""
    try:
        decode_sdo_request(data)
    except DecodeError:
        return False
    return True
