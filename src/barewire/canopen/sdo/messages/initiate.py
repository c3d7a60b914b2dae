"""The messages that begin and end an SDO transfer.   [CiA 301, SDO]

        byte   0         1   2      3      4   5   6   7
             | command | index    | sub  | data, a size or a code |        8 bytes, always
                         low high          little-endian

Letters of the command byte:

        n  how many of the bytes 4 to 7 are *not* data          e  expedited: this frame has the value
        s  the size is indicated (n, or the size in 4..7)       -  reserved: sent as 0, ignored when received

               client                                server                           byte 0
        InitiateUpload    010- ----     ->                                            40
                                        <-    ExpeditedUpload    010- nn1s            4F 4B 47 43, 42
                                        <-    UploadInitiated    010- --0s            41, 40   segments follow
        ExpeditedDownload 001- nn1s     ->                                            2F 2B 27 23, 22
        InitiateDownload  001- --0s     ->                                            21, 20   segments follow
                                        <-    DownloadInitiated  011- ----            60
        Abort             1000 0000    <->    Abort                                   80

"Upload" and "download" are seen from the device: an upload transfers a value from the server to the client. The
messages that follow are in `segment` and `block`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from barewire.codecs import BitPattern, Layout
from barewire.errors import DecodeError, EncodeError

OBJECT_LAYOUT = Layout("<BHB", "command", "index", "sub", tail="data")
SIZE_FIELD = Layout("<I", "size")
_CODE_FIELD = Layout("<I", "code")


def object_message(command: int, index: int, sub: int, data: bytes = b"") -> bytes:
    """Return the 8 bytes of a message about an object; unused bytes are zero."""
    return OBJECT_LAYOUT.pack(command, index, sub, tail=data.ljust(4, b"\0"))


@dataclass(frozen=True, slots=True)
class _Expedited:
    """A message with the value itself, which has the same bytes in both directions."""

    index: int
    sub: int
    data: bytes
    indicated: bool = True

    pattern: ClassVar[BitPattern]

    def encode(self) -> bytes:
        """Return the 8 bytes. Raise EncodeError for a value of no or more than 4 bytes."""
        if not 1 <= len(self.data) <= 4:
            raise EncodeError(f"{len(self.data)} bytes do not fit an expedited transfer: it carries 1 to 4")
        if not self.indicated and len(self.data) != 4:
            raise EncodeError("without an indicated size all 4 bytes are sent: expected 4")
        command = self.pattern.encode(n=4 - len(self.data), s=self.indicated)
        return object_message(command, self.index, self.sub, self.data)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the bytes; unused ones at the end may be missing. Without s, all four bytes are the value."""
        command, index, sub, value = OBJECT_LAYOUT.unpack(data)
        fields = cls.pattern.decode(command)
        size = 4 - fields["n"] if fields["s"] else 4
        if len(value) < size:
            raise DecodeError("short", data, len(data), f"{size} bytes of data announced, got {len(value)}")
        return cls(index, sub, value[:size], bool(fields["s"]))


@dataclass(frozen=True, slots=True)
class _Sized:
    """A message about a value that follows in segments, which has the same bytes in both directions."""

    index: int
    sub: int
    size: int | None = None

    pattern: ClassVar[BitPattern]

    def encode(self) -> bytes:
        """Return the 8 bytes."""
        size = b"" if self.size is None else SIZE_FIELD.pack(self.size)
        return object_message(self.pattern.encode(s=self.size is not None), self.index, self.sub, size)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the bytes; unused ones at the end may be missing."""
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
        """Return the 8 bytes of the request."""
        if not self.pattern.matches(self.command):
            raise EncodeError(
                f"command {self.command:02X}h does not request an upload: expected {self.pattern.pattern}"
            )
        return object_message(self.command, self.index, self.sub)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the 8 bytes. Reserved bits are ignored, so 43h is an upload request."""
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
        """Return the 8 bytes of the response."""
        return object_message(self.pattern.encode(), self.index, self.sub)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the bytes of the response; the last four are unused and may be missing."""
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
        """Return the 8 bytes of the message."""
        return object_message(self.pattern.encode(), self.index, self.sub, _CODE_FIELD.pack(self.code))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the bytes of the message. Raise DecodeError("short") without a whole code."""
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
    """Return bytes 4 to 7 as a little-endian number."""
    if len(data) < 8:
        raise DecodeError("short", data, len(data), f"bytes 4..7 are needed, but there are only {len(data)}")
    return int.from_bytes(data[4:8], "little")
