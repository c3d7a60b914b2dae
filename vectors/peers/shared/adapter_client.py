"""For the adapters of clients: a client makes a request of arguments, and takes the response to it.

`call(code, fields, reply)` makes the client's request of function `code`, answers it with the PDU `reply`, and returns
the PDU that the client sent and what it made of the reply. With `reply` None nobody answers, and the request counts.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from adapter import Answers, NotOffered, bits, bitted, hexed, octets, worded, words

Call = Callable[[int, dict[str, Any], bytes | None], tuple[bytes, Any]]


ARGUMENTS = {
    **dict.fromkeys((1, 2, 3, 4), ("address", "quantity")),
    **dict.fromkeys((5, 6), ("address", "value")),
    **dict.fromkeys((15, 16), ("address", "values")),
    0x16: ("address", "and_mask", "or_mask"),
    0x17: ("write_address", "values", "read_address", "read_quantity"),
    0x2B: ("read_code", "object_id"),
}
"""The arguments of a function, in the order that most clients have."""


def given(code: int, fields: dict[str, Any]) -> list[Any]:
    """Return the arguments of a call."""
    return [fields[name] for name in ARGUMENTS[code]]


def given_to_c(code: int, fields: dict[str, Any], found: Any, values: Any) -> list[Any]:
    """Return the arguments of a call in C: `found` is room for what is read, `values` are those to write."""
    numbers = [value for value in (*fields.values(), *fields.get("values", ())) if isinstance(value, int)]
    if not all(0 <= value <= 0xFFFF for value in numbers):
        raise NotOffered("its arguments are uint16_t, or truncated")
    arguments: list[Any] = []
    for value in given(code, fields):
        arguments += [len(value), values] if isinstance(value, list) else [int(value)]
    return [*arguments, found] if code <= 4 or code == 0x17 else arguments


class ExceptionAnswer(Exception):
    """The client says that the reply is an exception response with this code."""


def client_answers(call: Call, codes: set[int]) -> Answers:
    """Return the answers of a client for the functions that it has: requests, and responses to requests."""

    def encode(question: dict[str, Any]) -> dict[str, Any]:
        code = octets(question["function"])[0]
        known = code in codes and question["function"] != "2B 0D"
        if question["side"] != "request" or not known or not question["message"]:
            raise NotOffered("the client has no call for this")
        return {"pdu": hexed(call(code, arguments(code, question["message"]), None)[0])}

    def decode(question: dict[str, Any]) -> dict[str, Any]:
        request, reply = octets(question["request"]), octets(question["response"])
        fields = request_fields(request)
        if request[0] not in codes or fields is None:
            raise NotOffered("the client has no call for this")
        try:
            sent, result = call(request[0], fields, reply)
        except ExceptionAnswer as answer:
            return {"exception_code": answer.args[0]}
        if sent != request:
            raise NotOffered(f"the client sends {hexed(sent)} instead")
        if request[0] in (1, 2):
            return {"message": {"bits": bitted(result)}}
        if request[0] in (3, 4, 0x17):
            return {"message": {"registers": worded(result)}}
        written = {name: fields[name] for name in ("address", "value", "and_mask", "or_mask") if name in fields}
        return {"message": written | ({"quantity": len(fields["values"])} if "values" in fields else {})}

    return {"pdu": {"encode": encode}, "exchange": {"decode": decode}}


def arguments(code: int, message: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a message as arguments: `values` are the bits or the registers."""
    fields = dict(message)
    if "bits" in fields:
        fields["values"] = bits(fields.pop("bits"))
    if "registers" in fields:
        fields["values"] = words(fields.pop("registers"))
    return fields


def request_fields(pdu: bytes) -> dict[str, Any] | None:
    """Return the arguments with which a client makes this request; None for other functions."""
    code = pdu[0]
    if code in (1, 2, 3, 4):
        return dict(zip(ARGUMENTS[code], struct.unpack(">HH", pdu[1:])))
    if code in (5, 6):
        address, value = struct.unpack(">HH", pdu[1:])
        return {"address": address, "value": value == 0xFF00 if code == 5 else value}
    if code == 0x0F:
        address, count = struct.unpack(">HH", pdu[1:5])
        return {"address": address, "values": [bool(pdu[6 + at // 8] >> at % 8 & 1) for at in range(count)]}
    if code == 0x10:
        address, count = struct.unpack(">HH", pdu[1:5])
        return {"address": address, "values": list(struct.unpack(f">{count}H", pdu[6:]))}
    if code == 0x16:
        return dict(zip(ARGUMENTS[code], struct.unpack(">HHH", pdu[1:])))
    if code == 0x17:
        names = ("read_address", "read_quantity", "write_address")
        count = pdu[9] // 2
        return dict(zip(names, struct.unpack(">HHH", pdu[1:7]))) | {
            "values": list(struct.unpack(f">{count}H", pdu[10:]))
        }
    return None
