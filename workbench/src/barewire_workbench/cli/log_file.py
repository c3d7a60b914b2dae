"""`--to FILE`: the log into which `watch` writes."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from barewire.errors import EncodeError
from barewire_workbench.cli.output import note
from barewire_workbench.frames.result import counted
from barewire_workbench.live.disk import LocalDisk
from barewire_workbench.live.polling import Clock
from barewire_workbench.value_log.csv_file import CsvFile
from barewire_workbench.value_log.reader import DATABASES
from barewire_workbench.value_log.rotating_log import LogFile, RotatingLog, Rotation
from barewire_workbench.value_log.sqlite_file import SqliteFile


def open_log(path: str, headings: Sequence[str], *, append: bool, rotation: Rotation) -> RotatingLog:
    """Return the log. Raises EncodeError for a name that has another end, a file that exists without `append`, or has
    other columns, and PortError for one that cannot be opened."""
    disk = LocalDisk()
    if path.lower().endswith(DATABASES):
        open_file: Callable[[], LogFile] = lambda: SqliteFile(path, headings)  # noqa: E731
    elif path.lower().endswith(".csv"):
        open_file = lambda: CsvFile(disk, path, headings)  # noqa: E731
    else:
        expected = f"expected a name that ends in .csv, or in {', '.join(DATABASES)} for SQLite"
        raise EncodeError(f"--to {path}: {expected}")
    if not append and os.path.exists(path):
        raise EncodeError(f"--to {path}: the file exists: --append adds to it")
    log = RotatingLog(disk, path, open_file, rotation)
    if log.cut_off:
        note(f"{path}: {log.cut_off} bytes of a line that was not finished are cut off")
    return log


@contextmanager
def kept(log: RotatingLog, clock: Clock) -> Iterator[ProblemNotes]:
    """Close the log at the end of the block, however it ends, and say what is in it."""
    try:
        yield ProblemNotes(log)
    finally:
        with signals_later():
            log.close(clock.now())
        files = f", {len(log.rotated)} full files beside it" if log.rotated else ""
        anew = f", begun anew {counted(log.begun_anew, 'time')}: it was removed or moved" if log.begun_anew else ""
        note(f"{log.path}: {log.safe} rows written{files}{anew}")
        if log.lost:
            note(f"{log.path}: {log.lost} rows could not be written: {log.problem}")


class ProblemNotes:
    """Says on stderr when rows begin to wait, and when they do not wait any more."""

    def __init__(self, log: RotatingLog) -> None:
        self._log = log
        self._last = ""

    def show(self) -> None:
        """Print a line if something has changed."""
        if self._log.problem != self._last:
            self._last = self._log.problem
            note(f"{self._log.path}: " + (f"{self._last}: rows wait" if self._last else "rows are written again"))


@contextmanager
def signals_later() -> Iterator[None]:
    """Put off the signals that would end the command until the block is done."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
