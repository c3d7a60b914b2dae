"""Start-up times: `load("az3")`, and `barewire read` from its start to its first line.

Both are compared with a new interpreter that imports click, which the command line uses. Each piece of work is a new
interpreter; that of `load` measures the call itself, after `from barewire.devices import load`.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack

import pytest

from barewire import ModbusServer, Table
from bench.race import Factory, Many, Race, Work, entries

LOAD = """
import time
from barewire.devices import load
start = time.perf_counter()
load("az3")
print(time.perf_counter() - start)
"""


class Loaded(Many):
    """`load("az3")` in a new interpreter; only the call is measured."""

    measures_itself = True

    def __init__(self) -> None:
        super().__init__(self._load)

    def _load(self, count: int) -> float:
        run = subprocess.run([sys.executable, "-c", LOAD], capture_output=True, text=True, check=True)
        return float(run.stdout)


class FirstLine(Many):
    """A command, measured from its start to its first line of output."""

    measures_itself = True

    def __init__(self, *arguments: str) -> None:
        super().__init__(self._start)
        self.command = [sys.executable, *arguments]

    def _start(self, count: int) -> float:
        start = time.perf_counter()
        with subprocess.Popen(self.command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stdout.readline()
            took = time.perf_counter() - start
            process.stdout.read()
        return took


def _click(_: ExitStack) -> Work:
    return FirstLine("-c", "import click; print(click)")


def _read(closing: ExitStack) -> Work:
    server = closing.enter_context(ModbusServer("tcp://127.0.0.1:0", units={1: Table()}))
    return FirstLine("-m", "barewire", "read", server.url, "az3", "STATUS WORD")


STARTS: dict[str, Factory] = {
    "python, import click": _click,
    'load("az3")': lambda _: Loaded(),
    "barewire read": _read,
}
RACE = Race("Start", "in a new interpreter", "once", STARTS, rounds=9, turn=0.0)


@pytest.mark.parametrize(("race", "contestant"), entries(RACE))
def test_start(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)
