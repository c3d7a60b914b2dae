"""Adapters that do nothing pass no case, but those whose right answer is exactly what they say."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from typing import Any

import pytest

from barewire_workbench.vectors.answers.table import own_answer
from barewire_workbench.vectors.files import Vectors
from barewire_workbench.vectors.judge import Answer, judge
from barewire_workbench.vectors.questions import Question
from barewire_workbench.vectors.run import run_cases, selected
from tests.workbench.vectors.loaded import VECTORS

NO_STATE = {"drive-commands-15", "drive-commands-16", "drive-states-24", "drive-states-25", "drive-states-26"}
"""A word that is no state, or not this command: of the comparisons only these may be refused."""
UNUSED = {f"heartbeat-consumer-{number}" for number in (3, 4, 5, 8, 9)}
"""An entry of 1016h that names no node."""
NOT_SENT = {"emcy-25"}
"""Asks only whether a frame is made that must not be: an encoder may refuse the fields or fill them up."""
NO_ROLE = {f"tls-roles-{number}" for number in (5, 13, 14, 15, 16)}
"""A certificate without a role."""


def passed(ask: Callable[[Question], Answer]) -> set[str]:
    return {checked.id for checked in run_cases(VECTORS, ask) if checked.verdict.state == "passed"}


def refused() -> set[str]:
    """The cases that are to be refused, by themselves."""
    cases = (case for file in VECTORS.files for case in file.cases)
    return {case["id"] for case in cases if case.get("fails") in ("encode", "decode")}


def own(question: Question) -> dict[str, Any]:
    return own_answer(json.loads(json.dumps(question.as_json())))


@pytest.mark.parametrize(
    ("ask", "right"),
    [
        pytest.param(lambda question: {"is": {}}, set[str](), id="null"),
        pytest.param(lambda question: {"is": question.given}, set[str](), id="echo"),
        pytest.param(lambda question: {"is": question.as_json()}, set[str](), id="echo of the whole question"),
        pytest.param(lambda question: {"refused": ""}, refused() | NO_STATE | NOT_SENT, id="always invalid"),
        pytest.param(
            lambda question: {"is": dict.fromkeys(question.expected)}, UNUSED | NO_ROLE, id="null in each field"
        ),
    ],
)
def test_an_adapter_that_does_nothing_passes_nothing(ask: Callable[[Question], Answer], right: set[str]) -> None:
    assert passed(ask) == right


def device_cases(step: int) -> Vectors:
    """Every `step`th case of each file."""
    cases = selected(VECTORS, kinds=["device-conformance"])
    return cases._replace(files=tuple(file._replace(cases=file.cases[::step]) for file in cases.files))


@pytest.fixture(
    scope="module", params=[pytest.param(6, id="a part"), pytest.param(1, id="all", marks=pytest.mark.proof)]
)
def of_our_device(request: pytest.FixtureRequest) -> tuple[Vectors, dict[str, dict[str, Any]]]:
    """Cases, and the right answers by their question. What a device leaves out is noticed by any of them."""
    vectors = device_cases(request.param)
    cases = [(file, case) for file in vectors.files for case in file.cases]
    return vectors, {question.id: own(question) for file, case in cases for question in vectors.questions(file, case)}


def silent(answer: dict[str, Any]) -> None:
    """A device that never answers: nothing could be read from it."""
    answer["device"]["objects"] = {}
    answer["received"] = [[] for _ in answer["received"]]


def hurried(answer: dict[str, Any]) -> None:
    """An adapter that leaves out the last step."""
    del answer["received"][-1]


def talkative(answer: dict[str, Any]) -> None:
    """A device that sends one frame too many."""
    answer["received"][-1].append("585#8000000000000000")


@pytest.mark.parametrize("change", [silent, hurried, talkative])
def test_a_device_that_does_not_answer_as_it_must_passes_nothing(
    change: Callable[[dict[str, Any]], None], of_our_device: tuple[Vectors, dict[str, dict[str, Any]]]
) -> None:
    vectors, right = of_our_device

    def ask(question: Question) -> Answer:
        answer = copy.deepcopy(right[question.id])
        change(answer["is"])
        return answer

    assert {checked.id for checked in run_cases(vectors, ask) if checked.verdict.state == "passed"} == set()


@pytest.mark.parametrize(
    ("device", "received", "text"),
    [
        (None, [], "the answer needs device (node, has, objects) and received: TypeError"),
        ({"node": 5, "has": []}, [], "KeyError: 'objects'"),
        ({"node": "5", "has": [], "objects": {}}, [], "node 5: expected 1 to 127"),
        ({"node": 5, "has": [], "objects": {}}, [], "objects has no 1000:00"),
        ({"node": 5, "has": [], "objects": {"1000:00": "zz"}}, [], "ValueError"),
        ({"node": 5, "has": [], "objects": {"1000:00": "00"}}, [5], "TypeError"),
        ({"node": 5, "has": [], "objects": {"1000:00": "00"}}, [""], "TypeError: '' is no list"),
        ({"node": 5, "has": [], "objects": {"1000:00": "00"}}, [], "lacks LSS, and the case needs it"),
    ],
)
def test_an_answer_about_a_device_that_cannot_be_read_says_so(device: Any, received: Any, text: str) -> None:
    file, case = VECTORS.find("conform-lss-6")
    (question,) = VECTORS.questions(file, case)
    verdict = judge(question, {"is": {"device": device, "received": received}})
    assert verdict.state == "failed"
    assert text in verdict.text
