"""Which verdicts can change for a stack that passed the last release of the vectors, and passes by what it does still.

`python -m tools.vectors_release --verdicts` prints them, and `changes.json` of a release has them.

The effect of a case is computed from what the last release recorded of it (vectors/released.json: a digest of its
meaning, its result, a digest of its questions) and what it is now:

    new         it was not there: a stack that passed may fail
    new-open    it was not there, and the standard leaves it open: another decision is "open", not failed
    tightened   it was acceptable and is decided now: what was "open" can fail
    loosened    it was decided and is acceptable now: nothing that passed fails
    changed     the questions are the same, and another answer is right: what passed fails
    reasked     it asks something else: it can go either way

A case whose meaning is the same has no effect: its verdict can change only if the judge does, which the changelog says.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, TypeAlias

from barewire_workbench.vectors.files import Vectors
from barewire_workbench.vectors.profiles import in_profile
from barewire_workbench.vectors.questions import Case, questions

EFFECTS = ("new", "new-open", "tightened", "loosened", "changed", "reasked")
Effects: TypeAlias = dict[str, list[str]]


class Demand(NamedTuple):
    """What a verdict depends on: a digest of the whole meaning, the result, and a digest of the questions."""

    meaning: str
    result: str
    asked: str

    @classmethod
    def parse(cls, text: str) -> Demand:
        """Return the demand that a string of released.json has."""
        meaning, result, asked = text.split()
        return cls(meaning, result, asked)

    def __str__(self) -> str:
        return " ".join(self)


def demand(kind: str, case: Case, meaning: str, operations: Any) -> Demand:
    """Return what a case demands; `operations` are those of its kind."""
    asked = [[question.do, question.given] for question in questions(kind, case, operations)]
    text = json.dumps(asked, ensure_ascii=False, sort_keys=True, separators=(",", ":"))
    return Demand(meaning, str(case["result"]), hashlib.sha256(text.encode()).hexdigest()[:8])


def demands(vectors: Vectors, meanings: Mapping[str, str]) -> dict[str, Demand]:
    """Return what each case demands."""
    return {
        case["id"]: demand(file.kind, case, meanings[case["id"]], vectors.kinds[file.kind])
        for file in vectors.files
        for case in file.cases
    }


def effect(before: Demand | None, now: Demand) -> str:
    """Return the effect of a case on a stack that passed it; nothing for a case that has kept its meaning."""
    if before is None:
        return "new-open" if now.result == "acceptable" else "new"
    if before.meaning == now.meaning:
        return ""
    if now.result == before.result:
        return "changed" if now.asked == before.asked else "reasked"
    if "acceptable" in (now.result, before.result):
        return "loosened" if now.result == "acceptable" else "tightened"
    return "changed"


def effects(before: Mapping[str, Demand], now: Mapping[str, Demand]) -> Effects:
    """Return the ids of cases by their effect."""
    found: Effects = {name: [] for name in EFFECTS}
    for case_id, demanded in now.items():
        if name := effect(before.get(case_id), demanded):
            found[name].append(case_id)
    return found


def of_cases(found: Effects, ids: Iterable[str]) -> dict[str, int]:
    """Return how many of these cases have which effect; effects that none has are left out."""
    chosen = {*ids}
    numbers = Counter({name: len(chosen.intersection(cases)) for name, cases in found.items()})
    return dict(+numbers)


def by_profile(vectors: Vectors, found: Effects) -> dict[str, dict[str, int]]:
    """Return the numbers of effects for each profile."""
    return {
        name: of_cases(found, [case["id"] for file in in_profile(vectors, name).files for case in file.cases])
        for name in vectors.profiles
    }
