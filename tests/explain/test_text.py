"""What people paste, and the sentence they get for a typing error."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.errors import DecodeError, EncodeError
from barewire.explain import explain_text
from barewire.explain.text import parse_ascii, parse_can, parse_hex


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
def test_hexadecimal_in_any_dress(text: str) -> None:
    assert parse_hex(text) == bytes.fromhex("01040FB1")


@pytest.mark.parametrize(
    ("text", "reason", "at", "words"),
    [
        ("01 04 0G", "character", 7, "'G' at 7 is no hexadecimal digit"),
        ("01 04 F", "length", 6, "'F' at 6: a byte has two hexadecimal digits"),
        ("01, 0x", "length", 6, "'' at 6: a byte has two hexadecimal digits"),
        ("01 é4", "character", 3, "'é' at 3 is no hexadecimal digit"),
    ],
)
def test_a_typing_error_is_told_with_its_place(text: str, reason: str, at: int, words: str) -> None:
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
def test_ascii_frames_typed_or_as_codes(text: str) -> None:
    assert parse_ascii(text) == b":01040FB1000239\r\n"


def test_an_ascii_frame_copied_from_a_screen_is_valid() -> None:
    assert explain_text("ascii", ":01040FB1000239").valid
    assert explain_text("ascii", "3A 30 31 30 34 30 46 42 31 30 30 30 32 33 39").valid


def test_an_ascii_frame_without_its_colon_is_explained_and_not_valid() -> None:
    said = explain_text("ascii", "01040FB1000239")
    assert said.error is not None
    assert said.error.reason == "delimiter"


@pytest.mark.parametrize(
    "text",
    [
        "605#4040600000000000",
        "605#40.40.60.00.00.00.00.00",
        "can0 605#4040600000000000",
        "(1234.5) can0 605#4040600000000000",
        "(1436509052.249713) vcan0 605#4040600000000000 T",
        "605 40 40 60 00 00 00 00 00",
        "605 4040600000000000",
        "0x605 [8] 40 40 60 00 00 00 00 00",
        "605h 40 40 60 00 00 00 00 00",
        "  can0  605   [8]  40 40 60 00 00 00 00 00",
        "  can0  605   [8]  40 40 60 00 00 00 00 00   '@@`.....'",
        "(000.000000)  slcan1  RX - -  605   [8]  40 40 60 00 00 00 00 00",
    ],
)
def test_every_line_that_candump_writes(text: str) -> None:
    assert str(parse_can(text)) == "605#4040600000000000"


@pytest.mark.parametrize(
    ("text", "frame"),
    [
        ("605#R", "605#R"),
        ("can0  705   [1]  remote request", "705#R1"),
        ("80", "080#"),
        ("can0 00000605 [1] 40", "00000605#40"),
    ],
)
def test_remote_short_and_extended_frames(text: str, frame: str) -> None:
    assert str(parse_can(text)) == frame


@pytest.mark.parametrize(
    ("text", "reason", "at"),
    [
        ("", "short", 0),
        ("can0", "short", 4),
        ("can0 605#40g0", "character", 11),
        ("can0 605#404", "length", 12),
        ("60G 40", "character", 2),
        ("605 40 4", "length", 7),
        ("605 40 4g", "character", 8),
        ("605 [3] 40", "length", 8),
        ("605 [1]", "length", 7),
        ("605#00 11", "long", 7),
        ("0605 40", "length", 0),
        ("can0 8FF#", "value", 5),
        ("605##", "short", 5),
    ],
)
def test_a_line_that_is_no_frame(text: str, reason: str, at: int) -> None:
    with pytest.raises(DecodeError) as caught:
        explain_text("can", text)
    assert (caught.value.reason, caught.value.at) == (reason, at)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("protocol", "role"), [("profibus", None), ("rtu", "client")])
def test_a_protocol_or_role_that_does_not_exist(protocol: Any, role: Any) -> None:
    with pytest.raises(EncodeError, match="expected"):
        explain_text(protocol, "01", role)
