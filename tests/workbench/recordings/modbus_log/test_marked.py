"""Lines with a direction and bytes: in any notation, several frames in a line, remarks behind them."""

from __future__ import annotations

import pytest

from barewire.errors import DecodeError
from barewire_workbench.recordings.modbus_log import LoggedBytes, read_modbus_log
from barewire_workbench.recordings.model import Unread
from tests.helpers import every_case, refused
from tests.workbench.recordings.modbus_log.test_programs import REFUSED, lines_of

ASKED, ANSWERED = "01 03 00 05 00 02 D4 0A", "01 03 04 00 0B 00 16 0A 3F"
DONE = ["unit 1  Read Holding Registers, 2 from 0005h -> 11 22"]


def dashed(text: str) -> str:
    return text.replace(" ", "-")


@every_case(
    ("asked", "answered"),
    [
        ("[2024-05-01 10:31:18] Send: {}", "[2024-05-01 10:31:18] Recv: {}"),
        ("2024-05-01T10:31:18.250Z INFO  sent 8 bytes: {}", "2024-05-01T10:31:18.262Z INFO  received 9 bytes: {}"),
        ("Tx:000001-{}", "Rx:000002-{}"),  # Modbus Poll
        ("000000-Tx:{}", "000001-Rx:{}"),  # Modbus Poll, older
        ("[RTU]>Tx > 14:32:05:052 - {}", "[RTU]>Rx > 14:32:05:075 - {}"),  # QModMaster
        ("14.05.2025 09:57:07.113 'Device' Tx: {} ", "14.05.2025 09:57:07.298 'Device' Rx: {} "),  # Modbus Tools
        ("05/14/2025 09:57:07.113 [TX] - {}", "05/14/2025 09:57:07.298 [RX] - {}"),  # Docklight
        ("Sending request: {}", "Received response: {}"),
        ("Request (transaction id 25): {}", "Response (transaction id 25): {}"),  # jamod
        ("Request for unit 1: {}", "Response for read request (FC=3): {}"),
        ("COM3 12:00:01.250 >> {}", "COM3 12:00:01.270 << {}"),
        ("> {}", "< {}"),
        ("(0.000) --> {}", "(0.020) <-- {}"),
        ("Master: {}", "Slave: {}"),
        ("D/modbus ( 1234): write [8 bytes] {}", "D/modbus ( 1234): read [9 bytes] {}"),
        ("2024-05-01 10:31:18.100;TX;{};8", "2024-05-01 10:31:18.130;RX;{};9"),
        ("write <Buffer {}>", "read <Buffer {}>"),  # Node.js
        ('{{"dir":"tx","hex":"{}"}}', '{{"dir":"rx","hex":"{}"}}'),
        ("[10:31:18][D][uart_debug:114]: >>> {}", "[10:31:18][D][uart_debug:114]: <<< {}"),  # ESPHome
    ],
)  # fmt: skip
@every_case(
    "notation",
    [
        str,
        str.lower,
        dashed,
        lambda text: text.replace(" ", ","),
        lambda text: text.replace(" ", ""),
        lambda text: " ".join(f"0x{byte}" for byte in text.split()),
        lambda text: ", ".join(f"0x{byte}" for byte in text.split()),
        lambda text: "".join(f"\\x{byte}" for byte in text.split()),
        lambda text: " ".join(byte.lstrip("0") or "0" for byte in text.split()),
        lambda text: "".join(f"[{byte}]" for byte in text.split()),
        lambda text: ", ".join(str(int(byte, 16)) for byte in text.split()),
        lambda text: repr(bytes.fromhex(text)),
    ],
)
def test_every_prefix_with_every_notation(asked: str, answered: str, notation) -> None:  # type: ignore[no-untyped-def]
    text = f"{asked.format(notation(ASKED))}\n{answered.format(notation(ANSWERED))}\n"
    assert lines_of(text.encode()) == DONE


def test_a_wrapped_line_continues() -> None:
    for stamp in ("", "10:00:00.5 ", "[2024-05-01 10:31:18] "):
        text = f"{stamp}Tx: 01 03 00 05\n    00 02 D4 0A\n{stamp}Rx: 01 03 04 00 0B\n    00 16 0A 3F\n"
        assert lines_of(text.encode()) == DONE


def test_a_line_of_another_form_does_not_continue() -> None:
    text = f"Tx: 01 03\n[01][03][00][05][00][02][D4][0A]\n<{ANSWERED.replace(' ', '><')}>\n"
    log = read_modbus_log(text.encode())
    assert [item.line for item in log.items] == [1, 2, 3]
    assert lines_of(text.encode())[-1:] == DONE


def test_values_are_not_frames() -> None:
    """What a program prints of its values has a direction word, too, but does not pass the line."""
    text = f"Tx: {ASKED}\nRx: {ANSWERED}\nread 2 registers: 00 0B 00 16\n"
    log = read_modbus_log(text.encode())
    assert lines_of(text.encode()) == DONE
    assert isinstance(log.items[-1], Unread)
    assert log.items[-1].line == 3


def test_tcp_is_recognised_by_its_header() -> None:
    text = "TX 00 19 00 00 00 06 01 03 00 05 00 02\nRX 00 19 00 00 00 07 01 03 04 00 0B 00 16\n"
    assert lines_of(text.encode()) == DONE
    bare = "00 19 00 00 00 06 01 03 00 05 00 02\n00 19 00 00 00 07 01 03 04 00 0B 00 16\n"
    assert lines_of(bare.encode()) == DONE


def test_ascii_frames() -> None:
    text = "Tx: :010300050002F5\\r\\nRx: :010304000B0016D7\n".replace("\\r\\nRx", "\nRx")
    assert lines_of(text.encode()) == DONE
    codes = "Tx: 3A 30 31 30 33 30 30 30 35 30 30 30 32 46 35 0D 0A\n"
    assert lines_of(codes.encode()) == ["unit 1  Read Holding Registers, 2 from 0005h -> the recording ends here"]


def test_the_recorder_is_a_server() -> None:
    text = f"Rx: {ASKED}\nTx: {ANSWERED}\n"
    assert [item.from_client for item in read_modbus_log(text.encode()).items if isinstance(item, LoggedBytes)] == [
        True,
        False,
    ]


def test_a_damaged_answer_is_part_of_its_exchange() -> None:
    """No time runs backwards, and the damaged answer is not an event of its own."""
    text = f"10:00:00.000 Tx: {ASKED}\n10:00:00.020 Rx: 01 03 04 00 0B 00 17 0A 3F\n10:00:02.000 Tx: {ASKED}\n"
    lines = lines_of(text.encode())
    assert lines[0].startswith("unit 1  Read Holding Registers, 2 from 0005h -> no valid answer: 01 03 04 00 0B 00 17 ")
    assert lines[1] == "unit 1  Read Holding Registers, 2 from 0005h -> the recording ends here"
    assert len(lines) == 2


def test_times_never_run_backwards() -> None:
    frames = [f"10:00:0{second}.000 Tx: {ASKED}" for second in (5, 6, 2, 3)]
    log = read_modbus_log("\n".join(frames).encode())
    times = [item.at for item in log.items if isinstance(item, LoggedBytes)]
    assert [at - times[0] for at in times] == [0, 1, 1, 2]
    assert log.notes == ("line 3: the times go back by 4 s; later ones are counted from there",)
    night = read_modbus_log(f"23:59:59.5 Tx: {ASKED}\n00:00:00.5 Rx: {ANSWERED}\n".encode())
    first, second = (item.at for item in night.items)
    assert (second - first, night.notes) == (1.0, ())


def test_decimal_or_hexadecimal_is_not_guessed() -> None:
    with refused(DecodeError, "line 1: hexadecimal or decimal?"):
        read_modbus_log(b"Tx: 11 22 33 44\nRx: 11 22 33 45\n")


def test_other_text_is_no_log() -> None:
    with refused(DecodeError, "line 1"):
        read_modbus_log(b"Dear all,\nwe received: ab cd ef 01\nBest regards\n")


@pytest.mark.parametrize(
    "prefix", ["COM3: {}", "2024-01-05 10:31:18,257 {}", "DATE=2015-11-05T17:31:27.977;ERR=NO;FRAME={};SLAVE=1;", "{}"]
)
def test_bytes_without_a_direction(prefix: str) -> None:
    notation = dashed if "FRAME" in prefix else lambda text: " ".join(byte.lstrip("0") or "0" for byte in text.split())
    text = f"{prefix.format(notation(ASKED))}\n{prefix.format(notation(ANSWERED))}\n"
    assert lines_of(text.encode()) == DONE


def test_a_typing_error_in_a_log_of_bytes_is_an_error() -> None:
    with refused(DecodeError, "line 2: 'X' at 3"):
        read_modbus_log(f"{ASKED}\n01 X3 04 00 0B 00 16 0A 3F\n".encode())


def test_a_wrapped_log_of_bytes() -> None:
    """The CRC proves that two lines are one frame."""
    assert lines_of(b"01 03 00 05\n00 02 D4 0A\n01 03 04 00\n0B 00 16\n0A 3F\n") == DONE
    log = read_modbus_log(b"FF 00\n01 03 00 05 00 02 D4 0A\n")
    assert [item.line for item in log.items] == [1, 2]


@pytest.mark.parametrize("mark", ["(1.1) < {}", "Recv: {}", "Rx:000002-{}", "[2024-05-01 10:31:18.250] received: {}"])
def test_a_frame_in_pieces_may_have_one_byte_in_a_line(mark: str) -> None:
    lines = [mark.format(digits) for digits in ("01", "83 02 C0 F1")]
    log = read_modbus_log("\n".join(["Send: 01 03 00 00 00 02 C4 0B", *lines, "recv timeout 10"]).encode())
    pieces = [item.data.hex() for item in log.items if isinstance(item, LoggedBytes)]
    assert pieces[-2:] == ["01", "8302c0f1"]
    assert [item.text for item in log.items if isinstance(item, Unread)] == ["recv timeout 10"]


REFUSED_1 = "01 83 02 C0 F1"
SENT, RECEIVED = "0x1 0x3 0x0 0x5 0x0 0x2 0xd4 0xa", "0x1 0x83 0x2 0xc0 0xf1"
DONE_1 = REFUSED.replace("FFFFh", "0005h")
ERROR = "2025-10-23 16:49:37.254 ERROR (MainThread) [pymodbus.logging] No response received after 3 retries, continue"


@every_case(
    "line",
    [
        f">>>>> send: {SENT} >>>>> recv: {RECEIVED} extra data: ",
        f"{ERROR} >>>>> send: {SENT} >>>>> recv: {RECEIVED} extra data: ",
        f"DEBUG:pymodbus.logging:send: {SENT} recv: {RECEIVED}",
        f"Tx: {ASKED} Rx: {REFUSED_1}",
        f"2024-05-01 10:31:18.250 Tx/Rx: TX {ASKED}, RX {REFUSED_1}",
        f"Tx/Rx: {ASKED} / {REFUSED_1}",
        f"[TX] {ASKED.replace(' ', '')} [RX] {REFUSED_1.replace(' ', '')}",
        f"-> {ASKED} <- {REFUSED_1}",
        f"{ASKED} -> {REFUSED_1}",
        f"request: {ASKED} -> response: {REFUSED_1}",
        f"request {ASKED} (8 bytes), response {REFUSED_1} (5 bytes)",
    ],
)
@every_case("times", [1, 2])
def test_an_exchange_on_one_line(line: str, times: int) -> None:
    assert lines_of("\n".join([line] * times).encode()) == [DONE_1] * times


def test_several_exchanges_on_one_line_of_pymodbus() -> None:
    line = (
        f">>>>> send: {SENT} >>>>> recv: {RECEIVED} extra data:  >>>>> send: {SENT} >>>>> recv: {RECEIVED} extra data: "
    )
    assert lines_of(line.encode()) == [DONE_1, DONE_1]


def test_what_was_unexpected_is_not_read_twice() -> None:
    text = (
        f"{ERROR}\n>>>>> send: {SENT}\n>>>>> recv: {RECEIVED} extra data: \n>>>>> extra:  unexpected data: {RECEIVED}\n"
    )
    assert lines_of(text.encode()) == [DONE_1]


@pytest.mark.parametrize(
    "line",
    [
        "DEBUG:pymodbus.logging:recv: 0x1 0x83 0xzz 0xc0 0xf1",
        f">>>>> send: {SENT} >>>>> recv: 0x1 0x83 0xzz 0xc0 0xf1",
        "the answer was 01 83 02 C0 F1, or 01 83 01 80 F0, or so",
    ],
)
def test_bytes_that_cannot_be_read_are_reported(line: str) -> None:
    log = read_modbus_log(
        f"DEBUG:pymodbus.logging:send: {SENT}\n{line}\nDEBUG:pymodbus.logging:recv: {RECEIVED}\n".encode()
    )
    reported = [(item.line, item.why) for item in log.items if isinstance(item, Unread)]
    assert reported == [(2, "the bytes in this line cannot be read")]


def test_repeated_frames_that_the_log_does_not_have_are_noted() -> None:
    text = f"DEBUG:pymodbus.logging:send: {SENT}\nDEBUG:pymodbus.logging:recv: {RECEIVED}\n"
    assert read_modbus_log(f"{text}>>>>> send: {SENT}\n".encode()).notes == ()
    (note,) = read_modbus_log(f"{text}>>>>> send: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb\n".encode()).notes
    assert note.startswith("line 3: ")


REMARKS = [
    "<- the answer",
    "<--- Good",
    "<-- 03 is right",
    "// was OK",
    "# checked",
    "; from the meter",
    "(8 registers)",
]


def read(text: str) -> list[bytes]:
    return [item.data for item in read_modbus_log(text.encode()).items if isinstance(item, LoggedBytes)]


@every_case("remark", REMARKS)
@every_case("form", ["{0} {2}\n{1}   {2}\n", "Tx: {0}  {2}\nRx: {1} {2}\n", "1.0 {0} {2}\n1.1 {1} {2}\n"])
def test_a_remark_behind_the_bytes_is_none_of_them(form: str, remark: str) -> None:
    assert lines_of(form.format(ASKED, ANSWERED, remark).encode()) == DONE


@pytest.mark.parametrize("mark", ["<-", "<--", "//", "#", ";", "("])
def test_bytes_behind_a_mark_are_not_dropped_in_silence(mark: str) -> None:
    """They may be bytes of the frame, or the bytes before may be a time: a line is read only if a CRC proves it."""
    log = read_modbus_log(f"Tx: {ASKED}\nRx: 01 03 04 00 {mark} 0B 00 16 0A 3E and more\n".encode())
    assert [type(item) for item in log.items] == [LoggedBytes, Unread]
    if mark != "#":  # of a comment
        assert read(f"Tx: {ASKED}\nRx: 01 03 04 00 {mark} 0B 00 16 0A 3F and more\n")[1:] == [bytes.fromhex(ANSWERED)]


def test_an_arrow_between_a_time_and_bytes_is_a_direction() -> None:
    assert read(f"10.50 -> {ASKED}\n10.60 <- {ANSWERED}\n") == [bytes.fromhex(ASKED), bytes.fromhex(ANSWERED)]


@pytest.mark.parametrize(
    "end", ["{} bytes", "> {} bytes", ", {} byte", "] {} Bytes", "({} bytes)", "[{} bytes]", "({})"]
)
def test_a_count_of_bytes_behind_them_is_not_one_of_them(end: str) -> None:
    text = f"Tx: {ASKED} {end.format(8)}\nRx: {ANSWERED} {end.format(9)}\n"
    assert read(text) == [bytes.fromhex(ASKED), bytes.fromhex(ANSWERED)]


def test_a_count_that_is_not_that_of_the_bytes_is_no_count_of_them() -> None:
    log = read_modbus_log(f"Tx: {ASKED} 8 bytes\nRx: {ANSWERED[:-1]}E 12 bytes\n".encode())
    assert [type(item) for item in log.items] == [LoggedBytes, Unread]


def test_arrows_of_one_character_are_directions() -> None:
    log = read_modbus_log(f"→ < {ASKED} >\n← < {ANSWERED} > 9 bytes\n".encode())
    assert [item.from_client for item in log.items if isinstance(item, LoggedBytes)] == [True, False]
    assert lines_of(f"→ {ASKED}\n← {ANSWERED}\n".encode()) == DONE


def dump(title: str, data: bytes) -> str:
    """Return bytes as eModbus prints them."""
    rows = [data[place : place + 16] for place in range(0, len(data), 16)]
    lines = [
        f"  | {16 * place:04X}: {row.hex(' ', 1).upper():50}|{'.' * len(row):16}|" for place, row in enumerate(rows)
    ]
    return "\n".join([f"{title}: @3FFB37D4/{len(data)}:", *lines, ""])


def test_emodbus_prints_what_it_sends_without_the_crc() -> None:
    asked, answered = bytes.fromhex(ASKED), bytes.fromhex(ANSWERED)
    text = dump("[D] Sent packet", asked[:-2]) + dump("[V] Raw buffer received", answered)
    log = read_modbus_log(text.encode())
    assert read(text) == [asked, answered]
    assert log.notes == ("line 1: Sent packet is printed without the CRC that eModbus sends; it is added to 1 frame",)
    assert lines_of(text.encode()) == DONE


def test_emodbus_as_a_server_prints_its_answers_so() -> None:
    asked, answered = bytes.fromhex(ASKED), bytes.fromhex(ANSWERED)
    text = dump("[V] Raw buffer received", asked) + dump("[D] Sent packet", answered[:-2])
    assert read(2 * text) == 2 * [asked, answered]
    assert read_modbus_log((2 * text).encode()).notes[0].endswith("added to 2 frames")


@pytest.mark.parametrize(
    "data",
    [ASKED, "00 19 00 00 00 06 01 03 00 05 00 02", "01 03 00 05 00"],
    ids=["with its CRC", "TCP", "of another length"],
)
def test_a_crc_is_added_to_nothing_else(data: str) -> None:
    sent = bytes.fromhex(data)
    text = dump("[D] Sent packet", sent) + dump("[V] Raw buffer received", bytes.fromhex(ANSWERED))
    assert read(text)[0] == sent
    assert read_modbus_log(text.encode()).notes == ()


def test_the_last_number_of_a_sentence_is_no_byte() -> None:
    sentence = "Received read registers for device 0x21. FC: 0x3. Number of registers: 0x1."
    assert read(f"{sentence}\nReceived: {ANSWERED}\nasync.dataReceived:64,Data Received: 0x5\n") == [
        bytes.fromhex(ANSWERED),
        b"\x05",
    ]


def test_another_program_that_prints_no_crc_is_believed() -> None:
    text = f"Sent packet: {ASKED[:-6]}\nReceived: {ANSWERED}\n"
    assert read(text)[0] == bytes.fromhex(ASKED[:-6])
