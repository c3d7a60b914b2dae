"""`barewire vectors show`: one case, its frames explained, and the questions that it asks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from barewire_workbench.cli.vectors.frames import frames_of_case
from barewire_workbench.vectors.answers.table import own_answer
from barewire_workbench.vectors.files import VectorFile, Vectors
from barewire_workbench.vectors.judge import judge
from barewire_workbench.vectors.questions import Case

_FIRST = (
    "id",
    "result",
    "reason",
    "fails",
    "flags",
    "comment",
    "source",
    "clause",
    "origin",
    "confirmed_by",
    "unconfirmed",
)
_WIDTH = 110
_WHOLE = 12
"""The most frames whose bytes are shown, and the most items of a list."""


def shown_case(vectors: Vectors, file: VectorFile, case: Case) -> Iterator[str]:
    """Yield the lines of a case."""
    yield f"{case['id']}   {file.name}.json: {file.subject}"
    yield f"kind {file.kind}, {_result(case)}"
    for name in _FIRST[4:]:
        if name in case:
            yield f"{name}: {_flat(case[name])}"
    yield ""
    for name, value in case.items():
        if name not in _FIRST:
            yield from _field(name, value)
    yield from _explained(file.kind, case)
    yield ""
    for question in vectors.questions(file, case):
        answer = own_answer(question.as_json())
        yield f"> {_flat(question.as_json())}"
        yield f"< {_flat(answer)}   {judge(question, answer).state}"


def _field(name: str, value: Any) -> Iterator[str]:
    """Yield the lines of a field: of a long list of objects, such as the steps of a talk, one for each of the first."""
    text = json.dumps(value, ensure_ascii=False)
    if len(text) <= _WIDTH or not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
        yield f"  {name}: {_flat(value)}"
        return
    yield f"  {name}:"
    for item in value[:_WHOLE]:
        yield f"    {_flat(item)}"
    if len(value) > _WHOLE:
        yield f"    ... {len(value)} in all; --json has them"


def _result(case: Case) -> str:
    if case["result"] != "invalid":
        return str(case["result"])
    return f"invalid: {case['fails']} fails, {case['reason']}"


def _explained(kind: str, case: Case) -> Iterator[str]:
    """Yield the fields of each frame; of many frames only the verdicts, a line each."""
    frames = [*frames_of_case(kind, case)]
    if len(frames) > _WHOLE:
        yield ""
        width = max(len(frame.place) for frame in frames)
        for frame in frames:
            yield f"{frame.place:{width}}  {frame.explanation.verdict}"
        return
    for frame in frames:
        yield ""
        if frame.place:
            yield f"{frame.place}:"
        yield from frame.explanation.lines()


def _flat(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _WIDTH else text[:_WIDTH] + " ..."
