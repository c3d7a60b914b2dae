r"""Bytes within what people post: in sentences, in code, behind words without a blank, in any notation.

    I get `01 83 02 C0 F1` back, where [1, 3, 0, 22, 0, 2, 37, 207] was sent      two frames, the second in decimal
    data='\x01\x83\x02\xc0\xf1'  # from the device                           a string with escapes
    req: 0A 10 0001 0003 06 0A0B0C EE98                                           bytes and words of two bytes mixed
    Response: 00 01 02 ff [00 c5]                                                 brackets around a part

Numbers in a row are read as bytes only for a reason, which becomes a note. Some of them are a whole frame: a CRC, or a
header with its length. Or their end is the CRC of the whole. Or they are five or more with one separator, each of
two hexadecimal digits or with 0x. What stands beside a frame in the same notation belongs to it, so that noise is kept.
The shape of a frame states its direction; of other bytes the words before them do, in their line or the one above.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from itertools import accumulate, pairwise
from typing import NamedTuple

from barewire.errors import DecodeError
from barewire.modbus.messages.registry import measure_request, measure_response
from barewire.rtu.crc import crc16
from barewire_workbench.frames.input import parse_string_literal
from barewire_workbench.recordings.modbus_log.envelope import ENVELOPE_START, envelope_size
from barewire_workbench.recordings.modbus_log.marked import direction_of, frame_pdu, has_its_length
from barewire_workbench.recordings.modbus_log.model import LogEntry
from barewire_workbench.recordings.modbus_log.octets import HIDDEN
from barewire_workbench.sniffer import shapes

_TOKEN = re.compile(
    r"(?:(?P<mark>(?<!\w)0[xX]|\\x)|(?<![\w.\\]))(?P<digits>[0-9A-Fa-f]{1,520})(?P<h>[hH]?)(?!\w|\.\d)", re.ASCII
)
"""A word of another script ends where the digits begin."""
_GAP = re.compile(r"[\s,;:|\[\](){}<>'\"/+-]{0,6}")
"""What may stand between two bytes."""
_MARKUP = re.compile(r"</?(?:b|i|code|pre|strong|em|p|br|tt)\s*/?>|\*\*|`")
"""What sets bytes off in a text of Markdown or HTML."""
_LITERAL = re.compile(r"""b?(?:'(?:[^'\\]|\\.){1,1000}'|"(?:[^"\\]|\\.){1,1000}")""")
_ESCAPED = re.compile(r"\\x[0-9A-Fa-f]{2}|\\[0-3][0-7]{2}")
_QUOTES = str.maketrans("\u201c\u201d\u201e\u2018\u2019", '"""\'\'')
"""Quotes as a word processor or a forum sets them."""
_WORD = re.compile(r"(?i)[g-z][a-z]{2,}|[a-z]{2,}[g-z]|[^\x00-\x7F]{2}")
_ONE_NOTATION, IN_PART = "bytes in one notation", "bytes that are printed in part"
PROSE = re.compile(r"(?:\b[A-Za-z']{2,}\b,? +){4}")
"""Words of a sentence: bytes beside them may be a part of a frame, or an example."""
_CUT = re.compile(rf"[\s,;:>\])'\"]{{0,3}}(?:\.\.\.|…|{HIDDEN})")
"""What stands behind bytes in place of the others."""
_CODE = re.compile(r"(?:=\s*\[?|\{)\s*~|~\s*(?:,\s*$|[};])")
"""Where bytes stand in the code of a program: ~ are they."""
_BYTE = r"(?:0[xX][0-9A-Fa-f]{1,2}|\d{1,3})\b"
_BUILDS = re.compile(
    rf"\b(?P<list>\w+)\s*(?:\[\w*\]\s*)?=\s*[\[{{]\s*(?P<bytes>{_BYTE}(?:\s*,\s*{_BYTE})*)\s*,?\s*[\]}}]|"
    rf"\b(?P<set>\w+)\[(?P<at>\d{{1,3}})\]\s*=\s*(?P<byte>{_BYTE})|"
    rf"\b(?P<add>\w+)\.(?:push_back|append|push|add|write)\(\s*(?P<more>{_BYTE})\s*\)"
)
"""A list of bytes in the code of a program, a byte that is set in it, and one that is added."""
_LEAST = 5
"""So many bytes in one notation are no date, time or address of a host."""
_MAC = 6
_SHORTEST = 4
_WORDS = 80
"""Characters before the bytes in which a word may state their direction."""


class _Number(NamedTuple):
    """A number in a line: where it is, its notation, what stands before it, and its bytes; None if it has none."""

    start: int
    end: int
    kind: tuple[str, int]
    gap: str
    data: bytes | None
    decimal: int | None


class Posted(NamedTuple):
    """Bytes in a line of a text, and why they are that."""

    entry: LogEntry
    why: str


def without_markup(line: str) -> str:
    """Return a line with plain quotes, without the marks of Markdown and HTML around its parts, and without the > of a
    quotation.

    >>> without_markup("> received **01 83 02 C0 F1** <b>now</b>")
    'received 01 83 02 C0 F1 now'
    """
    plain = line.translate(_QUOTES)
    return plain if _ESCAPED.search(plain) else _MARKUP.sub("", plain).removeprefix("> ")  # marks may be characters


def whole_frames(data: bytes, starts: set[int] | None = None) -> list[tuple[int, int]]:
    """Return where whole frames of RTU and TCP begin and end, none of them within another; `starts` are the places
    where one may begin, beside the end of another.

    >>> whole_frames(bytes.fromhex("FF 01 83 02 C0 F1 00"))
    [(1, 6)]
    """
    found: list[tuple[int, int]] = []
    at = 0
    while at < len(data):
        end = _end_of_frame(data, at) if starts is None or at in starts or (found and found[-1][1] == at) else None
        if end is not None and (starts is None or end in starts or end == len(data)):
            found.append((at, end))
        at = end or at + 1
    return found


def _end_of_frame(data: bytes, at: int) -> int | None:
    if data[at] == ENVELOPE_START and (envelope := envelope_size(data, at)) is not None:
        return at + envelope
    size = 6 + int.from_bytes(data[at + 4 : at + 6], "big")
    pdu = frame_pdu("tcp", data[at : at + size]) if data[at + 2 : at + 4] == b"\0\0" else None
    if pdu and has_its_length(pdu):
        return at + size
    for measure in (measure_request, measure_response):
        length = measure(data[at + 1 :])
        if length is not None and at + length + 3 <= len(data) and crc16(data[at : at + length + 3]) == 0:
            return at + length + 3
    return None


def read_posted(lines: list[str], least: int = _LEAST) -> list[Posted]:
    """Return the bytes in the lines of a text, in their order; of those in one notation `least` in a row.

    >>> [(found.entry.data.hex(" "), found.why) for found in read_posted(["it says:[1, 131, 2, 192, 241]."])]
    [('01 83 02 c0 f1', 'a whole frame, in decimal')]
    """
    found: list[Posted] = []
    above, code = "", -1  # the line above, and the last line of code
    if not any(map(_WORD.search, lines)):
        return []  # a log of bytes alone, with an error in it
    for number, line in enumerate(lines, start=1):
        last = 0
        for start, end, data, why in _rows(line, least):
            before = line[max(last, start - _WORDS) : start].rstrip(" [({<'\"") or (above if not last else "")
            _, sent, from_client = direction_of(before)
            frame = next((data[begin:end] for begin, end in whole_frames(data)), data)
            pdu = next(filter(None, (frame_pdu(name, frame) for name in ("rtu", "tcp"))), None)
            is_silent = why == _ONE_NOTATION and sent is from_client is None
            if is_silent and (code == number - 1 or _CODE.search(f"{line[:start]}~{line[end:]}")):
                code = number  # a table or an address in a program
                continue
            if why == _ONE_NOTATION and _CUT.match(line, end):
                why = IN_PART
            request, response = shapes(pdu) if pdu else (False, False)
            is_echo = from_client is False and request and len(whole_frames(data)) > 1  # before its response
            is_told = not is_echo and (sent is not None or from_client is not None)
            from_client = request if is_told and request != response else from_client
            found.append(Posted(LogEntry(number, data, sent, from_client), why))
            last = end
        above = "" if last else line.strip() or above
    return sorted([*found, *_built(lines)], key=lambda posted: posted.entry.line)


def _built(lines: list[str]) -> Iterator[Posted]:
    """Yield the frames of RTU that code puts together, each where its CRC is complete. A byte that is set after others
    were added begins another branch of the code, from the first bytes on.

    >>> code = ["f = [1, 0x83, 0]", "f[2] = 2", "f.append(0xC0)", "f.append(0xF1)"]
    >>> [(found.entry.line, found.entry.data.hex()) for found in _built(code)]
    [(4, '018302c0f1')]
    """
    lists: dict[str, tuple[int, bytearray]] = {}  # by name: how many are the first bytes, and all
    for number, line in enumerate(lines, start=1):
        for step in _BUILDS.finditer(line) if "=" in line or "(" in line else ():
            name = step["list"] or step["set"] or step["add"]
            written = re.findall(_BYTE, step["bytes"] or step["byte"] or step["more"])
            numbers = [int(byte, 16 if byte[1:2] in ("x", "X") else 10) for byte in written]
            if step["list"]:
                data = bytes(number for number in numbers if number <= 0xFF)
                lists[name] = len(data), bytearray(data)
                continue
            first, frame = lists.setdefault(name, (0, bytearray()))
            at = len(frame) if step["add"] else int(step["at"])
            if step["set"] and 0 < first < len(frame) and at < first:
                del frame[first:]
            if at <= len(frame) and numbers[-1] <= 0xFF:
                frame[at : at + 1] = bytes((numbers[-1],))
            if (pdu := frame_pdu("rtu", bytes(frame))) is not None:
                asks = shapes(pdu)[0] or None
                yield Posted(LogEntry(number, bytes(frame), None, asks), "a frame that code puts together")
                del frame[len(frame) if step["set"] and not first else first :]


def _rows(line: str, least: int) -> Iterator[tuple[int, int, bytes, str]]:
    """Yield the place and the bytes of the numbers of a line that are bytes, and why; or those of strings with
    escapes."""
    literals = [*_literals(line)] if "\\" in line else []
    if literals:
        yield from literals
        return
    row: list[_Number] = []
    end = 0
    for token in [*_TOKEN.finditer(line), None]:
        gap = "" if token is None else line[end : token.start()]
        if row and (token is None or not _GAP.fullmatch(gap)):
            yield from _of_row(row, least)
            row = []
        if token is not None:
            row.append(_number(token, " " if gap.isspace() else gap if row else ""))
            end = token.end()


def _literals(line: str) -> Iterator[tuple[int, int, bytes, str]]:
    """Yield the place and the bytes of the strings of a line with escapes of bytes."""
    for literal in _LITERAL.finditer(line):
        try:
            data = parse_string_literal(literal[0]) if _ESCAPED.search(literal[0]) else None
        except DecodeError:
            continue
        if data is not None and len(data) >= _SHORTEST:
            yield literal.start(), literal.end(), data, "a string with escapes"


def _number(token: re.Match[str], gap: str) -> _Number:
    digits, mark = token["digits"], token["mark"] or token["h"]
    data = bytes.fromhex(digits.rjust(2, "0")) if len(digits) % 2 == 0 or len(digits) == 1 else None
    is_decimal = not mark and len(digits) <= 3 and digits.isdecimal() and int(digits) <= 0xFF
    kind = mark.lower(), 0 if mark else len(digits)
    return _Number(token.start(), token.end(), kind, gap, data, int(digits) if is_decimal else None)


def _of_row(row: list[_Number], least: int) -> Iterator[tuple[int, int, bytes, str]]:
    decimal = [None if number.decimal is None else bytes((number.decimal,)) for number in row]
    both = [([number.data for number in row], ""), (decimal, ", in decimal")]
    if len({number.kind for number in row}) > 1 and any(number.kind == ("", 1) for number in row):
        both.reverse()  # hexadecimal numbers mostly have two digits each
    for readings, what in both:
        found: list[tuple[int, int, bytes, str]] = []
        first = 0
        for place in range(len(row) + 1):
            if place == len(row) or readings[place] is None:
                found += _framed(row[first:place], [data for data in readings[first:place] if data is not None], what)
                first = place + 1
        if found:
            yield from found
            return
    yield from _in_one_notation(row, least)


def _framed(row: list[_Number], parts: list[bytes], what: str) -> Iterator[tuple[int, int, bytes, str]]:
    """Yield the parts of a row of bytes that have a whole frame, or end with their CRC."""
    data, places = b"".join(parts), {0: 0}
    for place, at in enumerate(accumulate(map(len, parts)), 1):
        places[at] = place
    frames = whole_frames(data, set(places))
    merged: list[tuple[int, int]] = []
    for (begin, end), (behind, _) in pairwise([*frames, (len(data), 0)]):
        left, right = merged[-1][1] if merged else 0, places.get(behind, len(row))
        first, last = places.get(begin, left), places.get(end, right)
        kind, gap = (Counter(values).most_common(1)[0][0] for values in _notations(row, first, last))
        while first > left and (row[first - 1].kind, row[first].gap) == (kind, gap):
            first -= 1
        while last < right and (row[last].kind, row[last].gap) == (kind, gap):
            last += 1
        if merged and first <= left and (first == len(row) or row[first].gap == gap):
            first = merged.pop()[0]
        merged.append((first, last))
    for first, last in merged:
        yield row[first].start, row[last - 1].end, b"".join(parts[first:last]), f"a whole frame{what}"
    if not merged and len(data) > _SHORTEST and crc16(data) == 0:
        yield row[0].start, row[-1].end, data, f"the last two are the CRC of the others{what}"


def _notations(row: list[_Number], first: int, last: int) -> tuple[list[tuple[str, int]], list[str]]:
    """Return the notations of some numbers, and what stands between them."""
    numbers = row[first:last] or row[:1]
    return [number.kind for number in numbers], [number.gap for number in numbers[1:]] or [""]


def _in_one_notation(row: list[_Number], least: int) -> Iterator[tuple[int, int, bytes, str]]:
    """Yield the parts of a row that have bytes of two hexadecimal digits, or with a mark, and one separator."""
    first = 0
    for place in range(1, len(row) + 1):
        is_same = place < len(row) and row[place].kind == row[first].kind
        if is_same and (place == first + 1 or row[place].gap == row[first + 1].gap):
            continue
        part = row[first:place]
        is_address = len(part) == _MAC and part[1].gap in (":", "-")
        is_byte = part[0].kind == ("", 2) or part[0].kind[0]
        if len(part) >= least and is_byte and not is_address and all(number.data for number in part):
            yield part[0].start, part[-1].end, b"".join(number.data or b"" for number in part), _ONE_NOTATION
        first = place
