"""Faults of units, lines and adapters."""

from __future__ import annotations

import json
import shutil
import sys
from bisect import bisect_left
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from tempfile import TemporaryDirectory

from tests.interop.canopen.guest import in_guest
from tools.gateway_lab.plots import Curve, plot_over_time
from tools.gateway_lab.programs import (
    ROOT,
    gateway,
    line,
    load,
    median,
    peak_memory,
    program,
    remaining_lines,
    stand_in,
    together,
)

_TOLD = 20.0
"""Seconds of the run that a plot shows."""


def measure_dead(runs: int) -> list[str]:
    """Two units of ten are dead: what the living keep; a greedy client beside polite ones."""
    lines = ["| | all ten answer | two are dead, first 10 s | 30 s after that |", "|---|---:|---:|---:|"]
    shares: list[tuple[float, float, float]] = []
    for _ in range(runs):
        with program(*stand_in("field", "-", 10, 0)) as field, gateway(line(field.first, 0.3)) as own:
            whole = load(*own, 5.0, 32).rate
        with program(*stand_in("field", "-", 8, 0)) as field, gateway(line(field.first, 0.3)) as own:
            begin = load(*own, 10.0, 32).rate
            later = load(*own, 30.0, 32).rate  # a dead unit is tried every 15 s or less often
        shares.append((whole, begin, later))
    whole, begin, later = (median(list(column)) for column in zip(*shares))
    lines.append(f"| right answers in a second, 32 clients | {whole:.0f} | {begin:.0f} | {later:.0f} |")
    with program(*stand_in("field", "-", 10, 0)) as field, gateway(line(field.first, 0.3)) as own:
        each = load(*own, 10.0, 10, greedy=16).each
    polite = f"nine polite ones {min(each[1:])} to {max(each[1:])}"
    greedy = f"A client that sends 16 requests at once got {each[0]} answers, {polite}."
    return ["### Dead units, greedy clients", "", *lines, "", greedy, ""]


def measure_faults(runs: int) -> list[str]:
    """Loss, noise, late and damaged answers at once."""
    kinds = "late:0.05,drop:0.05,flip:0.05,noise:0.05,split:0.05,exception:0.02"
    with (
        program(*stand_in("field", kinds, 10, 0)) as field,
        gateway(line(field.first, 0.1), more="dead_after = 3") as own,
    ):
        total = together([load(*own, 10.0, 8) for _ in range(runs)])
        memory = peak_memory(own[0])
    text = f"Faults in a quarter of the answers ({kinds.replace(':', ' ')}): {total.summary}; {memory:.1f} MiB at most."
    return ["### Everything at once", "", text, ""]


def measure_adapters(runs: int) -> list[str]:
    """An adapter that is pulled out and put in again, beside a line that stays."""
    seconds = 10.0 + 10.0 * runs
    with TemporaryDirectory() as folder:
        path = f"{folder}/adapter"
        both = f"{line(path, 0.3, '1-5', 'pulled')}\n[[backend]]\n"
        with program(*stand_in("field", "-", 10, 0)) as steady, program(*stand_in("adapter", path, 5, 1)) as adapter:
            with gateway(both + line(steady.first, 0.3, "6-10", "stays")) as own, ThreadPoolExecutor() as threads:
                futures = [threads.submit(load, *own, seconds, 8, units, pause=0.05) for units in ((1, 5), (6, 10))]
                pulled, stays = (future.result() for future in futures)
                memory = peak_memory(own[0])
            adapter.terminate()
            events = [(word, float(at)) for word, at in map(str.split, remaining_lines(adapter))]
    start = min(pulled.moments[0], stays.moments[0])
    absences = [
        (gone - start, back - start)
        for (word, gone), (_, back) in pairwise(events)
        if word == "gone" and start < gone and back < start + seconds
    ]
    waits = [
        pulled.moments[place] - start - back
        for _, back in absences
        if (place := bisect_left(pulled.moments, start + back)) < len(pulled.moments)
    ]
    picture = plot_over_time(
        "adapters",
        "right answers in a second",
        [
            Curve.of_moments("line that stays", [at - start for at in stays.moments], _TOLD),
            Curve.of_moments("adapter pulled out (grey)", [at - start for at in pulled.moments], _TOLD),
        ],
        [(gone, back) for gone, back in absences if back < _TOLD],
    )
    return [
        "### An adapter that is pulled out",
        "",
        f"A pseudo-terminal vanished {len(absences)} times in {seconds:g} s, for {min(b - a for a, b in absences):.1f} "
        f"to {max(b - a for a, b in absences):.1f} s, and returned under its name with another number. Eight clients "
        f"each on its five units and on five of another line, which wait for 0.05 s after an exception:",
        "",
        "| | |",
        "|---|---|",
        f"| pulled out | {pulled.summary} |",
        f"| line that stays | {stays.summary} |",
        f"| first right answer after the return | {median(waits):.2f} s, {max(waits):.2f} s at most |",
        f"| memory at most | {memory:.1f} MiB |",
        "",
        picture,
        "",
    ]


_PHASES = {
    "quiet": "nothing else on the bus",
    "babbling": "another node fills a bus of 125 kbit/s with the identifier 001h",
    "same identifier": "another node sends random data with the identifier of the answers, twenty times a second",
    "bus-off": "bus-off after a second, restart after two",
    "after it": "nothing else on the bus",
}


def measure_can(runs: int) -> list[str]:
    """A CAN bus in trouble, with SocketCAN in a guest kernel: a babbling node, and bus-off."""
    title = "### A CAN bus in trouble"
    if not all(map(shutil.which, ("linux.uml", "busybox", "cangen", "cc"))):
        return [
            title,
            "",
            "Not measured: user-mode-linux, busybox-static, can-utils or a compiler is not installed.",
            "",
        ]
    command = (sys.executable, "-m", "tools.gateway_lab.can_guest")
    paths = {"PYTHONPATH": f"{ROOT}/src:{ROOT}/workbench/src:{ROOT}"}
    totals: dict[str, Counter[str]] = {name: Counter() for name in _PHASES}
    recoveries: dict[str, list[float]] = {name: [] for name in _PHASES}
    memory = 0.0
    for _ in range(runs):
        with in_guest(command, paths) as done:
            if done.status:
                raise OSError(str(done))
            rows = json.loads(done.out)
        memory = max(memory, rows.pop("memory"))
        for name, row in rows.items():
            totals[name].update(row["counts"])
            recoveries[name] += [row["recovery"]] if "recovery" in row else []
    lines = ["| | right | **wrong** | 0B | **lost** | right again after |", "|---|---:|---:|---:|---:|---:|"]
    for name, counts in totals.items():
        cells = " | ".join(f"{counts.pop(kind, 0):,}" for kind in ("right", "wrong", "0B", "lost"))
        others = f", and {dict(counts)}" if counts else ""
        back = f"{max(recoveries[name]):.2f} s" if recoveries[name] else ""
        lines.append(f"| {_PHASES[name]} | {cells}{others} | {back} |")
    text = (
        "SocketCAN in a guest kernel with one processor, on which all programs take turns. A client reads objects of "
        "a simulated AZ3 by 2B/0D; one request in fifty goes to a node that is not there. vcan has no arbitration: "
        "what a real bus would do to the frames of the others is not in these numbers."
    )
    return [title, "", text, "", *lines, "", f"Memory at most {memory:.1f} MiB.", ""]
