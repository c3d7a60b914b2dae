"""The bytes of one transfer, read as they are sent and passed on as they are received.

        Outgoing   pieces of any length --> take(n)                      used by the sender, for segments or blocks
        Incoming   add(bytes) --> sink(bytes), counted and limited       used by the receiver

Only the present piece is buffered. Both check the number of bytes against the announced size, if there is one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from barewire.canopen.abort_codes import AbortCode, ProtocolViolation
from barewire.errors import EncodeError, shown

LIMIT = 16 << 20
"""Default for the longest value that is collected in memory: 16 MiB."""

SdoProgress = Callable[[int, int | None], object]
"""Called with the number of bytes transferred so far, and the total if it is known."""


def _ignore(done: int, size: int | None) -> None:
    """Do nothing: the default progress callback."""


class Outgoing:
    """Bytes to send, given as one piece or many.

    >>> value = Outgoing([b"abc", b"", b"defg"], 7)
    >>> value.take(5), value.exhausted, value.take(5), value.exhausted
    (b'abcde', False, b'fg', True)

    Raises EncodeError if the pieces have more or fewer bytes than `size`.
    """

    __slots__ = ("_offset", "_piece", "_pieces", "_progress", "_size", "count")

    def __init__(self, pieces: Iterable[bytes], size: int | None, progress: SdoProgress | None = None) -> None:
        self._pieces = iter(pieces)
        self._piece = memoryview(b"")
        self._offset = 0
        self._size = size
        self._progress = progress or _ignore
        self.count = 0

    @property
    def exhausted(self) -> bool:
        """Whether all bytes are taken. It fetches the next piece when the present one is used up."""
        while self._offset == len(self._piece):
            piece = next(self._pieces, None)
            if piece is None:
                if self._size is not None and self.count < self._size:
                    raise EncodeError(f"{self._size} bytes were announced, the data ends after {self.count}")
                return True
            if not isinstance(piece, (bytes, bytearray, memoryview)):
                raise EncodeError(f"{shown(piece)} is not bytes: an object takes bytes, or pieces of bytes")
            self._piece, self._offset = memoryview(piece), 0
        return False

    def take(self, length: int) -> bytes:
        """Return the next `length` bytes; fewer only at the end."""
        parts = []
        while length > 0 and not self.exhausted:
            part = self._piece[self._offset : self._offset + length]
            parts.append(part)
            length -= len(part)
            self._offset += len(part)
            self.count += len(part)
        if self._size is not None and self.count > self._size:
            raise EncodeError(f"{self._size} bytes were announced, the data goes on")
        self._progress(self.count, self._size)
        return b"".join(parts)


class Incoming:
    """Received bytes, passed on to `sink`.

    >>> parts = bytearray()
    >>> value = Incoming(parts.extend, 4, limit=100)
    >>> value.add(b"abc"); value.add(b"d"); value.end()
    >>> parts
    bytearray(b'abcd')

    Raises ProtocolViolation for more bytes than announced or than the limit, and at the end for fewer than announced.
    """

    __slots__ = ("_limit", "_progress", "_sink", "_size", "count")

    def __init__(
        self,
        sink: Callable[[bytes], object],
        size: int | None = None,
        *,
        limit: int | None = LIMIT,
        progress: SdoProgress | None = None,
    ) -> None:
        self._sink = sink
        self._limit = limit
        self._progress = progress or _ignore
        self.count = 0
        self.announce(size)

    def announce(self, size: int | None) -> None:
        """Record the size that the sender announced, before the first byte."""
        if self._limit is not None and size is not None and size > self._limit:
            raise ProtocolViolation(AbortCode.OUT_OF_MEMORY, f"{size} bytes announced, the limit is {self._limit}")
        self._size = size

    def add(self, data: bytes) -> None:
        """Count the next bytes and pass them on."""
        self.count += len(data)
        if self._size is not None and self.count > self._size:
            raise ProtocolViolation(AbortCode.TOO_LONG, f"{self._size} bytes announced, more came")
        if self._limit is not None and self.count > self._limit:
            raise ProtocolViolation(AbortCode.OUT_OF_MEMORY, f"more than {self._limit} bytes came")
        self._sink(data)
        self._progress(self.count, self._size)

    def end(self) -> None:
        """Check the size, because all bytes have been received."""
        if self._size is not None and self.count < self._size:
            raise ProtocolViolation(AbortCode.TOO_SHORT, f"{self._size} bytes announced, {self.count} came")
