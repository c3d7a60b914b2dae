"""MicroPython on serial lines with others: `python -m tools.micropython talks --seconds 3600`.

    MicroPython, server     <-- pseudo-terminal -->    barewire on CPython, and mbpoll, in turn
    MicroPython, client     <-- pseudo-terminal -->    barewire on CPython, server

Both lines run at the same time, from a clock that shows 30 days. Who asks writes numbers and reads them back.
"""

from __future__ import annotations

import json
import os
import pty
import random
import shutil
import subprocess
import sys
import tempfile
import time
import tty
from collections import Counter
from pathlib import Path

import barewire
from tools.micropython.build import Edition
from tools.micropython.sources import ROOT, Place
from tools.micropython.vectors import HERE, modules

BAUDRATE = 115200
_IN_A_ROW = 50
"""Rounds of our client before mbpoll has the line."""


class Line:
    """A pseudo-terminal with MicroPython at one end; `path` is the other one, which exists before it is started."""

    def __init__(self) -> None:
        self._ours, self._kept = pty.openpty()  # kept open: without a program at `path` MicroPython would get an error
        tty.setraw(self._kept)
        self.path = os.ttyname(self._kept)
        self.url = f"rtu://{self.path}?baudrate={BAUDRATE}&parity=N"

    def start(self, role: str, edition: str) -> None:
        """Start MicroPython in this role, and return when it listens or asks."""
        program = [str(ROOT / "tools" / "with-node"), "node", str(HERE / "talk.mjs")]
        command = [*program, modules(), edition, role, str(BAUDRATE)]
        self._program = subprocess.Popen(
            command, stdin=self._ours, stdout=self._ours, stderr=subprocess.PIPE, text=True
        )
        os.close(self._ours)
        assert self._program.stderr is not None
        if (said := self._program.stderr.readline()) != "ready\n":
            raise SystemExit(f"MicroPython does not start: {said}{self._program.stderr.read()}")

    def close(self) -> dict[str, int]:
        """End MicroPython, and return its counts."""
        self._program.terminate()
        _, errors = self._program.communicate(timeout=20)
        os.close(self._kept)
        try:
            counts, failures = json.loads(errors.splitlines()[-1])
        except (IndexError, ValueError):
            raise SystemExit(f"MicroPython ended with: {errors}") from None
        sys.stdout.write("".join(f"{failure}\n" for failure in failures))
        return dict(counts)


def ask_ours(url: str, counts: Counter[str], seed: random.Random) -> None:
    """Write and read registers and coils with our client."""
    with barewire.ModbusClient(url, unit=1, timeout=5.0) as client:
        for _ in range(_IN_A_ROW):
            row = tuple(seed.randrange(65536) for _ in range(seed.randrange(1, 100)))
            bits = tuple(value % 2 == 1 for value in row)
            client.write_multiple_registers(5, row)
            counts["wrong"] += client.read_holding_registers(5, len(row)) != row
            client.write_multiple_coils(7, bits)
            counts["wrong"] += client.read_coils(7, len(bits)) != bits
            try:
                client.read_input_registers(199, 2)
                counts["wrong"] += 1
            except barewire.ModbusException as error:
                counts["wrong"] += error.code != 2
            counts["exchanges"] += 5


def ask_mbpoll(path: str, counts: Counter[str], seed: random.Random) -> None:
    """Write and read registers with mbpoll."""
    row = [str(seed.randrange(65536)) for _ in range(4)]
    always = [
        "mbpoll",
        "-m",
        "rtu",
        "-b",
        str(BAUDRATE),
        "-P",
        "none",
        "-a",
        "1",
        "-0",
        "-r",
        "20",
        "-t",
        "4",
        "-1",
        "-q",
    ]
    for command in ([*always, path, *row], [*always, "-c", "4", path]):
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=30)
        counts["wrong"] += done.returncode != 0
        counts["exchanges"] += 1
    shown = [words[1] for line in done.stdout.splitlines() if (words := line.split()) and words[0].startswith("[")]
    counts["wrong"] += [value.split("(")[0] for value in shown] != row


def main(seconds: float) -> int:
    """Talk for so long, and print the counts. Return 1 if anything was wrong or failed."""
    if shutil.which("mbpoll") is None:
        raise SystemExit("mbpoll is missing: apt-get install mbpoll")
    ours, poll, seed = Counter[str](), Counter[str](), random.Random(25)
    with tempfile.TemporaryDirectory() as folder:
        talk = "tools.micropython.talk"
        roots = [Place(talk, name) for name in ("begin", "hear", "result")]
        Edition(("rtu", "client", "server", "coils", "registers"), roots).write(Path(folder))
        served, asking = Line(), Line()
        with barewire.ModbusServer(asking.url, units={1: barewire.Table(200)}):
            served.start("server", folder)
            asking.start("client", folder)
            until = time.monotonic() + seconds
            while time.monotonic() < until:
                ask_ours(served.url, ours, seed)
                ask_mbpoll(served.path, poll, seed)
        of_micropython = asking.close()
        served.close()
    rows = {
        "our client, MicroPython's server": ours,
        "mbpoll, MicroPython's server": poll,
        "MicroPython's client": of_micropython,
    }
    for name, counts in rows.items():
        numbers = ", ".join(f"{counts[what]} {what}" for what in ("exchanges", "wrong", "failed") if what in counts)
        sys.stdout.write(f"{name}: {numbers}\n")
    return int(any(counts["wrong"] or counts.get("failed") or not counts["exchanges"] for counts in rows.values()))
