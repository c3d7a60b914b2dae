"""Every case of vectors/, run with barewire, and the rules for the files.

`tests/vectors_runner` runs the cases. The rules: the schema, unique ids, a runner for each kind, the reasons of
barewire, and files and README as `tools/vectors.py` formats them.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from barewire.errors import REASONS
from tests.vectors_runner.common import Case
from tests.vectors_runner.kinds import RUNNERS
from tools import vectors

ROOT = Path(__file__).parent.parent
VECTORS = ROOT / "vectors"
FILES = sorted(VECTORS.glob("*/*.json"))
SCHEMA = json.loads((VECTORS / "schema.json").read_text(encoding="utf-8"))
README = (VECTORS / "README.md").read_text(encoding="utf-8")
DOCUMENTS: dict[Path, dict[str, Any]] = {file: json.loads(file.read_text(encoding="utf-8")) for file in FILES}
CASES = [(document["kind"], case) for document in DOCUMENTS.values() for case in document["cases"]]


def named(file: Path) -> str:
    return file.relative_to(VECTORS).as_posix()


@pytest.mark.parametrize(("kind", "case"), CASES, ids=[case["id"] for _, case in CASES])
def test_vector(kind: str, case: Case) -> None:
    RUNNERS[kind](case)


# The runners -----------------------------------------------------------------------------------------------------

NOT_COMPARED = {"id", "result", "reason", "fails", "flags", "comment", "source", "printed", "side"}
"""Fields that describe a case; the others are input or expected output of its runner."""


def altered(value: Any) -> Iterator[Any]:
    """Yield the same value with one change in it."""
    if isinstance(value, bool):
        yield not value
    elif isinstance(value, (int, float)):
        yield from (value + 1, value - 1)
    elif isinstance(value, str):
        yield from (value[:-1] + ("0" if value.endswith("1") else "1"), value + "0")
    elif isinstance(value, list):
        yield from (value[:place] + value[place + 1 :] for place in range(len(value)))
        for place, item in enumerate(value):
            yield from ([*value[:place], other, *value[place + 1 :]] for other in altered(item))
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from ({**value, key: other} for other in altered(item))


@pytest.mark.parametrize("kind", RUNNERS)
def test_a_runner_fails_for_a_change_in_any_field(kind: str) -> None:
    """A runner that did not compare a field would pass every change of it."""
    noticed, failed = set[str](), False
    cases = [case for case_kind, case in CASES if case_kind == kind and case["result"] != "invalid"]
    fields = {field for case in cases for field in case if list(altered(case[field]))} - NOT_COMPARED
    if kind == "sdo-talk":
        fields.discard("node")  # its frames are written without an identifier, so every node is right
    for case, field in itertools.product(cases, fields):
        for other in altered(case.get(field)) if field not in noticed else ():
            try:
                RUNNERS[kind]({**case, field: other})
            except (AssertionError, pytest.fail.Exception):
                failed = True
                noticed.add(field)
                break
            except Exception:  # the change made the case unreadable
                noticed.add(field)
    assert noticed == fields
    assert failed, "no comparison failed"


# The files -------------------------------------------------------------------------------------------------------

validator = jsonschema.Draft202012Validator(SCHEMA)


def test_the_schema_is_a_valid_json_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("file", FILES, ids=named)
def test_a_file_follows_the_schema_and_the_rules(file: Path) -> None:
    document = DOCUMENTS[file]
    wrong = [f"{error.json_path}: {error.message}" for error in validator.iter_errors(document)]
    assert not wrong, "\n".join(wrong)
    assert document["kind"] in RUNNERS, "a kind without a runner"
    assert len(document["cases"]) < 100, "one subject, under a hundred cases"
    for case in document["cases"]:
        assert re.fullmatch(rf"{re.escape(file.stem)}-[1-9]\d*", case["id"]), case["id"]


def test_every_kind_has_a_runner_vectors_and_a_section_of_the_readme() -> None:
    assert set(RUNNERS) == {document["kind"] for document in DOCUMENTS.values()}
    assert set(RUNNERS) == set(SCHEMA["properties"]["kind"]["enum"])
    assert [kind for kind in RUNNERS if f"### {kind}" not in README] == []


def test_ids_are_unique() -> None:
    ids = [case["id"] for _, case in CASES]
    assert sorted(ids) == sorted(set(ids))


def test_reasons_are_those_of_the_library() -> None:
    assert set(SCHEMA["$defs"]["reason"]["enum"]) == set(REASONS)
    assert [reason for reason in REASONS if f"| `{reason}` |" not in README] == []
    assert {case["reason"] for _, case in CASES if "reason" in case} <= set(REASONS)


def test_flags_are_explained() -> None:
    flags = SCHEMA["$defs"]["flags"]["items"]["enum"]
    assert [flag for flag in flags if f"| `{flag}` |" not in README] == []
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
}
"""By kind: the fields that are one half of a comparison."""


@pytest.mark.parametrize("file", FILES, ids=named)
def test_a_wrong_pair_shares_one_half_with_a_valid_case(file: Path) -> None:
    """A pair that does not match proves little alone: any typing error makes one. So one half of it is in a valid case
    of the same file, with the matching other half."""
    cases, kind = DOCUMENTS[file]["cases"], DOCUMENTS[file]["kind"]
    right = [case for case in cases if case["result"] == "valid"]
    for case in cases:
        if case.get("fails") == "compare":
            halves = [[case.get(key) for key in given] for given in HALVES[kind]]
            known = [[valid.get(key) for key in given] for given in HALVES[kind] for valid in right]
            assert any(half in known for half in halves), case["id"]


# The tool --------------------------------------------------------------------------------------------------------


def test_every_file_is_in_the_table() -> None:
    assert sorted(vectors.files()) == FILES


@pytest.mark.parametrize("file", FILES, ids=named)
def test_a_file_is_formatted(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert vectors.form(DOCUMENTS[file]) == text, "run python tools/vectors.py"


def test_the_table_of_the_readme_is_up_to_date() -> None:
    assert vectors.with_counts(README) == README, "run python tools/vectors.py"
