"""Lines of the text gateway that are empty, wrong, too long or arbitrary, and its help."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.conversation import play
from barewire_workbench.ascii_gateway.lines import TYPE_NAMES, GatewayError, from_text, split_line, to_text
from barewire_workbench.ascii_gateway.session import GatewaySession, parse_line
from tests.helpers import every_case
from tests.workbench.ascii_gateway.test_session import answer_to


@pytest.mark.parametrize("line", ["", "   ", "# a comment", "  # another"])
def test_empty_lines_are_not_answered(line: str) -> None:
    assert play(GatewaySession().answer(line), lambda frame, at: [])[0] == []


@every_case(
    ("line", "code"),
    [
        ("5 start", "[0] ERROR:101"),
        ("[x] 5 start", "[0] ERROR:101"),
        ("[-1] 5 start", "[0] ERROR:101"),
        ("[4294967296] 5 start", "[0] ERROR:101"),
        ("x[1] 5 start", "[0] ERROR:101"),
        ("[1", "[0] ERROR:101"),
        ("[1]", "[1] ERROR:101"),
        ("[1] 5", "[1] ERROR:101"),
        ("[1] 5 raed 0x6041 0", "[1] ERROR:100"),
        ("[1] 5 read", "[1] ERROR:101"),
        ("[1] 5 read 0x6041", "[1] ERROR:101"),
        ("[1] 5 read 0x16041 0", "[1] ERROR:101"),
        ("[1] 5 read 0x6041 256", "[1] ERROR:101"),
        ("[1] 5 read 0x6041 0 u17", "[1] ERROR:101"),
        ("[1] 5 read 0x6041 0 u16 7", "[1] ERROR:101"),
        ("[1] 5 write 0x6040 0 u16", "[1] ERROR:101"),
        ("[1] 5 write 0x6040 0 u16 65536", "[1] ERROR:101"),
        ("[1] 5 write 0x6040 0 u16 1.5", "[1] ERROR:101"),
        ("[1] 5 write 0x6040 0 b 2", "[1] ERROR:101"),
        ("[1] 5 write 0x6040 0 t 1", "[1] ERROR:101"),
        ("[1] 5 write 0x6040 0 t 1 86400000", "[1] ERROR:101"),
        ("[1] 5 write 0x6040 0 hex 0", "[1] ERROR:101"),
        ("[1] 5 write 0x6040 0 d !", "[1] ERROR:101"),
        ('[1] 5 write 0x6040 0 vs "open', "[1] ERROR:101"),
        ("[1] 5 reset", "[1] ERROR:101"),
        ("[1] 5 reset everything", "[1] ERROR:101"),
        ("[1] 1 5 set node 5", "[1] ERROR:101"),
        ("[1] 1 5 7 start", "[1] ERROR:101"),
        ("[1] set sdo_timeout 0", "[1] ERROR:101"),
        ("[1] set sdo_timeout x", "[1] ERROR:101"),
        ("[1] set speed 9", "[1] ERROR:100"),
        ("[1] set id 9", "[1] ERROR:100"),
        ("[1] set heartbeat 100", "[1] ERROR:100"),
        ("[1] init 4", "[1] ERROR:100"),
        ("[1] init 9", "[1] ERROR:100"),
        ("[1] log", "[1] ERROR:100"),
        ("[1] help me", "[1] ERROR:101"),
        ("[1] _emcy_indication", "[1] ERROR:101"),
        ("[1] lss_set_node 200", "[1] ERROR:101"),
        ("[1] lss_switch_glob 2", "[1] ERROR:101"),
        ("[1] lss_switch_sel 1 2 3", "[1] ERROR:101"),
        ("[1] lss_inquire_addr 4", "[1] ERROR:101"),
        ("[1] lss_activate_bitrate 70000", "[1] ERROR:101"),
        ("[1] lss_allnodes 1 200", "[1] ERROR:101"),
        ("[1] lss_allnodes 1 2 0 2 5", "[1] ERROR:101"),
        ("[1] lss_allnodes 1 2 0 3 5 0 0 0 0 0 0", "[1] ERROR:101"),
        ("[1] write pdo 1 2 3", "[1] ERROR:101"),
        ("[1] read pdo 0", "[1] ERROR:101"),
        ("[1] set rpdo 1 0x185 often 0", "[1] ERROR:101"),
        ("[1] set rpdo 1 0x185 event 1 0x2000 0 vs", "[1] ERROR:101"),
        ("[1] 5 enable", "[1] ERROR:101"),
        ("[1] 5 enable heartbeat 0", "[1] ERROR:101"),
    ],
)
def test_invalid_commands_get_an_error_code(line: str, code: str) -> None:
    answer = answer_to(GatewaySession(), line)
    assert answer.startswith(f"{code} #"), answer


def test_a_line_that_is_too_long_is_refused() -> None:
    assert answer_to(GatewaySession(), f"[1] 5 w 0x2000 0 d {'A' * 70_000}").startswith("[0] ERROR:600 #")


def test_help_and_version() -> None:
    lines = play(GatewaySession().answer("[1] help lss"), lambda frame, at: [])[0]
    assert lines[-1] == "[1] OK"
    assert any("_lss_fastscan" in line for line in lines)
    assert not any("boot_up" in line for line in lines)
    (types, _) = play(GatewaySession().answer("[1] help datatype"), lambda frame, at: [])[0]
    assert types.startswith("types: ")
    everything = play(GatewaySession().answer("[1] help"), lambda frame, at: [])[0]
    assert types in everything
    assert set(lines) < set(everything)
    assert answer_to(GatewaySession(version="barewire 1.2"), "[2] info version") == "[2] barewire 1.2"


@given(st.text(max_size=60) | st.from_regex(r"\[1\] ([0-9x]{1,3} ){0,2}(r|w|set|lss_\w+|enable) [ -~]{0,30}"))
def test_any_line_is_answered(line: str) -> None:
    answers = play(GatewaySession().answer(line), lambda frame, at: [])[0]
    assert all(answer.isprintable() for answer in answers), answers


@given(st.text(max_size=40))
def test_any_words_parse_or_raise_a_gateway_error(line: str) -> None:
    try:
        sequence = parse_line(f"[1] {line}").sequence
    except GatewayError as refused:
        sequence = 1 if refused.code in (100, 101, 401) else 0
    assert sequence == 1


@given(st.lists(st.text(max_size=8).filter(lambda text: "\x00" not in text), max_size=4))
def test_quotes_hold_any_word_together(words: list[str]) -> None:
    line = " ".join('"' + word.replace('"', '""') + '"' for word in words)
    assert split_line(line) == words


@every_case("type", TYPE_NAMES)
def test_text_and_bytes_convert_both_ways(type: str) -> None:
    if type in ("vs", "os", "us", "d", "hex"):
        data = b"ab"
    else:
        words = ["1", "2"] if type in ("t", "td") else ["1"]
        data = from_text(type, words)
    words = split_line(to_text(type, data)) if type != "vs" else ["ab"]
    assert from_text(type, words) == data
