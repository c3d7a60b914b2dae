"""The closed list of codes, and how a finding is shown."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from barewire_workbench import DiagnosisCode, Explanation, Finding
from barewire_workbench.frames.findings import MEANINGS

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "diagnosis.md"
FINDING = Finding("cut-frame", "the beginning of a response, 5 bytes are missing", "01 03 06 ...")


def test_every_code_has_a_meaning_of_one_line() -> None:
    assert list(MEANINGS) == list(get_args(DiagnosisCode))
    assert all(text.endswith(".") and text.isprintable() and len(text) < 110 for text in MEANINGS.values())
    assert len(set(MEANINGS.values())) == len(MEANINGS)


def test_every_code_is_in_the_reference_with_its_meaning() -> None:
    page = PAGE.read_text(encoding="utf-8")
    missing = [code for code, text in MEANINGS.items() if code not in page or text not in page]
    assert not missing, "docs/reference/diagnosis.md"


def test_an_explanation_shows_its_first_finding_after_the_verdict_and_all_of_them_in_its_dict() -> None:
    role = Finding("role", "this is a response", "...")
    explanation = Explanation("rtu", None, (), None, "nothing", (FINDING, role))
    assert explanation.lines()[1:] == [
        "diagnosis: the beginning of a response, 5 bytes are missing [cut-frame]: 01 03 06 ..."
    ]
    assert explanation.as_dict()["diagnosis"] == [
        {
            "code": "cut-frame",
            "text": "the beginning of a response, 5 bytes are missing",
            "proof": "01 03 06 ...",
        },
        {"code": "role", "text": "this is a response", "proof": "..."},
    ]
    assert Explanation("rtu", None, (), None, "nothing").as_dict()["diagnosis"] == []


def test_a_long_proof_is_cut_in_the_line_of_text_only() -> None:
    long = Finding("two-frames", "300 frames one behind the other", "01 03 " * 300)
    assert len(long.line) < 500
    assert long.line.endswith(" ...")
    assert long._asdict()["proof"] == long.proof
