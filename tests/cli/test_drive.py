"""`barewire drive` and `machine.drive`: two drives, over three wires."""

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
from tests.cli.helpers import COMMAND, error_of, output_of, run_command, simulated_at
from tests.helpers import free_port


@pytest.fixture(params=["csd-mt over tcp", "az3 over rtu", "az3 over can"])
def drive_at(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[str, str]]:
    device, _, wire = request.param.partition(" over ")
    urls = {
        "tcp": "tcp://127.0.0.1:0",
        "rtu": f"rtu://{tmp_path}/line?baudrate=115200",
        "can": f"can://socketcand/127.0.0.1:{free_port()}/can0",
    }
    with simulated_at(device, urls[wire]) as endpoint:
        yield endpoint, device


def test_enable_move_and_stop(drive_at: tuple[str, str]) -> None:
    assert output_of("drive", *drive_at, "status").startswith(
        "switch on disabled, position 0, velocity 0; status word "
    )
    enabled = output_of("drive", *drive_at, "enable").splitlines()
    assert "s  enable: switch on disabled, waiting for 'operation enabled', position 0, velocity 0" in enabled[0]
    assert enabled[-1].startswith("operation enabled, position 0")
    assert not any("operation enabled, waiting for 'operation enabled'" in line for line in enabled)
    # Not its velocity: what a CSD MT shows is the mean of the last 100 ms (register 1113).
    assert "position 2000, " in output_of("drive", *drive_at, "move", "2000", "--velocity", "400").splitlines()[-1]
    assert "position 1500" in output_of("drive", *drive_at, "move", "-500", "--relative").splitlines()[-1]
    events = [json.loads(line) for line in output_of("drive", *drive_at, "velocity", "-120", "--json").splitlines()]
    assert events[-1]["action"] == "velocity"
    assert "target reached" in events[-1]["bits"]
    assert [event["time"] for event in events] == sorted(event["time"] for event in events)
    stopped = output_of("drive", *drive_at, "quick-stop").splitlines()[-1]
    assert stopped.startswith("quick stop active" if drive_at[1] == "csd-mt" else "switch on disabled")
    assert output_of("drive", *drive_at, "disable").splitlines()[-1].startswith("switch on disabled")


@pytest.mark.parametrize("place", [(), ("ENDPOINT", "DEVICE"), ("tcp://127.0.0.1:1", "az3")])
@pytest.mark.parametrize("option", ["-h", "--help"])
def test_the_help_of_a_command_needs_no_endpoint_and_device(place: tuple[str, ...], option: str) -> None:
    text = output_of("drive", *place, "move", option)
    assert text.startswith(
        "Usage: barewire drive ENDPOINT DEVICE move [OPTIONS] TARGET\n\n  Move to the position TARGET"
    )
    assert "--relative " in text
    assert "Usage: barewire drive [OPTIONS] ENDPOINT DEVICE COMMAND" in output_of("drive", option)


def test_ctrl_c_is_a_quick_stop() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
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
        assert output_of("read", endpoint, "csd-mt", "Velocity Actual Value").startswith("Velocity Actual Value = 0 ")


@pytest.mark.parametrize("how", ["SIGTERM", "SIGHUP", "closed"])
def test_the_end_of_the_command_is_a_quick_stop(how: str) -> None:
    """A signal, a closed terminal or a closed pipe during a movement: the motor stops."""
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
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
        assert output_of("read", endpoint, "csd-mt", "Velocity Actual Value").startswith("Velocity Actual Value = 0 ")


def test_a_device_that_is_no_drive_is_refused_before_the_port_is_opened() -> None:
    error = error_of("drive", "tcp://127.0.0.1:1", "adxl", "enable")
    assert "is not a drive: its description has no table [drive]" in error


def test_an_error_names_the_state_and_the_cause() -> None:
    machine = simulator("csd-mt", time.monotonic())
    assert isinstance(machine, CsdMt)
    assert machine.modbus is not None
    with ModbusServer("tcp://127.0.0.1:0", units={1: machine.modbus}) as host:
        machine.supply(False, time.monotonic())
        error = error_after_progress("drive", host.url, "csd-mt", "enable", "--timeout", "0.3")
        assert "enable: stuck in 'ready to switch on' after 0.3 s" in error
        assert "no high voltage, bit 4 (voltage enabled) is off" in error
        machine.fault(0x2130, time.monotonic())
        error = error_after_progress("drive", host.url, "csd-mt", "move", "1")
        assert "Error Code 2130h (short circuit or overcurrent on a motor phase)" in error


def error_after_progress(*arguments: str) -> str:
    """Do the same as `error_of` for a command that prints its progress before it fails."""
    done = run_command(*arguments)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    return done.stderr


def test_a_velocity_out_of_range_is_refused() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        error = error_of("drive", endpoint, "csd-mt", "move", "0", "--velocity", "900000")
        assert "Profile Velocity = 900000: expected 0..800000 step/s" in error


def test_the_drive_of_a_machine() -> None:
    machine = simulator("csd-mt", time.monotonic())
    progress: list[DriveProgress] = []
    assert machine.modbus is not None
    with ModbusServer("tcp://127.0.0.1:0", units={1: machine.modbus}) as host, connect("csd-mt", host.url) as csd:
        drive = csd.drive.following(progress.append)
        assert drive.status().state is State.SWITCH_ON_DISABLED
        assert drive.move(3000, velocity=20_000).position == 3000
        assert drive.home(35).position == 0
        assert drive.reset().state is State.OPERATION_ENABLED
        assert drive.disable().state is State.SWITCH_ON_DISABLED
    assert progress[-1].action == "disable"


def test_a_broken_connection_during_a_movement_names_the_danger() -> None:
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
            error = process.stderr.read()
            assert process.wait(30) == 1
    assert error.count("\n") == 1
    assert error.endswith("; move: the motor may still be turning\n")


def test_a_homing_without_a_method_and_a_timeout_that_is_no_number() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        assert "home: Homing Method 0 is not a homing method: expected one of -2, -1, 3" in error_of(
            "drive", endpoint, "csd-mt", "home"
        )
        done = run_command("drive", endpoint, "csd-mt", "enable", "--timeout", "nan")
        assert done.stderr == "barewire: timeout = nan: expected seconds, above 0\n"
