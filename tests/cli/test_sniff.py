"""`barewire sniff` as a person types it: on a live line, on files, and when there is nothing to listen to."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from pathlib import Path

import pytest

from barewire.ascii import encode as ascii_frame
from barewire.explain.pcapng import read
from barewire.rtu import encode as rtu_frame
from barewire.shells.pseudo_terminal import PseudoTerminal
from tests.cli.test_command import COMMAND, ENVIRONMENT, barewire, failing, out
from tests.helpers import unhex

READ, VALUES = unhex("03 0000 0002"), unhex("03 04 0017 0007")


@pytest.mark.parametrize("scheme", ["rtu", "ascii"])
def test_a_live_line_is_heard_and_never_spoken_on(scheme: str, tmp_path: Path) -> None:
    encode = rtu_frame if scheme == "rtu" else ascii_frame
    file, terminal = tmp_path / "bus.pcapng", PseudoTerminal()
    command = [*COMMAND, "sniff", f"{scheme}://{terminal.path}?parity=N", "--write", str(file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        give_up = time.monotonic() + 20
        # What is said before the port is open is lost; two packets behind the header are an exchange.
        while (not file.exists() or len(read(file.read_bytes())) < 4) and time.monotonic() < give_up:
            terminal.send(encode(1, READ))
            time.sleep(0.05)
            terminal.send(encode(1, VALUES))
            time.sleep(0.15)
        process.send_signal(signal.SIGINT)
        said = process.stdout.read().decode()
        assert process.stderr.read() == b""
        assert process.wait(10) == 0
    assert "unit 1  Read Holding Registers, 2 from 0000h -> 23 7, after " in said
    assert terminal.receive(0.0) is None
    terminal.close()
    assert "Read Holding Registers, 2 from 0000h -> 23 7" in out("sniff", str(file))


def test_it_ends_by_itself() -> None:
    terminal = PseudoTerminal()
    assert out("sniff", f"rtu://{terminal.path}?parity=N", "--seconds", "0.2") == ""
    terminal.close()


def test_a_file_goes_through_a_capture_unchanged(tmp_path: Path) -> None:
    log, file = tmp_path / "bus.log", tmp_path / "bus.pcapng"
    frames = [(1.0, READ), (1.1, VALUES), (2.0, unhex("06 0001 0003")), (2.1, unhex("86 02")), (4.0, READ)]
    log.write_text("\n".join(f"{at} {rtu_frame(1, pdu).hex(' ')}" for at, pdu in frames) + "\n9.0 FF 00 55\n")
    first = out("sniff", str(log), "--json", "--write", str(file))
    second = out("sniff", str(file), "--json")
    events = [[json.loads(line) for line in text.splitlines()] for text in (first, second)]
    assert [event["event"] for event in events[0]] == [
        *("request", "response") * 2,
        *("request", "unanswered", "noise"),
    ]
    assert [event["event"] for event in events[1]] == [event["event"] for event in events[0]]
    assert events[1][:4] == events[0][:4]


def test_what_cannot_be_listened_to(tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.write_bytes(b"\xff\xfe\x00")
    assert "neither a capture nor text" in failing("sniff", str(broken))
    assert "No such file" in failing("sniff", str(tmp_path / "nothing"))
    assert "listening in needs a line" in failing("sniff", "tcp://127.0.0.1:1")
    assert "--seconds is for a line" in failing("sniff", str(broken), "--seconds", "1")
    assert "expected seconds, above 0" in failing("sniff", "rtu:///dev/null", "--window", "0")
    broken.write_text("01 03")
    assert "No such file" in failing("sniff", str(broken), "--write", str(tmp_path / "no" / "where"))
    assert barewire("sniff").returncode == 2
