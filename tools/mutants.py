"""Changes the core in every small way, one at a time, and tells which changes no test notices: `make mutants`.

    python tools/mutants.py [NAME ...]     NAME: a mutant or a pattern such as "barewire.rtu.*" (default: all)

mutmut makes the changes and runs the tests; its settings are `[tool.mutmut]` of pyproject.toml. A changed program is
called a mutant. One that no test notices survives, and must have a row with the reason in docs/reference/mutation.md:

    | function | before | after | why no test can notice it |

The tool ends with status 1 if a survivor has no row, which it prints ready to be filled in, or if a row is out of date.
After a run of all mutants it writes the numbers into the page.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "reference" / "mutation.md"
BEGIN, END = "<!-- made by tools/mutants.py -->\n", "<!-- end -->\n"
NOTICED = ("killed", "timeout", "segfault")
"""A mutant in an endless loop is stopped, which a user would notice too."""

_ROW = re.compile(
    r"^\| `+ ?(?P<function>[^`]+?) ?`+ \| (?P<before>`.+`) \| (?P<after>`.+`) \| (?P<why>[^|]+) \|$", re.M
)


class Change(NamedTuple):
    """One mutant: the function, and its lines before and after the change."""

    function: str
    before: str
    after: str


def explained(page: str) -> dict[Change, str]:
    """Return the rows of the page: each change, and why no test can notice it."""
    return {
        Change(row["function"], *(_from_cell(row[side]) for side in ("before", "after"))): row["why"]
        for row in _ROW.finditer(page)
    }


def row(change: Change, why: str = "") -> str:
    """Return the row of a change."""
    return f"| `{change.function}` | {_cell(change.before)} | {_cell(change.after)} | {why} |"


def _cell(code: str) -> str:
    fence = "``" if "`" in code else "`"
    return f"{fence}{code}{fence}".replace("|", "\\|")


def _from_cell(cell: str) -> str:
    return cell.strip("`").replace("\\|", "|")


def name_of(mutant: str) -> tuple[str, str]:
    """Return module and function of a mutant.

    >>> name_of("barewire.rtu.line.xǁRtuLineǁ_take__mutmut_10"), name_of("barewire.rtu.crc.x_crc16__mutmut_1")
    (('barewire.rtu.line', 'RtuLine._take'), ('barewire.rtu.crc', 'crc16'))
    """
    module, _, rest = mutant.rpartition("__mutmut_")[0].rpartition(".x")
    return module, rest[1:].replace("ǁ", ".")


def change_of(mutant: str) -> Change:
    """Return what a mutant changes, from the difference that mutmut shows."""
    lines = _mutmut("show", mutant).splitlines()
    lines = lines[next(place for place, line in enumerate(lines) if line.startswith("@@")) :]
    before, after = (" ".join(line[1:].strip() for line in lines if line.startswith(sign)) for sign in ("-", "+"))
    return Change(name_of(mutant)[1], before, after)


def results() -> dict[str, str]:
    """Return the state of each mutant: killed, survived, timeout, no tests, not checked."""
    lines = (line.strip().rpartition(": ") for line in _mutmut("results", "--all", "true").splitlines())
    return {mutant: state for mutant, _, state in lines if "__mutmut_" in mutant}


def table(states: dict[str, str]) -> str:
    """Return the table of numbers: a row for each file, and their sum."""
    counts: Counter[tuple[str, bool]] = Counter()
    for mutant, state in states.items():
        for module in (name_of(mutant)[0], "all"):
            counts[module, state in NOTICED] += 1
    lines = ["| file | mutants | noticed by a test | explained below |", "|---|--:|--:|--:|"]
    for module in dict.fromkeys([*sorted(name_of(mutant)[0] for mutant in states), "all"]):
        file = "all" if module == "all" else f"`{module.removeprefix('barewire.').replace('.', '/')}.py`"
        noticed, survived = counts[module, True], counts[module, False]
        lines.append(f"| {file} | {noticed + survived:,} | {noticed:,} | {survived} |")
    return "\n".join(lines) + "\n"


def _mutmut(*arguments: str) -> str:
    command = [sys.executable, "-m", "mutmut", *arguments]
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout


def main(patterns: list[str]) -> int:
    """Run the mutants, compare the survivors with the page, and write its numbers."""
    if {"-h", "--help"} & {*patterns}:
        sys.stdout.write(__doc__ or "")
        return 0
    command = [sys.executable, "-m", "mutmut", "run", "--max-children", "1", *patterns]
    if subprocess.run(command, cwd=ROOT, check=False).returncode:
        return 1
    states = results()
    page = PAGE.read_text(encoding="utf-8")
    reasons = explained(page)
    survivors = {change_of(mutant): mutant for mutant, state in states.items() if state in ("survived", "no tests")}
    unexplained = survivors.keys() - reasons.keys()
    for change in sorted(unexplained):
        sys.stdout.write(f"\nno test notices {survivors[change]}:\n{row(change)}\n")
    unchecked = sum(state == "not checked" for state in states.values())
    outdated = set() if unchecked else reasons.keys() - survivors.keys()
    for change in sorted(outdated):
        sys.stdout.write(f"\na row of docs/reference/mutation.md is out of date:\n{row(change, reasons[change])}\n")
    if unchecked:
        sys.stdout.write(
            f"\n{unchecked} mutants were not run, so the numbers of docs/reference/mutation.md stay as they are\n"
        )
    elif not unexplained and not outdated:
        head, rest = page.split(BEGIN)
        PAGE.write_text(head + BEGIN + table(states) + END + rest.split(END)[1], encoding="utf-8")
    return 1 if unexplained or outdated else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
