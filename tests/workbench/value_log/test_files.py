"""The rows of an SQLite log; reading both kinds of files again, to draw them."""

from __future__ import annotations

import os
import sqlite3
import time
from contextlib import closing
from math import nan
from pathlib import Path

import pytest

from barewire.errors import EncodeError, PortError
from barewire_workbench.live.disk import LocalDisk
from barewire_workbench.value_log.csv_file import CsvFile
from barewire_workbench.value_log.reader import read_logs
from barewire_workbench.value_log.rotating_log import LogFile, RotatingLog, Rotation
from barewire_workbench.value_log.sample import Row
from barewire_workbench.value_log.sqlite_file import SqliteFile
from tests.helpers import refused

HEADINGS = ["time", 'Speed "n" [rpm]', "Status", "Text", "error"]


def opened(path: Path) -> LogFile:
    return SqliteFile(str(path), HEADINGS) if path.suffix == ".db" else CsvFile(LocalDisk(), str(path), HEADINGS)


def row(second: int, speed: float | None, status: int | None = 1, error: str = "") -> Row:
    return [f"2026-11-28T03:00:{second:02}.000+01:00", speed, status, "a\nb", error]


@pytest.mark.parametrize("name", ["night.csv", "night.db"])
def test_rows_are_appended_rotated_and_read_again(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    for start in (0, 10):
        log = RotatingLog(LocalDisk(), str(path), lambda: opened(path), Rotation(size=1))
        log.add(row(start, 1.5), 0.0)
        log.add(row(start + 1, None, None, "no answer"), 1.0)
        log.close(2.0)
        assert (log.safe, log.lost) == (2, 0)
    files = sorted(map(str, tmp_path.iterdir()))
    assert len(files) == 4
    curves = read_logs(files)
    speed, status = curves.curves  # the column of texts has no curve
    assert (speed.title, speed.unit, speed.is_state) == ('Speed "n"', "rpm", False)
    assert [value for value in speed.values if value == value] == [1.5, 1.5]
    assert [at.second for at in speed.times] == [0, 1, 10, 11]
    assert (status.unit, status.is_state) == ("", True)
    assert [curve.title for curve in read_logs(files, ["status"]).curves] == ["Status"]
    with refused(EncodeError, "no column 'Stats': expected one of"):
        read_logs(files, ["Stats"])


@pytest.mark.parametrize("name", ["night.csv", "night.db"])
@pytest.mark.parametrize("is_moved", [False, True])
def test_a_file_that_another_program_removes_or_moves_is_begun_anew(tmp_path: Path, name: str, is_moved: bool) -> None:
    path, moved = tmp_path / name, tmp_path / f"moved-{name}"
    log = RotatingLog(LocalDisk(), str(path), lambda: opened(path))
    log.add(row(0, 1.0), 0.0)
    path.rename(moved) if is_moved else path.unlink()
    log.add(row(1, 2.0), 1.0)
    log.close(2.0)
    assert (log.safe, log.lost, log.problem, log.begun_anew) == (2, 0, "", 1)
    assert read_logs([str(path)], ['Speed "n"']).curves[0].values == [2.0]
    if is_moved:
        assert read_logs([str(moved)], ['Speed "n"']).curves[0].values == [1.0]


def test_rows_wait_while_another_file_is_in_the_place_of_the_log(tmp_path: Path) -> None:
    path = tmp_path / "night.csv"
    log = RotatingLog(LocalDisk(), str(path), lambda: opened(path))
    path.unlink()
    path.write_text("A file of something else\n")
    log.add(row(0, 1.0), 0.0)
    assert "expected time,speed" in log.problem
    path.unlink()
    log.add(row(1, 2.0), 1.0)
    log.close(2.0)
    assert (log.safe, log.lost) == (2, 0)


def test_a_locked_database_holds_nobody_up_and_its_rows_wait(tmp_path: Path) -> None:
    path = tmp_path / "night.db"
    log = RotatingLog(LocalDisk(), str(path), lambda: opened(path))
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        start = time.monotonic()
        for number in range(10):
            log.add(row(number, 1.0), float(number))
        assert time.monotonic() - start < 25.0, "SQLite would wait 5 s each time"
        assert log.problem == "database is locked"
        other.execute("ROLLBACK")
    log.close(9.0)
    assert (log.safe, log.lost) == (10, 0)


def test_the_oldest_full_file_is_removed_also_in_the_hour_that_comes_twice(tmp_path: Path) -> None:
    path = tmp_path / "night.csv"
    log = RotatingLog(LocalDisk(), str(path), lambda: opened(path), Rotation(size=1, keep=1))
    for second, clock in enumerate(("02:50:00.000+02:00", "02:10:00.000+01:00", "02:20:00.000+01:00")):
        log.add([f"2026-10-25T{clock}", 1.0, 1, "", ""], float(second))
        os.utime(path, (second, second))
    log.close(9.0)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["night-2026-10-25T021000.csv", "night.csv"]


def test_a_database_has_types_and_takes_other_columns_for_another_log(tmp_path: Path) -> None:
    path = tmp_path / "night.db"
    file = SqliteFile(str(path), HEADINGS)
    file.add(["2026-11-28T03:00:00.000+01:00", 2.5, True, 1 << 63, ""])
    assert file.first_time == file.last_time == "2026-11-28T03:00:00.000+01:00"
    file.add(["2026-11-28T03:00:01.000+01:00", nan, False, "", ""])
    file.close()
    with closing(SqliteFile(str(path), HEADINGS)) as again:
        assert again.last_time == "2026-11-28T03:00:01.000+01:00"
    with closing(sqlite3.connect(path)) as database, database:
        assert database.execute("SELECT * FROM samples").fetchall() == [
            ("2026-11-28T03:00:00.000+01:00", 2.5, 1, str(1 << 63), None),
            ("2026-11-28T03:00:01.000+01:00", "nan", 0, "", None),
        ]
    with refused(EncodeError, "expected time,Other,error to append"):
        SqliteFile(str(path), ["time", "Other", "error"])
    with closing(sqlite3.connect(tmp_path / "shop.db")) as database, database:
        database.execute("CREATE TABLE orders (number)")
    with refused(EncodeError, "has the tables orders: expected samples to append to it"):
        SqliteFile(str(tmp_path / "shop.db"), HEADINGS)
    (tmp_path / "text.db").write_text("not a database, but long enough to be looked at" * 10)
    with pytest.raises(OSError, match="not a database"):
        SqliteFile(str(tmp_path / "text.db"), HEADINGS)


def test_files_that_are_no_logs_are_named(tmp_path: Path) -> None:
    other = tmp_path / "other.csv"
    other.write_text("a,b\n1,2\n")
    with refused(EncodeError, "other.csv: expected a log of `barewire watch --to`"):
        read_logs([str(other)])
    other.write_text("time,A,error\nyesterday,1,\n")
    with refused(EncodeError, "'yesterday': expected a time such as"):
        read_logs([str(other)])
    for missing in ("none.csv", "none.db"):
        with refused(PortError, "No such file"):
            read_logs([str(tmp_path / missing)])
    assert not (tmp_path / "none.db").exists()
    for name, error in (("binary.csv", EncodeError), ("binary.db", PortError)):
        (tmp_path / name).write_bytes(b"\xff\xfe\0" * 100)
        with pytest.raises(error):
            read_logs([str(tmp_path / name)])


def test_half_a_line_at_the_end_is_not_drawn(tmp_path: Path) -> None:
    path = tmp_path / "night.csv"
    path.write_text("time,A [V],error\n2026-11-28T03:00:00.000+01:00,1,\n2026-11-28T03:0")
    curves = read_logs([str(path)])
    assert curves.curves[0].values == [1.0]
    assert curves.left_out == 1


def test_a_damaged_row_costs_only_itself(tmp_path: Path) -> None:
    """A byte that is no UTF-8, in a value or in the time; more bytes without a line end than a cell may have."""
    path = tmp_path / "night.csv"
    row = b"2026-11-28T03:00:00.000+01:00,%d,\n"
    damaged = [row[:30] + b"\xff,\n", row[:8] + b"\xff" + row[9:] % 2, b"\0" * 200_000 + b"\n"]
    path.write_bytes(b"time,A [V],error\n" + b"".join([row % 1, *damaged, row % 3]))
    curves = read_logs([str(path)])
    assert str(curves.curves[0].values) == "[1.0, nan, 3.0]"
    assert (curves.count, curves.left_out) == (3, 2)


def test_a_log_that_a_spreadsheet_has_saved_is_read(tmp_path: Path) -> None:
    path = tmp_path / "night.csv"
    path.write_bytes(b"\xef\xbb\xbftime,A [V],error\r\n2026-11-28T03:00:00.000+01:00,1,\r\n")
    assert read_logs([str(path)]).curves[0].values == [1.0]


@pytest.mark.parametrize("time", ["2026-11-28T03:00:00", "0001-01-01T00:00:00+14:00", "9999-12-31T23:59:59-14:00"])
def test_a_time_without_zone_or_far_away_is_refused(tmp_path: Path, time: str) -> None:
    path = tmp_path / "night.csv"
    path.write_text(f"time,A [V],error\n2026-11-28T03:00:00+01:00,1,\n{time},2,\n")
    with refused(EncodeError, f"night.csv: '{time}': expected a time such as 2026-11-28T03:00:00+01:00"):
        read_logs([str(path)])


def test_numbers_that_no_curve_can_show_are_gaps(tmp_path: Path) -> None:
    path = tmp_path / "night.csv"
    path.write_text(
        "time,A,error\n" + "".join(f"2026-11-28T03:00:00+01:00,{text},\n" for text in ("1e300", "-inf", "2"))
    )
    assert str(read_logs([str(path)]).curves[0].values) == "[nan, nan, 2.0]"


def test_two_programs_do_not_write_one_file(tmp_path: Path) -> None:
    path = tmp_path / "night.csv"
    first = opened(path)
    with refused(PortError, "another program writes to it"):
        opened(path)
    first.close()
    opened(path).close()


@pytest.mark.parametrize(
    "content",
    [
        "my only notes, no newline at end",
        "a,b\n1,2\n3,4 important",
        "\0" * 40_000 + "precious",
        "time,\0\0\0" + "of my life" * 20,
    ],
)
def test_a_file_of_something_else_is_refused_and_stays_as_it_is(tmp_path: Path, content: str) -> None:
    path = tmp_path / "notes.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(EncodeError, match="expected time"):
        opened(path)
    assert path.read_text(encoding="utf-8") == content


@pytest.mark.parametrize("left", ["ti", "time\0\0\0", "\0\0"])
def test_what_a_power_cut_left_of_the_headings_is_completed(tmp_path: Path, left: str) -> None:
    path = tmp_path / "night.csv"
    path.write_text(left, encoding="utf-8")
    opened(path).close()
    assert path.read_text(encoding="utf-8").startswith("time,")
