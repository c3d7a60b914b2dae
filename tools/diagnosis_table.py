"""Writes docs/reference/diagnosis-table.md: run `python tools/diagnosis_table.py` after a change of the diagnosis.

    own.json       frames of the manuals, each with one damage    one row for each
    threads.json   bytes that people posted in issue threads      one row for each thread: right if all its forms are

Both are in tests/workbench/diagnosis/broken/. A row is right if the first finding has a code that a reader expects. The
expectations were written before the answers were seen. A test compares the page with the answers of today.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from barewire.devices import load  # noqa: E402
from barewire.errors import BarewireError  # noqa: E402
from barewire_workbench import explain_exchange, explain_text  # noqa: E402
from tests.workbench.cli.helpers import run_here  # noqa: E402

BROKEN = ROOT / "tests" / "workbench" / "diagnosis" / "broken"
PAGE = ROOT / "docs" / "reference" / "diagnosis-table.md"
Case = dict[str, Any]
_ANSWERS: dict[str, list[str]] = {}

_INTRODUCTION = """# Broken inputs and what is said about them

This page is made by `python tools/diagnosis_table.py`. The inputs of the first table are frames of the manuals of three
devices, each with a damage that is met in practice. Those of the second were posted in issue threads of other projects.
One thread may have several inputs, for `barewire explain` and for `barewire diagnose`, and counts as right if the first
finding is right for all of them. *Expected* are the codes that a careful reader accepts as the first finding; "none" is
expected where nothing can be proved or nothing is wrong. The codes are described in [Diagnosis](diagnosis.md).
"""


def cases(name: str) -> list[Case]:
    """Return the cases of one file."""
    found: list[Case] = json.loads((BROKEN / name).read_text(encoding="utf-8"))["cases"]
    return found


def codes_of(case: Case) -> list[str]:
    """Return the codes of all findings, the first one first; "unreadable" if the text is refused."""
    if case["id"] not in _ANSWERS:
        _ANSWERS[case["id"]] = _answered(case)
    return _ANSWERS[case["id"]]


def _answered(case: Case) -> list[str]:
    if case["how"] == ["diagnose"]:
        return _codes_of_log(case["input"])
    protocol, request = case["how"][1], case.get("request")
    try:
        if request is not None and case.get("role") != "request" and protocol != "can":
            device = load(case["device"]) if "device" in case else None
            explanation = explain_exchange(protocol, request, case["input"], device=device)
        else:
            explanation = explain_text(protocol, case["input"], case.get("role"))
    except BarewireError:
        return ["unreadable"]
    return [finding.code for finding in explanation.diagnosis]


def _codes_of_log(text: str) -> list[str]:
    with TemporaryDirectory() as folder:
        log = Path(folder) / "posted.log"
        log.write_text(text, encoding="utf-8")
        run = run_here("diagnose", str(log), "--json")
    if run.returncode not in (0, 1) or (run.returncode == 1 and not run.stdout):
        return ["unreadable"]
    events = [json.loads(line) for line in run.stdout.splitlines()]
    return [event["code"] for event in events if event["event"] == "finding"]


def is_right(case: Case, codes: list[str]) -> bool:
    """Return whether the first finding is one that a reader expects."""
    if not codes:
        return case["expected"] in ([], ["*"]) or case.get("none_ok", False)
    if codes == ["unreadable"]:
        return False
    return case["expected"] == ["*"] or codes[0] in (case["expected"] or case.get("also", []))


def _rows(name: str) -> Iterator[tuple[str, list[tuple[Case, list[str]]]]]:
    """Yield the cases of each source with their answers: one by one for our own, by thread for the others."""
    groups: dict[str, list[tuple[Case, list[str]]]] = {}
    for case in cases(name):
        groups.setdefault(case["id"] if name == "own.json" else case["source"], []).append((case, codes_of(case)))
    yield from groups.items()


def _cell(text: str, most: int = 60) -> str:
    shown = " ".join(text.split()).replace("|", "\\|").replace("`", "'")
    return shown if len(shown) <= most else shown[: most - 3] + "..."


def _table(name: str, title: str, first: str) -> tuple[list[str], int, int]:
    lines, right, total = [], 0, 0
    for source, answers in _rows(name):
        all_right = all(is_right(case, codes) for case, codes in answers)
        right, total = right + all_right, total + 1
        # Of several inputs of a thread the first wrong one is shown, or the first.
        case, codes = next((pair for pair in answers if not is_right(*pair)), answers[0])
        command = " ".join(case["how"])
        cells = (source, f"`{command} {_cell(case['input'])}`", ", ".join(case["expected"]) or "none")
        said = codes[0] if codes else "none"
        lines.append(
            f"| {' | '.join(cells)} | {said} | {'yes' if all_right else '**no**'} | {_cell(case['why'], 160)} |"
        )
    head = [f"## {title}", "", f"Right: {right} of {total}.", ""]
    head += [f"| {first} | input | expected | first finding | right | why |", "|---|---|---|---|---|---|"]
    return [*head, *lines, ""], right, total


def page(names: Iterable[str] = ("own.json", "threads.json")) -> str:
    """Return the page."""
    titles = {
        "own.json": ("Damaged frames of three manuals", "case"),
        "threads.json": ("Bytes from issue threads", "thread"),
    }
    lines = [_INTRODUCTION]
    for name in names:
        lines += _table(name, *titles[name])[0]
    return "\n".join(lines).rstrip() + "\n"


def main() -> None:
    """Write the page, and say how many rows are right."""
    PAGE.write_text(page(), encoding="utf-8")
    counts = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("Right")]
    sys.stdout.write("\n".join(counts) + "\n")


if __name__ == "__main__":
    main()
