"""Bytes at the end of a line of a log, in any notation, and what stands before them.

    ... 0x1 0x3 0x0 0x0       ... 01 03 00 00      ... 1,3,0,A      ... 01-03-00-00     ... 01:03:00:00
    ... \\x01\\x03              ... 01030000         ... 0103 0000    ... [01][03]        ... <01><03>
    ... b'\\x01\\x03\\n'         bytes of Python
    ... TX: 1, 3, 0, 22       decimal: numbers of three digits occur in the log, and no letters
    ... :010300000002FA       a frame of ASCII

A count behind the bytes (`> 9 bytes`) has to be theirs; a remark behind them (`// good`) is none of them.

Only tokens with the same separator belong together: in `14:32:05 - 64 03 00` the bytes are 64 03 00. Digits that can be
hexadecimal and decimal are returned both ways; the whole log decides.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from barewire.errors import DecodeError
from barewire_workbench.frames.input import parse_string_literal
from barewire_workbench.recordings.bytelog import without_remark

_H = r"[0-9A-Fa-f]"
_END = re.compile(r"\s*(?:\(\d+(?: bytes)?\)|\[\d+ bytes\])?[\s,;.)\]}>'\"]*(?:[;|\t] ?\d{1,4}[;\s]*)?$")
_FORMS = tuple(
    (needed, re.compile(form))
    for needed, form in (
        (":", rf"(?P<ascii>(?<!\w):(?:{_H}{{2}}){{3,}})(?:\\r\\n|\\r|\\n|<CR><LF>|\[CR\]\[LF\])?"),
        ("xX", rf"(?P<list>(?<![\w])0[xX]{_H}{{1,2}}(?:[\s,;\-:]+0[xX]{_H}{{1,2}})*)"),
        ("\\", rf"(?P<list>(?:\\x{_H}{{2}})+)"),
        ("[", rf"(?P<list>(?:\[(?:0x)?{_H}{{2}}\]\s*)+)"),
        ("<", rf"(?P<list>(?:<(?:0x)?{_H}{{2}}>\s*)+)"),
        ("hH", rf"(?P<list>(?<![\w]){_H}{{2}}[hH](?:[\s,]+{_H}{{2}}[hH])*)"),
        ("", rf"(?P<list>(?<!\w)(?<!\d[\-:,|]){_H}{{1,2}}(?:\s+{_H}{{1,2}}){{1,}})"),
        ("-", rf"(?P<list>(?<!\w)(?<!\d-){_H}{{1,2}}(?:-{_H}{{1,2}}){{1,}})"),
        (":", rf"(?P<list>(?<!\w)(?<!\d:){_H}{{2}}(?::{_H}{{2}}){{1,}})"),
        (",", rf"(?P<list>(?<!\w)(?<!\d,){_H}{{1,2}}(?:,\s*{_H}{{1,2}}){{1,}})"),
        (",", r"(?P<decimal>(?<![\w,])\d{1,3}(?:,\s*\d{1,3}){1,})"),
        ("", r"(?P<decimal>(?<![\w,])\d{1,3}(?:\s+\d{1,3}){1,})"),
        ("", rf"(?P<list>(?<![\w]){_H}{{4}}(?:\s+{_H}{{4}})*(?:\s+{_H}{{2}})?)"),
        ("", rf"(?P<list>(?<![\w])(?:{_H}{{2}}){{4,}})"),
    )
)
"""Each with characters one of which it needs, if there are such: most lines are not searched for most forms."""
_BLANKS = "".join(chr(code) for code in range(0x3001) if chr(code).isspace())
_AT_THE_END = f"0123456789abcdefABCDEF{_BLANKS}xXhHrnRLyts\\[](){{}}<>:,;.|'\"-"
"""All characters of bytes in any notation, and of what may follow them."""
_PAIRS = re.compile(rf"(?P<mark>[xXrRtTsSnL]{{0,3}}[:>\])-]{{0,3}} {{1,20}})?(?P<bytes>{_H}{{2}}(?: {_H}{{2}})+)\s*")
"""The notation of nearly all logs, behind the end of a word: no other form reads more of it."""
_REMARKS = frozenset("<←/#;(")
_LITERAL = re.compile(r"""(?<!\w)b(?P<string>'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*")""")
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
    Octets(before='recv: ', data=b'\\x01\\x83\\x02\\xc0\\xf1', decimal=None)
    >>> split_octets("TX: 1, 3, 0, 22, 0, 2, 37, 207").decimal.hex(" "), split_octets("nothing at all")
    ('01 03 00 16 00 02 25 cf', None)
    """
    if ("yte" in line or "YTE" in line) and (found := _COUNT.search(line)):
        octets = _split(line[: found.start()])
        is_right = octets is not None and int(found["count"]) in map(len, filter(None, octets[1:]))
        return octets if is_right or found["opened"] else None
    octets = _split(line)
    if octets is None and not _REMARKS.isdisjoint(line) and (plain := without_remark(line)) != line:
        return _split(plain)
    return octets


def _split(line: str) -> Octets | None:
    """Split a line that has nothing but punctuation, or a count in brackets, behind its bytes."""
    literal = None
    if "'" in line or '"' in line:
        for literal in _LITERAL.finditer(line):  # noqa: B007 - the last one, as below
            pass
    if literal is not None and _END.match(line, literal.end()):
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
        if needed and needed[0] not in end and needed[-1] not in end:
            continue
        found = None
        for found in form.finditer(line, start):  # noqa: B007 - the last one: a search with an end would take quadratic time
            pass
        if found is not None and _END.match(line, found.end()) and (best is None or found.start() < best.start()):
            best = found
    if best is None:
        return None
    before = line[: best.start()]
    kind, text = next((kind, text) for kind, text in best.groupdict().items() if text is not None)
    if kind == "ascii":
        return Octets(before, text.encode() + b"\r\n")
    tokens = [found[1] for found in _TOKEN.finditer(text)]
    decimal = _decimal(tokens, text)
    if kind == "decimal":
        return None if decimal is None else Octets(before, None, decimal)
    return Octets(before, b"".join(bytes.fromhex(token.rjust(2, "0")) for token in tokens), decimal)


def _of_literal(line: str, found: re.Match[str]) -> Octets | None:
    """Return the bytes of b'...': escapes and characters, or the digits of hexlify."""
    content = found["string"][1:-1]
    try:
        data = parse_string_literal(f"b{found['string']}")
        if data is None:
            data = bytes.fromhex(content)
    except (DecodeError, ValueError):
        return None
    return Octets(line[: found.start()], data) if len(data) > 1 else None


def _decimal(tokens: list[str], text: str) -> bytes | None:
    """Return the bytes of decimal numbers; None if a token shows that they are hexadecimal."""
    if "x" in text.lower() or not all(token.isdecimal() for token in tokens):
        return None
    if any(len(token) > 3 or (len(token) == 2 and token[0] == "0") or int(token) > 255 for token in tokens):
        return None
    return bytes(map(int, tokens))
