"""Lines with something behind their bytes, a count or a remark, and requests that are printed without their CRC."""

from __future__ import annotations

import pytest

from barewire_workbench.recordings.modbus_log import LoggedBytes, read_modbus_log
from barewire_workbench.recordings.model import Unread
from tests.workbench.recordings.modbus_log.test_marked import ANSWERED, ASKED, DONE
from tests.workbench.recordings.modbus_log.test_programs import lines_of

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


@pytest.mark.parametrize("remark", REMARKS)
@pytest.mark.parametrize("form", ["{0} {2}\n{1}   {2}\n", "Tx: {0}  {2}\nRx: {1} {2}\n", "1.0 {0} {2}\n1.1 {1} {2}\n"])
def test_a_remark_behind_the_bytes_is_none_of_them(form: str, remark: str) -> None:
    assert lines_of(form.format(ASKED, ANSWERED, remark).encode()) == DONE


@pytest.mark.parametrize("mark", ["<-", "<--", "//", "#", ";", "("])
def test_bytes_behind_a_mark_are_not_dropped_in_silence(mark: str) -> None:
    """They may be bytes of the frame, or the bytes before may be a time: a line that is not sure is not read."""
    log = read_modbus_log(f"Tx: {ASKED}\nRx: 01 03 04 00 {mark} 0B 00 16 0A 3F and more\n".encode())
    assert [type(item) for item in log.items] == [LoggedBytes, Unread]


def test_an_arrow_between_a_time_and_bytes_is_a_direction() -> None:
    assert read(f"10.50 -> {ASKED}\n10.60 <- {ANSWERED}\n") == [bytes.fromhex(ASKED), bytes.fromhex(ANSWERED)]


@pytest.mark.parametrize(
    "end", ["{} bytes", "> {} bytes", ", {} byte", "] {} Bytes", "({} bytes)", "[{} bytes]", "({})"]
)
def test_a_count_of_bytes_behind_them_is_not_one_of_them(end: str) -> None:
    text = f"Tx: {ASKED} {end.format(8)}\nRx: {ANSWERED} {end.format(9)}\n"
    assert read(text) == [bytes.fromhex(ASKED), bytes.fromhex(ANSWERED)]


def test_a_count_that_is_not_that_of_the_bytes_is_no_count_of_them() -> None:
    log = read_modbus_log(f"Tx: {ASKED} 8 bytes\nRx: {ANSWERED} 12 bytes\n".encode())
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


def test_another_program_that_prints_no_crc_is_believed() -> None:
    text = f"Sent packet: {ASKED[:-6]}\nReceived: {ANSWERED}\n"
    assert read(text)[0] == bytes.fromhex(ASKED[:-6])
