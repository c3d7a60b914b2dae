"""`barewire sniff`: live lines and buses, recordings, and what cannot be decoded."""

from __future__ import annotations

import json
import shlex
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from barewire.ascii import encode as ascii_frame
from barewire.canopen import CanFrame
from barewire.canopen.eds import parse, to_dcf
from barewire.devices import load
from barewire.errors import PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.python_can import CanPort
from barewire.io.ports.pty import PseudoTerminal
from barewire.io.server.can import SocketcandHub
from barewire.rtu import encode as rtu_frame
from barewire_workbench.recordings.capture import read_packets
from tests.helpers import free_port, unhex
from tests.workbench.cli.helpers import (
    COMMAND,
    ENVIRONMENT,
    error_of,
    output_of,
    run_here,
)

READ, VALUES = unhex("03 0000 0002"), unhex("03 04 0017 0007")


@pytest.mark.parametrize("scheme", ["rtu", "ascii"])
def test_a_live_line_is_decoded_and_nothing_is_sent(scheme: str, tmp_path: Path) -> None:
    encode = rtu_frame if scheme == "rtu" else ascii_frame
    file, terminal = tmp_path / "bus.pcapng", PseudoTerminal()
    command = [*COMMAND, "sniff", f"{scheme}://{terminal.path}?parity=N", "--write", str(file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        give_up = time.monotonic() + 120
        # Frames sent before the port is open are lost. Two packets after the header are an exchange; a few more are
        # sent, because a computer that stands still may split one.
        while (not file.exists() or len(read_packets(file.read_bytes())) < 10) and time.monotonic() < give_up:
            terminal.send(encode(1, READ))
            time.sleep(0.05)
            terminal.send(encode(1, VALUES))
            time.sleep(0.15)
        process.send_signal(signal.SIGINT)
        text = process.stdout.read().decode()
        assert process.stderr.read() == b""
        assert process.wait(60) == 0
    assert "unit 1  Read Holding Registers, 2 from 0000h -> 23 7, after " in text
    assert terminal.receive(0.0) is None
    terminal.close()
    assert "Read Holding Registers, 2 from 0000h -> 23 7" in output_of("sniff", str(file))


def test_seconds_end_the_command() -> None:
    terminal = PseudoTerminal()
    assert output_of("sniff", f"rtu://{terminal.path}?parity=N", "--seconds", "0.2") == ""
    terminal.close()


def test_a_log_written_as_a_capture_decodes_the_same(tmp_path: Path) -> None:
    log, file = tmp_path / "bus.log", tmp_path / "bus.pcapng"
    frames = [(1.0, READ), (1.1, VALUES), (2.0, unhex("06 0001 0003")), (2.1, unhex("86 02")), (4.0, READ)]
    log.write_text("\n".join(f"{at} {rtu_frame(1, pdu).hex(' ')}" for at, pdu in frames) + "\n9.0 FF 00 55\n")
    first = output_of("sniff", str(log), "--json", "--write", str(file))
    second = output_of("sniff", str(file), "--json")
    events = [[json.loads(line) for line in text.splitlines()] for text in (first, second)]
    assert [event["event"] for event in events[0]] == [
        *("request", "response") * 2,
        *("request", "unanswered", "noise"),
    ]
    assert [event["event"] for event in events[1]] == [event["event"] for event in events[0]]
    assert events[1][:4] == events[0][:4]


def test_wrong_sources_are_refused(tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.write_bytes(b"\xff\xfe\x00")
    assert "neither a capture nor text" in error_of("sniff", str(broken))
    for content, why in ((b"", "the file is empty"), (b"host7\n", "a hexadecimal digit"), (b"\xff\x00", "nor text")):
        broken.write_bytes(content)
        text = error_of("sniff", str(broken))
        assert text.startswith(f"barewire: {broken}: ")
        assert why in text
        assert "expected a recording: pcapng, pcap, candump, ASC, BLF, a log of" in text
        assert f"barewire: {broken}: not a recording of CAN: expected candump" in error_of(
            "explain", "can", str(broken)
        )
    assert "No such file" in error_of("sniff", str(tmp_path / "nothing"))
    assert "barewire: /dev/zero: a device, not a file" in error_of("sniff", "/dev/zero")
    assert "listening in needs a line" in error_of("sniff", "tcp://127.0.0.1:1", status=2)
    assert "--seconds is for a line" in error_of("sniff", str(broken), "--seconds", "1", status=2)
    assert "expected seconds, above 0" in error_of("sniff", "rtu:///dev/null", "--window", "0", status=2)
    broken.write_text("01 03")
    assert "No such file" in error_of("sniff", str(broken), "--write", str(tmp_path / "no" / "where"))
    assert run_here("sniff").returncode == 2


def test_the_protocol_of_a_recording_can_be_stated(tmp_path: Path) -> None:
    log = tmp_path / "ascii.log"
    frames = [ascii_frame(1, READ)[5:], ascii_frame(1, READ), ascii_frame(1, VALUES)]
    log.write_text("\n".join(f"{place}.0 {frame.hex(' ')}" for place, frame in enumerate(frames)))
    assert "unit 1  Read Holding Registers" in output_of("sniff", str(log))
    assert output_of("sniff", str(log), "--protocol", "ascii") == output_of("sniff", str(log))
    assert "unit 1  Read Holding Registers" not in output_of("sniff", str(log), "--protocol", "rtu")
    assert "for a recording" in error_of("sniff", "rtu:///dev/null", "--protocol", "rtu", status=2)
    log.write_text(EXCHANGE)
    for option in (("--protocol", "rtu"), ("--window", "1"), ("--port", "1502")):
        assert f"{option[0]} is for Modbus, which {log} is not" in error_of("sniff", str(log), *option, status=2)


@pytest.mark.parametrize("kind", ["modbus", "can"])
def test_a_full_disk_is_reported_with_the_file_which_keeps_what_was_written(kind: str, tmp_path: Path) -> None:
    log = tmp_path / "bus.log"
    if kind == "modbus":
        log.write_text(
            "".join(
                f"{at}.0 {rtu_frame(1, READ).hex(' ')}\n{at}.1 {rtu_frame(1, VALUES).hex(' ')}\n" for at in range(9)
            )
        )
    else:
        log.write_text("".join(f"({at}.000000) can0 705#05\n" for at in range(30)))
    done = run_here("sniff", str(log), "--write", "/dev/full")
    assert done.returncode == 1
    assert done.stderr == "barewire: /dev/full: no space left on device; nothing was written\n"
    file = tmp_path / "bus.pcapng"
    limit = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (700, 700)); "
        "from barewire_workbench.cli import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-B", "-c", limit, "sniff", str(log), "--write", str(file)],  # -B: it would cut bytecode
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.startswith(f"barewire: {file}: file too large; it has the ")
    assert done.stderr.endswith(" frames before\n")
    kept = len(list(read_packets(file.read_bytes())))
    assert f" {kept} frames" in done.stderr
    assert 3 < kept < 18


# CAN -------------------------------------------------------------------------------------------------------------

EXCHANGE = """\
(1.000000) can0 705#00
(1.100000) can0 605#4041600000000000
(1.101200) can0 585#4B41600037060000
what is this
(1.200000) can0 205#0F00A8610000
(1.200000) can1 705#06
"""


def test_a_can_recording(tmp_path: Path) -> None:
    log = tmp_path / "bus.log"
    log.write_text(EXCHANGE)
    text = output_of("sniff", str(log), "--device", "az3", "--node", "5")
    assert "1.101200  node 5    SDO         upload 6041h:00 STATUS WORD -> 1591 (ready to switch on" in text
    assert "RPDO1       CONTROL WORD = 15 (" in text
    assert "UNREAD      line 4: " in text
    assert "HEARTBEAT-STATE" in text
    events = [json.loads(line) for line in output_of("sniff", str(log), "--json", "--bus", "can0").splitlines()]
    assert [event["event"] for event in events] == ["node", "sdo", "unread", "pdo", "summary"]
    assert events[1] | {"data": "3706", "index": 0x6041, "outcome": "done", "bus": "can0"} == events[1]
    assert output_of("sniff", str(log), "--only", "violation").count("\n") == 1


def test_a_device_without_a_node_says_whose_names_are_printed(tmp_path: Path) -> None:
    """The description of the AZ3 has the node-ID 1, a DCF has its own; --node gives another."""
    log, eds, dcf = tmp_path / "can.log", tmp_path / "az3.eds", tmp_path / "left.dcf"
    log.write_text("(0.1) can0 605#4041600000000000\n(0.2) can0 585#4B41600037060000\n")
    done = run_here("sniff", str(log), "--device", "az3")
    assert done.stderr == "barewire: --device az3: names are those of node 1; --node gives another\n"
    assert "STATUS WORD" not in done.stdout
    output_of("eds", "export", "az3", str(eds))
    dcf.write_bytes(to_dcf(parse(eds.read_bytes()), 5, {}).encode())
    done = run_here("sniff", str(log), "--device", str(dcf))
    assert "names are those of node 5" in done.stderr
    assert "STATUS WORD" in done.stdout
    assert run_here("sniff", str(log), "--device", "az3", "--node", "5").stderr == ""


def test_the_device_may_be_an_eds(tmp_path: Path) -> None:
    eds, log = tmp_path / "drive.eds", tmp_path / "bus.log"
    assert run_here("eds", "export", "az3", str(eds)).returncode == 0
    log.write_text(EXCHANGE)
    text = output_of("sniff", str(log), "--device", str(eds), "--node", "5")
    assert "upload 6041h:00 STATUS WORD -> 1591" in text
    assert "RPDO1       CONTROL WORD = 15, TARGET VELOCITY = 25000" in text


@pytest.mark.parametrize("name", ["again.pcapng", "again.log"])
def test_a_can_recording_written_in_another_format_decodes_the_same(name: str, tmp_path: Path) -> None:
    log, again = tmp_path / "bus.log", tmp_path / name
    log.write_text(EXCHANGE.replace("what is this\n", ""))
    first = output_of("sniff", str(log), "--json", "--all", "--write", str(again))
    assert output_of("sniff", str(again), "--json", "--all") == first


def test_a_live_bus_is_decoded_and_nothing_is_sent(tmp_path: Path) -> None:
    """Over socketcand, in another process. The sender receives nothing from the sniffer."""
    port = free_port()
    hub = SocketcandHub("127.0.0.1", port)
    url, file = f"can://socketcand/127.0.0.1:{port}/can0", tmp_path / "bus.log"
    sender = CanPort(Endpoint.parse(url))
    command = [*COMMAND, "sniff", url, "--write", str(file), "--device", "az3", "--node", "5"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        give_up = time.monotonic() + 120
        while (not file.exists() or file.read_bytes().count(b"\n") < 4) and time.monotonic() < give_up:
            sender.send(CanFrame.parse("605#4041600000000000"))
            sender.send(CanFrame.parse("585#4B41600037060000"))
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        text = process.stdout.read().decode()
        assert process.stderr.read() == b""
        assert process.wait(60) == 0
    assert "SDO         upload 6041h:00 STATUS WORD -> 1591 (ready to switch on" in text
    assert "SUMMARY" in text
    assert sender.receive(0.1) is None
    sender.close()
    hub.close()
    assert "STATUS WORD" in output_of("sniff", str(file), "--device", "az3", "--node", "5")


@pytest.mark.parametrize("name", ["bus.log", "bus.pcapng"])
def test_a_server_that_ends_is_an_error_and_the_file_keeps_all_frames_before(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a serial line whose adapter is unplugged. A client would connect again."""
    file, frames = tmp_path / name, [CanFrame(0x701 + number, b"\x05") for number in range(3)]

    class Port:
        def receive_any(self, timeout: float) -> CanFrame | None:
            if not frames:
                raise PortError("can://socketcand/127.0.0.1/can0: the server hung up")
            return frames.pop()

        def close(self) -> None: ...

    monkeypatch.setattr("barewire.io.ports.can.interfaces.can_port", lambda endpoint, *, stamps: Port())
    done = run_here("sniff", "can://socketcand/127.0.0.1/can0", "--write", str(file))
    assert done.returncode == 1
    assert done.stderr == (
        f"barewire: can://socketcand/127.0.0.1/can0: the server hung up; {file} has the 3 frames before\n"
    )
    assert output_of("sniff", str(file)).count("heartbeat") == 3


def test_options_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    log, modbus = tmp_path / "bus.log", tmp_path / "modbus.log"
    log.write_text(EXCHANGE)
    modbus.write_text("1.0 01 03 00 00 00 02 C4 0B\n")
    assert "'rubbish': expected one of sdo, gap" in error_of("sniff", str(log), "--only", "rubbish", status=2)
    assert "give a --device for each --node" in error_of("sniff", str(log), "--node", "5", status=2)
    assert "128 is not in the range" in error_of("sniff", str(log), "--device", "az3", "--node", "128", status=2)
    assert "has no CANopen" in error_of("sniff", str(log), "--device", "adxl", status=2)
    assert "No such file" in error_of("sniff", str(log), "--device", "no.eds", "--node", "5")
    assert "--node is for a CAN bus" in error_of("sniff", str(modbus), "--node", "5", status=2)
    assert "unknown interface 'nothing'" in error_of("sniff", "can://nothing/can0", status=2)
    done = run_here("sniff", str(log), "--bus", "can7")
    assert done.stderr == "barewire: --bus can7: no frames on it; there are frames on can0, can1\n"
    assert done.returncode == 1
    log.write_bytes(b"LOGG")
    assert "UNREAD" in output_of("sniff", str(log))


def test_a_recording_as_svg_html_text_and_json(tmp_path: Path) -> None:
    log = tmp_path / "line.log"
    log.write_text(f"1.0 {rtu_frame(1, READ).hex(' ')}\n1.01 {rtu_frame(1, VALUES).hex(' ')}\n")
    assert "unit 1" in output_of("sniff", str(log), "--format", "svg")
    assert "after 10.0 ms" in output_of("sniff", str(log), "--format", "html")
    assert output_of("sniff", str(log), "--format", "json") == output_of("sniff", str(log), "--json")
    assert "1.000000    |-------------->|" in output_of("sniff", str(log), "--picture", "sequence")


def test_the_states_of_a_drive_in_a_recording(tmp_path: Path) -> None:
    log = tmp_path / "bus.log"
    log.write_text("(1.0) can0 605#4041600000000000\n(1.1) can0 585#4B41600031020000\n")
    assert "status  0231h   ready to switch on" in output_of("sniff", str(log), "--picture", "states")
    assert "no status word" in error_of("sniff", str(log), "--picture", "states", "--device", "az3", "--node", "6")


def test_standard_input_and_a_device(tmp_path: Path) -> None:
    text = "debug enabled\n"
    text += "[01][04][0F][B1][00][02][22][F8]\nWaiting for a confirmation...\n"
    text += "<01><04><04><00><00><01><10><FB><D8>\n"
    command = [*COMMAND, "sniff", "-", "--device", "adxl", "--unit", "1"]
    done = subprocess.run(command, input=text.encode(), capture_output=True, timeout=60, check=True)
    line = "unit 1  Read Input Registers, 2 from 0FB1h -> Thyristors temperature = 27.2 °C\n"
    assert done.stdout.decode() == line
    shell = f"{shlex.join(COMMAND)} sniff - <&-"
    closed = subprocess.run(["sh", "-c", shell], capture_output=True, timeout=60)
    assert (closed.returncode, closed.stderr) == (1, b"barewire: -: standard input is closed\n")
    assert done.stderr.decode() == ("barewire: 1 line holds no bytes of a frame, the first is line 1: debug enabled\n")


def test_the_states_of_a_drive_on_modbus(tmp_path: Path) -> None:
    log, device = tmp_path / "line.log", load("csd-mt")
    assert device.drive is not None
    place = device.find(device.drive.status_word).modbus
    assert place is not None
    request, answer = unhex(f"03 {place.address:04X} 0001"), unhex("03 02 0231")
    log.write_text(f"1.0 {rtu_frame(1, request).hex(' ')}\n1.01 {rtu_frame(1, answer).hex(' ')}\n")
    assert "1.010000  status  0231h   ready to switch on" in output_of(
        "sniff", str(log), "--picture", "states", "--device", "csd-mt"
    )
    assert "--device NAME" in error_of("sniff", str(log), "--picture", "states")


EXCHANGES = [f"{at}.0 01 03 00 00 00 02 C4 0B\n{at}.1 01 83 02 C0 F1\n" for at in range(2, 5)]


@pytest.mark.parametrize(
    ("command", "lines", "expected"),
    [
        ("sniff", ["Tx: 01 03 00 00 00 02 C4 0B\n", "Rx: 01 83 02 C0 F1\n"], "exception 02"),
        pytest.param(
            "sniff", ["# a comment\n", "opened\n", "[01][83][02][C0][F1]\n"], "exception 02", marks=pytest.mark.proof
        ),
        pytest.param("sniff", ["(1.5) can0 705#00\n"], "boot-up", marks=pytest.mark.proof),
        ("diagnose", ["1.0 01 03 00 00 00 02 C4 0B\n", "1.1 01 83 02 C0 F1 FF FF FF FF FF\n", *EXCHANGES], "unit 1"),
        pytest.param("diagnose", ["(1.5) can0 705#01\n"], "node 5", marks=pytest.mark.proof),
    ],
)  # fmt: skip
def test_what_is_still_being_written_is_read_as_it_comes(command: str, lines: list[str], expected: str) -> None:
    with subprocess.Popen(
        [*COMMAND, command, "-"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        give_up = threading.Timer(30, process.kill)
        give_up.start()
        for line in lines:
            process.stdin.write(line)
            process.stdin.flush()
        assert expected in process.stdout.readline()  # before the end of the input
        process.stdin.close()
        process.stdout.read()
        give_up.cancel()
