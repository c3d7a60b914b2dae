"""Kills processes that write a file, at a hundred moments, and checks the file: `python tests/workbench/cli/killed.py`.

    killed.py DIRECTORY                         replace_file, alternately with two contents
    killed.py DIRECTORY URL DEVICE              barewire save

A process of its own, without threads: each of its children is a fork of it, which is ready at once.
"""

from __future__ import annotations

import os
import random
import signal
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path

from barewire_workbench.cli.app import run_command_line
from barewire_workbench.cli.output import replace_file
from barewire_workbench.settings.saved import SavedSettings

MOMENTS = 100
TRIES = 5000
"""Children that are begun at most: one that was at its end before it was killed does not count."""
OLD, NEW = b"old\n" * 50_000, b"new\n" * 60_000


def main(directory: str, *arguments: str) -> int:
    """Return how many children were killed, all of them in the middle."""
    file = Path(directory) / "file"
    if not arguments:
        file.write_bytes(OLD)
        return in_the_middle(lambda: alternate(file), lambda: check_alternated(file), longest=0.01)
    url, device = arguments
    save(url, device, file)
    start = time.monotonic()
    save(url, device, file)
    longest = time.monotonic() - start
    complete = len(SavedSettings.parse(file.read_bytes(), "file").settings)

    def check() -> None:
        assert len(SavedSettings.parse(file.read_bytes(), "file").settings) == complete

    return in_the_middle(lambda: save(url, device, file), check, longest=longest)


def in_the_middle(act: Callable[[], None], check: Callable[[], None], *, longest: float) -> int:
    """Kill children that `act`, each within `longest` seconds, and `check` after each. Return how many were killed."""
    dice = random.Random(27)
    killed = 0
    for _ in range(TRIES):
        child = os.fork()
        if not child:
            act()
            os._exit(0)
        time.sleep(dice.uniform(0, longest))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        killed += os.WIFSIGNALED(status)
        check()
        if killed == MOMENTS:
            break
    return killed


def alternate(file: Path) -> None:
    while True:
        replace_file(file, NEW)
        replace_file(file, OLD)


def check_alternated(file: Path) -> None:
    assert file.read_bytes() in (OLD, NEW)


def save(url: str, device: str, file: Path) -> None:
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
        assert run_command_line(["save", url, device, str(file)]) == 0


if __name__ == "__main__":
    print(main(*sys.argv[1:]))
