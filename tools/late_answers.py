"""Writes the tables of docs/explanation/late-answers.md: `make proof`, or `python tools/late_answers.py [QUESTIONS]`.

    exhaustive    every sequence of choices of a few small alphabets
    random        QUESTIONS questions (default 10,000,000) of a large alphabet
    clients       a quarter of that on the public clients with default options, blocking with threads and asyncio with
                  tasks, on every carrier; and fewer with every option, and with exceptions at any line.
                  `--clients QUESTIONS` plays only these, and does not write the page
    peers         clients of other libraries on the same serial line (default 1,000,000 questions, or a tenth), and on
                  the same CAN bus (a hundredth)

Libraries that are not installed are left out, and named with what they need. The work is divided among the
processors. It ends with status 1 if one answer of ours was delivered to another question.
"""

from __future__ import annotations

import logging
import os
import sys
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import chain, repeat
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from barewire.canopen import SdoServer  # noqa: E402
from tests.canopen.sdo.sdo_bus import RefusingServer  # noqa: E402
from tests.model.choices import Scenario, run_all, run_random  # noqa: E402
from tests.model.client_setups import (  # noqa: E402
    CARRIERS,
    OTHER_CARRIERS,
    Clients,
    World,
    default_options,
    errors_at_lines,
    every_option,
)
from tests.model.clients import clients_scenario  # noqa: E402
from tests.model.lanes import MANY_LANES, Fate as LaneFate, LanesSetup, LanesTally, lanes_scenario  # noqa: E402
from tests.model.one_line import Tally, scenario  # noqa: E402
from tests.model.peers import PEERS, package_version, peer_scenario  # noqa: E402
from tests.model.sdo import DEFAULT_OPTIONS, Mode, SdoTally, Transfers, sdo_scenario  # noqa: E402
from tests.model.sdo_peers import CLIENTS, LATE, SHARED, SdoFaults, SdoPeerTally, sdo_peer_scenario  # noqa: E402
from tests.model.sdo_two import TwoClients, TwoTally, two_clients_scenario  # noqa: E402
from tests.model.setups import DEEP, EVERYTHING, FEW_FAULTS, SERIAL, SMALL, WITH_OTHERS, for_framing  # noqa: E402
from tests.model.units import Framing  # noqa: E402

PAGE = ROOT / "docs" / "explanation" / "late-answers.md"
BEGIN, END = "<!-- made by tools/late_answers.py -->\n", "<!-- end -->\n"
PUBLIC = (
    "`ModbusClient` and `AsyncModbusClient` with their default options and a time-out of 0.3 s, and the clients of a",
    "`gateway`, which asks without a task for each request: only the port and the clock are replaced. A run has 48",
    "questions of one or three threads, tasks or clients of the gateway. Answers are late by any time in the",
    "window, lost, damaged, doubled, in pieces, behind noise, or exceptions; registers hold the image of a frame;",
    "questions begin shortly before a window ends; they are cancelled at any time (a task, an exception in a thread),",
    "seventeen or more in a row while the unit is busy; connections fail. The last rows have every option of a client",
    "and of its calls, or exceptions at any executed line of the package.",
)
COMPARISON = (
    "One unit that declines function 08, as most do; time-out 0.3 s; one read after the other, without retries. Of",
    "four answers one is lost; half of the others are prompt, a quarter comes after 0.35 s, a quarter after 0.8 s. The",
    "libraries are played unchanged, in the same virtual time. None of them claims to exclude late answers on serial",
    "lines.",
)
SDO_LATE = (
    "Uploads and downloads of 4 and 10 bytes, one after the other, time-out 0.3 s. An eighth of the frames is lost, an",
    "eighth is 0.25 s late.",
)
SDO_SHARED = (
    "The same without losses and delays, but an eighth of the frames is followed by a request of another client on the",
    "same channel, which reads or writes.",
)
PARTS = 16
"""Random runs are divided into so many parts, each with a seed of its own."""

ALPHABETS: dict[str, Callable[[str], Clients]] = {
    "default options": default_options,
    "every option": every_option,
    "exceptions at any line": errors_at_lines,
}
Row = tuple[str, int, int, int, int, int]
"""What was played, and the numbers of runs, questions, right answers, errors, wrong answers."""
ClientsRow = tuple[str, int, int, int, int, int, int]
"""What was played, and the numbers of questions, right answers, exception responses, no answers, cancellations, wrong
answers."""


def exhaustive(name: str, framing: Framing) -> Row:
    """Run every sequence of choices of one small alphabet."""
    tally = Tally()
    runs = run_all(scenario(for_framing((SMALL | DEEP | SERIAL)[name], framing), tally))
    return f"{framing.upper()}: {name}", runs, *_counts(tally)


LANES = {
    "cancelled at any time": LanesSetup(),
    "every fate of an answer": LanesSetup(questions=2, fates=tuple(LaneFate)),
    "the numbers wrap": LanesSetup(questions=4, fates=tuple(LaneFate)[:2], may_cancel=False, may_wrap=True),
    "writes and retries": LanesSetup(questions=2, writes=(False, True), retries=(0, 1)),
}


def exhaustive_lanes(name: str) -> Row:
    """Run every order of events of a few questions on two lanes."""
    tally = LanesTally()
    runs = run_all(lanes_scenario(LANES[name], tally))
    return f"TCP: two requests under way, {name}", runs, *_lanes_counts(tally)


SDO = {
    "two transfers, a fault at any frame": Transfers(),
    "the same, one frame without a conversation": Transfers(modes=("plain", "segments", "blocks")),
    "three of one frame, with and without a conversation": Transfers(length=3, modes=("plain", "expedited")),
}


def exhaustive_sdo(name: str) -> Row:
    """Run every sequence of a few SDO transfers with a fault at every frame."""
    tally = SdoTally()
    runs = run_all(sdo_scenario(SDO[name], tally))
    return f"SDO: {name}", runs, *_sdo_counts(tally)


def exhaustive_two(mode: Mode) -> Row:
    """Run every order of the frames of two SDO clients on one channel, with both kinds of servers."""
    tally, runs = TwoTally(), 0
    for server in (SdoServer, RefusingServer):
        runs += run_all(two_clients_scenario(TwoClients(modes=(mode,), server=server), tally))
    return f"SDO: two clients on one channel, {mode}", runs, *_sdo_counts(tally)


def random_sdo(questions: int, seed: int) -> Row:
    """Run random SDO transfers of the public client with all that the assumptions allow."""
    tally = SdoTally()
    runs = run_random(sdo_scenario(DEFAULT_OPTIONS, tally), questions // (DEFAULT_OPTIONS.length + 1), seed=seed)
    for wrong in (tally.wrong + tally.stuck)[:1]:
        sys.stderr.write(f"SDO, seed {seed}: {wrong}\n")
    return "SDO: `CanopenClient` with default options, random", runs, *_sdo_counts(tally)


def random_two(questions: int, seed: int) -> Row:
    """Run random orders of the frames of two SDO clients on one channel."""
    tally, runs = TwoTally(), 0
    for server in (SdoServer, RefusingServer):
        setup = TwoClients(transfers=4, modes=("plain", "expedited", "segments", "blocks"), server=server)
        runs += run_random(two_clients_scenario(setup, tally), questions // 16, seed=seed)
    return "SDO: two clients on one channel, random", runs, *_sdo_counts(tally)


def random_clients(alphabet: str, carrier: str, world: World, questions: int, seed: int) -> ClientsRow:
    """Run a public client with random threads or tasks, interrupts and trouble on its line."""
    tally, setup = Tally(), replace(ALPHABETS[alphabet](carrier), worlds=(world,))
    run_random(clients_scenario(setup, tally), -(-questions // setup.length), seed=seed)
    for wrong in tally.wrong[:1]:
        sys.stderr.write(f"{alphabet}, {carrier}, {world}, seed {seed}: {wrong}\n")
    counts = tally.questions, tally.right, tally.exceptions, tally.no_answer, tally.cancelled, len(tally.wrong)
    return f"{carrier}, {world}" if alphabet == "default options" else f"{carrier}: {alphabet}", *counts


def clients_parts(pool: ProcessPoolExecutor, questions: int) -> list[Iterable[ClientsRow]]:
    """Start so many questions on the public clients with default options, and half as many through a gateway; a quarter
    of that with every option, and an eighth with exceptions at any line. Returns the parts of each row."""
    parts: list[Iterable[ClientsRow]] = []
    for alphabet, share in zip(ALPHABETS, (1, 4, 8)):
        carriers = CARRIERS | OTHER_CARRIERS if alphabet == "every option" else CARRIERS
        each = questions // (share * 2 * len(carriers) * PARTS)

        def part(carrier: str, world: World, name: str = alphabet, count: int = each) -> Iterable[ClientsRow]:
            return pool.map(random_clients, *map(repeat, (name, carrier, world, count)), range(PARTS))

        for carrier in carriers:
            both = part(carrier, "blocking"), part(carrier, "asyncio")
            parts += (*both, part(carrier, "gateway")) if alphabet == "default options" else [chain(*both)]
    return parts


def clients_table(parts: list[Iterable[ClientsRow]]) -> tuple[list[str], bool]:
    """Return the rows as a table of Markdown with their total, and whether no answer was wrong."""
    rows = []
    for part in parts:
        names, *numbers = zip(*part)
        rows.append((names[0], *map(sum, numbers)))
    rows.append(("all", *(sum(numbers) for numbers in list(zip(*rows))[1:])))
    columns = "questions", "right", "exceptions", "no answer", "cancelled", "**wrong**"
    lines = [f"| client | {' | '.join(columns)} |", f"|---|{'---:|' * len(columns)}"]
    lines += [f"| {row[0]} | {' | '.join(f'{number:,}' for number in row[1:])} |" for row in rows]
    return [*lines, "", f"Seeds 0 to {PARTS - 1} for each row.", ""], rows[-1][-1] == 0


def random_part(framing: Framing, questions: int, seed: int) -> Row:
    """Run random sequences of the large alphabet."""
    tally = Tally()
    runs = run_random(scenario(for_framing(EVERYTHING, framing), tally), questions // EVERYTHING.length, seed=seed)
    return f"{framing.upper()}: random", runs, *_counts(tally)


def random_with_others(framing: Framing, questions: int, seed: int) -> Row:
    """Run random sequences with three units, broadcasts, an echo, and others on the line."""
    tally = Tally()
    runs = run_random(scenario(for_framing(WITH_OTHERS, framing), tally), questions // WITH_OTHERS.length, seed=seed)
    return f"{framing.upper()}: broadcasts, echo, others on the line, random", runs, *_counts(tally)


def random_lanes(questions: int, seed: int) -> Row:
    """Run random orders of events on four lanes."""
    tally = LanesTally()
    runs = run_random(lanes_scenario(MANY_LANES, tally), questions // MANY_LANES.questions, seed=seed)
    return "TCP: four requests under way, random", runs, *_lanes_counts(tally)


def peer_part(name: str, questions: int, seed: int) -> Row:
    """Run random sequences of a client; "barewire" is ours."""
    tally = Tally()
    play: Scenario = scenario(FEW_FAULTS, tally)
    if name != "barewire":
        play = peer_scenario(PEERS[name].connect, FEW_FAULTS, tally)
    runs = run_random(play, questions // FEW_FAULTS.length, seed=seed)
    return name, runs, *_counts(tally)


def sdo_peer_part(setup: SdoFaults, name: str, questions: int, seed: int) -> Row:
    """Run random SDO transfers of a client; "barewire" is ours."""
    tally = SdoPeerTally()
    runs = run_random(sdo_peer_scenario(CLIENTS[name], setup, tally), questions // setup.transfers, seed=seed)
    return name, runs, *_sdo_counts(tally)


def _sdo_counts(tally: SdoTally | TwoTally | SdoPeerTally) -> tuple[int, int, int, int]:
    return tally.transfers, tally.right, tally.errors, len(tally.wrong)


def _counts(tally: Tally) -> tuple[int, int, int, int]:
    errors = tally.exceptions + tally.no_answer + tally.cancelled
    return tally.questions, tally.right, errors, len(tally.wrong)


def _lanes_counts(tally: LanesTally) -> tuple[int, int, int, int]:
    return tally.questions, tally.right, tally.no_answer + tally.cancelled, len(tally.wrong)


def named(row: Row) -> Row:
    """Return a row with the version of its library."""
    if row[0] == "canopen":
        return f"canopen {package_version('canopen')}", *row[1:]
    return f"{row[0]} {PEERS[row[0]].version()}" if row[0] in PEERS else row[0], *row[1:]


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
    modes: tuple[Mode, ...] = ("plain", "expedited", "segments", "blocks")
    per_part, seeds = questions // (PARTS * 8), range(PARTS)
    peers = ["barewire", *(name for name, peer in PEERS.items() if peer.version())]
    missing = [f"{name} ({peer.needs})" for name, peer in PEERS.items() if not peer.version()]
    sdo_peers = [name for name in CLIENTS if name == "barewire" or package_version(name)]
    if len(sdo_peers) < len(CLIENTS):
        missing.append("canopen (pip install canopen)")
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        public = clients_parts(pool, questions // 4)
        small = [
            pool.submit(exhaustive, name, framing)
            for framing in framings
            for name in (SMALL | DEEP | SERIAL if framing != "tcp" else SMALL | DEEP)
        ]
        small += [pool.submit(exhaustive_lanes, name) for name in LANES]
        small += [
            *(pool.submit(exhaustive_sdo, name) for name in SDO),
            *(pool.submit(exhaustive_two, mode) for mode in modes),
        ]
        large = [pool.map(random_part, repeat(framing), repeat(per_part), seeds) for framing in framings]
        large += [pool.map(random_with_others, repeat(way), repeat(per_part // 4), seeds) for way in framings[:2]]
        large.append(pool.map(random_lanes, repeat(per_part), seeds))
        large += [pool.map(part, repeat(per_part // 10), seeds) for part in (random_sdo, random_two)]
        others = [pool.map(peer_part, repeat(name), repeat(questions // 10 // PARTS), seeds) for name in peers]
        can = {
            setup: [
                pool.map(sdo_peer_part, repeat(setup), repeat(name), repeat(questions // 100 // PARTS), seeds)
                for name in sdo_peers
            ]
            for setup in (LATE, SHARED)
        }
        clients, clients_right = clients_table(public)
        exhausted = [job.result() for job in small]
        randoms = [total(part) for part in large]
        compared = [total(part) for part in others]
        late, shared = ([total(part) for part in can[setup]] for setup in (LATE, SHARED))
    if missing:
        sys.stdout.write(f"Not installed, so not in the tables: {', '.join(missing)}.\n")
    lines = [
        *("### The public clients", "", *PUBLIC, "", *clients),
        *("### Every sequence", "", *table("alphabet", exhausted)),
        *("### Random sequences", "", *table("alphabet", randoms)),
        "An error is an exception response, an abort, `NoAnswer`, or a cancellation: the alphabet is made of trouble.",
        "",
        *("### Other clients, the same line", "", *COMPARISON, "", *table("client", map(named, compared))),
        *("### Other clients, the same CAN bus", "", *SDO_LATE, "", *table("client", map(named, late))),
        *(*SDO_SHARED, "", *table("client", map(named, shared))),
        *([f"Not installed in this run: {', '.join(missing)}."] if missing else []),
        f"CPython {sys.version.split()[0]}, {time.strftime('%Y-%m-%d')}.",
    ]
    ours = (*exhausted, *randoms, compared[0], late[0], shared[0])
    return lines, clients_right and all(row[-1] == 0 for row in ours)


def main() -> None:
    """Run everything and write the page."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("questions", nargs="?", type=int, default=10_000_000)
    parser.add_argument("--clients", type=int, metavar="QUESTIONS", help="only the public clients; the page stays")
    arguments = parser.parse_args()
    # The cables of the model are pulled out a thousand times, and each time a gateway warns of it.
    logging.getLogger("barewire").addHandler(logging.NullHandler())
    if arguments.clients is not None:
        with ProcessPoolExecutor(os.cpu_count()) as pool:
            lines, right = clients_table(clients_parts(pool, arguments.clients))
        sys.stdout.write("\n".join(lines))
        sys.exit(0 if right else 1)
    lines, right = measure(arguments.questions)
    text = "\n".join(lines) + "\n"
    sys.stdout.write(text)
    page = PAGE.read_text(encoding="utf-8")
    before, _, rest = page.partition(BEGIN)
    PAGE.write_text(before + BEGIN + "\n" + text + "\n" + END + rest.partition(END)[2], encoding="utf-8")
    sys.exit(0 if right else 1)


if __name__ == "__main__":
    main()
