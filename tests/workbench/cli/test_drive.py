"""`barewire drive` and `machine.drive`: two drives, over three wires."""

from __future__ import annotations

import json
import shlex
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from barewire import ModbusServer, connect
from barewire.devices.cia402 import State
from barewire.devices.drive import DriveProgress, DriveStatus
from barewire.devices.sim import CsdMt, simulator
from barewire.io.drive import DriveClient
from barewire_workbench.cli.app import run_command_line
from barewire_workbench.cli.drive import _remarks, _short
from tests.helpers import free_port
from tests.workbench.cli.helpers import COMMAND, error_of, output_of, run_here, simulated_at


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


def test_enable_warns_of_a_target_that_is_left_in_the_drive(tmp_path: Path) -> None:
    """In the velocity mode the motor turns as soon as the drive is enabled."""
    with simulated_at("az3", f"rtu://{tmp_path}/line?baudrate=115200") as url:
        assert "TARGET VELOCITY" not in run_here("drive", url, "az3", "enable").stderr
        output_of("drive", url, "az3", "disable")
        output_of("write", url, "az3", "MODES OF OPERATION=3", "TARGET VELOCITY=500")
        done = run_here("drive", url, "az3", "enable")
        assert (
            "barewire: TARGET VELOCITY is 500 in the velocity mode: the motor turns when it is enabled" in done.stderr
        )
        assert done.returncode == 0


def test_enable_move_and_stop(drive_at: tuple[str, str]) -> None:
    assert output_of("drive", *drive_at, "status").startswith(
        "switch on disabled, position 0, velocity 0; status word "
    )
    enabled = output_of("drive", *drive_at, "enable").splitlines()
    assert "s  enable: switch on disabled, waiting for 'operation enabled', position 0, velocity 0" in enabled[0]
    assert enabled[-1].startswith("operation enabled, position 0")
    assert not any("operation enabled, waiting for 'operation enabled'" in line for line in enabled)
    # Not its velocity: what a CSD MT shows is the mean of the last 100 ms (register 1113).
    assert "position 300, " in output_of("drive", *drive_at, "move", "300", "--velocity", "400")
    assert "position 200, " in output_of("drive", *drive_at, "move", "-100", "--relative")
    events = [json.loads(line) for line in output_of("drive", *drive_at, "velocity", "-120", "--json").splitlines()]
    assert events[-1]["action"] == "velocity"
    assert "target reached" in events[-1]["bits"]
    assert [event["time"] for event in events] == sorted(event["time"] for event in events)
    endpoint, device = drive_at
    turning = output_of("drive", *drive_at, "velocity", "-150").splitlines()
    stop = f'barewire drive "{endpoint}" {device} velocity 0'
    assert turning[-1] == f"the motor keeps turning; to stop it: {stop}"
    assert "keeps turning" not in output_of(*shlex.split(stop)[1:])
    stopped = output_of("drive", *drive_at, "quick-stop")
    assert ("\nquick stop active" if drive_at[1] == "csd-mt" else "\nswitch on disabled") in stopped
    assert output_of("drive", *drive_at, "disable").splitlines()[-1].startswith("switch on disabled")


@pytest.mark.parametrize("place", [(), ("ENDPOINT", "DEVICE"), ("tcp://127.0.0.1:1", "az3")])
@pytest.mark.parametrize("option", ["-h", "--help"])
def test_the_help_of_a_command_needs_no_endpoint_and_device(place: tuple[str, ...], option: str) -> None:
    text = output_of("drive", *place, "move", option)
    assert text.startswith(
        "Usage: barewire drive ENDPOINT DEVICE move [OPTIONS] TARGET\n\n  Move the enabled drive to the position TARGET"
    )
    assert "--relative " in text
    assert "Usage: barewire drive [OPTIONS] ENDPOINT DEVICE COMMAND" in output_of("drive", option)


def comes_to_rest(endpoint: str) -> bool:
    """Whether the velocity becomes 0: a CSD MT shows the mean of the last 100 ms, also after the motor has stopped."""
    end = time.monotonic() + 120
    while time.monotonic() < end:
        if output_of("read", endpoint, "csd-mt", "Velocity Actual Value").startswith("Velocity Actual Value = 0 "):
            return True
    return False


@pytest.mark.parametrize("presses", [1, 2, 20])
def test_ctrl_c_is_a_quick_stop(presses: int) -> None:
    """Also if it is pressed again before the quick stop is written and confirmed."""
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        command = [*COMMAND, "drive", endpoint, "csd-mt", "move", "100000000", "--enable", "--json"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            for line in process.stdout:
                if json.loads(line)["velocity"]:
                    break
            for _ in range(presses):
                process.send_signal(signal.SIGINT)
                time.sleep(0.0002)
            last = process.stdout.read().splitlines()[-1]
            report = process.stderr.read()
            # A press after the command, while Python itself ends, kills the process; a shell shows 130 for that too.
            assert process.wait(60) in ((130,) if presses == 1 else (130, -signal.SIGINT))
        assert report.startswith("barewire: move was interrupted: quick stop, the motor stands at position ")
        # The line is followed by an empty one if a further press came behind it.
        ending = report if presses == 1 else report.rstrip("\n") + "\n"
        assert ending.endswith("; quick stop active; current on, the motor holds its position\n")
        assert json.loads(last)["state"] == "quick stop active"
        assert comes_to_rest(endpoint)


@pytest.mark.parametrize("how", ["SIGTERM", "SIGHUP", "closed"])
def test_the_end_of_the_command_is_a_quick_stop(how: str) -> None:
    """A signal, a closed terminal or a closed pipe during a movement: the motor stops."""
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        command = [*COMMAND, "drive", endpoint, "csd-mt", "move", "100000000", "--enable", "--json"]
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
            assert process.wait(60) == {"SIGTERM": 143, "SIGHUP": 129, "closed": 1}[how]
        assert comes_to_rest(endpoint)


@pytest.fixture
def handlers() -> Iterator[None]:
    """Let the signals that end a command raise KeyboardInterrupt here, and restore their handlers afterwards."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    for number in before:
        signal.signal(number, signal.default_int_handler)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("second", ["SIGINT", "SIGTERM", "SIGHUP"])
@pytest.mark.parametrize("first", ["SIGINT", "SIGTERM", "closed"])
def test_a_second_signal_does_not_interrupt_the_quick_stop(
    first: str, second: str, handlers: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    quick_stop = DriveClient.quick_stop

    def interrupted_move(drive: DriveClient, *_: object, **__: object) -> None:
        drive.velocity(20_000, enable=True)
        if first == "closed":
            raise OSError("the output is closed")
        signal.raise_signal(signal.Signals[first])

    def interrupted_quick_stop(drive: DriveClient) -> DriveStatus:
        signal.raise_signal(signal.Signals[second])
        status: DriveStatus = quick_stop(drive)
        signal.raise_signal(signal.Signals[second])
        return status

    monkeypatch.setattr(DriveClient, "move", interrupted_move)
    monkeypatch.setattr(DriveClient, "quick_stop", interrupted_quick_stop)
    machine = simulator("csd-mt", time.monotonic())
    assert machine.modbus is not None
    with ModbusServer("tcp://127.0.0.1:0", units={1: machine.modbus}) as server:
        status = run_command_line(["drive", server.url, "csd-mt", "move", "1"])
        assert status == {"SIGINT": 130, "SIGTERM": 143, "closed": 1}[first]
        assert "move was interrupted: quick stop, the motor stands" in capsys.readouterr().err
        with connect("csd-mt", server.url) as csd:
            assert csd.drive.status().state is State.QUICK_STOP_ACTIVE


def test_a_device_that_is_no_drive_is_refused_before_the_port_is_opened() -> None:
    error = error_of("drive", "tcp://127.0.0.1:1", "adxl", "enable", status=2)
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
    done = run_here(*arguments)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    return done.stderr


def test_a_movement_does_not_switch_the_current_on_unasked() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        for words in (("move", "100"), ("velocity", "100"), ("home", "35")):
            error = error_after_progress("drive", endpoint, "csd-mt", *words, "--timeout", "0.3")
            assert "stuck in 'switch on disabled', waiting for 'operation enabled': " in error
            assert "enable it first, or together with the movement (--enable" in error
        assert output_of("drive", endpoint, "csd-mt", "status").startswith("switch on disabled, ")
        assert "position 100, " in output_of("drive", endpoint, "csd-mt", "move", "100", "--enable")


def test_results_that_need_a_remark() -> None:
    csd = simulator("csd-mt").device
    reached = DriveStatus(0.0, 0x0637, 1, 2000, 27506)
    assert list(_remarks("move", csd, reached, {"target": 2000})) == [
        "the target is reached; Velocity Actual Value still shows 27506: the mean over Velocity Total Sample (1113), "
        "100 ms as delivered, so it lags behind"
    ]
    assert list(_remarks("move", csd, reached._replace(velocity=0), {"target": 2000})) == []
    limited = DriveStatus(0.0, 0x0E37, 3, 0, 500)
    assert list(_remarks("velocity", csd, limited, {"target": 900})) == [
        "the drive limits itself at 500, 900 was asked for (internal limit, bit 11)"
    ]
    mean = "Velocity Actual Value still shows 500: the mean over Velocity Total Sample (1113), 100 ms as delivered"
    mean += ", so it lags behind"
    held = limited._replace(status_word=0x0637)
    assert list(_remarks("velocity", csd, held, {"target": 500})) == []
    assert list(_remarks("velocity", csd, held, {"target": 900})) == [f"the target is reached; {mean}"]
    assert list(_remarks("velocity", csd, held, {"target": 0})) == [f"the motor stands; {mean}"]
    assert list(_remarks("quick-stop", csd, held, {})) == [f"the motor stands; {mean}"]


def test_a_movement_that_takes_too_long_is_stopped_and_one_line_says_so() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        slow = ("move", "100000000", "--velocity", "500", "--within", "0.3", "--enable")
        error = error_after_progress("drive", endpoint, "csd-mt", *slow)
        assert "interrupted" not in error
        assert "waiting for target reached" in error
        assert "; then the command stopped the motor: quick stop, the motor stands at position " in error
        assert error.endswith("; quick stop active; current on, the motor holds its position\n")


def test_a_reset_without_a_fault_says_that_there_is_none() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        lines = output_of("drive", endpoint, "csd-mt", "reset").splitlines()
        assert lines[0].startswith("switch on disabled, position 0")
        assert lines[1:] == ["no fault to reset"]


def test_the_list_of_commands_is_not_cut() -> None:
    assert "..." not in output_of("drive", "--help").partition("Commands:")[2]


def test_the_line_of_a_terminal_names_what_is_waited_for() -> None:
    status = DriveStatus(0.0, 0x0237, 1, 5, 100)
    line = _short(DriveProgress("move", "target reached", status))
    assert line == "move, position 5, velocity 100; waiting for target reached"
    acknowledged = DriveProgress("move", "bit 12 to rise (set-point acknowledge)", status)
    assert _short(acknowledged).endswith("velocity 100; waiting for bit 12 to rise")
    off = DriveStatus(0.0, 0x0233, 1, 0, 0)
    assert _short(DriveProgress("enable", "'operation enabled'", off)) == (
        "enable, switched on; waiting for 'operation enabled'"
    )


def test_a_velocity_out_of_range_is_refused() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        error = error_of("drive", endpoint, "csd-mt", "move", "0", "--velocity", "900000", status=2)
        assert "Profile Velocity = 900000: expected 0..800000 step/s" in error


def test_the_drive_of_a_machine() -> None:
    machine = simulator("csd-mt", time.monotonic())
    progress: list[DriveProgress] = []
    assert machine.modbus is not None
    with ModbusServer("tcp://127.0.0.1:0", units={1: machine.modbus}) as host, connect("csd-mt", host.url) as csd:
        drive = csd.drive.following(progress.append)
        assert drive.status().state is State.SWITCH_ON_DISABLED
        assert drive.move(3000, velocity=20_000, enable=True).position == 3000
        assert drive.home(35).position == 0
        assert drive.reset().state is State.OPERATION_ENABLED
        assert drive.disable().state is State.SWITCH_ON_DISABLED
    assert progress[-1].action == "disable"


def test_a_broken_connection_during_a_movement_names_the_danger() -> None:
    command = [*COMMAND, "simulate", "csd-mt", "tcp://127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as machine:
        assert machine.stdout is not None
        endpoint = machine.stdout.readline().split()[1]
        moving = [*COMMAND, "drive", endpoint, "csd-mt", "move", "100000000", "--enable", "--json"]
        with subprocess.Popen(moving, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            for line in process.stdout:
                if '"waiting_for": "target reached"' in line:
                    break
            machine.send_signal(signal.SIGTERM)
            process.stdout.read()
            error = process.stderr.read()
            assert process.wait(60) == 1
    assert error.count("\n") == 1
    assert error.endswith("; move: the motor may still be turning\n")


def test_a_homing_without_a_method_and_a_timeout_that_is_no_number() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        assert "home: Homing Method 0 is not a homing method: expected one of -2, -1, 3" in error_of(
            "drive", endpoint, "csd-mt", "home", status=2
        )
        error = error_of("drive", endpoint, "csd-mt", "enable", "--timeout", "nan", status=2)
        expected = "expected seconds, above 0, below 1000000, such as 200ms, 15m, 12h"
        assert error == f"barewire: Invalid value for '--timeout': 'nan': {expected}\n"


@pytest.mark.parametrize("action", ["quick-stop", "disable"])
def test_the_motor_is_stopped_also_if_nothing_can_be_printed(action: str) -> None:
    with (
        ModbusServer("tcp://127.0.0.1:0", {1: simulator("csd-mt").modbus}) as server,
        connect("csd-mt", server.url) as client,
    ):
        client.drive.enable()
        client.drive.velocity(400)
        with open("/dev/full", "w") as full:
            command = [*COMMAND, "drive", server.url, "csd-mt", action]
            done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=30)
        assert done.stderr == "barewire: output: no space left on device\n"
        assert done.returncode == 1
        assert client.drive.status().state is not State.OPERATION_ENABLED
