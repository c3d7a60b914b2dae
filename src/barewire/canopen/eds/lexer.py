"""Bytes <-> lines of an EDS, without loss.

        EF BB BF    ParameterName = Device type ; in words CR LF
        |           '-----------' ^ '---------' '--------' '---'
        BOM         key           | value       after      end
                                  between

A document is the list of its lines, and a line the tuple of its pieces: joined, they are the original bytes. A change
replaces one piece of one line; everything else stays as it is, correct or not.

The encoding is the first of UTF-16 (with its byte order mark), ASCII, UTF-8, Windows-1252 and Latin-1 that reproduces
the bytes; Latin-1 always does.
"""

from __future__ import annotations

import re
from typing import Literal, NamedTuple

from barewire.canopen.eds.diagnostics import Diagnostic, diagnostic

Kind = Literal["blank", "comment", "section", "pair", "junk"]

_MARKS = ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be"))
_ENCODINGS = ("ascii", "utf-8", "cp1252", "latin-1")
_LINE = re.compile(r"[^\r\n]*(?:\r\n|\n|\r)|[^\r\n]+")
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")

_CONFLICT = re.compile(r"(?:<{7}|={7}|>{7}|\|{7})(?: .*)?")

_FREE_TEXT = re.compile(r"line[0-9]+", re.IGNORECASE)  # keys of [Comments]: their text has no comments of the file


class EdsText(NamedTuple):
    """A file as text: its byte order mark, its encoding, and the text after the mark."""

    mark: bytes
    encoding: str
    text: str


def decode_text(data: bytes) -> EdsText:
    """Decode the bytes. Never raises; encoding the text reproduces the bytes.

    >>> decode_text(b"[1000]"), decode_text(b"\\xdcberlast").encoding
    (EdsText(mark=b'', encoding='ascii', text='[1000]'), 'cp1252')
    """
    mark, first = next(((mark, name) for mark, name in _MARKS if data.startswith(mark)), (b"", "ascii"))
    rest = data[len(mark) :]
    for encoding in (first, *_ENCODINGS):
        try:
            text = rest.decode(encoding)
            if text.encode(encoding) == rest:
                return EdsText(mark, encoding, text)
        except UnicodeError:
            continue
    raise AssertionError("latin-1 decodes every byte")


class EdsLine(NamedTuple):
    """One line in pieces. The `key` of a section is its name; other lines without a key have all text in `after`."""

    kind: Kind
    before: str = ""
    key: str = ""
    between: str = ""
    value: str = ""
    after: str = ""
    end: str = ""

    @property
    def text(self) -> str:
        """The line as it is in the file."""
        return "".join(self[1:])

    @property
    def shown(self) -> str:
        """The line for messages, without outer blanks."""
        return self.text.strip()


def split_lines(text: str) -> list[EdsLine]:
    """Return all lines of a text.

    >>> [line.kind for line in split_lines("; hello\\n\\n[1000]\\nParameterName=Device type\\n?")]
    ['comment', 'blank', 'section', 'pair', 'junk']
    """
    return [_parse_line(piece) for piece in _LINE.findall(text)]


def _parse_line(piece: str) -> EdsLine:
    """Split one line with its end into pieces."""
    body = piece.rstrip("\r\n")
    end = piece[len(body) :]
    bare = body.strip()
    if not bare:
        return EdsLine("blank", after=body, end=end)
    if _CONFLICT.fullmatch(bare):
        return EdsLine("junk", after=body, end=end)
    if bare.startswith((";", "#", "//")):
        return EdsLine("comment", after=body, end=end)
    if bare.startswith("["):
        return _section(body, end)
    sign = "=" if "=" in body else ":"
    left, equals, right = body.partition(sign)
    if not equals or (sign == ":" and not left.strip().isalnum()):
        return EdsLine("junk", after=body, end=end)
    key, rest = left.strip(), right.lstrip()
    value = rest[: _comment(key, rest)].rstrip()
    start = left.index(key) if key else len(left)
    between = left[start + len(key) :] + equals + right[: len(right) - len(rest)]
    return EdsLine("pair", left[:start], key, between, value, rest[len(value) :], end)


def _section(body: str, end: str) -> EdsLine:
    opened = body.index("[") + 1
    closed = body.find("]", opened)
    if closed < 0:
        closed = opened + _comment("", body[opened:])
    name = body[opened:closed].strip()
    start = body.index(name, opened)
    return EdsLine("section", body[:start], name, after=body[start + len(name) :], end=end)


def _comment(key: str, rest: str) -> int:
    """Return where the comment after a value begins: at a semicolon after a blank, since names may contain a semicolon.

    >>> _comment("ParameterName", "speed;torque ; in words")
    13
    """
    if _FREE_TEXT.fullmatch(key):
        return len(rest)
    position = rest.find(";")
    while position > 0 and not rest[position - 1].isspace():
        position = rest.find(";", position + 1)
    return len(rest) if position < 0 else position


def text_diagnostics(read_as: EdsText, lines: list[EdsLine]) -> list[Diagnostic]:
    """Return the diagnostics of the text, and of each line by itself."""
    found = []
    if read_as.mark:
        found.append(diagnostic(1, "byte-order-mark", read_as.mark.hex(" ").upper()))
    if not read_as.text.isascii():
        number = next(number for number, line in enumerate(lines, 1) if not line.text.isascii())
        found.append(diagnostic(number, "not-ascii", f"{lines[number - 1].shown} ({read_as.encoding})"))
    ends = [line.end for line in lines if line.end]
    for number, line in enumerate(lines, 1):
        if line.end and (line.end != ends[0] or line.end == "\r"):
            found.append(diagnostic(number, "line-ends", line.shown))
            break
    for number, line in enumerate(lines, 1):
        found += [diagnostic(number, rule, line.shown) for rule in _broken_rules(line)]
    return found


def _broken_rules(line: EdsLine) -> list[str]:
    broken = []
    if _CONTROL.search(line.text[: len(line.text) - len(line.end)]):
        broken.append("control-character")
    if line.kind == "junk":
        broken.append("conflict" if _CONFLICT.fullmatch(line.after.strip()) else "no-equals")
    elif line.kind == "comment":
        if not line.after.lstrip().startswith(";"):
            broken.append("foreign-comment")
        elif line.after[0].isspace():
            broken.append("blanks")
    elif line.kind == "section":
        rest = line.after.partition("]")[2].strip()
        if line.before != "[" or line.after[:1].isspace():
            broken.append("blanks")
        if "]" not in line.after:
            broken.append("section-open")
        elif rest:
            broken.append("inline-comment" if rest.startswith(";") else "behind-section")
    elif line.kind == "pair":
        if not line.key:
            broken.append("no-key")
        elif line.between.strip() == ":":
            broken.append("colon")
        elif line.before or line.between[:1] != "=":
            broken.append("blanks")
        if line.after.strip():
            broken.append("inline-comment")
    return broken
