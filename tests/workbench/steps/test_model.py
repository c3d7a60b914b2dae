"""The value that all calculations are: lines, and a dict for JSON."""

from __future__ import annotations

import json

from barewire.canopen import CanFrame
from barewire_workbench.steps import (
    Steps,
    StepTable,
    can_frame_steps,
    cob_id_steps,
    control_word_steps,
    crc_steps,
    lrc_steps,
    number_steps,
    status_word_steps,
    timing_steps,
)
from barewire_workbench.steps.model import LINE_WIDTH, grouped_bits
from barewire_workbench.wire import CharacterFormat
from tests.helpers import every_case

EXAMPLES = [
    crc_steps(bytes.fromhex("010300000002")),
    lrc_steps(bytes.fromhex("010300000002")),
    *(
        timing_steps(rate, CharacterFormat.parse(form))
        for rate, form in ((9600, "7E1"), (19200, "8E1"), (115200, "8N1"))
    ),
    *(number_steps(text) for text in ("1.1", "-0", "nan", "1e-45")),
    *(number_steps(text, name) for text, name in (("-5", "i32"), ("5", "u8"), ("-1e300", "f64"))),
    *(cob_id_steps(number) for number in (0x58F, 0x80, 0x7E5, 0x700, 0x1234567, 0xC0000185, 0xA0001234)),
    *(control_word_steps(word) for word in (None, 0x0F, 0x80)),
    *(status_word_steps(word) for word in (0x0637, 0x0042, 0x0218)),
    can_frame_steps([CanFrame(0x605, b"\x40")]),
    can_frame_steps([CanFrame(0x123, b"\x40", extended=True)]),
    can_frame_steps([CanFrame(0x605, b"\x40"), CanFrame(0x705, b"\x05")]),
]


@every_case("steps", EXAMPLES)
def test_every_calculation_is_whole(steps: Steps) -> None:
    assert json.loads(json.dumps(steps.as_dict(), allow_nan=True))["subject"] == steps.subject
    assert steps.title
    assert steps.source
    assert steps.result
    for table in steps.tables:
        assert {len(row) for row in table.rows} == {len(table.header)}
    lines = steps.lines()
    assert lines[0] == steps.title
    assert " ".join(lines).endswith(steps.result)
    assert all(line == line.rstrip() for line in lines)
    assert "\n" not in "".join(lines)
    texts = [section for section in steps.sections if isinstance(section, str)]
    assert all(text[-1] in ".:" and "  " not in text for text in texts)
    assert len(repr(steps)) < 200


def test_text_is_wrapped_and_tables_are_not() -> None:
    wide = StepTable("", ("a", "b"), (("x" * 100, "y" * 100),))
    steps = Steps("x", "X", "source", ("word " * 40, wide), "done")
    lines = steps.lines()
    assert max(map(len, lines[:6])) <= LINE_WIDTH
    assert lines[-3] == "x" * 100 + "  " + "y" * 100


def test_bits_are_grouped_from_the_right() -> None:
    assert [grouped_bits(5, width) for width in (3, 4, 5, 8, 11)] == [
        "101",
        "0101",
        "0 0101",
        "0000 0101",
        "000 0000 0101",
    ]


def test_as_dict_has_texts_and_tables() -> None:
    steps = Steps("x", "X", "s", ("Text.", StepTable("c", ("h",), (("1",),))), "r", {"v": 1})
    assert steps.as_dict() == {
        "subject": "x",
        "title": "X",
        "source": "s",
        "sections": [{"text": "Text."}, {"caption": "c", "header": ["h"], "rows": [["1"]]}],
        "result": "r",
        "values": {"v": 1},
    }
