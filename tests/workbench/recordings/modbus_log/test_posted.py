"""Frames within sentences, in the notations in which people write bytes; and numbers that are no bytes."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import pytest

from barewire.errors import DecodeError
from barewire_workbench.recordings.modbus_log import LoggedBytes, read_modbus_log
from barewire_workbench.recordings.modbus_log.posted import read_posted
from tests.workbench.diagnosis.habits import exchanges, framed

_NOTATIONS: dict[str, Callable[[bytes], str]] = {
    "pairs": lambda data: data.hex(" ").upper(),
    "0x": lambda data: ", ".join(f"0x{byte:02x}" for byte in data),
    "short 0x": lambda data: " ".join(f"0x{byte:x}" for byte in data),
    "decimal list": lambda data: str(list(data)),
    "decimal dashes": lambda data: "-".join(map(str, data)),
    "CRC in brackets": lambda data: f"{data[:-2].hex(' ')} [{data[-2:].hex(' ')}]",
    "words": lambda data: f"{data[:2].hex(' ')} {data[2:-2].hex()} {data[-2:].hex()}",
    "joined": lambda data: data.hex(),
    "escaped": lambda data: "".join(f"\\x{byte:02x}" for byte in data),
    "h": lambda data: " ".join(f"{byte:02X}h" for byte in data),
    "code": lambda data: f"`{data.hex('-')}`",
    "bold": lambda data: f"**{data.hex(' ')}**",
    "JSON": lambda data: '{"type":"Buffer","data":' + str(list(data)).replace(" ", "") + "}",
    "braces": lambda data: "{" + ",".join(f"0x{byte:02X}" for byte in data) + "}",
}
_SENTENCES = (
    "Since version 3.1.2 of 2024-05-01 I ask the meter with {asked} at 9600 8N1\nand what comes is {answered}, why?",
    "The request ({asked}) is fine.\n\nBut the response is:\n\n{answered}\n",
    "master says:{asked}, slave says:{answered}; my adapter is 02:42:ac:11:00:02 at 192.168.1.12",
    "设备的请求是{asked}时，\n响应报文{answered}，但查询结果是正常的",
    "Die Anfrage {asked} ist gut, die Antwort {answered} nicht",
    "<p>10:31:18 [main] wrote {asked}</p>\n<p>10:31:19 [main] read {answered} in 12 ms</p>",
)


@pytest.mark.parametrize("notation", _NOTATIONS)
@pytest.mark.parametrize("framing", ["rtu", "tcp"])
def test_frames_within_sentences_are_read_in_any_notation(framing: str, notation: str) -> None:
    dice = Random(f"{framing} {notation}")
    for sentence in _SENTENCES:
        exchange = exchanges(dice, 1, reads=True)[0]
        frames = [framed(framing, exchange.unit, pdu, 7) for pdu in (exchange.asked, exchange.answered)]
        asked, answered = map(_NOTATIONS[notation], frames)
        log = read_modbus_log(sentence.format(asked=asked, answered=answered).encode())
        pieces = [item for item in log.items if isinstance(item, LoggedBytes)]
        assert [piece.data for piece in pieces] == frames, sentence
        for piece, from_client in zip(pieces, (True, False)):
            assert piece.from_client in (from_client, None), sentence


def test_noise_beside_a_frame_in_the_same_notation_belongs_to_it() -> None:
    found = read_posted(["the answer is FF 01 83 02 C0 F1 00, of 5 bytes"])
    assert [posted.entry.data for posted in found] == [bytes.fromhex("FF 01 83 02 C0 F1 00")]


def test_bytes_that_are_no_frame_are_read_beside_words_and_brackets() -> None:
    text = "I see:\n[01][01][00][00][00][67][7C][26]\nand the server FF 01 01 00 00 00 67 7C 26, why?"
    assert [posted.entry.line for posted in read_posted(text.splitlines())] == [2, 3]


def test_a_wrong_crc_of_the_others_is_one_of_bytes_in_one_notation() -> None:
    found = read_posted(["response is 01 03 02 00 17 F8 4B", "and 0A 10 0001 0003 06 0A0B0C EE98"])
    assert [posted.why for posted in found] == ["bytes in one notation", "the last two are the CRC of the others"]


@pytest.mark.parametrize(
    "text",
    [
        "Version 3.6.1 of 2024-05-01 10:31:18 on 192.168.1.12, adapter 02:42:ac:11:00:02 and ff:fe:00:11:22:33",
        "I read registers 40001, 40002 and 40010 with 3, 4, 5 and 6 of 8N1 at 9600, 19200, 38400 bit/s.",
        "commit 9f86d081884c7d659a2feaa0c55ad015a3bf4f1b in build 4711; values [230, 231, 229] and [0, 1, 2, 3, 4, 5]",
        "byte mac[] = { 0xDE, 0xAD, 0xBE, 0xEF, 0xFE, 0xED };\nIPAddress ip(192, 168, 1, 177);",
        "static const uint8_t crc_hi[] = {\n  0x00, 0xC1, 0x81, 0x40, 0x01,\n  0x80, 0x41, 0x01, 0xC0, 0x80\n};",
        "| 1 | 2 | 3 | 4 | 5 |\n| 12 | 13 | 14 |\nbe a bad dad add face fee",
    ],
)
def test_numbers_are_no_bytes_without_a_reason(text: str) -> None:
    assert read_posted(text.splitlines()) == []
    with pytest.raises(DecodeError):
        read_modbus_log(text.encode())
