"""A Modbus PDU, field by field: its function, its direction, and the meaning of each field.

        04 0F B1 00 02        fits a request (5 bytes), but not a response: the byte count would be 0Fh
        04 04 00 00 01 10     fits a response (byte count 4, 4 bytes follow), but not a request
        06 00 01 00 03        fits both: a write is answered with its echo

A PDU does not contain its direction. If the caller does not give it, both shapes are tried. If both fit, the PDU
counts as a request, with a note. If neither fits, the one nearer in length counts, because wrong values are more
common than wrong lengths.
"""

from __future__ import annotations

from typing import NamedTuple

from barewire.codecs import Field
from barewire.errors import DecodeError
from barewire.modbus.exceptions import exception_name
from barewire.modbus.messages.base import EXCEPTION_BIT, Message
from barewire.modbus.messages.canopen_reference import ExtendedExceptionResponse
from barewire.modbus.messages.registry import ENCAPSULATED, request_class, response_class
from barewire_workbench.frames.modbus.field_text import code_title, function_title, with_meanings
from barewire_workbench.frames.result import LEFT_OVER, FrameRole, counted, fill_gaps

_UNKNOWN_SHAPE = "data"


class ParsedPdu(NamedTuple):
    """One PDU explained; offsets count from its start. `note` mentions an ambiguous direction."""

    role: FrameRole | None
    fields: list[Field]
    error: DecodeError | None
    summary: str
    note: str = ""


def explain_pdu(pdu: bytes, role: FrameRole | None = None) -> ParsedPdu:
    """Explain a PDU. Never raises; `error` holds the fault.

    >>> explain_pdu(bytes.fromhex("8302")).summary
    'exception 02 (illegal data address) to 03 Read Holding Registers'
    """
    if not pdu:
        return ParsedPdu(role, [], DecodeError("short", pdu, 0, "there is no function code"), "nothing")
    note = ""
    if role is None:
        role, note = guess_role(pdu)
    message = _shape(pdu, role)
    fields = with_meanings(_fields(message, pdu), pdu, role)
    return ParsedPdu(role, fields, _error(message, pdu, role), _summary(fields, pdu), note)


def guess_role(pdu: bytes) -> tuple[FrameRole | None, str]:
    """Return the direction by the shape, and a note if the other one fits as well. None for an unknown function.

    >>> guess_role(bytes.fromhex("0600010003"))
    ('request', 'a response can look the same')
    """
    if pdu[0] & EXCEPTION_BIT:
        return "response", ""
    request, response = request_class(pdu), response_class(pdu)
    if request is None or response is None:
        return None, ""
    fits_request, fits_response = _decode_error(request, pdu) is None, _decode_error(response, pdu) is None
    if fits_request:
        return "request", "a response can look the same" if fits_response else ""
    if fits_response or _missed(response, pdu) < _missed(request, pdu):
        return "response", ""
    return "request", ""


def _missed(message: type[Message], pdu: bytes) -> int:
    """Return the difference in bytes between the length and the length of the shape."""
    size = message.measure(pdu)
    return abs(size - len(pdu)) if size is not None else len(pdu)


def _shape(pdu: bytes, role: FrameRole | None) -> type[Message] | None:
    """Return the message class of these bytes. Bit 7 marks an exception response, whatever role the caller gives."""
    if role == "response" or pdu[0] & EXCEPTION_BIT:
        return response_class(pdu)
    return request_class(pdu)


def _decode_error(message: type[Message], pdu: bytes) -> DecodeError | None:
    try:
        message.decode(pdu)
    except DecodeError as error:
        return error
    return None


def _error(message: type[Message] | None, pdu: bytes, role: FrameRole | None) -> DecodeError | None:
    if pdu[0] & ~EXCEPTION_BIT == 0:
        return DecodeError("function", pdu, 0, f"function code {pdu[0]:02X}: there is no function 00")
    if role == "request" and pdu[0] & EXCEPTION_BIT:
        return DecodeError(
            "function", pdu, 0, f"function code {pdu[0]:02X}: bit 7 is set, as in exception responses only"
        )
    # An unknown function is not a fault: 65..72 and 100..110 are user-defined.
    return _decode_error(message, pdu) if message else None


def _fields(message: type[Message] | None, pdu: bytes) -> list[Field]:
    """Return all bytes in fields, named as far as the shape is known."""
    if message is not None:
        found = message.fields(pdu)
        names = message.layout.names
        return fill_gaps(found, len(pdu), names[len(found)] if len(found) < len(names) else "")
    found = [Field(0, 1, "function_code", pdu[0])]
    if pdu[0] == ENCAPSULATED and len(pdu) > 1:
        found.append(Field(1, 1, "mei_type", pdu[1]))
    if len(pdu) > len(found):
        rest = pdu[len(found) :]
        found.append(Field(len(found), len(rest), _UNKNOWN_SHAPE, rest.hex(" ").upper()))
    return found


def _summary(fields: list[Field], pdu: bytes) -> str:
    """Return the message in one line, for the verdict."""
    if pdu[0] & EXCEPTION_BIT:
        text = f"exception {pdu[1]:02X} ({exception_name(pdu[1])})" if len(pdu) > 1 else "exception"
        if pdu[:2] == ExtendedExceptionResponse.BEGINNING:
            text = "extended exception"
        return f"{text} to {code_title(pdu[0] & ~EXCEPTION_BIT)}"
    by_name = {field.name: field.value for field in fields}
    address, quantity, value = by_name.get("address"), by_name.get("quantity"), by_name.get("value")
    if isinstance(address, int):
        if isinstance(quantity, int):
            return f"{function_title(pdu)}, {quantity} from {address:04X}h"
        if isinstance(value, int):
            meanings = {field.name: field.meaning for field in fields}
            return f"{function_title(pdu)}, {meanings['value'] if pdu[0] == 0x05 else value} to {address:04X}h"
    registers = sum(field.name.startswith("register ") for field in fields)
    if registers:
        return f"{function_title(pdu)}, {counted(registers, 'register')}"
    packed = sum(field.name in ("coils", "inputs") for field in fields)
    return f"{function_title(pdu)}, {counted(packed)} of bits" if packed else function_title(pdu)


def left_over_field(at: int, size: int, meaning: str = "") -> list[Field]:
    """Return a field for the bytes after a complete frame, if there are any."""
    return [Field(at, size - at, LEFT_OVER, None, meaning)] if size > at else []
