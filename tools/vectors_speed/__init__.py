"""How long a run of all cases takes with a compiled adapter:  make vectors-speed

The adapter (replay.c) has all answers ready, so what is measured is the one who asks: `barewire vectors check` with one
question at a time, as it is, and the command of the npm package. The rounds alternate; the table has the shortest
run of each, since other programs on the machine only add to it.
"""

from __future__ import annotations

import argparse
import io
import json
import shlex
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from barewire_workbench.live import vector_adapter
from barewire_workbench.vectors.answers.table import ANSWERS, own_answer
from barewire_workbench.vectors.files import load_vectors
from barewire_workbench.vectors.run import CheckSummary, run_cases
from tools.vectors_release import content, npm

SOURCE = Path(__file__).parent / "replay.c"
VECTORS = load_vectors()


def write_answers(file: Path) -> None:
    """Write the hello and our answers to all questions, as replay.c reads them."""
    hello = {"name": "replay", "version": "1", "kinds": {kind: list(row) for kind, row in ANSWERS.items()}}
    rows = [f"hello\t{json.dumps(hello)}"]
    for vector_file in VECTORS.files:
        for case in vector_file.cases:
            for question in VECTORS.questions(vector_file, case):
                answer = {"id": question.id, **own_answer(json.loads(json.dumps(question.as_json())))}
                rows.append(f"{question.id}\t{json.dumps(answer)}")
    file.write_text("\n".join(rows) + "\n", encoding="utf-8")


def in_this_process(command: str, window: int) -> int:
    """Run all cases here, and return how many have passed."""
    vector_adapter.WINDOW = window
    summary = CheckSummary()
    with vector_adapter.VectorAdapter(command) as adapter:
        for checked in run_cases(VECTORS, adapter):
            summary.add(checked)
    return summary.total["passed"]


def by_command(*words: str) -> int:
    """Run a command that prints "replay 1: N of M cases passed" last, and return N."""
    run = subprocess.run(words, capture_output=True, text=True, check=True)
    return int(run.stdout.splitlines()[-1].split()[2])


def main() -> int:
    """Measure, and print the table. Return the exit status."""
    parser = argparse.ArgumentParser(description="How long a run of all cases takes with a compiled adapter.")
    parser.add_argument("--rounds", type=int, default=5, help="runs of each (5)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        program, answers = Path(folder) / "replay", Path(folder) / "answers.txt"
        subprocess.run(["cc", "-O2", "-o", str(program), str(SOURCE)], check=True)
        write_answers(answers)
        with tarfile.open(fileobj=io.BytesIO(npm(content()))) as package:
            package.extractall(folder, filter="data")
        adapter = shlex.join([str(program), str(answers)])
        check = str(Path(folder) / "package" / "check.js")
        window = vector_adapter.WINDOW
        runs: dict[str, Callable[[], int]] = {
            "one question at a time": lambda: in_this_process(adapter, 1),
            f"{window} questions under way": lambda: in_this_process(adapter, window),
            "barewire vectors check": lambda: by_command(
                sys.executable, "-m", "barewire", "vectors", "check", "--adapter", adapter
            ),
            "npx barewire-vectors check": lambda: by_command("node", check, "check", "--", *shlex.split(adapter)),
        }
        seconds: dict[str, list[float]] = {name: [] for name in runs}
        for _ in range(options.rounds):
            for name, run in runs.items():
                begin = time.perf_counter()
                passed = run()
                seconds[name].append(time.perf_counter() - begin)
                if passed != len(VECTORS.digests):
                    raise SystemExit(f"{name}: {passed} of {len(VECTORS.digests)} cases passed")
    base = min(seconds["one question at a time"])
    sys.stdout.write(f"{len(VECTORS.digests)} cases, a compiled adapter{'seconds':>15}{'ratio':>8}\n")
    for name, row in seconds.items():
        sys.stdout.write(f"{name:32}{min(row):15.2f}{min(row) / base:8.2f}\n")
    return 0
