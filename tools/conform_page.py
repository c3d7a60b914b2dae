"""Writes docs/reference/conform.md: run `python tools/conform_page.py` after every change of a case or of our answers.

    our column         our own servers are started on real ports and tested with the batteries, as `barewire conform`
                       does; our clients are played against tests/modbus/client/faulty.py
    peer libraries     --measure starts the installed ones, and writes tools/conform_measured.json
    the survey         tools/conform_survey.toml: its rows, and the results of others with the versions named there

A test compares the page with our current answers.
"""

from __future__ import annotations

import json
import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from barewire import ModbusServer  # noqa: E402
from barewire.io.endpoint import Endpoint  # noqa: E402
from barewire.modbus import Bus, ModbusException, Table  # noqa: E402
from barewire.rtu import RtuLine  # noqa: E402
from barewire.tcp import TcpLine  # noqa: E402
from barewire_workbench.conform.modbus import ServerCase, accepted_sequence, answer_text  # noqa: E402
from barewire_workbench.live.modbus_conformance import cases_of, conform  # noqa: E402
from tests.modbus.client import faulty  # noqa: E402
from tools import conform_peers  # noqa: E402

PAGE = ROOT / "docs" / "reference" / "conform.md"
MEASURED = ROOT / "tools" / "conform_measured.json"
SURVEY = tomllib.loads((ROOT / "tools" / "conform_survey.toml").read_text(encoding="utf-8"))
BEGIN, END = "<!-- made by tools/conform_page.py -->\n", "<!-- end -->\n"
BATTERIES: dict[str, tuple[ServerCase, ...]] = {framing: cases_of(framing) for framing in ("tcp", "rtu", "ascii")}
OURS = {
    "tcp": "tcp://127.0.0.1:0",
    "rtu": "rtu://pty?baudrate=115200&parity=N",
    "ascii": "ascii://pty?baudrate=115200&parity=N",
}

Results = Mapping[str, str]
"""The result of each case by its name: "ok", with the answer where several are allowed, or the wrong answer."""


# Servers -------------------------------------------------------------------------------------------------------------


def measure(url: str, patience: float = 0.3) -> dict[str, str]:
    """Run a battery against the server at this URL."""
    endpoint = Endpoint.parse(url)
    endpoint = endpoint._replace(options={**endpoint.options, "timeout": str(patience)})
    return {result.case.name: cell_of(result.case, result.failure, result.received) for result in conform(endpoint)}


def cell_of(case: ServerCase, failure: str | None, heard: Any) -> str:
    """Return one result as a cell of the table."""
    if failure is None:
        accepted = accepted_sequence(case, heard)
        if accepted is None:
            return "not judged"
        return "ok" if len(case.accepts) == 1 else f"ok: {in_words(accepted)}"
    # The beginning of a long answer is enough.
    answers = [answer_text(answer) for answer in heard]
    return f"**{in_words([answer if len(answer) < 24 else f'{answer[:17]} ...' for answer in answers])}**"


def in_words(sequence: Sequence[str]) -> str:
    """Return the answers, step by step."""
    return ", then ".join(answer or "silence" for answer in sequence)


def ours(kind: str) -> dict[str, str]:
    """Return our own server of this kind."""
    with ModbusServer(OURS[kind], units={1: Table(100)}) as host:
        return measure(host.url)


# Clients -------------------------------------------------------------------------------------------------------------

_FOUND = {"right": "ok", "error": "error", "wrong": "**wrong value**"}


def played(name: str) -> str:
    """Return the result of our client for one fault on an RTU line."""
    bus = Bus(RtuLine(faulty.TIMING))
    if name in faulty.SURVIVED:
        return _FOUND[faulty.outcome(faulty.unit_of(faulty.SURVIVED[name]), bus)]
    if name in faulty.REFUSED:
        return _FOUND[faulty.outcome(faulty.unit_of(faulty.REFUSED[name][0]), bus)]
    if name == "late":
        return _FOUND[faulty.outcome(faulty.unit_of(lambda good: [(1.5, good)]), bus)] + ", then its own answer"
    if name == "an echo":
        request = faulty.rtu("03 0012 0001")
        unit = faulty.unit_of(lambda good: [(0.001, request), (0.02, good)])
        return _FOUND[faulty.outcome(unit, bus)]
    if name == "cancelled":
        unit, conversation = faulty.unit_of(lambda good: [(0.3, good)]), faulty.ask(bus, 100)
        faulty.abandon_when_sent(unit, conversation)
        return "ok" if unit.play(faulty.ask(bus, 200)).registers == (200,) else _FOUND["wrong"]
    assert name == "an exception", name
    unit = faulty.unit_of(lambda good: [(0.01, good)])
    try:
        unit.play(faulty.ask(bus, 999))
    except ModbusException:
        return "at once" if unit.now < 0.1 else f"after {unit.now:g} s"
    return _FOUND["wrong"]


def played_tcp(name: str) -> str:
    """Return the result of our client for one fault over TCP."""
    row = faulty.TCP_SURVIVED.get(name) or (lambda good: [(0.01, faulty.TCP_REFUSED[name][0])])
    return _FOUND[faulty.outcome(faulty.Unit(row, TcpLine()), Bus(TcpLine()))]


# The page ------------------------------------------------------------------------------------------------------------


def table(head: list[str], rows: list[list[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]


def expected(case: ServerCase) -> str:
    """Return the allowed answers of a case, in a cell."""
    return " or<br>".join(dict.fromkeys(in_words(sequence) for sequence in case.accepts))


def battery_lines(kind: str, own: Results, measured: Mapping[str, Mapping[str, Results]]) -> list[str]:
    """Return a battery case by case: our result, and those of the measured peer libraries."""
    peers = {name: kinds[kind] for name, kinds in measured.items() if kind in kinds}
    rows = [
        [
            case.name,
            case.clause,
            expected(case),
            own[case.name],
            *(cells.get(case.name, "-") for cells in peers.values()),
        ]
        for case in BATTERIES[kind]
    ]
    return table(["case", "clause", "may be answered", "barewire", *peers], rows)


def survey_lines(kind: str, cell: Any) -> list[str]:
    """Return the rows of the survey: our cell is made now, the others were measured."""
    part = SURVEY[kind]
    rows = [[row["text"], cell(row), *row["results"]] for row in part["row"]]
    return table(["row", "barewire", *part["versions"]], rows)


def all_of(results: Results, row: Any) -> str:
    """Return the cell of a row that covers several cases: ok, or the wrong answers."""
    wrong = [results[name] for name in row["cases"] if not results[name].startswith("ok")]
    return "; ".join(wrong) or "ok"


def several(play: Any, row: Any) -> str:
    """Return the cell of a row that covers several faults."""
    return "; ".join(dict.fromkeys(play(name) for name in row["plays"]))


def made(own: Mapping[str, Results], measured: Mapping[str, Mapping[str, Results]]) -> str:
    """Return the text between the two markers of the page."""
    names = {"tcp": "TCP, TLS, UDP", "rtu": "RTU", "ascii": "ASCII"}
    lines = ["", "## Servers, in the rows of the survey", "", "### On TCP", ""]
    lines += survey_lines("tcp", lambda row: all_of(own["tcp"], row))
    lines += ["", "### RTU, on a line with others", ""]
    lines += survey_lines("rtu", lambda row: all_of(own["rtu"], row))
    lines += ["", "## Clients, against a peer that does everything wrong", "", "### RTU", ""]
    lines += survey_lines("client", lambda row: several(played, row))
    lines += ["", "### TCP", ""]
    lines += survey_lines("client_tcp", lambda row: several(played_tcp, row))
    for kind, title in names.items():
        lines += ["", f"## Case by case: {title}", ""]
        lines += battery_lines(kind, own[kind], measured)
    return "\n".join([*lines, "", ""])


def page(own: Mapping[str, Results]) -> str:
    """Return the page with its generated part up to date."""
    measured = json.loads(MEASURED.read_text(encoding="utf-8"))
    text = PAGE.read_text(encoding="utf-8")
    begin, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    return text[:begin] + made(own, measured) + text[end:]


def main() -> None:
    """Measure the peer libraries with --measure, then write the page."""
    if "--measure" in sys.argv[1:]:
        found: dict[str, dict[str, dict[str, str]]] = {}
        for name, kind, cells in conform_peers.measured(lambda url: measure(url, 0.8)):
            found.setdefault(name, {})[kind] = cells
            passed = sum(cell.startswith("ok") for cell in cells.values())
            sys.stdout.write(f"{name} {kind}: {passed} of {len(cells)}\n")
        MEASURED.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    PAGE.write_text(page({kind: ours(kind) for kind in OURS}), encoding="utf-8")


if __name__ == "__main__":
    main()
