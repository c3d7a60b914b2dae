"""The table of contents: which message class belongs to which function code.

    01 Read Coils                05 Write Single Coil          0F Write Multiple Coils        07 Read Exception Status
    02 Read Discrete Inputs      06 Write Single Register      10 Write Multiple Registers    08 Diagnostics
    03 Read Holding Registers    16 Mask Write Register        17 Read/Write Multiple         0B Get Comm Event Counter
    04 Read Input Registers      18 Read FIFO Queue            14 Read File Record            0C Get Comm Event Log
    11 Report Server ID          2B/0E Read Device             15 Write File Record           2B/0D CANopen General
                                       Identification                                               Reference

A function code of your own: write a request and a response class, then `register(YourRequest)`. From then on servers,
clients, `explain` and the byte count of RTU know it.
"""

from __future__ import annotations

from typing import Any, TypeAlias

from barewire.errors import DecodeError, EncodeError
from barewire.modbus.messages.base import EXCEPTION_BIT, ExceptionResponse, Message, Request, Response
from barewire.modbus.messages.canopen_reference import CanopenReference
from barewire.modbus.messages.coils import ReadCoils, ReadDiscreteInputs, WriteMultipleCoils, WriteSingleCoil
from barewire.modbus.messages.combined import MaskWriteRegister, ReadWriteMultipleRegisters
from barewire.modbus.messages.comm_events import GetCommEventCounter, GetCommEventLog
from barewire.modbus.messages.diagnostics import Diagnostics, ReadExceptionStatus
from barewire.modbus.messages.fifo import ReadFifoQueue
from barewire.modbus.messages.files import ReadFileRecord, WriteFileRecord
from barewire.modbus.messages.identification import ReadDeviceIdentification, ReportServerId
from barewire.modbus.messages.registers import (
    ReadHoldingRegisters,
    ReadInputRegisters,
    WriteMultipleRegisters,
    WriteSingleRegister,
)
from barewire.modbus.messages.sdo_abort import ExtendedExceptionResponse

AnyRequest: TypeAlias = Request[Any]

ENCAPSULATED = 0x2B
"""Behind this function code a second byte, the MEI type, says which function it is [MB-APP 6.19]."""

_requests: dict[int, type[AnyRequest]] = {}
_encapsulated: dict[int, type[AnyRequest]] = {}


def register(request: type[AnyRequest], mei_type: int | None = None) -> type[AnyRequest]:
    """Make a request class known under its function code; usable as a decorator. `mei_type` only for 2B.

    Raises EncodeError for what is no request, for a code outside 1..127, and for 2B without an MEI type. A code that is
    taken is replaced: some devices speak their own 07.
    """
    is_request = isinstance(request, type) and issubclass(request, Request)
    if not is_request or not all(hasattr(request, name) for name in ("function_code", "layout", "response")):
        raise EncodeError("register wants a request class, with a function_code, a layout and a response")
    if not 1 <= request.function_code <= 0x7F:
        raise EncodeError(f"function code {request.function_code:02X}h: expected 01h..7Fh", "function_code")
    if (mei_type is not None) != (request.function_code == ENCAPSULATED):
        raise EncodeError("an MEI type belongs to function 2Bh, and only to that one", "function_code")
    if mei_type is None:
        _requests[request.function_code] = request
    else:
        _encapsulated[mei_type] = request
    return request


def forget(request: type[AnyRequest]) -> None:
    """Undo `register`: its function code is unknown again. For tests; what was replaced does not come back."""
    for known_by in (_requests, _encapsulated):
        for number in [number for number, known in known_by.items() if known is request]:
            del known_by[number]


for _request in (
    ReadCoils,
    ReadDiscreteInputs,
    ReadHoldingRegisters,
    ReadInputRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
    ReadExceptionStatus,
    Diagnostics,
    GetCommEventCounter,
    GetCommEventLog,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    ReportServerId,
    ReadFileRecord,
    WriteFileRecord,
    MaskWriteRegister,
    ReadWriteMultipleRegisters,
    ReadFifoQueue,
):
    register(_request)
register(CanopenReference, mei_type=0x0D)
register(ReadDeviceIdentification, mei_type=0x0E)


def known() -> list[type[AnyRequest]]:
    """Every request class there is, by function code."""
    found = [*_requests.values(), *_encapsulated.values()]
    return sorted(found, key=lambda request: request.function_code)


def request_class(pdu: bytes) -> type[AnyRequest] | None:
    """The class of a request PDU, told from its first byte or two; None for an unknown function."""
    if not pdu:
        return None
    if pdu[0] == ENCAPSULATED:
        return _encapsulated.get(pdu[1]) if len(pdu) > 1 else None
    return _requests.get(pdu[0])


def response_class(pdu: bytes) -> type[Response] | None:
    """The class of a response PDU, exception responses included; None for an unknown function."""
    if pdu and pdu[0] & EXCEPTION_BIT:
        return ExtendedExceptionResponse if pdu[:2] == ExtendedExceptionResponse.BEGINNING else ExceptionResponse
    request = request_class(pdu)
    return request.response if request else None


def _measure(message: type[Message] | None, pdu: bytes) -> int | None:
    if message is None:
        return 2 if pdu == bytes([ENCAPSULATED]) else None
    try:
        size = message.measure(pdu)
    except Exception:
        # A `measure` of the user's, called with the first bytes of anything at all. Who fails to count cannot count:
        # silence ends the frame then, and the line goes on.
        return None
    return size if isinstance(size, int) and size > 0 else None


def measure_request(pdu: bytes) -> int | None:
    """How many bytes of a request to wait for, told from the first ones; None if nobody can know.

    >>> measure_request(b"\\x03"), measure_request(b"\\x10\\x00\\x00\\x00\\x02\\x04"), measure_request(b"\\x41")
    (5, 10, None)
    """
    return _measure(request_class(pdu), pdu)


def measure_response(pdu: bytes) -> int | None:
    """The same for a response.

    >>> measure_response(b"\\x03"), measure_response(b"\\x03\\x04"), measure_response(b"\\x83")
    (2, 6, 2)
    """
    return _measure(response_class(pdu), pdu)


def decode_request(pdu: bytes) -> AnyRequest:
    """A request PDU as a message. DecodeError("function") for a code that nobody here knows.

    >>> decode_request(bytes.fromhex("03006B0003"))
    ReadHoldingRegisters(address=107, quantity=3)
    """
    if not pdu:
        raise DecodeError("short", pdu, 0, "an empty PDU has no function code")
    found = request_class(pdu)
    if found is None:
        raise DecodeError("function", pdu, 0, f"function {pdu[0]:02X} is not known")
    return found.decode(pdu)


def decode_response(pdu: bytes) -> Response:
    """A response PDU as a message, without its request: use `request.read_response` where there is one.

    >>> decode_response(bytes.fromhex("8302"))
    ExceptionResponse(function_code=131, exception_code=2)
    """
    if not pdu:
        raise DecodeError("short", pdu, 0, "an empty PDU has no function code")
    found = response_class(pdu)
    if found is None:
        raise DecodeError("function", pdu, 0, f"function {pdu[0]:02X} is not known")
    return found.decode(pdu)
