"""CAN frames as people note them, without times."""

from __future__ import annotations

import pytest

from barewire_workbench.monitor.recording import is_can_recording, is_timed, read_recording
from barewire_workbench.recordings.model import Recorded, Unread


@pytest.mark.parametrize(
    ("text", "frames"),
    [
        ("182#4007\n\n202#0600\n", ["182#4007", "202#0600"]),
        ("60B   [8]  40 0A 10 00 00 00 00 00\n", ["60B#400A100000000000"]),
        ("082 40 81 10 12 47 00 fd 00\n", ["082#4081101247 00FD00".replace(" ", "")]),
        ("\t67F Tx SD  8  23 14 10 00 00 00 00 00\n", ["67F#2314100000000000"]),
        ("26.07.22 : 15:47:14.042 : Test CAN : CAN1  586 Rx SD  2  4F 01\n", ["586#4F01"]),
    ],
)
def test_the_forms_of_notes(text: str, frames: list[str]) -> None:
    data = text.encode()
    assert is_can_recording(data)
    assert not is_timed(data)
    assert [str(item.frame) for item in read_recording(data) if isinstance(item, Recorded)] == frames


@pytest.mark.parametrize(
    "text",
    ["01 03 00 00 00 0A C5 CD", "182#4007\nand something else", "", "[01][03]", ":010300000001FB", "0103 0000 000A"],
)
def test_other_lines_are_no_notes(text: str) -> None:
    assert not is_can_recording(text.encode())


def test_a_frame_that_cannot_be_read_has_its_line() -> None:
    first, second = read_recording(b"705 [1] 05\n705 [2] 05")
    assert isinstance(first, Recorded)
    assert isinstance(second, Unread)
    assert second.line == 2
