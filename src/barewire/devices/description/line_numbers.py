"""On which line does it stand? tomllib reads the values and forgets the lines, so they are looked up here.

    1  # a comment                      Lines(text).of(("parameter", 0))            -> 2
    2  [[parameter]]                    Lines(text).of(("parameter", 0, "half"))    -> 3
    3  half = "L"                       Lines(text).of(("parameter", 0, "bits", "5"))  -> 5
    4  [parameter.bits]                 Lines(text).of(("parameter", 0, "name"))    -> 2, its block: it has no line
    5  5 = "fault"

Only for texts that tomllib has read: what is no TOML has its line in tomllib's own error. A line inside a string of
many lines or inside an array is never taken for a key or a header.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TypeAlias

Path: TypeAlias = tuple[str | int, ...]

_KEY = r"""(?:[A-Za-z0-9_-]+|"[^"\n]*"|'[^'\n]*')"""
_DOTTED = rf"{_KEY}(?:[ \t]*\.[ \t]*{_KEY})*"
_HEADER = re.compile(rf"[ \t]*(\[\[?)[ \t]*({_DOTTED})[ \t]*\]")
_ASSIGNMENT = re.compile(rf"[ \t]*({_DOTTED})[ \t]*=")
# What can hide a line end or a bracket, and the line ends and brackets themselves; long quotes before short ones.
_TOKEN = re.compile(
    r'''"""(?:\\.|[^\\])*?"""+|\'\'\'.*?\'\'\'+|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|\#[^\n]*|[\[{]|[\]}]|\n''', re.DOTALL
)


class KeyLines:
    """The lines of every header and key of one TOML text."""

    def __init__(self, text: str) -> None:
        self._at: dict[Path, int] = {}
        counts: dict[Path, int] = {}
        block: Path = ()
        for line, statement in _statements(text):
            if header := _HEADER.match(statement):
                block = _entered(_parts(header[2]), counts)
                if header[1] == "[[":
                    counts[block] = counts.get(block, -1) + 1
                    self._at.setdefault(block, line)
                    block = (*block, counts[block])
                self._at.setdefault(block, line)
            elif assignment := _ASSIGNMENT.match(statement):
                path = block
                for part in _parts(assignment[1]):
                    path = (*path, part)
                    self._at.setdefault(path, line)

    def of(self, path: Path) -> int:
        """The line of that key or table, counted from 1; of what is around it if it has none of its own."""
        while path and path not in self._at:
            path = path[:-1]
        return self._at.get(path, 1)


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Each header and each assignment, whole, with the line on which it begins."""
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


def _entered(parts: list[str], counts: dict[Path, int]) -> Path:
    """The path of a header: [parameter.bits] lies in the latest [[parameter]]."""
    path: Path = ()
    for place, part in enumerate(parts):
        path = (*path, part)
        if path in counts and place < len(parts) - 1:
            path = (*path, counts[path])
    return path
