"""Runs the vectors over all other implementations that are installed here: `make scoreboard`.

tools/scoreboard.json       what each made of the cases: numbers for each kind, ids of failed and of open cases, and
                            what it said in the cases that show its findings (tools/findings.py)
docs/reference/scoreboard.md          the same as a page
vectors/                    `confirmed_by` or `unconfirmed` in each case, and oracles.json: who is who
tools/confirmed.json        the digest of each case as it was asked, of each program its version and a digest of what
                            asked it: after a change of one, what it said counts no more until it is asked again

python tools/scoreboard.py                  all programs; those that are not installed keep their last results
python tools/scoreboard.py pymodbus tshark  only these
python tools/scoreboard.py --page           the page from scoreboard.json, without a run
"""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from barewire.errors import PortError  # noqa: E402
from barewire_workbench.vectors.files import load_vectors  # noqa: E402
from tools import vectors as files  # noqa: E402
from tools.findings import anchor, shortened, shown_cases  # noqa: E402
from tools.peers import PEERS, Peer, PeerRun, confirms, run  # noqa: E402
from tools.vectors_release import meanings  # noqa: E402

DATA = ROOT / "tools" / "scoreboard.json"
PAGE = ROOT / "docs" / "reference" / "scoreboard.md"
ORACLES = ROOT / "vectors" / "oracles.json"
CONFIRMED = ROOT / "tools" / "confirmed.json"
BEGIN, END = "<!-- made by tools/scoreboard.py -->\n", "<!-- end -->\n"
STATES = ("passed", "failed", "open", "not offered")


def measured(found: PeerRun) -> dict[str, Any]:
    """Return the results of a program: version, numbers by kind, ids of the cases that did not pass, some answers."""
    kinds: dict[str, Counter[str]] = {}
    for checked in found.cases:
        kinds.setdefault(checked.file.kind, Counter())[checked.verdict.state] += 1
    ids = {state: [name for _, name, own in found.states() if own == state] for state in ("failed", "open")}
    rows = {kind: dict(row) for kind, row in kinds.items() if set(row) != {"not offered"}}
    shown = shown_cases(found.peer)
    said = {one.id: shortened(one.verdict.text) for one in found.cases if one.id in shown}
    return {"version": found.version, "language": found.peer.language, "kinds": rows, **ids, "shown": said}


# Confirmations -----------------------------------------------------------------------------------------------------


class Asked(NamedTuple):
    """What confirmed.json keeps: what was asked, and by what."""

    programs: dict[str, dict[str, str]]
    """By name its version, and the digest of its recipe and adapter, when it was asked."""
    cases: dict[str, str]
    """The digest of the meaning of each case when it was asked."""

    def holds(self, peer: Peer, case_id: str, meaning: str) -> bool:
        """Return whether what a program said of a case then is said of the case, recipe and adapter as they are now."""
        then = self.programs.get(peer.name, {})
        return self.cases.get(case_id) == meaning and then.get("adapter") == peer.digest


def load_asked() -> Asked:
    """Return what the last run asked."""
    return Asked(**json.loads(CONFIRMED.read_text(encoding="utf-8")))


def confirm(runs: list[PeerRun]) -> None:
    """Write into each case who confirms it, or why nobody does.

    Programs that were not run keep what they said of a case while it, their recipe and their adapter are the same.
    """
    asked, now = load_asked(), meanings()
    new = {found.peer.name: found for found in runs}
    confirmed: dict[str, set[str]] = {}
    wrong: dict[str, dict[str, list[str]]] = {}
    for found in runs:
        for checked in found.cases:
            if confirms(found.peer, checked):
                confirmed.setdefault(checked.id, set()).add(found.peer.name)
            elif checked.verdict.state in ("failed", "open"):
                wrong.setdefault(checked.id, {}).setdefault(checked.verdict.state, []).append(found.peer.name)
    data = json.loads(DATA.read_text(encoding="utf-8")) if DATA.exists() else {}
    others = [peer for peer in PEERS if peer.name in data and peer.name not in new]
    for peer in others:
        for state in ("failed", "open"):
            for case_id in data[peer.name][state]:
                if case_id in now and asked.holds(peer, case_id, now[case_id]):
                    wrong.setdefault(case_id, {}).setdefault(state, []).append(peer.name)
    for file in files.files():
        document = json.loads(file.read_text(encoding="utf-8"))
        kind = document["kind"]
        for case in document["cases"]:
            case_id = case["id"]
            told = {peer.name for peer in others if asked.holds(peer, case_id, now[case_id])}
            names = confirmed.get(case_id, set()) | kept(case.pop("confirmed_by", ()), told, kind, case)
            case.pop("unconfirmed", None)
            if names:
                case["confirmed_by"] = [peer.name for peer in PEERS if peer.name in names]
            else:
                unasked = [peer.name for peer in others if kind in data[peer.name]["kinds"] and peer.name not in told]
                case["unconfirmed"] = why_not(kind, wrong.get(case_id, {}), unasked, restating(kind, case, data))
        file.write_text(files.form(document), encoding="utf-8")
    programs = asked.programs | {
        name: {"version": found.version, "adapter": found.peer.digest} for name, found in new.items()
    }
    kept_programs = {peer.name: programs[peer.name] for peer in PEERS if peer.name in programs}
    CONFIRMED.write_text(json.dumps({"programs": kept_programs, "cases": now}, indent=0) + "\n", encoding="utf-8")


def kept(names: Iterable[str], told: Collection[str], kind: str, case: Mapping[str, Any]) -> set[str]:
    """Return who still confirms a case, of programs that were told it as it is and are not asked again."""
    return {
        peer.name for peer in PEERS if peer.name in {*names} and peer.name in told and not peer.restates(kind, case)
    }


def restating(kind: str, case: Mapping[str, Any], data: Mapping[str, Any]) -> list[str]:
    """Return the programs whose adapters make the answer to a case themselves."""
    offering = [peer for peer in PEERS if kind in data.get(peer.name, {}).get("kinds", ())]
    return [peer.name for peer in offering if peer.restates(kind, case)]


def why_not(kind: str, wrong: dict[str, list[str]], unasked: list[str], restated: list[str]) -> str:
    """Return why nobody confirms a case; `unasked` are programs that have not seen it as it is now."""
    texts = []
    against = {name for names in wrong.values() for name in names}
    if "failed" in wrong:
        texts.append(f"answered otherwise by {_in_order(wrong['failed'])}")
    if "open" in wrong:
        texts.append(f"left open by the standard, decided otherwise by {_in_order(wrong['open'])}")
    if restated := [name for name in restated if name not in against]:
        texts.append(f"the adapter of {_in_order(restated)} makes the answer")
    if unasked:
        texts.append(f"not asked since it or its adapter changed: {_in_order(unasked)}")
    return "; ".join(texts) or f"no other implementation offers this {kind}"


def _in_order(names: Collection[str]) -> str:
    return ", ".join(peer.name for peer in PEERS if peer.name in names)


def oracles(data: dict[str, Any]) -> str:
    """Return the text of oracles.json: the names in `confirmed_by`, and what is behind them."""
    rows = {
        peer.name: {"version": data[peer.name]["version"], "language": peer.language, "what": peer.what}
        for peer in PEERS
        if peer.name in data
    }
    return json.dumps(rows, indent=2) + "\n"


# The page ----------------------------------------------------------------------------------------------------------


def page(data: dict[str, Any]) -> str:
    """Return the tables: a row for each program, and one for each program and kind."""
    names = [peer.name for peer in PEERS if peer.name in data]
    stacks = [peer.name for peer in PEERS if peer.name in data and not peer.oracle]
    lines = ["## Stacks", "", "| stack | version | language | kinds | passed | failed | open | not offered |"]
    lines.append("|---|---|---|--:|--:|--:|--:|--:|")
    for name in stacks:
        row = data[name]
        total: Counter[str] = sum((Counter(kind) for kind in row["kinds"].values()), Counter())
        numbers = " | ".join(str(total[state]) for state in STATES)
        lines.append(
            f"| [{name}](#{name.lower()}) | {row['version']} | {row['language']} | {len(row['kinds'])} | {numbers} |"
        )
    lines += ["", "Kinds of which a stack offers nothing are not counted. Programs that only confirm values:", ""]
    for name in [name for name in names if name not in stacks]:
        lines.append(f"- {name} {data[name]['version']}: {', '.join(f'`{kind}`' for kind in data[name]['kinds'])}")
    lines += ["", "## Kinds"]
    for name in stacks:
        lines += ["", f"### {name}", "", "| kind | passed | failed | open | not offered |", "|---|--:|--:|--:|--:|"]
        for kind, counts in data[name]["kinds"].items():
            numbers = " | ".join(str(counts.get(state, "")) for state in STATES)
            lines.append(f"| `{kind}` | {numbers} |")
        if data[name]["failed"]:
            count = len(data[name]["failed"])
            lines += ["", f"{count} cases failed: [findings](findings.md#{anchor(name)})"]
    return "\n".join(lines) + "\n\n"


def with_tables(text: str, data: dict[str, Any]) -> str:
    """Return the page with its tables up to date."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{page(data)}{END}{after}"


def main(arguments: list[str]) -> None:
    """Run, and write the files. Exits, and writes nothing, for a name that no program has."""
    names = [peer.name for peer in PEERS]
    if arguments != ["--page"] and (unknown := [name for name in arguments if name not in names]):
        sys.exit(f"{', '.join(unknown)}: expected --page alone, or some of {', '.join(names)}")
    data: dict[str, Any] = json.loads(DATA.read_text(encoding="utf-8")) if DATA.exists() else {}
    if arguments != ["--page"]:
        vectors, runs = load_vectors(ROOT / "vectors"), []
        for peer in PEERS:
            if arguments and peer.name not in arguments:
                continue
            start = time.monotonic()
            try:
                runs.append(run(peer, vectors))
            except PortError as error:
                sys.stdout.write(f"{peer.name:16} not installed: {error}\n")
                continue
            data[peer.name] = measured(runs[-1])
            numbers = Counter(state for _, _, state in runs[-1].states())
            took = time.monotonic() - start
            sys.stdout.write(f"{peer.name:16} {runs[-1].version:10} {dict(numbers)}  {took:.1f} s\n")
        data = {peer.name: data[peer.name] for peer in PEERS if peer.name in data}
        DATA.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
        ORACLES.write_text(oracles(data), encoding="utf-8")
        confirm(runs)
        files.main()
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8"), data), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
