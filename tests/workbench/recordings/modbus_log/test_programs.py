"""Logs of real programs, in `samples/`: written by mbpoll 1.4.11, pymodbus 3.16.1 and MinimalModbus 2.1.1 against our
server; only the name of the port is changed. They read registers 5 and 6, write one, read at FFFFh, and ask unit 9,
which does not exist."""

from __future__ import annotations

from pathlib import Path

import pytest

from barewire_workbench.frames.modbus_exchanges import Exchanges
from barewire_workbench.recordings.modbus_log import UNREADABLE, LoggedBytes, read_modbus_log
from barewire_workbench.recordings.modbus_replay import replay_log
from barewire_workbench.recordings.model import Unread
from tests.helpers import every_case

SAMPLES = Path(__file__).parent / "samples"

READ = "unit 1  Read Holding Registers, 2 from 0005h -> "
WRITE = "unit 1  Write Single Register, 3 to 0007h -> done"
REFUSED = "unit 1  Read Holding Registers, 2 from FFFFh -> exception 02 (illegal data address)"
SILENT = "unit 9  Read Holding Registers, 1 from 0000h -> no answer"
ALONE = "unit 1  (request not seen) -> "


def lines_of(data: bytes) -> list[str]:
    """Return the lines of `barewire sniff`, without times."""
    events = replay_log(data).events
    lines = Exchanges(timed=False)
    return [*map(str, [line for event in events for line in lines.feed(event)] + lines.end())]


@pytest.mark.parametrize(
    ("name", "form", "protocol", "lines"),
    [
        ("mbpoll-rtu.log", "libmodbus", "rtu", [
            f"{READ}0 0", "unit 1  Write Multiple Registers, 2 from 0005h -> done", REFUSED]),
        ("mbpoll-tcp.log", "libmodbus", "tcp", [f"{READ}11 22"]),
        ("minimalmodbus-rtu.log", "MinimalModbus", "rtu", [f"{READ}11 22", WRITE, REFUSED, SILENT]),
        ("minimalmodbus-ascii.log", "MinimalModbus", "ascii", [f"{READ}11 22", WRITE, REFUSED, SILENT]),
        ("pymodbus-async-rtu.log", "pymodbus", "rtu", [f"{READ}0 0", WRITE, REFUSED, SILENT]),
        ("pymodbus-async-ascii.log", "pymodbus", "ascii", [f"{READ}0 0", WRITE, REFUSED, SILENT]),
        ("pymodbus-async-tcp.log", "pymodbus", "tcp", [
            f"{READ}0 0", WRITE, REFUSED, SILENT.replace("no answer", "0")]),
        # the blocking clients of pymodbus log what they received, and not what they sent
        ("pymodbus-rtu.log", "pymodbus", "rtu", [
            f"{ALONE}Read Holding Registers, 2 registers", f"{ALONE}Write Single Register, 3 to 0007h",
            f"{ALONE}exception 02 (illegal data address) to 03 Read Holding Registers"]),
    ],
)  # fmt: skip
def test_the_log_of_a_program(name: str, form: str, protocol: str, lines: list[str]) -> None:
    data = (SAMPLES / name).read_bytes()
    log = read_modbus_log(data)
    assert log.form == form
    assert {item.protocol for item in log.items if isinstance(item, LoggedBytes) and item.data} == {protocol}
    assert lines_of(data) == lines


@every_case("name", sorted(path.name for path in SAMPLES.iterdir() if "without" not in path.name))
def test_each_line_is_an_item_or_known(name: str) -> None:
    """No line is dropped in silence: what is no traffic is known chatter of the program, or an `Unread`."""
    data = (SAMPLES / name).read_bytes()
    log = read_modbus_log(data)
    numbers = [item.line for item in log.items]
    assert numbers == sorted(numbers)
    strange = read_modbus_log(data.rstrip() + b"\nsomething else entirely\n").items[-1]
    assert isinstance(strange, Unread)
    assert (strange.line, strange.text) == (len(data.rstrip().splitlines()) + 1, "something else entirely")


def test_times_of_a_log() -> None:
    log = read_modbus_log((SAMPLES / "pymodbus-async-rtu.log").read_bytes())
    times = [item.at for item in log.items if isinstance(item, LoggedBytes)]
    assert log.timed
    assert round(times[1] - times[0], 3) == 0.007
    assert times == sorted(times)


def test_a_silent_client_of_libmodbus() -> None:
    text = "[09][03][00][00][00][01][85][42]\nWaiting for a confirmation...\nERROR Connection timed out: select\n"
    assert lines_of(text.encode()) == [SILENT]


def test_a_server_of_libmodbus_receives_the_requests() -> None:
    text = "Waiting for an indication...\n<01><06><00><07><00><03><78><0A>\n[01][06][00][07][00][03][78][0A]\n"
    log = read_modbus_log(text.encode())
    assert [item.from_client for item in log.items if isinstance(item, LoggedBytes)] == [True, False]


def test_pymodbus_of_other_versions() -> None:
    old = [
        "2023-02-26 19:03:11.610 DEBUG (SyncWorker_1) [pymodbus.transaction] SEND: 0x1 0x4 0x0 0xc 0x0 0x2 0xb1 0xc8",
        '2023-02-26 19:03:11.611 DEBUG (SyncWorker_1) [pymodbus.client.base] New Transaction state "SENDING"',
        "2023-02-26 19:03:11.668 DEBUG (SyncWorker_1) [pymodbus] RECV: 0x1 0x4 0x4 0x43 0xc9 0xaa 0x46 0xc1 0x6c",
        "2023-02-26 19:03:11.668 DEBUG (SyncWorker_1) [pymodbus.framer.rtu_framer] Getting Frame - 0x4 0x4 0x43 0xc9",
    ]
    assert lines_of("\n".join(old).encode()) == ["unit 1  Read Input Registers, 2 from 000Ch -> 17353 43590"]
    middle = [
        "2024-04-07 22:26:30.764 DEBUG (MainThread) [pymodbus.logging] send: 0xb 0x3 0x0 0x30 0x0 0x1 0x84 0xaf",
        "2024-04-07 22:26:30.780 DEBUG (MainThread) [pymodbus.logging] recv: 0xb 0x3 0x2 old_data:  addr=None",
        "2024-04-07 22:26:30.784 DEBUG (MainThread) [pymodbus] recv: 0x0 0x0 0x20 0x45 old_data: 0xb 0x3 0x2 addr=None",
    ]
    assert lines_of("\n".join(middle).encode()) == ["unit 11  Read Holding Registers, 1 from 0030h -> 0"]
    pieces = ["Processing: 0xb 0x3 0x2", "Processing: 0xb 0x3 0x2 0x0 0x0 0x20 0x45"]
    assert lines_of("\n".join(pieces).encode()) == ["unit 11  (request not seen) -> Read Holding Registers, 1 register"]


def test_old_minimalmodbus_writes_strings() -> None:
    text = (
        "MinimalModbus debug mode. Writing to instrument (expecting 5 bytes back): "
        "'\\x01\\x03\\x00\\x05\\x00\\x02\\xd4\\n'\n"
        "MinimalModbus debug mode. Response from instrument: '\\x01\\x83\\x02\\xc0\\xf1' (01 83 02 C0 F1) (5 bytes), "
        "roundtrip time: 50.0 ms. Timeout setting: 50.0 ms.\n"
    )
    assert lines_of(text.encode()) == [REFUSED.replace("FFFFh", "0005h")]


def test_an_answer_that_pymodbus_could_not_decode_is_no_silence() -> None:
    cut = b"SEND: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb\nRECV: 0x1 0x3 0x4 0x0\n[Input/Output] No Response received\n"
    assert [item.data for item in read_modbus_log(cut).items if isinstance(item, LoggedBytes)] == [
        bytes.fromhex("01 03 00 00 00 02 C4 0B"),
        bytes.fromhex("01 03 04 00"),
    ]


def test_the_answer_in_an_error_of_minimalmodbus_and_what_pymodbus_handles_are_read() -> None:
    wrong = rb"Wrong functioncode: 3 instead of 16. The response is: '\x01\x03\x00\x00\x00\x10D\x06'"
    handled = b"pymodbus Handling data: 0x1 0x83 0x2 0xc0 0xf1"
    for line, data in ((wrong, "01 03 00 00 00 10 44 06"), (handled, "01 83 02 C0 F1")):
        assert [item.data for item in read_modbus_log(line).items if isinstance(item, LoggedBytes)] == [
            bytes.fromhex(data)
        ]


@every_case(
    ("text", "pieces"),
    [
        # both words show the same read; the second one with what was received before
        ("Handling data: 0x1 0x83 0x2 0xc0 0xf1\nProcessing: 0x1 0x83 0x2 0xc0 0xf1\n" * 2, ["01 83 02 c0 f1"] * 2),
        (
            "Handling data: 0x1 0x83\nProcessing: 0x1 0x83\nHandling data: 0x2 0xc0 0xf1\n"
            "Processing: 0x1 0x83 0x2 0xc0 0xf1\n",
            ["01 83 02 c0 f1"],
        ),
        # several loggers print one event; the same request some time later is another one
        (
            "10:00:00,045 DEBUG send: 0x1 0x3 0x0 0x0 0x0 0x1 0x84 0xa\n" * 3
            + "10:00:00.046 DEBUG [pymodbus] send: 0x1 0x3 0x0 0x0 0x0 0x1 0x84 0xa\n"
            + "10:00:01,045 DEBUG send: 0x1 0x3 0x0 0x0 0x0 0x1 0x84 0xa\n",
            ["01 03 00 00 00 01 84 0a"] * 2,
        ),
        (
            "10:00:01 DEBUG send: 0x1 0x3 0x0 0x0 0x0 0x1 0x84 0xa\n" * 2,
            ["01 03 00 00 00 01 84 0a"] * 2,
        ),
        # and prints what it received as unexpected, too
        (
            "10:00:00,045 DEBUG recv: 0x1 0x83 0x2 0xc0 0xf1 extra data:\n"
            "10:00:00,046 DEBUG extra: unexpected data: 0x1 0x83 0x2 0xc0 0xf1\n"
            "10:00:00.045 DEBUG [pymodbus] recv: 0x1 0x83 0x2 0xc0 0xf1 extra data:\n",
            ["01 83 02 c0 f1"],
        ),
    ],
)
def test_what_pymodbus_prints_twice_is_one_frame(text: str, pieces: list[str]) -> None:
    items = [item for item in read_modbus_log(text.encode()).items if isinstance(item, LoggedBytes)]
    assert [item.data.hex(" ") for item in items] == pieces


@every_case("colour", ["\x1b[0m", "#033[0m", "^[[0m", "\\e[36m"])
def test_colours_of_a_terminal_are_no_bytes(colour: str) -> None:
    log = read_modbus_log(f"{colour}recv: 0x1 0x83 0x2 0xc0 0xf1{colour}\n".encode())
    assert [item.data.hex() for item in log.items if isinstance(item, LoggedBytes)] == ["018302c0f1"]


def test_a_line_with_two_times_holds_no_bytes() -> None:
    text = "Aug 24 08:39:23 host 2022-08-24 08:39:23.905 DEBUG Reading register 43006\nrecv: 0x1 0x83 0x2 0xc0 0xf1\n"
    assert read_modbus_log(text.encode()).items[0][2] != UNREADABLE


def test_it_is_said_which_lines_were_printed_again() -> None:
    line = "2026-03-01 10:00:00,045 DEBUG send: 0x1 0x3 0x0 0x0 0x0 0x1 0x84 0xa\n"
    log = read_modbus_log((line * 3).encode())
    assert (len(log.items), log.notes) == (1, ("line 2: the bytes of the line before, printed again: 2 lines",))
    assert len(read_modbus_log((line + line.replace("03-01", "03-02")).encode()).items) == 2
