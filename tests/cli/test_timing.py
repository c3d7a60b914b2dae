"""`--timing`: what the settings of a line mean, in milliseconds, on stderr; what is read stays alone on stdout."""

from __future__ import annotations

import pytest

from tests.cli.test_command import barewire, simulated


@pytest.mark.parametrize("where", [["--timing"], []])
def test_the_numbers_of_a_line_are_told_when_asked_for(where: list[str]) -> None:
    with simulated("adxl", "rtu://pty?baudrate=19200") as url:
        done = barewire("read", *where, f"{url}&latency=uart", "adxl", "Status")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Status")
    told = "speaks after 2.01 ms of silence (t3.5), forgives pauses of 5 ms inside a frame\n"
    assert done.stderr == (f"barewire: {url}&latency=uart {told}" if where else "")


def test_they_are_told_before_the_port_is_opened() -> None:
    done = barewire("write", "rtu:///dev/nothing?latency=tunnel&baudrate=9600", "az3", "CONTROL WORD=6", "--timing")
    assert done.returncode == 1
    first, second = done.stderr.splitlines()
    assert first.endswith("speaks after 4.01 ms of silence (t3.5), forgives pauses of 200 ms inside a frame")
    assert second == "barewire: /dev/nothing: no such file or directory"


def test_a_bus_has_none() -> None:
    done = barewire("read", "--timing", "can://virtual/x", "az3", "STATUS WORD")
    assert done.returncode == 1
    assert "Modbus goes over tcp://" in done.stderr
