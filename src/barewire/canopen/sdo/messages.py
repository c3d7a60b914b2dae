"""SDO messages: each a frozen dataclass with `encode` and `decode`.   [CiA 301, SDO]

        byte   0         1   2      3      4   5   6   7
             | command | index    | sub  | data, a size or a code |        8 bytes, always
                         low high          little-endian

Letters of the command byte:

        n  how many of the data bytes are *not* data            e  expedited: this frame has the value
        s  the size is indicated (n, or the size in 4..7)       -  reserved: sent as 0, ignored when received

               client                                server                           byte 0
        InitiateUpload    010- ----     ->                                            40
                                        <-    ExpeditedUpload    010- nn1s            4F 4B 47 43, 42
                                        <-    UploadInitiated    010- --0s            41, 40   segments follow
        ExpeditedDownload 001- nn1s     ->                                            2F 2B 27 23, 22
        InitiateDownload  001- --0s     ->                                            21, 20   segments follow
                                        <-    DownloadInitiated  011- ----            60
        Abort             1000 0000    <->    Abort                                   80

"Upload" and "download" are seen from the device: an upload transfers a value from the server to the client.

A segmented transfer: seven bytes in a segment, each of them confirmed. No message names the object.

        t  toggle: 0 in the first segment, then 1, 0, 1; the response repeats that of the request
        c  complete: this is the last segment

               client                                server                           byte 0
        NextSegment       011t ----     ->                                            60 70
                                        <-    SdoSegment         000t nnnc            00 10, last: 01 ... 1F
        SdoSegment        000t nnnc     ->                                            00 10, last: 01 ... 1F
                                        <-    SegmentTaken       001t ----            20 30

An empty value is one segment 0Fh with seven unused bytes.

A block transfer: up to 127 segments in a row for one acknowledgement.   [CiA 301, SDO block]

        c  this side supports the CRC (used only if both do); in a segment: this is the last one
        q  number of the segment in its block, from 1

               client                                    server                            byte 0
        InitiateBlockDownload  110- -cs0    ->                                             C6 C4 C2 C0
                                            <-    BlockDownloadInitiated  101- -c00        A4 A0
        InitiateBlockUpload    101- -c00    ->                                             A4 A0
                                            <-    BlockUploadInitiated    110- -cs0        C6 C4 C2 C0
        StartBlockUpload       101- --11    ->                                             A3

               sender of the value                       receiver of the value
        BlockSegment           cqqq qqqq    ->                                             01 ... 7F, last: 81 ... FF
                                            <-    BlockAck                101- --10        A2
        BlockEnd               110n nn-1    ->                                             C1 C5 ... DD
                                            <-    BlockEnded              101- --01        A1

In a download the client is the sender, in an upload the server. There is no segment 0, so 80h is an abort inside a
block too. Only BlockEnd states how many bytes of the last segment are data.

Which message eight bytes are depends on the state of the transfer, so `decode_one_of` takes the types possible now:

        C1 34 12 ...      the end of a block transfer    if the last segment is acknowledged
                          segment 41h, the last          inside a block
                          not a valid message            outside a transfer
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, Self, TypeAlias, TypeVar

from barewire.codecs import BitPattern, Layout
from barewire.errors import DecodeError, EncodeError

OBJECT_LAYOUT = Layout("<BHB", "command", "index", "sub", tail="data")
SIZE_FIELD = Layout("<I", "size")
_CODE_FIELD = Layout("<I", "code")
ABORT = 0x80
"""The command byte of an abort, in every state of a transfer."""
BLOCK_MAX = 127
"""The most segments in a block."""
LAST = 0x80
"""The bit of a segment of a block that makes it the last one."""
SEGMENT = 7
"""Bytes of data in a segment."""


def object_message(command: int, index: int, sub: int, data: bytes = b"") -> bytes:
    """Return the 8 bytes of a message about an object; unused bytes are zero."""
    return OBJECT_LAYOUT.pack(command, index, sub, tail=data.ljust(4, b"\0"))


@dataclass(frozen=True, slots=True)
class _Expedited:
    index: int
    sub: int
    data: bytes
    indicated: bool = True

    pattern: ClassVar[BitPattern]

    def encode(self) -> bytes:
        if not 1 <= len(self.data) <= 4:
            raise EncodeError(f"{len(self.data)} bytes do not fit an expedited transfer: it carries 1 to 4")
        if not self.indicated and len(self.data) != 4:
            raise EncodeError("without an indicated size all 4 bytes are sent: expected 4")
        command = self.pattern.encode(n=4 - len(self.data), s=self.indicated)
        return object_message(command, self.index, self.sub, self.data)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        command, index, sub, value = OBJECT_LAYOUT.unpack(data)
        fields = cls.pattern.decode(command)
        size = 4 - fields["n"] if fields["s"] else 4  # without s, n has no meaning: all four bytes are the value
        if len(value) < size:
            raise DecodeError("short", data, len(data), f"{size} bytes of data announced, got {len(value)}")
        return cls(index, sub, value[:size], bool(fields["s"]))


@dataclass(frozen=True, slots=True)
class _Sized:
    index: int
    sub: int
    size: int | None = None

    pattern: ClassVar[BitPattern]

    def encode(self) -> bytes:
        size = b"" if self.size is None else SIZE_FIELD.pack(self.size)
        return object_message(self.pattern.encode(s=self.size is not None), self.index, self.sub, size)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        _, index, sub, _ = OBJECT_LAYOUT.unpack(data)
        return cls(index, sub, indicated_size(cls.pattern, data))


@dataclass(frozen=True, slots=True)
class InitiateUpload:
    """The client requests an object.

        010- ---- | index 2 | sub 1 | reserved 4

    >>> InitiateUpload(0x6041, 0).encode().hex(" ")
    '40 41 60 00 00 00 00 00'

    `command` is 40h; some devices expect other values of the reserved bits, see `SdoDialect`.
    """

    index: int
    sub: int
    command: int = 0x40

    pattern: ClassVar = BitPattern("010- ----")

    def encode(self) -> bytes:
        if not self.pattern.matches(self.command):
            raise EncodeError(
                f"command {self.command:02X}h does not request an upload: expected {self.pattern.pattern}"
            )
        return object_message(self.command, self.index, self.sub)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        command, index, sub, _ = OBJECT_LAYOUT.unpack(data)
        return cls(index, sub, command)


@dataclass(frozen=True, slots=True)
class ExpeditedUpload(_Expedited):
    """The response with the value itself, 1 to 4 bytes.

        010- nn1s | index 2 | sub 1 | data 4

    >>> ExpeditedUpload(0x6041, 0, bytes.fromhex("3706")).encode().hex(" ")
    '4b 41 60 00 37 06 00 00'

    With `indicated` false (42h) the response does not state how many of the four bytes are the value.
    """

    pattern: ClassVar = BitPattern("010- nn1s")


@dataclass(frozen=True, slots=True)
class UploadInitiated(_Sized):
    """The server will send the value in segments, usually of the given size.

        010- --0s | index 2 | sub 1 | size 4

    >>> UploadInitiated(0x1008, 0, 16).encode().hex(" ")
    '41 08 10 00 10 00 00 00'
    """

    pattern: ClassVar = BitPattern("010- --0s")


@dataclass(frozen=True, slots=True)
class ExpeditedDownload(_Expedited):
    """The client writes a value of 1 to 4 bytes.

        001- nn1s | index 2 | sub 1 | data 4

    >>> ExpeditedDownload(0x6040, 0, bytes.fromhex("0F00")).encode().hex(" ")
    '2b 40 60 00 0f 00 00 00'
    """

    pattern: ClassVar = BitPattern("001- nn1s")


@dataclass(frozen=True, slots=True)
class InitiateDownload(_Sized):
    """The client will write a value in segments, usually of the given size.

        001- --0s | index 2 | sub 1 | size 4

    >>> InitiateDownload(0x1008, 0, 16).encode().hex(" ")
    '21 08 10 00 10 00 00 00'
    """

    pattern: ClassVar = BitPattern("001- --0s")


@dataclass(frozen=True, slots=True)
class DownloadInitiated:
    """The server has written the value (or is ready for its segments).

        011- ---- | index 2 | sub 1 | reserved 4

    >>> DownloadInitiated(0x6040, 0).encode().hex(" ")
    '60 40 60 00 00 00 00 00'
    """

    index: int
    sub: int

    pattern: ClassVar = BitPattern("011- ----")

    def encode(self) -> bytes:
        return object_message(self.pattern.encode(), self.index, self.sub)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        _, index, sub, _ = OBJECT_LAYOUT.unpack(data)
        return cls(index, sub)


@dataclass(frozen=True, slots=True)
class Abort:
    """Either side ends the transfer; there is no response.

        1000 0000 | index 2 | sub 1 | abort code 4

    >>> Abort(0x6041, 0, 0x06020000).encode().hex(" ")
    '80 41 60 00 00 00 02 06'

    Its low bits are not ignored, unlike those of other messages: 81h to 9Fh are last segments of a block, perhaps late.
    """

    index: int
    sub: int
    code: int

    pattern: ClassVar = BitPattern("1000 0000")

    def encode(self) -> bytes:
        return object_message(self.pattern.encode(), self.index, self.sub, _CODE_FIELD.pack(self.code))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        _, index, sub, _ = OBJECT_LAYOUT.unpack(data)
        return cls(index, sub, _number(data))


def has_reserved_bits(pattern: BitPattern, command: int) -> bool:
    """Return whether any bit of a command byte that is drawn as '-' is set.

    >>> has_reserved_bits(InitiateUpload.pattern, 0x40), has_reserved_bits(InitiateUpload.pattern, 0x43)
    (False, True)
    """
    return pattern.encode(**pattern.decode(command)) != command


def indicated_size(pattern: BitPattern, data: bytes) -> int | None:
    """Return the announced size, None if there is none."""
    return _number(data) if pattern.decode(data[0])["s"] else None


def _number(data: bytes) -> int:
    if len(data) < 8:
        raise DecodeError("short", data, len(data), f"bytes 4..7 are needed, but there are only {len(data)}")
    return int.from_bytes(data[4:8], "little")


@dataclass(frozen=True, slots=True)
class SdoSegment:
    """Up to seven bytes of the value, in either direction.

        000t nnnc | data 7

    >>> SdoSegment(0, b"CANopen").encode().hex(" ")
    '00 43 41 4e 6f 70 65 6e'
    >>> SdoSegment(0, b"32", last=True).encode().hex(" ")
    '0b 33 32 00 00 00 00 00'
    """

    toggle: int
    data: bytes
    last: bool = False

    pattern: ClassVar = BitPattern("000t nnnc")

    def encode(self) -> bytes:
        if len(self.data) > SEGMENT:
            raise EncodeError(f"{len(self.data)} bytes of data: a segment carries at most {SEGMENT}")
        command = self.pattern.encode(t=self.toggle, n=SEGMENT - len(self.data), c=self.last)
        return bytes([command]) + self.data.ljust(SEGMENT, b"\0")

    @classmethod
    def decode(cls, data: bytes) -> Self:
        fields = cls.pattern.decode(data[0])
        end = 1 + SEGMENT - fields["n"]
        if len(data) < end:
            raise DecodeError("short", data, len(data), f"{end - 1} bytes of data announced, got {len(data) - 1}")
        return cls(fields["t"], data[1:end], bool(fields["c"]))


@dataclass(frozen=True, slots=True)
class _ToggleOnly:
    toggle: int

    pattern: ClassVar[BitPattern]

    def encode(self) -> bytes:
        return bytes([self.pattern.encode(t=self.toggle)]).ljust(8, b"\0")

    @classmethod
    def decode(cls, data: bytes) -> Self:
        return cls(cls.pattern.decode(data[0])["t"])


@dataclass(frozen=True, slots=True)
class NextSegment(_ToggleOnly):
    """The client requests the next segment of an upload.

        011t ---- | reserved 7

    >>> NextSegment(1).encode().hex(" ")
    '70 00 00 00 00 00 00 00'
    """

    pattern: ClassVar = BitPattern("011t ----")


@dataclass(frozen=True, slots=True)
class SegmentTaken(_ToggleOnly):
    """The server confirms a segment of a download; the confirmation of the last one means that the value is written.

        001t ---- | reserved 7

    >>> SegmentTaken(0).encode().hex(" ")
    '20 00 00 00 00 00 00 00'
    """

    pattern: ClassVar = BitPattern("001t ----")


_ACK = Layout("<BBB", "command", "sequence", "blksize", tail="reserved")
_END = Layout("<BH", "command", "crc", tail="reserved")


def _check_blksize(blksize: int) -> None:
    if not 1 <= blksize <= BLOCK_MAX:
        raise EncodeError(f"{blksize} segments in a block: expected 1..{BLOCK_MAX}")


def _byte(data: bytes, offset: int, name: str) -> int:
    if len(data) <= offset:
        raise DecodeError("short", data, len(data), f"{name} is byte {offset}, but there are only {len(data)}")
    return data[offset]


@dataclass(frozen=True, slots=True)
class InitiateBlockDownload:
    """The client will write a value in blocks, usually of the given size.

        110- -cs0 | index 2 | sub 1 | size 4

    >>> InitiateBlockDownload(0x2100, 0, 10).encode().hex(" ")
    'c6 00 21 00 0a 00 00 00'
    """

    index: int
    sub: int
    size: int | None = None
    crc: bool = True

    pattern: ClassVar = BitPattern("110- -cs0")

    def encode(self) -> bytes:
        size = b"" if self.size is None else SIZE_FIELD.pack(self.size)
        return object_message(self.pattern.encode(c=self.crc, s=self.size is not None), self.index, self.sub, size)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        _, index, sub, _ = OBJECT_LAYOUT.unpack(data)
        return cls(index, sub, indicated_size(cls.pattern, data), bool(cls.pattern.decode(data[0])["c"]))


@dataclass(frozen=True, slots=True)
class BlockUploadInitiated(InitiateBlockDownload):
    """The server will send a value in blocks, after StartBlockUpload.

        110- -cs0 | index 2 | sub 1 | size 4

    >>> BlockUploadInitiated(0x1008, 0, 16).encode().hex(" ")
    'c6 08 10 00 10 00 00 00'
    """


@dataclass(frozen=True, slots=True)
class BlockDownloadInitiated:
    """The server is ready for the first block, of `blksize` segments.

        101- -c00 | index 2 | sub 1 | blksize 1 | reserved 3

    >>> BlockDownloadInitiated(0x2100, 0, 127).encode().hex(" ")
    'a4 00 21 00 7f 00 00 00'
    """

    index: int
    sub: int
    blksize: int
    crc: bool = True

    pattern: ClassVar = BitPattern("101- -c00")

    def encode(self) -> bytes:
        _check_blksize(self.blksize)
        return object_message(self.pattern.encode(c=self.crc), self.index, self.sub, bytes([self.blksize]))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        _, index, sub, _ = OBJECT_LAYOUT.unpack(data)
        return cls(index, sub, _byte(data, 4, "blksize"), bool(cls.pattern.decode(data[0])["c"]))


@dataclass(frozen=True, slots=True)
class InitiateBlockUpload:
    """The client requests a value in blocks of `blksize` segments.

        101- -c00 | index 2 | sub 1 | blksize 1 | switch 1 | reserved 2

    `switch` is the protocol switch threshold: a value of at most this many bytes may be sent as an ordinary upload.

    >>> InitiateBlockUpload(0x1008, 0, 20).encode().hex(" ")
    'a4 08 10 00 14 00 00 00'
    """

    index: int
    sub: int
    blksize: int
    switch: int = 0
    crc: bool = True

    pattern: ClassVar = BitPattern("101- -c00")

    def encode(self) -> bytes:
        _check_blksize(self.blksize)
        if not 0 <= self.switch <= 0xFF:
            raise EncodeError(f"protocol switch at {self.switch} bytes: expected 0..255")
        return object_message(self.pattern.encode(c=self.crc), self.index, self.sub, bytes([self.blksize, self.switch]))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        _, index, sub, _ = OBJECT_LAYOUT.unpack(data)
        switch = _byte(data, 5, "protocol switch")
        return cls(index, sub, data[4], switch, bool(cls.pattern.decode(data[0])["c"]))


class _CommandOnly:
    __slots__ = ()
    pattern: ClassVar[BitPattern]

    def encode(self) -> bytes:
        return bytes([self.pattern.encode()]).ljust(8, b"\0")

    @classmethod
    def decode(cls, data: bytes) -> Self:
        cls.pattern.decode(data[0])
        return cls()


@dataclass(frozen=True, slots=True)
class StartBlockUpload(_CommandOnly):
    """The client is ready for the first block.

        101- --11 | reserved 7

    >>> StartBlockUpload().encode().hex(" ")
    'a3 00 00 00 00 00 00 00'
    """

    pattern: ClassVar = BitPattern("101- --11")


@dataclass(frozen=True, slots=True)
class BlockSegment:
    """Segment number `sequence` of a block: seven bytes of the value, padded with zeros after its end.

        cqqq qqqq | data 7

    >>> BlockSegment(3, b"32", last=True).encode().hex(" ")
    '83 33 32 00 00 00 00 00'
    """

    sequence: int
    data: bytes
    last: bool = False

    pattern: ClassVar = BitPattern("cqqq qqqq")

    def encode(self) -> bytes:
        if not 1 <= self.sequence <= BLOCK_MAX:
            raise EncodeError(f"segment {self.sequence}: expected 1..{BLOCK_MAX}")
        if len(self.data) > SEGMENT or (len(self.data) < SEGMENT and not self.last):
            raise EncodeError(f"{len(self.data)} bytes of data: a segment carries {SEGMENT}, only the last one fewer")
        return bytes([self.sequence | LAST * self.last]) + self.data.ljust(SEGMENT, b"\0")

    @classmethod
    def decode(cls, data: bytes) -> Self:
        if len(data) < 1 + SEGMENT:
            raise DecodeError("short", data, len(data), f"a segment has {SEGMENT} bytes of data")
        if not data[0] & ~LAST:
            raise DecodeError("value", data, 0, "there is no segment 0")
        return cls(data[0] & ~LAST, data[1 : 1 + SEGMENT], bool(data[0] & LAST))


@dataclass(frozen=True, slots=True)
class BlockAck:
    """The receiver has segments 1 to `sequence` of this block; the next block shall have `blksize`.

        101- --10 | sequence 1 | blksize 1 | reserved 5

    >>> BlockAck(2, 127).encode().hex(" ")
    'a2 02 7f 00 00 00 00 00'
    """

    sequence: int
    blksize: int

    pattern: ClassVar = BitPattern("101- --10")

    def encode(self) -> bytes:
        _check_blksize(self.blksize)
        return _ACK.pack(self.pattern.encode(), self.sequence, self.blksize, tail=bytes(5))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        return cls(*_ACK.unpack(data)[1:3])


@dataclass(frozen=True, slots=True)
class BlockEnd:
    """The sender has sent everything; `unused` bytes of the last segment are padding, `crc` is that of the value.

        110n nn-1 | CRC 2 | reserved 5

    >>> BlockEnd(4, 0x9C58).encode().hex(" ")
    'd1 58 9c 00 00 00 00 00'
    """

    unused: int
    crc: int = 0

    pattern: ClassVar = BitPattern("110n nn-1")

    def encode(self) -> bytes:
        return _END.pack(self.pattern.encode(n=self.unused), self.crc, tail=bytes(5))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        return cls(cls.pattern.decode(data[0])["n"], _END.unpack(data)[1])


@dataclass(frozen=True, slots=True)
class BlockEnded(_CommandOnly):
    """The receiver has the complete value, and the CRC is correct.

        101- --01 | reserved 7

    >>> BlockEnded().encode().hex(" ")
    'a1 00 00 00 00 00 00 00'
    """

    pattern: ClassVar = BitPattern("101- --01")


class SdoMessage(Protocol):
    """The interface of every SDO message."""

    pattern: ClassVar[BitPattern]

    def encode(self) -> bytes:
        """Return the 8 bytes. Raise EncodeError for a field that they cannot carry."""

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the bytes; those at the end that the message does not use may be missing. Raise DecodeError."""


M = TypeVar("M", bound=SdoMessage)

SdoRequest: TypeAlias = (
    InitiateUpload | ExpeditedDownload | InitiateDownload | InitiateBlockUpload | InitiateBlockDownload | Abort
)
UploadResponse: TypeAlias = ExpeditedUpload | UploadInitiated
BlockUploadResponse: TypeAlias = BlockUploadInitiated | ExpeditedUpload | UploadInitiated
SdoResponse: TypeAlias = BlockUploadResponse | DownloadInitiated | BlockDownloadInitiated | Abort
ReceiverMessage: TypeAlias = BlockAck | BlockEnded

_INITIATE_REQUESTS: tuple[type[SdoRequest], ...] = (
    InitiateUpload,
    ExpeditedDownload,
    InitiateDownload,
    InitiateBlockUpload,
    InitiateBlockDownload,
    Abort,
)
UPLOAD_RESPONSES: tuple[type[UploadResponse], ...] = (ExpeditedUpload, UploadInitiated)
BLOCK_UPLOAD_RESPONSES: tuple[type[BlockUploadResponse], ...] = (BlockUploadInitiated, *UPLOAD_RESPONSES)
_INITIATE_RESPONSES: tuple[type[SdoResponse], ...] = (
    *BLOCK_UPLOAD_RESPONSES,
    DownloadInitiated,
    BlockDownloadInitiated,
    Abort,
)
RECEIVER_MESSAGES: tuple[type[ReceiverMessage], ...] = (BlockAck, BlockEnded)

_LATE = (SdoSegment, SegmentTaken, BlockAck, BlockEnd, BlockEnded)


def decode_one_of(data: bytes, types: tuple[type[M], ...]) -> M:
    """Decode the bytes as a message of one of these types.

    >>> decode_one_of(bytes.fromhex("A2 02 7F 00 00 00 00 00"), RECEIVER_MESSAGES)
    BlockAck(sequence=2, blksize=127)

    Raise DecodeError("short") if bytes are missing, and ("function") if the message is not of these types.
    """
    if not data:
        raise DecodeError("short", data, 0, "the command is byte 0, but there are none")
    for type in types:
        if type.pattern.matches(data[0]):
            return type.decode(data)
    raise DecodeError("function", data, 0, f"command {data[0]:02X}h is not possible here")


def decode_sdo_request(data: bytes) -> SdoRequest:
    """Decode a client's request to a server without a running transfer.

    >>> decode_sdo_request(bytes.fromhex("2B40 6000 0F00 0000"))
    ExpeditedDownload(index=24640, sub=0, data=b'\\x0f\\x00', indicated=True)

    Raise DecodeError as `decode_one_of` does.
    """
    return decode_one_of(data, _INITIATE_REQUESTS)


def decode_sdo_response(data: bytes) -> SdoResponse:
    """Decode a server's response to a request. Trailing bytes that the message does not use may be missing.

    >>> decode_sdo_response(bytes.fromhex("4B41 6000 3706"))
    ExpeditedUpload(index=24641, sub=0, data=b'7\\x06', indicated=True)

    Raise DecodeError as `decode_one_of` does.
    """
    return decode_one_of(data, _INITIATE_RESPONSES)


def is_any_response(data: bytes) -> bool:
    """Return whether these bytes are a response in any state of a transfer. An unexpected response is a late one.

    >>> is_any_response(BlockEnded().encode()), is_any_response(bytes.fromhex("E0 00 00 00 00 00 00 00"))
    (True, False)
    """
    for types in (_INITIATE_RESPONSES, _LATE):
        try:
            decode_one_of(data, types)
        except DecodeError:
            continue
        return True
    return False
