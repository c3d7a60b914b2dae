"""Read the values of logs, to draw them: CSV files and databases that `barewire watch --to` wrote."""

from __future__ import annotations

import csv
import re
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from datetime import datetime
from itertools import pairwise
from statistics import median
from typing import NamedTuple

from barewire.codecs import Value
from barewire.errors import EncodeError, PortError, shown, suggest
from barewire_workbench.value_log.sample import ERROR, TIME
from barewire_workbench.value_log.sqlite_file import TABLE

DATABASES = (".db", ".sqlite", ".sqlite3")
"""The ends of names of databases; of every other file, CSV is expected."""

_HEADING = re.compile(r"(?P<title>.+?)(?: \[(?P<unit>[^\[\]]*)\])?")
"""A name, and its unit in brackets."""
_NOT_READ = float("nan")
_YEARS = range(1900, 3000)
_LARGEST = 1e300
"""An axis is longer than the difference of its values, and has whole years on both sides: both must be numbers."""
_NEAR = 10
"""Rows before and behind a gap whose distances tell the interval of the log: a later run may have another one."""


class Curve(NamedTuple):
    """A value over time: its title and unit, times, and a number for each; NaN where it was not read."""

    title: str
    unit: str
    times: list[datetime]
    values: list[float]

    @property
    def is_state(self) -> bool:
        """Whether it is drawn in steps: a plain number that is whole each time, such as a state, does not pass through
        the numbers between."""
        return not self.unit and all(value.is_integer() for value in self.values if value == value)


def broken(curve: Curve) -> Curve:
    """Return the curve with a break, a further NaN, wherever more than three intervals lie between two rows: what
    was there is not known.

    >>> rows = [datetime(2026, 11, 28, 3, 0, second) for second in (0, 1, 2, 6, 7)]
    >>> broken(Curve("Speed", "rpm", rows, [1.0, 2.0, 3.0, 4.0, 5.0])).values
    [1.0, 2.0, 3.0, nan, 4.0, 5.0]
    """
    distances = [(later - earlier).total_seconds() for earlier, later in pairwise(curve.times)]
    times, values = curve.times[:1], curve.values[:1]
    for place, distance in enumerate(distances):
        if distance > 3 * median(distances[max(0, place - _NEAR) : place + _NEAR + 1]):
            times.append(curve.times[place])
            values.append(_NOT_READ)
        times.append(curve.times[place + 1])
        values.append(curve.values[place + 1])
    return curve._replace(times=times, values=values)


class Curves:
    """The curves of columns, given as (title, unit): at most `most` points of each, evenly spread, however many come.

    >>> kept = Curves([("Speed", "rpm")], most=4)
    >>> for second in range(11):
    ...     kept.add(datetime(2026, 11, 28, 3, 0, second), [second])
    >>> kept.curves[0].values, kept.every
    ([0.0, 4.0, 8.0], 4)
    """

    def __init__(self, columns: Iterable[tuple[str, str]], most: int = 20_000) -> None:
        self.curves = [Curve(title, unit, [], []) for title, unit in columns]
        self.every = 1
        """One row in so many is kept."""
        self.count = 0
        """Rows so far."""
        self.left_out = 0
        """Lines of a file that were no rows: half a line after a power cut, or damaged."""
        self._most = most

    def add(self, at: datetime, values: Sequence[Value | None]) -> None:
        """Keep a row, or skip it."""
        self.count += 1
        if (self.count - 1) % self.every:
            return
        for curve, value in zip(self.curves, values):
            curve.times.append(at)
            curve.values.append(_number(value))
        if self.curves and len(self.curves[0].times) > self._most:
            for curve in self.curves:
                del curve.times[1::2], curve.values[1::2]
            self.every *= 2


def read_logs(paths: Sequence[str], names: Sequence[str] = ()) -> Curves:
    """Return the values of logs with the same columns, one behind the other.

    `names` are titles of columns; without them, all with numbers. Raises PortError for a file that cannot be read,
    EncodeError for one that is no log, or for a name that it does not have.
    """
    curves: Curves | None = None
    heading: list[str] = []
    for path in paths:
        rows = _rows(path)
        columns = next(rows, [])
        if columns[:1] != [TIME] or columns[-1:] != [ERROR]:
            raise EncodeError(f"{path}: expected a log of `barewire watch --to`, with the columns {TIME}, ..., {ERROR}")
        if curves is None:
            heading, curves = columns, Curves(map(_title_and_unit, columns[1:-1]))
        elif columns != heading:
            raise EncodeError(f"{path}: it has other columns than {paths[0]}")
        for row in rows:
            time = _time(path, row[0]) if len(row) == len(heading) else None
            if time is not None:
                curves.add(time, row[1:-1])
            elif curves.count or len(row) != len(heading):
                curves.left_out += 1
            else:
                raise _no_time(path, row[0])
    assert curves is not None, "there is a path"
    curves.curves = _chosen(curves.curves, names)
    return curves


def _time(path: str, text: str) -> datetime | None:
    """Return the time of a row, None if it is damaged. Raises EncodeError for one that no log has."""
    try:
        time = datetime.fromisoformat(text)
    except ValueError:
        return None
    if time.tzinfo is None or time.year not in _YEARS:
        raise _no_time(path, text)
    return time


def _no_time(path: str, text: str) -> EncodeError:
    return EncodeError(f"{path}: {shown(text)}: expected a time such as 2026-11-28T03:00:00+01:00")


def _chosen(curves: list[Curve], names: Sequence[str]) -> list[Curve]:
    if not names:
        return [curve for curve in curves if any(value == value for value in curve.values)]
    by_title = {curve.title.casefold(): curve for curve in curves}
    for name in names:
        if name.casefold() not in by_title:
            titles = [curve.title for curve in curves]
            raise EncodeError(f"no column {shown(name)}: expected one of {', '.join(titles)}{suggest(name, titles)}")
    return [by_title[name.casefold()] for name in names]


def _title_and_unit(heading: str) -> tuple[str, str]:
    match = _HEADING.fullmatch(heading)
    return (match["title"], match["unit"] or "") if match else (heading, "")


def _number(value: Value | None) -> float:
    """Return a value as a number; text, none, or what is no place on an axis leaves a gap in the curve."""
    try:
        number = _NOT_READ if value is None else float(value)
    except ValueError:
        return _NOT_READ
    return number if abs(number) < _LARGEST else _NOT_READ


def _rows(path: str) -> Iterator[list[str]]:
    """Yield the heading and the rows as text. What is no text is replaced: it spoils its own row only."""
    try:
        if path.lower().endswith(DATABASES):
            yield from _rows_of_database(path)
        else:
            # A spreadsheet puts a mark before UTF-8.
            with open(path, encoding="utf-8-sig", errors="replace", newline="") as file:
                yield from _rows_of_text(file)
    except (OSError, sqlite3.Error) as error:
        raise PortError(f"{path}: {getattr(error, 'strerror', None) or error}") from None


def _rows_of_text(file: Iterable[str]) -> Iterator[list[str]]:
    """Yield the rows, an empty one for a line that has too many characters in a cell."""
    rows = csv.reader(file)
    while True:
        try:
            yield next(rows)
        except csv.Error:
            yield []
        except StopIteration:
            return


def _rows_of_database(path: str) -> Iterable[list[str]]:
    open(path, "rb").close()  # sqlite3 would make it
    with closing(sqlite3.connect(path)) as database:
        cursor = database.execute(f"SELECT * FROM {TABLE} ORDER BY rowid")
        yield [column[0] for column in cursor.description]
        for row in cursor:
            yield ["" if cell is None else str(cell) for cell in row]
