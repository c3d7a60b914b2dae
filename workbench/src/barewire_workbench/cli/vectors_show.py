"""`barewire vectors show`: one case, its frames explained or drawn, and the questions that it asks.

The frames of a case by its kind:

    pdu, exchange, server        the fields of a PDU
    client                       those of each request
    rtu-frame, ascii-frame, ...  the envelope, too
    rtu-talk, ...                the PDU of each frame that is received
    cob_id and data, can-text    a CAN frame
    sdo-talk, node-talk, device  each CAN frame; those before it tell whether it is a segment of a block
    device-conformance           each frame that is sent, with the values of our device

The picture of a case by its frames:

    one frame                    its bytes and fields; on a page of a whole frame also its levels on the wire
    several frames               a sequence diagram
    words of a CiA 402 drive     the state machine with the path
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import zip_longest
from typing import Any, NamedTuple

from barewire.canopen.cob_ids import cob_id
from barewire.canopen.frame import CanFrame
from barewire.errors import BarewireError, EncodeError
from barewire_workbench import Explanation, FrameRole, explain_text
from barewire_workbench.frames.modbus import explain_pdu
from barewire_workbench.frames.result import as_problem, explained_fields
from barewire_workbench.monitor import CanMonitor
from barewire_workbench.pictures.fields import FieldsPicture
from barewire_workbench.pictures.levels import frame_pictures
from barewire_workbench.pictures.picture import Picture
from barewire_workbench.pictures.recordings import CLIENT, MASTER, can_stations, explained_message
from barewire_workbench.pictures.sequence import SequenceMessage, SequencePicture
from barewire_workbench.pictures.states import DriveWord, StatesPicture
from barewire_workbench.vectors.answers.device_conformance import case_on_device
from barewire_workbench.vectors.answers.table import own_answer
from barewire_workbench.vectors.files import VectorFile, Vectors
from barewire_workbench.vectors.judge import judge
from barewire_workbench.vectors.questions import Case

_HEAD = ("id", "result", "reason", "fails")
"""Fields that the first two lines have."""
_DESCRIPTION = ("flags", "comment", "source", "clause", "origin", "confirmed_by", "unconfirmed")
_WIDTH = 110
_SHOWN_MOST = 12
"""The most frames whose bytes are shown, and the most items of a list."""


def shown_case(vectors: Vectors, file: VectorFile, case: Case) -> Iterator[str]:
    """Yield the lines of a case."""
    yield f"{case['id']}   {file.name}.json: {file.subject}"
    yield f"kind {file.kind}, {_result(case)}"
    for name in _DESCRIPTION:
        if name in case:
            yield f"{name}: {_flat(case[name])}"
    yield ""
    for name, value in case.items():
        if name not in _HEAD and name not in _DESCRIPTION:
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
    for item in value[:_SHOWN_MOST]:
        yield f"    {_flat(item)}"
    if len(value) > _SHOWN_MOST:
        yield f"    ... {len(value)} in all; --json has them"


def _result(case: Case) -> str:
    if case["result"] != "invalid":
        return str(case["result"])
    return f"invalid: {case['fails']} fails, {case['reason']}"


def _explained(kind: str, case: Case) -> Iterator[str]:
    """Yield the fields of each frame; of many frames only the verdicts, a line each."""
    frames = list(frames_of_case(kind, case))
    if len(frames) > _SHOWN_MOST:
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


# The frames

_ANY_BYTE = ".."
_STEPS_SHOWN = 40
"""Steps of a case of device-conformance that are explained: some write 800 numbers, one after the other."""


class FrameOfCase(NamedTuple):
    """One frame: its place in the case, empty if it is the only one, and its explanation."""

    place: str
    explanation: Explanation


def frames_of_case(kind: str, case: Case) -> Iterator[FrameOfCase]:
    """Yield the frames of a case that can be explained; none for a kind without frames."""
    if kind in _FRAMES_OF_KIND:
        yield from _FRAMES_OF_KIND[kind](case)
    elif "talk" in case:
        yield from _talk(case)
    elif "cob_id" in case and "data" in case:
        yield from _can_text(f"{case['cob_id']}#{case['data'].replace(' ', '')}")


def _framed(protocol: str, field: str, case: Case) -> Iterator[FrameOfCase]:
    if field in case:
        yield FrameOfCase("", explain_text(protocol, case[field], case.get("side")))


def _message(case: Case) -> Iterator[FrameOfCase]:
    if "pdu" in case:
        yield FrameOfCase(case["side"], _pdu(case["pdu"], case["side"]))


def _exchange(case: Case) -> Iterator[FrameOfCase]:
    yield FrameOfCase("request", _pdu(case["request"], "request"))
    yield FrameOfCase("response", _pdu(case["response"], "response"))


def _client(case: Case) -> Iterator[FrameOfCase]:
    for number, question in enumerate(case["ask"], start=1):
        yield FrameOfCase(f"ask {number}, unit {question['unit']}", _pdu(question["pdu"], "request"))


def _can_text(text: str) -> Iterator[FrameOfCase]:
    with suppress(BarewireError):  # the case may be that this text is no frame
        yield FrameOfCase("", explain_text("can", text))


def _pdu(text: str, role: FrameRole | None) -> Explanation:
    data = bytes.fromhex(text)
    parsed = explain_pdu(data, role)
    fields, problem = explained_fields(parsed.fields, data), as_problem(parsed.error)
    return Explanation("rtu", parsed.role, fields, problem, parsed.summary)


def _sdo_talk(case: Case) -> Iterator[FrameOfCase]:
    bus = _Bus()
    sides = {"client": cob_id("SDO request", case["node"]), "server": cob_id("SDO answer", case["node"])}
    for place, data in case["talk"]:
        first, *others = data["one_of"] if isinstance(data, dict) else [data]
        frame = CanFrame(sides[place.partition(" ")[0]], bytes.fromhex(first))
        note = f", or {' or '.join(others)}" if others else ""
        yield FrameOfCase(f"{place}{note}", bus.explained(frame, is_lost=place.endswith("lost")))


def _device_steps(case: Case) -> Iterator[FrameOfCase]:
    """Yield the frames that are sent to our device, and what is accepted after them; of a long case its beginning."""
    bus, steps = _Bus(), case_on_device(dict(case)).steps
    for number, step in enumerate(steps[:_STEPS_SHOWN], start=1):
        accepted = " or ".join(pattern or "silence" for pattern in (*step.accepts, *step.ends))
        for place, text in enumerate(step.sends, start=1):
            note = f", accepted: {accepted}" if place == len(step.sends) else ""
            note += f", and so on up to step {len(steps)}" if number == _STEPS_SHOWN < len(steps) else ""
            yield FrameOfCase(f"step {number}, send {text}{note}", bus.explained(CanFrame.parse(text)))


def _talk(case: Case) -> Iterator[FrameOfCase]:
    """Yield the frames of the steps: CAN frames as text, PDUs, and frames that a receiver has found."""
    bus = _Bus()
    for number, step in enumerate(case["talk"], start=1):
        place = f"at {step['at']} us" if "at" in step else f"step {number}"
        for name, item, others in _items(step):
            if isinstance(item, dict) and "pdu" in item:
                role: FrameRole | None = "response" if case["line"].get("role") == "client" else None
                yield FrameOfCase(f"{place}, frame of unit {item['unit']}", _pdu(item["pdu"], role))
            elif not isinstance(item, str):
                continue  # a number, such as a time
            elif "#" in item:
                note = f", or {' or '.join(others)}" if others else ""
                note += ", shown with 00 for each byte that may have any value" if _ANY_BYTE in item else ""
                frame = CanFrame.parse(item.replace(_ANY_BYTE, "00"))
                yield FrameOfCase(f"{place}, {name}{note}", bus.explained(frame))
            elif name == "ask":
                yield FrameOfCase(f"{place}, ask unit {step['unit']}", _pdu(item, "request"))
            elif name == "say":
                yield FrameOfCase(f"{place}, say", _pdu(item, "response"))


def _items(step: Case) -> Iterator[tuple[str, Any, list[Any]]]:
    """Yield what each field of a step has, with the name of the field and what is accepted in its place."""
    for name, value in step.items():
        for item in value if isinstance(value, list) else [value]:
            first, *others = item["one_of"] if isinstance(item, dict) and "one_of" in item else [item]
            yield name, first, others


class _Bus:
    """Frames in their order: after the beginning of a block transfer some are segments."""

    def __init__(self) -> None:
        self._monitor, self._now = CanMonitor(), 0.0

    def explained(self, frame: CanFrame, *, is_lost: bool = False) -> Explanation:
        explanation = self._monitor.explain(frame)
        self._now += 0.001
        if not is_lost:
            self._monitor.feed(frame, self._now)
        return explanation


_FRAMES_OF_KIND: dict[str, Callable[[Case], Iterator[FrameOfCase]]] = {
    "rtu-frame": partial(_framed, "rtu", "frame"),
    "ascii-frame": partial(_framed, "ascii", "text"),
    "tcp-frame": partial(_framed, "tcp", "frame"),
    "pdu": _message,
    "exchange": _exchange,
    "client": _client,
    "sdo-talk": _sdo_talk,
    "device-conformance": _device_steps,
    "can-text": lambda case: _can_text(case["text"]),
}


# The pictures

_TIME = re.compile(r"at (\d+) us")
_SIDES = ("", "client", "server", "request", "response")
"""Places of a frame that its arrow shows."""
_WHOLE_FRAMES = ("rtu-frame", "ascii-frame", "tcp-frame")


def pictures_of_case(kind: str, case: Case) -> list[Picture]:
    """Return the pictures of a case, the most telling first. Raise EncodeError for a case without any."""
    words = list(_drive_words(kind, case))
    if words:
        return [StatesPicture(words, str(case["id"]))]
    frames = list(frames_of_case(kind, case))
    if not frames:
        raise EncodeError(f"{case['id']}: a case of kind {kind} has no frames that can be drawn")
    if len(frames) > 1:
        return [SequencePicture(f"{case['id']}: {kind}", _messages(frames), [CLIENT, MASTER])]
    explanation = frames[0].explanation
    if explanation.protocol != "can" and kind not in _WHOLE_FRAMES:
        return [FieldsPicture(explanation, "PDU")]
    return list(frame_pictures(explanation, _can_frame(explanation)).values())


def _drive_words(kind: str, case: Case) -> Iterator[DriveWord]:
    """Yield the words of a case about a drive: each status word that is seen, and the control word that is written."""
    if kind == "drive-state" and "word" in case:
        yield DriveWord("status", int(case["word"], 16))
    elif kind == "drive-command" and "word" in case:
        yield DriveWord("control", int(case["word"], 16))
    elif kind == "drive-path" and "seen" in case:
        # An invalid case has no control words, and one may be null (wait) or an object (an error).
        for seen, written in zip_longest(case["seen"], case.get("words", [])):
            yield DriveWord("status", int(seen, 16))
            if isinstance(written, str):
                yield DriveWord("control", int(written, 16))


def _messages(frames: Sequence[FrameOfCase]) -> Iterator[SequenceMessage]:
    for frame in frames:
        explanation, timed = frame.explanation, _TIME.search(frame.place)
        source, target = _stations(explanation)
        message = explained_message(source, target, explanation)
        if timed is not None:
            yield message._replace(at=int(timed[1]) / 1e6)
        else:
            yield message._replace(text=message.text if frame.place in _SIDES else f"{frame.place}: {message.text}")


def _stations(explanation: Explanation) -> tuple[str, str]:
    if explanation.protocol == "can":
        frame = _can_frame(explanation)
        return (MASTER, "") if frame is None else can_stations(frame)
    return ("server", CLIENT) if explanation.role == "response" else (CLIENT, "server")


def _can_frame(explanation: Explanation) -> CanFrame | None:
    """Return the frame of an explanation, if its fields have all of it."""
    if explanation.protocol != "can" or not explanation.fields or explanation.fields[0].name != "COB-ID":
        return None
    identifier, *fields = explanation.fields
    if not fields and "remote" in explanation.verdict:
        return None
    data = bytes.fromhex("".join(field.hex for field in fields if field.length))
    return CanFrame(int(identifier.hex, 16), data, extended=len(identifier.hex) > 3)
