"""The labs of the course: a right answer is right in any notation, a wrong one gets a hint that is not the answer."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from barewire import CanopenServer, ModbusServer
from barewire.devices.sim import simulator
from barewire.rtu.crc import crc16
from barewire_workbench.cli.labs import LABS
from barewire_workbench.cli.labs.model import Lab
from barewire_workbench.cli.labs.real_line import HEAT_PUMP_LOG
from barewire_workbench.cli.labs.repair import LIVE_UNIT, RECORDINGS, recording_text
from tests.helpers import every_case, part_or_whole
from tests.workbench.cli.helpers import run_here

RIGHT: dict[str, tuple[str, ...]] = {
    "1.1": ("104", "0.104 ms", "104,17 µs"),
    "1.2": ("0 1011 0010 1",),
    "1.3": ("53h", "0x53", "S"),
    "1.4": ("960 bytes/s",),
    "1.5": ("6", "06h"),
    "2.1": ("1 1 0 1",),
    "2.3": ("573 us", "0,573"),
    "2.4": ("05", "0C", "FF"),
    "2.5": ("c3h",),
    "3.1": ("0x01,0x04,0x0f,0xb1,0x00,0x02", "01040FB1000222F8", "01 04 0F B0 00 03"),
    "3.2": ("24,5 °C", "24.5 C"),
    "3.3": ("01 03 00 00 00 01",),
    "3.4": ("01 04 0F B1 00 02 00 00", "00 04 0F B1 00 02 23 29"),
    "4.1": ("82e7", "05 0A 82 E7"),
    "4.3": ("4.01", "4010 us"),
    "4.4": ("1750us",),
    "4.5": ("2.5 ms, 1.2 ms",),
    "5.1": ("39h",),
    "5.2": (": 01 06 00 07 00 2A C8", r":01060007002AC8\r\n"),
    "5.3": ("000700000006 01040FB10002",),
    "5.4": ("0008", "0x8"),
    "6.2": ("0x186A0",),
    "6.3": ("cdab",),
    "6.4": ("bfc0 0000",),
    "6.5": ("6Bh", "0x006B"),
    "7.1": ("185h", "0x185"),
    "7.2": ("00000 1 000 1111",),
    "7.3": ("58ah",),
    "7.4": ("605 40 41 60 00 00 00 00 00", "605#43.41.60.00.00.00.00.00"),
    "7.5": ("0x1270", "4720"),
    "8.1": ("000#0200", "000 02 05"),
    "8.2": ("Stopped",),
    "8.4": ("−2500",),
    "8.5": ("205 0F 00 DC 05 00 00",),
    "9.1": ("Switched-On",),
    "9.2": ("0x0F", "1F", "15"),
    "9.3": ("01 10 00 9A 00 01 02 00 06", "01 06 00 9A 00 06 29 E7"),
    "9.4": ("605#2B40600016000000",),
    "10.2": ("LATE",),
    "11.1": ("02 03 2B D3 00 14",),
    "11.2": ("20 and 2", "2, 14h"),
    "11.3": ("13h",),
    "11.4": ("0x11",),
    "11.5": ("software flow control", "xonxoff"),
}
"""Right answers beside the solution of the exercise: other notations of it, or others that are right."""

WRONG: list[tuple[str, str, str]] = [
    ("1.1", "1042", "the time of a whole character"),
    ("1.1", "52 us", "19231 of them"),
    ("1.1", "soon", "is not a time"),
    ("1.1", "0", "endlessly many"),
    ("1.2", "0 0100 1101 1", "the highest one first"),
    ("1.2", "10110010", "8 levels; a character of 8N1 has 10"),
    ("1.2", "1 1011 0010 1", "as the idle line is"),
    ("1.2", "0 1011 0010 0", "a stop bit is 1"),
    ("1.2", "0 1111 0010 1", "a receiver reads these levels as 4Fh"),
    ("1.2", "levels", "expected bits"),
    ("1.3", "CA", "from left to right"),
    ("1.3", "54", "the levels of 54h would be 0 0 0 1"),
    ("1.3", "1A6", "more than a byte"),
    ("1.3", "11001010", "these are eight bits"),
    ("1.4", "1200", "the 8 data bits only"),
    ("1.4", "1000", "10000 bits a second"),
    ("1.5", "01", "0 0 1 1 0 0"),
    ("2.1", "0010", "odd parity"),
    ("2.1", "1100", "80h = 10000000b has 1 one"),
    ("2.1", "110", "3 bits"),
    ("2.2", "1", "an even number"),
    ("2.2", "7", "1 to 4"),
    ("2.3", "0.417 ms", "the time of 8 bits"),
    ("2.3", "1 ms", "19.2 bits"),
    ("2.4", "02", "differs in 1 bit:"),
    ("2.4", "03", "nothing was damaged"),
    ("2.4", "100", "is no byte"),
    ("2.5", "43", "that is what was sent"),
    ("2.5", "86", "the levels are 0 1 1 0 0 0 0 1 1 1"),
    ("3.1", "01 03 0F B1 00 02", "is Read Holding Registers: the table says input"),
    ("3.1", "01 04 0F B2 00 02", "this reads 2 from 0FB2h (4018)"),
    ("3.1", "02 04 0F B1 00 02", "a request to unit 2"),
    ("3.1", "01 04 0F B1", "as unit 01"),
    ("3.1", "01 04 0F BG", "'G' at 10 is not a hexadecimal digit"),
    ("3.1", "01 04 0F B1 00 7F", "expected 1..125"),
    ("3.2", "245", "the raw value"),
    ("3.2", "24", "00 00 00 F5"),
    ("3.3", "01 04 0F B1 00 02", "the device answers 01 04 04"),
    ("3.3", "01 04 0F B1 00 00", "expected 1..125"),
    ("3.4", "01 04 0F B1 00 02 22 F8", "unit 1 answers"),
    ("4.1", "E7 82", "its low byte goes first"),
    ("4.1", "F7", "1 bytes; a CRC has 2"),
    ("4.1", "11 11", "is not the CRC"),
    ("4.1", "7F 43", "the first byte alone"),
    ("4.2", "01 04 0F B1 00 02 22 F9", "not valid either: CRC"),
    ("4.2", "01 04 0F B1 00 03 E3 38", "it differs from the damaged one in"),
    ("4.2", "01 04 0F B1", "4 bytes; the damaged frame has 8"),
    ("4.3", "1.72", "t1.5"),
    ("4.3", "3.65", "10 bits a character"),
    ("4.3", "9", "7.9 characters"),
    ("4.4", "0.334", "the standard fixes another time"),
    ("4.5", "1.2 2.5", "it ends no frame"),
    ("4.5", "2.5 0.5", "it is allowed inside a frame"),
    ("4.5", "2.5", "1 pauses"),
    ("4.5", "3 1.2", "none of the pauses"),
    ("5.1", "C7", "the sum of the bytes"),
    ("5.1", "38", "missing to FFh"),
    ("5.1", "22F8", "must be 00"),
    ("5.2", "01060007002AC8", "begins with a colon"),
    ("5.2", ":01060007002AC7", "read as the LRC"),
    ("5.2", ":01060007002A", "does not fit the 5 bytes before it"),
    ("5.2", ":01060007002BC7", "a good frame, but it says"),
    ("5.2", ":010600G7002AC8", "not valid"),
    ("5.3", "00 07 00 00 00 08 01 04 0F B1 00 02 22 F8", "the last two bytes are a CRC"),
    ("5.3", "00 01 00 00 00 06 01 04 0F B1 00 02", "the transaction number is 1"),
    ("5.3", "00 07 00 00 00 05 01 04 0F B1 00 02", "length"),
    ("5.4", "7", "function code 04"),
    ("5.4", "1", "no frame has this"),
    ("6.1", "65336", "without a sign"),
    ("6.1", "200", "is not FF 38"),
    ("6.2", "2258632705", "in order CDAB"),
    ("6.2", "34465", "the first register counts 65536"),
    ("6.3", "ABCD", "hardly a temperature"),
    ("6.3", "AB", "expected one of ABCD"),
    ("6.4", "00 00 BF C0", "in order CDAB"),
    ("6.4", "3F C0 00 00", "that is 1.5"),
    ("6.4", "BF C0", "2 bytes; two registers have 4"),
    ("6.5", "40108", "the printed number"),
    ("6.5", "108", "counted from 0"),
    ("6.5", "8", "the first digit names the table"),
    ("7.1", "605", "605h is 11000000101. At bit 1"),
    ("7.1", "585", "At bit 1 of"),
    ("7.1", "100", "none of the three"),
    ("7.2", "0 00000001111", "without stuff bits"),
    ("7.2", "00000 0 000 1111", "the first 5 levels are right"),
    ("7.2", "1", "the start bit, which is 0"),
    ("7.2", "00000 1 000 1111 0", "what follows is too much"),
    ("7.3", "60A", "the COB-ID of the request"),
    ("7.3", "590", "the answer of node 16"),
    ("7.3", "18A", "TPDO1 of node 10"),
    ("7.4", "605#4060410000000000", "the low byte of the index goes first"),
    ("7.4", "605#2B41600000000000", "to read, it begins with the bits 010"),
    ("7.4", "601#4041600000000000", "is node 1; the drive is node 5"),
    ("7.4", "585#4041600000000000", "is SDO answer"),
    ("7.4", "605#40416000", "4 bytes of data"),
    ("7.4", "605#4040600000000000", "this reads 6040h:00"),
    ("7.4", "read it", "expected a CAN frame"),
    ("7.5", "7012h", "reads the bytes as Modbus would"),
    ("7.5", "1", "2 of the last 4 bytes"),
    ("7.6", "605#23FF6000000005DC", "the low byte goes first"),
    ("7.6", "605#2BFF6000DC050000", "an i32 has 4"),
    ("7.6", "605#40FF600000000000", "to write up to 4 bytes"),
    ("7.6", "605#2360FF00DC050000", "this writes FF60h:00"),
    ("8.1", "000#0501", "is not an NMT command"),
    ("8.1", "000#0206", "this stops node 6"),
    ("8.1", "000#0105", "start"),
    ("8.1", "000#8105", "reset node"),
    ("8.1", "605#0105", "is not an NMT command"),
    ("8.2", "operational", "705#05"),
    ("8.2", "asleep", "pre-operational"),
    ("8.3", "605#2B17100001F40000", "this writes 62465 ms"),
    ("8.3", "605#23171000F4010000", "a u16 has 2"),
    ("8.3", "605#4017100000000000", "the task asks to write 1017h:00"),
    ("8.4", "4294964796", "without a sign"),
    ("8.4", "1022820351", "reads the high byte first"),
    ("8.4", "1591", "the next four"),
    ("8.5", "205#000F000005DC", "control word 0F00h"),
    ("8.5", "205#0F00", "16 bits and 32 bits are 6"),
    ("8.5", "185#0F00DC050000", "200h + 5"),
    ("9.1", "fault", "would be 0008h; here they are 0003h"),
    ("9.1", "on", "expected one of"),
    ("9.2", "0007", "0007h is switch on: switched on"),
    ("9.2", "six", "is not a number"),
    ("9.3", "01 06 00 9A 00 07", "the drive is switch on disabled after it"),
    ("9.3", "01 06 9A 00 00 06", "this writes register 39424"),
    ("9.3", "01 03 00 9A 00 01", "there is function 06"),
    ("9.4", "605#2340600006000000", "a u16 has 2"),
    ("9.4", "605#2B40600000060000", "0600h is"),
    ("9.4", "605#4040600000000000", "the control word is object 6040h:00"),
    ("9.5", "tcp://127.0.0.1:1", "expected rtu:// or can://"),
    ("9.5", "rtu:///nosuch", "the drive was not read"),
    ("9.5", "here", "expected tcp://"),
    ("10.1", "drop", "with drop one would see requests without any answer"),
    ("10.1", "broken", "expected one of"),
    ("10.2", "flip", "a CRC that does not fit"),
    ("10.3", "19200", "the rate of the recorder"),
    ("10.3", "4800", "explain the first line"),
    ("10.4", "tcp://127.0.0.1:1", "expected rtu://"),
    ("10.4", "rtu:///nosuch", "nosuch"),
    ("11.1", "02 03 28 FF", "that begins as a response does"),
    ("11.1", "00 14 BD EB", "as a request that is not valid"),
    ("11.1", "02 03 2B D4", "do not stand one behind the other"),
    ("11.2", "1 2", "asks it itself"),
    ("11.2", "2 3", "no frame has it"),
    ("11.2", "2 2", "that is one of them, twice"),
    ("11.2", "2", "1 numbers"),
    ("11.3", "26", "the byte count of the response"),
    ("11.3", "14", "the CRC of 02 03 08 47 00 14 is F7 83"),
    ("11.3", "100", "is no byte"),
    ("11.4", "04", "that byte is there"),
    ("11.5", "RTS/CTS", "wires of its own"),
    ("11.5", "parity", "most of them are"),
    ("11.5", "luck", "control characters of ASCII"),
    ("1.1", "1" * 1000, "an answer of 1000 characters"),
]

LIVE = {"9.5", "10.4"}
"""Exercises whose answer is the URL of a machine that runs."""
SOLUTIONS = {exercise.number: exercise.solution for lab in LABS.values() for exercise in lab.exercises}


def checked(number: str, answer: str) -> tuple[int, str]:
    run = run_here("lab", number.partition(".")[0], "check", number, answer)
    assert run.stderr == "", run.stderr
    return run.returncode, " ".join(run.stdout.split())


def test_every_exercise_has_answers_here() -> None:
    numbers = {exercise.number for lab in LABS.values() for exercise in lab.exercises}
    assert RIGHT.keys() <= numbers
    assert {number for number, _, _ in WRONG} == numbers


@every_case(
    ("number", "answer"),
    [
        *((number, solution) for number, solution in SOLUTIONS.items() if number not in LIVE),
        *((number, answer) for number, row in RIGHT.items() for answer in row),
    ],
)
def test_a_right_answer(number: str, answer: str) -> None:
    status, text = checked(number, answer)
    assert (status, text[: len(number) + 8]) == (0, f"{number} right: "), text


@every_case(("number", "answer", "hint"), WRONG)
def test_a_wrong_answer_gets_a_hint_that_is_not_the_answer(number: str, answer: str, hint: str) -> None:
    status, text = checked(number, answer)
    assert (status, text[: len(number) + 8]) == (1, f"{number} wrong: "), text
    assert hint in text
    solution = SOLUTIONS[number]
    says_it = len(solution) > 3 and solution not in answer and solution in text
    assert not says_it or "expected one of" in text, "the hint says the answer"


NASTY = [
    *("-", "9" * 399, "-" + "9" * 300, "0x", "::", ":", "#", "605#", "605#R", "605##1AABB", "12345678#00", "605#40"),
    *("1e999", "nan", "inf", "\u0663", "\0", "01", "80", "00 00", "FF" * 190, "[1, 2", "b'", "3A 30", "rtu://", "http://x"),
    *("1 2 3 4 5 6 7 8 9", "0b1", "1/2", "\u00e4\u00f6", "can://", "605#2B", "605#4041600000000000000000"),
]  # fmt: skip


@pytest.mark.parametrize("step", part_or_whole(5, 1))
@pytest.mark.parametrize("lab", LABS.values(), ids=str)
def test_no_text_makes_a_check_fail(lab: Lab, step: int) -> None:
    """A part is every fifth text, others for each exercise: a check that fails has a form of text that it cannot read,
    which most exercises of a lab share."""
    texts = (*NASTY, *SOLUTIONS.values(), *(answer for row in RIGHT.values() for answer in row))
    for place, exercise in enumerate(lab.exercises):
        if exercise.number not in LIVE:
            for text in texts[place % step :: step]:
                assert exercise.answered(text).text


def test_an_answer_without_the_number_of_its_exercise_is_tried_on_all() -> None:
    run = run_here("lab", "3", "check", "01", "04", "0F", "B1", "00", "02")
    assert (run.returncode, run.stdout.split(":")[0]) == (0, "3.1 right")
    before = run_here("lab", "3.1", "check", "01", "04", "0F", "B1", "00", "02")
    assert before.stdout == run.stdout
    nothing = run_here("lab", "3", "check", "hello")
    assert nothing.returncode == 1
    assert nothing.stdout.startswith("wrong: this solves no exercise of lab 3")
    assert "lab 3 has no exercise 3.9" in run_here("lab", "3", "check", "3.9", "1").stdout


def test_the_list_and_one_lab_as_text_and_as_json() -> None:
    lines = run_here("lab").stdout.splitlines()
    assert [line.split()[0] for line in lines] == [*map(str, LABS), "4"]
    assert "4 h 30 min in all" in lines[-1]
    for lab in LABS.values():
        text = run_here("lab", str(lab.number)).stdout
        assert all(f"\n{exercise.number}  " in text for exercise in lab.exercises)
        shown = json.loads(run_here("lab", str(lab.number), "--json").stdout)
        assert [exercise["exercise"] for exercise in shown["exercises"]] == [one.number for one in lab.exercises]
    assert len(run_here("lab", "--json").stdout.splitlines()) == len(LABS)
    answer = json.loads(run_here("lab", "6", "check", "6.1", "-200", "--json").stdout)
    assert (answer["exercise"], answer["right"]) == ("6.1", True)


def test_the_drive_of_lab_9_is_read_through_the_url() -> None:
    machine = simulator("az3", node=5)
    with CanopenServer("can://memory/lab9?node=5", device=machine.canopen):
        url = "can://memory/lab9?node=5"
        assert "the motor has no current" in checked("9.5", url)[1]
        assert run_here("drive", url, "az3", "enable").returncode == 0
        assert "not at 3000" in checked("9.5", url)[1]
        assert run_here("drive", url, "az3", "move", "3000", "--velocity", "60000").returncode == 0
        status, text = checked("9.5", url)
    assert (status, text) == (0, "9.5 right: operation enabled, position 3000, read over can")


def test_the_line_of_lab_10_is_read_through_the_url() -> None:
    with ModbusServer("rtu://pty", {LIVE_UNIT: simulator("adxl").modbus}, faults="drop@every=5") as server:
        assert "Is it the right unit?" in checked("10.4", f"{server.url}?timeout=0.05&recovery=wait&late_window=0")[1]
        url = f"{server.url}?unit={LIVE_UNIT}&late_window=0&recovery=wait"
        assert "The unit is right; measure" in checked("10.4", f"{url}&timeout=0.1")[1]
        status, text = checked("10.4", f"{url}&timeout=0.1&retries=9")
    assert (status, text) == (0, "10.4 right: 5 readings, each one answered: Thyristors temperature = 24.5 °C")


def test_the_recordings_of_lab_10_are_written_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_here("lab", "10", "recordings").returncode == 0
    assert run_here("lab", "10", "recordings", "--json").returncode == 0, "the same text is no other file"
    assert sorted(path.name for path in tmp_path.iterdir()) == [recording.name for recording in RECORDINGS]
    Path("line-2.log").write_text("mine")
    refused = run_here("lab", "10", "recordings")
    assert refused.returncode == 2
    assert "line-2.log: there is another file of this name" in refused.stderr
    assert Path("line-2.log").read_text() == "mine"


def test_one_byte_at_one_place_makes_a_damaged_frame_of_the_real_line_good() -> None:
    received = [bytes.fromhex(line.partition("Rx: ")[2]) for line in HEAT_PUMP_LOG.splitlines() if "Rx: " in line]
    for damaged, place in ((received[1][:7], (5, 0x13)), (received[1][7:], (33, 0x11)), (received[2][8:], (3, 0x11))):
        places = ((at, byte) for at in range(len(damaged) - 1) for byte in range(256))
        good = [(at, byte) for at, byte in places if _is_good(damaged[:at] + bytes([byte]) + damaged[at:])]
        assert good == [place]


def _is_good(frame: bytes) -> bool:
    return crc16(frame[:-2]).to_bytes(2, "little") == frame[-2:]


def test_a_recording_shows_its_fault() -> None:
    flipped, late, other_rate = (recording_text(recording).splitlines()[1:] for recording in RECORDINGS)
    assert len(flipped) == len(late) == len(other_rate) == 24
    assert other_rate[0].split(maxsplit=1)[1] != flipped[0].split(maxsplit=1)[1]
