r"""A CSV file to which rows are added, and which is whole again after a power cut.

    time,Speed [rpm],error\n                              each line is written at once, by one call
    2026-11-28T03:00:00.000+01:00,1500,\n
    2026-11-28T03:00:10.000+01:00,15                     <- cut off when the file is opened again, so that the next
                                                            row begins a line

A line that cannot be written whole, because the disk is full, is taken back at once.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from contextlib import suppress
from typing import Protocol

from barewire.errors import EncodeError
from barewire_workbench.value_log.sample import Row, cell_text

_BLOCK = 1 << 16


class File(Protocol):
    """An open file, to the end of which is written. Its methods raise OSError."""

    def size(self) -> int: ...

    def read(self, at: int, count: int) -> bytes: ...

    def append(self, data: bytes) -> int:
        """Write some of the data at the end, and return how many bytes."""

    def cut(self, size: int) -> None:
        """Make the file shorter."""

    def sync(self) -> None:
        """Return when what was written is on the disk."""

    def is_in_place(self) -> bool:
        """Return whether it still has its path: another program may have removed or moved it."""

    def close(self) -> None: ...


class Disk(Protocol):
    """What a log needs of a directory. Its methods raise OSError; a file that was made or renamed is so after a power
    cut too."""

    def open(self, path: str) -> File:
        """Open a file, or make it."""

    def exists(self, path: str) -> bool: ...

    def rename(self, old: str, new: str) -> None: ...

    def remove(self, path: str) -> None: ...

    def names(self, start: str, end: str) -> list[str]:
        """Return the paths that begin and end so, that of the file which was written last at the end."""


class CsvFile:
    """A CSV file with these headings. `first_time` and `last_time` are those of its rows, "" without any.

    Raises EncodeError if the file has other headings, and OSError.
    """

    def __init__(self, disk: Disk, path: str, headings: Sequence[str]) -> None:
        self.path = path
        self.cut_off = 0
        """Bytes of half a line that were at the end."""
        self._file = disk.open(path)
        try:
            line = csv_line(headings)
            # Before anything is cut off: the file of another program, or of other columns, stays as it is.
            present = self._file.read(0, len(line))
            if present != line and not self._is_begun(present, line):
                raise EncodeError(_other_headings(path, present, headings))
            self._repair()
            if self._file.size() == 0:
                self._append(line)
                self._file.sync()
            self.first_time, self.last_time = self._times(len(line))
        except BaseException:
            self._file.close()
            raise

    def add(self, row: Row, *, is_last: bool = False) -> None:
        """Write a row. After an OSError it is not in the file."""
        self._append(csv_line([cell_text(value) for value in row]))
        self.last_time = str(row[0])
        self.first_time = self.first_time or self.last_time

    def size(self) -> int:
        """Return the size in bytes."""
        return self._file.size()

    def sync(self) -> None:
        """Return when all rows are on the disk."""
        self._file.sync()

    def is_in_place(self) -> bool:
        """Return whether it still has its path."""
        return self._file.is_in_place()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _append(self, data: bytes) -> None:
        start = self._file.size()
        try:
            written = 0
            while written < len(data):
                written += self._file.append(data[written:])
        except OSError:
            with suppress(OSError):
                self._file.cut(start)
            raise

    def _is_begun(self, present: bytes, line: bytes) -> bool:
        # A power cut soon after the first rows leaves a part of the headings, and behind it nothing but zeros.
        behind = range(len(present), self._file.size(), _BLOCK)
        has_zeros = not any(self._file.read(start, _BLOCK).strip(b"\0") for start in behind)
        return has_zeros and line.startswith(present.rstrip(b"\0"))

    def _repair(self) -> None:
        """Cut off what is behind the last whole line. Some file systems leave zeros there."""
        size = end = self._file.size()
        while end:
            start = max(0, end - _BLOCK)
            place = self._file.read(start, end - start).rfind(b"\n")
            if place >= 0:
                end = start + place + 1
                break
            end = start
        self.cut_off = size - end
        if self.cut_off:
            self._file.cut(end)
            self._file.sync()

    def _times(self, heading: int) -> tuple[str, str]:
        size = self._file.size()
        first = self._file.read(heading, _BLOCK).partition(b",")[0]
        last = self._file.read(max(heading, size - _BLOCK), _BLOCK).rstrip().rpartition(b"\n")[2].partition(b",")[0]
        return first.decode("utf-8", "replace"), last.decode("utf-8", "replace")


def csv_line(cells: Sequence[str]) -> bytes:
    """Return a line of CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue().encode()


def _other_headings(path: str, present: bytes, headings: Sequence[str]) -> str:
    first, end, _ = present.decode("utf-8", "replace").partition("\n")
    shown = first[:200] if end else f"{first[:200]} ..."
    return f"{path} has the columns {shown}: expected {','.join(headings)[:200]} to append to it"
