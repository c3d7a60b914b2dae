"""Writes the tables of docs/late-answers.md: `make proof`, or `python tools/late_answers.py [QUESTIONS]`.

    exhaustive    every sequence of choices of a few small alphabets
    random        QUESTIONS questions (default 10,000,000) of a large alphabet
    peers         clients of other libraries on the same serial line (default 1,000,000 questions, or a tenth)

The work is divided among the processors. It ends with status 1 if one answer of ours was delivered to another question.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from tests.model.choices import run_all, run_random  # noqa: E402
from tests.model.lanes import Fate as LaneFate, LanesSetup, LanesTally, lanes_scenario  # noqa: E402
from tests.model.one_line import Framing, Tally, scenario  # noqa: E402
from tests.model.peers import PEERS, peer_scenario, peer_version  # noqa: E402
from tests.model.sdo import SdoTally, Transfers, sdo_scenario  # noqa: E402
from tests.model.setups import DEEP, EVERYTHING, FEW_FAULTS, SMALL, for_framing  # noqa: E402

PAGE = ROOT / "docs" / "late-answers.md"
BEGIN, END = "<!-- made by tools/late_answers.py -->\n", "<!-- end -->\n"
COMPARISON = (
    "One unit that declines function 08, as most do; time-out 0.3 s; one read after the other, without retries. Of",
    "four answers one is lost; half of the others are prompt, a quarter comes after 0.35 s, a quarter after 0.8 s. The",
    "libraries are played unchanged, in the same virtual time. None of them claims to exclude late answers on serial",
    "lines.",
)
PARTS = 16
"""Random runs are divided into so many parts, each with a seed of its own."""

Row = tuple[str, int, int, int, int, int]
"""What was played, and the numbers of runs, questions, right answers, errors, wrong answers."""


def exhaustive(name: str, framing: Framing) -> Row:
    """Run every sequence of choices of one small alphabet."""
    tally = Tally()
    runs = run_all(scenario(for_framing((SMALL | DEEP)[name], framing), tally))
    return f"{framing.upper()}: {name}", runs, *_counts(tally)


def exhaustive_lanes() -> Row:
    """Run every order of events of three questions on two lanes."""
    tally = LanesTally()
    runs = run_all(lanes_scenario(LanesSetup(lanes=2, questions=3), tally))
    return "TCP: two requests under way, cancelled at any time", runs, *_lanes_counts(tally)


def exhaustive_sdo() -> Row:
    """Run every pair of SDO transfers with a fault at every frame."""
    tally = SdoTally()
    runs = run_all(sdo_scenario(Transfers(), tally))
    counts = tally.transfers, tally.right, tally.errors, len(tally.wrong)
    return "SDO: two transfers, a fault at any frame", runs, *counts


def random_part(framing: Framing, questions: int, seed: int) -> Row:
    """Run random sequences of the large alphabet."""
    tally = Tally()
    runs = run_random(scenario(for_framing(EVERYTHING, framing), tally), questions // EVERYTHING.length, seed=seed)
    return f"{framing.upper()}: random", runs, *_counts(tally)


def random_lanes(questions: int, seed: int) -> Row:
    """Run random orders of events on four lanes."""
    tally = LanesTally()
    setup = LanesSetup(lanes=4, questions=20, fates=tuple(LaneFate))
    runs = run_random(lanes_scenario(setup, tally), questions // setup.questions, seed=seed)
    return "TCP: four requests under way, random", runs, *_lanes_counts(tally)


def peer_part(name: str, questions: int, seed: int) -> Row:
    """Run random sequences of a client; "barewire" is ours."""
    tally = Tally()
    play = scenario(FEW_FAULTS, tally) if name == "barewire" else peer_scenario(PEERS[name][1], FEW_FAULTS, tally)
    runs = run_random(play, questions // FEW_FAULTS.length, seed=seed)
    return name, runs, *_counts(tally)


def _counts(tally: Tally) -> tuple[int, int, int, int]:
    errors = tally.exceptions + tally.no_answer + tally.cancelled
    return tally.questions, tally.right, errors, len(tally.wrong)


def _lanes_counts(tally: LanesTally) -> tuple[int, int, int, int]:
    return tally.questions, tally.right, tally.no_answer + tally.cancelled, len(tally.wrong)


def named(row: Row) -> Row:
    """Return a row with the version of its library."""
    return f"{row[0]} {peer_version(PEERS[row[0]][0])}" if row[0] in PEERS else row[0], *row[1:]


def total(rows: Iterable[Row]) -> Row:
    """Add the numbers of rows that belong together."""
    every = list(rows)
    runs, questions, right, errors, wrong = (sum(numbers) for numbers in zip(*(row[1:] for row in every)))
    return every[0][0], runs, questions, right, errors, wrong


def table(head: str, rows: Iterable[Row]) -> list[str]:
    """Return rows as a table of Markdown."""
    lines = [f"| {head} | runs | questions | right | errors | **wrong** |", "|---|---:|---:|---:|---:|---:|"]
    return [*lines, *(f"| {row[0]} | {' | '.join(f'{number:,}' for number in row[1:])} |" for row in rows), ""]


def measure(questions: int) -> tuple[list[str], bool]:
    """Return the tables, and whether no answer of ours was wrong."""
    framings: tuple[Framing, ...] = ("rtu", "ascii", "tcp")
    per_part = questions // (PARTS * 4)
    peers = ["barewire", *(name for name, (distribution, _) in PEERS.items() if peer_version(distribution))]
    missing = [name for name, (distribution, _) in PEERS.items() if not peer_version(distribution)]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        small = [pool.submit(exhaustive, name, framing) for framing in framings for name in SMALL | DEEP]
        small += [pool.submit(exhaustive_lanes), pool.submit(exhaustive_sdo)]
        large = [pool.map(random_part, repeat(framing), repeat(per_part), range(PARTS)) for framing in framings]
        large.append(pool.map(random_lanes, repeat(per_part), range(PARTS)))
        others = [pool.map(peer_part, repeat(name), repeat(questions // 10 // PARTS), range(PARTS)) for name in peers]
        exhausted = [job.result() for job in small]
        randoms = [total(part) for part in large]
        compared = [total(part) for part in others]
    lines = [
        *("### Every sequence", "", *table("alphabet", exhausted)),
        *("### Random sequences", "", *table("alphabet", randoms)),
        "An error is an exception response, `NoAnswer`, or a cancellation: the alphabet is made of trouble.",
        "",
        *("### Other clients, the same line", "", *COMPARISON),
        *([f"Not installed in this run: {', '.join(missing)}."] if missing else []),
        "",
        *table("client", map(named, compared)),
        f"CPython {sys.version.split()[0]}, {time.strftime('%Y-%m-%d')}.",
    ]
    return lines, all(row[-1] == 0 for row in (*exhausted, *randoms, compared[0]))


def main() -> None:
    """Run everything and write the page."""
    questions = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000
    lines, right = measure(questions)
    text = "\n".join(lines) + "\n"
    sys.stdout.write(text)
    page = PAGE.read_text(encoding="utf-8")
    before, _, rest = page.partition(BEGIN)
    PAGE.write_text(before + BEGIN + "\n" + text + "\n" + END + rest.partition(END)[2], encoding="utf-8")
    sys.exit(0 if right else 1)


if __name__ == "__main__":
    main()
