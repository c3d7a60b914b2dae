"""`barewire watch`, also against `barewire simulate --fault`: times of polls, output formats, failed polls, plots."""

from __future__ import annotations

import csv
import errno
import json
import math
import os
import re
import signal
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from barewire import ModbusServer
from barewire.devices.sim import simulator
from barewire.errors import EncodeError, PortError
from barewire.modbus import Table
from barewire_workbench.cli.plot import check_plot_file, draw_plot
from barewire_workbench.cli.watch import seconds_until
from barewire_workbench.live.disk import DiskFile, LocalDisk
from barewire_workbench.value_log.csv_file import CsvFile
from barewire_workbench.value_log.reader import Curve, broken
from barewire_workbench.value_log.sqlite_file import SqliteFile
from tests.helpers import free_port, refused, some_of
from tests.workbench.cli.helpers import (
    COMMAND,
    ENVIRONMENT,
    error_of,
    output_of,
    run_here,
    simulated_at,
)

NAMES = ("Position Actual Value", "Status Word")
BUSY = "unit 1, address 1004: exception 06 (server device busy) to function 03; while reading Position Actual Value"


# The command


def test_the_other_names_are_read_if_one_is_refused() -> None:
    """The table has registers and coils 0 to 7, and no others."""
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table(8)}) as server:
        watch = ("watch", server.url, "raw", "holding:0", "holding:100", "coil:0", "--count", "3", "--period", "0.05")
        plain = output_of(*watch).splitlines()
        assert len(plain) == 3
        for line in plain:
            assert (
                "holding:0 = 0; coil:0 = off; holding:100: unit 1, address 100: exception 02 (illegal data address)"
                in line
            )
        for row in map(json.loads, output_of(*watch, "--json").splitlines()):
            assert row["values"] == {"holding:0": 0, "coil:0": False}
            assert row["error"].startswith("holding:100: unit 1, address 100: exception 02")
        table = list(csv.reader(output_of(*watch, "--csv").splitlines()[1:]))
        assert [row[1:4] for row in table] == [["0", "", "0"]] * 3
        assert all("holding:100: unit 1, address 100: exception 02" in row[4] for row in table)
        done = run_here("watch", server.url, "raw", "holding:100", "coil:99", "--count", "2", "--period", "0.05")
        assert done.returncode == 1
        assert all("error: unit 1, address " in line and ": exception 02 " in line for line in done.stdout.splitlines())


def test_lines_json_and_csv() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        watch, before = ("watch", endpoint, "csd-mt", *NAMES, "--period", "0.1", "--count", "3"), datetime.now(UTC)
        plain = output_of(*watch).splitlines()
        assert len(plain) == 3
        assert re.match(r" +\d+\.\d{3} s  Position Actual Value = 0 step; Status Word = 624 \(voltage", plain[0])
        rows = [json.loads(line) for line in output_of(*watch, "--json").splitlines()]
        assert [row["values"] for row in rows] == [{"Position Actual Value": 0, "Status Word": 624}] * 3
        assert 0.0 <= rows[0]["seconds"] < rows[1]["seconds"] < rows[2]["seconds"]
        assert rows[2]["seconds"] >= 0.2
        table = list(csv.reader(output_of(*watch, "--csv").splitlines()))
        after = datetime.now(UTC)
    assert table[0] == ["time", "Position Actual Value [step]", "Status Word", "error"]
    assert [row[1:] for row in table[1:]] == [["0", "624", ""]] * 3
    times = [row["time"] for row in rows] + [row[0] for row in table[1:]]
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}[+-]\d\d:\d\d", text) for text in times)
    dates = [datetime.fromisoformat(text) for text in times]
    assert dates == sorted(dates)
    assert before - timedelta(seconds=0.001) <= dates[0] <= dates[-1] <= after


def test_names_with_a_star() -> None:
    with simulated_at("adxl", "tcp://127.0.0.1:0") as endpoint:
        watch = ("watch", endpoint, "adxl", "*event*", "motor hour meter", "--count", "1", "--csv")
        done = run_here(*watch)
        assert "left out, each is read by its name: 'Event description'" in done.stderr
        headings = next(csv.reader(done.stdout.splitlines()))
        assert "Motor hour meter [h]" in headings
        assert len(headings) > 3
        assert "Event description" not in headings
        refusal = error_of("watch", endpoint, "adxl", "Evnt *", "--count", "1", status=2)
        assert "no readable parameter of adxl has a name like 'Evnt *'" in refusal


def test_failed_polls_are_shown_and_polling_continues() -> None:
    command = [*COMMAND, "simulate", "csd-mt", "tcp://127.0.0.1:0", "--fault", "exception:0.5", "--seed", "4"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        endpoint = process.stdout.readline().split()[1]
        watch = ("watch", endpoint, "csd-mt", NAMES[0], "--period", "0.02", "--count", "20", "--no-check")
        rows = [json.loads(line) for line in output_of(*watch, "--json").splitlines()]
        done = run_here(*watch, "--csv")
        process.send_signal(signal.SIGTERM)
        faults = process.stdout.read().splitlines()
        assert process.wait(60) == 0
    failed = [row for row in rows if "error" in row]
    assert 0 < len(failed) < 20
    assert {row["error"] for row in failed} == {BUSY}
    table = list(csv.reader(done.stdout.splitlines()))
    errors = [row for row in table[1:] if row[-1] == BUSY]
    assert (done.returncode, done.stderr, len(table)) == (0, "", 21)
    assert faults == ["fault exception"] * (len(failed) + len(errors))


@pytest.mark.parametrize("wire", ["rtu", "ascii", "can"])
def test_faults_on_the_other_wires(wire: str, tmp_path: Path) -> None:
    url = f"can://socketcand/127.0.0.1:{free_port()}/can0" if wire == "can" else f"{wire}://{tmp_path}/line"
    device, name = ("az3", "STATUS WORD") if wire == "can" else ("adxl", "Status")
    command = [*COMMAND, "simulate", device, url, "--fault", "exception:1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        error = error_of("read", process.stdout.readline().split()[1], device, name)
        process.send_signal(signal.SIGTERM)
        assert "fault exception" in process.stdout.read()
    assert ("0800 0000h general error" if wire == "can" else "exception 06") in error


def test_status_1_if_no_poll_succeeds() -> None:
    command = [*COMMAND, "simulate", "adxl", "tcp://127.0.0.1:0", "--fault", "drop:1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        endpoint = f"{process.stdout.readline().split()[1]}?timeout=0.1"
        done = run_here("watch", endpoint, "adxl", "Status", "--period", "0.05", "--count", "2")
        process.send_signal(signal.SIGTERM)
    assert done.returncode == 1
    assert [line.split("  ")[-1][:20] for line in done.stdout.splitlines()] == ["error: unit 1 did no"] * 2


def test_a_table_on_a_terminal_ends_with_ctrl_c() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        command = [*COMMAND, "watch", endpoint, "csd-mt", *NAMES, "--period", "0.05"]
        code = "import pty, sys; sys.exit(pty.spawn(sys.argv[1:]) >> 8)"
        with subprocess.Popen(
            [sys.executable, "-c", code, *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=ENVIRONMENT | {"TERM": "xterm", "COLUMNS": "120", "LINES": "30"},
        ) as process:
            assert process.stdout is not None
            assert process.stdin is not None
            shown, give_up = "", time.monotonic() + 120
            while "12 polls" not in shown and time.monotonic() < give_up:
                shown += os.read(process.stdout.fileno(), 4096).decode(errors="replace")
            process.stdin.write(b"\x03")
            process.stdin.close()
            process.stdout.read()
            assert process.wait(60) == 0
    assert "Position Actual Value" in shown
    assert "greatest" in shown


@pytest.mark.parametrize("suffix", ["svg", "png"])
def test_a_plot(suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"watched.{suffix}"
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        output_of("watch", endpoint, "csd-mt", *NAMES, "--period", "0.05", "--count", "4", "--plot", str(file))
    drawn = file.read_bytes()
    assert drawn.startswith(b"<?xml" if suffix == "svg" else b"\x89PNG")
    assert len(drawn) > 5000


@pytest.mark.parametrize("ended_by", some_of(["Ctrl-C", "a closed pipe", "SIGTERM"], 1))
def test_a_plot_is_drawn_after_ctrl_c_sigterm_and_a_closed_pipe(ended_by: str, tmp_path: Path) -> None:
    """The values read so far are drawn."""
    status = {"Ctrl-C": 130, "a closed pipe": 1, "SIGTERM": 143}[ended_by]
    file = tmp_path / f"{ended_by}.svg"
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        command = [
            "watch",
            endpoint,
            "csd-mt",
            *NAMES,
            "--period",
            "0.02",
            "--count",
            "100000",
            "--plot",
            str(file),
        ]
        with subprocess.Popen([*COMMAND, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            for _ in range(3):
                assert process.stdout.readline()
            if ended_by == "Ctrl-C":
                process.send_signal(signal.SIGINT)
            elif ended_by == "SIGTERM":
                process.terminate()
            else:
                process.stdout.close()
            assert process.stderr.read().strip() == b""
            assert process.wait(60) == status
    assert file.stat().st_size > 5000


def test_without_a_value_no_plot_is_drawn(tmp_path: Path) -> None:
    with simulated_at("adxl", "tcp://127.0.0.1:0") as endpoint:
        command = ("watch", endpoint, "raw", "holding:40000", "--period", "0.05", "--count", "1")
        done = run_here(*command, "--plot", f"{tmp_path}/none.svg")
    assert done.returncode == 1
    assert done.stderr.endswith("none.svg: no value was read, nothing is drawn\n")
    assert not (tmp_path / "none.svg").exists()


def test_a_plot_without_samples_is_empty(tmp_path: Path) -> None:
    draw_plot("nothing", str(tmp_path / "empty.svg"), [Curve("Speed", "rpm", [], [])])
    assert (tmp_path / "empty.svg").exists()


def test_a_plot_that_cannot_be_written_is_refused_before_the_first_poll(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with refused(EncodeError, "--plot curve.txt: expected a name that ends in .svg, .png, .pdf"):
        check_plot_file("--plot", "curve.txt")
    with refused(PortError, "the directory does not exist"):
        check_plot_file("--plot", f"{tmp_path}/nowhere/curve.svg")
    (tmp_path / "dir.svg").mkdir()
    with refused(EncodeError, "dir.svg: expected a file, not a directory"):
        check_plot_file("--plot", f"{tmp_path}/dir.svg")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with refused(PortError, "drawing needs the extra 'plot': pip install 'barewire[plot]'"):
        check_plot_file("--plot", f"{tmp_path}/curve.svg")


def test_names_and_units_are_drawn_as_they_are(tmp_path: Path) -> None:
    """matplotlib has a language for formulas between two $, hides what begins with _, and XML has no control
    characters."""
    log = tmp_path / "night.csv"
    log.write_text(
        "time,$\\frac{ [$x_$],_hidden [V],a\x1bb -- c [V],速度 [V],error\n2026-11-28T03:00:00+01:00,1,2,3,4,\n"
    )
    drawn = run_here("plot", str(log))
    assert drawn.stderr == f"barewire: {tmp_path}/night.svg: 1 rows\n"
    picture = (tmp_path / "night.svg").read_text(encoding="utf-8")
    assert ElementTree.fromstring(picture) is not None
    for text in ("$\\frac{", "$x_$", "_hidden", "a?b", "速度"):
        assert f"{text} " in picture


def test_the_panel_of_many_curves_is_as_high_as_their_names_and_too_many_are_refused(tmp_path: Path) -> None:
    log = tmp_path / "night.csv"
    for count, error in ((60, "60 rows"), (101, "101 curves: expected at most 100: --name chooses some")):
        names = ",".join(f"value {number} [V]" for number in range(count))
        log.write_text(f"time,{names},error\n" + f"2026-11-28T03:00:00+01:00{',1' * count},\n" * 60)
        drawn = run_here("plot", str(log), "--to", str(tmp_path / "night.png"))
        assert drawn.stderr.count("\n") == 1
        assert error in drawn.stderr
    assert error in error_of("watch", "tcp://127.0.0.1:1", "raw", "holding:0-100", "--plot", "x.svg", status=2)


def test_a_plot_does_not_take_the_place_of_its_log_and_lines_that_are_no_rows_are_counted(tmp_path: Path) -> None:
    log = tmp_path / "night.svg"
    log.write_text("time,A [V],error\n2026-11-28T03:00:00+01:00,1,\n2026-11-28T03:0\n")
    assert "night.svg is the same file, which would be overwritten" in error_of("plot", str(log), status=2)
    drawn = run_here("plot", str(log), "--to", str(tmp_path / "night.png"))
    assert drawn.stderr == f"barewire: {tmp_path}/night.png: 1 rows, 1 left out that are damaged\n"
    assert "/dev/zero: a device, not a file" in error_of("plot", "/dev/zero", "--to", str(tmp_path / "zero.svg"))


# Logs


def rows_of(path: Path) -> list[list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def test_a_log_of_two_machines_is_appended_to_and_drawn(tmp_path: Path) -> None:
    path = tmp_path / "night.csv"
    units: dict[int, Any] = {1: simulator("csd-mt").modbus, 2: simulator("adxl").modbus}
    with ModbusServer("tcp://127.0.0.1:0", units) as server:
        first_machine = ("watch", f"{server.url}?unit=1", "csd-mt", "Current Ratio")
        both = (*first_machine, "--and", f"{server.url}?unit=2", "adxl", "Status")
        watch = (*both, "--period", "10ms", "--count", "3", "--to", str(path))
        first = run_here(*watch)
        assert (first.returncode, first.stdout, first.stderr) == (0, "", f"barewire: {path}: 3 rows written\n")
        assert f"--to {path}: the file exists: --append adds to it" in error_of(*watch, status=2)
        path.write_bytes(path.read_bytes()[:-5])  # half a line, after a power cut
        again = run_here(*watch, "--append", "--json")
        assert "bytes of a line that was not finished are cut off" in again.stderr
    heading, *rows = rows_of(path)
    assert heading == ["time", "csd-mt: Current Ratio [%]", "adxl: Status", "error"]
    assert [row[1:] for row in rows] == [["70", "2", ""]] * 5
    shown = [json.loads(line) for line in again.stdout.splitlines()]
    assert [row["time"] for row in shown] == [row[0] for row in rows[2:]]
    drawn = run_here("plot", str(path))
    assert (drawn.returncode, drawn.stderr) == (0, f"barewire: {path.with_suffix('.svg')}: 5 rows\n")
    assert path.with_suffix(".svg").stat().st_size > 5000
    assert "no column 'Speed': expected one of csd-mt: Current Ratio, adxl: Status" in error_of(
        "plot", str(path), "--name", "Speed", status=2
    )


@pytest.mark.parametrize(
    ("options", "drawn"), [((), [1.0, 2.0, math.nan, 4.0, math.nan, 5.0, 6.0]), (("--connect",), None)]
)
def test_a_curve_is_broken_where_rows_or_values_are_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], drawn: list[float] | None
) -> None:
    """Row 3 has an error in place of a value; between 4 and 5 are 4 s."""
    log = tmp_path / "night.csv"
    curves: list[Curve] = []
    cells = [("00", 1), ("01", 2), ("02", ""), ("03", 4), ("07", 5), ("08", 6)]
    rows = [f"2026-11-28T03:00:{second}.000+01:00,{value},{'' if value else 'no answer'}" for second, value in cells]
    log.write_text("\n".join(["time,Speed [rpm],error", *rows, ""]))
    monkeypatch.setattr("barewire_workbench.cli.plot.draw_plot", lambda name, file, given: curves.extend(given))
    assert run_here("plot", str(log), *options).returncode == 0
    expected = drawn or [1.0, 2.0, math.nan, 4.0, 5.0, 6.0]
    assert str(curves[0].values) == str(expected)
    assert len(curves[0].times) == len(expected)


def test_a_log_with_another_period_later_is_not_broken() -> None:
    begin = datetime(2026, 11, 28)
    seconds = [*range(50), *range(52, 152, 2)]
    curve = Curve("Speed", "rpm", [begin + timedelta(seconds=second) for second in seconds], [1.0] * len(seconds))
    assert broken(curve) == curve


def test_a_machine_that_cannot_be_reached_has_rows_that_say_so(tmp_path: Path) -> None:
    path, port = tmp_path / "night.csv", free_port()
    with ModbusServer("tcp://127.0.0.1:0", {1: Table(1)}) as server:
        run_here(
            *("watch", server.url, "raw", "holding:0", "--and", f"tcp://127.0.0.1:{port}", "raw", "holding:1"),
            *("--to", str(path), "--count", "2", "--period", "0.3"),
        )
    assert [row[1:] for row in rows_of(path)[1:]] == [
        ["0", "", f"raw at tcp://127.0.0.1:{port}: 127.0.0.1:{port}: connection refused"]
    ] * 2


def test_another_machine_than_named_is_an_error_of_the_command(tmp_path: Path) -> None:
    units: dict[int, Any] = {1: simulator("adxl").modbus}
    with ModbusServer("tcp://127.0.0.1:0", units) as server:
        watch = ("watch", server.url, "csd-mt", "Current Ratio", "--count", "1")
        assert "(adxl: LOVATO" in error_of(*watch)
        done = run_here(*watch, "--to", str(tmp_path / "night.csv"))
    assert done.returncode == 1
    assert "unit 1 is not csd-mt" in done.stderr


def test_rows_are_chosen_by_conditions_and_changes(tmp_path: Path) -> None:
    with ModbusServer("tcp://127.0.0.1:0", {1: Table(4)}) as server:
        watch = ("watch", server.url, "raw", "holding:0", "--count", "3", "--period", "10ms", "--csv")
        assert len(output_of(*watch, "--change", "0").splitlines()) == 2
        assert len(output_of(*watch, "--every", "2").splitlines()) == 3
        assert output_of(*watch, "--when", "holding:1.3 == 1") == "time,holding:0,holding:1,error\n"
        output_of("write", server.url, "raw", "holding:1=8")
        assert len(output_of(*watch, "--when", "holding:1.3 == 1").splitlines()) == 4


@pytest.mark.parametrize("end", ["night.csv", "night.db"])
def test_a_full_disk_is_reported(tmp_path: Path, end: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, is_last: bool = False) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    with ModbusServer("tcp://127.0.0.1:0", {1: Table(1)}) as server:
        watch = ("watch", server.url, "raw", "holding:0", "--period", "10ms", "--to", str(tmp_path / end))
        output_of(*watch, "--count", "1")
        monkeypatch.setattr(DiskFile, "append", full)
        monkeypatch.setattr(SqliteFile, "add", full)
        done = run_here(*watch, "--append", "--count", "2")
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        f"barewire: {tmp_path / end}: no space left on device: rows wait",
        f"barewire: {tmp_path / end}: 0 rows written",
        f"barewire: {tmp_path / end}: 2 rows could not be written: no space left on device",
    ]


@pytest.mark.parametrize(
    ("end", "sent"),
    [
        ("csv", signal.SIGKILL),
        ("db", signal.SIGTERM),
        pytest.param("csv", signal.SIGTERM, marks=pytest.mark.proof),
        pytest.param("csv", signal.SIGHUP, marks=pytest.mark.proof),
        pytest.param("db", signal.SIGKILL, marks=pytest.mark.proof),
        pytest.param("db", signal.SIGHUP, marks=pytest.mark.proof),
    ],
)
def test_what_was_shown_is_in_the_file_however_the_command_ends(tmp_path: Path, end: str, sent: signal.Signals) -> None:
    """Killed a few times while it writes, a row was in the file before it was shown, and each is there once."""
    path, shown = tmp_path / f"night.{end}", []
    with ModbusServer("tcp://127.0.0.1:0", {1: Table(1)}) as server:
        watch = ("watch", server.url, "raw", "holding:0", "--period", "2ms", "--json", "--to", str(path), "--append")
        for lines in (1, 7, 30):
            with subprocess.Popen(
                [*COMMAND, *watch], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT
            ) as process:
                assert process.stdout is not None
                shown += [process.stdout.readline() for _ in range(lines)]
                process.send_signal(sent)
                shown += process.stdout.readlines()
                assert process.wait(60) == (-9 if sent == signal.SIGKILL else 128 + sent)
    # The last line of a killed process may be half.
    times = [json.loads(line)["time"] for line in shown if line.endswith("\n")]
    if end == "csv":
        CsvFile(LocalDisk(), str(path), ["time", "holding:0", "error"]).close()
        written = [row[0] for row in rows_of(path)[1:]]
    else:
        with closing(sqlite3.connect(path)) as database, database:
            written = [row[0] for row in database.execute("SELECT time FROM samples")]
    assert len(times) >= 38
    assert not Counter(times) - Counter(written)
    assert len(written) - len(times) <= 3 * 2


def test_a_clock_time_ends_the_command() -> None:
    with ModbusServer("tcp://127.0.0.1:0", {1: Table(1)}) as server:
        watch = ("watch", server.url, "raw", "holding:0", "--period", "50ms", "--csv")
        end = datetime.now().astimezone() + timedelta(seconds=1)
        assert 1 < len(output_of(*watch, "--until", end.isoformat()).splitlines()) < 25
        assert 1 < len(output_of(*watch, "--for", "140ms").splitlines()) <= 4  # a busy computer leaves out polls
        assert "that is over, now it is" in error_of(*watch, "--until", "2020-01-01", status=2)
        assert "expected a time such as 06:00" in error_of(*watch, "--until", "25:00", status=2)


@pytest.mark.skipif(not hasattr(time, "tzset"), reason="Windows has no TZ")
@pytest.mark.parametrize(("day", "hours"), [("2026-10-24", 9), ("2026-03-28", 7), ("2026-06-01", 8)])
def test_a_clock_time_behind_the_change_of_summer_time(monkeypatch: pytest.MonkeyPatch, day: str, hours: int) -> None:
    """In the night of October 24 the clocks are set back, in that of March 28 they are set forward."""
    with monkeypatch.context() as patched:
        patched.setenv("TZ", "CET-1CEST,M3.5.0,M10.5.0/3")
        time.tzset()
        seconds = seconds_until("06:00", datetime.fromisoformat(f"{day}T22:00"))
    time.tzset()
    assert seconds == hours * 3600


def test_wrong_options_are_refused() -> None:
    command = ("watch", "tcp://127.0.0.1:1", "csd-mt")
    assert "expected only one of them" in error_of(*command, NAMES[0], "--json", "--csv", status=2)
    assert "expected seconds, above 0" in error_of(*command, NAMES[0], "--period", "0", status=2)
    assert "did you mean 'Status Word'?" in error_of(*command, "Statos Word", status=2)
    assert "connection refused" in error_of(*command, NAMES[0])
    assert "expected ENDPOINT DEVICE NAME..." in error_of(*command, NAMES[0], "--and", "tcp://127.0.0.1", status=2)
    assert "expected a name that ends in .csv" in error_of(*command, NAMES[0], "--to", "night.xls", status=2)
    assert "are for the file of --to FILE" in error_of(*command, NAMES[0], "--append", status=2)
    assert "--at-least is for rows that --change" in error_of(*command, NAMES[0], "--at-least", "1h", status=2)
    assert "> out.csv, or barewire watch ... --to out.csv" in error_of(*command, "out.csv", "--csv", status=2)
    assert "> out.csv, or" in error_of("read", *command[1:], NAMES[0], "--csv", "out.csv", status=2)
    assert "fault 'late:2': expected a probability" in error_of(
        "simulate", "adxl", "tcp://127.0.0.1:0", "--fault", "late:2", status=2
    )
