"""`barewire read` and `barewire write` on every wire, `--timing`, and a response that comes after the time-out."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from barewire import ModbusServer, Table
from barewire.devices.sim import simulator
from barewire.io.ports.pty import PseudoTerminal
from barewire.modbus import WriteSingleRegister, WriteSingleRegisterResponse
from barewire.modbus.messages.base import Response
from barewire.rtu import crc16
from tests.helpers import every_case, free_port
from tests.workbench.cli.helpers import (
    COMMAND,
    ENVIRONMENT,
    error_of,
    output_of,
    read_until,
    run_command,
    run_here,
    simulated,
    simulated_at,
)

# Every wire


@pytest.mark.parametrize("scheme", ["rtu", "ascii"])
def test_a_simulated_adxl_on_a_pseudo_terminal(scheme: str, tmp_path: Path) -> None:
    with simulated_at("adxl", f"{scheme}://{tmp_path}/line") as endpoint:
        name, _, value = output_of("read", endpoint, "adxl", "Thyristors temperature").strip().partition(" = ")
        assert name == "Thyristors temperature"
        assert value.endswith("°C")
        assert 10 < float(value.split()[0]) < 60
        written = output_of("write", endpoint, "adxl", "Motor start command=1")
        assert written == "Motor start command = 1 (execute), written\n"
        status = read_until(endpoint, "adxl", "Status", "ramp")
        assert "Starter ready" not in status


def test_a_simulated_csd_mt_over_tcp() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        assert "switch on disabled" in output_of("read", endpoint, "csd-mt", "Status Word")
        steps = (("0x6", "ready to switch on"), ("7", "switched on"), ("15", "operation enabled"))
        for word, state in steps:
            # Written again until it is accepted: the high voltage comes half a second after the process.
            read_until(endpoint, "csd-mt", "Status Word", state, "write", endpoint, "csd-mt", f"Control Word={word}")


def test_the_same_names_of_the_az3_on_both_its_wires(tmp_path: Path) -> None:
    names = ("STATUS WORD", "SPEED KP", "PROFILE ACCELERATION")
    with simulated_at("az3", f"rtu://{tmp_path}/az3?parity=E") as endpoint:
        over_rtu = output_of("read", endpoint, "az3", *names)
        assert over_rtu == output_of("read", endpoint, "az3", *names)  # opening it again with parity works as well
    with simulated_at("az3", f"can://socketcand/127.0.0.1:{free_port()}/can0?node=5") as endpoint:
        over_can = output_of("read", endpoint, "az3", *names)
        assert output_of("write", endpoint, "az3", "TARGET VELOCITY=-250").startswith("TARGET VELOCITY = -250")
        assert output_of("read", endpoint, "az3", "target velocity").startswith("TARGET VELOCITY = -250")
    assert over_rtu == over_can


def test_a_value_as_json() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0?unit=3") as endpoint:
        fields = json.loads(output_of("read", endpoint, "csd-mt", "Position Actual Value", "--json"))
    assert fields == {"name": "Position Actual Value", "value": 0, "unit": "step", "text": "0 step"}


# What is written, and what is refused


def test_a_value_out_of_range_names_the_range() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        assert "expected -2..37" in error_of("write", endpoint, "csd-mt", "Homing Method=99", status=2)
        assert "read only" in error_of("write", endpoint, "csd-mt", "Status Word=1", status=2)
        assert "expected a number" in error_of("write", endpoint, "csd-mt", "Homing Method=fast", status=2)


def test_nothing_is_written_if_a_later_value_is_wrong() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        before = output_of("read", endpoint, "csd-mt", "Profile Velocity")
        error_of("write", endpoint, "csd-mt", "Profile Velocity=1234", "Homing Method=99", status=2)
        assert output_of("read", endpoint, "csd-mt", "Profile Velocity") == before


def test_a_refused_write_names_the_value_and_those_already_written() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        error = error_of("write", endpoint, "csd-mt", "Profile Velocity=5", "Current Ratio=121", "--force")
        assert error.endswith("to function 06; while writing Current Ratio; written before that: Profile Velocity\n")
        assert "expected 28524\n" in error_of("write", endpoint, "csd-mt", "Restore All Default Parameters=0", status=2)
        assert output_of("write", endpoint, "csd-mt", "Current Ratio=070").startswith("Current Ratio = 70 %, written")


def test_a_value_without_a_name_is_written_with_a_note() -> None:
    with simulated_at("az3", "rtu://pty") as endpoint:
        done = run_here("write", endpoint, "az3", "MODES OF OPERATION=77")
    assert done.returncode == 0
    assert "77 has no name in the description" in done.stderr


def test_a_write_that_the_device_does_not_answer_is_reported_as_sent() -> None:
    with simulated_at("adxl", "tcp://127.0.0.1:0", client_option="timeout=1") as endpoint:
        assert output_of("write", endpoint, "adxl", "Save and reboot=5").startswith(
            "Save and reboot = 5 (execute), sent: the device does not answer it"
        )


def test_a_part_of_a_register_is_reported_as_read_changed_and_written_back() -> None:
    with simulated_at("az3", "rtu://pty") as endpoint:
        first, second = output_of("write", endpoint, "az3", "BRAKE 1 POW VALUE=50", "POLARITY=1").splitlines()
    assert first == "BRAKE 1 POW VALUE = 50 %, written: its register was read, changed and written back"
    assert second == "POLARITY = 1, written"


def test_a_name_that_is_written_twice_is_written_in_order() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        assignments = ("Profile Velocity=1000", "Control Word=6", "Control Word=0")
        rows = [
            json.loads(line) for line in output_of("write", endpoint, "csd-mt", *assignments, "--json").splitlines()
        ]
    assert [(row["name"], row["value"], row["how"]) for row in rows] == [
        ("Profile Velocity", 1000, "written"),
        ("Control Word", 6, "written"),
        ("Control Word", 0, "written"),
    ]


def test_a_device_whose_byte_order_was_changed() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        output_of("write", endpoint, "csd-mt", "Little Endian / Big Endian=0")
        output_of("write", endpoint, "csd-mt?order=ABCD", "Profile Velocity=70000")
        velocity = output_of("read", endpoint, "csd-mt?order=ABCD", "Profile Velocity")
        assert velocity == "Profile Velocity = 70000 step/s\n"
        assert "position 300" in output_of("drive", endpoint, "csd-mt?order=ABCD", "move", "300", "--enable")
    assert "expected ?order= and one of ABCD" in error_of("devices", "csd-mt?order=X", status=2)
    assert "a simulated device has its own byte order" in error_of(
        "simulate", "csd-mt?order=ABCD", "tcp://127.0.0.1:0", status=2
    )


# --timing


@pytest.mark.parametrize("option", [["--timing"], []])
def test_timing_is_printed_on_stderr_if_requested(option: list[str]) -> None:
    with simulated_at("adxl", "rtu://pty?baudrate=19200&parity=E") as url:
        done = run_here("read", *option, f"{url}&latency=uart", "adxl", "Status")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Status")
    times = "sends after 2.01 ms of silence (t3.5), accepts pauses up to 5 ms inside a frame\n"
    assert done.stderr == (f"barewire: {url}&latency=uart {times}" if option else "")


def test_timing_is_printed_before_the_port_is_opened() -> None:
    done = run_here("write", "rtu:///dev/nothing?latency=tunnel&baudrate=9600", "az3", "CONTROL WORD=6", "--timing")
    assert done.returncode == 1
    first, second = done.stderr.splitlines()
    assert first.endswith("sends after 4.01 ms of silence (t3.5), accepts pauses up to 200 ms inside a frame")
    assert second == "barewire: /dev/nothing: no such file or directory"


def test_timing_is_that_of_the_settings_in_the_description() -> None:
    """9600 8N1 of the ADXL."""
    for command in (("read", "Status"), ("write", "Event index=0")):
        done = run_here(command[0], "rtu:///dev/nothing", "adxl", command[1], "--timing")
        assert "sends after 3.65 ms of silence" in done.stderr


def test_timing_is_refused_for_a_can_bus() -> None:
    assert "Modbus goes over tcp://" in error_of("read", "--timing", "can://virtual/x", "az3", "STATUS WORD", status=2)


# A response after the time-out of its command


def _serve_late(terminal: PseudoTerminal, stop: threading.Event) -> None:
    """Answer in order, the first time after 1.5 s. Every register holds its own address."""
    delay = 1.5
    while not stop.is_set():
        request = terminal.receive(0.1)
        if not request:
            continue
        address, quantity = int.from_bytes(request[2:4], "big"), int.from_bytes(request[4:6], "big")
        if request[1] == 4:
            data = b"".join((address + place).to_bytes(2, "big") for place in range(quantity))
            body = request[:2] + bytes([len(data)]) + data
        else:
            body = bytes([request[0], request[1] | 0x80, 1])
        time.sleep(delay)
        delay = 0.0
        terminal.send(body + crc16(body).to_bytes(2, "little"))


def _unanswered(words: tuple[str, ...]) -> str:
    """The errors of a command whose second word is the device, at a line where nothing answers."""
    terminal = PseudoTerminal()
    try:
        command, *rest = words
        done = run_command(command, f"rtu://{terminal.path}?timeout=1.5", *rest)
    finally:
        terminal.close()
    assert done.returncode == 1
    return done.stderr


def test_a_command_without_a_response_states_all_that_it_waited_for_and_can_wait_less() -> None:
    read, write = ("read", "adxl", "Status"), ("write", "adxl", "Motor start command=1")
    drive, watch = ("drive", "az3", "status"), ("watch", "adxl", "Status", "--count", "1")
    every = [(*words, *option) for words in (read, write, drive, watch) for option in ((), ("--no-wait",))]
    with ThreadPoolExecutor(len(every)) as pool:
        error = dict(zip(every, pool.map(_unanswered, every)))
    within = "unit 1 did not answer Read Input Registers within 1.5 s; while reading Status"
    waited = r"waited [0-3]\.\d s more for a late response"
    assert re.fullmatch(
        rf"barewire: {within}; {waited}, which the next command could take for its own \(--no-wait: do not wait\)\n",
        error[read],
    )
    assert error[*read, "--no-wait"] == f"barewire: {within}\n"
    for words in (write, drive):
        assert re.fullmatch(rf"barewire: .* within 1\.5 s.*; {waited}, which .*\n", error[words])
        assert re.fullmatch(r"barewire: .* within 1\.5 s.*\n", error[*words, "--no-wait"])
        assert "waited" not in error[*words, "--no-wait"]
    assert re.match(f"barewire: {waited}, which ", error[watch])
    assert error[*watch, "--no-wait"] == ""
    # On TCP a late response is recognized by its number: there is nothing to wait for.
    with socket.create_server(("127.0.0.1", 0)) as silent:
        tcp = error_of("read", f"tcp://127.0.0.1:{silent.getsockname()[1]}?timeout=1.5", "adxl", "Status")
        assert tcp == f"barewire: {within}\n"


@pytest.mark.parametrize(
    ("command", "sent"),
    [
        ("read adxl Status", signal.SIGINT),
        ("watch adxl Status", signal.SIGINT),  # with a status of its own
        ("drive csd-mt status", signal.SIGTERM),
        pytest.param("read adxl Status", signal.SIGTERM, marks=pytest.mark.proof),
        pytest.param("watch adxl Status", signal.SIGTERM, marks=pytest.mark.proof),
        pytest.param("drive csd-mt status", signal.SIGINT, marks=pytest.mark.proof),
    ],
)
def test_a_signal_while_a_response_is_missing_ends_the_command_at_once(command: str, sent: signal.Signals) -> None:
    """The time-outs are longer than the test waits: nothing but the signal ends the command in time."""
    name, *rest = command.split()
    status = 1 if (name, sent) == ("watch", signal.SIGINT) else 128 + sent  # 1: no poll succeeded
    terminal = PseudoTerminal()
    words = [*COMMAND, name, f"rtu://{terminal.path}?timeout=600", *rest]
    try:
        with subprocess.Popen(words, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT) as process:
            try:
                while not terminal.receive(0.1):
                    assert process.poll() is None
                process.send_signal(sent)
                error = process.communicate(timeout=60)[1]
            finally:
                process.kill()
    finally:
        terminal.close()
    if (name, sent) == ("read", signal.SIGTERM):
        assert (process.returncode, error) == (-sent, "")  # not handled: `read` has nothing to tidy up
    else:
        text = "interrupted before a response that the next command could take for its own"
        assert (process.returncode, error.strip()) == (status, f"barewire: {text}")  # click ends the line after ^C


def test_a_late_response_does_not_reach_the_next_command() -> None:
    terminal, stop = PseudoTerminal(), threading.Event()
    unit = threading.Thread(target=_serve_late, args=(terminal, stop))
    unit.start()

    def read(name: str, timeout: float) -> subprocess.CompletedProcess[str]:
        command = [*COMMAND, "read", f"rtu://{terminal.path}?timeout={timeout}", "adxl", name, "--no-check"]
        return subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, timeout=30, check=False)

    try:
        first = read("L1 current", 0.7)
        assert "did not answer" in first.stderr
        second = read("L2 current", 20.0)
        assert second.stdout == f"L2 current = {(9 * 65536 + 10) / 10000} A\n"
    finally:
        stop.set()
        unit.join()
        terminal.close()


def test_a_forced_write_says_what_the_device_has_then() -> None:
    """The word of these bits can be written, so no error comes, and the drive keeps the bits of its state."""
    with simulated_at("az3", f"can://socketcand/127.0.0.1:{free_port()}/can0") as endpoint:
        printed = output_of(
            "write", endpoint, "az3", "READY TO SWITCH ON=on", "TARGET TORQUE=5", "--force"
        ).splitlines()
        assert printed == [
            "READY TO SWITCH ON = on, written: its object was read, changed and written back, but the device has off",
            "TARGET TORQUE = 5 ‰ of rated torque, written",
        ]


def test_a_range_of_addresses_is_a_value_for_each() -> None:
    with simulated("table", "tcp://127.0.0.1:0") as (endpoint,):
        output_of("write", endpoint, "raw", "holding:1=7", "coil:3=on")
        assert output_of("read", endpoint, "raw", "holding:0-2", "holding:0-3:u32", "coil:3-4").splitlines() == [
            "holding:0 = 0",
            "holding:1 = 7",
            "holding:2 = 0",
            "holding:0:u32 = 7",
            "holding:2:u32 = 0",
            "coil:3 = on",
            "coil:4 = off",
        ]
        lines = output_of("watch", endpoint, "raw", "holding:0-1", "--count", "1")
        assert "holding:0 = 0; holding:1 = 7" in lines


# Everything at once


def test_all_values_of_a_machine_in_each_form() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        lines = output_of("read", endpoint, "csd-mt", "--all").splitlines()
        rows = output_of("read", endpoint, "csd-mt", "--all", "--csv").splitlines()
        objects = output_of("read", endpoint, "csd-mt", "*velocity*", "--json").splitlines()
        settings = output_of("read", endpoint, "csd-mt", "--group", "homing", "--access", "rw").splitlines()
    assert len(lines) > 100
    assert rows[0] == "name,value,unit,text,error"
    assert len(rows) == len(lines) + 1
    assert "Profile Velocity" in {json.loads(line)["name"] for line in objects}
    assert settings[0].startswith("Homing Method = ")


def test_what_a_reading_changes_is_read_by_its_name_only() -> None:
    """Then `--all` of a whole machine ends with status 0. The text of an event moves the index to the next one."""
    with ModbusServer("tcp://127.0.0.1:0", {1: simulator("adxl").modbus}) as server:
        done = run_here("read", f"{server.url}?timeout=30", "adxl", "--all")
        assert (done.returncode, done.stderr.count("\n")) == (0, 1)
        assert "Event description =" not in done.stdout
        assert "Events counter =" in done.stdout
        for text in ("'Parameter value' (it is that of the menu", "'Event description' (each reading moves"):
            assert text in done.stderr
        assert "Event description = " in output_of(
            "read", f"{server.url}?timeout=30", "adxl", "event*", "Event description"
        )


def test_a_setting_behind_a_menu_is_refused_with_the_names_that_read_it() -> None:
    with ModbusServer("tcp://127.0.0.1:0", {1: simulator("adxl").modbus}) as server:
        url = f"{server.url}?timeout=30"
        for command, name in (("read", "p08.01 node address"), ("write", "P08.01 node address=2")):
            text = error_of(command, url, "adxl", name, status=2)
            assert "P08.01 node address is behind a menu" in text
        selection, value = re.findall(r'write ((?:"[^"]+"[ ,]+)+).*then read or write "(.+)"', text)[0]
        assert output_of("write", url, "adxl", *re.findall(r'"([^"]+)"', selection)).count("written") == 3
        assert output_of("read", url, "adxl", value) == "Parameter value = 1\n"


def test_a_refused_register_of_a_range_costs_only_itself() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        run = run_here("read", endpoint, "raw", "holding:1000-1003", "--csv")
    assert run.returncode == 1
    rows = run.stdout.splitlines()[1:]
    assert [row.partition(",")[0] for row in rows] == [f"holding:{address}" for address in range(1000, 1004)]
    assert ["exception 02" in row for row in rows] == [True, False, False, True]
    assert run.stderr == "barewire: 2 of 4 values were not read\n"


def test_numbers_of_a_manual_are_read_and_written() -> None:
    with simulated_at("csd-mt", "tcp://127.0.0.1:0") as endpoint:
        assert output_of("read", endpoint, "raw", "41002") == output_of("read", endpoint, "raw", "holding:1001")
        assert output_of("write", endpoint, "raw", "hr:1080=70").startswith("holding:1080 = 70, written")
        assert output_of("read", endpoint, "raw", "41081-41081").startswith("holding:1080 = 70")
        hint = "; if 41002 is the number in the manual, the address is holding:1001"
        assert error_of("read", endpoint, "raw", "holding:41002").rstrip().endswith(hint)
        assert hint in run_here("read", endpoint, "raw", "holding:1001", "holding:41002").stdout


# Before and after a write


def test_another_machine_is_named_before_anything_is_read_or_written() -> None:
    with simulated_at("adxl", "tcp://127.0.0.1:0") as endpoint:
        text = error_of("read", endpoint, "az3", "STATUS WORD")
        assert "unit 1 is not az3: it says server ID" in text
        assert text.endswith("(adxl: LOVATO Electric ADXL soft starter); --no-check goes on\n")
        for command in (
            ("write", endpoint, "az3", "CONTROL WORD=6"),
            ("watch", endpoint, "csd-mt", "Status Word", "--count", "1"),
            ("drive", endpoint, "csd-mt", "enable"),
        ):
            assert "(adxl: LOVATO" in error_of(*command)
        # What is read without asking: a number that means nothing.
        assert output_of("read", endpoint, "az3", "STATUS WORD", "--no-check") == "STATUS WORD = 0 (no bit set)\n"
        assert "exception" in error_of("drive", endpoint, "csd-mt", "quick-stop")  # goes out without a question


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (
            ("rtu:///dev/nothing", "az3", "BRAKE 1 POW VALUE=50", "TARGET VELOCITY=-5"),
            """BRAKE 1 POW VALUE = 50 %, would be written: raw 32 to the high byte of holding:265; its register is \
read, changed and written back
TARGET VELOCITY = -5 User units, would be written: raw FFFB FFFF to holding:156-157
would send  01 03 01 09 00 01 55 F4  valid: a request to unit 1, Read Holding Registers, 1 from 0109h; CRC ok
would send  01 10 00 9C 00 02 04 FF FB FF FF BA C3  valid: a request to unit 1, Write Multiple Registers, 2 from \
009Ch; CRC ok
""",
        ),
        (
            ("tcp://127.0.0.1:1?unit=3", "raw", "coil:7=on", "holding:8=1", "holding:8=2"),
            """coil:7 = on, would be written: raw 1 to coil:7
holding:8 = 1, would be written: raw 0001 to holding:8
would send  00 01 00 00 00 06 03 05 00 07 FF 00  valid: a request to unit 3, Write Single Coil, on to 0007h; \
transaction 1
would send  00 02 00 00 00 06 03 06 00 08 00 01  valid: a request to unit 3, Write Single Register, 1 to 0008h; \
transaction 2
holding:8 = 2, would be written: raw 0002 to holding:8
would send  00 01 00 00 00 06 03 06 00 08 00 02  valid: a request to unit 3, Write Single Register, 2 to 0008h; \
transaction 1
""",
        ),
        (
            ("can://memory/nothing?node=3", "az3", "TARGET VELOCITY=-5"),
            """TARGET VELOCITY = -5 User units, would be written: raw FB FF FF FF to object:60FFh
would send  603#23FF6000FBFFFFFF  valid: SDO request to node 3: initiate download, 60FFh:00 TARGET VELOCITY, \
4 bytes: FFFFFFFBh, -5 User units
""",
        ),
    ],
    ids=["rtu", "tcp", "can"],
)
def test_a_dry_run_shows_values_words_and_frames_and_opens_no_port(arguments: tuple[str, ...], expected: str) -> None:
    assert output_of("write", *arguments, "--dry-run", "--frames") == expected


def test_a_dry_run_checks_values_and_has_fields() -> None:
    write = ("write", "tcp://127.0.0.1:1", "csd-mt", "--dry-run")
    assert "expected -2..37" in error_of(*write, "Homing Method=99", status=2)
    assert "has no address on Modbus" in error_of(
        "write", "tcp://127.0.0.1:1", "az3", "IQRMSX10=1", "--force", "--dry-run", status=2
    )
    fields = json.loads(output_of(*write, "Profile Velocity=1234", "--json"))
    assert (fields["raw"], fields["address"], fields["value"]) == ("04D2 0000", "holding:1044-1045", 1234)


class Interrupting(Table):
    """A table that interrupts a process instead of answering the request with this number, counted from 1."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number, self.requests = number, 0
        self.process: subprocess.Popen[str] | None = None

    def handle(self, request: Any, now: float) -> Response | None:
        self.requests += 1
        if self.requests < self.number:
            return super().handle(request, now)
        assert self.process is not None
        self.process.send_signal(signal.SIGINT)
        return None

    def interrupt(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run a command, and end it if nothing interrupts it."""
        pipe = subprocess.PIPE
        with subprocess.Popen([*COMMAND, *words], stdout=pipe, stderr=pipe, text=True, env=ENVIRONMENT) as self.process:
            try:
                out, error = self.process.communicate(timeout=60)
            finally:
                self.process.kill()
        return subprocess.CompletedProcess(words, self.process.returncode, out, error)


@every_case(
    ("number", "out", "error"),
    [
        (2, "", "each may be written or not: holding:2, holding:4"),
        (4, "holding:2 = 7, written; the device has it\n", "written, and perhaps not read back: holding:2, holding:4"),
    ],
)
def test_an_interrupted_write_says_what_was_written(number: int, out: str, error: str) -> None:
    unit = Interrupting(number)
    with ModbusServer("tcp://127.0.0.1:0", {1: unit}) as server:
        done = unit.interrupt("write", f"{server.url}?timeout=600", "raw", "holding:2=7", "holding:4=8", "--verify")
    assert (done.returncode, done.stdout, done.stderr.strip()) == (130, out, f"barewire: interrupted; {error}")


class _Stubborn(Table):
    """A table that confirms every write, and keeps the values of its odd addresses."""

    def handle(self, request: Any, now: float) -> Response | None:
        if isinstance(request, WriteSingleRegister) and request.address % 2:
            return WriteSingleRegisterResponse(request.address, request.value)
        return super().handle(request, now)


def test_what_was_written_is_read_back_and_a_difference_is_the_status() -> None:
    with ModbusServer("tcp://127.0.0.1:0", {1: _Stubborn()}) as server:
        same = output_of("write", server.url, "raw", "holding:2=7", "holding:4:f32=0.1", "--verify")
        other = run_here("write", server.url, "raw", "holding:3=7", "holding:6=1", "--verify")
    assert same.splitlines() == [
        "holding:2 = 7, written; the device has it",
        "holding:4:f32 = 0.1, written; the device has it",
    ]
    assert other.returncode == 1
    assert other.stdout.splitlines() == [
        "holding:3 = 7, written, but the device has 0",
        "holding:6 = 1, written; the device has it",
    ]
    assert other.stderr == "barewire: 1 of 2 values are not as written\n"


def test_a_scaled_value_is_compared_as_its_raw_number(tmp_path: Path) -> None:
    (tmp_path / "device.toml").write_text(
        """name = "pump"
title = "A pump"
[modbus]
first_register = 0
[[parameter]]
name = "Pressure"
type = "u16"
access = "rw"
holding = 2
scale = "1/3"
unit = "bar"
"""
    )
    with ModbusServer("tcp://127.0.0.1:0", {1: Table()}) as server:
        written = output_of("write", server.url, str(tmp_path), "Pressure=2.3333", "--verify")
    assert written == "Pressure = 2.3333 bar, written; the device has it\n"


def test_a_value_that_cannot_be_read_back_is_refused_before_the_write() -> None:
    text = error_of("write", "tcp://127.0.0.1:1", "adxl", "Save and reboot=5", "--verify", status=2)
    assert text == "barewire: --verify: Save and reboot: it cannot be read\n"
