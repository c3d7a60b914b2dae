"""Frames of CAN as they are noted and posted: an identifier and its bytes in each line, without times.

    182#4007                                   60B   [8]  40 0A 10 00 00 00 00 00
    082 40 81 10 12 47 00 fd 00                67F Tx SD  8  23 14 10 00 00 00 00 00        standard, 8 bytes

The last form may have a date and the name of the bus before it. The frames count as 1 ms apart.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from barewire.errors import DecodeError
from barewire_workbench.recordings.can_text import parse_can
from barewire_workbench.recordings.model import Recorded, RecordedItem, split_lines, unread

_STEP = 0.001
_BUS = "can0"
_INSPECTED = 50

_PLAIN = re.compile(
    r"(?P<id>[0-9A-Fa-f]{3})(?:#[0-9A-Fa-f.]{0,24}|\s+\[[0-8]\](?:\s+\S.*)?|(?:\s+[0-9A-Fa-f]{2}){1,8})"
)
_DIRECTED = re.compile(
    r"(?:.*\s)?(?P<id>[0-9A-Fa-f]{3})\s+[TR]x\s+S?D\s+(?P<length>[0-8])(?P<data>(?:\s+[0-9A-Fa-f]{2}){0,8})"
)


def is_can_notes(text: str) -> bool:
    """Return whether each of the first lines is a frame.

    >>> is_can_notes("182#4007\\n202#0600"), is_can_notes("01 03 00 00 00 0A C5 CD")
    (True, False)
    """
    lines = [line.strip() for line in text.splitlines()[:_INSPECTED] if line.strip()]
    return bool(lines) and all(_PLAIN.fullmatch(line) or _DIRECTED.fullmatch(line) for line in lines)


def read_can_notes(text: str | Iterable[str]) -> Iterator[RecordedItem]:
    """Yield the frames, 1 ms apart.

    >>> [str(item.frame) for item in read_can_notes("60B   [2]  40 0A\\n67F Tx SD  2  23 14")]
    ['60B#400A', '67F#2314']
    """
    now = 0.0
    for number, line in enumerate(split_lines(text), start=1):
        if not line.strip():
            continue
        now += _STEP
        found = _DIRECTED.fullmatch(line.strip())
        try:
            note = line if found is None else f"{found['id']} [{found['length']}] {found['data']}"
            yield Recorded(now, _BUS, parse_can(note), number)
        except DecodeError as error:
            yield unread(now, number, error, line)
