"""What was overheard, in words: a line for each exchange, and a dict for each event.

1.000000  unit 1  Read Holding Registers, 2 from 0000h -> 23 7, after 12.3 ms
2.000000  unit 9  Read Holding Registers, 1 from 0000h -> no answer
"""

from __future__ import annotations

from barewire.explain.modbus.pdu import explain_pdu
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.sniffer.sniffer import (
    AmbiguousFrame,
    NoiseSeen,
    RequestSeen,
    ResponseMissing,
    ResponseSeen,
    SnifferEvent,
)

_SHOWN = 12
"""So many values or bytes of an answer are printed; `exchange_as_dict` has them all."""


def exchange_line(event: SnifferEvent) -> str | None:
    """The line for an event; None for a question whose answer is still to come.

    >>> asked = RequestSeen(1, bytes.fromhex("0300000002"), 1.0)
    >>> exchange_line(asked), exchange_line(ResponseSeen(1, bytes.fromhex("030400170007"), 1.0123, request=asked))
    (None, '1.000000  unit 1  Read Holding Registers, 2 from 0000h -> 23 7, after 12.3 ms')
    """
    match event:
        case RequestSeen(unit=0):
            return f"{event.at:.6f}  all     {explain_pdu(event.pdu, 'request').summary} (broadcast)"
        case RequestSeen():
            return None
        case ResponseMissing():
            return f"{_question(event.request)} -> no answer"
        case AmbiguousFrame():
            said = explain_pdu(event.pdu, "request").summary
            return f"{event.at:.6f}  unit {event.unit}  {said} -> heard once: the request or its echo"
        case NoiseSeen():
            data = event.noise.data
            return f"{event.at:.6f}  noise   {_clipped(data.hex(' ').upper().split())} ({event.noise.text})"
        case ResponseSeen(request=None):
            said = explain_pdu(event.pdu, "response").summary
            return f"{event.at:.6f}  unit {event.unit}  (request not heard) -> {said}"
        case ResponseSeen(request=asked):
            assert asked is not None
            late = ", late: the next one had been asked" if event.late else ""
            return f"{_question(asked)} -> {_said(event, asked)}, after {1e3 * (event.at - asked.at):.1f} ms{late}"


def _question(asked: RequestSeen) -> str:
    return f"{asked.at:.6f}  unit {asked.unit}  {explain_pdu(asked.pdu, 'request').summary}"


def _said(answer: ResponseSeen, asked: RequestSeen) -> str:
    """What an answer says that its question did not."""
    pdu = answer.pdu
    letter = explain_pdu(pdu, "response")
    if pdu[0] & EXCEPTION_BIT:
        return letter.summary.partition(" to ")[0]
    if letter.error is not None:
        return f"not readable: {letter.error.text}"
    if pdu == asked.pdu or asked.pdu.startswith(pdu):
        return "done"
    registers = [str(field.value) for field in letter.fields if field.name.startswith("register ")]
    return _clipped(registers or pdu[1:].hex(" ").upper().split())


def _clipped(parts: list[str]) -> str:
    return " ".join(parts if len(parts) <= _SHOWN else [*parts[:_SHOWN], "..."])


def exchange_as_dict(event: SnifferEvent) -> dict[str, object]:
    """For programs: ready for `json.dumps`. `request_at` says which request a response or a silence belongs to.

    >>> exchange_as_dict(ResponseMissing(RequestSeen(1, bytes.fromhex("0300000002"), 1.0), 2.0))
    {'event': 'unanswered', 'at': 2.0, 'unit': 1, 'request_at': 1.0}
    """
    match event:
        case RequestSeen():
            kind = "request" if event.unit or event.transaction is not None else "broadcast"
            return _frame(kind, event.unit, event.pdu, event.at, event.transaction)
        case ResponseSeen():
            told = _frame("response", event.unit, event.pdu, event.at, event.transaction)
            if event.pdu[0] & EXCEPTION_BIT and len(event.pdu) > 1:
                told["exception"] = event.pdu[1]
            asked = event.request
            return told | {
                "request_at": None if asked is None else asked.at,
                "seconds": None if asked is None else round(event.at - asked.at, 6),
                "late": event.late,
            }
        case ResponseMissing():
            return {"event": "unanswered", "at": event.at, "unit": event.request.unit, "request_at": event.request.at}
        case AmbiguousFrame():
            return _frame("half", event.unit, event.pdu, event.at, None)
        case NoiseSeen():
            data, reason, text = event.noise
            return {"event": "noise", "at": event.at, "data": data.hex(), "reason": reason, "text": text}


def _frame(kind: str, unit: int, pdu: bytes, at: float, transaction: int | None) -> dict[str, object]:
    letter = explain_pdu(pdu, "response" if kind == "response" else "request")
    fields = {field.name: field.value if isinstance(field.value, int) else str(field.value) for field in letter.fields}
    told: dict[str, object] = {"event": kind, "at": at, "unit": unit, "function": pdu[0] & ~EXCEPTION_BIT}
    if transaction is not None:
        told["transaction"] = transaction
    return told | {"pdu": pdu.hex(), "summary": letter.summary, "fields": fields}
