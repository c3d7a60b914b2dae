"""Dumps of bytes as tools print them: the offset in front and the characters behind are no bytes.

    00000000  01 03 00 00 00 0a c5 cd                           |........|        hexdump -C
    00000000: 0103 0000 000a c5cd                      ........                   xxd; -b too is one, but in bits
    0000   01 03 00 00 00 0a c5 cd                            ........            tshark -x, Wireshark
    0000000 01 03 00 00 00 0a c5 cd                                               od -t x1 (its offsets are octal)

A line may stand alone. Of several, each has to begin where the one before it ended, or they are no dump; `*`, for
lines that are all like the one before, is refused rather than guessed at.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from barewire.errors import DecodeError

_PAIRS = r"[0-9A-Fa-f]{2}(?: [0-9A-Fa-f]{2})*"
_GROUPS = r"(?:[0-9A-Fa-f]{2})+(?: (?:[0-9A-Fa-f]{2})+)*"
_XXD = re.compile(rf"\s*(?:0x)?([0-9A-Fa-f]{{4,8}}): {{1,3}}({_GROUPS})(?:\s*$|  )")
_COLUMNS = re.compile(rf"\s*([0-9A-Fa-f]{{4,8}})(?: {{2,4}}|\t)({_PAIRS}(?:  {_PAIRS})?)(?:\s*$| {{2,}})")
_OD = re.compile(rf"\s*([0-7]{{7}}) ({_PAIRS})\s*$")
_END = re.compile(r"\s*[0-9A-Fa-f]{6,8}\s*$")  # hexdump and od say last where the end is
_WORDS = re.compile(r"\s*0{7} (?:[0-9A-Fa-f]{4}(?: |\s*$)|[0-7]{6}(?: |\s*$))")
LINE_MAX = 256


class DumpLine(NamedTuple):
    """A line taken apart. `octal` is the offset as od counts, where the digits allow it."""

    offset: int
    octal: int | None
    data: bytes


def dump_line(line: str) -> DumpLine | None:
    """One line of a dump, or None.

    >>> dump_line("00000010: 0103 0002  ....")
    DumpLine(offset=16, octal=8, data=b'\\x01\\x03\\x00\\x02')
    >>> dump_line("0000 0000 0006 01 03 0000 0001")  # a frame, written in its fields
    """
    for form in (_XXD, _COLUMNS, _OD):
        if found := form.match(line):
            digits, data = found[1], bytes.fromhex(found[2])
            octal = int(digits, 8) if set(digits) <= set("01234567") else None
            return DumpLine(int(digits, 16), octal, data) if len(data) <= LINE_MAX else None
    return None


def parse_dump(text: str) -> bytes | None:
    """The bytes of a dump; None for a text that is none.

    >>> parse_dump("00000000  01 03 00 00  |....|\\n00000004  00 0a c5 cd  |....|\\n00000008").hex(" ")
    '01 03 00 00 00 0a c5 cd'

    Raises DecodeError where a line of the dump is missing, and for words of two bytes, whose order it does not tell.
    """
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    if not lines:
        return None
    if _WORDS.match(lines[0][1]) and len(lines[0][1].split()[0]) == 7:
        raise _wrong(text, 1, "hexdump and od without options print words, whose bytes change places: use hexdump -C")
    first = dump_line(lines[0][1])
    if first is None or (len(lines) == 1 and not _is_alone(first, lines[0][1])):
        return None
    doubtful = not _is_alone(first, lines[0][1])
    data, octal = first.data, False
    for number, line in lines[1:]:
        found, come = dump_line(line), len(data)
        if doubtful and (found is None or found.offset != first.offset + come):
            return None
        if found is None:
            if _END.match(line) and number == lines[-1][0]:
                break
            raise _wrong(text, number, f"{line.strip()[:24]!r} is no line of the dump that line 1 begins")
        octal = octal or (found.octal == (first.octal or 0) + come and found.offset != first.offset + come)
        if (found.octal if octal else found.offset) != ((first.octal or 0) if octal else first.offset) + come:
            raise _wrong(text, number, f"the dump goes on at {found.offset:X}h, expected {first.offset + come:X}h")
        data += found.data
    return data


def _is_alone(found: DumpLine, line: str) -> bool:
    """Whether one line alone is a dump beyond doubt: four digits and two blanks may be a transaction number."""
    if len(line.split()[0].rstrip(":").removeprefix("0x")) > 4:
        return True
    characters = "".join(chr(byte) if 0x20 <= byte < 0x7F else "." for byte in found.data)
    return found.offset == 0 or line.rstrip().endswith(characters)


def _wrong(text: str, number: int, words: str) -> DecodeError:
    return DecodeError("value", text.encode("latin-1", "replace"), 0, f"line {number}: {words}")
