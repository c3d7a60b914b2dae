"""The output of candump: reads all its forms, writes its log.

    (1700000000.000100) can0 605#4041600000000000          -L and -l: the log; 705#R1 remote, 123##1AABB CAN FD,
    (1700000000.000100) can0 20000004#0001000000000000 R      20000004#... an error frame; R or T with -x
      can0  605   [8]  40 41 60 00 00 00 00 00             the screen; with -a '@A`.....' after it
     (0000.000800)  can0  605   [8]  40 41 ...             -t d: since the line before; -t z: since the first
     (2026-11-21 11:52:00.000100)  can0  605   [8] ...     -t A
      can0  RX - -  605   [8]  40 41 60                    -x: direction, bit rate switch, error state
      can0  605   [8]  00`00`00`00`00`60`41`40             -S: the last byte first;   -i: 01000000 01000001 ...
      can0  123  [12]  AA BB ...                           a length of two digits: CAN FD
      can0  20000004   [8]  00 01 ...   ERRORFRAME         with -e followed by lines that begin with a tab
    DROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 3)

One line does not show whether its time is from -t d or -t z. Times are differences if one of them is smaller than the
one before: times since the first line only increase.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime

from barewire.canopen.frame import BASE_MAX, DATA_MAX, EXTENDED_MAX, AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.errors import DecodeError
from barewire_workbench.frames.result import text_error
from barewire_workbench.recordings.model import FD_LENGTHS, FD_MAX, Dropped, Recorded, RecordedItem, split_lines, unread

_STEP = 0.001
"""Seconds between two lines without times."""
_ERROR_FLAG = 0x2000_0000

_ANSI = re.compile(r"\x1b\[[0-9;]*m")
_DROPS = re.compile(r"DROPCOUNT: dropped (\d+) CAN frames? on '([^']*)'")
_LOG = re.compile(r"\((\d{1,12}(?:\.\d{1,12})?)\)\s+(\S+)\s+([0-9A-Fa-f]+#\S*)(?:\s+[RT])?\s*$")
_NUMBER = re.compile(r"\d{1,12}(?:\.\d{1,12})?", re.ASCII)
_TIME = re.compile(r"\(([^()]*)\)\s*")
_COLUMNS = re.compile(
    r"(?P<bus>\S+)\s+(?:(?:RX|TX)\s+[-B]\s+[-E]\s+)?(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})\s+"
    r"(?P<open>[\[{])(?P<length>[0-9A-Fa-f]{1,2})[\]}](?P<rest>.*)$"
)


def log_line(at: float, bus: str, frame: AnyFrame) -> str:
    """Format the line of the log.

    >>> log_line(12.5, "can0", CanFrame.parse("705#R1"))
    '(0000000012.500000) can0 705#R1'
    """
    if isinstance(frame, ErrorFrame):
        text = f"{frame.classes | _ERROR_FLAG:08X}#{frame.data.hex().upper()}"
    else:
        text = str(frame)
    return f"({max(0.0, at):017.6f}) {bus} {text}"


def parse_frame(text: str) -> AnyFrame:
    """Parse a frame in the notation with '#': classical, CAN FD or error frame.

    >>> parse_frame("123##1AABB"), parse_frame("20000040#0000000000000000").text
    (FdFrame(id=291, data=b'\\xaa\\xbb', extended=False, flags=1), 'bus off')

    Raises DecodeError.
    """
    identifier, _, body = text.partition("#")
    if body.startswith("#"):
        number, extended = _identifier(identifier, text)
        digits = body[2:].replace(".", "")
        if len(body) < 2 or body[1] not in "0123456789ABCDEFabcdef":
            raise text_error("short", text, len(text), "## is followed by the flags of CAN FD, one digit")
        data = _data(digits, text)
        if len(data) > FD_MAX:
            raise text_error("long", text, len(text), f"{len(data)} bytes: a CAN FD frame has at most {FD_MAX}")
        return FdFrame(number, data, extended, int(body[1], 16) & 3)
    if len(identifier) == 8 and _is_error(identifier):
        data = _data(body.replace(".", ""), text)
        if len(data) > DATA_MAX:
            raise text_error("long", text, len(text), f"{len(data)} bytes: an error frame has at most {DATA_MAX}")
        return ErrorFrame(int(identifier, 16) & EXTENDED_MAX, data)
    return CanFrame.parse(re.sub(r"_[9A-Fa-f]$", "", text))  # _9 to _F: a length code above 8, which means 8 bytes


def _is_error(identifier: str) -> bool:
    try:
        number = int(identifier, 16)
    except ValueError:
        return False
    return bool(number & _ERROR_FLAG) and number <= _ERROR_FLAG | EXTENDED_MAX


def _identifier(digits: str, text: str) -> tuple[int, bool]:
    try:
        number = int(digits, 16)
    except ValueError:
        raise text_error("character", text, 0, f"identifier {digits!r} is not hexadecimal") from None
    extended = len(digits) == 8
    if len(digits) not in (3, 8) or number > (EXTENDED_MAX if extended else BASE_MAX):
        raise text_error(
            "value", text, 0, f"identifier {digits!r}: expected 3 hex digits up to 7FF, or 8 up to 1FFFFFFF"
        )
    return number, extended


def _data(digits: str, text: str) -> bytes:
    try:
        return bytes.fromhex(digits)
    except ValueError:
        raise text_error("character", text, 0, f"{digits[:24]!r} is not bytes in hexadecimal") from None


def parse_columns(text: str) -> tuple[str, AnyFrame]:
    """Parse bus and frame of a line of the screen without its time. Raises DecodeError.

    >>> bus, frame = parse_columns("vcan0  705   [1]  remote request")
    >>> bus, str(frame)
    ('vcan0', '705#R1')
    """
    match = _COLUMNS.match(text)
    if match is None:
        raise text_error("delimiter", text, 0, "not a line of candump: expected bus, identifier, [length], bytes")
    rest, digits, is_raw = match["rest"], match["id"], match["open"] == "{"
    length = int(match["length"], 16 if is_raw else 10) if match["length"].isdecimal() or is_raw else -1
    fd = len(match["length"]) == 2 and not is_raw
    if is_raw:
        length = min(length, DATA_MAX)
    if not 0 <= length <= (FD_MAX if fd else DATA_MAX) or (fd and length not in FD_LENGTHS):
        raise text_error("value", text, match.start("length"), f"length [{match['length']}] is impossible for CAN")
    if "remote request" in rest:
        number, extended = _identifier(digits, text)
        return match["bus"], CanFrame(number, b"", extended, True, length)
    data = _bytes(rest, length, text)
    if len(digits) == 8 and _is_error(digits):
        return match["bus"], ErrorFrame(int(digits, 16) & EXTENDED_MAX, data)
    number, extended = _identifier(digits, text)
    return match["bus"], FdFrame(number, data, extended) if fd else CanFrame(number, data, extended)


def _bytes(rest: str, length: int, text: str) -> bytes:
    """Parse `length` bytes in one of the three notations; the characters after them are ignored."""
    tokens = rest.split()
    if tokens and "`" in tokens[0]:  # -S: in reverse order, with a delimiter
        tokens = list(reversed(tokens[0].split("`")))
    tokens = tokens[:length]
    if len(tokens) < length:
        raise text_error("short", text, len(text), f"the length is [{length}], but {len(tokens)} bytes follow")
    base = 2 if tokens and all(len(token) == 8 and not token.strip("01") for token in tokens) else 16
    if base == 16 and any(len(token) != 2 for token in tokens):
        raise text_error("character", text, 0, f"{' '.join(tokens)[:24]!r} is not bytes")
    try:
        return bytes(int(token, base) for token in tokens)
    except ValueError:
        raise text_error("character", text, 0, f"{' '.join(tokens)[:24]!r} is not bytes in hexadecimal") from None


def _seconds(stamp: str) -> float:
    """Return a time as a number. Raises ValueError for other text, also for notations that only Python accepts."""
    if not _NUMBER.fullmatch(stamp):
        raise ValueError(stamp)
    return float(stamp)


class _Times:
    """The times of the lines: absolute ones count from 1970, small ones from the first or the last line."""

    def __init__(self, differences: bool) -> None:
        self._differences = differences
        self._now = 0.0

    def read(self, stamp: str | None) -> float:
        """Return the time of the next line. Raises ValueError if the stamp is not a time."""
        if stamp is None:
            self._now += _STEP
        elif "-" in stamp:
            self._now = datetime.fromisoformat(stamp).replace(tzinfo=UTC).timestamp()
        else:
            number = _seconds(stamp)
            self._now = self._now + number if self._differences else number
        return self._now


def are_differences(text: str) -> bool:
    """Return whether the times are differences (-t d): small, and not always increasing."""
    last = -1.0
    for line in text.splitlines():
        match = _TIME.match(_ANSI.sub("", line).strip())
        if match is None:
            continue
        try:
            number = _seconds(match[1])
        except ValueError:
            return False
        if number >= 1e8:
            return False
        if number < last:
            return True
        last = number
    return False


def is_candump(text: str) -> bool:
    """Return whether one of the first lines is a line of candump."""
    for line in text.splitlines()[:50]:
        plain = _ANSI.sub("", line).strip()
        if _DROPS.match(plain) or _LOG.match(plain):
            return True
        if _COLUMNS.match(_TIME.sub("", plain, count=1)):
            return True
    return False


def has_times(text: str) -> bool:
    """Return whether the lines begin with times. Without them they count as 1 ms apart.

    >>> has_times("(1.5) can0 705#05"), has_times("  can0  705   [1]  7F")
    (True, False)
    """
    plain = (_ANSI.sub("", line).strip() for line in text.splitlines()[:50])
    return any(_TIME.match(line) for line in plain)


def read_candump(text: str | Iterable[str], differences: bool | None = None) -> Iterator[RecordedItem]:
    """Yield the frames of a log or of screen output. `differences` tells what the times are; by default the text does.

    >>> [str(item.frame) for item in read_candump("(1.5) can0 705#05\\n  can0  705   [1]  7F")]
    ['705#05', '705#7F']
    """
    if differences is None:
        differences = isinstance(text, str) and are_differences(text)
    times = _Times(differences)
    now = 0.0
    for number, line in enumerate(split_lines(text), start=1):
        plain = _ANSI.sub("", line) if "\x1b" in line else line
        if not plain.strip() or plain.startswith("\t") or plain.lstrip().startswith("# "):
            continue  # empty, the text of -e for the error frame above, a comment
        plain = plain.strip()
        if drops := _DROPS.match(plain):
            yield Dropped(now, drops[2], int(drops[1]))
            continue
        try:
            stamp = _TIME.match(plain)
            now = times.read(stamp[1] if stamp else None)
            rest = plain[stamp.end() :] if stamp else plain
            bus, _, after = rest.partition(" ")
            if "#" in after and (log := after.split()) and "#" in log[0]:
                yield Recorded(now, bus, parse_frame(log[0]), number)
            else:
                yield Recorded(now, *parse_columns(rest), number)
        except DecodeError as error:
            yield unread(now, number, error, line)
        except ValueError:
            yield unread(now, number, "the text in brackets is not a time", line)
