"""Lines with several frames, and lines whose bytes cannot be read: none of them is dropped without a word."""

from __future__ import annotations

import pytest

from barewire_workbench.recordings.modbus_log import read_modbus_log
from barewire_workbench.recordings.model import Unread
from tests.workbench.recordings.modbus_log.test_programs import REFUSED, lines_of

ASKED, ANSWERED = "01 03 00 05 00 02 D4 0A", "01 83 02 C0 F1"
SENT, RECEIVED = "0x1 0x3 0x0 0x5 0x0 0x2 0xd4 0xa", "0x1 0x83 0x2 0xc0 0xf1"
DONE = REFUSED.replace("FFFFh", "0005h")
ERROR = "2025-10-23 16:49:37.254 ERROR (MainThread) [pymodbus.logging] No response received after 3 retries, continue"


@pytest.mark.parametrize(
    "line",
    [
        f">>>>> send: {SENT} >>>>> recv: {RECEIVED} extra data: ",
        f"{ERROR} >>>>> send: {SENT} >>>>> recv: {RECEIVED} extra data: ",
        f"DEBUG:pymodbus.logging:send: {SENT} recv: {RECEIVED}",
        f"Tx: {ASKED} Rx: {ANSWERED}",
        f"2024-05-01 10:31:18.250 Tx/Rx: TX {ASKED}, RX {ANSWERED}",
        f"Tx/Rx: {ASKED} / {ANSWERED}",
        f"[TX] {ASKED.replace(' ', '')} [RX] {ANSWERED.replace(' ', '')}",
        f"-> {ASKED} <- {ANSWERED}",
        f"{ASKED} -> {ANSWERED}",
        f"request: {ASKED} -> response: {ANSWERED}",
        f"request {ASKED} (8 bytes), response {ANSWERED} (5 bytes)",
    ],
)
@pytest.mark.parametrize("times", [1, 2])
def test_an_exchange_on_one_line(line: str, times: int) -> None:
    assert lines_of("\n".join([line] * times).encode()) == [DONE] * times


def test_several_exchanges_on_one_line_of_pymodbus() -> None:
    line = (
        f">>>>> send: {SENT} >>>>> recv: {RECEIVED} extra data:  >>>>> send: {SENT} >>>>> recv: {RECEIVED} extra data: "
    )
    assert lines_of(line.encode()) == [DONE, DONE]


def test_what_was_unexpected_is_not_read_twice() -> None:
    text = (
        f"{ERROR}\n>>>>> send: {SENT}\n>>>>> recv: {RECEIVED} extra data: \n>>>>> extra:  unexpected data: {RECEIVED}\n"
    )
    assert lines_of(text.encode()) == [DONE]


@pytest.mark.parametrize(
    "line",
    [
        "DEBUG:pymodbus.logging:recv: 0x1 0x83 0xzz 0xc0 0xf1",
        f">>>>> send: {SENT} >>>>> recv: 0x1 0x83 0xzz 0xc0 0xf1",
        "the answer was 01 83 02 C0 F1 or so",
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
