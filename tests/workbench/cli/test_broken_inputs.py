"""Broken inputs, damaged frames of manuals and bytes from issue threads: the first finding is the right one."""

from __future__ import annotations

import pytest

from tools import diagnosis_table

MISSED = {"az3-two-bytes-lost", "adxl-half-as-fast"}
"""Two bytes lost look like a missing CRC, and at half the baud rate half of the bits are never sampled."""
EXPLAINED = [case for case in diagnosis_table.cases("threads.json") if case["how"] != ["diagnose"]]


def test_damaged_frames_of_manuals_have_the_right_finding_first() -> None:
    own = diagnosis_table.cases("own.json")
    wrong = {case["id"] for case in own if not diagnosis_table.is_right(case, diagnosis_table.codes_of(case))}
    assert len(own) >= 40
    assert wrong == MISSED


def test_bytes_from_issue_threads_have_the_right_finding_first() -> None:
    wrong = {case["id"] for case in EXPLAINED if not diagnosis_table.is_right(case, diagnosis_table.codes_of(case))}
    assert len({case["source"] for case in EXPLAINED}) >= 40
    assert wrong == set()


def test_the_first_table_of_the_page_is_that_of_today() -> None:
    own = diagnosis_table.page(["own.json"])
    assert diagnosis_table.PAGE.read_text(encoding="utf-8").startswith(own), "run python tools/diagnosis_table.py"


@pytest.mark.long
def test_logs_from_issue_threads_have_the_right_finding_first() -> None:
    logs = [case for case in diagnosis_table.cases("threads.json") if case["how"] == ["diagnose"]]
    right = [case["id"] for case in logs if diagnosis_table.is_right(case, diagnosis_table.codes_of(case))]
    assert len(right) >= 0.6 * len(logs), {case["id"] for case in logs} - set(right)


@pytest.mark.long
def test_no_thread_is_accused_of_something_else() -> None:
    threads = [case for half in diagnosis_table.HALVES for case in diagnosis_table.posted(half)]
    judgements = {case["url"]: diagnosis_table.judged(case)[0] for case in threads}
    assert {url for url, judgement in judgements.items() if judgement == "wrong"} == set()
    assert list(judgements.values()).count("right") >= 0.9 * len(judgements)


def test_the_record_of_the_unseen_threads_is_complete_and_the_page_has_its_figures() -> None:
    unseen = diagnosis_table.posted("fresh")
    assert len({case["url"] for case in unseen}) == len(unseen) == 100
    words = diagnosis_table.JUDGEMENTS
    for case in unseen:
        assert case["judgement"] == max(case.get("twice", [case["judgement"]]), key=words.index), case["url"]
        assert ("why" in case) == (case["judgement"] in ("missed", "wrong")), case["url"]
    judgements = [case["judgement"] for case in unseen]
    figures = ", ".join(f"{judgements.count(word)} {word}" for word in words)
    assert f"- 100 threads: {figures}." in diagnosis_table.PAGE.read_text(encoding="utf-8")
