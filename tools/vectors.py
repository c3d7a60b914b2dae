"""Keeps vectors/ in its form: `python tools/vectors.py` after every change of a case.

    ids     a case without an id gets the next free number of its file: <file>-<n>. An id is never given twice
    form    few lines for a case: what it is, what it says, where from, then the fields; nothing wider than 120
    counts  the table of vectors/README.md, between its two marks

The tests call the same functions and fail when something is not as this tool would leave it.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

VECTORS = Path(__file__).parent.parent / "vectors"
WIDTH = 120
BEGIN, END = "<!-- counts: made by tools/vectors.py -->", "<!-- end of counts -->"

# The keys of a case in the order in which they are read. What is not named here follows as it stands in the file.
ROWS = (("id", "result", "reason", "fails", "flags"), ("comment",), ("source",))


def files() -> list[Path]:
    """Every vector file, in the order of the table."""
    rooms = ("codecs", "modbus", "rtu", "ascii", "tcp", "canopen", "devices")
    return [file for room in rooms for file in sorted((VECTORS / room).glob("*.json"))]


def number(document: dict[str, Any], stem: str) -> None:
    """Give an id to each case that has none, above every number that was ever used here."""
    last = max([int(case["id"].rpartition("-")[2]) for case in document["cases"] if "id" in case], default=0)
    for case in document["cases"]:
        if "id" not in case:
            last += 1
            case["id"] = f"{stem}-{last}"


def _flat(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def _pack(items: list[str], indent: str) -> list[str]:
    """Items one behind the other, a new line where they would become too wide."""
    lines: list[str] = []
    line = indent
    for place, item in enumerate(items):
        piece = item + ("," if place < len(items) - 1 else "")
        if line != indent and len(line) + 1 + len(piece) > WIDTH:
            lines.append(line)
            line = indent
        line += ("" if line == indent else " ") + piece
    return [*lines, line] if line.strip() else lines


def _entry(key: str, value: Any, indent: str) -> str:
    """One key of a case: on one line if it fits or cannot be cut, otherwise a list with an element on each line."""
    flat = f"{_flat(key)}: {_flat(value)}"
    if len(indent) + len(flat) + 1 <= WIDTH or not isinstance(value, (list, dict)) or not value:
        return flat
    inner = indent + "  "
    if isinstance(value, list) and all(isinstance(one, str) for one in value):
        body = "\n".join(_pack([_flat(one) for one in value], inner))
    elif isinstance(value, list):
        body = ",\n".join(inner + _flat(one) for one in value)
    else:
        body = ",\n".join(inner + _entry(name, one, inner) for name, one in value.items())
    opening, closing = "[]" if isinstance(value, list) else "{}"
    return f"{_flat(key)}: {opening}\n{body}\n{indent}{closing}"


def _case(case: dict[str, Any]) -> str:
    indent = " " * 6
    rest = [key for key in case if not any(key in row for row in ROWS)]
    lines: list[str] = []
    rows = [[key for key in row if key in case] for row in ROWS]
    for row in [*rows, rest]:
        entries = [_entry(key, case[key], indent) for key in row]
        while entries:
            wide = next((place for place, entry in enumerate(entries) if "\n" in entry), len(entries))
            lines += [line + "," for line in _pack(entries[:wide], indent)]
            lines += [indent + entry + "," for entry in entries[wide : wide + 1]]
            entries = entries[wide + 1 :]
    return "    {\n" + "\n".join(lines).removesuffix(",") + "\n    }"


def form(document: dict[str, Any]) -> str:
    """The text of a vector file."""
    head = [f"  {_entry(key, value, '  ')}," for key, value in document.items() if key != "cases"]
    cases = ",\n".join(_case(case) for case in document["cases"])
    return "{\n" + "\n".join(head) + '\n  "cases": [\n' + cases + "\n  ]\n}\n"


def counts() -> str:
    """The table: each file with its subject, its kind, and how many cases of each result it has."""
    rows = ["| file | subject | kind | valid | invalid | acceptable |", "|---|---|---|--:|--:|--:|"]
    total: Counter[str] = Counter()
    for file in files():
        document = json.loads(file.read_text(encoding="utf-8"))
        results = Counter(case["result"] for case in document["cases"])
        total += results
        name = file.relative_to(VECTORS).as_posix()
        numbers = " | ".join(str(results[result] or "") for result in ("valid", "invalid", "acceptable"))
        rows.append(f"| [{name}]({name}) | {document['subject']} | `{document['kind']}` | {numbers} |")
    numbers = " | ".join(str(total[result]) for result in ("valid", "invalid", "acceptable"))
    rows.append(f"| **{len(files())} files** | **{sum(total.values())} cases** | | {numbers} |")
    return "\n".join(rows)


def with_counts(readme: str) -> str:
    """The README with the table of today."""
    before, _, rest = readme.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n{counts()}\n\n{END}{after}"


def main() -> None:
    """Bring everything into its form; say what was changed."""
    for file in files():
        before = file.read_text(encoding="utf-8")
        document = json.loads(before)
        number(document, file.stem)
        if (after := form(document)) != before:
            file.write_text(after, encoding="utf-8")
            sys.stdout.write(f"{file.relative_to(VECTORS)}\n")
    readme = VECTORS / "README.md"
    before = readme.read_text(encoding="utf-8")
    if (after := with_counts(before)) != before:
        readme.write_text(after, encoding="utf-8")
        sys.stdout.write("README.md\n")


if __name__ == "__main__":
    main()
