"""Pasted CAN frames in all forms, and the errors for unreadable text."""

from __future__ import annotations

import pytest

from barewire.errors import DecodeError
from barewire_workbench import explain_text
from barewire_workbench.recordings.candump import parse_any_can, parse_can
from tests.helpers import every_case


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
def test_every_line_that_candump_writes_is_read(text: str) -> None:
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
def test_remote_short_and_extended_frames_are_read(text: str, frame: str) -> None:
    assert str(parse_can(text)) == frame


@every_case(
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
        ("605#00 1", "long", 7),
        ("605#0 11", "long", 6),
        ("605#00 11 g0", "long", 10),
        ("605# 00 00 00 00 00 00 00 00 00", "long", 29),
        ("0605 40", "length", 0),
        ("can0 8FF#", "value", 5),
        ("605##", "short", 5),
    ],
)
def test_a_line_that_is_not_a_frame_is_refused(text: str, reason: str, at: int) -> None:
    with pytest.raises(DecodeError) as caught:
        explain_text("can", text)
    assert (caught.value.reason, caught.value.at) == (reason, at)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ["605#40 41 60 00", "605# 40 41 60 00", "605 #40416000", "605 # 40 41 60 00", "(1.5) can0 605#4041 6000"]
)
def test_blanks_behind_the_number_sign(text: str) -> None:
    assert str(parse_any_can(text)) == "605#40416000"
