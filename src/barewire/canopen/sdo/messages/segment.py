"""The messages of a segmented transfer: segments of seven bytes, each of them confirmed.   [CiA 301, SDO]

        byte   0         1 ... 7
             | command | data, or nothing |        no index: the transfer determines the object

        t  toggle: 0 in the first segment, then 1, 0, 1; the response repeats that of the request
        n  how many of the bytes 1 to 7 are *not* data          c  complete: this is the last segment

               client                                server                           byte 0
        NextSegment       011t ----     ->                                            60 70
                                        <-    SdoSegment         000t nnnc            00 10, last: 01 ... 1F
        SdoSegment        000t nnnc     ->                                            00 10, last: 01 ... 1F
                                        <-    SegmentTaken       001t ----            20 30

An empty value is one segment 0Fh with seven unused bytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from barewire.codecs import BitPattern
from barewire.errors import DecodeError, EncodeError

SEGMENT = 7
"""Bytes of data in a segment."""


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
        """Return the 8 bytes."""
        if len(self.data) > SEGMENT:
            raise EncodeError(f"{len(self.data)} bytes of data: a segment carries at most {SEGMENT}")
        command = self.pattern.encode(t=self.toggle, n=SEGMENT - len(self.data), c=self.last)
        return bytes([command]) + self.data.ljust(SEGMENT, b"\0")

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the 8 bytes; unused bytes at the end may be missing."""
        fields = cls.pattern.decode(data[0])
        end = 1 + SEGMENT - fields["n"]
        if len(data) < end:
            raise DecodeError("short", data, len(data), f"{end - 1} bytes of data announced, got {len(data) - 1}")
        return cls(fields["t"], data[1:end], bool(fields["c"]))


@dataclass(frozen=True, slots=True)
class _ToggleOnly:
    """A message that consists of its command byte, with the toggle bit."""

    toggle: int

    pattern: ClassVar[BitPattern]

    def encode(self) -> bytes:
        """Return the 8 bytes."""
        return bytes([self.pattern.encode(t=self.toggle)]).ljust(8, b"\0")

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decode the command byte."""
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
