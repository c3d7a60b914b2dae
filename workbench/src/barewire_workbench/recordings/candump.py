"""CAN frames in the notation of candump: its output, and a frame that was typed.

**The output of candump: reads all its forms, writes its log**

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
    13:22:10.8857 605   [8]  40 41 60 ...                  a time of day, with the bus or without it: as it is posted

Posted lines may have marks of Markdown, and two frames in one line.
One line does not show whether its time is from -t d or -t z. Times are differences if one of them is smaller than the
one before: times since the first line only increase.

**A pasted CAN frame: a line of candump, or one of the short forms used in notes**

    605#4040600000000000     (1234.5) can0 605#...     605#R     605 40 40 60     can0 605 [8] 40 40 60 ...

Raises DecodeError with the character that cannot be read, and its place.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime

from barewire.canopen.frame import BASE_MAX, DATA_MAX, EXTENDED_MAX, AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.errors import DecodeError
from barewire_workbench.frames.input import HEX_DIGITS, HEX_PREFIX, parse_hex_token
from barewire_workbench.frames.result import counted, text_error
from barewire_workbench.recordings.model import (
    FD_LENGTHS,
    FD_MAX,
    Dropped,
    Recorded,
    RecordedItem,
    split_lines,
    unread,
    without_colours,
)

_STEP = 0.001
"""Seconds between two lines without times."""
_ERROR_FLAG = 0x2000_0000

_DROPS = re.compile(r"DROPCOUNT: dropped (\d+) CAN frames? on '([^']*)'")
_LOG = re.compile(r"\((\d{1,12}(?:\.\d{1,12})?)\)\s+(\S+)\s+([0-9A-Fa-f]+#\S*)(?:\s+[RT])?\s*$")
_NUMBER = re.compile(r"\d{1,12}(?:\.\d{1,12})?", re.ASCII)
_TIME = re.compile(r"\(([^()]*)\)\s*")
_DIRECTION = re.compile(r"\S+\s+(RX|TX)\s+[-B]\s+[-E]\s")
_SENT = {"T": True, "R": False}
_CLOCK = re.compile(r"(\d\d:\d\d:\d\d\.\d{1,9})\s+(?=(\S+\s+)?[0-9A-Fa-f]{3}(?:[0-9A-Fa-f]{5})?\s+\[\d)", re.ASCII)
_NEXT = re.compile(r"(?<=\S)(?=\(\d{1,12}\.\d{1,12}\)\s+\S+\s)")
"""Where the next frame begins in the same line."""
_COLUMNS = re.compile(
    r"(?P<bus>\S+)\s+(?:(?:RX|TX)\s+[-B]\s+[-E]\s+)?(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})\s+"
    r"(?P<open>[\[{])(?P<length>[0-9A-Fa-f]{1,2})[\]}](?P<rest>.*)$"
)


def _plain(line: str) -> str:
    """Return a line without colours and marks of Markdown, with a time of day as candump writes it."""
    return _unmarked(without_colours(line))


def _unmarked(uncoloured: str) -> str:
    plain = uncoloured.replace("**", "").strip().strip("`")
    if ":" not in plain:  # most lines: a recording has a million of them
        return plain
    return _CLOCK.sub(lambda clock: f"(1970-01-01 {clock[1]}) {'' if clock[2] else 'can0 '}", plain, count=1)


def _frame_texts(text: str | Iterable[str]) -> Iterator[tuple[int, str, str]]:
    """Yield the number and the text of each line that may hold a frame, and what is plain of each frame in it."""
    for number, line in enumerate(split_lines(text), start=1):
        uncoloured = without_colours(line)
        if not uncoloured.strip() or uncoloured.startswith("\t") or uncoloured.lstrip().startswith("# "):
            continue  # empty, the text of -e for the error frame above, a comment
        plain = _unmarked(uncoloured)
        if plain.find("(", 1) < 0:
            yield number, line, plain
        else:
            yield from ((number, line, part) for part in _NEXT.split(plain))


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
        match = _TIME.match(_plain(line))
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
        plain = _plain(line)
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
    return any(_TIME.match(_plain(line)) for line in text.splitlines()[:50])


def read_candump(text: str | Iterable[str], differences: bool | None = None) -> Iterator[RecordedItem]:
    """Yield the frames of a log or of screen output. `differences` tells what the times are; by default the text does.

    >>> [str(item.frame) for item in read_candump("(1.5) can0 705#05\\n  can0  705   [1]  7F")]
    ['705#05', '705#7F']
    """
    if differences is None:
        differences = isinstance(text, str) and are_differences(text)
    times = _Times(differences)
    now = 0.0
    for number, line, plain in _frame_texts(text):
        if drops := _DROPS.match(plain):
            yield Dropped(now, drops[2], int(drops[1]))
            continue
        try:
            stamp = _TIME.match(plain)
            now = times.read(stamp[1] if stamp else None)
            rest = plain[stamp.end() :] if stamp else plain
            bus, _, after = rest.partition(" ")
            if "#" in after and (log := after.split()) and "#" in log[0]:
                yield Recorded(now, bus, parse_frame(log[0]), number, _SENT.get(log[-1]))
            else:
                shown = _DIRECTION.match(rest)
                yield Recorded(now, *parse_columns(rest), number, shown and _SENT[shown[1][0]])
        except DecodeError as error:
            yield unread(now, number, error, line)
        except ValueError:
            yield unread(now, number, "the text in brackets is not a time", line)


_BUS = re.compile(r"(?i)[vsx]?l?can\d*|[a-z]+\d+")
_ERROR = re.compile(r"[23][0-9A-Fa-f]{7}#")  # bit 29 above the identifier: an error frame


def parse_any_can(text: str) -> AnyFrame:
    """Parse a CAN frame, a CAN FD frame or an error frame.

    >>> str(parse_any_can("(1.5) can0 123##1AABB")), parse_any_can("can0 20000040 [8] 00 00 00 00 00 00 00 00").text
    ('123##1AABB', 'bus off')
    """
    items = list(read_candump(text)) if "\n" not in text.strip() else []
    if len(items) == 1 and isinstance(items[0], Recorded) and not isinstance(items[0].frame, CanFrame):
        return items[0].frame
    stripped = text.strip()
    if "##" in stripped or _ERROR.match(stripped):
        return parse_frame(stripped)
    return parse_can(text)


def parse_can(text: str) -> CanFrame:
    """Parse a classical CAN frame, from a line of candump or from a short form.

    >>> str(parse_can("(1234.5) can0 605#40.41.60.00")), str(parse_can("605# 40 41 60 00"))
    ('605#40416000', '605#40416000')
    >>> str(parse_can("  vcan0  705   [1]  remote request")), str(parse_can("0x80"))
    ('705#R1', '080#')
    """
    body = re.sub(r"^\s*\([^)]*\)", lambda stamp: " " * len(stamp.group()), text)
    tokens = [(token.start(), token.group()) for token in re.finditer(r"\S+", body)]
    if tokens and "#" not in tokens[0][1] and _is_bus(tokens[0][1]):
        tokens = tokens[1:]
        if tokens and tokens[0][1] in ("RX", "TX"):  # candump -x: direction, and two flags
            tokens = tokens[3:]
    if not tokens:
        raise text_error("short", text, len(text), "not a CAN frame: expected something like 605#4041600000000000")
    (position, first), rest = tokens[0], tokens[1:]
    if "#" not in first and rest and rest[0][1].startswith("#"):
        (_, second), rest = rest[0], rest[1:]
        first += second
    if "#" in first:
        first, rest = _joined(first, rest)
        if rest and (len(rest) > 1 or rest[0][1] not in ("R", "T")):
            raise text_error("long", text, rest[0][0], f"{rest[0][1]!r} at {rest[0][0]} is left over after the frame")
        return _parsed(text, position, first)
    return _in_columns(text, position, first, rest)


def _joined(first: str, rest: list[tuple[int, str]]) -> tuple[str, list[tuple[int, str]]]:
    """Return the frame with the bytes that stand behind it, and what is left: 605#40 41 60 00, each with two digits."""
    start = re.sub(r"^#.", "", first.partition("#")[2])  # the flags of CAN FD
    if len(start.replace(".", "")) % 2 or not set(start) <= HEX_DIGITS | {"."}:
        return first, rest
    while rest and len(rest[0][1]) % 2 == 0 and set(rest[0][1]) <= HEX_DIGITS:
        first, rest = first + rest[0][1], rest[1:]
    return first, rest


def _is_bus(token: str) -> bool:
    """Return whether the token is the name of a bus, such as can0. `CA0` could be both and is an identifier."""
    return _BUS.fullmatch(token) is not None and not set(token) <= HEX_DIGITS and not token.startswith("0x")


def _in_columns(text: str, position: int, first: str, rest: list[tuple[int, str]]) -> CanFrame:
    """Parse identifier, [length], bytes; each token comes with its place in the text."""
    start = 2 if HEX_PREFIX.match(first) else 0
    identifier = first[start:].removesuffix("h")
    for place, character in enumerate(identifier, start=position + start):
        if character not in HEX_DIGITS:
            raise text_error("character", text, place, f"{character!r} at {place} is not a hexadecimal digit")
    length: int | None = None
    if rest and (given := re.fullmatch(r"\[(\d+)\]", rest[0][1])):
        length, rest = int(given.group(1)), rest[1:]
    if rest and rest[0][1] in ("remote", "R", "RTR"):
        body = f"R{length or 0}"
    else:
        # candump -a prints the characters in quotes after the bytes.
        quoted = next((place for place, (_, token) in enumerate(rest) if token.startswith("'")), len(rest))
        data = b"".join(parse_hex_token(text, place, token) for place, token in rest[:quoted])
        if length is not None and length != len(data):
            words = f"the length is [{length}], but {counted(len(data))} of data follow"
            raise text_error("length", text, rest[0][0] if rest else len(text), words)
        body = data.hex()
    return _parsed(text, position, f"{identifier.rjust(3, '0')}#{body}")


def _parsed(text: str, position: int, frame: str) -> CanFrame:
    """Parse a frame as `CanFrame.parse` does, with the place of an error in the whole text."""
    try:
        return CanFrame.parse(frame)
    except DecodeError as error:
        letters = [place for place in range(position, len(text)) if not text[place].isspace()]
        place = letters[error.at] if error.at < len(letters) else len(text)
        words = f"{text[place : place + 1]!r} is not a hexadecimal digit" if error.reason == "character" else error.text
        raise text_error(error.reason, text, place, f"{words}, at {place}") from None
