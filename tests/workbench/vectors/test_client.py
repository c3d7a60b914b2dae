"""The kind `client`: the peer of the reference is the peer of our answers, other settings of our bus come to accepted
outcomes as well, and the judge knows several right outcomes and one that is never right."""

from __future__ import annotations

import random
import runpy
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from barewire.modbus import Bus
from barewire_workbench.vectors.answers import client
from barewire_workbench.vectors.answers.client import ClientPeer
from barewire_workbench.vectors.judge import judge
from barewire_workbench.vectors.questions import Question
from tests.helpers import every_case
from tests.workbench.vectors.loaded import VECTORS

PEER = Path(__file__).parents[3] / "vectors" / "reference" / "modbus" / "client_peer.py"
REFERENCE = runpy.run_path(str(PEER))["ClientPeer"]
QUESTIONS = [
    question
    for file in VECTORS.files
    if file.kind == "client"
    for case in file.cases
    for question in VECTORS.questions(file, case)
]
NAMES = [question.id for question in QUESTIONS]


class BothPeers(ClientPeer):
    """Our peer and that of the reference: both must send the same."""

    def __init__(self, given: dict[str, Any]) -> None:
        super().__init__(given)
        self.reference = REFERENCE(given)

    def begin(self, place: int) -> None:
        super().begin(place)
        self.reference.begin(place)

    def end(self, place: int) -> None:
        super().end(place)
        self.reference.end(place)

    def hear(self, frame: bytes, now: int) -> None:
        self.reference.coming = list(self.coming)
        super().hear(frame, now)
        self.reference.hear(frame, now)
        assert self.coming == self.reference.coming
        assert self.seen == self.reference.seen


@every_case("question", QUESTIONS)
def test_the_peer_of_the_reference_is_ours(question: Question, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "ClientPeer", BothPeers)
    answer = {"is": client.run_client(question.given)}
    assert judge(question, answer, exact=True).state == "passed"


@every_case("question", QUESTIONS)
def test_a_bus_that_waits_comes_to_accepted_outcomes(question: Question, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "Bus", partial(Bus, recovery="wait"))
    answer = {"is": client.run_client(question.given)}
    assert judge(question, answer, exact=True).state == "passed", answer


class ForgetfulBus(Bus):
    """A bus that forgets what may still come, as a client does that only follows the standard."""

    def _leave_pending(self, now: float) -> None:
        super()._leave_pending(now)
        self.state.pending.clear()


def test_a_client_that_forgets_fails_where_an_answer_is_late(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "Bus", ForgetfulBus)
    states = {}
    for question in QUESTIONS:
        answer = {"is": client.run_client(question.given)}
        states[question.id] = judge(question, answer), question.case.get("flags", ())
    failed = [flags for verdict, flags in states.values() if verdict.state == "failed"]
    assert len(failed) >= 20
    assert all("lateness" in flags for flags in failed)


def test_the_judge_knows_several_right_outcomes_and_one_that_is_never_right() -> None:
    wanted = {"ask": [{"outcome": {"one_of": ["registers 0001", "no answer"], "never": ["registers 0002"]}, "seen": 1}]}
    case = {"id": "x-1", "result": "acceptable"}
    question = Question(case, "client", "run", {}, wanted)

    def state(outcome: str, seen: int = 1, result: str = "acceptable") -> str:
        asked = question._replace(case={**case, "result": result})
        return judge(asked, {"is": {"ask": [{"outcome": outcome, "seen": seen}]}}).state

    assert [state(outcome) for outcome in ("registers 0001", "no answer")] == ["passed", "passed"]
    assert [state(outcome) for outcome in ("registers 0003", "registers 0002")] == ["open", "failed"]
    assert state("registers 0001", seen=2) == "open"
    assert state("registers 0003", result="valid") == "failed"


@pytest.mark.parametrize(("seen", "state"), [(0, "failed"), (1, "passed"), (3, "passed"), (4, "failed")])
def test_the_judge_knows_a_range_of_numbers(seen: int, state: str) -> None:
    question = Question({"id": "x-1", "result": "valid"}, "client", "run", {}, {"seen": {"from": 1, "to": 3}})
    assert judge(question, {"is": {"seen": seen}}).state == state
    assert judge(question, {"is": {"seen": str(seen)}}).state == "failed"


def test_no_answer_depends_on_the_order_of_the_cases() -> None:
    some = random.Random(1).sample(QUESTIONS, 50)
    first = [client.run_client(question.given) for question in some]
    assert [client.run_client(question.given) for question in reversed(some)] == first[::-1]
