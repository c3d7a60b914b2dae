"""A log of rows in a file that is synced, renamed and begun anew; rows wait in memory while the disk is full.

add(row)      written at once; the program may be killed, the row is there
sync          at most `SYNC_EVERY` seconds later it is on the disk, and counted as `safe`: also after a power cut
removed       if another program removes or moves the file, it is begun anew
rotation      night.csv becomes night-2026-11-27T220000.csv, after the time of its first row, and begins anew
full disk     what was written of a row is taken back; it is tried again with the next one
"""

from __future__ import annotations

import os
import re
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from barewire.errors import EncodeError, PortError, shown
from barewire_workbench.value_log.csv_file import Disk
from barewire_workbench.value_log.sample import Row

SYNC_EVERY = 1.0
"""Seconds: of rows that come more often than that, those of a second are synced together."""

_WAITING = 10_000
"""Rows that are kept in memory while they cannot be written; then the oldest are lost."""

_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9}


class LogFile(Protocol):
    """A file of a log. Its methods raise OSError."""

    first_time: str
    last_time: str
    cut_off: int

    def add(self, row: Row, *, is_last: bool = False) -> None: ...

    def size(self) -> int: ...

    def sync(self) -> None: ...

    def is_in_place(self) -> bool: ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class Rotation:
    """When a file is full. size: bytes, 0 for any; day: at the first row of a new day; keep: full files, 0 for all."""

    size: int = 0
    day: bool = False
    keep: int = 0


def rotation(texts: tuple[str, ...], keep: int = 0) -> Rotation:
    """Return the rotation of texts such as "day" and "10MB". Raises EncodeError.

    >>> rotation(("day", "10MB"))
    Rotation(size=10000000, day=True, keep=0)
    """
    size, day = 0, False
    for text in texts:
        number = re.fullmatch(r"(\d{1,12}) ?([kmg]?)b?", text.lower())
        if text.lower() == "day":
            day = True
        elif number and int(number[1]):
            size = int(number[1]) * _UNITS[number[2]]
        else:
            raise EncodeError(f"rotation {shown(text)}: expected day, or a size such as 500kB, 10MB, 1GB")
    return Rotation(size, day, keep)


class RotatingLog:
    """A log whose present file is `path`. `open_file` opens it, to append to it.

    safe      rows that are on the disk since this log was opened
    lost      rows that were given up
    problem   why rows wait; empty if none do
    rotated   the files that became full
    begun_anew   how often the file was begun anew because another program had removed or moved it

    The constructor raises EncodeError for a file with other columns, PortError for one that cannot be opened. Later
    errors of the disk are in `problem`.
    """

    def __init__(
        self, disk: Disk, path: str, open_file: Callable[[], LogFile], rotation: Rotation = Rotation()
    ) -> None:
        self.path = path
        self.safe = self.lost = self.begun_anew = 0
        self.problem = ""
        self.rotated: list[str] = []
        self._disk, self._open, self._rotation = disk, open_file, rotation
        self._waiting: deque[Row] = deque()
        self._unsynced = 0
        self._synced_at = float("-inf")
        try:
            self._file: LogFile | None = open_file()
        except PortError:
            raise
        except OSError as error:
            raise PortError(f"{path}: {error.strerror or error}") from None
        self.cut_off = self._file.cut_off

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.path}: {self.safe} rows>"

    @property
    def written(self) -> int:
        """Rows that are in the file, also if the program is killed."""
        return self.safe + self._unsynced

    def add(self, row: Row, now: float) -> None:
        """Write a row, and those that wait."""
        self._waiting.append(row)
        if len(self._waiting) > _WAITING:
            self._waiting.popleft()
            self.lost += 1
        self.advance(now)

    def advance(self, now: float, *, is_last: bool = False) -> None:
        """Write what waits, and sync if it is time; with `is_last` at once."""
        self.problem = ""
        try:
            while self._waiting:
                self._file_for(self._waiting[0]).add(self._waiting[0], is_last=is_last)
                self._waiting.popleft()
                self._unsynced += 1
        except OSError as error:
            self.problem = _text(error)
        if self._unsynced and (is_last or now - self._synced_at >= SYNC_EVERY):
            self._synced_at = now
            try:
                self._sync()
            except OSError as error:
                self.problem = _text(error)

    def close(self, now: float) -> None:
        """Write and sync what waits, and close the file. Rows that cannot be written are lost."""
        self.advance(now, is_last=True)
        self.lost += len(self._waiting) + self._unsynced
        self._waiting.clear()
        if self._file is not None:
            self._file.close()

    def _sync(self) -> None:
        assert self._file is not None
        self._file.sync()
        self.safe += self._unsynced
        self._unsynced = 0

    def _file_for(self, row: Row) -> LogFile:
        """Return the file for a row, a new one if the present one is full, or not there any more."""
        if self._file is not None:
            is_gone = not self._file.is_in_place()
            if is_gone or self._is_full(self._file, row):
                self._sync()
                left, self._file = self._file, None
                left.close()
                if is_gone:
                    self.begun_anew += 1
                else:
                    self._rename(left.first_time)
        if self._file is None:
            try:
                self._file = self._open()
            except EncodeError as error:  # another program has put a file in its place
                raise OSError(0, str(error)) from None
        return self._file

    def _is_full(self, file: LogFile, row: Row) -> bool:
        if not file.first_time:
            return False
        is_over = bool(self._rotation.size) and file.size() >= self._rotation.size
        return is_over or (self._rotation.day and file.last_time[:10] != str(row[0])[:10])

    def _rename(self, first_time: str) -> None:
        stem, end = os.path.splitext(self.path)
        start = f"{stem}-{first_time[:19].replace(':', '')}"
        name, number = f"{start}{end}", 1
        while self._disk.exists(name):
            number += 1
            name = f"{start}_{number}{end}"  # sorted behind the one without a number
        self._disk.rename(self.path, name)
        self.rotated.append(name)
        if self._rotation.keep:
            form = re.compile(re.escape(stem) + r"-\d{4}-\d\d-\d\dT\d{6}(_\d+)?" + re.escape(end))
            full = [name for name in self._disk.names(f"{stem}-", end) if form.fullmatch(name)]
            for old in full[: -self._rotation.keep]:
                with suppress(OSError):
                    self._disk.remove(old)


def _text(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
