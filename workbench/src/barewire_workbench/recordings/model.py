"""The items of a recording of CAN buses, the same for all file formats.

        Recorded(at, bus, frame)      a frame, classical, CAN FD or error, on the bus of that name, at that time
        Dropped(at, bus, frames)      the recorder reports that it lost this number of frames (0: unknown)
        Unread(at, line, why, text)   a line or record that cannot be read; reading goes on after it

`line` counts from 1: lines of a text, packets of a capture.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple, TypeAlias

from barewire.canopen.frame import AnyFrame
from barewire.errors import DecodeError
from barewire_workbench.frames.result import counted

FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
"""The lengths in bytes of the 16 data length codes of CAN FD."""
FD_MAX = 64


class Unread(NamedTuple):
    """A line or record that cannot be read and was skipped. Line 0 is for several of them: `why` says how many."""

    at: float
    line: int
    why: str
    text: str


class Recorded(NamedTuple):
    """One frame. `sent`: the recording program itself sent it; None if the format does not say that."""

    at: float
    bus: str
    frame: AnyFrame
    line: int = 0
    sent: bool | None = None


class Dropped(NamedTuple):
    """The recorder or its controller lost frames."""

    at: float
    bus: str
    frames: int


LEFT_OUT = "left out: the capture is read as"
"""Why packets of another bus or line are not read: a part of every such `Unread`, whose line is 0."""


class LeftOut:
    """Counts the packets of a capture that are not read, which is as what its first packet is: `Modbus` or `CAN`."""

    def __init__(self, read_as: str) -> None:
        self._read_as = read_as
        self.of_other_bus = self.neither = 0

    def items(self, at: float) -> Iterator[Unread]:
        """Yield the numbers, at the end of the capture."""
        if self.of_other_bus:
            other = "CAN" if self._read_as == "Modbus" else "Modbus"
            packets = counted(self.of_other_bus, "packet")
            yield Unread(at, 0, f"{packets} of {other} {LEFT_OUT} {self._read_as}", "")
        if self.neither:
            hold = "packet holds" if self.neither == 1 else "packets hold"
            yield Unread(at, 0, f"{self.neither} {hold} neither Modbus nor CAN", "")


RecordedItem: TypeAlias = Recorded | Dropped | Unread

_TEXT_SHOWN = 60
_ESCAPES = ("\x1b", "#033", "^[", "\\u001b", "\\e", "\u241b")
"""The character that begins a colour of a terminal, also as rsyslog and editors show it."""
_COLOURS = re.compile(rf"(?:{'|'.join(map(re.escape, _ESCAPES))})\[[0-9;]{{0,20}}[mK]")
"""What sets the colours of a terminal."""


def split_lines(text: str | Iterable[str]) -> Iterable[str]:
    """Return the lines of a text; lines that come one by one, as of a pipe, are returned as they are."""
    return text.splitlines() if isinstance(text, str) else text


def without_colours(line: str) -> str:
    """Return a line without what sets the colours of a terminal."""
    return _COLOURS.sub("", line) if "[" in line and any(escape in line for escape in _ESCAPES) else line


def unread(at: float, line: int, error: DecodeError | str, text: str) -> Unread:
    """Return an `Unread` item; a long text is cut."""
    why = error.text if isinstance(error, DecodeError) else error
    clean = "".join(character if character.isprintable() else "." for character in text.strip()[: _TEXT_SHOWN + 1])
    return Unread(at, line, why, clean if len(clean) <= _TEXT_SHOWN else f"{clean[: _TEXT_SHOWN - 3]}...")
