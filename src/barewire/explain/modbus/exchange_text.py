"""Formats the events of the Modbus sniffer: a line for each exchange, a dict for each event.

1.000000  unit 1  Read Holding Registers, 2 from 0000h -> 23 7, after 12.3 ms
2.000000  unit 9  Read Holding Registers, 1 from 0000h -> no answer
"""

from __future__ import annotations

from barewire.explain.modbus.pdu import explain_pdu
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.sniffer import (
    AmbiguousFrame,
    NoiseSeen,
    RequestSeen,
    ResponseMissing,
    ResponseSeen,
    SnifferEvent,
)

_SHOWN = 12
"""The most values or bytes of an answer in a line; `exchange_as_dict` has all of them."""


def exchange_line(event: SnifferEvent) -> str | None:
    """Return the event as one line; None for a request whose answer is still to come.

    >>> request = RequestSeen(1, bytes.fromhex("0300000002"), 1.0)
    >>> exchange_line(request), exchange_line(ResponseSeen(1, bytes.fromhex("030400170007"), 1.0123, request=request))
    (None, '1.000000  unit 1  Read Holding Registers, 2 from 0000h -> 23 7, after 12.3 ms')
    """
    match event:
        case RequestSeen(unit=0):
            return f"{event.at:.6f}  all     {explain_pdu(event.pdu, 'request').summary} (broadcast)"
        case RequestSeen():
            return None
        case ResponseMissing():
            return f"{_request(event.request)} -> no answer"
        case AmbiguousFrame():
            summary = explain_pdu(event.pdu, "request").summary
            return f"{event.at:.6f}  unit {event.unit}  {summary} -> seen once: the request or its echo"
        case NoiseSeen():
            data = event.noise.data
            return f"{event.at:.6f}  noise   {_clipped(data.hex(' ').upper().split())} ({event.noise.text})"
        case ResponseSeen(request=None):
            summary = explain_pdu(event.pdu, "response").summary
            return f"{event.at:.6f}  unit {event.unit}  (request not seen) -> {summary}"
        case ResponseSeen(request=request):
            assert request is not None
            late = ", late: after the next request" if event.late else ""
            return (
                f"{_request(request)} -> {_result(event, request)}, after {1e3 * (event.at - request.at):.1f} ms{late}"
            )


def _request(request: RequestSeen) -> str:
    return f"{request.at:.6f}  unit {request.unit}  {explain_pdu(request.pdu, 'request').summary}"


def _result(answer: ResponseSeen, request: RequestSeen) -> str:
    """Return the part of an answer that its request does not contain."""
    pdu = answer.pdu
    parsed = explain_pdu(pdu, "response")
    if pdu[0] & EXCEPTION_BIT:
        return parsed.summary.partition(" to ")[0]
    if parsed.error is not None:
        return f"cannot be decoded: {parsed.error.text}"
    if pdu == request.pdu or request.pdu.startswith(pdu):
        return "done"
    registers = [str(field.value) for field in parsed.fields if field.name.startswith("register ")]
    return _clipped(registers or pdu[1:].hex(" ").upper().split())


def _clipped(parts: list[str]) -> str:
    return " ".join(parts if len(parts) <= _SHOWN else [*parts[:_SHOWN], "..."])


def exchange_as_dict(event: SnifferEvent) -> dict[str, object]:
    """Return the event for `json.dumps`; `request_at` is the time of the request of a response or a time-out.

    >>> exchange_as_dict(ResponseMissing(RequestSeen(1, bytes.fromhex("0300000002"), 1.0), 2.0))
    {'event': 'unanswered', 'at': 2.0, 'unit': 1, 'request_at': 1.0}
    """
    match event:
        case RequestSeen():
            name = "request" if event.unit or event.transaction is not None else "broadcast"
            return _frame(name, event.unit, event.pdu, event.at, event.transaction)
        case ResponseSeen():
            result = _frame("response", event.unit, event.pdu, event.at, event.transaction)
            if event.pdu[0] & EXCEPTION_BIT and len(event.pdu) > 1:
                result["exception"] = event.pdu[1]
            request = event.request
            return result | {
                "request_at": None if request is None else request.at,
                "seconds": None if request is None else round(event.at - request.at, 6),
                "late": event.late,
            }
        case ResponseMissing():
            return {"event": "unanswered", "at": event.at, "unit": event.request.unit, "request_at": event.request.at}
        case AmbiguousFrame():
            return _frame("half", event.unit, event.pdu, event.at, None)
        case NoiseSeen():
            data, reason, text = event.noise
            return {"event": "noise", "at": event.at, "data": data.hex(), "reason": reason, "text": text}


def _frame(name: str, unit: int, pdu: bytes, at: float, transaction: int | None) -> dict[str, object]:
    parsed = explain_pdu(pdu, "response" if name == "response" else "request")
    fields = {field.name: field.value if isinstance(field.value, int) else str(field.value) for field in parsed.fields}
    result: dict[str, object] = {"event": name, "at": at, "unit": unit, "function": pdu[0] & ~EXCEPTION_BIT}
    if transaction is not None:
        result["transaction"] = transaction
    return result | {"pdu": pdu.hex(), "summary": parsed.summary, "fields": fields}
