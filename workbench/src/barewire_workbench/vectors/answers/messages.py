"""Answers for pdu and exchange: the messages of the application protocol of Modbus."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from barewire.errors import EncodeError
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.messages.registry import decode_request, decode_response, request_class, response_class
from barewire_workbench.vectors.answers.texts import bits, bitted, hexed, octets, worded, words
from barewire_workbench.vectors.questions import Fields


def encode_pdu(given: Fields) -> Fields:
    """Encode a message of this function."""
    code = octets(given["function"])
    made = request_class(code) if given["side"] == "request" else response_class(code)
    if made is None:
        raise EncodeError(f"function {given['function']}: no message has this code")
    return {"pdu": hexed(made(**{name: _read(name, value) for name, value in given["message"].items()}).encode())}


def decode_pdu(given: Fields) -> Fields:
    """Decode a message."""
    decode = decode_request if given["side"] == "request" else decode_response
    pdu = octets(given["pdu"])
    message = decode(pdu)
    width = 2 if pdu[:1] == b"\x2b" or pdu[:2] == b"\xab\xff" else 1
    return {"function": hexed(pdu[:width]), "message": fields_of(message)}


def accept(given: Fields) -> Fields:
    """Take a response as the answer to a request."""
    request = decode_request(octets(given["request"]))
    try:
        return {"message": fields_of(request.read_response(octets(given["response"])))}
    except ModbusException as error:
        return {"exception_code": int(error.code)}


def fields_of(message: Any) -> Fields:
    """Return the fields of a message as the vectors write them."""
    return {field.name: _written(field.name, getattr(message, field.name)) for field in fields(message)}


def _read(name: str, value: Any) -> Any:
    """Return the value of a message field in the types of the library."""
    match name:
        case "bits":
            return bits(value)
        case "registers":
            return words(value)
        case "data" | "events":
            return octets(value)
        case "index" | "abort_code":
            return int(value, 16)
        case "places":
            return tuple((one["file"], one["record"], one["length"]) for one in value)
        case "records":
            return tuple(
                words(one) if isinstance(one, str) else (one["file"], one["record"], words(one["registers"]))
                for one in value
            )
        case "objects":
            return tuple((one["id"], octets(one["value"])) for one in value)
    return value


def _written(name: str, value: Any) -> Any:
    """Return the value of a message field as the vectors write it."""
    match name:
        case "bits":
            return bitted(value)
        case "registers":
            return worded(value)
        case "data" | "events":
            return hexed(value)
        case "index":
            return f"{value:04X}"
        case "abort_code":
            return f"{value:08X}"
        case "places":
            return [dict(zip(("file", "record", "length"), one)) for one in value]
        case "records":
            return [_record(one) for one in value]
        case "objects":
            return [{"id": one[0], "value": hexed(one[1])} for one in value]
    return value


def _record(one: tuple[Any, ...]) -> Any:
    if len(one) == 3 and isinstance(one[2], tuple):
        return {"file": one[0], "record": one[1], "registers": worded(one[2])}
    return worded(one)
