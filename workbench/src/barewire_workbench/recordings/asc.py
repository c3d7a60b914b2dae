"""Vector ASC: CAN frames as lines of text, written by CANalyzer and other tools.

    date Tue Nov 14 22:13:20.000 2023
    base hex  timestamps absolute                                    or dec; or relative: since the line before
    internal events logged
    Begin Triggerblock Tue Nov 14 22:13:20.000 2023
       0.000000 Start of measurement
       0.000800 1  605             Rx   d 8 40 41 60 00 00 00 00 00  Length = 0 BitCount = 64 ID = 1541
       0.099900 1  705             Rx   r 1                          remote; the length may be missing
       0.199900 1  18EBFF00x       Rx   d 2 01 02                    x: an extended identifier
       0.299900 1  ErrorFrame
       0.399900 CANFD   1 Rx   123  Name  1 0 a 16 AA BB ...         BRS ESI code length bytes duration length flags
    End TriggerBlock

The bus is the number of the channel. Times count from the start of the measurement, as in the file. Other lines of
the format (statistics, status, other buses, comments) are skipped.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from barewire.canopen.frame import BASE_MAX, DATA_MAX, EXTENDED_MAX, AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.errors import DecodeError
from barewire_workbench.recordings.model import FD_LENGTHS, Dropped, Recorded, RecordedItem, split_lines, unread

_EDL = 0x1000
"""The flag for CAN FD in a CANFD line; without it the line has a classical frame."""

_START = re.compile(r"(?i)^\s*(date\s|base\s+(hex|dec)|(no\s+)?internal events logged)")
_BASE = re.compile(r"(?i)^\s*base\s+(hex|dec)\s+timestamps\s+(absolute|relative)")
_KNOWN = re.compile(
    r"(?i)^\s*(//|date\s|base\s|(no\s+)?internal events|begin\s|end\s|previous log|"
    r"\d+\.\d+\s+(start of|sv:|log |can\s+\d+\s+status|\d+\s+statistic|\d+\s+overloadframe|cantp|tfs:|gps|"
    r"lin|l\d|j1939|li\s|fr|eth|more|test|%|[a-z]+\s*:))"
)
_OVERRUN = re.compile(r"(?i)^\s*(\d{1,12}\.\d{1,12})\s+(?:can\s+)?(\d+)\s+.*overrun")
_ERROR = re.compile(r"(?i)^\s*(\d{1,12}\.\d{1,12})\s+(?:canfd\s+)?(\d+)\s+(?:rx\s+|tx\s+)?errorframe")
_FRAME = re.compile(
    r"(?i)^\s*(?P<at>\d{1,12}\.\d{1,12})\s+(?P<bus>\d+)\s+(?P<id>[0-9a-f]+)(?P<x>x?)\s+(?P<dir>rx|tx|txrq)\s+"
    r"(?P<kind>[dr])(?P<rest>.*)$"
)
_FD = re.compile(
    r"(?i)^\s*(?P<at>\d{1,12}\.\d{1,12})\s+canfd\s+(?P<bus>\d+)\s+(?P<dir>rx|tx|txrq)\s+(?P<id>[0-9a-f]+)(?P<x>x?)\s+"
    r"(?:(?P<name>(?![01]\s+[01]\s+[0-9a-f]\s+\d)\S+)\s+)?(?P<brs>[01])\s+(?P<esi>[01])\s+(?P<code>[0-9a-f])\s+"
    r"(?P<length>\d+)(?P<rest>.*)$"
)


def is_asc(text: str) -> bool:
    """Return whether the text begins like an ASC file."""
    lines = [line for line in text.splitlines()[:20] if line.strip() and not line.lstrip().startswith("//")]
    return bool(lines) and _START.match(lines[0]) is not None


def read_asc(text: str | Iterable[str]) -> Iterator[RecordedItem]:
    """Yield the frames of the file.

    >>> text = "base hex  timestamps absolute\\n 0.5 1  705  Rx   d 1 05\\n"
    >>> [(item.at, item.bus, str(item.frame)) for item in read_asc(text)]
    [(0.5, '1', '705#05')]
    """
    base, relative, now = 16, False, 0.0
    for number, line in enumerate(split_lines(text), start=1):
        if header := _BASE.match(line):
            base, relative = (16 if header[1].lower() == "hex" else 10), header[2].lower() == "relative"
            continue
        if not line.strip():
            continue
        match = _FRAME.match(line) or _FD.match(line) or _ERROR.match(line)
        if match is None:
            if overrun := _OVERRUN.match(line):
                yield Dropped(now, overrun[2], 0)
            elif not _KNOWN.match(line):
                yield unread(now, number, "not a line of an ASC file", line)
            continue
        stamp = float(match[1])
        now = now + stamp if relative else stamp
        if match.re is _ERROR:
            yield Recorded(now, match[2], ErrorFrame(0x80), number)
            continue
        try:
            frame = _frame(match, base) if match.re is _FRAME else _fd_frame(match, base)
        except DecodeError as error:
            yield unread(now, number, error, line)
        else:
            yield Recorded(now, match["bus"], frame, number)


def _wrong(match: re.Match[str], words: str) -> DecodeError:
    return DecodeError("value", match[0].encode("latin-1", "replace"), 0, words)


def _identifier(match: re.Match[str], base: int) -> tuple[int, bool]:
    extended = bool(match["x"])
    try:
        number = int(match["id"], base)
    except ValueError:
        raise _wrong(match, f"identifier {match['id']!r} is not a number in base {base}") from None
    if number > (EXTENDED_MAX if extended else BASE_MAX):
        raise _wrong(match, f"identifier {match['id']}: expected up to 7FF, or 1FFFFFFFx")
    return number, extended


def _data(match: re.Match[str], tokens: list[str], length: int, base: int) -> bytes:
    tokens = tokens[:length]
    try:
        data = bytes(int(token, base) for token in tokens)
    except ValueError:
        raise _wrong(match, f"{' '.join(tokens)[:24]!r} is not bytes in base {base}") from None
    if len(data) < length:
        raise _wrong(match, f"the length is {length}, but {len(data)} bytes follow")
    return data


def _frame(match: re.Match[str], base: int) -> CanFrame:
    number, extended = _identifier(match, base)
    tokens = match["rest"].split()
    code = tokens[0] if tokens else ""
    if match["kind"].lower() == "r":
        requested = int(code, 16) if len(code) == 1 and code in "0123456789abcdefABCDEF" else 0
        return CanFrame(number, b"", extended, True, min(requested, DATA_MAX))
    if len(code) != 1 or code not in "0123456789abcdefABCDEF":
        raise _wrong(match, f"length {code!r}: expected one digit")
    return CanFrame(number, _data(match, tokens[1:], min(int(code, 16), DATA_MAX), base), extended)


def _fd_frame(match: re.Match[str], base: int) -> AnyFrame:
    number, extended = _identifier(match, base)
    length, tokens = int(match["length"]), match["rest"].split()
    if length > FD_LENGTHS[-1]:
        raise _wrong(match, f"length {length}: a CAN FD frame has at most {FD_LENGTHS[-1]} bytes")
    data = _data(match, tokens, length, base)
    rest = tokens[length:]  # duration, length in bits, flags
    try:
        flags = int(rest[2], 16) if len(rest) > 2 else _EDL
    except ValueError:
        flags = _EDL
    if not flags & _EDL and length <= DATA_MAX:
        if flags & 0x10:
            return CanFrame(number, b"", extended, True, min(int(match["code"], 16), DATA_MAX))
        return CanFrame(number, data, extended)
    return FdFrame(number, data, extended, int(match["brs"]) | int(match["esi"]) << 1)
