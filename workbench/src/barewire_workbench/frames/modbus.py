"""Modbus frames, field by field: the meanings of fields, a PDU, and the three framings around it.

    rtu      unit | PDU | CRC                                       offsets count bytes
    ascii  : unit | PDU | LRC CR LF                                 offsets count characters, two for each byte
    tcp      transaction | protocol | length | unit | PDU           offsets count bytes

The message classes define the places of their fields; here are the meanings that they do not give. The `decode` of each
framing decides whether it is valid; here its bytes are named, also in a broken one. A fault of the framing is reported
first: with a wrong CRC the content is not certain.

A PDU does not contain its direction. If the caller does not give it, both shapes are tried:

        04 0F B1 00 02        fits a request (5 bytes), but not a response: the byte count would be 0Fh
        04 04 00 00 01 10     fits a response (byte count 4, 4 bytes follow), but not a request
        06 00 01 00 03        fits both: a write is answered with its echo
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from barewire.ascii import frame as ascii_frame
from barewire.ascii.frame import lrc
from barewire.codecs import Field, Layout
from barewire.errors import DecodeError, Reason
from barewire.modbus.adu import Adu
from barewire.modbus.exceptions import EXCEPTIONS, exception_name
from barewire.modbus.messages.base import EXCEPTION_BIT, Message
from barewire.modbus.messages.canopen_reference import ExtendedExceptionResponse
from barewire.modbus.messages.identification import MORE, NO_MORE, OBJECT_NAMES, READ_CODES
from barewire.modbus.messages.registry import (
    ENCAPSULATED,
    measure_request,
    measure_response,
    request_class,
    response_class,
)
from barewire.rtu import frame as rtu_frame
from barewire.rtu.crc import crc16
from barewire.tcp import frame as tcp_frame
from barewire_workbench.frames.result import (
    LEFT_OVER,
    Explanation,
    FrameRole,
    Problem,
    as_problem,
    counted,
    explained_field,
    explained_fields,
    fill_gaps,
    shifted,
)

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


# PDUs ---------------------------------------------------------------------------------------------------------------


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
    # If neither fits, the nearer length decides: wrong values are more common than wrong lengths.
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
        fields = message.fields(pdu)
        names = message.layout.names
        return fill_gaps(fields, len(pdu), names[len(fields)] if len(fields) < len(names) else "")
    fields = [Field(0, 1, "function_code", pdu[0])]
    if pdu[0] == ENCAPSULATED and len(pdu) > 1:
        fields.append(Field(1, 1, "mei_type", pdu[1]))
    if len(pdu) > len(fields):
        rest = pdu[len(fields) :]
        fields.append(Field(len(fields), len(rest), _UNKNOWN_SHAPE, rest.hex(" ").upper()))
    return fields


def _summary(fields: list[Field], pdu: bytes) -> str:
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


# Frames -------------------------------------------------------------------------------------------------------------


_MBAP = Layout(">HHHB", "transaction", "protocol", "length", "unit")


def _fault(decode: Callable[[bytes], Adu], data: bytes) -> DecodeError | None:
    try:
        decode(data)
    except DecodeError as error:
        return error
    return None


def _frame_summary(parsed: ParsedPdu, unit: int, ending: str = "") -> str:
    """Return the text of the verdict, such as 'a request to unit 1, Read Input Registers, 2 from 0FB1h; CRC ok'."""
    directions = {"request": "a request to", "response": "a response from"}
    direction = directions.get(parsed.role or "", "a message for or from")
    note = f" ({parsed.note})" if parsed.note else ""
    return f"{direction} unit {unit}, {parsed.summary}{ending and '; '}{ending}{note}"


def _unit_and_pdu(adu: bytes, parsed: ParsedPdu) -> list[Field]:
    """Return the fields of a unit on a serial line and its PDU; those of the PDU alone if there is no byte."""
    unit = [Field(0, 1, "unit", adu[0], unit_text(adu[0], serial=True))] if adu else []
    return [*unit, *shifted(parsed.fields, 1)]


def _is_bare(body: bytes, checked: int, role: FrameRole | None) -> bool:
    """Return whether unit and PDU fit a message as they are, but not without the last `checked` bytes.

    The checksum is often left out when a frame is written down. Only a known function shows that.
    """
    whole = explain_pdu(body[1:], role)
    return whole.role is not None and whole.error is None and explain_pdu(body[1:-checked], role).error is not None


# RTU ---------------------------------------------------------------------------------------------------------------


def explain_rtu(data: bytes, role: FrameRole | None = None, *, bare: bool = True) -> Explanation:
    """Explain one RTU frame. With `bare`, unit and PDU without a CRC are explained as such; else the last two bytes are
    a wrong CRC.

    >>> print(*explain_rtu(bytes.fromhex("010404000001103BC3"), "response").lines(), sep="\\n")
    0  01     unit           1            unit 1
    1  04     function code  4            04 Read Input Registers
    2  04     byte count     4            bytes that follow
    3  00 00  register 0     0
    5  01 10  register 1     0110h (272)
    7  3B C3  CRC                         CRC wrong, should be FB D8
    not valid: CRC is 3B C3, should be FB D8 (byte 7)
    """
    fault = _fault(rtu_frame.decode, data)
    frame, remark = data, ""
    is_doubtful = fault.reason == "checksum" if fault else explain_pdu(data[1:-2], role).error is not None
    end = _end_of_first(data, role) if is_doubtful else None
    if end is not None:
        frame, remark = data[:end], "perhaps the next frame"
        # The CRC does not detect a byte 00 after a good frame; only the length of the message does.
        reason: Reason = "checksum" if fault else "long"
        text = f"a complete frame ends before this, {counted(len(data) - end)} left over"
        fault = DecodeError(reason, data, end, text)
    elif bare and fault is not None and fault.reason in ("checksum", "short") and _is_bare(data, 2, role):
        return _without_crc(data, role)
    elif fault is not None and fault.reason == "checksum" and data[-2:] == crc16(data[:-2]).to_bytes(2, "big"):
        fault = DecodeError(fault.reason, data, fault.at, f"{fault.text}: the low byte comes first")
    body = frame[:-2] if len(frame) >= rtu_frame.SHORTEST else frame
    parsed = explain_pdu(body[1:], role)
    fields = _unit_and_pdu(data, parsed)
    if len(body) < len(frame):
        right = crc16(body).to_bytes(2, "little")
        meaning = "CRC ok" if frame[-2:] == right else f"CRC wrong, should be {right.hex(' ').upper()}"
        fields.append(Field(len(body), 2, "CRC", int.from_bytes(frame[-2:], "little"), meaning))
    fields += left_over_field(len(frame), len(data), remark)
    summary = _frame_summary(parsed, data[0], "CRC ok") if data else ""
    return Explanation(
        "rtu",
        parsed.role,
        explained_fields(fields, data),
        as_problem(fault) or as_problem(parsed.error, offset=1),
        summary,
    )


def _without_crc(data: bytes, role: FrameRole | None) -> Explanation:
    """Explain a frame that lacks its CRC.

    >>> explain_rtu(bytes.fromhex("01030000000A")).verdict
    'not valid: no CRC; with C5 CD it is a request to unit 1, Read Holding Registers, 10 from 0000h (byte 6)'
    """
    parsed, right = explain_pdu(data[1:], role), crc16(data).to_bytes(2, "little").hex(" ").upper()
    fields = [*_unit_and_pdu(data, parsed), Field(len(data), 0, "CRC", None, f"is missing; it would be {right}")]
    text = f"no CRC; with {right} it is {_frame_summary(parsed, data[0])}"
    return Explanation("rtu", parsed.role, explained_fields(fields, data), Problem("short", len(data), text), text)


def _end_of_first(data: bytes, role: FrameRole | None) -> int | None:
    """Return the end of a complete frame with a correct CRC, if more bytes follow, as when two frames are pasted."""
    measures = {"request": (measure_request,), "response": (measure_response,)}
    for measure in measures.get(role or "", (measure_request, measure_response)):
        size = measure(data[1:])
        if size is not None and size + 3 < len(data) and _fault(rtu_frame.decode, data[: size + 3]) is None:
            return size + 3
    return None


# ASCII -------------------------------------------------------------------------------------------------------------


def explain_ascii(data: bytes, role: FrameRole | None = None, *, typed: bool = False) -> Explanation:
    """Explain one ASCII frame. With `typed` the CR LF may be missing, as in a line copied from a screen.

    >>> explain_ascii(b":01040FB1000239\\r\\n").verdict
    'valid: a request to unit 1, Read Input Registers, 2 from 0FB1h; LRC ok'
    >>> explain_ascii(b":01040FB1000238\\r\\n").verdict
    'not valid: LRC is 38, should be 39 (character 13)'
    """
    parts = _ascii_parts(data, typed)
    start, end, adu = parts.start, parts.end, parts.adu
    fault = _ascii_fault(data, data[:end] + ascii_frame.END if typed and not parts.has_end else data)
    is_bare = False
    if parts.is_whole and start > 0 and fault is not None and fault.reason in ("checksum", "short"):
        is_bare = _is_bare(adu, 1, role)
    has_lrc = parts.is_whole and len(adu) >= 3 and not is_bare
    body = adu[:-1] if has_lrc else adu
    parsed = explain_pdu(body[1:], role)
    inner = _unit_and_pdu(adu, parsed)
    if has_lrc:
        meaning = "LRC ok" if adu[-1] == lrc(body) else f"LRC wrong, should be {lrc(body):02X}"
        inner.append(Field(len(body), 1, "LRC", adu[-1], meaning))
    elif is_bare:
        inner.append(Field(len(body), 0, "LRC", None, f"is missing; it would be {lrc(body):02X}"))
        text = f"no LRC; with {lrc(body):02X} it is {_frame_summary(parsed, adu[0])}"
        fault = DecodeError("short", data, end, text)
    fields = [Field(start - 1, 1, "start", ":", "begins a frame")] if start else []
    # Each byte between the colon and the line end is two characters.
    fields += [field._replace(offset=start + 2 * field.offset, length=2 * field.length) for field in inner]
    if parts.has_end:
        fields.append(Field(end, 2, "end", "CR LF", "ends a frame"))
    elif typed:
        meaning = "CR LF is missing here; on a line every frame ends with it"
        fields = [*fill_gaps(fields, end), Field(end, len(data) - end, "end", None, meaning)]
    problem = as_problem(fault)
    if problem is None and parsed.error is not None:
        problem = Problem(parsed.error.reason, start + 2 * (1 + parsed.error.at), parsed.error.text)
    shown = tuple(explained_field(field, _characters(field, data)) for field in fill_gaps(fields, len(data)))
    summary = _frame_summary(parsed, adu[0], "LRC ok") if adu else ""
    return Explanation("ascii", parsed.role, shown, problem, summary)


class _AsciiParts(NamedTuple):
    """The characters between the colon and the line end, and the bytes that they are, up to a wrong character.

    `is_whole`: there is no wrong one. Only then the last byte is the LRC; after a wrong one the fields are not certain.
    """

    start: int
    end: int
    has_end: bool
    adu: bytes
    is_whole: bool


def _ascii_parts(data: bytes, typed: bool) -> _AsciiParts:
    start = data.find(ascii_frame.START) + 1
    end = data.find(ascii_frame.END, start)
    has_end = end >= 0
    if not has_end:
        end = max(start, len(data.rstrip(b"\r\n")) if typed else len(data))
    digits = next((n for n, byte in enumerate(data[start:end]) if byte not in ascii_frame.DIGITS), end - start)
    adu = bytes.fromhex(data[start : start + digits - digits % 2].decode("ascii"))
    return _AsciiParts(start, end, has_end, adu, start + digits == end and digits % 2 == 0)


def _ascii_fault(data: bytes, completed: bytes) -> DecodeError | None:
    """Return the fault of the framing. A line end that was added for decoding (`completed`) is not counted."""
    fault = _fault(ascii_frame.decode, completed)
    if fault is None:
        return None
    text, at = fault.text, min(fault.at, len(data))
    if fault.reason == "delimiter" and at:
        # `decode` looks at the last two characters; here the place is where CR LF, or nothing more, should be.
        after = next((n for n, byte in enumerate(data) if n and byte not in ascii_frame.DIGITS), len(data))
        at = after + 2 * data[after:].startswith(ascii_frame.END)
    if fault.reason in ("short", "long") and len(completed) > len(data):
        text = text.replace(f"got {len(completed)}", f"got {len(data)} and no CR LF")
    return DecodeError(fault.reason, data, at, text)


def _characters(field: Field, data: bytes) -> str:
    """Return the characters of a field: digits in pairs, invisible ones by name or escaped."""
    text = data[field.offset : field.offset + field.length]
    if field.name == "end":
        return " ".join({13: "CR", 10: "LF"}[character] for character in text)
    if all(character in ascii_frame.DIGITS for character in text):
        return " ".join(text[index : index + 2].decode() for index in range(0, len(text), 2))
    return text.decode("latin-1").encode("unicode_escape").decode("ascii")


# TCP ---------------------------------------------------------------------------------------------------------------


def explain_tcp(data: bytes, role: FrameRole | None = None) -> Explanation:
    """Explain one Modbus TCP frame.

    >>> print(*explain_tcp(bytes.fromhex("000700000006010300000001")).lines(), sep="\\n")
     0  00 07  transaction    7  the answer repeats it
     2  00 00  protocol       0  Modbus
     4  00 06  length         6  unit and PDU: 6 bytes follow
     6  01     unit           1  unit 1
     7  03     function code  3  03 Read Holding Registers
     8  00 00  address        0  0-based; number 1 in 1-based tables
    10  00 01  quantity       1  holding registers
    valid: a request to unit 1, Read Holding Registers, 1 from 0000h; transaction 7
    """
    fault = _fault(tcp_frame.decode, data)
    header = _MBAP.fields(data)
    if len(header) < len(_MBAP.names):
        fields, parsed, end = fill_gaps(header, len(data), _MBAP.names[len(header)]), explain_pdu(b"", role), len(data)
    else:
        # Only a possible length ends the frame; any other number does not show where it ends.
        length = int.from_bytes(data[4:6], "big")
        end = min(tcp_frame.PREFIX + length, len(data)) if length in tcp_frame.LENGTHS else len(data)
        parsed = explain_pdu(data[_MBAP.size : end], role)
        fields = [*header, *shifted(parsed.fields, _MBAP.size)]
    fields = [_header_words(field, len(data)) for field in fields]
    fields += left_over_field(end, len(data), "after the frame: perhaps the next one")
    summary = _frame_summary(parsed, data[6], f"transaction {int.from_bytes(data[:2], 'big')}") if len(data) > 6 else ""
    whole = explained_fields(fields, data)
    return Explanation(
        "tcp", parsed.role, whole, as_problem(fault) or as_problem(parsed.error, offset=_MBAP.size), summary
    )


def _header_words(field: Field, size: int) -> Field:
    """Return a field of the header with its meaning; other fields are returned unchanged."""
    value = field.value
    if field.offset >= _MBAP.size or not isinstance(value, int):
        return field
    follow = size - tcp_frame.PREFIX
    meanings = {
        "transaction": "the answer repeats it",
        "protocol": "Modbus" if value == 0 else "not Modbus, which has 0",
        "length": f"unit and PDU: {value} bytes " + ("follow" if value == follow else f"announced, {follow} follow"),
        "unit": unit_text(value, serial=False),
    }
    return field._replace(meaning=meanings[field.name])
