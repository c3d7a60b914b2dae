"""`barewire diagnose`: recordings, standard input, live lines and buses; its output and exit status."""

from __future__ import annotations

import json
import signal
import subprocess
import threading
from pathlib import Path

import pytest

from barewire.canopen import CanFrame
from barewire.io.endpoint import Endpoint
from barewire.io.ports.can.python_can import CanPort
from barewire.io.ports.pty import PseudoTerminal
from barewire.io.server.can import SocketcandHub
from barewire.rtu import encode
from tests.helpers import free_port, unhex
from tests.workbench.cli.helpers import COMMAND, ENVIRONMENT, error_of, output_of, run_here

READ, VALUES = encode(1, unhex("03 0000 0002")), encode(1, unhex("03 04 0017 0007"))


def poll(count: int, noise: bytes = b"") -> str:
    """Return a log of reads, with noise before each response."""
    lines = []
    for place in range(count):
        lines += [f"{place}.000 {READ.hex(' ')}", f"{place}.020 {(noise + VALUES).hex(' ')}"]
    return "\n".join(lines) + "\n"


def test_a_good_log_has_one_line_and_the_status_0(tmp_path: Path) -> None:
    log = tmp_path / "good.log"
    log.write_text(poll(3))
    expected = "verdict: nothing wrong [nothing-wrong]: 6 frames, 3 requests answered by 1 unit\n"
    assert output_of("diagnose", str(log)) == expected
    done = subprocess.run(
        [*COMMAND, "diagnose", "-"], input=poll(3), capture_output=True, text=True, env=ENVIRONMENT, check=False
    )
    assert (done.stdout, done.stderr, done.returncode) == (expected, "", 0)


def test_findings_come_with_their_lines_and_only_the_first_of_a_kind_unless_all_are_wanted(tmp_path: Path) -> None:
    log = tmp_path / "noisy.log"
    log.write_text(poll(8, b"\0"))
    done = run_here("diagnose", str(log))
    lines = done.stdout.splitlines()
    assert (done.returncode, done.stderr) == (1, "")
    assert lines[0] == (
        "0.020000  line 2  unit 1  1 byte of noise before a response of unit 1 [noise-before]: "
        f"00 beside the good frame {VALUES.hex(' ').upper()}"
    )
    assert lines[5:] == [
        "unit 1  3 more [noise-before]; --all shows them",
        "verdict: bias resistors are missing: noise comes before frames [no-bias]: 8 of 8 responses had 1 byte of "
        "noise before them; it may also be a transmitter that is switched on before it sends, or a missing termination",
    ]
    assert len(run_here("diagnose", str(log), "--all").stdout.splitlines()) == 9


@pytest.mark.parametrize("option", [("--json",), ("--format", "json")])
def test_as_json_every_finding_and_verdict_is_an_object(option: tuple[str, ...], tmp_path: Path) -> None:
    log = tmp_path / "noisy.log"
    log.write_text(poll(8, b"\0"))
    done = run_here("diagnose", str(log), *option)
    objects = [json.loads(line) for line in done.stdout.splitlines()]
    assert [item["event"] for item in objects] == ["finding"] * 8 + ["verdict"]
    assert objects[0] | {"proof": ""} == {
        "event": "finding",
        "at": 0.02,
        "line": 2,
        "place": "unit 1",
        "code": "noise-before",
        "text": "1 byte of noise before a response of unit 1",
        "proof": "",
    }
    assert objects[-1]["code"] == "no-bias"
    assert objects[-1]["evidence"] == "8 of 8 responses had 1 byte of noise before them"
    assert done.returncode == 1


def test_a_log_of_a_can_bus(tmp_path: Path) -> None:
    log = tmp_path / "can.log"
    frames = ["605#4341600000000000", "585#8041600001000405", "085#1042000000000000", "185#3706"]
    log.write_text("".join(f"({place}.000000) can0 {frame}\n" for place, frame in enumerate(frames)))
    done = run_here("diagnose", str(log))
    assert [line.partition("[")[2].partition("]")[0] for line in done.stdout.splitlines()] == [
        *("sdo-read-command", "emcy-register", "nothing-proved"),
    ]
    assert done.stdout.startswith("1.000000  line 2  node 5  43h is how a server answers; a read request is 40h")
    known = run_here("diagnose", str(log), "--device", "az3", "--node", "5").stdout
    assert "TPDO1 of node 5 has 2 bytes, " in known
    assert "there are frames on can0" in error_of("diagnose", str(log), "--bus", "can7")


def test_lines_that_hold_no_frame_are_named(tmp_path: Path) -> None:
    log = tmp_path / "mixed.log"
    log.write_text(f"send: {READ.hex(' ')}\nthe pump is on\nrecv: {VALUES.hex(' ')}\n")
    done = run_here("diagnose", str(log))
    assert done.stderr == "barewire: 1 line holds no frame, the first is line 2: the pump is on\n"
    assert (done.stdout.count("\n"), done.returncode) == (1, 0)
    unread = json.loads(output_of("diagnose", str(log), "--json").splitlines()[0])
    assert (unread["event"], unread["line"]) == ("unread", 2)


def test_what_is_no_recording_is_refused_in_one_line(tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.write_text("host7\n")
    assert f"barewire: {broken}: " in error_of("diagnose", str(broken))
    broken.write_text("")
    assert "is empty" in error_of("diagnose", str(broken))
    assert "No such file" in error_of("diagnose", str(tmp_path / "nothing"))
    broken.write_text(poll(1))
    assert "--bus is for a CAN bus" in error_of("diagnose", str(broken), "--bus", "x", status=2)


@pytest.mark.long
def test_a_live_line_is_diagnosed_until_ctrl_c() -> None:
    terminal = PseudoTerminal()
    command = [*COMMAND, "diagnose", f"rtu://{terminal.path}?parity=N", "--all"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT) as process:
        assert process.stdout is not None
        stop = threading.Event()

        def send() -> None:
            while not stop.is_set():
                for data in (READ, b"\0" + VALUES):
                    terminal.send(data)
                    stop.wait(0.04)

        thread = threading.Thread(target=send)
        thread.start()
        findings = [process.stdout.readline().decode() for _ in range(6)]
        stop.set()
        thread.join()
        process.send_signal(signal.SIGINT)
        rest = process.stdout.read().decode()
        assert process.wait(60) == 1
    assert all("of noise before a response of unit 1 [noise-before]: 00" in line for line in findings)
    assert "verdict: bias resistors are missing: noise comes before frames [no-bias]: " in rest
    assert terminal.receive(0.0) is None
    terminal.close()


@pytest.mark.long
def test_a_silent_line_is_no_good_one() -> None:
    terminal = PseudoTerminal()
    done = run_here("diagnose", f"rtu://{terminal.path}?parity=N", "--seconds", "0.2")
    assert (done.stdout, done.returncode) == ("verdict: undecided: nothing was received [nothing-heard]: no byte\n", 1)
    terminal.close()


@pytest.mark.long
def test_a_live_bus_is_diagnosed_and_nothing_is_sent() -> None:
    port = free_port()
    hub = SocketcandHub("127.0.0.1", port)
    url = f"can://socketcand/127.0.0.1:{port}/can0"
    sender = CanPort(Endpoint.parse(url))
    command = [*COMMAND, "diagnose", url, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT) as process:
        assert process.stdout is not None
        stop = threading.Event()

        def send() -> None:
            while not stop.wait(0.05):
                sender.send(CanFrame.parse("085#1042000000000000"))

        thread = threading.Thread(target=send)
        thread.start()
        first = json.loads(process.stdout.readline())
        stop.set()
        thread.join()
        process.send_signal(signal.SIGINT)
        rest = process.stdout.read().decode()
        assert process.wait(60) == 1
    assert (first["code"], first["place"]) == ("emcy-register", "node 5")
    assert json.loads(rest.splitlines()[-1])["code"] == "nothing-proved"
    assert sender.receive(0.1) is None
    sender.close()
    hub.close()


def test_a_text_that_reports_no_failure_is_no_recording(tmp_path: Path) -> None:
    text = tmp_path / "notes.txt"
    text.write_text("a shopping list\n")
    assert "expected a recording" in error_of("diagnose", str(text))


def test_a_text_without_bytes_ends_with_its_verdict_and_status_1(tmp_path: Path) -> None:
    text = tmp_path / "error.txt"
    text.write_text("pymodbus.exceptions.ConnectionException: Modbus Error: [Connection] Failed to connect\n")
    done = run_here("diagnose", str(text))
    assert done.returncode == 1
    assert done.stdout.startswith(
        'verdict: undecided: "Failed to connect" (line 1): the TCP connection is not made [no-bytes]: no frame is read '
    )


def test_bytes_between_words_are_read_and_it_is_said_why(tmp_path: Path) -> None:
    text = tmp_path / "posted.txt"
    text.write_text("17:40:53 DMP: 01 03 04 00 17 00\n17:40:53 DBG: response error 8\n")
    done = run_here("diagnose", str(text))
    assert done.returncode == 1
    assert "line 1: read as bytes: bytes in one notation" in done.stderr
    assert "[cut-frame]" in done.stdout
    text.write_text("The answer is `01 83 02 C0 F1`, the error is mine. " + "More words. " * 10_000)
    assert "expected a recording" in error_of(
        "diagnose", str(text)
    )  # too long for a text in which bytes are looked for


def test_words_about_an_error_do_not_hide_bytes_that_are_read(tmp_path: Path) -> None:
    log = tmp_path / "read.log"
    log.write_text(poll(1) + "\nerror: modbus timeout in 01 02 03 04 05 06\n")
    assert "[no-bytes]" not in run_here("diagnose", str(log)).stdout


def test_digits_of_a_message_are_no_bytes_of_a_line(tmp_path: Path) -> None:
    text = tmp_path / "error.txt"
    text.write_text("Error in plugin: modbus: response transaction id '7616' does not match request '7617'\n")
    assert "each answer has the number of the request before" in run_here("diagnose", str(text)).stdout


@pytest.mark.parametrize("words", ["", "The meter answers nothing at all:\n"])
def test_what_else_it_may_be_is_left_out_for_a_text_with_words(tmp_path: Path, words: str) -> None:
    log = tmp_path / "posted.txt"
    log.write_text(
        words
        + "".join(
            f"12:00:0{2 * place}.5 Tx: {READ.hex(' ')}\n12:00:0{2 * place + 1}.5 timed out\n" for place in range(4)
        )
    )
    verdict = run_here("diagnose", str(log)).stdout.splitlines()[-1]
    assert "[no-answers]" in verdict
    assert ("it may also be" in verdict) is (not words)


def test_a_log_of_good_frames_with_a_message_of_a_failure_is_not_called_good_as_a_whole(tmp_path: Path) -> None:
    log = tmp_path / "said.txt"
    log.write_text(f"ERROR connection reset by peer\nTx: {READ.hex(' ')}\nRx: {VALUES.hex(' ')}\n")
    lines = run_here("diagnose", str(log)).stdout.splitlines()
    assert lines[0].startswith(
        "verdict: undecided: the frames shown are sound, and the text tells of more [not-seen]: 2 frames"
    )
    assert "the other side reset the TCP connection" in lines[1]


def test_the_whole_of_a_long_title_limits_what_sound_frames_prove(tmp_path: Path) -> None:
    log = tmp_path / "posted.txt"
    title = "With two integrations at one converter, each of them with its own poll interval, one of them is crashing"
    log.write_text(f"{title}\nTx: {READ.hex(' ')}\nRx: {VALUES.hex(' ')}\n")
    assert "[not-seen]" in run_here("diagnose", str(log)).stdout
