"""`barewire conform can://...`: hold any CANopen device against CiA 301 and 305, case by case."""

from __future__ import annotations

import json

from barewire.cli.arguments import ending
from barewire.errors import EncodeError
from barewire.io.canopen.conformance import NodeCaseResult, conform_can
from barewire.io.endpoint import Endpoint


def hold(endpoint: str, *, as_json: bool, gentle: bool, large: str | None, only: str) -> int:
    """Run the battery and print it; 1 if a case failed."""
    held, failed, left_out = 0, 0, 0
    wanted = tuple(name.strip().upper() for name in only.split(","))
    with ending(as_json):
        for result in conform_can(Endpoint.parse(endpoint), gentle=gentle, large=_place(large), only=wanted):
            held += result.outcome is not None
            failed += result.failure is not None
            left_out += result.outcome is None
            print(json.dumps(_as_dict(result), ensure_ascii=False) if as_json else _line(result), flush=True)
    if not held + left_out:
        raise EncodeError(f"--only {only!r}: no case has a name that begins so")
    if not as_json:
        print(f"{held - failed} of {held} as the standard says" + (f", {left_out} left out" if left_out else ""))
    return int(failed > 0)


def _place(text: str | None) -> tuple[int, int] | None:
    """INDEX:SUB in hexadecimal digits, as candump and data sheets write them."""
    if text is None:
        return None
    index, _, sub = text.partition(":")
    try:
        place = int(index, 16), int(sub or "0", 16)
    except ValueError:
        place = -1, -1
    if not (0x2000 <= place[0] <= 0xFFFF and 0 <= place[1] <= 0xFF):
        raise EncodeError(f"--large {text!r}: expected INDEX:SUB from 2000:00 on, in hexadecimal digits")
    return place


def _line(result: NodeCaseResult) -> str:
    status = "FAILED" if result.failure else "-" if result.outcome is None else "ok"
    case = result.case
    text = f"{case.title}: {result.failure}" if result.failure else case.title
    return f"{status:6}  {case.name:6}  {text}" + (f" ({result.left_out})" if result.left_out else "")


def _as_dict(result: NodeCaseResult) -> dict[str, object]:
    case = result.case
    return {
        "case": case.name,
        "title": case.title,
        "clause": case.clause,
        "effect": case.effect,
        "ok": None if result.outcome is None else result.failure is None,
        "left_out": result.left_out or None,
        "heard": [] if result.outcome is None else [list(turn) for turn in result.outcome.received],
        "failure": result.failure,
    }
