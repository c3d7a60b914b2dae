"""The bytes of a recording as they come: of a file, part by part, or of a pipe into which a program still writes.

        read ---> start ------------> which format?
              |-> text_parts -------> lists of whole lines, decoded
              |-> take, packets ----> so many bytes; the packets of a capture
              '-> parts ------------> bytes as they come

No more than one part and one line is in memory, so a recording may be longer than that, and may have no end.
"""

from __future__ import annotations

import codecs
from collections.abc import Callable, Iterator
from io import BytesIO

from barewire_workbench.recordings.capture import numbered_packets

START = 0x1_0000
"""Bytes that are read first, and show the format."""
PART = 0x4_0000
"""Bytes that are read at once; a pipe gives what it has."""
LINE_MAX = 1_000_000
"""Characters of the longest line; what is behind them is cut off."""


class RecordingSource:
    """A recording that is read once. `read` returns at most so many bytes, as soon as there are any; none at the end.

    >>> from io import BytesIO
    >>> source = RecordingSource(BytesIO(b"(1.5) can0 705#05\\n(1.6) can0 705#05").read)
    >>> source.start[:5], [len(lines) for lines in source.text_parts(bytes.decode)]
    (b'(1.5)', [1, 1])
    """

    def __init__(self, read: Callable[[int], bytes]) -> None:
        self._read = read
        self.start = read(START)
        self._part = self.start  # of which the next bytes are taken
        self._taken = 0
        self.cut: list[int] = []
        """The lines whose ends were cut off."""
        self.packets = numbered_packets(self.take)
        """The packets of a capture, or the error where it is damaged, each with its number; to be read once."""

    @classmethod
    def of(cls, recording: bytes | RecordingSource) -> RecordingSource:
        """Return the source of these bytes, or the source itself."""
        return cls(BytesIO(recording).read) if isinstance(recording, bytes) else recording

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.start[:16]!r}>"

    def more(self) -> bool:
        """Read on, so that the start is longer; return whether there was more."""
        part = self._read(PART)
        self._part = self.start = self.start + part
        return bool(part)

    def whole(self) -> bytes:
        """Read to the end, and return all bytes: the start is then the whole."""
        parts = [self.start]
        while part := self._read(PART):
            parts.append(part)
        self._part = self.start = b"".join(parts)
        return self.start

    def take(self, size: int) -> bytes:
        """Return the next bytes, as many as `size`; fewer only at the end."""
        taken = self._part[self._taken : self._taken + size]
        self._taken += len(taken)
        if len(taken) == size:
            return taken
        pieces, missing = [taken], size - len(taken)
        while missing and (part := self._read(PART)):
            pieces.append(part[:missing])
            self._part, self._taken = part, len(pieces[-1])
            missing -= self._taken
        return b"".join(pieces)

    def parts(self) -> Iterator[bytes]:
        """Yield the bytes that were not taken, as many as there are at a time."""
        part = self._part[self._taken :] or self._read(PART)  # a pipe may have given just what was taken
        while part:
            yield part
            part = self._read(PART)

    def text_parts(self, decode: Callable[[bytes], str], longest: int = LINE_MAX) -> Iterator[list[str]]:
        """Yield the lines, as many as there are at a time. `decode` is for bytes that are not UTF-8 or UTF-16; of a
        line `longest` characters are kept."""
        pending, number, skips = "", 0, False
        for text in self._texts(decode):
            end = text.find("\n") + 1
            if skips and not end:
                continue
            text, skips = pending + (text[end:] if skips else text), False
            end = text.rfind("\n") + 1 or text.rfind("\r", 0, -1) + 1
            lines, pending = text[:end].splitlines(), text[end:]
            if len(pending) > longest:
                lines.append(pending)
                pending, skips = "", True
            for place in [place for place, line in enumerate(lines) if len(line) > longest]:
                lines[place] = lines[place][:longest]
                self.cut.append(number + place + 1)
            number += len(lines)
            if lines:
                yield lines
        if pending:
            yield pending.splitlines()

    def _texts(self, decode: Callable[[bytes], str]) -> Iterator[str]:
        encoding = "utf-16" if self.start[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
        decoder: codecs.IncrementalDecoder | None = codecs.getincrementaldecoder(encoding)()
        for part in self.parts():
            try:
                yield decode(part) if decoder is None else decoder.decode(part)
            except UnicodeDecodeError:
                assert decoder is not None
                held, _ = decoder.getstate()
                decoder = None
                yield decode(held + part)
        if decoder is not None and (held := decoder.getstate()[0]):
            yield decode(held)
