"""Every frame and PDU of the vectors, explained: the verdict is that of the vectors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from barewire import rtu
from barewire_workbench import Explanation, FrameRole, explain
from tests.helpers import every_case

VECTORS = Path(__file__).parents[3] / "vectors" / "cases"
LEFT_OPEN = dict.fromkeys(("exceptions-34", "rtu-frames-62", "rtu-frames-63", "rtu-frames-64"), False)
"""What `explain` says of cases that `decode` accepts: function 00, which the standard leaves open, does not exist; and
the PDU of a frame whose byte count lies is wrong, the frame around it is not."""
BYTES_OF = {"rtu-frame": "frame", "tcp-frame": "frame", "ascii-frame": "text", "pdu": "pdu"}


def has_bytes_to_judge(case: dict[str, Any], key: str) -> bool:
    """Return False for cases without bytes, and for unknown functions, which `decode` refuses and `explain` accepts."""
    refused = case["result"] == "invalid" and (case.get("fails") != "decode" or case.get("reason") == "function")
    return key in case and not refused and (key != "pdu" or 1 <= len(bytes.fromhex(case[key])) <= 253)


def vectors() -> list[Any]:
    found = []
    for room in ("modbus", "rtu", "ascii", "tcp"):
        for file in sorted((VECTORS / room).glob("*.json")):
            content = json.loads(file.read_text(encoding="utf-8"))
            kind = content["kind"]
            cases = [case for case in content["cases"] if kind in BYTES_OF and has_bytes_to_judge(case, BYTES_OF[kind])]
            found += [pytest.param(kind, case, id=case["id"]) for case in cases]
    return found


def of_vector(kind: str, case: dict[str, Any]) -> Explanation:
    side: FrameRole | None = case.get("side")
    if kind == "ascii-frame":
        return explain("ascii", case["text"].encode("latin-1"), side)
    if kind == "pdu":
        return explain("rtu", rtu.encode(1, bytes.fromhex(case["pdu"])), side)
    return explain("rtu" if kind == "rtu-frame" else "tcp", bytes.fromhex(case["frame"]), side)


@every_case(("kind", "case"), vectors())
def test_the_verdict_is_that_of_the_vectors(kind: str, case: dict[str, Any]) -> None:
    explanation = of_vector(kind, case)
    assert explanation.valid == LEFT_OPEN.get(case["id"], case["result"] != "invalid"), explanation.verdict
    if explanation.valid:
        assert explanation.diagnosis == ()
        assert not [field for field in explanation.fields if field.name == "left over"]


@every_case(("kind", "case"), [case for case in vectors() if case.values[1]["result"] == "invalid"])
def test_an_invalid_case_has_its_error_at_the_place_of_its_reason(kind: str, case: dict[str, Any]) -> None:
    """The vectors give the reason of a refusal; each reason belongs to one place of the bytes."""
    explanation = of_vector(kind, case)
    assert explanation.error is not None
    reason, at, _ = explanation.error
    starts = {field.offset for field in explanation.fields}
    size = sum(field.length for field in explanation.fields)
    if reason != case["reason"]:
        # The fields say more than `decode`: a whole frame ends before the rest, or the checksum was left out.
        assert (case["reason"], reason) in {
            ("checksum", "short"),
            ("checksum", "long"),
            ("length", "long"),
            ("value", "long"),
        }
    match reason:
        case "checksum" if explanation.fields[-1].name == "left over":
            assert at == explanation.fields[-1].offset
        case "checksum":
            assert at == next(field.offset for field in explanation.fields if field.name in ("CRC", "LRC"))
        case "delimiter":
            assert at == 0 or chr(case["text"].encode()[at - 1]) in ":0123456789ABCDEF\n"
        case "character":
            assert case["text"][at] not in "0123456789ABCDEFabcdef"
        case "long":
            assert at in (*starts, 256, 513)
        case "short" if "group" in case["comment"] or kind == "pdu":
            assert at in starts or at == 1 + len(bytes.fromhex(case["pdu"]))
        case "short":
            assert at in (size, size - 2)
        case _:
            assert at in starts
