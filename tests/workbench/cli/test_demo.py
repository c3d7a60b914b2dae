"""`barewire demo`: the story of two screens, every frame with `--all`, one object a line with `--json`."""

from __future__ import annotations

import fcntl
import json
import os
import re
import struct
import subprocess
import termios
from io import StringIO

import pytest
from rich.console import Console

from barewire.canopen import CanFrame
from barewire_workbench import explain
from barewire_workbench.cli.demo import LateFrames
from tests.workbench.cli.helpers import COMMAND, ENVIRONMENT, output_of

SCREENS = 2 * 40


def piped(*options: str, **environment: str) -> list[str]:
    """The lines of the demo when its output is no terminal; COLUMNS only as given."""
    env = {name: value for name, value in ENVIRONMENT.items() if name != "COLUMNS"} | environment
    command = [*COMMAND, "demo", *options]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, env=env, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.splitlines()


@pytest.fixture(scope="module")
def story() -> list[str]:
    return piped()


def scene(story: list[str], title: str) -> list[str]:
    """The lines below a title, up to the next empty one."""
    start = next(place for place, line in enumerate(story) if title in line)
    return story[start + 1 : story.index("", start)]


def test_the_story_has_two_screens_of_80_columns(story: list[str]) -> None:
    assert SCREENS // 2 < len(story) <= SCREENS
    assert max(map(len, story)) <= 80
    assert all(line == line.rstrip() for line in story)


@pytest.mark.parametrize(
    ("title", "protocol", "read"),
    [
        ("AZ3 servo drive on Modbus RTU", "rtu", "HEATSINK TEMPERATURE = 25 °C"),
        ("same drive on CANopen", "can", "HEATSINK TEMPERATURE = 25 °C"),
        ("ADXL soft starter on Modbus ASCII", "ascii", "Thyristors temperature = 24"),
        ("CSD MT stepper drive on Modbus TCP", "tcp", "Position Actual Value = 0 step"),
    ],
)
def test_each_wire_shows_a_value_read_and_one_written_with_their_frames(
    story: list[str], title: str, protocol: str, read: str
) -> None:
    lines = scene(story, title)
    actions = [line.split()[0] for line in lines if re.match(r"  (read|write) ", line)]
    assert actions == ["read", "write"]
    assert lines[0].startswith(f"  read  {read}")
    frames = re.findall(r"^    (sent    |received)  (.*)\n      (.*)", "\n".join(lines), re.MULTILINE)
    assert [direction.strip() for direction, _, _ in frames] == ["sent", "received"] * 2
    for direction, shown, meaning in frames:
        item: bytes | CanFrame
        if protocol == "can":
            cob_id, _, data = shown.partition("  ")
            item = CanFrame(int(cob_id, 16), bytes.fromhex(data))
        else:
            item = shown.replace(" CR LF", "\r\n").encode() if protocol == "ascii" else bytes.fromhex(shown)
        explanation = explain(protocol, item, "request" if direction == "sent    " else "response")
        assert explanation.valid
        assert explanation.summary.startswith(meaning)


def test_a_motor_moves_in_a_few_lines(story: list[str]) -> None:
    lines = [re.search(r"^  \|(.*)\| +(-?\d+) steps?, +(-?\d+) step/s$", line) for line in scene(story, "moves")]
    samples = [(int(match[2]), match[1].count("=")) for match in lines if match]
    assert 3 <= len(samples) <= 8
    assert samples == sorted(samples)
    assert samples[0] == (0, 0)
    assert samples[-1][0] == 38400
    assert any(0 < position < 38400 for position, _ in samples)


def test_a_late_answer_is_not_taken_for_the_next_one(story: list[str]) -> None:
    lines = scene(story, "late answer")
    text = "\n".join(lines)
    late = "received  01 03 04 00 00 41 C8 CB F5"
    assert re.search(
        r"NoAnswer: .*did not answer.* within 0.5 s; while reading HEATSINK TEMPERATURE", " ".join(text.split())
    )
    assert text.index("did not answer") < text.index(late) < text.index("  read  SPEED KP = 0.001")
    assert text.index(late) < text.index("sent      01 03 00 20 00 02 C5 C1")
    times = [float(line.split()[0]) for line in lines if re.search(r" s +(sent|received) ", line)]
    assert times == sorted(times)
    assert len(times) == 6


def test_the_terminal_gives_the_width_and_the_movement_stays_in_one_line() -> None:
    lines = in_a_terminal(100)
    drawn = next(line for line in lines if line.count("\r") > 5)
    positions = [int(text) for text in re.findall(r"(-?\d+) step,", drawn)]
    assert positions == sorted(positions)
    assert positions[-1] == 38400
    assert {len(part) for part in drawn.strip("\r").split("\r")} == {99}
    assert 80 < max(len(line) for line in lines if line is not drawn) <= 100


def in_a_terminal(columns: int) -> list[str]:
    """The lines of the demo on a terminal of so many columns; other programs' ends are at its end of line, CR LF."""
    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    env = {name: value for name, value in ENVIRONMENT.items() if name != "COLUMNS"} | {"TERM": "xterm"}
    output = b""
    with subprocess.Popen([*COMMAND, "demo"], stdin=theirs, stdout=theirs, stderr=theirs, env=env) as process:
        os.close(theirs)
        try:
            while data := os.read(ours, 65536):
                output += data
        except OSError:  # EIO: the last program that had it open has ended
            pass
        os.close(ours)
    assert process.returncode == 0, output.decode()
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", output.decode()).split("\r\n")


def test_all_shows_every_field_within_the_width() -> None:
    lines = piped("--all")
    assert max(map(len, lines)) <= 80
    assert "bold" not in lines[1]  # a pipe has none
    assert "A line with an arrow is one value" in " ".join(lines[:6])
    assert sum("valid: " in line for line in lines) >= 60
    assert all(line == line.rstrip() for line in lines)
    wide = piped("--all", COLUMNS="200")
    assert max(map(len, wide)) > 100
    words, wide_words = (" ".join(" ".join(text).split()) for text in (lines, wide))
    assert words.count("CRC ok") == wide_words.count("CRC ok") > 10


def test_json_shows_every_wire() -> None:
    exchanges = [json.loads(line) for line in output_of("demo", "--json").splitlines()]
    assert {exchange["endpoint"].partition(":")[0] for exchange in exchanges} == {"rtu", "ascii", "tcp", "can"}
    assert {exchange["device"] for exchange in exchanges} == {"az3", "adxl", "csd-mt"}
    assert all(frame["valid"] for exchange in exchanges for frame in exchange["frames"])
    assert all(exchange["frames"] for exchange in exchanges)
    states = [exchange["text"] for exchange in exchanges if exchange["name"] == "Status Word"]
    assert "switch on disabled" in states[0]
    assert "operation enabled" in states[-1]


def test_a_page_shows_a_diagram_of_each_wire() -> None:
    page = output_of("demo", "--format", "html")
    assert page.count('class="bw"') == 6
    assert page.count("Read Input Registers") > 2
    assert "6041h" in page


def test_two_frames_in_one_delivery_and_one_in_two_are_shown() -> None:
    output = StringIO()
    frames = LateFrames(Console(file=output, width=80))
    late, probe = bytes.fromhex("01 03 04 00 00 41 C8 CB F5"), bytes.fromhex("01 88 01 87 C0")
    frames.watch("received", late[:4])
    frames.watch("received", late[4:] + probe)
    assert re.findall(r"received  ([0-9A-F ]+[0-9A-F])  ", output.getvalue()) == [
        late.hex(" ").upper(),
        "01 88 01 87 C0",
    ]


def test_the_help_says_how_json_differs_from_the_demo() -> None:
    text = " ".join(output_of("demo", "--help").split())
    assert "--json As --all, one JSON object a line; without movement and late answer." in text
