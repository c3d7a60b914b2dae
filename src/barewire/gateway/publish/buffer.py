"""The readings that the broker has not acknowledged yet, in the order in which they were read, in an SQLite file.

    append  ->  | 17 | 18 | 19 | 20 |  ->  batch: sent, and marked as sent  ->  acknowledged: deleted up to 18

A row that was sent and not acknowledged (the broker or this program ended meanwhile) is sent again, and says so. Beyond
`limit` rows the oldest are dropped and counted. Committed rows survive the end of the program; a power failure may cost
the last second (SQLite's write-ahead log, synchronous NORMAL), which spares flash memory. While the file cannot be
written (the disk is full, another program has it locked), new rows wait in memory.
"""

from __future__ import annotations

import sqlite3
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import NamedTuple

from barewire.errors import PortError


class BufferedReading(NamedTuple):
    """One row. `sequence` grows by one with each reading, also over restarts."""

    sequence: int
    topic: str
    payload: str
    was_sent: bool
    """Whether it was sent before and may have arrived."""


class Buffer:
    """A bounded queue in a file, or in memory. Every method raises PortError if the file cannot be read or written.

    >>> buffer = Buffer(limit=2)
    >>> buffer.append([("a", "1"), ("b", "2"), ("c", "3")])
    >>> [row.topic for row in buffer.batch(10)], buffer.dropped
    (['b', 'c'], 1)
    >>> buffer.close()
    """

    def __init__(self, file: str = ":memory:", limit: int = 100_000) -> None:
        self.file = file
        self.limit = limit
        self.dropped = 0
        """Rows dropped because the buffer was full."""
        self._acknowledged = 0
        """The latest row that the broker has, also if it could not be deleted."""
        self._unwritten: deque[tuple[str, str]] = deque()
        try:
            # With a time-out, a locked file would stop the event loop.
            self._rows = sqlite3.connect(file, timeout=0.0, isolation_level=None)
            self._rows.executescript(
                "PRAGMA journal_mode = WAL; PRAGMA synchronous = NORMAL; "
                "CREATE TABLE IF NOT EXISTS reading (sequence INTEGER PRIMARY KEY AUTOINCREMENT, topic TEXT NOT NULL, "
                "payload TEXT NOT NULL, was_sent INTEGER NOT NULL DEFAULT 0)"
            )
            (self._size,) = self._rows.execute("SELECT count(*) FROM reading").fetchone()
        except sqlite3.Error as error:
            raise PortError(f"{file}: {error}") from None

    def __len__(self) -> int:
        return int(self._size) + len(self._unwritten)

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        """Do everything in the block, or nothing."""
        try:
            self._rows.execute("BEGIN IMMEDIATE")
            yield
            self._rows.execute("COMMIT")
        except sqlite3.Error as error:
            with suppress(sqlite3.Error):  # there is none if BEGIN failed
                self._rows.execute("ROLLBACK")
            raise PortError(f"the buffer {self.file}: {error}") from None

    def append(self, rows: Sequence[tuple[str, str]]) -> None:
        """Add readings, (topic, payload) each. After PortError they wait in memory for the next call."""
        self._unwritten.extend(rows)
        while len(self._unwritten) > self.limit:
            self._unwritten.popleft()
            self.dropped += 1
        self._write()

    def _write(self) -> None:
        """Write what is in memory only."""
        if not self._unwritten:
            return
        surplus = max(0, len(self) - self.limit)
        oldest = "SELECT sequence FROM reading ORDER BY sequence LIMIT ?"
        with self._transaction():
            self._rows.executemany("INSERT INTO reading (topic, payload) VALUES (?, ?)", self._unwritten)
            self._rows.execute(f"DELETE FROM reading WHERE sequence IN ({oldest})", [surplus])
        self._size += len(self._unwritten) - surplus
        self.dropped += surplus
        self._unwritten.clear()

    def batch(self, count: int) -> list[BufferedReading]:
        """Return the oldest rows, at most `count`, and mark them as sent."""
        self._write()
        with self._transaction():
            oldest = "SELECT * FROM reading WHERE sequence > ? ORDER BY sequence LIMIT ?"
            rows = self._rows.execute(oldest, [self._acknowledged, count]).fetchall()
            if rows:
                self._rows.execute("UPDATE reading SET was_sent = 1 WHERE sequence <= ?", [rows[-1][0]])
        return [BufferedReading(sequence, topic, payload, bool(sent)) for sequence, topic, payload, sent in rows]

    def acknowledged(self, sequence: int) -> None:
        """Delete the rows up to this one: the broker has them. After PortError the next call deletes them."""
        self._acknowledged = sequence
        with self._transaction():
            deleted = self._rows.execute("DELETE FROM reading WHERE sequence <= ?", [sequence]).rowcount
        self._size -= deleted

    def close(self) -> None:
        """Close the file."""
        self._rows.close()
