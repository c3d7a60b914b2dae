"""Pictures of frames: every byte is drawn, any bytes can be drawn, sizes are bounded."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given, settings, strategies as st

from barewire.canopen import CanFrame
from barewire.errors import EncodeError
from barewire_workbench import Explanation, explain, explain_text
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.modbus import explain_ascii, explain_rtu, explain_tcp
from barewire_workbench.pictures.drawing import COLOURS, TEXT_ON, text_lines, xml_text
from barewire_workbench.pictures.fields import FieldsPicture, byte_boxes
from barewire_workbench.pictures.levels import (
    CHARACTERS_DRAWN,
    CanFramePicture,
    LevelsPicture,
    frame_bytes,
    frame_levels,
    frame_pictures,
)
from barewire_workbench.pictures.picture import as_html, as_svg, page_style, rendered
from barewire_workbench.wire import CharacterFormat, can_bits
from tests.workbench.pictures.checks import assert_self_contained, check, contrast, html_texts, svg_texts

READ = bytes.fromhex("01 03 00 00 00 02 C4 0B")
FRAMES = [
    ("rtu", READ.hex()),
    ("rtu", "01 03 00 00 00 02 C4 0C"),
    ("rtu", ""),
    ("tcp", "00 01 00 00 00 06 01 03 00 00 00 02"),
    ("ascii", ":01040FB1000239"),
    ("can", "605#4041600000000000"),
    ("can", "00000605#R3"),
    ("can", "605##0400010"),
    ("can", "can0 20000040 [8] 00 00 00 00 00 00 00 00"),
]


@pytest.mark.parametrize(("protocol", "text"), FRAMES[:2] + FRAMES[3:])
def test_every_form_of_a_frame(protocol: str, text: str) -> None:
    for picture in frame_pictures(explain_text(protocol, text)).values():
        check(picture)


@pytest.mark.parametrize("role", list(TEXT_ON))
def test_contrast_is_enough_in_light_and_dark(role: str) -> None:
    for background in TEXT_ON[role]:
        for place in (0, 1):
            assert contrast(COLOURS[role][place], COLOURS[background][place]) >= 4.5, (role, background, place)


def test_lines_of_waves_are_seen_on_every_tint() -> None:
    for name in ("paper", "mark", *TEXT_ON["ink"]):
        for place in (0, 1):
            assert contrast(COLOURS["ink"][place], COLOURS[name][place]) >= 3


def test_fields_show_every_byte_name_meaning_and_the_verdict() -> None:
    explanation = explain("rtu", READ)
    for texts in (svg_texts(FieldsPicture(explanation)), html_texts(FieldsPicture(explanation))):
        shown = " ".join(texts)
        for field in explanation.fields:
            assert field.name in shown
            assert field.meaning in shown
        assert f"✓ {explanation.verdict}" in shown
    boxes = svg_texts(FieldsPicture(explanation))
    assert [text for text in boxes if re.fullmatch("[0-9A-F]{2}", text)][:8] == READ.hex(" ").upper().split()


def test_a_wrong_frame_has_its_diagnosis_and_a_sign_that_needs_no_colour() -> None:
    wrong = explain_text("rtu", "01 03 00 00 00 02 0B C4")
    explanation = replace(wrong, diagnosis=(Finding("crc-swapped", "the CRC has its high byte first", "... C4 0B"),))
    for texts in (svg_texts(FieldsPicture(explanation)), html_texts(FieldsPicture(explanation))):
        shown = " ".join(texts)
        assert "✗ not valid" in shown
        assert "→ diagnosis: the CRC has its high byte first [crc-swapped]" in shown


def test_parts_of_a_field_light_each_other_up() -> None:
    picture = FieldsPicture(explain("rtu", READ))
    for text in (as_svg(picture), as_html(picture)):
        for number in range(picture.links):
            assert f":has(.f{number}:hover,.f{number}:focus) .f{number}" in text
            assert re.search(rf'class="[^"]*\bf{number}\b[^"]*"[^>]*tabindex="0"', text)


@given(st.sampled_from([explain_rtu, explain_tcp, explain_ascii]), st.binary(max_size=40))
@settings(max_examples=60)
def test_any_bytes_have_pictures_with_every_byte(explained: Callable[[bytes], Explanation], data: bytes) -> None:
    explanation = explained(data)  # without the diagnosis, which takes its time
    assert bytes(byte for byte, _ in frame_bytes(explanation)) == data
    for picture in frame_pictures(explanation).values():
        check(picture)


@pytest.mark.parametrize(
    "frame",
    [
        b":01040FB1000239\r\n",
        b":0 1\\x\x00\r\n",
        b"\n",
        b":01\r",
        b":01 \r\n:",
        b"ab'c\"\t",
        b":01\xff",
        b":01040FB\r\n",
        b":010300000002FA\n\r",
    ],
)
def test_every_character_of_an_ascii_frame_is_drawn(frame: bytes) -> None:
    explanation = explain("ascii", frame)
    assert bytes(byte for byte, _ in frame_bytes(explanation)) == frame
    assert sum(len(byte_boxes(field)) for field in explanation.fields) == len(frame)


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
@settings(max_examples=30)
def test_any_can_frame_has_pictures(identifier: int, data: bytes) -> None:
    frame = CanFrame(identifier, data)
    for picture in frame_pictures(explain("can", frame), frame).values():
        check(picture)


@given(st.text())
def test_any_text_can_be_drawn(text: str) -> None:
    xml_text(text).encode()
    assert "".join("".join(text_lines(text, 60)).split()) == "".join(text.split())


def test_levels_have_every_character_in_the_order_on_the_line() -> None:
    picture = frame_levels(explain("rtu", READ))
    shown = svg_texts(picture)
    assert [text for text in shown if re.fullmatch("[01]{11}", text)][:2] == ["01000000011", "01100000001"]
    assert sum(bool(re.fullmatch("[01]{11}", text)) for text in shown) == len(READ)
    assert shown.count("silence") == 2
    assert "at least t3.5" in shown
    assert "2.005 ms" in shown


def test_levels_of_seven_bits_odd_parity_and_two_stop_bits() -> None:
    picture = LevelsPicture(b"A", CharacterFormat(7, "O", 2), 9600)
    assert picture.as_dict()["characters"][0]["levels"] == "01000001111"
    assert picture.bit_names == ["start", "0", "1", "2", "3", "4", "5", "6", "par", "stop", "stop"]
    check(picture)


def test_a_can_frame_has_every_bit_and_marks_the_stuff_bits() -> None:
    picture = CanFramePicture(can_bits(CanFrame.parse("605#4041600000000000")), 500_000)
    texts = svg_texts(picture)
    assert "".join(text for text in texts if re.fullmatch("[01]+", text)) == picture.sent.levels
    assert texts.count("s") == picture.sent.stuff_count == 13
    lines = picture.lines()
    assert "".join("".join(line.split()) for line in lines if re.fullmatch(r"\s+[01]( [01])*", line)) == (
        picture.sent.levels
    )
    assert "242 us at 500000 bit/s" in lines[0]


def test_the_parts_of_an_extended_frame() -> None:
    picture = CanFramePicture(can_bits(CanFrame.parse("1ABCDE05#FF")))
    headings = [line.partition(" =")[0] for line in picture.lines() if line and line[0] not in " rd"]
    assert headings[1:5] == ["SOF, identifier", "identifier extension", "identifier extension", "RTR, r1, r0, DLC"]
    assert "identifier extension" in svg_texts(picture)


def test_sizes_are_bounded() -> None:
    frame = explain("rtu", bytes(256))
    for picture in frame_pictures(frame).values():
        assert len(as_svg(picture)) < 600_000
    long = LevelsPicture(bytes(CHARACTERS_DRAWN + 5), CharacterFormat(), 9600)
    assert "The last 5 characters are not drawn." in long.caption
    assert long.lines()[-1] == "The last 5 characters are not drawn."
    assert len(as_svg(long)) < 600_000
    assert "not drawn" not in LevelsPicture(bytes(CHARACTERS_DRAWN), CharacterFormat(), 9600).caption


def test_many_registers_are_bounded_too() -> None:
    body = bytes([1, 3, 250]) + bytes(range(250))
    assert len(as_svg(FieldsPicture(explain("rtu", body + bytes(2))))) < 300_000


def test_only_frames_with_levels_have_that_picture() -> None:
    fd = "605##0400010"
    assert list(frame_pictures(explain_text("tcp", FRAMES[3][1]))) == ["fields"]
    assert list(frame_pictures(explain_text("can", fd))) == ["fields"]


def test_a_page_of_documentation_decides_about_light_and_dark() -> None:
    style = page_style(follows_page=True)
    assert '[data-theme="dark"] .bw' in style
    assert "body{" not in style
    assert_self_contained(style)


def test_another_form_is_refused() -> None:
    with pytest.raises(EncodeError, match="'png': expected one of text, json, html, svg"):
        rendered("png", FieldsPicture(explain("rtu", READ)))
