"""What each program does otherwise, and what that means for its users: docs/reference/findings.md.

vectors/peers/NAME/findings.toml    the findings of a program, written by hand; NAME is barewire for those of our own
tools/scoreboard.json               which cases fail, and what the program said in the case that shows a finding

A findings.toml has `does_well`, a sentence, and rows [[finding]]:

    title           what is wrong, in one line
    consequence     one of CONSEQUENCES
    does            what the program does, with the bytes
    means           what that means for a user
    upstream        addresses of threads of its authors that were read; an empty list: none found
    shown_by        the id of the case that shows it best
    cases           all cases that fail by it, "client-rtu-late: 1 4 7 10-22", a line for each file

Every case that fails belongs to one finding, and every case of a finding fails: a new version of a program, or of the
cases, is noticed. The findings of barewire have `version`, which one has or had it, in the place of `cases`,
and `shown_by` may be a command.

python -m tools.findings            writes the page
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from tools.peers import ADAPTERS, PEERS, ROOT, Peer

PAGE = ROOT / "docs" / "reference" / "findings.md"
BOARD = ROOT / "tools" / "scoreboard.json"
OWN = ADAPTERS / "barewire" / "findings.toml"
BEGIN, END = "<!-- made by tools/findings.py -->\n", "<!-- end -->\n"
Board: TypeAlias = Mapping[str, Mapping[str, Any]]

CONSEQUENCES = {
    "wrong value": "the caller, or the device, gets another value, and no error",
    "hang": "a transfer or a state does not end, or ends by its time-out only",
    "crash": "the program stops",
    "refusal": "what is right is refused, lost or not answered",
    "none": "another byte than the standard has, and nothing comes of it on a line that works",
}
FIELDS = {"title", "consequence", "does", "means", "upstream", "shown_by"}
LONGEST = 240
"""Characters of an answer on the page."""


class Finding(NamedTuple):
    """One thing that a program does otherwise."""

    program: str
    title: str
    consequence: str
    does: str
    means: str
    upstream: tuple[str, ...]
    shown_by: str
    cases: tuple[str, ...]
    version: str
    """Which version of barewire has or had it; of the others the scoreboard knows the version."""


# The files ---------------------------------------------------------------------------------------------------------


def file_of(peer: Peer) -> Path:
    """Return the file with the findings of a program."""
    return peer.folder / "findings.toml"


def read(program: str, file: Path) -> tuple[str, list[Finding]]:
    """Return what a program does well, and its findings. Raise ValueError for a file that is none."""
    document = tomllib.loads(file.read_text(encoding="utf-8"))
    kind = "version" if program == "barewire" else "cases"
    found = []
    for row in document["finding"]:
        if {*row} != FIELDS | {kind}:
            raise ValueError(f"{file}: {row.get('title')}: expected the fields {', '.join(sorted(FIELDS | {kind}))}")
        if row["consequence"] not in CONSEQUENCES:
            raise ValueError(f"{file}: {row['title']}: consequence: expected one of {', '.join(CONSEQUENCES)}")
        title, does, means = (" ".join(row[name].split()) for name in ("title", "does", "means"))
        upstream, cases = tuple(row["upstream"]), tuple(expanded(row.get("cases", "")))
        rest = row["shown_by"], cases, row.get("version", "")
        found.append(Finding(program, title, row["consequence"], does, means, upstream, *rest))
    return " ".join(document["does_well"].split()), found


def expanded(text: str) -> Iterator[str]:
    """Yield the ids of lines such as "lrc: 1 3-5". Raise ValueError for what is no number and no range.

    >>> list(expanded("lrc: 1 3-5"))
    ['lrc-1', 'lrc-3', 'lrc-4', 'lrc-5']
    """
    stem = ""
    for word in text.split():
        if word.endswith(":"):
            stem = word[:-1]
        elif match := re.fullmatch(r"(\d+)(?:-(\d+))?", word):
            first = int(match[1])
            yield from (f"{stem}-{number}" for number in range(first, int(match[2] or first) + 1))
        else:
            raise ValueError(f"{stem}: {word}: expected a number of a case, or a range such as 3-5")


def all_of(board: Board) -> dict[str, tuple[str, list[Finding]]]:
    """Return the findings of all programs with a row in the scoreboard, and of barewire."""
    found = {peer.name: read(peer.name, file_of(peer)) for peer in PEERS if peer.name in board and not peer.oracle}
    return {**found, "barewire": read("barewire", OWN)}


def problems(program: str, findings: Iterable[Finding], failed: Iterable[str]) -> list[str]:
    """Return what is wrong with the findings of a program, as sentences; `failed` are the cases that fail."""
    listed = Counter(case for one in findings for case in one.cases)
    failing = {*failed}
    wrong = [f"{program}: no finding has {case}, which fails" for case in sorted(failing - {*listed})]
    wrong += [f"{program}: {case} does not fail, a finding has it" for case in sorted({*listed} - failing)]
    wrong += [f"{program}: {case} is in two findings" for case, count in listed.items() if count > 1]
    wrong += [
        f"{program}: {one.title}: {one.shown_by} is to show it, and is not among its cases"
        for one in findings
        if one.cases and one.shown_by not in one.cases
    ]
    return wrong


def shown_cases(peer: Peer) -> set[str]:
    """Return the cases that show the findings of a program: the scoreboard keeps what was said in them."""
    return {one.shown_by for one in read(peer.name, file_of(peer))[1]} if file_of(peer).exists() else set()


def shortened(text: str) -> str:
    """Return what was said in a case on one line, without folders; the middle of a long text is left out.

    >>> shortened("it ended: /tmp/a/b.c:7:  failed")
    'it ended: b.c:7: failed'
    """
    line = re.sub(r"(?<!\S)/(?:[\w.-]+/)+", "", " ".join(text.split()))
    return line if len(line) <= LONGEST else f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"


# The page ----------------------------------------------------------------------------------------------------------


def tables(board: Board, findings: Mapping[str, tuple[str, list[Finding]]]) -> str:
    """Return the generated part of the page: the list by consequence, and a section for each program."""
    others = [one for name, (_, rows) in findings.items() if name != "barewire" for one in rows]
    lines = ["## By consequence"]
    for consequence, meaning in CONSEQUENCES.items():
        chosen = [one for one in others if one.consequence == consequence]
        lines += ["", f"**{consequence.capitalize()}**: {meaning}. {len(chosen)} findings.", ""]
        lines += [f"- [{one.program}](#{anchor(one.program)}): {one.title}" for one in chosen]
    for name, (does_well, rows) in findings.items():
        row = board.get(name, {})
        lines += ["", f"## {name}", ""]
        if name != "barewire":
            count = len(row["failed"])
            lines += [f"Version {row['version']}, {row['language']}; {count} cases fail by {len(rows)} findings.", ""]
        lines += [f"Does well: {does_well}", ""]
        for number, one in enumerate(in_order(rows), 1):
            lines += [*described(number, one, row), ""]
        lines.pop()
    return "\n".join(lines) + "\n"


def in_order(rows: Iterable[Finding]) -> list[Finding]:
    """Return findings sorted by consequence, the worst first."""
    return sorted(rows, key=lambda one: [*CONSEQUENCES].index(one.consequence))


def described(number: int, one: Finding, row: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of one finding."""
    yield f"{number}. **{one.title}** ({one.consequence}). {one.does}"
    yield ""
    yield f"   *For a user:* {one.means}"
    yield ""
    if one.version:
        yield f"   *Case:* `{one.shown_by}`. *In:* {one.version}."
        return
    threads = ", ".join(f"[{short_of(url)}]({url})" for url in one.upstream) or "no thread found"
    said = row["shown"].get(one.shown_by, "")
    yield f"   *Case:* `{one.shown_by}`: `` {said} `` *Upstream:* {threads}."
    if len(one.cases) > 1:
        yield ""
        yield f"   *{len(one.cases)} cases:* {'; '.join(grouped(one.cases))}"


def anchor(name: str) -> str:
    """Return the anchor of a heading."""
    return re.sub(r"[^\w-]", "", name.lower().replace(" ", "-"))


def short_of(url: str) -> str:
    """Return the short form of an address of a thread.

    >>> short_of("https://github.com/owner/name/issues/7")
    'owner/name#7'
    """
    match = re.fullmatch(r"https://github\.com/([^/]+/[^/]+)/(?:issues|pull)/(\d+)", url)
    return f"{match[1]}#{match[2]}" if match else url


def grouped(cases: Iterable[str]) -> list[str]:
    """Return ids as one text for each file.

    >>> grouped(["lrc-1", "lrc-3", "lrc-4", "lrc-5", "crc16-2"])
    ['lrc 1 3-5', 'crc16 2']
    """
    groups: dict[str, list[int]] = {}
    for case in cases:
        stem, _, number = case.rpartition("-")
        groups.setdefault(stem, []).append(int(number))
    return [f"{stem} {' '.join(ranges(sorted(numbers)))}" for stem, numbers in groups.items()]


def ranges(numbers: list[int]) -> Iterator[str]:
    """Yield sorted numbers as numbers and ranges of three and more."""
    run: list[int] = []
    for number in [*numbers, -1]:
        if run and number != run[-1] + 1:
            yield from [f"{run[0]}-{run[-1]}"] if len(run) > 2 else map(str, run)
            run = []
        run.append(number)


def with_tables(text: str, board: Board) -> str:
    """Return the page with its tables up to date."""
    before, _, rest = text.partition(BEGIN)
    after = rest.partition(END)[2]
    return f"{before}{BEGIN}\n{tables(board, all_of(board))}\n{END}{after}"


def load_board() -> Board:
    """Return the results of the last run of the scoreboard."""
    found: Board = json.loads(BOARD.read_text(encoding="utf-8"))
    return found


def main() -> int:
    """Write the page. Return the exit status: 1 if a case that fails has no finding, or a finding is wrong."""
    board = load_board()
    wrong = [
        text
        for name, (_, rows) in all_of(board).items()
        for text in problems(name, rows, board.get(name, {"failed": ()})["failed"])
    ]
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8"), board), encoding="utf-8")
    sys.stdout.write("".join(f"{text}\n" for text in wrong))
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
