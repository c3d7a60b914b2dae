"""The bytes of one transfer on their way: taken as they are needed, or given on as they come.

        Outgoing   pieces of any length --> take(n)                      who sends them: segments or blocks
        Incoming   add(bytes) --> sink(bytes), counted and limited       who hears them

Nothing is held here but the piece that is being taken from. Both know the announced size, if there is one, and hold
the transfer to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from barewire.canopen.sdo.aborts import AbortCode, ProtocolViolation
from barewire.errors import EncodeError

LIMIT = 16 << 20
"""The longest value that is collected in memory if nobody says otherwise: 16 MiB."""

SdoProgress = Callable[[int, int | None], object]
"""Told how many bytes have gone or come, and of how many, if anybody knows."""


def _ignore(done: int, size: int | None) -> None:
    """The progress that nobody wants to know of."""


class Outgoing:
    """Bytes to be sent, out of one piece or many.

    >>> value = Outgoing([b"abc", b"", b"defg"], 7)
    >>> value.take(5), value.exhausted, value.take(5), value.exhausted
    (b'abcde', False, b'fg', True)

    Raises EncodeError where the pieces turn out to be more or fewer bytes than `size`.
    """

    __slots__ = ("_at", "_piece", "_pieces", "_progress", "_size", "taken")

    def __init__(self, pieces: Iterable[bytes], size: int | None, progress: SdoProgress | None = None) -> None:
        self._pieces = iter(pieces)
        self._piece = memoryview(b"")
        self._at = 0
        self._size = size
        self._progress = progress or _ignore
        self.taken = 0

    @property
    def exhausted(self) -> bool:
        """Whether there is nothing more to take. Fetches the next piece where that is the only way to know."""
        while self._at == len(self._piece):
            piece = next(self._pieces, None)
            if piece is None:
                if self._size is not None and self.taken < self._size:
                    raise EncodeError(f"{self._size} bytes were announced, the data ends after {self.taken}")
                return True
            self._piece, self._at = memoryview(piece), 0
        return False

    def take(self, count: int) -> bytes:
        """The next `count` bytes; fewer only at the end."""
        parts = []
        while count > 0 and not self.exhausted:
            part = self._piece[self._at : self._at + count]
            parts.append(part)
            count -= len(part)
            self._at += len(part)
            self.taken += len(part)
        if self._size is not None and self.taken > self._size:
            raise EncodeError(f"{self._size} bytes were announced, the data goes on")
        self._progress(self.taken, self._size)
        return b"".join(parts)


class Incoming:
    """Bytes that come, given on to `sink`.

    >>> parts = bytearray()
    >>> value = Incoming(parts.extend, 4, limit=100)
    >>> value.add(b"abc"); value.add(b"d"); value.end()
    >>> parts
    bytearray(b'abcd')

    Raises Breach for more bytes than announced, more than the limit, and at the end for fewer than announced.
    """

    __slots__ = ("_limit", "_progress", "_sink", "_size", "count")

    def __init__(
        self,
        sink: Callable[[bytes], object],
        size: int | None,
        *,
        limit: int | None = LIMIT,
        progress: SdoProgress | None = None,
    ) -> None:
        if limit is not None and size is not None and size > limit:
            raise ProtocolViolation(AbortCode.OUT_OF_MEMORY, f"{size} bytes announced, the limit is {limit}")
        self._sink = sink
        self._size = size
        self._limit = limit
        self._progress = progress or _ignore
        self.count = 0

    def add(self, data: bytes) -> None:
        """The next bytes."""
        self.count += len(data)
        if self._size is not None and self.count > self._size:
            raise ProtocolViolation(AbortCode.TOO_LONG, f"{self._size} bytes announced, more came")
        if self._limit is not None and self.count > self._limit:
            raise ProtocolViolation(AbortCode.OUT_OF_MEMORY, f"more than {self._limit} bytes came")
        self._sink(data)
        self._progress(self.count, self._size)

    def end(self) -> None:
        """That was all."""
        if self._size is not None and self.count < self._size:
            raise ProtocolViolation(AbortCode.TOO_SHORT, f"{self._size} bytes announced, {self.count} came")
