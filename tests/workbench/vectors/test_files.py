"""The rules for the files of vectors/: the schema, unique ids, an answer of barewire for each kind, the reasons of
barewire, and files and pages as `tools/vectors.py` formats them."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from barewire.errors import REASONS
from barewire_workbench.vectors.answers.table import ANSWERS
from tests.helpers import every_case, part_or_whole
from tools import vectors

ROOT = Path(__file__).parents[3]
VECTORS = ROOT / "vectors"
FILES = sorted(VECTORS.glob("cases/*/*.json"))
SCHEMA = json.loads((VECTORS / "schema.json").read_text(encoding="utf-8"))
CASES_PAGE = (VECTORS / "CASES.md").read_text(encoding="utf-8")
DOCUMENTS: dict[Path, dict[str, Any]] = {file: json.loads(file.read_text(encoding="utf-8")) for file in FILES}
CASES = [(document["kind"], case) for document in DOCUMENTS.values() for case in document["cases"]]


def named(file: Path) -> str:
    return file.relative_to(VECTORS).as_posix()


# The files -------------------------------------------------------------------------------------------------------

validator = jsonschema.Draft202012Validator(SCHEMA)


def test_the_schema_is_a_valid_json_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


def forms(value: Any) -> set[tuple[str, ...]]:
    """Each path of names in a case, with what is at its end: a word, the form of a short number, or a type."""
    if isinstance(value, dict):
        return {(name, *rest) for name, item in value.items() if name != "id" for rest in forms(item)}
    if isinstance(value, list):
        return {rest for item in value for rest in forms(item)}
    if isinstance(value, str):
        is_word = re.fullmatch("[a-z][a-z_-]*", value)
        return {(value if is_word else re.sub("[0-9A-Fa-f]", "0", value) if len(value) < 6 else "",)}
    return {(type(value).__name__,)}


def new_forms() -> dict[Path, list[Any]]:
    """Of each file the cases with a form that no case of the kind before them has, and every 20th."""
    seen: dict[str, set[tuple[str, ...]]] = {}
    found: dict[Path, list[Any]] = {}
    for file, document in DOCUMENTS.items():
        known = seen.setdefault(document["kind"], set())
        for place, case in enumerate(document["cases"]):
            if not (given := forms(case)) <= known or place % 20 == 0:
                found.setdefault(file, []).append(case)
            known |= given
    return found


@pytest.mark.parametrize(
    "cases",
    part_or_whole(new_forms(), {file: document["cases"] for file, document in DOCUMENTS.items()}),
    ids=["a part", "all"],
)
@every_case("file", FILES)
def test_a_file_follows_the_schema_and_the_rules(file: Path, cases: dict[Path, list[Any]]) -> None:
    """A part are the cases of `new_forms`: a wrong name, word or type is a form that no other case has."""
    document = DOCUMENTS[file]
    checked = {**document, "cases": cases[file]}
    wrong = [f"{error.json_path}: {error.message}" for error in validator.iter_errors(checked)]
    assert not wrong, "\n".join(wrong)
    assert document["kind"] in ANSWERS, "a kind without an answer"
    assert len(document["cases"]) < 100, "one subject, under a hundred cases"
    for case in document["cases"]:
        assert re.fullmatch(rf"{re.escape(file.stem)}-[1-9]\d*", case["id"]), case["id"]


def test_every_kind_has_answers_vectors_operations_and_a_page() -> None:
    assert set(ANSWERS) == {document["kind"] for document in DOCUMENTS.values()}
    assert set(ANSWERS) == set(SCHEMA["properties"]["kind"]["enum"])
    kinds = json.loads((VECTORS / "kinds.json").read_text(encoding="utf-8"))
    assert {kind: set(row) for kind, row in kinds.items()} == {kind: set(row) for kind, row in ANSWERS.items()}
    assert {*ANSWERS} == {file.stem for file in (VECTORS / "kinds").iterdir()}


def test_ids_are_unique() -> None:
    ids = [case["id"] for _, case in CASES]
    assert sorted(ids) == sorted(set(ids))


def test_reasons_are_those_of_the_library() -> None:
    assert set(SCHEMA["$defs"]["reason"]["enum"]) == set(REASONS)
    assert [reason for reason in REASONS if f"| `{reason}` |" not in CASES_PAGE] == []
    assert {case["reason"] for _, case in CASES if "reason" in case} <= set(REASONS)


def test_flags_are_explained() -> None:
    flags = SCHEMA["$defs"]["flags"]["items"]["enum"]
    assert [flag for flag in flags if f"| `{flag}` |" not in CASES_PAGE] == []
    assert set(flags) == {flag for _, case in CASES for flag in case.get("flags", ())}


def test_the_printed_lrc_f5_is_in_an_invalid_and_a_valid_case() -> None:
    """The ADXL manual's LRC of 01 04 00 00 08: F3 is right, the printed F5 belongs to 01 04 00 00 06."""
    found = {(case["bytes"], case["lrc"]): case["result"] for kind, case in CASES if kind == "lrc"}
    assert found["01 04 00 00 08", "F3"] == "valid"
    assert found["01 04 00 00 08", "F5"] == "invalid"
    assert found["01 04 00 00 06", "F5"] == "valid"


HALVES: dict[str, list[tuple[str, ...]]] = {
    "crc16": [("bytes",)],
    "lrc": [("bytes",)],
    "number": [("type", "order", "value"), ("type", "order", "bytes")],
    "bits": [("bits",), ("bytes",)],
    "register-part": [("register", "part")],
    "rtu-timing": [("baud", "bits")],
    "parameter": [("parameter", "registers"), ("parameter", "value")],
    "drive-state": [("word",), ("state",)],
    "drive-command": [("word",), ("command",)],
    "cob-entry": [("value",)],
    "heartbeat-consumer": [("bytes",)],
}
"""By kind: the fields that are one half of a comparison."""


@every_case("file", FILES)
def test_a_wrong_pair_shares_one_half_with_a_right_one(file: Path) -> None:
    """A pair that does not match proves little alone: any typing error makes one. So one half of it is in a valid or
    acceptable case of the same file, with the matching other half."""
    cases, kind = DOCUMENTS[file]["cases"], DOCUMENTS[file]["kind"]
    right = [case for case in cases if case["result"] != "invalid"]
    for case in cases:
        if case.get("fails") == "compare":
            halves = [[case.get(key) for key in given] for given in HALVES[kind]]
            known = [[valid.get(key) for key in given] for given in HALVES[kind] for valid in right]
            assert any(half in known for half in halves), case["id"]


# The tool --------------------------------------------------------------------------------------------------------


def test_every_file_is_in_the_table() -> None:
    assert sorted(vectors.files()) == FILES


@every_case("file", FILES)
def test_a_file_is_formatted(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert vectors.form(DOCUMENTS[file]) == text, "run python tools/vectors.py"


def test_the_index_is_up_to_date() -> None:
    assert vectors.index() == (VECTORS / "index.json").read_text(encoding="utf-8"), "run python tools/vectors.py"


@every_case("name", vectors.tables())
def test_the_tables_of_a_page_are_up_to_date(name: str) -> None:
    page = (VECTORS / name).read_text(encoding="utf-8")
    assert vectors.with_tables(page, vectors.tables()[name]) == page, "run python tools/vectors.py"
