"""The messages of a block transfer: up to 127 segments in a row for one acknowledgement.   [CiA 301, SDO block]

        c  this side supports the CRC (used only if both do); in a segment: this is the last one
        s  the size is indicated                    n  how many bytes of the last segment are *not* data
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
block too. A segment does not state how many of its bytes are data; BlockEnd states it for the last segment.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from barewire.canopen.sdo.messages.initiate import OBJECT_LAYOUT, SIZE_FIELD, indicated_size, object_message
from barewire.canopen.sdo.messages.segment import SEGMENT
from barewire.codecs import BitPattern, Layout
from barewire.errors import DecodeError, EncodeError

BLOCK_MAX = 127
LAST = 0x80
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
        """Return the 8 bytes of the request."""
        size = b"" if self.size is None else SIZE_FIELD.pack(self.size)
        return object_message(self.pattern.encode(c=self.crc, s=self.size is not None), self.index, self.sub, size)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the 8 bytes; unused bytes at the end may be missing."""
        _, index, sub, _ = OBJECT_LAYOUT.unpack(data)
        return cls(index, sub, indicated_size(cls.pattern, data), bool(cls.pattern.decode(data[0])["c"]))


@dataclass(frozen=True, slots=True)
class BlockUploadInitiated(InitiateBlockDownload):
    """The server will send a value in blocks, after StartBlockUpload. Its bytes are those of the request of a download.

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
        """Return the 8 bytes of the response."""
        _check_blksize(self.blksize)
        return object_message(self.pattern.encode(c=self.crc), self.index, self.sub, bytes([self.blksize]))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the 8 bytes; the transfer checks the block size."""
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
        """Return the 8 bytes of the request."""
        _check_blksize(self.blksize)
        if not 0 <= self.switch <= 0xFF:
            raise EncodeError(f"protocol switch at {self.switch} bytes: expected 0..255")
        return object_message(self.pattern.encode(c=self.crc), self.index, self.sub, bytes([self.blksize, self.switch]))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the 8 bytes; the transfer checks the block size."""
        _, index, sub, _ = OBJECT_LAYOUT.unpack(data)
        switch = _byte(data, 5, "protocol switch")
        return cls(index, sub, data[4], switch, bool(cls.pattern.decode(data[0])["c"]))


class _CommandOnly:
    """A message that consists of its command byte."""

    __slots__ = ()
    pattern: ClassVar[BitPattern]

    def encode(self) -> bytes:
        """Return the 8 bytes."""
        return bytes([self.pattern.encode()]).ljust(8, b"\0")

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the command byte."""
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
        """Return the 8 bytes."""
        if not 1 <= self.sequence <= BLOCK_MAX:
            raise EncodeError(f"segment {self.sequence}: expected 1..{BLOCK_MAX}")
        if len(self.data) > SEGMENT or (len(self.data) < SEGMENT and not self.last):
            raise EncodeError(f"{len(self.data)} bytes of data: a segment carries {SEGMENT}, only the last one fewer")
        return bytes([self.sequence | LAST * self.last]) + self.data.ljust(SEGMENT, b"\0")

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the 8 bytes. Raise DecodeError("value") for 00h and 80h, which are not segments."""
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
        """Return the 8 bytes."""
        _check_blksize(self.blksize)
        return _ACK.pack(self.pattern.encode(), self.sequence, self.blksize, tail=bytes(5))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the first 3 bytes; the transfer checks the numbers."""
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
        """Return the 8 bytes."""
        return _END.pack(self.pattern.encode(n=self.unused), self.crc, tail=bytes(5))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the first 3 bytes."""
        return cls(cls.pattern.decode(data[0])["n"], _END.unpack(data)[1])


@dataclass(frozen=True, slots=True)
class BlockEnded(_CommandOnly):
    """The receiver has the complete value, and the CRC is correct.

        101- --01 | reserved 7

    >>> BlockEnded().encode().hex(" ")
    'a1 00 00 00 00 00 00 00'
    """

    pattern: ClassVar = BitPattern("101- --01")
