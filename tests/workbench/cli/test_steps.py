"""`barewire steps`: each calculation as text and as JSON."""

from __future__ import annotations

import html
import json
from xml.etree import ElementTree

import pytest

from barewire_workbench.cli.app import run_command_line
from tests.helpers import every_case
from tests.workbench.cli.helpers import error_of, output_of

COMMANDS = [
    (("crc", "02 07"), "CRC 1241h, sent low byte first: 41 12"),
    (("crc", "02", "07", "--view", "polynomial"), "CRC 1241h, sent low byte first: 41 12"),
    (("lrc", "01 04 00 00 08"), "LRC F3h, sent as the two characters 'F3'"),
    (("lrc", ":01040FB10002"), "LRC 39h, sent as the two characters '39'"),
    (
        ("timing", "--baudrate", "19200", "--format", "8E1"),
        "8E1 at 19200 bit/s: a character lasts 572.9 us, t1.5 859.4 us, t3.5 2.005 ms",
    ),
    (("timing",), "8E1 at 19200 bit/s: a character lasts 572.9 us, t1.5 859.4 us, t3.5 2.005 ms"),
    (("float", "1.1", "--order", "CDAB"), "1.1 as f32 in order CDAB: CC CD 3F 8C"),
    (("float", "-5", "--type", "i32"), "-5 as i32 in order ABCD: FF FF FF FB"),
    (("float", "--bytes", "CC CD 3F 8C", "--order", "CDAB"), "CC CD 3F 8C as f32 in order CDAB is 1.100000023841858"),
    (("float", "--bytes", "FFFB", "--type", "i16"), "FF FB as i16 in order AB is -5"),
    (("lrc", r":01040FB1000239\r\n"), "LRC 00h, sent as the two characters '00'"),
    (("can-frame", "can0", "605#40"), "605#40 has"),
    (("cob-id", "58Fh"), "58Fh is the SDO answer of node 15"),
    (("cob-id", "185", "--extended"), "00000185h is an extended identifier of 29 bits"),
    (("controlword", "000F"), "000Fh is the command enable operation"),
    (("controlword", "0080h", "--previous", "0080h"), "0080h is no command"),
    (("controlword",), "A control word is a command by bits 7, 3, 2, 1 and 0"),
    (("statusword", "0637h", "--device", "az3"), "0637h is the state operation enabled"),
    (
        ("can-frame", "605#4041600000000000", "--bitrate", "500000"),
        "605#4041600000000000 has 121 bits, 13 of them stuff bits: 242 us at 500000 bit/s",
    ),
    (("can-frame", "605", "40", "41"), "605#4041 has"),
    (("can-frame", "705#05", "605#40"), "605#40 wins and is sent without delay"),
]


@every_case(("arguments", "result"), COMMANDS)
def test_text_and_json_have_the_same_result(arguments: tuple[str, ...], result: str) -> None:
    text = output_of("steps", *arguments)
    (only,) = output_of("steps", *arguments, "--format", "json").splitlines()
    found = json.loads(only)
    assert found["result"].startswith(result)
    assert " ".join(text.splitlines()).rstrip().endswith(found["result"])
    assert text.startswith(found["title"])
    assert output_of("steps", *arguments, "--json").rstrip() == only


def test_the_picture_of_bytes_has_their_value_in_each_order() -> None:
    drawn = output_of("steps", "float", "--bytes", "00 01 00 00", "--type", "u32", "--format", "svg")
    assert drawn.startswith("<svg")
    for value in ("65536", "16777216", "256"):
        assert value in drawn


@every_case(("arguments", "result"), COMMANDS)
def test_html_is_one_page_with_the_calculation(arguments: tuple[str, ...], result: str) -> None:
    page = output_of("steps", *arguments, "--format", "html")
    assert page.startswith("<!DOCTYPE html>")
    assert result in html.unescape(page)
    drawn = {"float", "statusword", "controlword", "can-frame", "timing"}
    several = arguments[0] == "can-frame" and sum("#" in word for word in arguments) > 1
    is_drawn = arguments[0] in drawn and "i16" not in arguments and not several
    assert page.count("<figure") == 1 + is_drawn


def test_ascii_is_drawn_with_seven_data_bits() -> None:
    drawn = output_of("steps", "timing", "--format", "7E1", "--format", "svg")
    assert "3Ah: start" in drawn
    assert "0Ah: LF" in drawn


def test_json_without_numbers_that_json_has_not() -> None:
    assert json.loads(output_of("steps", "float", "nan", "--json"))["values"]["value"] == "nan"


def test_the_form_of_a_character_and_of_the_output_share_an_option() -> None:
    found = json.loads(output_of("steps", "timing", "--format", "json", "--format", "7E1", "--baudrate", "9600"))
    assert found["values"]["bits"] == 10
    assert "expected one form of a character" in error_of(
        *("steps", "timing", "--format", "8E1", "--format", "8N1"), status=2
    )
    assert "give one of them" in error_of("steps", "timing", "--json", "--format", "text", status=2)


def test_each_command_has_help_with_one_line_in_the_list() -> None:
    listed = output_of("steps", "--help").partition("Commands:\n")[2].splitlines()
    assert len(listed) == 8
    for line in listed:
        name, summary = line.split(maxsplit=1)
        assert not summary.endswith("...")
        assert output_of("steps", name, "--help").splitlines()[2].strip() == summary


def test_output_goes_to_stdout_in_one_piece(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["steps", "crc", "02 07"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out.endswith("41 12\n")


@pytest.mark.parametrize(
    ("arguments", "title"),
    [
        (("float", "1.1", "--order", "CDAB"), "1.1 as f32 in two registers"),
        (("float", "-5", "--type", "i32"), "-5 as i32 in two registers"),
        (("statusword", "0250h", "0231h"), "State machine of CiA 402: ready to switch on"),
        (("statusword", "0637h", "--device", "az3"), "State machine of CiA 402 of az3: operation enabled"),
        (("controlword", "000Fh"), "State machine of CiA 402"),
        (("can-frame", "605#40"), "CAN frame 605#40 on the bus"),
        (("timing", "--baudrate", "9600", "--format", "8N2"), "Levels on the line: 8 characters, 8N2, 9600 bit/s"),
    ],
)
def test_steps_with_a_picture(arguments: tuple[str, ...], title: str) -> None:
    root = ElementTree.fromstring(output_of("steps", *arguments, "--format", "svg"))
    assert root.findtext("{http://www.w3.org/2000/svg}title") == title
    assert f"<title>{title}</title>" in output_of("steps", *arguments, "--format", "html")


def test_several_status_words_are_a_path() -> None:
    words = ("steps", "statusword", "0250h", "0231h", "0233h", "0237h")
    assert "4  status  0237h   operation enabled, by transition 4" in output_of(*words)
    assert [word["transitions"] for word in json.loads(output_of(*words, "--json"))["words"]] == [[], [2], [3], [4]]
