"""What people type wrongly, and what goes wrong on a bench: one clear line each time, and no success that is none."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path

import pytest

from tests.cli.test_command import COMMAND, barewire, failing, out, simulated


def test_a_device_without_parameters(tmp_path: Path) -> None:
    (tmp_path / "device.toml").write_text('name = "bare"\ntitle = "Bare"\n')
    assert out("devices", str(tmp_path)) == "Bare: 0 parameters\n"
    assert "bare has no Modbus: no table [modbus]" in failing("simulate", str(tmp_path), "tcp://127.0.0.1:0")


@pytest.mark.parametrize("late", ["nan", "-1", "inf"])
def test_a_fault_that_is_late_by_no_number_of_seconds(late: str) -> None:
    said = failing("simulate", "adxl", "tcp://127.0.0.1:0", "--fault", "late", f"--late={late}")
    assert said.endswith(f"late = {late}: expected seconds, from 0 on and below 3600\n")


def test_a_refusal_says_whose_value_it_was() -> None:
    with simulated("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        said = failing("write", endpoint, "csd-mt", "Profile Velocity=5", "Current Ratio=121", "--force")
        assert said.endswith("to function 06; while writing Current Ratio; written before that: Profile Velocity\n")
        assert "expected 28524\n" in failing("write", endpoint, "csd-mt", "Restore All Default Parameters=0")
        assert out("write", endpoint, "csd-mt", "Current Ratio=070").startswith("Current Ratio = 70 %, written")


def test_a_command_without_an_answer_is_not_called_written() -> None:
    with simulated("adxl", "tcp://127.0.0.1:0", asking="timeout=1") as endpoint:
        assert out("write", endpoint, "adxl", "Save and reboot=5").startswith(
            "Save and reboot = 5 (execute), sent: the device does not answer it"
        )


def test_a_machine_that_was_turned_round() -> None:
    with simulated("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        out("write", endpoint, "csd-mt", "Little Endian / Big Endian=0")
        out("write", endpoint, "csd-mt?order=ABCD", "Profile Velocity=70000")
        assert out("read", endpoint, "csd-mt?order=ABCD", "Profile Velocity") == "Profile Velocity = 70000 step/s\n"
        assert "position 300" in out("drive", endpoint, "csd-mt?order=ABCD", "move", "300")
    assert "expected ?order= and one of ABCD" in failing("devices", "csd-mt?order=X")
    assert "the order is the machine's own" in failing("simulate", "csd-mt?order=ABCD", "tcp://127.0.0.1:0")


def test_a_line_that_breaks_while_the_motor_turns() -> None:
    command = [*COMMAND, "simulate", "csd-mt", "tcp://127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as machine:
        assert machine.stdout is not None
        endpoint = machine.stdout.readline().split()[1]
        moving = [*COMMAND, "drive", endpoint, "csd-mt", "move", "100000000", "--json"]
        with subprocess.Popen(moving, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            for line in process.stdout:
                if '"waiting_for": "target reached"' in line:
                    break
            machine.send_signal(signal.SIGTERM)
            process.stdout.read()
            said = process.stderr.read()
            assert process.wait(30) == 1
    assert said.count("\n") == 1
    assert said.endswith("; move: the motor may still be turning\n")


def test_a_homing_that_cannot_begin() -> None:
    with simulated("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        assert "home: Homing Method 0 is no method: expected one of -2, -1, 3" in failing(
            "drive", endpoint, "csd-mt", "home"
        )
        done = barewire("drive", endpoint, "csd-mt", "enable", "--timeout", "nan")
        assert done.stderr == "barewire: timeout = nan: expected seconds, above 0\n"
