"""The main command: help, version, wrong usage, and errors as one line on stderr."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import can
import pytest

from barewire import CanopenClient, ModbusServer
from barewire.devices.sim import simulator
from barewire.errors import PortError
from barewire_workbench.cli.app import COMMANDS
from tests.helpers import every_case, free_port, some_of
from tests.workbench.cli.helpers import COMMAND, ENVIRONMENT, error_of, output_of, run_command, run_here, simulated_at


def test_version_and_help() -> None:
    assert output_of("--version").startswith("barewire")
    text = output_of("--help")
    assert "ENDPOINT" in text
    listed = [line.split(maxsplit=1) for line in text.partition("Commands:\n")[2].splitlines() if line]
    assert [(name, summary) for name, summary in listed] == [(name, COMMANDS[name][1]) for name in COMMANDS]


@every_case("name", COMMANDS)
def test_the_help_of_a_command_begins_with_its_line_of_the_list(name: str) -> None:
    usage, empty, first, *_ = output_of(name, "--help").splitlines()
    assert usage.startswith(f"Usage: barewire {name} ")
    assert (empty, first.strip()) == ("", COMMANDS[name][1])


def test_verbose_writes_the_log_to_stderr() -> None:
    place = f"tcp://127.0.0.1:{free_port()}"
    command = "read", f"{place}?timeout=0.1", "adxl", "Status"
    quiet, verbose = run_command(*command), run_command("-v", *command)
    assert (quiet.returncode, verbose.returncode) == (1, 1)
    assert len(quiet.stderr.splitlines()) == 1
    assert f" INFO barewire.modbus.client: {place}: not connected: connection refused; next" in verbose.stderr
    assert verbose.stderr.splitlines()[-1] == quiet.stderr.strip()


def test_more_verbose_writes_all_bytes() -> None:
    with ModbusServer("tcp://127.0.0.1:0", {1: simulator("adxl").modbus}) as server:
        run = run_command("-vv", "read", server.url, "adxl", "Status", "--no-check")
    assert " DEBUG barewire.modbus.client: " in run.stderr
    assert ": sent 00 01 00 00 00 06 01 04 " in run.stderr


@pytest.mark.parametrize("group", [(), ("eds",), ("drive",)])
def test_a_group_without_a_command_shows_its_help_page(group: tuple[str, ...]) -> None:
    run = run_here(*group)
    assert run.stdout + run.stderr == output_of(*group, "--help")


@pytest.mark.parametrize(
    "arguments",
    [
        ("read", "http://127.0.0.1", "adxl", "Status"),
        ("read", "tcp://127.0.0.1?colour=red", "adxl", "Status"),
        ("write", "tcp://127.0.0.1", "adxl", "Status"),
        ("explain", "morse", "00"),
        ("nonsense",),
        ("read",),
    ],
)
def test_wrong_usage_is_one_line_and_status_2(arguments: tuple[str, ...]) -> None:
    assert error_of(*arguments, status=2)


@pytest.mark.parametrize("query", ["timeout=-1", "idle=300?unit=5", "any_unit=yes", "recovery=hope", "unit=x"])
def test_a_wrong_option_of_an_endpoint_is_wrong_usage(query: str) -> None:
    error = error_of("read", f"tcp://127.0.0.1:1?{query}", "adxl", "Status", status=2)
    assert error.startswith("barewire: Invalid value for 'ENDPOINT': endpoint 'tcp://127.0.0.1:1?")


@pytest.mark.parametrize("place", ["virtual/x?prt=1", "udp_multicast/239.74.163.2?prt=1", "udpmulticast/x"])
def test_a_wrong_option_or_interface_of_can_is_wrong_usage(place: str) -> None:
    error = error_of("read", f"can://{place}", "az3", "STATUS WORD", status=2)
    assert error.startswith(f"barewire: Invalid value for 'ENDPOINT': endpoint 'can://{place}': unknown ")


def test_four_causes_of_failure_are_four_different_lines(tmp_path: Path) -> None:
    no_port = error_of("read", "rtu:///dev/tty-nowhere", "adxl", "Status")
    refused = error_of("read", f"tcp://127.0.0.1:{free_port()}", "csd-mt", "Status Word")
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        silent = error_of("read", f"tcp://127.0.0.1:{port}?timeout=0.2", "csd-mt", "Status Word")
    with simulated_at("adxl", f"rtu://{tmp_path}/line") as endpoint:
        exception = error_of("read", endpoint, "csd-mt", "Status Word", "--no-check")
    assert no_port == "barewire: /dev/tty-nowhere: no such file or directory\n"
    assert "connection refused" in refused
    assert "did not answer Read Holding Registers within 0.2 s" in silent
    assert "exception 02 (illegal data address) to function 03" in exception
    assert "while reading Status Word" in exception
    assert len({no_port, refused, silent, exception}) == 4


def test_a_socketcand_port_without_server_is_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    url = f"can://socketcand/127.0.0.1:{free_port()}/can0"
    assert "connection refused" in error_of("read", url, "az3", "STATUS WORD")
    # python-can itself would try for ten seconds: it is not even called.
    monkeypatch.setattr(can, "Bus", lambda *_, **__: pytest.fail("python-can was called"))
    with pytest.raises(PortError, match="connection refused"):
        CanopenClient(url)


def test_an_unknown_name_suggests_the_nearest() -> None:
    error = error_of("read", "tcp://127.0.0.1:1", "adxl", "Tyristor temperature", status=2)
    assert "did you mean 'Thyristors temperature'?" in error
    assert "did you mean 'adxl'" in error_of("read", "tcp://127.0.0.1:1", "adxk", "Status", status=2)


def test_output_without_a_degree_sign_in_its_encoding() -> None:
    environment = ENVIRONMENT | {"LC_ALL": "C", "PYTHONIOENCODING": "ascii"}
    done = subprocess.run([*COMMAND, "devices", "adxl"], capture_output=True, env=environment, check=False)
    assert done.returncode == 0
    assert b"Thyristors temperature" in done.stdout


@pytest.mark.parametrize(
    "module", ["click", "barewire_workbench.cli.app", "barewire_workbench.cli.read_write", "barewire.io.machine"]
)
def test_ctrl_c_while_the_command_is_being_loaded_ends_it_quietly(module: str) -> None:
    """The interrupt comes in the middle of an import, also where Python reports exceptions and goes on."""
    code = f"""
import os, signal, sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            class Ignored:
                def __del__(self):
                    os.kill(os.getpid(), signal.SIGINT)
                    sum(range(1000))
            Ignored()
            os.kill(os.getpid(), signal.SIGINT)
            sum(range(1000))
sys.meta_path.insert(0, Interrupting())
from barewire_workbench.cli import main
sys.argv = ["barewire", "read", "tcp://127.0.0.1:1", "adxl", "Status"]
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_ctrl_c_at_any_time_of_the_start_ends_the_command_quietly() -> None:
    """From the first import of `main` on; before, while the interpreter starts, Python itself prints a traceback."""
    code = """
import sys
class Ready:
    def find_spec(self, name, path=None, target=None):
        if name == "click":
            print(flush=True)
sys.meta_path.insert(0, Ready())
from barewire_workbench.cli import main
main()
"""
    command = [sys.executable, "-c", code, "explain", "rtu", "01"]
    for place in range(8):
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            process.stdout.readline()
            time.sleep(0.01 * place)
            process.send_signal(signal.SIGINT)
            error = process.stderr.read()
            assert "Traceback" not in error
            # While Python itself ends, the signal kills the process; a shell shows 130 for that too.
            assert process.wait(30) in (0, 130, -signal.SIGINT)


@pytest.mark.parametrize(
    ("name", "end"), [("reed", "vendor; did you mean 'read' or 'record'?\n"), ("xyz", "eds, vendor\n")]
)
def test_an_unknown_command_is_reported_with_the_nearest_one(name: str, end: str) -> None:
    error = error_of(name, "tcp://127.0.0.1:1", status=2)
    assert error.startswith(f"barewire: unknown command '{name}': expected one of demo, devices")
    assert error.endswith(end)


@pytest.mark.parametrize(
    "command",
    some_of(
        [
            ("--version",),
            ("diagnose", "docs/pictures/line.log"),  # its status is 1 by its findings
            ("devices",),
            ("devices", "adxl", "--json"),
            ("explain", "rtu", "01 03"),
        ],
        2,
    ),
    ids=" ".join,
)
def test_a_closed_stdout_is_one_line(command: tuple[str, ...]) -> None:
    shell = ["sh", "-c", '"$@" >&-', "sh", *COMMAND, *command]
    done = subprocess.run(shell, stderr=subprocess.PIPE, text=True, timeout=60, env=ENVIRONMENT, check=False)
    assert (done.returncode, done.stderr) == (
        1,
        "barewire: output: stdout is closed, what the command printed is lost\n",
    )


def test_a_drive_moves_and_stops_with_a_closed_stdout() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        for words in (("move", "100", "--enable"), ("quick-stop",)):
            shell = ["sh", "-c", '"$@" >&-', "sh", *COMMAND, "drive", endpoint, "csd-mt", *words]
            done = subprocess.run(shell, stderr=subprocess.PIPE, text=True, timeout=60, env=ENVIRONMENT, check=False)
            assert done.stderr == "barewire: output: stdout is closed, what the command printed is lost\n"
        assert output_of("drive", endpoint, "csd-mt", "status").startswith("quick stop active, position 100,")


UNWRITABLE = "barewire: output: no space left on device\n"
COMMANDS_THAT_PRINT = [
    ("--version",),
    ("--help",),
    ("devices",),
    ("eds", "export", "az3"),
    ("eds", "--help"),
    ("demo",),
    ("devices", "adxl", "--json"),
    ("explain", "rtu", "01 83 02 C0 F1"),
    ("steps", "crc", "01 03"),
    ("lab",),
    ("vectors", "list"),
]
"""The first four print in different ways: click, its help, rich, and text as it is."""


@pytest.mark.parametrize("command", some_of(COMMANDS_THAT_PRINT, 4), ids=" ".join)
def test_an_output_that_cannot_be_written_is_one_line(command: tuple[str, ...]) -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*COMMAND, *command],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
            env=ENVIRONMENT,
            check=False,
        )
    assert (done.returncode, done.stderr) == (1, UNWRITABLE)


SMALL_DISK = ["sh", "-c", 'ulimit -f 8; exec "$@"', "sh", *COMMAND]
"""A command that can write a few kilobytes to a file. Its bytecode must not be written then: it would be cut too."""


@pytest.mark.parametrize("settings", [{}, {"PYTHONUNBUFFERED": "1"}], ids=["buffered", "unbuffered"])
def test_an_output_that_is_cut_is_an_error(settings: dict[str, str], tmp_path: Path) -> None:
    with (tmp_path / "cut").open("w") as file:
        done = subprocess.run(
            [*SMALL_DISK, "eds", "export", "az3"],
            stdout=file,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
            env=ENVIRONMENT | settings | {"PYTHONDONTWRITEBYTECODE": "1"},
            check=False,
        )
    assert (done.returncode, done.stderr) == (1, "barewire: output: file too large\n")


def test_a_file_is_replaced_as_a_whole_or_stays(tmp_path: Path) -> None:
    file = tmp_path / "az3.eds"
    output_of("eds", "export", "az3", str(file))
    before = file.read_bytes()
    command = [*SMALL_DISK, "eds", "export", "az3", str(file)]
    environment = ENVIRONMENT | {"PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=environment, check=False)
    assert (done.returncode, done.stderr) == (1, f"barewire: {file}: File too large\n")
    assert (file.read_bytes(), list(tmp_path.iterdir())) == (before, [file])


@pytest.mark.parametrize("redirection", ["2>/dev/full", "2>&-"])
@pytest.mark.parametrize(
    ("command", "status"), [("devices", 0), ("nonsense", 2), ("read tcp://127.0.0.1:1 adxl Status", 1)]
)
def test_an_error_that_cannot_be_written_leaves_the_status(command: str, status: int, redirection: str) -> None:
    shell = ["sh", "-c", f'"$@" {redirection}', "sh", *COMMAND, *command.split()]
    done = subprocess.run(shell, capture_output=True, text=True, timeout=60, env=ENVIRONMENT, check=False)
    assert done.returncode == status
    assert ("barewire: " in done.stdout, done.stdout == "") == (False, status != 0)


def test_a_reader_that_ends_early_is_no_error() -> None:
    shell = ["bash", "-c", '"$@" | true; exit ${PIPESTATUS[0]}', "bash", *COMMAND, "devices", "adxl", "--json"]
    done = subprocess.run(shell, capture_output=True, text=True, timeout=60, env=ENVIRONMENT, check=False)
    assert (done.returncode, done.stderr) == (1, "")
