"""The pages of vectors/, from which people write adapters and runners: examples run, and every field has its row."""

from __future__ import annotations

import json
import re
import shlex
import sys
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from barewire_workbench.live import vector_adapter
from barewire_workbench.live.vector_adapter import VectorAdapter
from barewire_workbench.vectors.judge import _UNORDERED, judge
from barewire_workbench.vectors.questions import DESCRIPTION, Question
from barewire_workbench.vectors.run import run_cases, selected
from tests.helpers import every_case
from tests.workbench.vectors.loaded import VECTORS
from tools.vectors_release import questions

PAGES = Path(__file__).parents[3] / "vectors"
TEXT = "\n".join((PAGES / name).read_text(encoding="utf-8") for name in ("START.md", "PROTOCOL.md", "CASES.md"))
DESCRIBES = {*DESCRIPTION, "id", "result", "reason", "fails", "flags", "do"}
"""Fields of all kinds, which the first sections describe."""


def block(language: str, word: str) -> str:
    """The fenced block of this language that has the word in it."""
    (found,) = [text for text in re.findall(rf"```{language}\n(.*?)```", TEXT, flags=re.DOTALL) if word in text]
    return str(found)


def section(heading: str) -> str:
    """The text below a heading, up to the next one of its level."""
    level = heading.partition(" ")[0]
    below = TEXT.partition(f"\n{heading}\n")[2]
    assert below, f"{heading} is on no page"
    return re.split(rf"\n#{{1,{len(level)}}} ", below)[0]


# The examples -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("language", "program", "name"),
    [
        ("python", sys.executable, "small.py"),
        pytest.param("js", "node", "small.js", marks=pytest.mark.needs("node")),
    ],
)
def test_the_adapters_of_the_pages_pass(language: str, program: str, name: str, tmp_path: Path) -> None:
    file = tmp_path / name
    file.write_text(block(language, "'small'" if language == "js" else '"small"'), encoding="utf-8")
    cases = selected(VECTORS, kinds=["lrc", "sync"])
    with VectorAdapter(shlex.join([program, str(file)])) as adapter:
        found = {checked.id: checked.verdict for checked in run_cases(cases, adapter)}
    wrong = {case_id: verdict for case_id, verdict in found.items() if verdict.state != "passed"}
    assert {*wrong} == {"sync-9", "sync-10"}  # its encoder is not offered
    assert {verdict.state for verdict in wrong.values()} <= {"not offered"}


def asked(text: str) -> dict[str, Question]:
    """The questions of the example's case, which must be the one of the file."""
    file, case = VECTORS.find(json.loads(text)["id"])
    assert json.loads(text) == {name: case[name] for name in case if name not in ("confirmed_by", "unconfirmed")}
    return {question.id: question for question in VECTORS.questions(file, case)}


def test_the_worked_example_is_what_the_case_asks() -> None:
    questions = asked(block("json", '"comment": "unit 2, read'))
    lines = [json.loads(line) for line in block("json", '"do": "receive", "side"').splitlines() if line]
    given, answers = lines[::2], lines[1::2]
    for question, answer in zip(given, answers, strict=True):
        assert question == questions[question["id"]].as_json()
        assert answer["id"] == question["id"]
        assert judge(questions[question["id"]], answer).state == "passed"
    assert len(given) == 3


def test_the_rows_of_the_worked_example_are_those_of_its_kind() -> None:
    kinds = json.loads("{" + block("json", '"rtu-frame": {') + "}")
    found: dict[str, Any] = json.loads((Path(__file__).parents[3] / "vectors" / "kinds.json").read_text("utf-8"))
    assert kinds["rtu-frame"] == found["rtu-frame"]


def test_the_numbers_of_the_protocol_are_those_of_the_program() -> None:
    text = section("## An adapter")
    assert f'{{"hello": "barewire-vectors", "protocol": {vector_adapter.PROTOCOL}}}' in text
    assert f"the hello {vector_adapter.START_TIMEOUT:g} s" in text
    assert vector_adapter._LOST_MOST == 20
    assert "After twenty such losses" in text
    assert vector_adapter.LINE_LONGEST == 1 << 20
    assert "at most 1 MiB" in text


def test_the_line_of_a_release_is_one_of_its_questions() -> None:
    line = json.loads(block("json", '{"case": "lrc-1"'))
    assert line in [json.loads(row) for row in islice(questions(), 3000) if b'"lrc-1"' in row]


def test_the_longest_question_is_as_short_as_the_page_says() -> None:
    assert "that of a question less than 16 KiB" in section("## An adapter")
    asked = [question for file in VECTORS.files for case in file.cases for question in VECTORS.questions(file, case)]
    assert max(len(json.dumps(question.as_json())) for question in asked) < 16 * 1024


VALID = {"result": "valid"}
SHORT = {"result": "invalid", "fails": "decode", "reason": "short"}
PAIR = {"result": "invalid", "fails": "compare", "reason": "checksum"}
OPEN = {"result": "acceptable"}
TOLERANT = {"result": "acceptable", "flags": ["tolerant"]}
RIGHT, WRONG, MORE = {"is": {"bytes": "0A 0B"}}, {"is": {"bytes": "0A"}}, {"is": {"bytes": "0a0b", "more": 1}}
NOTHING = [{"is": {"bytes": None}}, {"is": {"bytes": ""}}]
REFUSED, SILENT, OTHER = {"refused": "short"}, {"refused": ""}, {"refused": "long"}


@pytest.mark.parametrize(
    ("case", "do", "answers", "state"),
    [
        (VALID, "decode", [RIGHT, MORE], "passed"),
        (VALID, "decode", [WRONG, REFUSED, {}, {"is": []}, {"refused": 1}, {"is": {}}], "failed"),
        (SHORT, "decode", [REFUSED, SILENT], "passed"),
        (SHORT, "decode", [RIGHT, WRONG, OTHER, {}], "failed"),
        (PAIR, "encode", [WRONG], "passed"),
        (PAIR, "encode", [REFUSED, OTHER], "open"),
        (PAIR, "encode", [RIGHT, MORE, {}, {"is": {}}, *NOTHING], "failed"),
        (OPEN, "encode", [RIGHT, WRONG, REFUSED], "passed"),
        (TOLERANT, "encode", [WRONG, REFUSED], "passed"),
        (TOLERANT, "encode", [RIGHT, MORE, {"is": {}}, *NOTHING], "failed"),
        (OPEN, "decode", [RIGHT], "passed"),
        (TOLERANT, "decode", [WRONG, REFUSED, SILENT], "open"),
        (VALID, "decode", [{"not_offered": "so"}], "not offered"),
    ],
)
def test_the_verdicts_are_those_of_the_table(
    case: dict[str, Any], do: str, answers: list[dict[str, Any]], state: str
) -> None:
    question = Question({"id": "x-1", **case}, "number", do, {"type": "u16"}, {"bytes": "0A 0B"})
    assert {judge(question, answer).state for answer in answers} == {state}


@pytest.mark.parametrize(
    ("kind", "type_", "wanted", "found", "same"),
    [
        ("number", "i8", "1", "1.0", True),
        ("number", "f32", "0.1", "0.100000001", True),
        ("number", "f64", "0.1", "0.100000001", False),
        ("number", "f64", "nan", "-nan", True),
        ("object-value", "VISIBLE_STRING", "1", "1.0", False),
        ("object-value", "BOOLEAN", True, 1, False),
        ("number", "i8", None, None, True),
    ],
)
def test_values_are_equal_as_described(kind: str, type_: str, wanted: object, found: object, same: bool) -> None:
    question = Question({"id": "x-1", "result": "valid"}, kind, "decode", {"type": type_}, {"value": wanted})
    assert (judge(question, {"is": {"value": found}}).state == "passed") is same


def test_the_kinds_whose_frames_come_in_any_order_are_named() -> None:
    (line,) = [line for line in section("## The verdict").splitlines() if "in any order" in line]
    assert re.findall("`([a-z0-9-]+)`", line) == [*_UNORDERED]


# The fields -------------------------------------------------------------------------------------------------------


@every_case("kind", VECTORS.kinds)
def test_every_field_of_a_kind_has_its_row(kind: str) -> None:
    fields = {name for file in VECTORS.files if file.kind == kind for case in file.cases for name in case}
    for operation in VECTORS.kinds[kind]:
        fields |= {name.removesuffix("?") for name in (*operation.given, *operation.gives)}
    page = (PAGES / "kinds" / f"{kind}.md").read_text(encoding="utf-8")
    table = page.partition("\n| field | form | meaning |\n")[2].partition("\n\n")[0]
    rows = re.findall(r"^\| `([a-z_0-9]+)` \| (.+?) \| .+ \|$", table, flags=re.MULTILINE)
    assert sorted(fields - DESCRIBES) == sorted(name for name, _ in rows), (
        "rows of the table | field | form | meaning |"
    )


def test_the_first_page_fits_on_a_screen() -> None:
    assert len((PAGES / "START.md").read_text(encoding="utf-8").splitlines()) <= 60
    assert len((PAGES / "README.md").read_text(encoding="utf-8").splitlines()) <= 80


@every_case("file", sorted((PAGES / "judge").glob("*/*")))
def test_a_file_of_a_judge_is_short(file: Path) -> None:
    """As PROTOCOL.md says of what judges; readers of JSON and what fills a case are longer."""
    if file.is_file() and not file.name.startswith(("json.", "fill.")):
        assert len(file.read_text(encoding="utf-8").splitlines()) < 150


def test_the_known_services_of_lss_are_those_of_the_reference() -> None:
    page = (PAGES / "kinds" / "lss.md").read_text(encoding="utf-8")
    line = page.partition("The known services are, of a request: ")[2].partition("\nEvery")[0]
    named = [text.strip(" .") for text in line.partition("; of an answer: ")[::2]]
    found = []
    for text in named:
        ranges = [part.split(" to ") for part in text.split(", ")]
        found.append({code for row in ranges for code in range(int(row[0], 16), int(row[-1], 16) + 1)})
    reference = (PAGES / "reference" / "canopen" / "services.py").read_text(encoding="utf-8")
    services: dict[str, Any] = {}
    exec("LSS_SERVICES" + reference.partition("\nLSS_SERVICES")[2].partition("\n}\n")[0] + "\n}", services)
    assert found == [{*row} for row in services["LSS_SERVICES"].values()]
