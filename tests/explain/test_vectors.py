"""Every frame and PDU of the vectors, explained: the verdict is that of the vectors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from barewire import rtu
from barewire.explain import Explanation, FrameRole, explain

VECTORS = Path(__file__).parent.parent.parent / "vectors"
LEFT_OPEN = {"exceptions-34": False}
"""What `explain` says of a case that the standard leaves open and that `decode` accepts: function 00 does not exist."""
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


@pytest.mark.parametrize(("kind", "case"), vectors())
def test_the_verdict_is_that_of_the_vectors(kind: str, case: dict[str, Any]) -> None:
    explanation = of_vector(kind, case)
    assert explanation.valid == LEFT_OPEN.get(case["id"], case["result"] != "invalid"), explanation.verdict
