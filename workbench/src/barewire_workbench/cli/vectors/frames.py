"""The frames of a case, explained byte by byte: of a frame or a message, and of each step of a talk.

pdu, exchange, server        the fields of a PDU
client                       those of each request
rtu-frame, ascii-frame, ...  the envelope, too
rtu-talk, ...                the PDU of each frame that is received
cob_id and data, can-text    a CAN frame
sdo-talk, node-talk, device  each CAN frame; those before it tell whether it is a segment of a block
device-conformance           each frame that is sent, with the values of our device
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from barewire.canopen.cob_ids import cob_id
from barewire.canopen.frame import CanFrame
from barewire.errors import BarewireError
from barewire_workbench import Explanation, FrameRole, explain_text
from barewire_workbench.frames.can import explain_can, explain_segment
from barewire_workbench.frames.modbus import explain_pdu
from barewire_workbench.frames.result import as_problem, explained_fields
from barewire_workbench.monitor import CanMonitor
from barewire_workbench.vectors.answers.device_conformance import case_on_device
from barewire_workbench.vectors.questions import Case

_FRAMES = {"rtu-frame": ("rtu", "frame"), "ascii-frame": ("ascii", "text"), "tcp-frame": ("tcp", "frame")}
_ANY_BYTE = ".."
_STEPS_SHOWN = 40
"""Steps of a case of device-conformance that are explained: some write 800 numbers, one after the other."""


class FrameOfCase(NamedTuple):
    """One frame: its place in the case, empty if it is the only one, and its explanation."""

    place: str
    explanation: Explanation


def frames_of_case(kind: str, case: Case) -> Iterator[FrameOfCase]:
    """Yield the frames of a case that can be explained; none for a kind without frames."""
    if kind in _FRAMES:
        protocol, field = _FRAMES[kind]
        if field in case:
            yield FrameOfCase("", explain_text(protocol, case[field], case.get("side")))
    elif kind == "pdu":
        if "pdu" in case:
            yield FrameOfCase(case["side"], _pdu(case["pdu"], case["side"]))
    elif kind == "exchange":
        yield FrameOfCase("request", _pdu(case["request"], "request"))
        yield FrameOfCase("response", _pdu(case["response"], "response"))
    elif kind == "sdo-talk":
        yield from _sdo_talk(case)
    elif kind == "device-conformance":
        yield from _device_steps(case)
    elif kind == "client":
        for number, question in enumerate(case["ask"], start=1):
            yield FrameOfCase(f"ask {number}, unit {question['unit']}", _pdu(question["pdu"], "request"))
    elif "talk" in case:
        yield from _talk(case)
    elif kind == "can-text" or ("cob_id" in case and "data" in case):
        text = case["text"] if kind == "can-text" else f"{case['cob_id']}#{case['data'].replace(' ', '')}"
        try:
            yield FrameOfCase("", explain_text("can", text))
        except BarewireError:
            return  # the case is that this text is no frame


def _pdu(text: str, role: FrameRole | None) -> Explanation:
    data = bytes.fromhex(text)
    parsed = explain_pdu(data, role)
    return Explanation(
        "rtu", parsed.role, explained_fields(parsed.fields, data), as_problem(parsed.error), parsed.summary
    )


def _sdo_talk(case: Case) -> Iterator[FrameOfCase]:
    bus = _Bus()
    sides = {"client": cob_id("SDO request", case["node"]), "server": cob_id("SDO answer", case["node"])}
    for place, data in case["talk"]:
        frame = CanFrame(sides[place.partition(" ")[0]], bytes.fromhex(data))
        yield FrameOfCase(place, bus.explained(frame, is_lost=place.endswith("lost")))


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
        for name, value in step.items():
            for wanted in value if isinstance(value, list) else [value]:
                item, *others = wanted["one_of"] if isinstance(wanted, dict) and "one_of" in wanted else [wanted]
                if isinstance(item, str) and "#" in item:
                    note = f", or {' or '.join(others)}" if others else ""
                    note += ", shown with 00 for each byte that may have any value" if _ANY_BYTE in item else ""
                    frame = CanFrame.parse(item.replace(_ANY_BYTE, "00"))
                    yield FrameOfCase(f"{place}, {name}{note}", bus.explained(frame))
                elif isinstance(item, dict) and "pdu" in item:
                    role: FrameRole | None = "response" if case["line"].get("role") == "client" else None
                    yield FrameOfCase(f"{place}, frame of unit {item['unit']}", _pdu(item["pdu"], role))
                elif isinstance(item, str) and name == "ask":
                    yield FrameOfCase(f"{place}, ask unit {step['unit']}", _pdu(item, "request"))
                elif isinstance(item, str) and name == "say":
                    yield FrameOfCase(f"{place}, say", _pdu(item, "response"))


class _Bus:
    """Frames in their order: after the beginning of a block transfer some are segments."""

    def __init__(self) -> None:
        self._monitor, self._now = CanMonitor(), 0.0

    def explained(self, frame: CanFrame, *, is_lost: bool = False) -> Explanation:
        explanation = explain_segment(frame) if self._monitor.takes_segment(frame) else explain_can(frame)
        self._now += 0.001
        if not is_lost:
            self._monitor.feed(frame, self._now)
        return explanation
