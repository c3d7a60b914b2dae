"""`barewire vectors show`: one case, its frames explained, and the questions that it asks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from barewire.explain import explain_text
from barewire.vectors.answers.table import own_answer
from barewire.vectors.files import VectorFile, Vectors
from barewire.vectors.judge import judge
from barewire.vectors.questions import Case

_FRAMES = {"rtu-frame": ("rtu", "frame"), "ascii-frame": ("ascii", "text"), "tcp-frame": ("tcp", "frame")}
_FIRST = ("id", "result", "reason", "fails", "flags", "comment", "source", "clause", "origin", "confirmed_by")
_WIDTH = 110


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
            yield f"  {name}: {_flat(value)}"
    frame = _frame(file.kind, case)
    if frame is not None:
        yield ""
        yield from explain_text(*frame).lines()
    yield ""
    for question in vectors.questions(file, case):
        answer = own_answer(question.as_json())
        yield f"> {_flat(question.as_json())}"
        yield f"< {_flat(answer)}   {judge(question, answer).state}"


def _result(case: Case) -> str:
    if case["result"] != "invalid":
        return str(case["result"])
    return f"invalid: {case['fails']} fails, {case['reason']}"


def _frame(kind: str, case: Case) -> Any:
    """Return protocol and frame for the explanation; None for a case without a frame."""
    if kind in _FRAMES:
        protocol, field = _FRAMES[kind]
        return (protocol, case[field]) if field in case else None
    if "cob_id" in case and "data" in case:
        return "can", f"{case['cob_id']}#{case['data'].replace(' ', '')}"
    return None


def _flat(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _WIDTH else text[:_WIDTH] + " ..."
