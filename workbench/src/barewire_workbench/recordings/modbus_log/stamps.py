"""Times in the lines of logs.

    2024-01-05 10:31:18,257    2024-01-05T10:31:18.257Z    14.05.2025 09:57:07.113    2024/05/11 13:17:34.792
    05/01/2024 10:31:18.2 AM   a date with slashes that may be of two days: only the time of day counts
    10:31:18.257   14:32:05:052 (QModMaster)   0:13.5      a time of day, or minutes and seconds
    1700000000.257   12.345678   (12.5)   [12.5]           seconds

`LogClock` turns them into seconds that never decrease: a time of day that goes back by more than half a day is of the
next day; any other step back is kept out of the times, and noted.
"""

from __future__ import annotations

import re
from datetime import date
from functools import lru_cache

from barewire_workbench.recordings.modbus_log.model import Stamp

_DAY = 86400.0
STEP = 0.1
"""Seconds between two entries without times: long enough to end a frame, short enough to wait for an answer."""
_BACK = 1e-6
"""Seconds: a smaller step back is rounding."""

_NAMES = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_MONTHS = {name: number for number, name in enumerate(_NAMES, 1)}
_DATE = (
    r"(?:(?P<iso>\d{4})[-/.](?P<imonth>\d{1,2})[-/.](?P<iday>\d{1,2})"
    r"|(?P<first>\d{1,2})(?P<between>[-/.])(?P<second>\d{1,2})(?P=between)(?P<year>\d{4})"
    r"|(?P<name>[A-Z][a-z]{2}) {1,2}(?P<nday>\d{1,2})(?:[ ,]+(?P<nyear>\d{4}))?)"
)
_OF_DAY = r"(?P<hours>\d{1,2}):(?P<minutes>\d{2}):(?P<seconds>\d{2}(?:[.,:]\d{1,9})?)(?: ?(?P<half>[AaPp][Mm]))?"
_ZONE = r"(?:Z|[+-]\d\d:?\d\d)?"
_DATED = re.compile(rf"(?<![\w.]){_DATE}(?:[T@_]|,? +)?{_OF_DAY}(?: (?P<lastyear>\d{{4}}))?{_ZONE}(?!\w)")
_TIME = re.compile(rf"(?<![\w:.]){_OF_DAY}(?![\w:])")
_SHORT = re.compile(r"^\s*[(\[]?(?P<minutes>\d{1,3}):(?P<seconds>\d{2}[.,]\d+)[)\]]?(?=[:;,\s]|$)")
_SECONDS = re.compile(r"^\s*(?:[(\[]\s*(\d{1,12}(?:[.,]\d{1,9})?)\s*[)\]]|(\d{1,12}[.,]\d{1,9}))(?=[:;,\s]|$)")


def find_stamp(text: str) -> tuple[Stamp, int, int] | None:
    """Return the first time in a line, and where it begins and ends; None if there is none.

    >>> find_stamp("2024-01-05 10:31:18,257 DEBUG recv: 0x1")
    (Stamp(seconds=37878.257, day=19727, of_day=True), 0, 23)
    >>> find_stamp("[RTU]>Tx > 14:32:05:052 - 64 03")[0]
    Stamp(seconds=52325.052, day=None, of_day=True)
    >>> find_stamp("(12.5) 01 03"), find_stamp("01 03 00 00")
    ((Stamp(seconds=12.5, day=None, of_day=False), 0, 6), None)
    """
    if ":" in text:
        if found := _DATED.search(text):
            return Stamp(_of_day(found), _day(found), True), found.start(), found.end()
        if found := _TIME.search(text):
            return Stamp(_of_day(found), None, True), found.start(), found.end()
        if found := _SHORT.match(text):
            return Stamp(60 * int(found["minutes"]) + _number(found["seconds"])), found.start(), found.end()
    if found := _SECONDS.match(text):
        return Stamp(_number(found[1] or found[2])), found.start(), found.end()
    return None


def _number(text: str) -> float:
    return float(text.replace(",", ".").replace(":", "."))


def _of_day(found: re.Match[str]) -> float:
    hours = int(found["hours"])
    if found["half"]:
        hours = hours % 12 + (12 if found["half"].lower() == "pm" else 0)
    return 3600 * hours + 60 * int(found["minutes"]) + _number(found["seconds"])


def _day(found: re.Match[str]) -> int | None:
    """Return the day, counted from 1970-01-01; None if the date does not state the year or the order of its parts."""
    if found["iso"]:
        year, month, day = int(found["iso"]), int(found["imonth"]), int(found["iday"])
    elif found["year"]:
        first, second, year = int(found["first"]), int(found["second"]), int(found["year"])
        if found["between"] != "." and first <= 12 and second <= 12 and first != second:
            return None
        day, month = (second, first) if second > 12 else (first, second)
    else:
        stated = found["nyear"] or found["lastyear"]
        if not stated:
            return None
        year, month, day = int(stated), _MONTHS.get(found["name"].lower(), 0), int(found["nday"])
    return _day_number(year, month, day)


@lru_cache(16)
def _day_number(year: int, month: int, day: int) -> int | None:
    try:
        return date(year, month, day).toordinal() - date(1970, 1, 1).toordinal()
    except ValueError:
        return None


class LogClock:
    """Turns the stamps of a log, in order, into seconds that never decrease.

    >>> clock = LogClock()
    >>> [clock.read(Stamp(seconds, None, True), 1) for seconds in (86399.0, 1.0)]
    [86399.0, 86401.0]
    """

    def __init__(self) -> None:
        self.timed = False
        self.notes: list[str] = []
        self._now = 0.0
        self._began = False
        self._offset = 0.0

    def read(self, stamp: Stamp | None, line: int, *, step: bool = True) -> float:
        """Return the time of an entry. Without a stamp it is `STEP` after the one before, or that one's time in a log
        that has times, and without `step`."""
        if stamp is None:
            self._now += STEP if self._began and step and not self.timed else 0.0
            self._began = True
            return self._now
        at = stamp.seconds + _DAY * (stamp.day or 0) + self._offset
        if self._began and self.timed and at < self._now - _BACK:
            if stamp.of_day and stamp.day is None and self._now - at > _DAY / 2:
                self._offset += _DAY
                at += _DAY
            if at < self._now - _BACK:
                back = self._now - at
                self.notes.append(f"line {line}: the times go back by {back:g} s; later ones are counted from there")
                self._offset += back
        self._now = max(self._now, at) if self.timed else at
        self._began = self.timed = True
        return self._now
