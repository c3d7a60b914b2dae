"""Expectations that are our own are found: bytes that belong to a manufacturer, and cases that others contradict."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

VECTORS = Path(__file__).parents[3] / "vectors"
CASES: list[tuple[str, dict[str, Any]]] = [
    (document["kind"], case)
    for file in sorted(VECTORS.glob("cases/*/*.json"))
    if "cases" in (document := json.loads(file.read_text(encoding="utf-8")))
    for case in document["cases"]
]
EMCY = re.compile(r"0(8[1-9A-F]|[9A-E][0-9A-F]|F[0-9A-F])#([0-9A-F]{4})..(.{10})")
"""The code of an emergency, and the bytes of the manufacturer."""


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
