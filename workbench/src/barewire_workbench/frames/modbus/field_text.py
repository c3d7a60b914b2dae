"""The meanings of the fields of Modbus messages, which `explain` prints in the last column.

The message classes define the places of their fields and a few meanings. This file has the others: the base of
addresses, special units, and function codes that are user-defined or reserved.
"""

from __future__ import annotations

from barewire.codecs import Field
from barewire.modbus.exceptions import EXCEPTIONS, exception_name
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.canopen_reference import ExtendedExceptionResponse
from barewire.modbus.messages.identification import MORE, NO_MORE, OBJECT_NAMES, READ_CODES
from barewire.modbus.messages.registry import ENCAPSULATED, request_class
from barewire_workbench.frames.result import FrameRole

# Names of public functions, also of those without a message class.                     [MB-APP 5.1]
_PUBLIC = {
    0x08: "Diagnostics",
    0x0B: "Get Comm Event Counter",
    0x0C: "Get Comm Event Log",
    0x14: "Read File Record",
    0x15: "Write File Record",
    0x16: "Mask Write Register",
    0x17: "Read/Write Multiple Registers",
    0x18: "Read FIFO Queue",
    0x2B: "Encapsulated Interface Transport",
}
_MEI_TYPES = {0x0D: "CANopen General Reference", 0x0E: "Read Device Identification"}
_USER_DEFINED = (*range(65, 73), *range(100, 111))
_RESERVED = (9, 10, 13, 14, 41, 42, 90, 91, 125, 126, 127)

_QUANTITY_OF = {
    0x01: "coils",
    0x02: "discrete inputs",
    0x03: "holding registers",
    0x04: "input registers",
    0x0F: "coils",
    0x10: "holding registers",
}


def unit_text(unit: int, serial: bool) -> str:
    """Return the meaning of a unit number.

    >>> unit_text(0, serial=True)
    'broadcast: all units, no answer'
    """
    if unit == 0:
        return "broadcast: all units, no answer" if serial else "the server itself (or a broadcast behind it)"
    if unit == 255 and not serial:
        return "the server itself, no unit behind it"
    return f"unit {unit}" + (": 248..255 are reserved" if unit > 247 else "")


def unnamed_code_text(code: int) -> str:
    """Return the kind of a function code that has no name.

    >>> unnamed_code_text(65), unnamed_code_text(9), unnamed_code_text(99)
    ('user-defined function', 'reserved function', 'not a public function of the standard')
    """
    if code in _USER_DEFINED:
        return "user-defined function"
    return "reserved function" if code in _RESERVED else "not a public function of the standard"


def function_title(pdu: bytes) -> str:
    """Return the name of the function of a PDU."""
    known = request_class(pdu)
    if known is not None:
        return known.name
    if pdu[0] == ENCAPSULATED and len(pdu) > 1 and pdu[1] in _MEI_TYPES:
        return _MEI_TYPES[pdu[1]]
    return _PUBLIC.get(pdu[0]) or f"function {pdu[0]:02X} ({unnamed_code_text(pdu[0])})"


def code_title(code: int) -> str:
    """Return number and name, such as '04 Read Input Registers', as far as one byte determines it."""
    known = request_class(bytes([code]))
    name = known.name if known else _PUBLIC.get(code)
    return f"{code:02X} {name or unnamed_code_text(code)}"


def with_meanings(fields: list[Field], pdu: bytes, role: FrameRole | None) -> list[Field]:
    """Return the fields of a PDU, each with its meaning; meanings that a message class gives are kept."""
    by_name = {field.name: field.value for field in fields}
    start = by_name.get("address") if role == "request" else None
    result = []
    for field in fields:
        meaning = _meaning(field, pdu)
        if field.name.startswith("register ") and isinstance(start, int):
            meaning = ", ".join(filter(None, (f"for address {start + int(field.name[9:]):04X}h", meaning)))
        result.append(field._replace(meaning=meaning or field.meaning))
    return result


def _meaning(field: Field, pdu: bytes) -> str:
    """Return the meaning of one field; empty if there is nothing to add."""
    value = field.value
    if not isinstance(value, int):
        return ""
    if field.name.startswith("register ") or (field.name == "value" and not field.meaning):
        return f"{value - 0x10000} if signed" if value >= 0x8000 else ""
    match field.name:
        case "function_code" if value & EXCEPTION_BIT:
            return f"bit 7: exception to {code_title(value & ~EXCEPTION_BIT)}"
        case "function_code":
            return code_title(value) if value else "there is no function 00"
        case "exception_code" if pdu[:2] == ExtendedExceptionResponse.BEGINNING:
            return ""
        case "exception_code":
            known = EXCEPTIONS.get(value)
            return f"{known.name}: {known.hint}" if known else exception_name(value)
        case "address" | "read_address" | "write_address":
            return f"0-based; number {value + 1} in 1-based tables"
        case "quantity":
            return _QUANTITY_OF.get(pdu[0], "")
        case "byte_count":
            present = len(pdu) - field.offset - field.length
            return "bytes that follow" if present == value else f"{value} bytes announced, {present} follow"
        case "mei_type":
            return f"{value:02X} {_MEI_TYPES.get(value, 'reserved')}"
        case "read_code":
            return READ_CODES.get(value, "not defined")
        case "object_id":
            return OBJECT_NAMES.get(value, "private" if value >= 0x80 else "reserved")
        case "conformity":
            individual = ", or one object at a time" if value & 0x80 else ""
            return READ_CODES.get(value & 0x7F, "not defined") + individual
        case "more_follows":
            return {MORE: "more follows", NO_MORE: "this is all"}.get(value, "neither FFh nor 00h")
    return ""
