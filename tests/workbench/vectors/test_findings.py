"""The findings about other programs: each case that fails belongs to one, and each shows what was measured."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.helpers import every_case
from tests.workbench.vectors.loaded import VECTORS
from tools import findings
from tools.findings import Finding
from tools.peers import PEERS, Peer

BOARD = findings.load_board()
ALL = findings.all_of(BOARD)
SHOWING = {one.name: one for one in PEERS if one.name in ALL}


@every_case("name", SHOWING)
def test_each_case_that_fails_has_one_finding_and_nothing_else_has(name: str) -> None:
    assert findings.problems(name, ALL[name][1], BOARD[name]["failed"]) == [], "write them into its findings.toml"
    assert {*BOARD[name]["shown"]} == findings.shown_cases(SHOWING[name]), f"run make scoreboard ARGS={name}"


def test_the_page_is_made_of_the_findings() -> None:
    text = findings.PAGE.read_text(encoding="utf-8")
    assert findings.with_tables(text, BOARD) == text, "run python -m tools.findings"


def test_the_findings_of_barewire_name_cases_or_commands() -> None:
    ids = {case["id"] for file in VECTORS.files for case in file.cases}
    shown = [one.shown_by for one in ALL["barewire"][1]]
    assert all(name in ids or name.startswith(("make ", "pytest ", "barewire ")) for name in shown)
    assert len(shown) >= 4


def finding(*cases: str, shown_by: str = "lrc-1") -> Finding:
    return Finding("small", "it adds", "wrong value", "it adds `01`", "wrong sums", (), shown_by, cases, "")


@pytest.mark.parametrize(
    ("rows", "failed", "wrong"),
    [
        ([finding("lrc-1")], ["lrc-1", "lrc-2"], "small: no finding has lrc-2, which fails"),
        ([finding("lrc-1", "lrc-3")], ["lrc-1"], "small: lrc-3 does not fail, a finding has it"),
        ([finding("lrc-1"), finding("lrc-1")], ["lrc-1"], "small: lrc-1 is in two findings"),
        ([finding("lrc-2")], ["lrc-2"], "small: it adds: lrc-1 is to show it, and is not among its cases"),
    ],
)
def test_what_does_not_fit_the_scoreboard_is_named(rows: list[Finding], failed: list[str], wrong: str) -> None:
    assert findings.problems("small", rows, failed) == [wrong]


GOOD = """
does_well = "It is small."

[[finding]]
title = "it adds"
consequence = "wrong value"
does = "it adds `01`"
means = "wrong sums"
upstream = ["https://github.com/owner/small/issues/7"]
shown_by = "lrc-1"
cases = "lrc: 1 3-5"
"""


def test_a_file_of_findings_is_read_and_described(tmp_path: Path) -> None:
    file = tmp_path / "findings.toml"
    file.write_text(GOOD)
    does_well, (one,) = findings.read("small", file)
    assert does_well == "It is small."
    assert one.cases == ("lrc-1", "lrc-3", "lrc-4", "lrc-5")
    text = "\n".join(findings.described(1, one, {"shown": {"lrc-1": "encode: F4, expected F3"}}))
    for part in (
        "1. **it adds** (wrong value). it adds `01`",
        "*For a user:* wrong sums",
        "owner/small#7",
        "`` encode: F4",
    ):
        assert part in text
    assert text.endswith("*4 cases:* lrc 1 3-5")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            lambda good: good.replace('"wrong value"', '"bad"'),
            r"it adds: consequence: expected one of wrong value, hang",
        ),
        (lambda good: good.replace('means = "wrong sums"\n', ""), r"it adds: expected the fields cases, consequence"),
        (lambda good: good.replace("3-5", "3-x"), r"lrc: 3-x: expected a number of a case, or a range such as 3-5"),
    ],
)
def test_a_wrong_file_of_findings_is_an_error(change: Callable[[str], str], text: str, tmp_path: Path) -> None:
    file = tmp_path / "findings.toml"
    file.write_text(change(GOOD))
    with pytest.raises(ValueError, match=text):
        findings.read("small", file)


def test_a_finding_is_no_part_of_what_asks_a_program(tmp_path: Path) -> None:
    folder = tmp_path / "small"
    folder.mkdir()
    (folder / "peer.toml").write_text('name = "small"\nlanguage = "C"\nwhat = "a program of this test"\n')
    before = Peer(folder).digest
    (folder / "findings.toml").write_text(GOOD)
    assert Peer(folder).digest == before
