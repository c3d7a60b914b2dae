"""A table `samples` in an SQLite database, with the columns and rows of the CSV file. Each row is a transaction.

sqlite3 night.db 'SELECT time, "Speed [rpm]" FROM samples WHERE error IS NULL'
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from barewire.codecs import Value
from barewire.errors import EncodeError
from barewire_workbench.value_log.sample import Row

TABLE = "samples"
_WAIT, _LAST_WAIT = 100, 5000
"""Milliseconds in which another program may unlock the database: a row that is not the last waits for the next."""
_INTEGERS = 1 << 63
"""Integers of SQLite have 64 bits with a sign; larger ones are stored as text."""


class SqliteFile:
    """A database with a table of these headings, with the methods of `CsvFile`.

    Raises EncodeError if the table has other columns, and OSError.
    """

    cut_off = 0

    def __init__(self, path: str, headings: Sequence[str]) -> None:
        self.path = path
        with _os_error():
            self._database = sqlite3.connect(path, isolation_level=None, timeout=5.0)
        try:
            with _os_error():
                columns = ", ".join(_quoted(heading) for heading in headings)
                self._database.execute("PRAGMA synchronous = FULL")
                tables = [
                    row[0] for row in self._database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
                ]
            if tables and TABLE not in tables:
                raise EncodeError(f"{path} has the tables {','.join(tables)[:200]}: expected {TABLE} to append to it")
            with _os_error():
                self._database.execute(f"CREATE TABLE IF NOT EXISTS {TABLE} ({columns})")
                present = [row[1] for row in self._database.execute(f"PRAGMA table_info({TABLE})")]
            if present != list(headings):
                raise EncodeError(
                    f"{path} has the columns {','.join(present)[:200]}: expected {','.join(headings)[:200]} to append"
                )
            with _os_error():
                time = _quoted(headings[0])
                ends = [
                    self._database.execute(f"SELECT {time} FROM {TABLE} ORDER BY rowid {order} LIMIT 1").fetchone()
                    for order in ("ASC", "DESC")
                ]
            self.first_time, self.last_time = (str(end[0]) if end else "" for end in ends)
        except BaseException:
            self._database.close()
            raise
        self._stat = os.stat(path)
        self._insert = f"INSERT INTO {TABLE} VALUES ({', '.join('?' * len(headings))})"

    def add(self, row: Row, *, is_last: bool = False) -> None:
        """Write a row. After an OSError it is not in the file. The last rows wait longer for another program."""
        with _os_error():
            self._database.execute(f"PRAGMA busy_timeout = {_LAST_WAIT if is_last else _WAIT}")
            self._database.execute(self._insert, [*map(_stored, row[:-1]), row[-1] or None])
        self.last_time = str(row[0])
        self.first_time = self.first_time or self.last_time

    def size(self) -> int:
        """Return the size in bytes."""
        with _os_error():
            pages, size = (self._database.execute(f"PRAGMA page_{key}").fetchone()[0] for key in ("count", "size"))
        return int(pages * size)

    def sync(self) -> None:
        """Do nothing: a transaction that has ended is on the disk."""

    def is_in_place(self) -> bool:
        """Return whether it still has its path: another program may have removed or moved it."""
        try:
            return os.path.samestat(os.stat(self.path), self._stat)
        except FileNotFoundError:
            return False

    def close(self) -> None:
        """Close the database."""
        self._database.close()


def _stored(value: Value | None) -> Value | None:
    if value != value:  # SQLite stores NaN as NULL, which is a value that was not read
        return "nan"
    return str(value) if isinstance(value, int) and value >= _INTEGERS else value


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


@contextmanager
def _os_error() -> Iterator[None]:
    try:
        yield
    except sqlite3.Error as error:
        raise OSError(0, str(error)) from None
