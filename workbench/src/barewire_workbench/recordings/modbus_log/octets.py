"""Bytes and times in the lines of a log.

**Logs of a serial line as text: bytes with times, and dumps without**

    12.345678 01 03 00 00 00 02 C4 0B         seconds; also (12.345678), [12.345678] and 10:31:18.25
    01 03 00 00 00 02 C4 0B                   no time: a line is one piece
    00000000: 0103 0000 0002 c40b  ......     xxd or hexdump -C: one piece, however many lines
    # text                                    a comment, skipped like an empty line
    01 03 00 00 00 02 C4 0B   <-- good        a remark: behind blanks and <-- // # ; or (

The bytes are in any notation of `frames.input.parse_hex`; a direction mark (> or <) may come before them.

**Times in the lines of logs**

    2024-01-05 10:31:18,257    2024-01-05T10:31:18.257Z    14.05.2025 09:57:07.113    2024/05/11 13:17:34.792
    05/01/2024 10:31:18.2 AM   a date with slashes that may be of two days: only the time of day counts
    10:31:18.257   14:32:05:052 (QModMaster)   0:13.5      a time of day, or minutes and seconds
    1700000000.257   12.345678   (12.5)   [12.5]           seconds

`LogClock` turns them into seconds that never decrease: a time of day that goes back by more than half a day is of the
next day; any other step back is kept out of the times, and noted.

**Bytes at the end of a line of a log, in any notation, and what stands before them**

    ... 0x1 0x3 0x0 0x0       ... 01 03 00 00      ... 1,3,0,A      ... 01-03-00-00     ... 01:03:00:00
    ... \x01\x03              ... 01030000         ... 0103 0000    ... [01][03]        ... <01><03>
    ... b'\x01\x03\n'         bytes of Python
    ... TX: 1, 3, 0, 22       decimal: numbers of three digits occur in the log, and no letters
    ... :010300000002FA       a frame of ASCII

A count behind the bytes (`> 9 bytes`) has to be theirs; a remark behind them (`// good`) is none of them.

Only tokens with the same separator belong together: in `14:32:05 - 64 03 00` the bytes are 64 03 00. Digits that can be
hexadecimal and decimal are returned both ways; the whole log decides.
"""

from __future__ import annotations

import re
from datetime import date
from functools import lru_cache
from typing import NamedTuple

from barewire.errors import DecodeError
from barewire_workbench.frames.input import parse_hex, parse_string_literal
from barewire_workbench.recordings.modbus_log.model import Stamp

STEP = 0.1
"""Seconds between two entries without times: long enough to end a frame, short enough to wait for an answer."""
_PIECE = 0x1000
"""Bytes of a piece of a dump that is read part by part."""

DUMP_OFFSET = re.compile(r"(?:0x)?[0-9A-Fa-f]{6,8}(?:: ?|  )(?=[0-9A-Fa-f]{2})")
_BYTELOG_TIME = re.compile(r"[(\[]?(?:(?:(\d{1,12}):)?(\d{1,12}):)?(\d{1,12}[.,]\d+|\d{1,12}(?=[)\]]))[)\]]?:?\s+")
_MARK = re.compile(r"(?:<-|->|[<>]|[RT]X:?)\s*", re.IGNORECASE)

_HEX_PAIRS = re.compile(r"[0-9A-Fa-f]{2}(?: [0-9A-Fa-f]{2})+")
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
        offset, time = DUMP_OFFSET.match(content), _BYTELOG_TIME.match(content)
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
            now += STEP
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
    remark = _REMARK.search(line)
    return line if remark is None else line[: remark.start()]


def _bytes(text: str, number: int) -> bytes:
    if text.startswith(":"):  # an ASCII frame as it was sent
        return text.encode("latin-1", "replace") + b"\r\n"
    if _HEX_PAIRS.fullmatch(text):
        return bytes.fromhex(text)
    try:
        return parse_hex(text)
    except DecodeError as error:
        octets = split_octets(text)
        if octets is not None and not octets.before.strip() and (data := octets.data or octets.decimal):
            return data
        raise DecodeError(error.reason, error.data, error.at, f"line {number}: {error.text}") from None


_DAY = 86400.0
_BACK = 1e-6
"""Seconds: a smaller step back is rounding."""

_NAMES = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_MONTHS = {name: number for number, name in enumerate(_NAMES, 1)}
_DATE = (
    r"(?:(?P<iso>\d{4})[-/.](?P<imonth>\d{1,2})[-/.](?P<iday>\d{1,2})"
    r"|(?P<first>\d{1,2})(?P<between>[-/.])(?P<second>\d{1,2})(?P=between)(?P<year>\d{4})"
    r"|(?P<name>[A-Z][a-z]{2}) {1,2}(?P<nday>\d{1,2})(?:[ ,]+(?P<nyear>\d{4}))?)"
)
_OF_DAY = r"(?P<hours>\d{1,2}):(?P<minutes>\d{2}):(?P<seconds>\d{2}(?:[.,:]\d{1,9})?)(?: ?(?P<half>[AaPp][Mm]))?"
_ZONE = r"(?:Z|[+-]\d\d:?\d\d)?"
_DATED = re.compile(rf"(?<![\w.]){_DATE}(?:[T@_]|,? +)?{_OF_DAY}(?: (?P<lastyear>\d{{4}}))?{_ZONE}(?!\w)")
_TIME = re.compile(rf"(?<![\w:.]){_OF_DAY}(?![\w:])")
_SHORT = re.compile(r"^\s*[(\[]?(?P<minutes>\d{1,3}):(?P<seconds>\d{2}[.,]\d+)[)\]]?(?=[:;,\s]|$)")
_SECONDS = re.compile(r"^\s*(?:[(\[]\s*(\d{1,12}(?:[.,]\d{1,9})?)\s*[)\]]|(\d{1,12}[.,]\d{1,9}))(?=[:;,\s]|$)")


def find_stamp(text: str) -> tuple[Stamp, int, int] | None:
    """Return the first time in a line, and where it begins and ends; None if there is none.

    >>> find_stamp("2024-01-05 10:31:18,257 DEBUG recv: 0x1")
    (Stamp(seconds=37878.257, day=19727, of_day=True), 0, 23)
    >>> find_stamp("[RTU]>Tx > 14:32:05:052 - 64 03")[0]
    Stamp(seconds=52325.052, day=None, of_day=True)
    >>> find_stamp("(12.5) 01 03"), find_stamp("01 03 00 00")
    ((Stamp(seconds=12.5, day=None, of_day=False), 0, 6), None)
    """
    if ":" in text:
        if match := _DATED.search(text):
            return Stamp(_of_day(match), _day(match), True), match.start(), match.end()
        if match := _TIME.search(text):
            return Stamp(_of_day(match), None, True), match.start(), match.end()
        if match := _SHORT.match(text):
            return Stamp(60 * int(match["minutes"]) + _number(match["seconds"])), match.start(), match.end()
    if match := _SECONDS.match(text):
        return Stamp(_number(match[1] or match[2])), match.start(), match.end()
    return None


def stamp_in(text: str) -> Stamp | None:
    """Return the first time in a line."""
    stamp = find_stamp(text)
    return None if stamp is None else stamp[0]


def without_stamp(line: str) -> tuple[str, Stamp | None]:
    """Return a line with blanks in place of its first time, and that time.

    >>> without_stamp("(12.5) 01 03")
    ('       01 03', Stamp(seconds=12.5, day=None, of_day=False))
    """
    stamp_and_place = find_stamp(line)
    if stamp_and_place is None:
        return line, None
    stamp, start, end = stamp_and_place
    return line[:start] + " " * (end - start) + line[end:], stamp


def _number(text: str) -> float:
    return float(text.replace(",", ".").replace(":", "."))


def _of_day(match: re.Match[str]) -> float:
    hours = int(match["hours"])
    if match["half"]:
        hours = hours % 12 + (12 if match["half"].lower() == "pm" else 0)
    return 3600 * hours + 60 * int(match["minutes"]) + _number(match["seconds"])


def _day(match: re.Match[str]) -> int | None:
    """Return the day, counted from 1970-01-01; None if the date does not state the year or the order of its parts."""
    if match["iso"]:
        year, month, day = int(match["iso"]), int(match["imonth"]), int(match["iday"])
    elif match["year"]:
        first, second, year = int(match["first"]), int(match["second"]), int(match["year"])
        if match["between"] != "." and first <= 12 and second <= 12 and first != second:
            return None
        day, month = (second, first) if second > 12 else (first, second)
    else:
        stated = match["nyear"] or match["lastyear"]
        if not stated:
            return None
        year, month, day = int(stated), _MONTHS.get(match["name"].lower(), 0), int(match["nday"])
    return _day_number(year, month, day)


@lru_cache(16)
def _day_number(year: int, month: int, day: int) -> int | None:
    try:
        return date(year, month, day).toordinal() - date(1970, 1, 1).toordinal()
    except ValueError:
        return None


class LogClock:
    """Turns the stamps of a log, in order, into seconds that never decrease.

    >>> clock = LogClock()
    >>> [clock.read(Stamp(seconds, None, True), 1) for seconds in (86399.0, 1.0)]
    [86399.0, 86401.0]
    """

    def __init__(self) -> None:
        self.timed = False
        self.notes: list[str] = []
        self._now = 0.0
        self._began = False
        self._offset = 0.0

    def read(self, stamp: Stamp | None, line: int, *, step: bool = True) -> float:
        """Return the time of an entry. Without a stamp it is `STEP` after the one before, or that one's time in a log
        that has times, and without `step`."""
        if stamp is None:
            self._now += STEP if self._began and step and not self.timed else 0.0
            self._began = True
            return self._now
        at = stamp.seconds + _DAY * (stamp.day or 0) + self._offset
        if self._began and self.timed and at < self._now - _BACK:
            if stamp.of_day and stamp.day is None and self._now - at > _DAY / 2:
                self._offset += _DAY
                at += _DAY
            if at < self._now - _BACK:
                back = self._now - at
                self.notes.append(f"line {line}: the times go back by {back:g} s; later ones are counted from there")
                self._offset += back
        self._now = max(self._now, at) if self.timed else at
        self._began = self.timed = True
        return self._now


_H = r"[0-9A-Fa-f]"
_END = re.compile(r"\s*(?:\(\d+(?: bytes)?\)|\[\d+ bytes\])?[\s,;.)\]}>'\"]*(?:[;|\t] ?\d{1,4}[;\s]*)?$")
_FORMS = tuple(
    (needed, re.compile(form))
    for needed, form in (
        (":", rf"(?P<ascii>(?<!\w):(?:{_H}{{2}}){{3,}})(?:\\r\\n|\\r|\\n|<CR><LF>|\[CR\]\[LF\])?"),
        ("xX", rf"(?P<list>(?<![\w])0[xX]{_H}{{1,2}}(?:[\s,;\-:|'\"]+0[xX]{_H}{{1,2}})*)"),
        ("\\", rf"(?P<list>(?:\\x?{_H}{{2}})+)(?!\w)"),
        ("\\", r"(?P<octal>(?:\\[0-3][0-7]{2})+)"),
        ("[", rf"(?P<list>(?:\[\s*(?:0[xX])?{_H}{{2}}\s*\]\s*)+)"),
        ("<", rf"(?P<list>(?:<\s*(?:0[xX])?{_H}{{2}}\s*>\s*)+)"),
        ("([<", r"(?P<decimal>(?:[\[<(]\s*[0-2]\d\d\s*[\])>]\s*)+)"),
        ("hH", rf"(?P<list>(?<![\w]){_H}{{2}}[hH](?:[\s,]+{_H}{{2}}[hH])*)"),
        ("", rf"(?P<list>(?<!\w)(?<!\d[\-:,|]){_H}{{1,2}}(?:\s+{_H}{{1,2}}){{1,}})"),
        ("-", rf"(?P<list>(?<!\w)(?<!\d-){_H}{{1,2}}(?:-{_H}{{1,2}}){{1,}})"),
        ("-", r"(?P<decimal>(?<![\w-])\d{1,3}(?:-\d{1,3}){3,})"),
        (":", rf"(?P<list>(?<!\w)(?<!\d:){_H}{{2}}(?::{_H}{{2}}){{1,}})"),
        (".", rf"(?P<list>(?<![\w.]){_H}{{2}}(?:\.{_H}{{2}}){{4,}})(?![.\w])"),
        ("|", rf"(?P<list>(?<![\w|]){_H}{{2}}(?:\|{_H}{{2}}){{3,}})(?![|\w])"),
        (",", rf"(?P<list>(?<!\w)(?<!\d,){_H}{{1,2}}(?:,\s*{_H}{{1,2}}){{1,}})"),
        (",", r"(?P<decimal>(?<![\w,])-?\d{1,3}(?:,\s*-?\d{1,3}){1,})"),
        ("", r"(?P<decimal>(?<![\w,])\d{1,3}(?:\s+\d{1,3}){1,})"),
        ("", rf"(?P<list>(?<![\w]){_H}{{4}}(?:(?:\s+{_H}{{4}})+(?:\s+{_H}{{2}})?|\s+{_H}{{2}}))"),
        ("", rf"(?P<list>(?<![\w])(?:0[xX])?(?:{_H}{{2}}){{4,}})"),
    )
)
"""Each with characters one of which it needs, if there are such: most lines are not searched for most forms."""
_BLANKS = "".join(chr(code) for code in range(0x3001) if chr(code).isspace())
_AT_THE_END = f"0123456789abcdefABCDEF{_BLANKS}xXhHrnRLyts\\[](){{}}<>:,;.|'\"-"
"""All characters of bytes in any notation, and of what may follow them."""
_PAIRS = re.compile(rf"(?P<mark>[xXrRtTsSnL]{{0,3}}[:>\])-]{{0,3}} {{1,20}})?(?P<bytes>{_H}{{2}}(?: {_H}{{2}})+)\s*")
"""The notation of nearly all logs, behind the end of a word: no other form reads more of it."""
_REMARKS = frozenset("<←/#;(")
_LITERALS = tuple(
    re.compile(rf"""(?<![\w\\]){prefix}(?P<string>'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*")""") for prefix in ("b", "")
)
_ESCAPED = re.compile(rf"\\(?:x{_H}{{2}}|[0-3][0-7]{{2}})")
_INSIDE = (
    re.compile(rf"(?<![\w.:-])(?P<list>{_H}{{2}}(?: {{1,2}}{_H}{{2}}){{3,}})(?![\w-])"),
    re.compile(rf"(?<![\w.:-])(?P<list>{_H}{{2}}(?:(?P<by>[.:,-]){_H}{{2}})(?:(?P=by){_H}{{2}}){{3,}})(?![\w.:-])"),
    re.compile(rf"(?<!\w)(?P<list>0[xX]{_H}{{1,2}}(?:[\s,;|'\"-]{{1,3}}0[xX]{_H}{{1,2}}){{3,}})(?!\w)"),
    re.compile(rf"(?P<list>(?:[\[<]\s?{_H}{{2}}\s?[\]>]\s?){{4,}})"),
    re.compile(rf"(?P<list>(?:\\x{_H}{{2}}){{4,}})"),
)
"""Rows of bytes that are told from other words without the end of the line."""
_LEAST_INSIDE, _LONGEST_INSIDE = 4, 2000
_MAC = 17
"""Characters of the address of a network card, 02:42:ac:11:00:02."""
HIDDEN = r"(?:[xX]{2}|\?\?)(?!\w)"
"""A byte that is not shown, as a pattern."""
_CUT = re.compile(rf"(?<![.\w])\.\.\.(?!\.)[\s'\")\]>}}]*$|…|\d+ more bytes?|(?<=\w ){HIDDEN}")
"""What a program prints in place of the bytes that it leaves out."""
_OPENER = re.compile(
    r"(?:\{?\s*\"type\"\s*:\s*\"Buffer\"\s*,\s*\"data\"\s*:\s*|<?Buffer|bytearray\(b?|bytes\(|\bb)?[\s\"'({\[]*$"
)
"""What a language prints before the bytes: no part of the text that states their direction."""
_COUNT = re.compile(r"(?<=\W)(?P<opened>[(\[]?)(?P<count>\d{1,4}) ?bytes?[)\]]?\s*$", re.IGNORECASE)
"""A count without brackets could be a byte, too: it has to be right."""
_TOKEN = re.compile(rf"(?:0[xX]|\\x)?({_H}+)")


class Octets(NamedTuple):
    """The text before the bytes, and the bytes: as hexadecimal digits, and as decimal numbers; None if impossible."""

    before: str
    data: bytes | None
    decimal: bytes | None = None


def split_octets(line: str) -> Octets | None:
    """Split a line into what stands before its bytes, and the bytes; None if it does not end with two bytes or more.

    >>> split_octets("recv: 0x1 0x83 0x2 0xc0 0xf1")
    Octets(before='recv:', data=b'\\x01\\x83\\x02\\xc0\\xf1', decimal=None)
    >>> split_octets("TX: 1, 3, 0, 22, 0, 2, 37, 207").decimal.hex(" "), split_octets("nothing at all")
    ('01 03 00 16 00 02 25 cf', None)
    """
    counted = "yte" in line or "YTE" in line
    octets = _counted(line) if counted else None
    if octets is None:
        octets = _split(line)
    if octets is None and not _REMARKS.isdisjoint(line) and (plain := without_remark(line)) != line:
        octets = _split(plain)
    has_count = counted and _COUNT.search(line) is not None
    if _size(octets) < _LEAST_INSIDE and not has_count and _size(inside := _inside(line)) > _size(octets):
        octets = inside
    if octets is None or (_CUT.search(line, len(octets.before)) and _size(octets) != 3):
        return None
    opener = _OPENER.search(octets.before)
    return octets if opener is None else octets._replace(before=octets.before[: opener.start()])


def _size(octets: Octets | None) -> int:
    return 0 if octets is None else len(octets.data or octets.decimal or b"")


def _counted(line: str) -> Octets | None:
    """Return the bytes before a count that ends the line: `(8 bytes)`, or a count without brackets that is theirs."""
    count = _COUNT.search(line)
    octets = None if count is None else _split(line[: count.start()])
    if count is None or octets is None:
        return None
    is_right = int(count["count"]) in map(len, filter(None, octets[1:]))
    return octets if is_right or count["opened"] else None


def _inside(line: str) -> Octets | None:
    """Return the bytes with other text behind them, as `<Buffer 01 03 ...>, unit: 1 }`; None if there are none, or
    several rows of them. Joined digits and decimal numbers count only at the end: inside they are names and values."""
    rows = [] if len(line) > _LONGEST_INSIDE else [match for form in _INSIDE for match in form.finditer(line)]
    if len(rows) != 1 or (":" in rows[0][0] and len(rows[0][0]) == _MAC):
        return None
    return _of_form(line, rows[0])


def _split(line: str) -> Octets | None:
    """Split a line that has nothing but punctuation, or a count in brackets, behind its bytes."""
    for form in _LITERALS if "'" in line or '"' in line else ():
        literal = _last_match(form, line)
        if (
            literal is not None
            and _END.match(line, literal.end())
            and (form is _LITERALS[0] or _ESCAPED.search(literal[0]))
        ):
            return _of_literal(line, literal)
    best: re.Match[str] | None = None
    start = len(line.rstrip(_AT_THE_END))
    end = line[start:]
    if (pairs := _PAIRS.fullmatch(end.lstrip())) and (pairs["mark"] or start == 0):
        digits = pairs["bytes"]
        data = bytes.fromhex(digits)
        before = line[: len(line) - len(pairs[0]) + pairs.start("bytes")]
        is_hex = not digits.replace(" ", "").isdecimal()
        return Octets(before, data, None if is_hex else _decimal(digits.split(), digits))
    for needed, form in _FORMS:
        if needed and not any(character in end for character in needed):
            continue
        match = _last_match(form, line, start)
        if match is not None and _END.match(line, match.end()) and (best is None or match.start() < best.start()):
            best = match  # the form that reads the most of the line
    return None if best is None else _of_form(line, best)


def _last_match(form: re.Pattern[str], line: str, start: int = 0) -> re.Match[str] | None:
    """Return the last match; a search for one that ends at the end of the line would take quadratic time."""
    match = None
    for match in form.finditer(line, start):  # noqa: B007 - the last one
        pass
    return match


def _of_form(line: str, match: re.Match[str]) -> Octets | None:
    """Return the bytes of a match of one of the forms."""
    before = line[: match.start()]
    kind, text = next((kind, text) for kind, text in match.groupdict().items() if text is not None and kind != "by")
    if kind == "ascii":
        return Octets(before, text.encode() + b"\r\n")
    if kind == "octal":
        return Octets(before, bytes(int(digits, 8) for digits in text.split("\\")[1:]))
    tokens = [token[1] for token in _TOKEN.finditer(text)]
    decimal = _decimal(text.split(",") if "-" in text and "," in text else tokens, text)
    if kind == "decimal":
        return None if decimal is None else Octets(before, None, decimal)
    return Octets(before, b"".join(bytes.fromhex(token.rjust(2, "0")) for token in tokens), decimal)


def _of_literal(line: str, match: re.Match[str]) -> Octets | None:
    """Return the bytes of b'...': escapes and characters, or the digits of hexlify."""
    content = match["string"][1:-1]
    try:
        data = parse_string_literal(f"b{match['string']}")
        if data is None:
            data = bytes.fromhex(content)
    except (DecodeError, ValueError):
        return None
    return Octets(line[: match.start()], data) if len(data) > 1 else None


def _decimal(tokens: list[str], text: str) -> bytes | None:
    """Return the bytes of decimal numbers; None if a token shows that they are hexadecimal."""
    digits = [token.strip().removeprefix("-") for token in tokens]
    if "x" in text.lower() or not all(token.isdecimal() for token in digits):
        return None
    if any(len(token) > 3 or (len(token) == 2 and token[0] == "0") or int(token) > 255 for token in digits):
        return None
    return bytes(int(token) & 0xFF for token in tokens)
