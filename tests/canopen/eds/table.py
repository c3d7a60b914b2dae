"""The tables of rules in docs/reference/eds.md, with an example line for each from the cases of the tests.

`python -m tests.canopen.eds.table` writes them; `test_reading.py` compares the page with them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from barewire.canopen import eds
from barewire.canopen.eds.diagnostics import LINT_RULES, PARSE_RULES
from barewire_workbench.eds.lint import lint
from tests.canopen.eds.field_files import FIELD, LINTED
from tests.canopen.eds.oddities import MADE
from tests.workbench.eds.test_lint import FAULTS, FINE

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "eds.md"
_UNSEEN = {
    "byte-order-mark": "EF BB BF",
    "line-ends": "\\r",
    "control-character": "\\x1a",
    "long-line": "Description=xxx...",
}


_BEST = ("DefaultValue=1Fh", "DefaultValue=010", "to be done", "[MyTool]", "DefaultValue=0x200+$NODEID", "[2000Sub1]")
"""Preferred examples."""


def examples() -> dict[str, str]:
    """Return an example line for each rule; none if something is missing in the file as a whole."""
    lines_of: dict[str, list[str]] = {}
    for file in files():
        document = eds.parse(file)
        for diagnostic in lint(document):
            if diagnostic.line:
                lines_of.setdefault(diagnostic.rule, []).append(document.lines[diagnostic.line - 1].text.rstrip("\r\n"))
    best = {rule: next((line for line in _BEST if line in lines), lines[0]) for rule, lines in lines_of.items()}
    return best | _UNSEEN


def files() -> Iterator[bytes]:
    """Yield the files of all cases, small ones first."""
    for oddity in [*FIELD, *MADE, *LINTED]:
        yield oddity.file if isinstance(oddity.file, bytes) else oddity.file.encode()
    for old, new, _, _ in FAULTS:
        yield FINE.replace(old, new, 1).encode()


def table(rules: dict[str, str]) -> str:
    """Return one table, in the order of the rules."""
    shown = examples()
    rows = ["| rule | message | example |", "|---|---|---|"]
    for rule, message in rules.items():
        line = shown.get(rule, "")
        rows.append(f"| `{rule}` | {message} | {f'`{line}`' if line else ''} |")
    return "\n".join(rows)


def page(text: str) -> str:
    """Return the page with both tables up to date."""
    for heading, rules in (("## Rules of reading", PARSE_RULES), ("## Rules of lint", LINT_RULES)):
        pattern = re.compile(rf"({re.escape(heading)}\n.*?\n)\| rule \|.*?(?=\n\n)", re.DOTALL)
        text = pattern.sub(lambda match, rules=rules: match[1] + table(rules), text, count=1)  # type: ignore[misc]
    return text


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
