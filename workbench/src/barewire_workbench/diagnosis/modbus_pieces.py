"""The frames and the noise of a line, each with its place in the log: when it began and ended, and in which line.

        fed       00 01 03 04 00 17    00 07 0B F5 01 03        at 1.000 and 1.010, lines 7 and 8
        pieces    |00| 01 03 04 00 17    00 07 0B F5 |...       noise from line 7; a frame from line 7, ended at 1.010

`TrackedLine` is a line for a sniffer: it passes everything on to another one, and keeps what that returned.

`Examiner` says what is wrong with damaged pieces, with a bound on its cost: the search for a wrong baud rate takes a
tenth of a second for some bytes. It is made for the first pieces of a log that no other trial explains; what is wrong
with the whole line shows in them. Equal bytes are tried once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from barewire.modbus.adu import Adu, Noise
from barewire.modbus.framing import LineEvent
from barewire_workbench.diagnosis.ascii import diagnose_ascii
from barewire_workbench.diagnosis.resample import misread, misread_parity
from barewire_workbench.diagnosis.rtu import RTU_TRIALS, diagnose_rtu, first_findings
from barewire_workbench.diagnosis.tcp import diagnose_tcp
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.result import FrameRole, ProtocolName
from barewire_workbench.recordings.modbus_replay import RecordedTcpLine
from barewire_workbench.sniffer import HeardLine

_KEPT = 4096
"""Chunks whose place is kept; a line holds far fewer."""


class Piece(NamedTuple):
    """A frame or noise, and its place. `joined`: it begins in the chunk in which the piece before ended."""

    data: bytes
    adu: Adu | None
    start: float
    end: float
    line: int
    from_client: bool | None
    joined: bool


class _Chunk:
    """Bytes that were received together, and how many of them belong to no piece yet."""

    def __init__(self, at: float, line: int, from_client: bool | None, data: bytes) -> None:
        self.at, self.line, self.from_client = at, line, from_client
        self.data = data


class TrackedLine:
    """Another line, and the pieces that it found. `place` states where the next bytes stand in the log."""

    def __init__(self, line: HeardLine, protocol: ProtocolName) -> None:
        self.line = line
        self.protocol = protocol
        self.pieces: list[Piece] = []
        self._place: tuple[int, bool | None] = (0, None)
        self._chunks: deque[_Chunk] = deque(maxlen=_KEPT)
        self._last: _Chunk | None = None  # in which the last piece ended

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.line!r}>"

    def place(self, line: int, from_client: bool | None) -> None:
        """State the line of the bytes that are fed next, and their direction if it is known."""
        self._place = line, from_client

    def take(self) -> list[Piece]:
        """Return the pieces since the last call."""
        pieces, self.pieces = self.pieces, []
        return pieces

    def feed(self, data: bytes | None, now: float) -> Sequence[LineEvent]:
        """Take bytes, and keep where the frames and the noise in them stand."""
        if data:
            self._chunks.append(_Chunk(now, *self._place, data))
        events = self.line.feed(data, now)
        for event in events:
            self._keep(event)
        return events

    def end(self) -> None:
        """Keep the held bytes of a TCP connection as noise: the recording ends, and their frame does not."""
        if isinstance(self.line, RecordedTcpLine):
            for event in self.line.end():
                self._keep(event)

    def _keep(self, event: Adu | Noise) -> None:
        """Keep a frame as one piece; noise as a piece for each chunk, since damaged frames are recorded one by one."""
        if isinstance(event, Noise):
            size = len(event.data)
            while size > 0 and self._chunks:
                first = min(size, len(self._chunks[0].data))
                self._take_bytes(first, None)
                size -= first
            return
        inner = len(event.pdu)
        self._take_bytes({"rtu": inner + 3, "ascii": 2 * inner + 7, "tcp": inner + 7}.get(self.protocol, inner), event)

    def _take_bytes(self, size: int, adu: Adu | None) -> None:
        if not self._chunks:
            return
        first = last = self._chunks[0]
        joined, data = first is self._last, bytearray()
        while size > len(data) and self._chunks:
            last = self._chunks[0]
            part = last.data[: size - len(data)]
            data += part
            last.data = last.data[len(part) :]
            if not last.data:
                self._chunks.popleft()
        self._last = last
        self.pieces.append(Piece(bytes(data), adu, first.at, last.at, first.line, first.from_client, joined))

    @property
    def deadline(self) -> float | None:
        """When to feed None if nothing arrived."""
        return self.line.deadline

    @property
    def held(self) -> bytes:
        """The bytes that are neither a frame nor noise yet."""
        return self.line.held


THOROUGH, THOROUGH_BESIDE = 8, 3
"""So many different pieces of a log get all trials: if no frame is good, and if some are. Then the line is read as it
is sent, and at most one unit has other settings."""
_REMEMBERED = 512
_LONGEST = 300
"""Bytes: a longer piece is not one frame with a fault."""
_QUICK = tuple(trials for trials in RTU_TRIALS if misread not in trials)
_DOUBTFUL = frozenset({"baud-rate", "inverted"})
"""Codes of other readings of the line. Most pieces decide which one is right."""
WEAK = frozenset({"cut-frame", "crc-missing"})
"""Codes without a checksum as their proof."""
_FRAMINGS = {"rtu": diagnose_rtu, "ascii": diagnose_ascii, "tcp": diagnose_tcp}


class Examiner:
    """Returns what is wrong with pieces of one log, in one framing.

    >>> Examiner("rtu").findings(bytes.fromhex("01 03 00 00 00 0A CD C5"), "request")[0].code
    'crc-swapped'
    """

    def __init__(self, protocol: ProtocolName) -> None:
        self._protocol = protocol
        self._thorough = 0
        self._known: dict[tuple[bytes, FrameRole | None], list[Finding]] = {}

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._protocol}, {self._thorough} thorough trials made>"

    def findings(self, data: bytes, role: FrameRole | None, *, good: bool = False) -> list[Finding]:
        """Return what is wrong with bytes that should be one frame; the role is that which the log lets expect.

        `good`: frames of this line are read as they were sent.
        """
        key = data, role
        if key not in self._known:
            found = self._tried(data, role, THOROUGH_BESIDE if good else THOROUGH)
            if len(self._known) >= _REMEMBERED:
                return found
            self._known[key] = found
        return self._known[key]

    def _tried(self, data: bytes, role: FrameRole | None, limit: int) -> list[Finding]:
        if len(data) > _LONGEST:
            return []
        if self._protocol != "rtu":
            return _FRAMINGS[self._protocol](data, role)  # these are cheap
        found = first_findings(_QUICK, data, role) or first_findings(_QUICK, data, None)
        if (found and found[0].code != "cut-frame") or self._thorough >= limit:
            return found
        self._thorough += 1
        found = diagnose_rtu(data, role) or (diagnose_rtu(data) if role is not None else [])
        if not found or found[0].code in _DOUBTFUL:
            found += misread_parity(data, role)
        return found
