"""No row that was reported as written is lost, however the program ends: a disk in memory is stopped at each step."""

from __future__ import annotations

import csv
import io
from datetime import datetime, timedelta, timezone

import pytest

from barewire.errors import EncodeError
from barewire_workbench.value_log.csv_file import CsvFile
from barewire_workbench.value_log.rotating_log import RotatingLog, Rotation, rotation
from barewire_workbench.value_log.sample import Row
from tests.helpers import refused
from tests.workbench.value_log.memory_disk import MemoryDisk, Stopped

HEADINGS = ["time", "Number", "error"]
BEGIN = datetime(2026, 11, 27, 22, 0, tzinfo=timezone(timedelta(hours=1)))


def row(number: int, period: float = 10.0) -> Row:
    at = BEGIN + timedelta(seconds=number * period)
    return [at.isoformat(timespec="milliseconds"), number, 'a "b", c' if number % 7 == 0 else ""]


def opened(disk: MemoryDisk, rule: Rotation = Rotation()) -> RotatingLog:  # noqa: B008
    return RotatingLog(disk, "night.csv", lambda: CsvFile(disk, "night.csv", HEADINGS), rule)


def numbers_in(disk: MemoryDisk) -> list[int]:
    """The rows of all files, in the order in which they were written. Each file is whole, and has a heading."""
    found = []
    for path in [*disk.names("night-", ".csv"), "night.csv"]:
        content = disk.contents.get(path, b"")
        assert content.endswith(b"\n") or not content, path
        heading, *rows = list(csv.reader(io.StringIO(content.decode()))) or [HEADINGS]
        assert heading == HEADINGS, path
        assert all(len(cells) == 3 for cells in rows), path
        found += [int(cells[1]) for cells in rows]
    return found


class Writer:
    """Writes rows with rising numbers in sessions that are stopped; `reported` are those reported as written."""

    def __init__(self, disk: MemoryDisk, rule: Rotation, *, is_killed: bool) -> None:
        self.disk, self.rule, self.is_killed = disk, rule, is_killed
        self.number = 0
        self.reported: set[int] = set()

    def write(self, until: int, period: float) -> bool:
        """Open the log, and write up to this number. Return whether it was not stopped."""
        try:
            self._write(until, period)
        except Stopped:
            if not self.is_killed:
                self.disk.cut_power()
            return False
        finally:
            self.disk.stop_in = None
        return True

    def _write(self, until: int, period: float) -> None:
        log, first = opened(self.disk, self.rule), self.number
        while self.number < until:
            self.number += 1
            log.add(row(self.number - 1, period), self.number * period)
            # A kill leaves what was written, a power cut what was synced.
            count = self.number - first if self.is_killed and not log.problem else log.safe
            self.reported.update(range(first, first + count))
        log.close(self.number * period)
        assert log.lost == 0
        self.reported.update(range(first, self.number))

    def check(self) -> None:
        """Every reported row is in the files, each once, in order, and all lines are whole."""
        opened(self.disk, self.rule).close(0.0)
        numbers = numbers_in(self.disk)
        assert numbers == sorted(set(numbers))
        assert self.reported <= set(numbers)


RULES = {"no rotation": Rotation(), "by day": Rotation(day=True), "by size": Rotation(size=300, day=True)}


@pytest.mark.parametrize("period", [0.3, 3600.0], ids=["synced together", "synced each"])
@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
@pytest.mark.parametrize("is_killed", [True, False], ids=["killed", "power cut"])
def test_stopped_at_each_step_nothing_reported_is_lost(is_killed: bool, rule: Rotation, period: float) -> None:
    step = 0
    while True:
        disk = MemoryDisk(step)
        writer = Writer(disk, rule, is_killed=is_killed)
        assert writer.write(5, period)
        disk.stop_in = step
        is_done = writer.write(40, period)
        writer.check()
        assert writer.write(60, period)  # it goes on
        writer.check()
        assert set(range(40 if is_done else 50, 60)) <= writer.reported
        if is_done:
            break
        step += 1
    assert step > 40  # a step for each row at least


@pytest.mark.parametrize("is_killed", [True, False], ids=["killed", "power cut"])
def test_many_rows_with_rotation_and_stops_at_random(is_killed: bool) -> None:
    """A row every ten seconds for two days, files of a day and of at most 50 kB, stopped about every 40 minutes."""
    disk = MemoryDisk(7)
    writer = Writer(disk, Rotation(size=50_000, day=True), is_killed=is_killed)
    rows, stops = 2 * 24 * 360, 0
    while writer.number < rows:
        disk.stop_in = disk.random.randrange(1, 1000)
        stops += not writer.write(rows, 10.0)
    disk.stop_in = None
    writer.check()
    assert stops > 30
    assert len(disk.contents) > 10
    # Only rows that were under way when it was stopped may be missing.
    assert len(numbers_in(disk)) >= rows - 2 * stops


def test_rows_wait_for_space_on_the_disk_and_are_in_order() -> None:
    disk = MemoryDisk(3)
    log = opened(disk)
    for number in range(100):
        disk.free = {20: 35, 40: None, 50: 3}.get(number, disk.free)
        log.add(row(number), number * 10.0)
        full = 20 < number < 40 or number > 50
        assert bool(log.problem) == full or number in (20, 50)
        numbers_in(disk)
    assert log.problem == "no space left on device"
    assert len(numbers_in(disk)) < 60
    disk.free = None
    log.close(1000.0)
    assert numbers_in(disk) == list(range(100))
    assert (log.safe, log.lost) == (100, 0)


def test_rows_that_cannot_be_written_are_counted() -> None:
    disk = MemoryDisk()
    log = opened(disk)
    for number in range(3):
        log.add(row(number), 0.0)  # the second and third are not synced yet
    disk.free = 0
    for number in range(10_010):
        log.add(row(number), 0.0)
    assert (log.safe, log.written) == (1, 3)
    log.close(0.0)
    assert (log.safe, log.lost, log.problem) == (3, 10_010, "no space left on device")


def test_full_files_are_named_after_their_first_row_and_old_ones_are_removed() -> None:
    disk = MemoryDisk(1)
    log = opened(disk, Rotation(day=True, keep=2))
    for number in range(9):  # every twelve hours, from ten in the evening
        log.add(row(number, 43200.0), number * 43200.0)
    log.close(0.0)
    full = ["night-2026-11-29T100000.csv", "night-2026-11-30T100000.csv"]
    assert disk.names("", "") == [*full, "night.csv"]
    disk.contents["night-2026-12-01T100000.csv"] = disk.synced["night-2026-12-01T100000.csv"] = b""
    log = opened(disk, Rotation(size=1))
    log.add(row(9, 43200.0), 0.0)
    assert log.rotated == ["night-2026-12-01T100000_2.csv"]  # the name without a number was taken


def test_a_file_with_other_columns_is_left_alone() -> None:
    disk = MemoryDisk()
    disk.contents["night.csv"] = disk.synced["night.csv"] = b"time,Other,error\n1,2,\n"
    with refused(EncodeError, "has the columns time,Other,error: expected time,Number,error to append to it"):
        opened(disk)
    assert disk.contents["night.csv"].endswith(b"1,2,\n")


@pytest.mark.parametrize(
    ("content", "left"),
    [
        (b"", b""),
        (b"time,Num", b""),
        (b"time,Number,error\n2026-11-27T22", b""),
        (b"time,Number,error\n2026-11-27T22:00:00.000+01:00,1,\n2026", b"2026-11-27T22:00:00.000+01:00,1,\n"),
        (b"time,Number,error\n2026-11-27T22:00:00.000+01:00,1,\n\0\0\0", b"2026-11-27T22:00:00.000+01:00,1,\n"),
        (b"\0" * 200_000, b""),
    ],
    ids=["empty", "half a heading", "half a row", "half a second row", "zeros", "nothing but zeros"],
)
def test_what_is_not_whole_is_cut_off(content: bytes, left: bytes) -> None:
    disk = MemoryDisk()
    disk.contents["night.csv"] = disk.synced["night.csv"] = content
    log = opened(disk)
    assert disk.contents["night.csv"] == b"time,Number,error\n" + left
    whole = left and b"time,Number,error\n" + left
    assert log.cut_off == (
        len(content) - len(whole) if left else len(content) - content.startswith(b"time,Number,error\n") * 18
    )


@pytest.mark.parametrize("text", ["", "0", "week", "10XB", "-1", "1.5MB"])
def test_a_wrong_rotation_is_refused(text: str) -> None:
    with refused(EncodeError, "expected day, or a size such as 500kB, 10MB, 1GB"):
        rotation((text,))
