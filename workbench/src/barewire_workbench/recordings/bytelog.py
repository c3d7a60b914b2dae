"""Logs of a serial line as text: bytes with times, and dumps without.

    12.345678 01 03 00 00 00 02 C4 0B         seconds; also (12.345678), [12.345678] and 10:31:18.25
    01 03 00 00 00 02 C4 0B                   no time: a line is one piece
    00000000: 0103 0000 0002 c40b  ......     xxd or hexdump -C: one piece, however many lines
    # text                                    a comment, skipped like an empty line
    01 03 00 00 00 02 C4 0B   <-- good        a remark: behind blanks and <-- // # ; or (

The bytes are in any notation of `frames.input.parse_hex`; a direction mark (> or <) may come before them.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from barewire.errors import DecodeError
from barewire_workbench.frames.input import parse_hex

_STEP = 0.1
"""Seconds between two lines without times: long enough to end a frame, short enough to wait for an answer."""

_PIECE = 0x1000
"""Bytes of a piece of a dump that is read part by part."""

DUMP_OFFSET = re.compile(r"(?:0x)?[0-9A-Fa-f]{6,8}(?:: ?|  )(?=[0-9A-Fa-f]{2})")
_TIME = re.compile(r"[(\[]?(?:(?:(\d{1,12}):)?(\d{1,12}):)?(\d{1,12}[.,]\d+|\d{1,12}(?=[)\]]))[)\]]?:?\s+")
_MARK = re.compile(r"(?:<-|->|[<>]|[RT]X:?)\s*", re.IGNORECASE)

_PAIRS = re.compile(r"[0-9A-Fa-f]{2}(?: [0-9A-Fa-f]{2})+")
"""The notation of nearly all logs: `parse_hex` reads the others, and takes twenty times as long."""

_TWO_BYTES = r"(?:0x)?[0-9A-Fa-f]{1,2}\W+(?:0x)?[0-9A-Fa-f]{1,2}\b"
_REMARK = re.compile(rf"(?<=[0-9A-Fa-f]{{2}})[\])>,.]?\s{{1,200}}(?:<[-=]|←|//|#|;|\()(?![-=\s]{{0,99}}{_TWO_BYTES})")
"""Where a remark begins. Two bytes at its beginning may belong to the frame, or those before the arrow are a time."""


class Chunk(NamedTuple):
    """Bytes received together, the last of them at `at`, in seconds."""

    at: float
    data: bytes


class Log(NamedTuple):
    """The content of a log; `timed` is false if its times are made up. `lines` has the number of the first line of each
    chunk."""

    chunks: list[Chunk]
    timed: bool
    lines: list[int]


def parse_log(text: str, before: Log | None = None, lines_before: int = 0) -> Log:
    """Parse a log into bytes and times. `before` is the part of it before this text, with
    `lines_before` lines.

    >>> parse_log("12.5 01 03\\n0:13.5 83 02").chunks
    [Chunk(at=12.5, data=b'\\x01\\x03'), Chunk(at=13.5, data=b'\\x83\\x02')]
    >>> parse_log("00000000: 0103 0002\\n00000004: 8302").chunks
    [Chunk(at=0.0, data=b'\\x01\\x03\\x00\\x02\\x83\\x02')]

    Raises DecodeError with the number of a line that cannot be read.
    """
    chunks: list[Chunk] = []
    lines: list[int] = []
    dumped, timed, now = False, False, 0.0
    if before is not None:
        timed, now = before.timed, before.chunks[-1].at
    for number, line in enumerate(text.splitlines(), start=1):
        content = without_remark(line.partition("#")[0].strip())
        if not content:
            continue
        offset, time = DUMP_OFFSET.match(content), _TIME.match(content)
        if offset is not None:
            content = content[offset.end() :]
            if ":" not in offset[0]:
                content = content.replace("  ", " ", 1)  # hexdump -C: two blanks after eight bytes
            content = re.split(r"  +(?=\S)|\|", content)[0]
        elif time is not None:
            hours, minutes, seconds = time.groups()
            now = 3600 * int(hours or 0) + 60 * int(minutes or 0) + float(seconds.replace(",", "."))
            content, timed = content[time.end() :], True
        elif (chunks or before is not None) and not timed:
            now += _STEP
        data = _bytes(_MARK.sub("", content, count=1), lines_before + number)
        if offset is not None and dumped and (before is None or len(chunks[-1].data) < _PIECE):
            chunks[-1] = Chunk(chunks[-1].at, chunks[-1].data + data)
        elif data:
            chunks.append(Chunk(now, data))
            lines.append(number)
        dumped = offset is not None
    return Log(chunks, timed, lines)


def without_remark(line: str) -> str:
    """Return a line of bytes without the remark behind them.

    >>> without_remark("01 83 02 C0 F1   <-- refused"), without_remark("12.50 <-- 01 83 02 C0 F1")
    ('01 83 02 C0 F1', '12.50 <-- 01 83 02 C0 F1')
    """
    found = _REMARK.search(line)
    return line if found is None else line[: found.start()]


def _bytes(text: str, number: int) -> bytes:
    if text.startswith(":"):  # an ASCII frame as it was sent
        return text.encode("latin-1", "replace") + b"\r\n"
    if _PAIRS.fullmatch(text):
        return bytes.fromhex(text)
    try:
        return parse_hex(text)
    except DecodeError as error:
        raise DecodeError(error.reason, error.data, error.at, f"line {number}: {error.text}") from None
