"""The vectors on MicroPython: builds an edition that answers their questions, asks it, and counts the cases by kind."""

from __future__ import annotations

import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from barewire_workbench.live.vector_adapter import VectorAdapter
from barewire_workbench.vectors.files import load_vectors
from barewire_workbench.vectors.run import CheckSummary, run_cases, selected
from tools.micropython.build import FAMILIES, PARTS, Edition
from tools.micropython.seconds import PER_SECOND
from tools.micropython.sources import ROOT, Place

HERE = Path(__file__).parent
_NAMES = (
    "number bits register-part text pdu exchange crc16 lrc rtu-frame rtu-talk ascii-frame ascii-talk tcp-frame "
    "tcp-talk client server sdo sdo-talk"
)
KINDS: dict[str, tuple[str, ...]] = dict.fromkeys(_NAMES.split(), ()) | {"sdo-talk": ("client",)}
"""The kinds that an edition with all parts answers, and of these the operations; all of them if none is named."""
THIRTY_DAYS = 30 * 86400 * PER_SECOND


def answering_edition(start: int) -> Edition:
    """Return an edition with all parts and our answers, whose clock shows `start` where the vectors begin to count."""
    answers = "tools.micropython.answers"
    roots = [Place(answers, "answer"), Place(answers, "kinds"), Place(answers, "serve")]
    constants = {"barewire_workbench.vectors.answers.values:START": start}
    return Edition((*PARTS, *FAMILIES), roots, KINDS, constants)


def modules() -> str:
    """Return the folder of npm's modules with MicroPython; it is installed if it is not there."""
    command = [str(ROOT / "tools" / "get-modules"), "tools/micropython"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return done.stdout.strip()


def check(start: int, program: str | None = None) -> CheckSummary:
    """Ask every question of these kinds, and return the numbers; what has failed is printed."""
    summary = CheckSummary()
    with tempfile.TemporaryDirectory() as folder:
        answering_edition(start).write(Path(folder))
        if program is None:
            command = [str(ROOT / "tools" / "with-node"), "node", str(HERE / "answer.mjs"), modules(), folder]
        else:
            script = f"import sys; sys.path.insert(0, '{folder}'); from tools.micropython.answers import serve; serve()"
            command = [program, "-X", "heapsize=32M", "-c", script]
        with VectorAdapter(shlex.join(command)) as adapter:
            for case in run_cases(selected(load_vectors(), kinds=KINDS), adapter):
                summary.add(case)
                if case.verdict.state == "failed":
                    sys.stdout.write(f"failed  {case.id}: {case.verdict.text}\n")
    return summary


def main(program: str | None = None) -> int:
    """Print the numbers of both runs. Return 1 if a case has failed, or if the runs differ.

    `program` is a MicroPython of this machine, in place of the one in node.
    """
    summaries = [check(start, program) for start in (0, THIRTY_DAYS)]
    first, late = summaries
    sys.stdout.write(f"{'kind':16}{'passed':>8}{'not offered':>13}{'after 30 days':>15}\n")
    for kind, counts in first.by_kind.items():
        numbers = counts["passed"] + counts["open"], counts["not offered"], late.by_kind[kind]["passed"]
        sys.stdout.write("{:16}{:8}{:13}{:15}\n".format(kind, *numbers))
    passed = [summary.total["passed"] for summary in summaries]
    sys.stdout.write(f"{passed[0]} cases passed on MicroPython, {passed[1]} with a clock that shows 30 days\n")
    return int(any(summary.total["failed"] for summary in summaries) or first.by_kind != late.by_kind)
