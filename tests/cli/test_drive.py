"""`barewire drive` and `client.drive`: one command over the three wires of two drives, as a person types it."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from barewire import ModbusServer, connect
from barewire.devices.drive.cia402 import State
from barewire.devices.drive.report import DriveProgress
from barewire.devices.sim import CsdMt, simulator
from tests.cli.test_command import COMMAND, failing, free_port, out, simulated


@pytest.fixture(params=["csd-mt over tcp", "az3 over rtu", "az3 over can"])
def wired(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[str, str]]:
    device, _, wire = request.param.partition(" over ")
    urls = {
        "tcp": "tcp://127.0.0.1:0",
        "rtu": f"rtu://{tmp_path}/line?baudrate=115200",
        "can": f"can://socketcand/127.0.0.1:{free_port()}/can0",
    }
    with simulated(device, urls[wire]) as endpoint:
        yield endpoint, device


def test_enable_move_and_stop(wired: tuple[str, str]) -> None:
    assert out("drive", *wired, "status").startswith("switch on disabled, position 0, velocity 0; status word ")
    enabled = out("drive", *wired, "enable").splitlines()
    assert "s  enable: switch on disabled, waiting for 'operation enabled', position 0, velocity 0" in enabled[0]
    assert enabled[-1].startswith("operation enabled, position 0")
    # Not its velocity: what a CSD MT shows is the mean of the last 100 ms (register 1113).
    assert "position 2000, " in out("drive", *wired, "move", "2000", "--velocity", "400").splitlines()[-1]
    assert "position 1500" in out("drive", *wired, "move", "-500", "--relative").splitlines()[-1]
    told = [json.loads(line) for line in out("drive", *wired, "velocity", "-120", "--json").splitlines()]
    assert told[-1]["action"] == "velocity"
    assert "target reached" in told[-1]["bits"]
    assert [event["time"] for event in told] == sorted(event["time"] for event in told)
    stopped = out("drive", *wired, "quick-stop").splitlines()[-1]
    assert stopped.startswith("quick stop active" if wired[1] == "csd-mt" else "switch on disabled")
    assert out("drive", *wired, "disable").splitlines()[-1].startswith("switch on disabled")


def test_ctrl_c_is_a_quick_stop() -> None:
    with simulated("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        command = [*COMMAND, "drive", endpoint, "csd-mt", "move", "100000000", "--json"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            for line in process.stdout:
                if json.loads(line)["velocity"]:
                    break
            process.send_signal(signal.SIGINT)
            last = process.stdout.read().splitlines()[-1]
            assert process.wait(10) == 130
        assert json.loads(last)["state"] == "quick stop active"
        assert out("read", endpoint, "csd-mt", "Velocity Actual Value").startswith("Velocity Actual Value = 0 ")


@pytest.mark.parametrize("how", ["SIGTERM", "SIGHUP", "closed"])
def test_whatever_ends_it_is_a_quick_stop(how: str) -> None:
    """Whether it is ended, its terminal goes away, or nobody reads what it says: the motor stops."""
    with simulated("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        command = [*COMMAND, "drive", endpoint, "csd-mt", "move", "100000000", "--json"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
            assert process.stdout is not None
            for line in process.stdout:
                if json.loads(line)["velocity"]:
                    break
            if how == "closed":
                process.stdout.close()
            else:
                process.send_signal(getattr(signal, how))
                assert json.loads(process.stdout.read().splitlines()[-1])["state"] == "quick stop active"
            assert process.wait(20) == {"SIGTERM": 143, "SIGHUP": 129, "closed": 1}[how]
        assert out("read", endpoint, "csd-mt", "Velocity Actual Value").startswith("Velocity Actual Value = 0 ")


def test_what_is_no_drive_is_told_before_anything_is_opened() -> None:
    said = failing("drive", "tcp://127.0.0.1:1", "adxl", "enable")
    assert "is no drive: its description has no table [drive]" in said


def test_a_fault_is_one_line_that_says_which() -> None:
    machine = simulator("csd-mt", time.monotonic())
    assert isinstance(machine, CsdMt)
    assert machine.modbus is not None
    with ModbusServer("tcp://127.0.0.1:0", units={1: machine.modbus}) as host:
        machine.supply(False, time.monotonic())
        said = failing_while_talking("drive", host.url, "csd-mt", "enable", "--timeout", "0.3")
        assert "enable: stuck in 'ready to switch on' after 0.3 s" in said
        assert "no high voltage, bit 4 (voltage enabled) is off" in said
        machine.fault(0x2130, time.monotonic())
        said = failing_while_talking("drive", host.url, "csd-mt", "move", "1")
        assert "Error Code 2130h (short circuit or overcurrent on a motor phase)" in said


def failing_while_talking(*arguments: str) -> str:
    """As `failing`, for a command that tells what it does before it fails."""
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    return done.stderr


def test_what_is_no_drive_is_told_before_anything_is_sent() -> None:
    with simulated("adxl", "tcp://127.0.0.1:0") as endpoint:
        assert "adxl is no drive: its description has no table [drive]" in failing("drive", endpoint, "adxl", "enable")
    with simulated("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        said = failing("drive", endpoint, "csd-mt", "move", "0", "--velocity", "900000")
        assert "Profile Velocity = 900000: expected 0..800000 step/s" in said


def test_a_machine_has_a_drive() -> None:
    machine = simulator("csd-mt", time.monotonic())
    told: list[DriveProgress] = []
    assert machine.modbus is not None
    with ModbusServer("tcp://127.0.0.1:0", units={1: machine.modbus}) as host, connect("csd-mt", host.url) as csd:
        drive = csd.drive.following(told.append)
        assert drive.status().state is State.SWITCH_ON_DISABLED
        assert drive.move(3000, velocity=20_000).position == 3000
        assert drive.home(35).position == 0
        assert drive.reset().state is State.OPERATION_ENABLED
        assert drive.disable().state is State.SWITCH_ON_DISABLED
    assert told[-1].action == "disable"
