"""The server's side of SDO: a machine that answers frames out of an object dictionary.   [CiA 301, SDO]

        heard on 600h+n                               said on 580h+n
        ---------------                               --------------
        40  upload                                    4F 4B 47 43   the value, 1 to 4 bytes
        2F 2B 27 23  download, size told              60            taken
        22           download, size not told          60            taken: the low bytes that the object needs
        80  abort                                     nothing: an abort is never answered
        any other command                             80  0504 0001h, with the object of the very same frame
        no 8 bytes, remote, another identifier        nothing: counted

What the dictionary refuses, it refuses by raising SdoAbort; the server carries the code out. Reserved bits in a
command are read over, as the standard wants it, and counted as a deviation: that is how the read requests of the
AZ3's guide (4F, 4B, 43) are served.

I know: one node's frames and that there is a dictionary.  I never know: what is in it, NMT states, time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from barewire.canopen.cob import cob_id
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.aborts import AbortCode, SdoAbort
from barewire.canopen.sdo.dialect import STANDARD, Dialect
from barewire.canopen.sdo.messages import (
    LAYOUT,
    Abort,
    DownloadInitiated,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateUpload,
    Request,
    decode_request,
    has_reserved_bits,
)
from barewire.errors import BarewireError, DecodeError


class ObjectStore(Protocol):
    """What a server needs of an object dictionary. Every method refuses by raising SdoAbort."""

    def size(self, index: int, sub: int) -> int | None:
        """How many bytes the object has, None if that varies."""

    def read(self, index: int, sub: int) -> bytes:
        """Its value, little-endian."""

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Take a value, or refuse it."""


@dataclass(slots=True)
class ServerCounters:
    """What a server has seen."""

    requests: int = 0
    wrong_length: int = 0  # frames with a DLC other than 8, not answered
    unknown_command: int = 0
    reserved_bits: int = 0  # served, although something stood in reserved bits
    aborts_heard: int = 0
    aborts_said: int = 0


class SdoServer:
    """The default SDO server of a node. A machine.

    >>> from barewire.canopen.dictionary import Entry, ObjectDictionary
    >>> server = SdoServer(5, ObjectDictionary([Entry(0x6041, 0, "STATUS WORD", "u16", "ro", 0x0637)]))
    >>> str(server.feed(CanFrame.parse("605#4041600000000000"), 0.0)[0])
    '585#4B41600037060000'
    """

    __slots__ = ("answer_id", "counters", "dialect", "objects", "request_id")

    def __init__(self, node: int, objects: ObjectStore, dialect: Dialect = STANDARD) -> None:
        self.request_id = cob_id("SDO request", node)
        self.answer_id = cob_id("SDO answer", node)
        self.objects = objects
        self.dialect = dialect
        self.counters = ServerCounters()

    @property
    def deadline(self) -> float | None:
        """None: an expedited transfer is over when it has been answered."""
        return None

    def reset(self) -> None:
        """A reset of the node or of its communication: counters begin again."""
        self.counters = ServerCounters()

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """The answer to a frame, if it asks for one."""
        if frame is None or frame.key != (self.request_id, False) or frame.remote:
            return []
        if len(frame.data) != 8:
            self.counters.wrong_length += 1
            return []
        self.counters.requests += 1
        answer = self._answer(frame.data)
        return [] if answer is None else [CanFrame(self.answer_id, answer)]

    def _answer(self, data: bytes) -> bytes | None:
        _, index, sub, _ = LAYOUT.unpack(data)
        try:
            request = decode_request(data)
        except DecodeError:
            self.counters.unknown_command += 1
            self.counters.aborts_said += 1
            return Abort(index, sub, AbortCode.COMMAND).encode()
        if isinstance(request, Abort):
            self.counters.aborts_heard += 1
            return None
        self.counters.reserved_bits += has_reserved_bits(request.pattern, data[0])
        code: int = AbortCode.GENERAL
        try:
            return self._carry_out(request)
        except SdoAbort as refusal:
            code = refusal.code
        except BarewireError:
            pass  # a hook of the application said no in other words
        self.counters.aborts_said += 1
        return Abort(index, sub, code).encode()

    def _carry_out(self, request: Request) -> bytes:
        index, sub = request.index, request.sub
        if isinstance(request, InitiateUpload):
            data = self.objects.read(index, sub)
            if not 1 <= len(data) <= 4:
                raise SdoAbort(AbortCode.COMMAND, index, sub)
            return ExpeditedUpload(index, sub, self._widened(request, data)).encode()
        if isinstance(request, ExpeditedDownload):
            self.objects.write(index, sub, self._trimmed(request))
            return DownloadInitiated(index, sub).encode()
        raise SdoAbort(AbortCode.COMMAND, index, sub)

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
