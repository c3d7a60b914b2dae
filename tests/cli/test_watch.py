"""`barewire watch` and `barewire simulate --fault`: polls at their times, whatever single ones come to."""

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
from pathlib import Path
from typing import Any, cast

import pytest
from barewire.cli.polling import Poll, Source, due, polls

from barewire import ModbusServer
from barewire.cli.plot import check, draw
from barewire.devices import Device, Reading, load
from barewire.devices.raw_address import device_with
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.modbus import ModbusException, Table
from tests.cli.test_command import COMMAND, ENVIRONMENT, barewire, failing, free_port, out, simulated
from tests.helpers import refused

NAMES = ("Position Actual Value", "Status Word")
CSD = load("csd-mt")
BUSY = "exception 06 (server device busy) to function 03; while reading Position Actual Value"


# Deadlines, without a wire


def test_deadlines_do_not_drift_and_missed_ones_are_left_out() -> None:
    number, passed, times = 0, 0.0, []
    for takes in (0.1, 0.1, 1.2, 0.1, 0.5):
        passed = max(passed, number * 0.5)
        times.append(passed)
        passed += takes
        number = due(number, 0.5, passed)
    assert times == [0.0, 0.5, 1.0, 2.5, 3.0]
    assert number == 7


class Unplugged(Source):
    """A port that is gone for a while."""

    def __init__(self, errors: list[Exception | None]) -> None:
        self.errors = errors
        self.device, self.names, self.client = CSD, NAMES[:1], None

    def poll(self, time: float) -> Poll:
        error = self.errors.pop(0)
        return Poll(time, (), str(error)) if error else Poll(time, (Reading(CSD.find(NAMES[0]), 7),))


def test_a_poll_that_failed_is_told_and_polling_goes_on() -> None:
    made = list(polls(Unplugged([None, NoAnswer("silence"), None]), 0.001, 3))
    assert [poll.error for poll in made] == ["", "silence", ""]


# As a person types it


def test_a_name_that_is_refused_takes_no_other_with_it() -> None:
    """The first eight registers are there, number 100 is not; a coil is, in another table."""
    with ModbusServer("tcp://127.0.0.1:0", units={1: Table(8)}) as host:
        watch = ("watch", host.url, "raw", "holding:0", "holding:100", "coil:0", "--count", "3", "--period", "0.05")
        plain = out(*watch).splitlines()
        assert len(plain) == 3
        for line in plain:
            assert "holding:0 = 0; coil:0 = off; holding:100: exception 02 (illegal data address)" in line
        for told in map(json.loads, out(*watch, "--json").splitlines()):
            assert told["values"] == {"holding:0": 0, "coil:0": False}
            assert list(told["refused"]) == ["holding:100"]
        done = barewire(*watch, "--csv")
        assert [row[1:] for row in csv.reader(done.stdout.splitlines()[1:])] == [["0", "", "0"]] * 3
        assert len(done.stderr.splitlines()) == 1
        assert "holding:100: exception 02" in done.stderr
        done = barewire("watch", host.url, "raw", "holding:100", "coil:99", "--count", "2", "--period", "0.05")
        assert done.returncode == 1
        assert all("error: exception 02" in line for line in done.stdout.splitlines())


class Fussy:
    """A machine that refuses some names, alone or with others."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.refuses: set[str] = set()
        self.asked: list[tuple[str, ...]] = []

    def read_all(self, names: Sequence[str]) -> list[Reading]:
        self.asked.append(tuple(names))
        if self.refuses & set(names):
            raise ModbusException(2, 3)
        return [Reading(self.device.find(name), 1) for name in names]

    def read(self, name: str) -> Reading:
        return self.read_all([name])[0]


def test_a_name_that_is_refused_is_apart_from_the_others_no_longer_than_that() -> None:
    names = ("holding:0", "holding:1", "holding:2")
    device = device_with("raw", names)
    source, client = Source.__new__(Source), Fussy(device)
    source.device, source.names, source.apart = device, names, set()
    source.machine = cast(Any, client)
    client.refuses = {"holding:1"}
    poll = source.poll(0.0)
    assert ([one.name for one in poll.readings], list(poll.refused)) == (["holding:0", "holding:2"], ["holding:1"])
    assert client.asked == [names, *((name,) for name in names)]
    client.asked.clear()
    assert source.poll(1.0).refused == poll.refused
    assert client.asked == [("holding:0", "holding:2"), ("holding:1",)]
    client.refuses = set()
    assert source.poll(2.0).refused == {}
    client.asked.clear()
    assert [one.name for one in source.poll(3.0).readings] == list(names)
    assert client.asked == [names]
    client.refuses = set(names)
    assert "exception 02" in source.poll(4.0).error


def test_lines_json_and_csv() -> None:
    with simulated("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        watch = ("watch", endpoint, "csd-mt", *NAMES, "--period", "0.1", "--count", "3")
        plain = out(*watch).splitlines()
        assert len(plain) == 3
        assert re.match(r" +\d+\.\d{3} s  Position Actual Value = 0 step; Status Word = 624 \(voltage", plain[0])
        told = [json.loads(line) for line in out(*watch, "--json").splitlines()]
        assert [poll["values"] for poll in told] == [{"Position Actual Value": 0, "Status Word": 624}] * 3
        assert 0.0 <= told[0]["time"] < told[1]["time"] < told[2]["time"]
        assert told[2]["time"] >= 0.2
        rows = list(csv.reader(out(*watch, "--csv").splitlines()))
    assert rows[0] == ["time", *NAMES]
    assert [row[1:] for row in rows[1:]] == [["0", "624"]] * 3


def test_faults_are_shown_and_polling_goes_on() -> None:
    command = [*COMMAND, "simulate", "csd-mt", "tcp://127.0.0.1:0", "--fault", "exception:0.5", "--seed", "4"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        endpoint = process.stdout.readline().split()[1]
        watch = ("watch", endpoint, "csd-mt", NAMES[0], "--period", "0.02", "--count", "20")
        told = [json.loads(line) for line in out(*watch, "--json").splitlines()]
        done = barewire(*watch, "--csv")
        process.send_signal(signal.SIGTERM)
        struck = process.stdout.read().splitlines()
        assert process.wait(10) == 0
    failed = [poll for poll in told if "error" in poll]
    assert 0 < len(failed) < 20
    assert {poll["error"] for poll in failed} == {BUSY}
    errors = done.stderr.splitlines()
    assert done.returncode == 0
    assert len(done.stdout.splitlines()) + len(errors) == 21
    assert struck == ["fault exception"] * (len(failed) + len(errors))


@pytest.mark.parametrize("wire", ["rtu", "ascii", "can"])
def test_faults_on_the_other_wires(wire: str, tmp_path: Path) -> None:
    url = f"can://socketcand/127.0.0.1:{free_port()}/can0" if wire == "can" else f"{wire}://{tmp_path}/line"
    device, name = ("az3", "STATUS WORD") if wire == "can" else ("adxl", "Status")
    command = [*COMMAND, "simulate", device, url, "--fault", "exception:1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        said = failing("read", process.stdout.readline().split()[1], device, name)
        process.send_signal(signal.SIGTERM)
        assert "fault exception" in process.stdout.read()
    assert ("0800 0000h general error" if wire == "can" else "exception 06") in said


def test_a_device_that_never_answers_is_a_failure() -> None:
    command = [*COMMAND, "simulate", "adxl", "tcp://127.0.0.1:0", "--fault", "drop:1"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        endpoint = f"{process.stdout.readline().split()[1]}?timeout=0.1"
        done = barewire("watch", endpoint, "adxl", "Status", "--period", "0.05", "--count", "2")
        process.send_signal(signal.SIGTERM)
    assert done.returncode == 1
    assert [line.split("  ")[-1][:20] for line in done.stdout.splitlines()] == ["error: unit 1 did no"] * 2


def test_a_table_on_a_terminal_ends_with_ctrl_c() -> None:
    with simulated("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        words = [*COMMAND, "watch", endpoint, "csd-mt", *NAMES, "--period", "0.05"]
        code = "import pty, sys; sys.exit(pty.spawn(sys.argv[1:]) >> 8)"
        with subprocess.Popen(
            [sys.executable, "-c", code, *words],
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
    with simulated("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        out("watch", endpoint, "csd-mt", *NAMES, "--period", "0.05", "--count", "4", "--plot", str(file))
    drawn = file.read_bytes()
    assert drawn.startswith(b"<?xml" if suffix == "svg" else b"\x89PNG")
    assert len(drawn) > 5000


def test_a_plot_is_drawn_however_the_watch_ends(tmp_path: Path) -> None:
    """Ctrl-C before the count is full, or a reader of the output that has had enough: what was watched is not lost."""
    for ended_by in ("Ctrl-C", "a closed pipe"):
        file = tmp_path / f"{ended_by}.svg"
        with simulated("csd-mt", "tcp://127.0.0.1:0") as endpoint:
            words = ["watch", endpoint, "csd-mt", *NAMES, "--period", "0.02", "--count", "100000", "--plot", str(file)]
            with subprocess.Popen([*COMMAND, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
                assert process.stdout is not None
                assert process.stderr is not None
                for _ in range(3):
                    assert process.stdout.readline()
                if ended_by == "Ctrl-C":
                    process.send_signal(signal.SIGINT)
                else:
                    process.stdout.close()
                assert process.stderr.read().strip() == b""
                assert process.wait(30) == (130 if ended_by == "Ctrl-C" else 1)
        assert file.stat().st_size > 5000


def test_nothing_to_draw_is_said(tmp_path: Path) -> None:
    with simulated("adxl", "tcp://127.0.0.1:0") as endpoint:
        where = ("watch", endpoint, "raw", "holding:40000", "--period", "0.05", "--count", "1")
        done = barewire(*where, "--plot", f"{tmp_path}/none.svg")
    assert done.returncode == 1
    assert done.stderr.endswith("none.svg: no value came, nothing is drawn\n")
    assert not (tmp_path / "none.svg").exists()


def test_nothing_to_draw_is_an_empty_plot(tmp_path: Path) -> None:
    draw(str(tmp_path / "empty.svg"), "nothing", [CSD.find(NAMES[0])], [])
    assert (tmp_path / "empty.svg").exists()


def test_what_cannot_be_drawn_is_told_before_anything_is_watched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with refused(EncodeError, "--plot curve.txt: expected a name that ends in .svg, .png, .pdf"):
        check("curve.txt")
    with refused(EncodeError, "there is no such directory"):
        check(f"{tmp_path}/nowhere/curve.svg")
    (tmp_path / "dir.svg").mkdir()
    with refused(EncodeError, "dir.svg: that is a directory"):
        check(f"{tmp_path}/dir.svg")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with refused(PortError, "drawing needs the extra 'plot': pip install 'barewire[plot]'"):
        check(f"{tmp_path}/curve.svg")


def test_what_makes_no_sense() -> None:
    where = ("watch", "tcp://127.0.0.1:1", "csd-mt")
    assert "one of them" in failing(*where, NAMES[0], "--json", "--csv", status=2)
    assert "expected seconds, above 0" in failing(*where, NAMES[0], "--period", "0", status=2)
    assert "did you mean 'Status Word'?" in failing(*where, "Statos Word")
    assert "connection refused" in failing(*where, NAMES[0])
    assert "fault 'late:2': expected a probability" in failing(
        "simulate", "adxl", "tcp://127.0.0.1:0", "--fault", "late:2"
    )
