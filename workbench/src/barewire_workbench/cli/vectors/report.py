"""What `barewire vectors check` prints and writes: lines and a table, JSON, JUnit XML."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from barewire.errors import PortError
from barewire_workbench.cli.arguments import print_json
from barewire_workbench.vectors.run import CheckedCase, CheckSummary

STATES = ("passed", "open", "failed", "not offered")


def as_fields(checked: CheckedCase) -> dict[str, Any]:
    """Return a case as one object of the JSON output."""
    fields = {
        "id": checked.id,
        "file": checked.file.name,
        "kind": checked.file.kind,
        "result": checked.case["result"],
        "state": checked.verdict.state,
    }
    return fields | ({"text": checked.verdict.text} if checked.verdict.text else {})


def summary_fields(summary: CheckSummary, name: str) -> dict[str, Any]:
    """Return the last object of the JSON output: the numbers by kind."""
    rows = {kind: {state: row[state] for state in STATES} for kind, row in summary.by_kind.items()}
    return {"implementation": name, **{state: summary.total[state] for state in STATES}, "kinds": rows}


def case_line(checked: CheckedCase) -> str:
    """Return the line of a case that did not pass."""
    comment = checked.case.get("comment", "")
    return f"{checked.verdict.state}  {checked.id}  {comment}\n    {printable(checked.verdict.text)}"


def table(summary: CheckSummary, name: str) -> str:
    """Return the numbers by kind as a table."""
    width = max(map(len, summary.by_kind), default=4)
    rows = [f"{'':{width}}" + "".join(f"{state:>13}" for state in STATES)]
    counts = [*summary.by_kind.items(), ("all", summary.total)]
    for kind, row in counts:
        rows.append(f"{kind:{width}}" + "".join(f"{row[state] or '':>13}" for state in STATES))
    total = sum(summary.total.values())
    not_offered = f", {summary.total['not offered']} not offered" if summary.total["not offered"] else ""
    return "\n".join([*rows, f"{printable(name)}: {summary.total['passed']} of {total} cases passed{not_offered}"])


def nothing_asked(cases: list[CheckedCase]) -> str:
    """Return a line that explains why no case was asked; nothing if one was."""
    if any(checked.verdict.state != "not offered" for checked in cases):
        return ""
    return f"nothing was asked; for example {cases[0].id}: {printable(cases[0].verdict.text)}"


class Progress:
    """A line of the terminal that counts the cases of a check; nothing if the error output is not a terminal."""

    def __init__(self, total: int) -> None:
        self._total, self._done, self._failed = total, 0, 0
        self._is_shown = sys.stderr.isatty()

    def add(self, checked: CheckedCase) -> None:
        """Count a case."""
        self._done += 1
        self._failed += checked.verdict.state == "failed"
        if self._is_shown and (self._done % 20 == 0 or self._done == self._total):
            print(f"\r{self._done} of {self._total} cases, {self._failed} failed ", end="", file=sys.stderr, flush=True)

    def clear(self) -> None:
        """Remove the line."""
        if self._is_shown:
            print("\r" + " " * 60 + "\r", end="", file=sys.stderr, flush=True)


def print_checked(checked: CheckedCase, as_json: bool) -> None:
    """Print one case: all of them as JSON, otherwise those that did not pass."""
    if as_json:
        print_json(as_fields(checked))
    elif checked.verdict.state == "failed":
        print(case_line(checked), flush=True)


def write_junit(path: Path, name: str, cases: list[CheckedCase]) -> None:
    """Write a file of JUnit XML: a suite for each file, a test case for each case."""
    root = ElementTree.Element("testsuites", name=f"barewire vectors: {printable(name)}")
    suites: dict[str, ElementTree.Element] = {}
    for checked in cases:
        suite = suites.get(checked.file.name)
        if suite is None:
            suite = suites[checked.file.name] = ElementTree.SubElement(root, "testsuite", name=checked.file.name)
        row = ElementTree.SubElement(suite, "testcase", classname=checked.file.name, name=checked.id)
        if checked.verdict.state == "failed":
            ElementTree.SubElement(row, "failure", message=printable(checked.verdict.text))
        elif checked.verdict.state in ("open", "not offered"):
            ElementTree.SubElement(
                row, "skipped", message=printable(f"{checked.verdict.state}: {checked.verdict.text}")
            )
    for suite in suites.values():
        suite.set("tests", str(len(suite)))
        suite.set("failures", str(len(suite.findall("testcase/failure"))))
        suite.set("skipped", str(len(suite.findall("testcase/skipped"))))
    try:
        ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise PortError(f"{path}: {error.strerror or error}") from None


def printable(text: str) -> str:
    """Return a text of a foreign program without control characters: XML does not have them, terminals obey them."""
    return "".join(character if character.isprintable() else "?" for character in text)
