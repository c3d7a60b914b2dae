"""`barewire sniff` as a person types it: on a live line, on files, and when there is nothing to listen to."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import time
from pathlib import Path

import pytest

from barewire.ascii import encode as ascii_frame
from barewire.canopen import CanFrame
from barewire.explain.capture.pcapng import read_packets
from barewire.io.canopen.socketcand import SocketcandHub
from barewire.io.endpoint import Endpoint
from barewire.io.ports.pty import PseudoTerminal
from barewire.io.ports.python_can import CanPort
from barewire.rtu import encode as rtu_frame
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
        # What is said before the port is open is lost. Two packets behind the header are an exchange; a few more, for
        # the machine may stand still within one.
        while (not file.exists() or len(read_packets(file.read_bytes())) < 10) and time.monotonic() < give_up:
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
    for content, why in ((b"", "the file is empty"), (b"host7\n", "a hexadecimal digit"), (b"\xff\x00", "nor text")):
        broken.write_bytes(content)
        said = failing("sniff", str(broken))
        assert said.startswith(f"barewire: {broken}: ")
        assert why in said
        assert "expected a recording: pcapng, pcap, candump, ASC, BLF, or lines of bytes" in said
        assert f"barewire: {broken}: not a recording of CAN: expected candump" in failing("explain", "can", str(broken))
    assert "No such file" in failing("sniff", str(tmp_path / "nothing"))
    assert "listening in needs a line" in failing("sniff", "tcp://127.0.0.1:1")
    assert "--seconds is for a line" in failing("sniff", str(broken), "--seconds", "1")
    assert "expected seconds, above 0" in failing("sniff", "rtu:///dev/null", "--window", "0")
    broken.write_text("01 03")
    assert "No such file" in failing("sniff", str(broken), "--write", str(tmp_path / "no" / "where"))
    assert barewire("sniff").returncode == 2


# CAN -------------------------------------------------------------------------------------------------------------

EXCHANGE = """\
(1.000000) can0 705#00
(1.100000) can0 605#4041600000000000
(1.101200) can0 585#4B41600037060000
what is this
(1.200000) can0 205#0F00A8610000
(1.200000) can1 705#06
"""


def test_a_recording_of_can(tmp_path: Path) -> None:
    log = tmp_path / "bus.log"
    log.write_text(EXCHANGE)
    said = out("sniff", str(log), "--device", "az3", "--node", "5")
    assert "1.101200  node 5    SDO         upload 6041h:00 STATUS WORD -> 1591 (ready to switch on" in said
    assert "RPDO1       CONTROL WORD = 15 (" in said
    assert "UNREAD      line 4: " in said
    assert "HEARTBEAT-STATE" in said
    events = [json.loads(line) for line in out("sniff", str(log), "--json", "--bus", "can0").splitlines()]
    assert [event["event"] for event in events] == ["node", "sdo", "unread", "pdo", "summary"]
    assert events[1] | {"data": "3706", "index": 0x6041, "outcome": "done", "bus": "can0"} == events[1]
    assert out("sniff", str(log), "--only", "violation").count("\n") == 1


def test_what_is_known_may_be_an_eds(tmp_path: Path) -> None:
    eds, log = tmp_path / "drive.eds", tmp_path / "bus.log"
    assert barewire("eds", "export", "az3", str(eds)).returncode == 0
    log.write_text(EXCHANGE)
    said = out("sniff", str(log), "--device", str(eds), "--node", "5")
    assert "upload 6041h:00 STATUS WORD -> 1591" in said
    assert "RPDO1       CONTROL WORD = 15, TARGET VELOCITY = 25000" in said


@pytest.mark.parametrize("name", ["again.pcapng", "again.log"])
def test_a_recording_goes_through_another_form_unchanged(name: str, tmp_path: Path) -> None:
    log, again = tmp_path / "bus.log", tmp_path / name
    log.write_text(EXCHANGE.replace("what is this\n", ""))
    first = out("sniff", str(log), "--json", "--all", "--write", str(again))
    assert out("sniff", str(again), "--json", "--all") == first


def test_a_live_bus_is_heard_and_never_spoken_on(tmp_path: Path) -> None:
    """Over socketcand, in another process: what the listener hears, and that nobody hears the listener."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    hub = SocketcandHub("127.0.0.1", port)
    url, file = f"can://socketcand/127.0.0.1:{port}/can0", tmp_path / "bus.log"
    speaker = CanPort(Endpoint.parse(url))
    command = [*COMMAND, "sniff", url, "--write", str(file), "--device", "az3", "--node", "5"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        give_up = time.monotonic() + 20
        while (not file.exists() or file.read_bytes().count(b"\n") < 4) and time.monotonic() < give_up:
            speaker.send(CanFrame.parse("605#4041600000000000"))
            speaker.send(CanFrame.parse("585#4B41600037060000"))
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        said = process.stdout.read().decode()
        assert process.stderr.read() == b""
        assert process.wait(10) == 0
    assert "SDO         upload 6041h:00 STATUS WORD -> 1591 (ready to switch on" in said
    assert "SUMMARY" in said
    assert speaker.receive(0.1) is None
    speaker.close()
    hub.close()
    assert "STATUS WORD" in out("sniff", str(file), "--device", "az3", "--node", "5")


def test_options_that_do_not_fit(tmp_path: Path) -> None:
    log, modbus = tmp_path / "bus.log", tmp_path / "modbus.log"
    log.write_text(EXCHANGE)
    modbus.write_text("1.0 01 03 00 00 00 02 C4 0B\n")
    assert "--only rubbish: expected one of sdo, gap" in failing("sniff", str(log), "--only", "rubbish")
    assert "give a --device for each" in failing("sniff", str(log), "--node", "5")
    assert "expected 1..127" in failing("sniff", str(log), "--device", "az3", "--node", "128")
    assert "has no CANopen" in failing("sniff", str(log), "--device", "adxl")
    assert "No such file" in failing("sniff", str(log), "--device", "no.eds", "--node", "5")
    assert "--device is for a CAN bus" in failing("sniff", str(modbus), "--device", "az3")
    assert "python-can" in failing("sniff", "can://nothing/can0") or "nothing" in failing("sniff", "can://nothing/can0")
    done = barewire("sniff", str(log), "--bus", "can7")
    assert done.stderr == "barewire: --bus can7: no frames on it, but on can0, can1\n"
    assert done.returncode == 1
    log.write_bytes(b"LOGG")
    assert "UNREAD" in out("sniff", str(log))


def test_explain_on_recordings_and_with_names(tmp_path: Path) -> None:
    log = tmp_path / "bus.log"
    log.write_text(
        EXCHANGE + "(1.3) can0 605#C600210007000000\n(1.4) can0 585#A40021007F000000\n(1.5) can0 605#8100010203040506\n"
    )
    said = out("explain", "can", str(log), "--device", "az3", "--node", "5")
    assert "valid: SDO answer from node 5: initiate upload, 6041h:00 STATUS WORD, 2 bytes: 0637h" in said
    assert "valid: RPDO1 to node 5: CONTROL WORD = 15 (" in said
    assert "605#8100010203040506  valid: SDO request to node 5: segment 1 of a block, the last" in said
    assert "    1.200000  node 6    VIOLATION" not in said
    assert "UNREAD      line 4: " in said
    assert barewire("explain", "can", str(log), "--check").returncode == 1
    lines = [json.loads(line) for line in out("explain", "can", str(log), "--json").splitlines()]
    assert [line["frame"] for line in lines if "frame" in line and "fields" in line][1] == "605#4041600000000000"
    sdo = tmp_path / "sdo.log"
    sdo.write_text(
        "(1.0) can0 605#4041600000000000\n(1.1) can0 585#4B41600037060000\n(1.2) can0 585#4108100004000000\n"
    )
    first, second, third, *_ = out("explain", "can", str(sdo), "--device", "az3", "--node", "5").splitlines()
    assert first.endswith("SDO request to node 5: initiate upload, 6041h:00 STATUS WORD")
    assert "initiate upload, 6041h:00 STATUS WORD, 2 bytes: 0637h, 1591 (ready to switch on, " in second
    assert third.endswith("initiate upload, 1008h:00")  # which the description does not have
    rows = out("explain", "can", "585#4B41600037060000", "--device", "az3", "--node", "5").splitlines()
    assert rows[2].split() == ["1", "41", "60", "index", "6041h", "STATUS", "WORD"]
    assert "1591 (ready to switch on, " in rows[4]
    one = out("explain", "can", "205#0F00A8610000", "--device", "az3", "--node", "5")
    assert "TARGET VELOCITY" in one
    assert "not valid: 6 bytes are mapped, here are 2" in out(
        "explain", "can", "205#0F00", "--device", "az3", "--node", "5"
    )
    assert "CAN FD frame" in out("explain", "can", "123##1AABB")
    assert "controller problem: receive buffer overrun" in out("explain", "can", "20000004#0001000000000000")
    assert "--device is for can" in failing("explain", "rtu", "01", "--device", "az3")
