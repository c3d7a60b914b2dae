"""Hex dumps as tools print them: the offset before the bytes and the characters after them are skipped.

    00000000  01 03 00 00 00 0a c5 cd                           |........|        hexdump -C
    00000000: 0103 0000 000a c5cd                      ........                   xxd (not xxd -b)
    0000   01 03 00 00 00 0a c5 cd                            ........            tshark -x, Wireshark
    0000000 01 03 00 00 00 0a c5 cd                                               od -t x1 (its offsets are octal)

A single line may be a dump. Each further line must begin where the line before it ends; a `*`, which stands for
repeated lines, raises DecodeError.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from barewire.errors import DecodeError
from barewire_workbench.frames.result import text_error

_PAIRS = r"[0-9A-Fa-f]{2}(?: [0-9A-Fa-f]{2})*"
_GROUPS = r"(?:[0-9A-Fa-f]{2})+(?: (?:[0-9A-Fa-f]{2})+)*"
_XXD = re.compile(rf"\s*(?:0x)?([0-9A-Fa-f]{{4,8}}): {{1,3}}({_GROUPS})(?:\s*$|  )")
_COLUMNS = re.compile(rf"\s*([0-9A-Fa-f]{{4,8}})(?: {{2,4}}|\t)({_PAIRS}(?:  {_PAIRS})?)(?:\s*$| {{2,}})")
_OD = re.compile(rf"\s*([0-7]{{7}}) ({_PAIRS})\s*$")
_END = re.compile(r"\s*[0-9A-Fa-f]{6,8}\s*$")  # hexdump and od print the end offset in the last line
_WORDS = re.compile(r"\s*0{7} (?:[0-9A-Fa-f]{4}(?: |\s*$)|[0-7]{6}(?: |\s*$))")
_LINE_MAX = 256


class DumpLine(NamedTuple):
    """One line: its offset, as od counts it (`octal`) if the digits allow that, and its bytes."""

    offset: int
    octal: int | None
    data: bytes


def dump_line(line: str) -> DumpLine | None:
    """Parse one line of a dump; None if it is not one.

    >>> dump_line("00000010: 0103 0002  ....")
    DumpLine(offset=16, octal=8, data=b'\\x01\\x03\\x00\\x02')
    >>> dump_line("0000 0000 0006 01 03 0000 0001")  # a frame with blanks between its fields
    """
    for form in (_XXD, _COLUMNS, _OD):
        if found := form.match(line):
            digits, data = found[1], bytes.fromhex(found[2])
            octal = int(digits, 8) if set(digits) <= set("01234567") else None
            return DumpLine(int(digits, 16), octal, data) if len(data) <= _LINE_MAX else None
    return None


def parse_dump(text: str) -> bytes | None:
    """Return the bytes of a dump; None if the text is not a dump.

    >>> parse_dump("00000000  01 03 00 00  |....|\\n00000004  00 0a c5 cd  |....|\\n00000008").hex(" ")
    '01 03 00 00 00 0a c5 cd'

    Raises DecodeError if a line of the dump is missing, and for words of two bytes, whose byte order is unknown.
    """
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    if not lines:
        return None
    if _WORDS.match(lines[0][1]) and len(lines[0][1].split()[0]) == 7:
        raise _wrong(text, 1, "hexdump and od without options print words with unknown byte order: use hexdump -C")
    first = dump_line(lines[0][1])
    if first is None or (len(lines) == 1 and not _is_alone(first, lines[0][1])):
        return None
    uncertain = not _is_alone(first, lines[0][1])
    data, octal = first.data, False
    for number, line in lines[1:]:
        found, count = dump_line(line), len(data)
        if uncertain and (found is None or found.offset != first.offset + count):
            return None
        if found is None:
            if _END.match(line) and number == lines[-1][0]:
                break
            raise _wrong(text, number, f"{line.strip()[:24]!r} is not a line of the dump that begins in line 1")
        octal = octal or (found.octal == (first.octal or 0) + count and found.offset != first.offset + count)
        if (found.octal if octal else found.offset) != ((first.octal or 0) if octal else first.offset) + count:
            raise _wrong(text, number, f"the dump continues at {found.offset:X}h, expected {first.offset + count:X}h")
        data += found.data
    return data


def _is_alone(found: DumpLine, line: str) -> bool:
    """Return whether one line alone is certainly a dump: four digits and two blanks may be a transaction number."""
    if len(line.split()[0].rstrip(":").removeprefix("0x")) > 4:
        return True
    characters = "".join(chr(byte) if 0x20 <= byte < 0x7F else "." for byte in found.data)
    return found.offset == 0 or line.rstrip().endswith(characters)


def _wrong(text: str, number: int, message: str) -> DecodeError:
    return text_error("value", text, 0, f"line {number}: {message}")
