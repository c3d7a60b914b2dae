"""Line numbers of the headers and keys of a TOML text, for error messages: tomllib does not keep them.

    1  # a comment                      KeyLines(text).of(("parameter", 0))               -> 2
    2  [[parameter]]                    KeyLines(text).of(("parameter", 0, "half"))       -> 3
    3  half = "L"                       KeyLines(text).of(("parameter", 0, "bits", "5"))  -> 5
    4  [parameter.bits]                 KeyLines(text).of(("parameter", 0, "name"))       -> 2, its table: no such key
    5  5 = "fault"

Only for texts that tomllib accepts; its error for any other text has a line. A line inside a multi-line string or an
array is not taken for a key or a header. The text is searched at the first call of `of` only.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cached_property
from typing import TypeAlias

KeyPath: TypeAlias = tuple[str | int, ...]

_KEY = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')"""
_DOTTED = rf"{_KEY}(?:[ \t]*\.[ \t]*{_KEY})*"
_HEADER = re.compile(rf"[ \t]*(\[\[?)[ \t]*({_DOTTED})[ \t]*\]")
_ASSIGNMENT = re.compile(rf"[ \t]*({_DOTTED})[ \t]*=")
# Strings and comments, which may contain line ends and brackets, and line ends and brackets; long quotes come first.
_TOKEN = re.compile(
    r'''"""(?:\\.|[^\\])*?"""+|\'\'\'.*?\'\'\'+|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|\#[^\n]*|[\[{]|[\]}]|\n''', re.DOTALL
)


class KeyLines:
    """The lines of the headers and keys of one TOML text."""

    def __init__(self, text: str) -> None:
        self._text = text

    def of(self, path: KeyPath) -> int:
        """Return the line of that key or table, counted from 1, or of the table around it if it has no line."""
        while path and path not in self._lines:
            path = path[:-1]
        return self._lines.get(path, 1)

    @cached_property
    def _lines(self) -> dict[KeyPath, int]:
        lines: dict[KeyPath, int] = {}
        counts: dict[KeyPath, int] = {}
        table: KeyPath = ()
        for line, statement in _statements(self._text):
            if header := _HEADER.match(statement):
                table = _header_path(_parts(header[2]), counts)
                if header[1] == "[[":
                    counts[table] = counts.get(table, -1) + 1
                    lines.setdefault(table, line)
                    table = (*table, counts[table])
                lines.setdefault(table, line)
            elif assignment := _ASSIGNMENT.match(statement):
                path = table
                for part in _parts(assignment[1]):
                    path = (*path, part)
                    lines.setdefault(path, line)
        return lines


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Yield each header and each assignment with the line on which it begins."""
    line, begin, begun_at, depth = 1, 0, 1, 0
    for token in _TOKEN.finditer(text + "\n"):
        found = token[0]
        depth += (found in "[{") - (found in "]}")
        line += found.count("\n")
        if found == "\n" and depth == 0:
            yield begun_at, text[begin : token.start()]
            begin, begun_at = token.end(), line


def _parts(dotted: str) -> list[str]:
    return [part.strip("\"'") for part in re.findall(_KEY, dotted)]


def _header_path(parts: list[str], counts: dict[KeyPath, int]) -> KeyPath:
    """Return the path of a header: [parameter.bits] belongs to the latest [[parameter]]."""
    path: KeyPath = ()
    for place, part in enumerate(parts):
        path = (*path, part)
        if path in counts and place < len(parts) - 1:
            path = (*path, counts[path])
    return path
