"""Settings of all tests: programs from outside PyPI, and the rule that CI skips no test.

A test that uses another program is marked:

    @pytest.mark.needs("socat", "mbpoll")
    def test_mbpoll_reads_our_server() -> None: ...

Each name is a line of `.ci/apt-packages.txt`. Where the program is missing, the test is skipped and the reason names
the package. With `BAREWIRE_NO_SKIPS=1` (set by `.ci/run`) every skip, for any reason, is a failure: a run without
failures has run all tests.
"""

from __future__ import annotations

import gc
import os
import shutil
import signal
import sys
from collections.abc import Generator
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import HealthCheck, settings

# The same examples in every run and on every machine, so that failures are reproducible. Of 44 planted mistakes that
# 100 examples of the property tests found, 10 examples found 42 and 30 found 43; a direct test finds the last one.
settings.register_profile(
    "steady",
    max_examples=30,
    derandomize=True,
    database=None,
    deadline=None,  # no test is timed: another program may use the processor
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("steady")

# Twenty thousand collected tests are millions of objects. The garbage collector would visit them again and again, which
# takes half of the time of the collection and a sixth of that of the tests. `pytest_collection_finish` enables it.
gc.disable()

# A shell that starts the tests in the background makes them ignore SIGINT, and nohup makes them ignore SIGHUP. Child
# processes would inherit that, but some tests end a program with these signals. A handler is not inherited.
for ignored in (signal.SIGINT, signal.SIGHUP):
    if signal.getsignal(ignored) is signal.SIG_IGN:
        signal.signal(ignored, lambda *_: None)

ROOT = Path(__file__).parent.parent
PROGRAMS = ROOT / ".ci" / "apt-packages.txt"
FIRST = [
    *("test_terminals.py", "interop/canopen/test_canopen_guest.py", "website/test_explorer_page.py", "workbench/live"),
    *("test_docs.py", "interop", "io", "website", "workbench/vectors", "workbench/cli", "model"),
]
"""The files and directories whose tests take longest, in the order in which they are run."""
NO_SKIPS = "BAREWIRE_NO_SKIPS"


class Program(NamedTuple):
    """One line of the list: the name in tests, the Debian package, and the program or file that proves its presence."""

    name: str
    package: str
    proof: str

    def is_here(self) -> bool:
        return Path(self.proof).exists() if "/" in self.proof else shutil.which(self.proof) is not None


def read_programs(text: str) -> dict[str, Program]:
    rows = [line.partition("#")[0].split() for line in text.splitlines()]
    return {row[0]: Program(*row) for row in rows if row}


@pytest.hookimpl(tryfirst=True)  # before --random-order
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    # Files with tests that wait come first: one of them as the last file would keep one process waiting for the other.
    def place(item: pytest.Item) -> tuple[int, str]:
        file = item.nodeid.partition("::")[0].removeprefix("tests/")  # "io/ports/test_tcp.py" of the room "io"
        at = (at for at, name in enumerate(FIRST) if file == name or file.startswith(f"{name}/"))
        return next(at, len(FIRST)), file

    items.sort(key=place)
    programs = read_programs(PROGRAMS.read_text(encoding="utf-8"))
    for item in items:
        for name in [name for mark in item.iter_markers("needs") for name in mark.args]:
            if name not in programs:
                raise pytest.UsageError(f"{item.nodeid}: needs({name!r}) is not a name in {PROGRAMS}")
            if not programs[name].is_here():
                why = f"needs {name}: apt-get install {programs[name].package}"
                item.add_marker(pytest.mark.skip(reason=why))


def pytest_collection_finish() -> None:
    """Let the garbage collector leave alone what was collected, from here on."""
    if sys.version_info < (3, 14):  # there hypothesis asks the collector who refers to its generator of random numbers
        gc.freeze()
    gc.enable()


def forbid_skip(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Turn a skip into a failure if skips are forbidden. An expected failure (xfail) is not a skip."""
    if os.environ.get(NO_SKIPS) == "1" and report.skipped and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
        report.outcome = "failed"
        report.longrepr = f"{report.nodeid}\n{reason}\n({NO_SKIPS}=1: no test may be skipped)"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    forbid_skip(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Let each of several processes begin with another part of a folder.

    In a new clone they divide the work of compiling the tests: who comes to a file later finds what another one has
    written. `pytest_collection_modifyitems` puts the tests in the same order everywhere.
    """
    report = yield
    forbid_skip(report)
    if isinstance(collector, pytest.Directory) and report.result:
        number = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
        first = len(report.result) * number // int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
        report.result = [*report.result[first:], *report.result[:first]]
    return report
