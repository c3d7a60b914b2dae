"""`barewire watch`, also against `barewire simulate --fault`: times of polls, output formats, failed polls, plots."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from barewire import ModbusServer
from barewire.devices import Reading, load
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.modbus import ModbusException, Table
from barewire_workbench.cli.plot import check_plot_file, draw_plot
from barewire_workbench.cli.raw_address import device_with
from barewire_workbench.cli.watch import Poller, next_poll, polls
from tests.helpers import free_port, refused
from tests.workbench.cli.helpers import (
    COMMAND,
    ENVIRONMENT,
    error_of,
    output_of,
    run_command,
    run_here,
    simulated_at,
)

NAMES = ("Position Actual Value", "Status Word")
CSD = load("csd-mt")
BUSY = "unit 1, address 1004: exception 06 (server device busy) to function 03; while reading Position Actual Value"


# Deadlines, without a wire


def test_deadlines_do_not_drift_and_missed_ones_are_left_out() -> None:
    number, passed, times = 0, 0.0, []
    for takes in (0.1, 0.1, 1.2, 0.1, 0.5):
        passed = max(passed, number * 0.5)
        times.append(passed)
        passed += takes
        number = next_poll(number, 0.5, passed)
    assert times == [0.0, 0.5, 1.0, 2.5, 3.0]
    assert number == 7


class FakeMachine:
    """A machine that refuses some names, alone or with others, and raises the given errors first."""

    def __init__(self, errors: Sequence[Exception | None] = ()) -> None:
        self.errors = list(errors)
        self.refuses: set[str] = set()
        self.requests: list[tuple[str, ...]] = []
        self.connected = 0

    def connect(self) -> FakeMachine:
        self.connected += 1
        return self

    def close(self) -> None:
        pass

    def read_all(self, names: Sequence[str]) -> list[Reading]:
        self.requests.append(tuple(names))
        if self.errors and (error := self.errors.pop(0)) is not None:
            raise error
        if self.refuses & set(names):
            raise ModbusException(2, 3)
        device = device_with("raw", names)
        return [Reading(device.find(name), 1) for name in names]

    def read(self, name: str) -> Reading:
        return self.read_all([name])[0]


def test_polling_continues_after_a_failed_poll() -> None:
    machine, names = FakeMachine([None, NoAnswer("silence"), PortError("unplugged"), None]), ("holding:0",)
    made = list(polls(Poller(machine.connect, device_with("raw", names), names), 0.001, 4))
    assert [poll.error for poll in made] == ["", "silence", "unplugged", ""]
    assert machine.connected == 2  # again after the port failed


def test_a_request_that_cannot_be_encoded_ends_polling() -> None:
    machine, names = FakeMachine([EncodeError("no such type")]), ("holding:0",)
    with refused(EncodeError, "no such type"):
        next(polls(Poller(machine.connect, device_with("raw", names), names), 0.001, 1))


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
            assert list(row["refused"]) == ["holding:100"]
        done = run_command(*watch, "--csv")
        assert [row[2:] for row in csv.reader(done.stdout.splitlines()[1:])] == [["0", "", "0"]] * 3
        assert len(done.stderr.splitlines()) == 1
        assert "holding:100: unit 1, address 100: exception 02" in done.stderr
        done = run_command("watch", server.url, "raw", "holding:100", "coil:99", "--count", "2", "--period", "0.05")
        assert done.returncode == 1
        assert all("error: unit 1, address " in line and ": exception 02 " in line for line in done.stdout.splitlines())


def test_a_refused_name_is_read_alone_as_long_as_it_is_refused() -> None:
    names = ("holding:0", "holding:1", "holding:2")
    machine = FakeMachine()
    poller = Poller(machine.connect, device_with("raw", names), names)
    machine.refuses = {"holding:1"}
    poll = poller.poll(0.0)
    assert ([reading.name for reading in poll.readings], list(poll.refused)) == (
        ["holding:0", "holding:2"],
        ["holding:1"],
    )
    assert machine.requests == [names, *((name,) for name in names)]
    machine.requests.clear()
    assert poller.poll(1.0).refused == poll.refused
    assert machine.requests == [("holding:0", "holding:2"), ("holding:1",)]
    machine.refuses = set()
    assert poller.poll(2.0).refused == {}
    machine.requests.clear()
    assert [reading.name for reading in poller.poll(3.0).readings] == list(names)
    assert machine.requests == [names]
    machine.refuses = set(names)
    assert "exception 02" in poller.poll(4.0).error


def test_lines_json_and_csv() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        watch, before = ("watch", endpoint, "csd-mt", *NAMES, "--period", "0.1", "--count", "3"), datetime.now(UTC)
        plain = output_of(*watch).splitlines()
        assert len(plain) == 3
        assert re.match(r" +\d+\.\d{3} s  Position Actual Value = 0 step; Status Word = 624 \(voltage", plain[0])
        rows = [json.loads(line) for line in output_of(*watch, "--json").splitlines()]
        assert [row["values"] for row in rows] == [{"Position Actual Value": 0, "Status Word": 624}] * 3
        assert 0.0 <= rows[0]["time"] < rows[1]["time"] < rows[2]["time"]
        assert rows[2]["time"] >= 0.2
        table = list(csv.reader(output_of(*watch, "--csv").splitlines()))
        after = datetime.now(UTC)
    assert table[0] == ["time", "utc", *NAMES]
    assert [row[2:] for row in table[1:]] == [["0", "624"]] * 3
    for row, seconds in ((rows[0]["utc"], rows[0]["time"]), *((row[1], float(row[0])) for row in table[1:])):
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", row)
        assert before <= datetime.fromisoformat(row) + timedelta(seconds=0.001) <= after + timedelta(seconds=seconds)
    utc = [datetime.fromisoformat(row[1]) for row in table[1:]]
    assert utc == sorted(utc)


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
        assert process.wait(10) == 0
    failed = [row for row in rows if "error" in row]
    assert 0 < len(failed) < 20
    assert {row["error"] for row in failed} == {BUSY}
    errors = done.stderr.splitlines()
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) + len(errors) == 21
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
        done = run_command("watch", endpoint, "adxl", "Status", "--period", "0.05", "--count", "2")
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
            shown, give_up = "", time.monotonic() + 20
            while "12 polls" not in shown and time.monotonic() < give_up:
                shown += os.read(process.stdout.fileno(), 4096).decode(errors="replace")
            process.stdin.write(b"\x03")
            process.stdin.close()
            process.stdout.read()
            assert process.wait(10) == 0
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


def test_a_plot_is_drawn_after_ctrl_c_sigterm_and_a_closed_pipe(tmp_path: Path) -> None:
    """The values read so far are drawn."""
    for ended_by, status in {"Ctrl-C": 130, "a closed pipe": 1, "SIGTERM": 143}.items():
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
                assert process.wait(30) == status
        assert file.stat().st_size > 5000


def test_without_a_value_no_plot_is_drawn(tmp_path: Path) -> None:
    with simulated_at("adxl", "tcp://127.0.0.1:0") as endpoint:
        command = ("watch", endpoint, "raw", "holding:40000", "--period", "0.05", "--count", "1")
        done = run_command(*command, "--plot", f"{tmp_path}/none.svg")
    assert done.returncode == 1
    assert done.stderr.endswith("none.svg: no value was read, nothing is drawn\n")
    assert not (tmp_path / "none.svg").exists()


def test_a_plot_without_samples_is_empty(tmp_path: Path) -> None:
    draw_plot(str(tmp_path / "empty.svg"), "nothing", [CSD.find(NAMES[0])], [])
    assert (tmp_path / "empty.svg").exists()


def test_a_plot_that_cannot_be_written_is_refused_before_the_first_poll(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with refused(EncodeError, "--plot curve.txt: expected a name that ends in .svg, .png, .pdf"):
        check_plot_file("curve.txt")
    with refused(PortError, "the directory does not exist"):
        check_plot_file(f"{tmp_path}/nowhere/curve.svg")
    (tmp_path / "dir.svg").mkdir()
    with refused(EncodeError, "dir.svg: expected a file, not a directory"):
        check_plot_file(f"{tmp_path}/dir.svg")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with refused(PortError, "drawing needs the extra 'plot': pip install 'barewire[plot]'"):
        check_plot_file(f"{tmp_path}/curve.svg")


def test_wrong_options_are_refused() -> None:
    command = ("watch", "tcp://127.0.0.1:1", "csd-mt")
    assert "expected only one of them" in error_of(*command, NAMES[0], "--json", "--csv", status=2)
    assert "expected seconds, above 0" in error_of(*command, NAMES[0], "--period", "0", status=2)
    assert "did you mean 'Status Word'?" in error_of(*command, "Statos Word", status=2)
    assert "connection refused" in error_of(*command, NAMES[0])
    assert "fault 'late:2': expected a probability" in error_of(
        "simulate", "adxl", "tcp://127.0.0.1:0", "--fault", "late:2", status=2
    )
