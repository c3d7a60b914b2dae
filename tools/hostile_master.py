"""Lets a hostile master configure each device: `make hostile`, or `python tools/hostile_master.py [RANDOM] [--three]`.

    two letters     every sequence of two letters of the whole alphabet of each device; of N letters with --length N
    random          RANDOM sequences (default 20,000) of three to nine letters and single writes, of each device
    --three         every sequence of three letters of the small alphabets: 343,000, 343,000 and 64,000
                    sequences take 40 minutes of a processor with those of two letters; the last run found nothing

The work is divided among the processors. It ends with status 1 if a device did not answer or beat afterwards, and
prints the shortest sequence for each kind of failure. The checks are those of tests/model/hostile_master.py.
"""

from __future__ import annotations

import argparse
import itertools
import os
import random
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from tests.model.hostile_devices import masters  # noqa: E402
from tests.model.hostile_master import Letter  # noqa: E402


class Part(NamedTuple):
    """A part of the work, for one process: all sequences of `length` that begin with one letter, or random ones."""

    device: str
    length: int
    small: bool = False
    first: int = 0
    random: int = 0
    seed: int = 0


class Played(NamedTuple):
    """What a part found: the number of sequences, and the failures as kind -> shortest sequence."""

    sequences: int
    failures: dict[str, str]


def play(part: Part) -> Played:
    """Play the sequences of a part."""
    master = masters()[part.device]()
    letters = master.letters(small=part.small, singles=bool(part.random))
    count, failures = 0, dict[str, str]()
    for sequence in _sequences(part, letters):
        count += 1
        try:
            master.play(sequence)
        except AssertionError as error:
            kind = f"{type(error.__cause__).__name__}: {error.__cause__}"[:60]
            failures[kind] = min(str(error), failures.get(kind, str(error)), key=len)
    return Played(count, failures)


def _sequences(part: Part, letters: Sequence[Letter]) -> Iterator[Sequence[Letter]]:
    if part.random:
        dice = random.Random(part.seed)
        for _ in range(part.random):
            yield [dice.choice(letters) for _ in range(dice.randint(3, 9))]
        return
    for others in itertools.product(letters, repeat=part.length - 1):
        yield [letters[part.first], *others]


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def run(pool: ProcessPoolExecutor, title: str, parts: Iterable[Part]) -> bool:
    """Play the parts, print one line, and return whether there was no failure."""
    began, found = time.monotonic(), list(pool.map(play, parts))
    failures: dict[str, str] = {}
    for part in found:
        for kind, text in part.failures.items():
            failures[kind] = min(text, failures.get(kind, text), key=len)
    seconds = time.monotonic() - began
    _say(f"{title:34} {sum(part.sequences for part in found):>9,} sequences, {seconds:6.0f} s")
    for text in failures.values():
        _say(f"    {text}")
    return not failures


def main() -> int:
    """Run all parts. Returns the exit status."""
    parser = argparse.ArgumentParser(description="A hostile master configures each device in every way.")
    parser.add_argument("random", nargs="?", type=int, default=20_000, help="random sequences of each device")
    parser.add_argument("--length", type=int, default=2, metavar="N", help="letters of the whole alphabets, default 2")
    parser.add_argument("--three", action="store_true", help="all sequences of three letters of the small alphabets")
    options = parser.parse_args()
    is_good, workers = True, os.cpu_count() or 1
    with ProcessPoolExecutor(workers) as pool:
        for device, make in masters().items():
            whole, small = len(make().letters()), len(make().letters(small=True))
            parts = [Part(device, options.length, first=first) for first in range(whole)]
            is_good &= run(pool, f"{device}: {options.length} of {whole} letters", parts)
            share = -(-options.random // workers)
            parts = [Part(device, 0, random=share, seed=seed) for seed in range(workers)] if share else []
            is_good &= run(pool, f"{device}: random", parts)
            if options.three:
                triples = [Part(device, 3, small=True, first=first) for first in range(small)]
                is_good &= run(pool, f"{device}: 3 of {small} letters", triples)
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
