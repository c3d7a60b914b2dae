"""The command as a person types it: what it prints, how it fails. Devices run in a second process, on real ports."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest

from barewire import CanopenClient
from barewire.errors import PortError

COMMAND = [sys.executable, "-m", "barewire.cli"]
ENVIRONMENT = os.environ | {"COLUMNS": "200", "NO_COLOR": "1"}


def barewire(*arguments: str, timeout: float = 60) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *arguments], capture_output=True, text=True, timeout=timeout, env=ENVIRONMENT, check=False
    )


def out(*arguments: str) -> str:
    done = barewire(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


@contextmanager
def simulated(device: str, endpoint: str, asking: str = "timeout=30") -> Iterator[str]:
    """A device in a process of its own; gives the endpoint that it says it is ready at, with an option for whoever
    asks there: a second, which is usual, a machine may stand still."""
    command = [*COMMAND, "simulate", device, endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            line = process.stdout.readline()
            assert line.startswith("ready "), process.stderr.read()
            yield asked_with(line.split()[1], asking)
        finally:
            process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0
        assert process.stderr.read() == ""


def asked_with(url: str, option: str) -> str:
    """The URL with an option more; none if it is empty."""
    return f"{url}{'&' if '?' in url else '?'}{option}" if option else url


def reads(endpoint: str, device: str, name: str, wanted: str, *meanwhile: str) -> str:
    """What a value reads as, once it has these words in it: another process moves it, in its own time."""
    give_up = time.monotonic() + 20
    if meanwhile:
        out(*meanwhile)
    while wanted not in (said := out("read", endpoint, device, name)):
        assert time.monotonic() < give_up, f"{said.strip()}: never {wanted!r}"
        if meanwhile:
            out(*meanwhile)
    return said


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return int(taken.getsockname()[1])


def failing(*arguments: str, status: int = 1) -> str:
    """The one line on stderr of a command that must fail."""
    done = barewire(*arguments)
    assert done.returncode == status, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    assert done.stdout == ""
    return done.stderr


# Two processes over each of the four wires


@pytest.mark.parametrize("scheme", ["rtu", "ascii"])
def test_a_simulated_adxl_on_a_pseudo_terminal(scheme: str, tmp_path: Path) -> None:
    with simulated("adxl", f"{scheme}://{tmp_path}/line") as endpoint:
        read = out("read", endpoint, "adxl", "Thyristors temperature")
        name, _, value = read.strip().partition(" = ")
        assert name == "Thyristors temperature"
        assert value.endswith("°C")
        assert 10 < float(value.split()[0]) < 60
        assert out("write", endpoint, "adxl", "Motor start command=1") == "Motor start command = 1 (execute), written\n"
        status = reads(endpoint, "adxl", "Status", "ramp")
        assert "Starter ready" not in status


def test_a_simulated_csd_mt_over_tcp() -> None:
    with simulated("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        assert "switch on disabled" in out("read", endpoint, "csd-mt", "Status Word")
        steps = (("0x6", "ready to switch on"), ("7", "switched on"), ("15", "operation enabled"))
        for word, state in steps:
            # Written again until it is taken: high voltage comes half a second after the process.
            reads(endpoint, "csd-mt", "Status Word", state, "write", endpoint, "csd-mt", f"Control Word={word}")


def test_the_same_names_of_the_az3_on_both_its_wires(tmp_path: Path) -> None:
    names = ("STATUS WORD", "SPEED KP", "PROFILE ACCELERATION")
    with simulated("az3", f"rtu://{tmp_path}/az3?parity=E") as endpoint:
        over_rtu = out("read", endpoint, "az3", *names)
        assert over_rtu == out("read", endpoint, "az3", *names)  # the second opening with parity works as well
    with simulated("az3", f"can://socketcand/127.0.0.1:{free_port()}/can0?node=5") as endpoint:
        over_can = out("read", endpoint, "az3", *names)
        assert out("write", endpoint, "az3", "TARGET VELOCITY=-250").startswith("TARGET VELOCITY = -250")
        assert out("read", endpoint, "az3", "target velocity").startswith("TARGET VELOCITY = -250")
    assert over_rtu == over_can


def test_a_plain_table_over_tcp_answers_json() -> None:
    with simulated("csd-mt", "tcp://127.0.0.1:0?unit=3") as endpoint:
        fields = json.loads(out("read", endpoint, "csd-mt", "Position Actual Value", "--json"))
    assert fields == {"name": "Position Actual Value", "value": 0, "unit": "step", "text": "0 step"}


def test_a_table_is_simulated_until_interrupted() -> None:
    with simulated("table", "tcp://127.0.0.1:0", asking="") as endpoint:
        host, _, port = endpoint.removeprefix("tcp://").partition(":")
        with socket.create_connection((host, int(port)), timeout=30) as client:
            client.sendall(bytes.fromhex("0001 0000 0006 01 03 FFFF 0001"))
            assert client.recv(100) == bytes.fromhex("0001 0000 0005 01 03 02 0000")


# What goes wrong


def test_four_troubles_are_four_lines(tmp_path: Path) -> None:
    unplugged = failing("read", "rtu:///dev/tty-nowhere", "adxl", "Status")
    refused = failing("read", f"tcp://127.0.0.1:{free_port()}", "csd-mt", "Status Word")
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        silent = failing("read", f"tcp://127.0.0.1:{port}?timeout=0.2", "csd-mt", "Status Word")
    with simulated("adxl", f"rtu://{tmp_path}/line") as endpoint:
        declined = failing("read", endpoint, "csd-mt", "Status Word")
    assert unplugged == "barewire: /dev/tty-nowhere: no such file or directory\n"
    assert "connection refused" in refused
    assert "did not answer Read Holding Registers within 0.2 s" in silent
    assert "exception 02 (illegal data address) to function 03" in declined
    assert len({unplugged, refused, silent, declined}) == 4


@pytest.mark.parametrize("query", ["timeout=-1", "idle=300?unit=5", "any_unit=yes", "recovery=hope", "unit=x"])
def test_a_wrong_option_of_an_endpoint_is_a_command_that_cannot_be_understood(query: str) -> None:
    said = failing("read", f"tcp://127.0.0.1:1?{query}", "adxl", "Status", status=2)
    assert said.startswith("barewire: Invalid value for 'ENDPOINT': endpoint 'tcp://127.0.0.1:1?")


def test_a_wrong_name_suggests_the_nearest() -> None:
    said = failing("read", "tcp://127.0.0.1:1", "adxl", "Tyristor temperature")
    assert "did you mean 'Thyristors temperature'?" in said
    assert "did you mean 'adxl'" in failing("read", "tcp://127.0.0.1:1", "adxk", "Status")


def test_a_value_out_of_range_names_the_range() -> None:
    with simulated("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        said = failing("write", endpoint, "csd-mt", "Homing Method=99")
        assert "expected -2..37" in said
        assert "read only" in failing("write", endpoint, "csd-mt", "Status Word=1")
        assert "expected a number" in failing("write", endpoint, "csd-mt", "Homing Method=fast")


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
def test_what_cannot_be_understood_is_usage(arguments: tuple[str, ...]) -> None:
    assert failing(*arguments, status=2)


def test_nothing_is_written_when_a_later_value_is_wrong() -> None:
    with simulated("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        before = out("read", endpoint, "csd-mt", "Profile Velocity")
        failing("write", endpoint, "csd-mt", "Profile Velocity=1234", "Homing Method=99")
        assert out("read", endpoint, "csd-mt", "Profile Velocity") == before


def test_a_value_without_a_name_is_remarked_on() -> None:
    with simulated("az3", "rtu://pty") as endpoint:
        done = barewire("write", endpoint, "az3", "MODES OF OPERATION=77")
    assert done.returncode == 0
    assert "77 has no name in the description" in done.stderr


def test_a_link_that_was_left_over_is_replaced(tmp_path: Path) -> None:
    line = tmp_path / "line"
    line.symlink_to("/dev/pts/999999")
    with simulated("adxl", f"rtu://{line}") as endpoint:
        assert "Status" in out("read", endpoint, "adxl", "Status")


def test_a_bus_that_nobody_serves_is_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    url = f"can://socketcand/127.0.0.1:{free_port()}/can0"
    assert "connection refused" in failing("read", url, "az3", "STATUS WORD")
    # At once, for python-can is not even asked: it would try for ten seconds.
    monkeypatch.setattr(can, "Bus", lambda *_, **__: pytest.fail("python-can was asked"))
    with pytest.raises(PortError, match="connection refused"):
        CanopenClient(url)


def test_an_exception_tells_what_was_being_read() -> None:
    with simulated("adxl", "tcp://127.0.0.1:0") as endpoint:
        assert "while reading Status Word" in failing("read", endpoint, "csd-mt", "Status Word")


def test_a_terminal_without_a_degree_sign() -> None:
    environment = ENVIRONMENT | {"LC_ALL": "C", "PYTHONIOENCODING": "ascii"}
    done = subprocess.run([*COMMAND, "devices", "adxl"], capture_output=True, env=environment, check=False)
    assert done.returncode == 0
    assert b"Thyristors temperature" in done.stdout


def test_a_frame_that_is_not_valid_can_be_a_failure() -> None:
    assert barewire("explain", "rtu", "01 04", "--check").returncode == 1
    assert barewire("explain", "rtu", "01 04").returncode == 0


def test_hex_that_is_none_is_told() -> None:
    assert "hex" in failing("explain", "rtu", "01 0G").lower()


# Explaining and listing


def test_explaining_a_request() -> None:
    said = out("explain", "rtu", "01 04 0F B1 00 02 22 F8")
    for word in ("unit 1", "Read Input Registers", "0FB1h", "quantity", "CRC ok"):
        assert word in said


def test_explaining_a_response_with_a_wrong_crc() -> None:
    said = json.loads(out("explain", "rtu", "01 04 04 00 00 01 10 3B C3", "--role", "response", "--json"))
    assert said["valid"] is False
    assert said["role"] == "response"
    assert said["error"]["reason"] == "checksum"
    assert said["error"]["at"] == 7
    assert "FB D8" in said["error"]["text"]
    assert [field["length"] for field in said["fields"]] == [1, 1, 1, 2, 2, 2]


def test_the_devices_are_listed() -> None:
    listed = [json.loads(line) for line in out("devices", "--json").splitlines()]
    assert {device["name"] for device in listed} == {"az3", "adxl", "csd-mt"}
    assert "TEM AZ3" in out("devices")


@pytest.mark.parametrize("name", ["az3", "adxl", "csd-mt"])
def test_every_parameter_is_listed_with_every_field(name: str) -> None:
    keys = ["name", "type", "unit", "scale", "default", "min", "max", "access", "values", "firmware", "note"]
    rows = [json.loads(line) for line in out("devices", name, "--json").splitlines()]
    assert len(rows) >= 20
    for row in rows:
        assert list(row)[:13] == [*keys, "modbus", "object"]
        if row["modbus"]:
            assert list(row["modbus"]) == ["table", "address", "words", "half", "bit", "order"]
        if row["object"]:
            assert list(row["object"]) == ["index", "sub", "bit"]
    assert rows[0]["name"] in out("devices", name)


def test_the_demo_shows_every_wire_in_json() -> None:
    done = [json.loads(line) for line in out("demo", "--json").splitlines()]
    assert {exchange["endpoint"].partition(":")[0] for exchange in done} == {"rtu", "ascii", "tcp", "can"}
    assert {exchange["device"] for exchange in done} == {"az3", "adxl", "csd-mt"}
    assert all(frame["valid"] for exchange in done for frame in exchange["frames"])
    assert all(exchange["frames"] for exchange in done)
    states = [exchange["text"] for exchange in done if exchange["name"] == "Status Word"]
    assert "switch on disabled" in states[0]
    assert "operation enabled" in states[-1]


def test_the_version_and_the_help() -> None:
    assert out("--version").startswith("barewire")
    assert "ENDPOINT" in out("--help")
