"""The judgement of an answer: whether an implementation did what a case demands.

    result        the question       the answer must be
    valid         any                the expected fields
    acceptable    decode, run        anything; other fields than the expected ones, or a refusal, are "open"
                  encode             any fields; with the flag `tolerant` not the expected ones
                  run                a value that `never` excludes has failed
    invalid       that of `fails`    a refusal; its reason is compared if the implementation has reasons
                  compare            other values than those of the case; a case fails if all its answers have these

An answer is JSON: {"is": {fields}}, {"refused": reason or "", "text": ...}, {"not_offered": why}. A field of
hexadecimal digits may have other letters or blanks; numbers of floating point are compared as numbers of their type.
A field that is missing has failed, also where null is expected.
Where several answers are right, a case has {"one_of": [...]} or, for a number, {"from": ..., "to": ...} in their place.
Beside `one_of`, `never` has answers that are wrong even if the case is acceptable. In a frame of a device two dots are
a byte that may have any value.
"""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Iterable, Mapping
from decimal import Decimal
from typing import Any, Literal, NamedTuple, TypeAlias

from barewire_workbench.conform.modbus import fitting
from barewire_workbench.vectors.questions import Question
from barewire_workbench.vectors.tested_device import failure_of_answer

Answer: TypeAlias = Mapping[str, Any]
VerdictState = Literal["passed", "open", "failed", "not offered"]

_UNORDERED = ("device", "gateway-309-3")
"""Kinds whose frames of different identifiers may come in any order."""
_REFUSED = (("drive-state", "decode"), ("drive-command", "decode"))
"""Where a comparison may be answered by a refusal: the word is no state or not this command. A codec has a value."""
_CERTAIN = (("eds", "check"),)
"""What is certain in an acceptable case too: that a line departs from CiA 306, however it is read."""
_HEX = re.compile(r"[0-9A-Fa-f ]*")
_LONG = 60
"""Characters from which on two texts are shown only near the place where they begin to differ."""
_SHOWN = 300
"""Characters of an answer that a text shows."""
_MISSING: Any = object()
_FORMS = {
    str: "a text",
    bool: "true or false",
    int: "a number",
    float: "a number",
    list: "a list",
    dict: "an object",
    type(None): "null",
}
_NUMBER = re.compile(r"[+-]?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]{1,4})?")
_NAMED = re.compile("[+-]?(inf|nan)", re.IGNORECASE)


class Verdict(NamedTuple):
    """The state of one question, and the difference as a sentence."""

    state: VerdictState
    text: str = ""


def judge(question: Question, answer: Answer, *, exact: bool = False) -> Verdict:
    """Return the verdict on one answer. With `exact`, an acceptable case must be answered as it is written."""
    problem = malformed(answer)
    if problem:
        return Verdict("failed", problem)
    if "not_offered" in answer:
        return Verdict("not offered", str(answer["not_offered"]))
    result, tolerant = question.case["result"], "tolerant" in question.case.get("flags", ())
    if result == "acceptable" and (question.kind, question.do) in _CERTAIN:
        result = "valid"
    if result == "invalid" and question.case["fails"] != "compare":
        return _refusal(question, answer)
    same = "is" in answer and not differences(question, answer["is"])
    if result == "invalid":
        if "is" not in answer and (question.kind, question.do) not in _REFUSED:
            return Verdict("open", f"{_shown(answer)}, expected other values than {_shown(question.expected)}")
        if "is" in answer and (wrong := _of_other_form(question.expected, answer["is"])):
            return Verdict("failed", wrong)
        return Verdict("failed", f"{_shown(answer)}, as in the case, which is wrong") if same else PASSED
    if result == "acceptable" and question.do == "encode":
        if "is" in answer and (wrong := _of_other_form(question.expected, answer["is"])):
            return Verdict("failed", wrong)
        return (
            Verdict("failed", f"encoded as {_shown(answer)}, which is for decoding only")
            if same and tolerant
            else PASSED
        )
    if same:
        return PASSED
    if result == "acceptable" and "is" in answer and (wrong := _excluded(question, question.expected, answer["is"])):
        text = "; ".join(differences(question, answer["is"]))
        return Verdict("failed", f"{_shown(wrong)} is wrong in any case: {text}")
    text = f"{_shown(answer)}, expected {_shown(question.expected)}"
    if "is" in answer:
        text = "; ".join(differences(question, answer["is"]))
    return Verdict("open" if result == "acceptable" and not exact else "failed", text)


PASSED = Verdict("passed")


def verdict_of_case(verdicts: Iterable[Verdict], *, compares: bool = False) -> Verdict:
    """Return the verdict on a case: the worst one of its questions; for a case that compares, the best one."""
    order = ("passed", "open", "failed", "not offered") if compares else ("failed", "open", "passed", "not offered")
    return min(verdicts, key=lambda verdict: order.index(verdict.state), default=Verdict("not offered", "no question"))


def malformed(answer: Answer) -> str:
    """Return what is wrong with the form of an answer; nothing if it is one of the three, and not two of them."""
    forms = [name for name in ("is", "refused", "not_offered") if name in answer]
    if len(forms) != 1:
        return f"an answer needs one of is, refused and not_offered: {json.dumps(answer, ensure_ascii=False)[:_SHOWN]}"
    for name, type_, form in (("is", dict, "an object of fields"), ("refused", str, "a text")):
        if name in answer and not isinstance(answer[name], type_):
            return f"{name} must be {form}, not {_form(answer[name])}: {_shown(answer[name])}"
    return ""


def differences(question: Question, answered: Mapping[str, Any]) -> list[str]:
    """Return each field that differs from the expected one, as a sentence about the first place where it does."""
    if question.kind == "device-conformance":
        failure = failure_of_answer(question.given, answered)
        return [failure] if failure else []
    return [
        _difference(name, wanted, answered.get(name, _MISSING), question)
        for name, wanted in question.expected.items()
        if not _as_expected(name, wanted, answered.get(name, _MISSING), question)
    ]


def _difference(path: str, wanted: Any, answered: Any, question: Question) -> str:
    """Return what differs: `talk[1].say is ["585#02"], expected ["585#01"]`."""
    if isinstance(wanted, dict) and isinstance(answered, dict):
        for name, value in wanted.items():
            if not _equal(value, answered.get(name, _MISSING), name, _type_of(question.given), question):
                return _difference(f"{path}.{name}", value, answered.get(name, _MISSING), question)
    if isinstance(answered, list) and isinstance(wanted, list) and any(_is_deep(item) for item in wanted):
        sizes = [f"{path} has {len(answered)} items, expected {len(wanted)}"] if len(answered) != len(wanted) else []
        for place, (value, item) in enumerate(zip(wanted, answered)):
            if not _equal(value, item, path, _type_of(question.given), question):
                return "; ".join([*sizes, _difference(f"{path}[{place}]", value, item, question)])
        if sizes:
            return sizes[0]
    if isinstance(wanted, str) and isinstance(answered, str) and min(len(wanted), len(answered)) > _LONG:
        shorter = min(len(wanted), len(answered))
        place = next((place for place in range(shorter) if wanted[place] != answered[place]), shorter)
        where = f"byte {place // 3}" if _HEX.fullmatch(wanted) and wanted[2] == " " else f"character {place}"
        return f"{path} is {_around(answered, place)}, expected {_around(wanted, place)}, different from {where} on"
    is_what = "is missing" if answered is _MISSING else f"is {_shown(answered)}"
    return f"{path} {is_what}, expected {_shown(wanted)}"


def _around(text: str, place: int) -> str:
    """Return a long text near the place where it begins to differ from another one."""
    first, end = max(place - _LONG // 2, 0) // 3 * 3, place + _LONG // 2
    return f"{'... ' if first else ''}{text[first:end]}{' ...' if end < len(text) else ''}"


def _is_deep(item: Any) -> bool:
    """Whether an item of a list has fields of its own, such as a step of a talk."""
    return isinstance(item, dict) and "one_of" not in item


def _form(value: Any) -> str:
    """Return the type of JSON of a value, as words. JSON has one kind of number: 1 and 1.0 are the same."""
    return _FORMS.get(type(value), "nothing")


def _of_other_form(expected: Mapping[str, Any], answered: Mapping[str, Any]) -> str:
    """Return what makes an answer one that no case has: a field that is missing, empty, or of another type of JSON."""
    for name, value in expected.items():
        if name not in answered:
            return f"the answer has no {name}"
        if _form(answered[name]) != _form(value):
            return f"{name} is {_shown(answered[name])}, expected {_form(value)}"
        if value and answered[name] in ("", [], {}):
            return f"{name} is empty"
    return ""


def _refusal(question: Question, answer: Answer) -> Verdict:
    if "refused" not in answer:
        return Verdict("failed", f"{_shown(answer)}, expected a refusal: {question.case['reason']}")
    reason = answer["refused"]
    if reason and reason != question.case["reason"]:
        return Verdict("failed", f"refused as {_shown(reason)}, expected {question.case['reason']}")
    return PASSED


def _excluded(question: Question, wanted: Any, answered: Any) -> Any:
    """Return an answer that `never` excludes, None if there is none."""
    if isinstance(wanted, dict) and "one_of" in wanted:
        return answered if any(_equal(never, answered, "", "", question) for never in wanted.get("never", ())) else None
    pairs: Iterable[tuple[Any, Any]] = ()
    if isinstance(wanted, dict) and isinstance(answered, dict):
        pairs = ((value, answered[name]) for name, value in wanted.items() if name in answered)
    elif isinstance(wanted, list) and isinstance(answered, list):
        pairs = zip(wanted, answered)
    return next((wrong for pair in pairs if (wrong := _excluded(question, *pair)) is not None), None)


# Equality ---------------------------------------------------------------------------------------------------------


def _as_expected(name: str, wanted: Any, answered: Any, question: Question) -> bool:
    """Whether a field of an answer is as expected. Of server-conformance, one of several sequences is."""
    if question.kind == "server-conformance" and name == "answers":
        is_row = isinstance(answered, list) and all(isinstance(text, str) for text in answered)
        return is_row and fitting(map(tuple, wanted), answered) is not None
    return _equal(wanted, answered, name, _type_of(question.given), question)


def _equal(wanted: Any, answered: Any, name: str, type_: str, question: Question) -> bool:
    """Whether an answer has what is wanted. `name` is that of the field, `type_` that of a number in it."""
    if isinstance(wanted, dict):
        if "one_of" in wanted:
            return any(_equal(alternative, answered, name, type_, question) for alternative in wanted["one_of"])
        if wanted.keys() == {"from", "to"}:
            is_between = _form(answered) == "a number" and wanted["from"] <= answered <= wanted["to"]
            return is_between and answered == int(answered)
        return isinstance(answered, dict) and all(
            _padded(key, value, answered.get(key, _MISSING), question)
            or _equal(value, answered.get(key, _MISSING), key, type_, question)
            for key, value in wanted.items()
        )
    if isinstance(wanted, list):
        types = [row["type"] or "" for row in question.given["entries"]] if question.kind == "pdo" else []
        if question.kind in _UNORDERED and isinstance(answered, list):
            wanted, answered = _by_identifier(wanted), _by_identifier(answered)
        return (
            isinstance(answered, list)
            and len(answered) == len(wanted)
            and all(
                _equal(value, item, name, types[place] if place < len(types) else type_, question)
                for place, (value, item) in enumerate(zip(wanted, answered))
            )
        )
    if isinstance(wanted, str) and isinstance(answered, str):
        if question.kind == "device" and ".." in wanted:
            return re.fullmatch(wanted.replace("..", "[0-9A-F]{2}"), answered) is not None
        is_number = name == "value" and _same_number(wanted, answered, type_)
        return wanted == answered or _same_digits(wanted, answered) or is_number
    return _form(wanted) == _form(answered) and bool(wanted == answered)


def _by_identifier(items: list[Any]) -> list[Any]:
    """Return frames in the order of their identifiers, those of one identifier as they came; other lists unchanged."""
    choices = [item.get("one_of") if isinstance(item, dict) else None for item in items]
    frames = [one_of[0] if isinstance(one_of, list) and one_of else item for item, one_of in zip(items, choices)]
    if not all(isinstance(frame, str) and "#" in frame for frame in frames):
        return items
    places = sorted(range(len(items)), key=lambda place: frames[place].partition("#")[0])
    return [items[place] for place in places]


def _same_digits(wanted: str, answered: str) -> bool:
    both = [text.replace(" ", "").upper() for text in (wanted, answered)]
    return both[0] == both[1] and _HEX.fullmatch(wanted) is not None


def _type_of(fields: Mapping[str, Any]) -> str:
    described = fields.get("parameter", fields)
    kind = described.get("type", "")
    return kind if isinstance(kind, str) else ""


def _same_number(wanted: str, answered: str, type_: str) -> bool:
    """Whether two texts are the same number: of floating point the nearest ones of that type, others exactly."""
    one, other = _number(wanted, type_), _number(answered, type_)
    return one is not None and one == other


def _number(text: str, type_: str) -> Decimal | bytes | None:
    """Return the number, of floating point its bytes; None for what is none, or too large. NaN is NaN."""
    is_decimal = _NUMBER.fullmatch(text) is not None
    if type_.startswith(("u", "i", "b")):
        return Decimal(text) if is_decimal else None
    if not type_.startswith("f") or (not is_decimal and not _NAMED.fullmatch(text)):
        return None
    try:
        packed = struct.pack(">f" if type_ == "f32" else ">d", float(text))
    except OverflowError:
        return None
    return None if is_decimal and math.isinf(float(text)) else b"nan" if math.isnan(float(text)) else packed


def _padded(name: str, wanted: Any, answered: Any, question: Question) -> bool:
    """Whether bits are those expected, with up to seven more that are zero: a response decoded without its request."""
    if name != "bits" or question.kind != "pdu" or question.given.get("side") != "response":
        return False
    both = [text.replace(" ", "") for text in (wanted, answered) if isinstance(text, str)]
    return (
        len(both) == 2
        and both[1].startswith(both[0])
        and both[1][len(both[0]) :] in ("", *("0" * n for n in range(1, 8)))
    )


def _shown(value: Any) -> str:
    """Return a field for a text; of an answer its fields, or its refusal."""
    if isinstance(value, dict) and isinstance(value.get("is"), dict):
        value = value["is"]
    elif isinstance(value, dict) and isinstance(value.get("refused"), str):
        reason = f"refused as {value['refused']}" if value["refused"] else "refused"
        value = f"{reason}: {value['text']}" if value.get("text") else reason
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _SHOWN else text[:_SHOWN] + "..."
