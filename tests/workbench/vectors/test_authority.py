"""Each case says by what authority it is right, and expectations that are our own are found."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tools import vectors

VECTORS = Path(__file__).parents[3] / "vectors"
DOCUMENTS: list[dict[str, Any]] = [json.loads(file.read_text(encoding="utf-8")) for file in vectors.files()]
CASES: list[tuple[str, dict[str, Any]]] = [
    (document["kind"], case) for document in DOCUMENTS for case in document["cases"]
]
STANDARDS: dict[str, dict[str, str]] = json.loads((VECTORS / "standards.json").read_text(encoding="utf-8"))
EMCY = re.compile(r"0(8[1-9A-F]|[9A-E][0-9A-F]|F[0-9A-F])#([0-9A-F]{4})..(.{10})")
"""The code of an emergency, and the bytes of the manufacturer."""


def of_their_own(document: dict[str, Any], case: dict[str, Any]) -> str:
    """What a case lacks of the authority that it names, its own or that of its file; "" if it has all."""
    by = case.get("by", document["by"])
    have = {name for part in (document, case) for name in part}
    lacks = {"standard": {"clause"}, "manual": {"source"}, "convention": {"origin"}, "barewire": set[str]()}[by] - have
    if (by == "barewire") != ("policy" in case.get("flags", ())):
        return f"{case['id']}: by barewire means the flag policy"
    return f"{case['id']}: by {by} needs {', '.join(lacks)}" if lacks else ""


def test_no_case_is_without_authority() -> None:
    lacking = [of_their_own(document, case) for document in DOCUMENTS for case in document["cases"]]
    assert [text for text in lacking if text] == []


def test_each_clause_names_a_standard_of_its_file_with_the_version_that_was_read() -> None:
    known = {f"{name} {row['version']}".rstrip(): name for name, row in STANDARDS.items()}
    wrong = []
    for document in DOCUMENTS:
        named = document.get("standard", [])
        wrong += [f"{document['subject']}: {standard}" for standard in named if standard not in known]
        names = tuple(known[standard] for standard in named if standard in known)
        clauses = [part["clause"] for part in (document, *document["cases"]) if "clause" in part]
        wrong += [text for text in clauses if names and not all(begins(part, names) for part in text.split("; "))]
    assert wrong == []
    assert {known[standard] for document in DOCUMENTS for standard in document.get("standard", ())} == set(STANDARDS)


def begins(part: str, names: tuple[str, ...]) -> bool:
    """Whether a part of a clause begins with a standard, or with a number in the one before."""
    return part.startswith(names) or part[0].isdigit()


def test_a_file_that_decides_what_its_authority_leaves_open_says_what_that_is() -> None:
    silent = [
        document["subject"]
        for document in DOCUMENTS
        if document["open"] == "Nothing."
        and any(case["result"] == "acceptable" or case.get("by") == "barewire" for case in document["cases"])
    ]
    assert silent == []


def emergencies(case: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield code and manufacturer bytes of each emergency that a device sends."""
    for step in case["talk"]:
        for said in step["say"]:
            for frame in said["one_of"] if isinstance(said, dict) else [said]:
                if found := EMCY.fullmatch(frame):
                    yield found[2], found[3]


def acted(case: dict[str, Any]) -> set[str]:
    """The codes that the application of the device reports, as in a frame; with one that ends, 0000."""
    acts = [act for step in case["talk"] for act in step.get("act", ())]
    codes = {act["error"][2:] + act["error"][:2] for act in acts if "error" in act}
    return codes | ({"0000"} if any("clear" in act for act in acts) else set())


def test_the_manufacturer_bytes_of_an_emergency_are_open_unless_the_case_gives_them() -> None:
    """CiA 301 leaves the last five bytes to the manufacturer; the application of a case may give them (`act`)."""
    named = [
        case["id"]
        for kind, case in CASES
        if kind == "device"
        for code, bytes_ in emergencies(case)
        if code not in acted(case) and bytes_ != ".........."
    ]
    assert named == [], "write two dots for each byte of the manufacturer"


def contradicted() -> set[str]:
    """The cases that nobody confirms and at least two programs answer otherwise."""
    found = set()
    for _, case in CASES:
        against = re.match(r"answered otherwise by ([^;]+)", case.get("unconfirmed", ""))
        if case["result"] != "acceptable" and against and "," in against[1]:
            found.add(case["id"])
    return found


def test_each_case_that_others_contradict_was_read_and_has_its_reason() -> None:
    rows: list[dict[str, Any]] = json.loads((VECTORS / "contradicted.json").read_text(encoding="utf-8"))
    listed = [case_id for row in rows for case_id in row["cases"]]
    assert all(len(row["why"]) > 20 for row in rows)
    assert len(listed) == len({*listed})
    assert contradicted() - {*listed} == set(), "read the case: correct it, or say in contradicted.json why it is right"
    assert {*listed} - contradicted() == set(), "somebody confirms it now, or fewer contradict"
