"""Turns the docstrings of barewire into reStructuredText.

A docstring is plain text with few signs, and each has its form here:

    paragraph                     a paragraph; `name` becomes a link if `name` is public in barewire, code otherwise
    sentence.     [MB-APP 6.3]    the clause of the standard behind it, in italics
    lines indented by 4           a drawing: a literal block, sign by sign
    columns, or a | b             a drawing too: the formatter takes its indentation where nothing follows it
    an example of Python          a highlighted block, up to the next empty line
    - item, 1. item               a list

The first sentence of every docstring says what the thing is, so `summary` is the start of a table.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator

Link = Callable[[str], str | None]
"""The full name of what a name in backticks stands for, or None."""

_CLAUSE = re.compile(r"\s*\[([A-Z][^\]]*?\d[^\]]*|CiA [^\]]*|MB-[^\]]*)\]\s*$")
_COLUMNS = re.compile(r"\S {3,}\S|(?:^|\s)\|(?:\s|$)")
_ITEM = re.compile(r"(-|\d+\.) +(?=\S)")
_CODE = re.compile(r"(`+)(.+?)\1")


def escape(text: str) -> str:
    """Return plain text as reStructuredText: no sign has a meaning.

    >>> escape("*args, a_ and |x|")
    '\\\\*args, a\\\\_ and \\\\|x\\\\|'
    """
    return re.sub(r"([\\*`|_])", r"\\\1", text)


def inline(text: str, link: Link) -> str:
    """Return one paragraph, on one line, as reStructuredText; only code, *words* and **words** have a form.

    >>> inline("**Do** `it` *now*, *args and **kwargs", {}.get)
    '**Do** ``it`` *now*, \\\\*args and \\\\*\\\\*kwargs'
    """
    parts, last = [], 0
    for code in _CODE.finditer(text):
        parts += [escape(text[last : code.start()]), _code(code[2].strip(), link)]
        before, after = text[: code.start()], text[code.end() :]
        # Markup begins and ends at a space or a sign. Elsewhere "\\ " parts it from the text, and is not shown.
        if before and not before[-1].isspace() and before[-1] not in "'\"([{<-/:":
            parts.insert(-1, "\\ ")
        if after and not after[0].isspace() and after[0] not in "'\")]}>-/:.,;!?":
            parts.append("\\ ")
        last = code.end()
    whole = "".join([*parts, escape(text[last:])])
    for mark in ("**", "*"):
        sign = re.escape(escape(mark))
        whole = re.sub(rf"(?<!\S){sign}(\w(?:[^*`\\]*\w)?){sign}(?=[\s.,;:)]|$)", rf"{mark}\1{mark}", whole)
    return whole


def _code(name: str, link: Link) -> str:
    target = link(name)
    if target:
        return f":py:obj:`{escape(name)} <{target}>`"
    # A literal cannot end with a backslash or contain its own quotes.
    return f"``{name}``" if not name.endswith("\\") and "``" not in name else escape(name)


def rendered(docstring: str, link: Link) -> list[str]:
    """Return the lines of a docstring in reStructuredText."""
    lines: list[str] = []
    for kind, block in parts(docstring):
        if kind == "text":
            lines += [_paragraph(block, link), ""]
        elif kind == "item":
            mark = _ITEM.match(block[0])
            assert mark
            body = " ".join(line.strip() for line in [block[0][mark.end() :], *block[1:]])
            lines += [f"{mark[1]} {inline(body, link)}", ""]
        else:
            language = "pycon" if kind == "example" else "text"
            lines += [f".. code-block:: {language}", "", *(f"   {line}".rstrip() for line in block), ""]
    return lines


def _paragraph(block: list[str], link: Link) -> str:
    """One paragraph; the clause at the end of its first line goes behind it."""
    clauses = []
    kept = []
    for line in block:
        clause = _CLAUSE.search(line) if "   " in line or line is block[-1] else None
        kept.append((line[: clause.start()] if clause else line).strip())
        if clause:
            clauses.append(clause[1])
    text = inline(re.sub(r" {2,}", " ", " ".join(part for part in kept if part)), link)
    text = re.sub(r"^([-+#•]|\d+\.)(?=\s)", r"\\\1", text)
    return " ".join([text, *(f"*[{escape(clause)}]*" for clause in clauses)]).strip()


def parts(docstring: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the blocks of a docstring: `text`, `item`, `example` or `drawing`, and its lines.

    >>> list(parts("One.\\n\\n    a | b\\n\\n>>> 1\\n1"))
    [('text', ['One.']), ('drawing', ['a | b']), ('example', ['>>> 1', '1'])]
    """
    lines = inspect.cleandoc(docstring).splitlines()
    at = 0
    while at < len(lines):
        line, start = lines[at], at
        if not line.strip():
            at += 1
            continue
        if line.startswith(" "):
            at = _while(lines, at, lambda other: not other.strip() or other.startswith(" "))
            yield "drawing", _dedented(lines[start:at])
        elif line.startswith(">>> "):
            at = _while(lines, at, lambda other: bool(other.strip()))
            yield "example", lines[start:at]
        elif _ITEM.match(line):
            at = _while(lines, at + 1, lambda other: other.startswith("  "))
            yield "item", lines[start:at]
        elif start and _is_drawn(block := lines[at : _while(lines, at, lambda other: bool(other.strip()))]):
            at += len(block)
            yield "drawing", block
        else:
            at = _while(
                lines,
                at + 1,
                lambda other: bool(other.strip()) and not other.startswith((" ", ">>> ")) and not _ITEM.match(other),
            )
            yield "text", lines[start:at]


def _is_drawn(block: list[str]) -> bool:
    return any(_COLUMNS.search(_CLAUSE.sub("", line)) for line in block)


def _while(lines: list[str], at: int, holds: Callable[[str], bool]) -> int:
    while at < len(lines) and holds(lines[at]):
        at += 1
    return at


def _dedented(lines: list[str]) -> list[str]:
    while lines and not lines[-1].strip():
        lines = lines[:-1]
    depth = min(len(line) - len(line.lstrip()) for line in lines if line.strip())
    return [line[depth:].rstrip() for line in lines]


def drawings(docstring: str) -> list[list[str]]:
    """Return the drawings of a docstring."""
    return [block for kind, block in parts(docstring) if kind == "drawing"]


def clause(docstring: str) -> str:
    """Return the clause of the standard that the first paragraph names, or an empty text.

    >>> clause("The registers that were read.      [MB-APP 6.3]")
    'MB-APP 6.3'
    """
    for kind, block in parts(docstring):
        if kind == "text":
            found = [match[1] for line in block if (match := _CLAUSE.search(line))]
            return found[0] if found else ""
    return ""


def summary(docstring: str) -> str:
    """Return the first sentence, without the clause behind it.

    >>> summary("What it is. And more.")
    'What it is.'
    """
    for kind, block in parts(docstring):
        if kind == "text":
            text = " ".join(_CLAUSE.sub("", line).strip() for line in block)
            text = re.sub(r" {2,}", " ", text)
            end = re.search(r"(?<![. ][a-z])\.(?=\s+[A-Z`\d(])", text)
            return text[: end.end()] if end else text
    return ""
