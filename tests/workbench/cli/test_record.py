"""`barewire record`: from a recording or a live line to a file that `barewire simulate` serves."""

from __future__ import annotations

import os
import selectors
import signal
import subprocess
import time
from pathlib import Path

import pytest

from barewire import ModbusClient, NoAnswer
from barewire.io.ports.pty import PseudoTerminal
from barewire.modbus import ModbusException
from barewire.rtu import encode
from barewire_workbench.replay.unit_replay import recorded_units
from tests.helpers import unhex
from tests.workbench.cli.helpers import COMMAND, ENVIRONMENT, error_of, output_of, simulated

READ, VALUES = unhex("03 0000 0002"), unhex("03 04 0017 0007")
REFUSED = unhex("83 06")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log of two units: 7 answers, then declines after 0.3 s, then is silent; 9 answers once."""
    rows = [
        (1.0, 7, READ), (1.01, 7, VALUES), (2.0, 7, READ), (2.01, 7, VALUES), (3.0, 7, READ), (3.3, 7, REFUSED),
        (4.0, 7, READ), (6.0, 9, READ), (6.01, 9, VALUES),
    ]  # fmt: skip
    file = tmp_path / "bus.log"
    file.write_text("".join(f"{at:.3f} {encode(unit, pdu).hex(' ')}\n" for at, unit, pdu in rows))
    return file


def check_answers_of_unit_7(client: ModbusClient) -> None:
    """Check that a simulation of the log gives its first three answers: two with values, one that declines late."""
    for _ in range(2):
        assert client.read_holding_registers(0, 2) == (23, 7)
    asked = time.monotonic()
    with pytest.raises(ModbusException, match="06"):
        client.read_holding_registers(0, 2)
    assert time.monotonic() - asked >= 0.29


def test_the_recording_is_not_overwritten(log: Path, tmp_path: Path) -> None:
    before = log.read_bytes()
    link = tmp_path / "link.log"
    link.symlink_to(log)
    for command, option in (("record", "--to"), ("sniff", "--write")):
        for target in (log, link):
            error = error_of(command, str(log), option, str(target), status=2)
            assert f"{option} {target}: {log} is the same file, which would be overwritten" in error
            assert log.read_bytes() == before


def test_a_recording_becomes_a_device_and_is_served(log: Path, tmp_path: Path) -> None:
    target = tmp_path / "pump.toml"
    assert output_of("record", str(log), "--to", str(target)).splitlines() == [
        "unit 7: read holding:0-1 4 times, every 1 s: 1 exception, 1 without an answer",
        "unit 9: read holding:0-1 once",
        f"{target} written; to serve it: barewire simulate {target} ENDPOINT",
    ]
    with (
        simulated(str(target), f"rtu://{tmp_path}/line", client_option="timeout=2") as (url,),
        ModbusClient(url, unit=7) as client,
    ):
        check_answers_of_unit_7(client)
        with pytest.raises(NoAnswer):
            client.at(timeout=0.2).read_holding_registers(0, 2)
        assert client.at(unit=9).read_holding_registers(1, 1) == (7,)


@pytest.mark.parametrize("scheme", ["tcp", "udp", "rtu+tcp"])
def test_answers_take_as_long_on_every_carrier(scheme: str, log: Path, tmp_path: Path) -> None:
    target = tmp_path / "pump.toml"
    output_of("record", str(log), "--to", str(target), "--unit", "7")
    with (
        simulated(str(target), f"{scheme}://127.0.0.1:0", client_option="timeout=5") as (url,),
        ModbusClient(url, unit=7) as client,
    ):
        check_answers_of_unit_7(client)


def test_what_sniff_wrote_is_recorded_as_the_log_itself(log: Path, tmp_path: Path) -> None:
    capture = tmp_path / "bus.pcapng"
    output_of("sniff", str(log), "--write", str(capture))
    texts = [output_of("record", str(file)).splitlines()[1:] for file in (log, capture)]
    assert texts[0] == texts[1]


def test_without_a_file_the_text_is_printed(log: Path, tmp_path: Path) -> None:
    text = output_of("record", str(log), "--unit", "9")
    assert text.startswith(f"# Recorded by barewire from {log}: 1 unit, ")
    file = tmp_path / "x.toml"
    file.write_text(text)
    assert list(recorded_units(file)) == [9]


def test_a_live_line_is_recorded_until_it_is_interrupted(tmp_path: Path) -> None:
    terminal, target = PseudoTerminal(), tmp_path / "line.toml"
    command = [*COMMAND, "record", f"rtu://{terminal.path}", "--to", str(target)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT) as process:
        assert process.stderr is not None
        assert process.stdout is not None
        give_up = time.monotonic() + 120
        # Frames sent before the port is open are lost, and the first may be a response. Each exchange is printed.
        printed = b""
        with selectors.DefaultSelector() as output:
            output.register(process.stdout, selectors.EVENT_READ)
            while b"-> 23 7" not in printed and time.monotonic() < give_up:
                terminal.send(encode(1, READ))
                time.sleep(0.05)
                terminal.send(encode(1, VALUES))
                if output.select(0.1):
                    printed += os.read(process.stdout.fileno(), 4096)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 0, process.stderr.read()
    assert terminal.receive(0.0) is None
    terminal.close()
    (request,) = recorded_units(target)[1].recorded.requests
    assert (0x17, 7) in [answer.values for answer in request.answers]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--unit", "8"], "--unit 8: no request to it in "),
        (["--unit", "8"], "there are: 7, 9"),
        (["--limit", "0"], "'--limit': 0 is not in the range x>=1"),
        (["--seconds", "1"], "--seconds is for a line"),
        (["--to", "/no/such/directory/x.toml"], "/no/such/directory/x.toml: No such file or directory"),
    ],
)
def test_what_cannot_be_recorded_is_reported(arguments: list[str], text: str, log: Path) -> None:
    assert text in error_of("record", str(log), *arguments, status=1 if "--to" in arguments else 2)


def test_a_recording_without_requests_is_reported(tmp_path: Path) -> None:
    file = tmp_path / "x.log"
    file.write_text(f"1.0 {encode(7, VALUES).hex(' ')}\n2.0 00 11 22\n")
    assert "no request to a unit in it (1 frames without their request, 1 pieces of noise)" in error_of(
        "record", str(file)
    )
    assert "a CAN bus; `record` is for Modbus" in error_of("record", "can://socketcan/can0", status=2)
    file.write_text("(1.0) can0 705#05\n")
    assert "a recording of a CAN bus; `record` is for Modbus" in error_of("record", str(file), status=2)


def test_a_recorded_device_has_its_own_addresses_and_no_names(log: Path, tmp_path: Path) -> None:
    target = tmp_path / "pump.toml"
    output_of("record", str(log), "--to", str(target))
    error = error_of("simulate", str(target), "tcp://127.0.0.1:0?unit=3", status=2)
    assert "recorded units have their own addresses: 7, 9" in error
    assert "has no named values" in error_of("simulate", str(target), "tcp://127.0.0.1:0", "--set", "A=1", status=2)
    target.write_text(target.read_text().replace("values", "valus", 1))
    error = error_of("simulate", str(target), "tcp://127.0.0.1:0", status=2)
    assert "pump.toml: unit 7: request 1: answer 1: unknown key 'valus'" in error
