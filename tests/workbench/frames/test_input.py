"""Pasted text in all forms, and the errors for unreadable text."""

from __future__ import annotations

import re
from typing import Any

import pytest

from barewire.errors import DecodeError, EncodeError
from barewire_workbench import explain, explain_text
from barewire_workbench.frames.input import parse_ascii, parse_hex
from barewire_workbench.recordings.candump import parse_any_can
from tests.helpers import every_case


@pytest.mark.parametrize(
    "text",
    [
        "01 04 0F B1",
        "01040fb1",
        "0x01,0x04,0x0f,0xB1",
        "0x01 0x4 0xf 0xb1",
        "01-04-0F-B1",
        "01:04:0f:b1",
        "0104 0FB1\n",
        r"\x01\x04\x0f\xb1",
        "01h 04h 0Fh B1h",
        "0x01040FB1",
    ],
)
def test_hexadecimal_in_any_notation(text: str) -> None:
    assert parse_hex(text) == bytes.fromhex("01040FB1")


ASK = bytes.fromhex("01 03 00 00 00 0A C5 CD")


@every_case(
    "text",
    [
        "{0x01, 0x03, 0x00, 0x00, 0x00, 0x0a, 0xc5, 0xcd};",
        "const uint8_t ask[8] = { 0x01, 0x03, 0, 0, 0, 0x0A, 0xC5, 0xCD };".replace("0,", "0x0,"),
        "[01][03][00][00][00][0A][C5][CD]",
        "<01> <03> <00> <00> <00> <0A> <C5> <CD>",
        "<01 03 00 00 00 0A C5 CD>",
        r"b'\x01\x03\x00\x00\x00\n\xc5\xcd'",
        r"bytearray(b'\x01\x03\x00\x00\x00\n\xc5\xcd')",
        r'"\x01\x03\x00\x00\x00\x0a\xc5\xcd"',
        "b'01030000000ac5cd'",
        "frame = bytes.fromhex('01 03 0000 000A C5CD')",
        "bytes([1, 3, 0, 0, 0, 10, 197, 205])",
        "[1, 3, 0, 0, 0, 10, -59, -51]",
        "1 3 0 0 0 10 197 205",
        "1,3,0,0,0,10,197,205",
        "00000000  01 03 00 00 00 0a c5 cd                           |........|\n00000008",
        "00000000: 0103 0000 000a c5cd                      ........",
        "0000   01 03 00 00 00 0a c5 cd                            ........",
        "0000  01 03 00 00 00 0a c5 cd   ........",
        "00000040  01 03 00 00\n00000044  00 0a c5 cd",
        "0010  01 03 00 00 00 0a c5 cd   ........",
        "0000000 01 03 00 00 00 0a c5 cd\n0000010",
    ],
)
def test_bytes_as_programs_and_tools_print_them(text: str) -> None:
    assert parse_hex(text) == ASK


def test_a_dump_of_many_lines() -> None:
    frame = bytes(range(0x30, 0x55))
    lines = [frame[at : at + 16] for at in range(0, len(frame), 16)]
    plain = "".join(f"{16 * n:04x}  {part.hex(' '):<47}   {part.decode()}\n" for n, part in enumerate(lines))
    octal = "".join(f"{16 * n:07o} {part.hex(' ')}\n" for n, part in enumerate(lines)) + f"{len(frame):07o}\n"
    assert parse_hex(plain) == parse_hex(octal) == frame


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("0001  00 00 00 06 01 03 00 00 00 01", "0001 0000 0006 0103 0000 0001"),
        ("0000 0000 0006 01 03 0000 0001", "0000 0000 0006 0103 0000 0001"),
        ("10 20 30", "10 20 30"),
        ("[10, 0A]", "10 0A"),
    ],
)
def test_ambiguous_digits_are_plain_hexadecimal(text: str, data: str) -> None:
    assert parse_hex(text) == bytes.fromhex(data)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 3 10", "'1 3 10': hexadecimal or decimal?"),
        ("[10, 20, 30]", "hexadecimal or decimal?"),
        ("1 3 300", "'300' at 4: a byte is a number from 0 to 255"),
        ("(12.5) 01 03", "'(' at 0"),
        (r"b'\xg1'", "is not an escape of a byte"),
        ("0000000 0301 0000 0a00 cdc5\n0000008", "hexdump -C"),
        ("00000000: 0103\n*\n00000010: 0103", "line 2: '*' is not a line of the dump"),
        ("00000000: 0103\n00000010: 0103", "line 2: the dump continues at 10h, expected 2h"),
        (
            f"0000000 {'01 ' * 16}\n0000020 {'01 ' * 16}\n0000020 01",
            "the dump continues at octal 20, expected octal 40",
        ),
    ],
)
def test_ambiguous_text_is_refused(text: str, words: str) -> None:
    with pytest.raises(DecodeError, match=re.escape(words)):
        parse_hex(text)


@pytest.mark.parametrize(
    ("protocol", "text", "words"),
    [
        ("tcp", "01 03 00 00 00 0A C5 CD", "; as rtu it is a request to unit 1, Read Holding Registers, 10 from 0000h"),
        ("tcp", "01 03 00 00 00 0A", "; as rtu: no CRC; with C5 CD it is a request"),
        ("rtu", "000700000006010300000001", "; as tcp it is a request to unit 1"),
        ("rtu", ":01040FB1000239", "; as ascii it is a request to unit 1"),
        ("rtu", ":01030000000A", "; as ascii: no LRC; with F2 it is a request to unit 1"),
        ("ascii", "01 04 0F B1 00 02 22 F8", "; as rtu it is a request to unit 1"),
        ("can", "00 05 00 00 FF 00 8D EB", "; as rtu it is a request to unit 0, Write Single Coil"),
    ],
)
def test_the_hint_names_another_protocol(protocol: str, text: str, words: str) -> None:
    explanation = explain_text(protocol, text)
    assert explanation.error is not None
    assert words in explanation.error.text


@pytest.mark.parametrize(
    "text",
    [
        "<Buffer 01 03 00 00 00 0a c5 cd>",
        "[01] [03] [0000] [000A] [C5CD]",
        "TX 01 03 00 00 00 0A C5 CD",
        "Request: 0103 0000 000A C5CD",
        "1 3 0 0 0 A C5 CD",
    ],
)
def test_bytes_as_programs_print_them(text: str) -> None:
    assert parse_hex(text) == bytes.fromhex("01 03 00 00 00 0A C5 CD")


def test_unreadable_text_gets_a_hint_too() -> None:
    with pytest.raises(DecodeError, match=re.escape("; as can it is SDO request to node 5")):
        explain_text("tcp", "605#4041600000000000")
    with pytest.raises(DecodeError, match=re.escape("; as tcp it is a request to unit 1")):
        explain_text("can", "00 01 00 00 00 06 01 03 00 00 00 0A")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("01 03 00 00 00 0A C5 CD", ["good RTU frame", "rtu in place of can", "unit 1, Read Holding Registers, 10"]),
        ("0x01 0x83 0x02 0xC0 0xF1", ["good RTU frame", "a response from unit 1, exception 02"]),
        ("11 05 00 AC FF 00 4E 8B", ["good RTU frame", "a request to unit 17, Write Single Coil"]),
        ("12 34 00 00 00 03 01 83 02", ["good Modbus TCP frame", "tcp in place of can", "transaction 4660"]),
    ],
)
def test_a_modbus_frame_that_can_be_read_as_a_can_frame_is_said_to_be_one(text: str, words: list[str]) -> None:
    explanation = explain_text("can", text)
    assert (explanation.protocol, explanation.valid) == ("can", True)
    first = explanation.diagnosis[0]
    assert first.code == "modbus-on-can"
    assert all(part in first.line for part in words), first.line
    assert explain("can", parse_any_can(text)).diagnosis == explanation.diagnosis


@pytest.mark.parametrize(
    "text",
    [
        "605 40 41 60 00 00 00 00 00",
        "001#030000000AC5CD",
        "can0  705   [1]  05",
        "01 03 00 00 00 0A C5 CE",
        "01 03 00 00 00 0A",
        "00 01 05",
    ],
)
def test_a_can_frame_that_is_no_flawless_modbus_frame_is_only_that(text: str) -> None:
    assert "modbus-on-can" not in [finding.code for finding in explain_text("can", text).diagnosis]


@pytest.mark.parametrize(
    "text", [r":01040FB1000239\r\n", ":01040FB1000239", "3A 30 31 30 34 30 46 42 31 30 30 30 32 33 39"]
)
def test_an_ascii_frame_in_another_protocol_is_read_as_its_characters(text: str) -> None:
    assert [finding.code for finding in explain_text("rtu", text).diagnosis] == ["ascii-on-rtu"]
    assert [finding.code for finding in explain_text("tcp", text).diagnosis] == ["ascii-on-tcp"]


def test_the_codes_of_an_rtu_frame_are_diagnosed_where_ascii_was_expected() -> None:
    assert [finding.code for finding in explain_text("ascii", "01 03 00 00 00 0A C5 CD").diagnosis] == ["rtu-on-ascii"]
    coded = "BA B0 31 B0 34 B0 46 C2 31 B0 B0 B0 32 B3 B9 0D 8A"
    assert [finding.code for finding in explain_text("ascii", coded).diagnosis] == ["seven-bit"]


@pytest.mark.parametrize("text", ["01 03 00 00 00 0A C5 CE", "0007 0000 0006 01 03 0000 0000"])
def test_a_damaged_frame_of_its_own_protocol_gets_no_hint(text: str) -> None:
    explanation = explain_text("rtu" if len(text) < 25 else "tcp", text)
    assert explanation.error is not None
    assert "; as " not in explanation.error.text


@pytest.mark.parametrize(
    ("text", "reason", "at", "words"),
    [
        ("01 04 0G", "character", 7, "'G' at 7 is not a hexadecimal digit"),
        ("01 04 F", "length", 6, "'F' at 6: a byte has two hexadecimal digits"),
        ("01, 0x", "length", 6, "'' at 6: a byte has two hexadecimal digits"),
        ("01 é4", "character", 3, "'é' at 3 is not a hexadecimal digit"),
    ],
)
def test_a_typing_error_is_reported_with_its_place(text: str, reason: str, at: int, words: str) -> None:
    with pytest.raises(DecodeError) as caught:
        explain_text("rtu", text)
    assert (caught.value.reason, caught.value.at, caught.value.text) == (reason, at, words)


@pytest.mark.parametrize(
    "text",
    [
        ":01040FB1000239\r\n",
        r":01040FB1000239\r\n",
        "  :01040FB1000239<CR><LF>",
        "3A 30 31 30 34 30 46 42 31 30 30 30 32 33 39 0D 0A",
        "3a3031303430464231303030323339" + "0d0a",
    ],
)
def test_ascii_frames_as_text_or_as_codes(text: str) -> None:
    assert parse_ascii(text) == b":01040FB1000239\r\n"


def test_an_ascii_frame_copied_from_a_screen_is_valid() -> None:
    assert explain_text("ascii", ":01040FB1000239").valid
    assert explain_text("ascii", "3A 30 31 30 34 30 46 42 31 30 30 30 32 33 39").valid


def test_an_ascii_frame_without_its_colon_is_explained_and_not_valid() -> None:
    explanation = explain_text("ascii", "01040FB1000239")
    assert explanation.error is not None
    assert explanation.error.reason == "delimiter"


@pytest.mark.parametrize(("protocol", "role"), [("profibus", None), ("rtu", "client")])
def test_an_unknown_protocol_or_role_is_refused(protocol: Any, role: Any) -> None:
    with pytest.raises(EncodeError, match="expected"):
        explain_text(protocol, "01", role)
