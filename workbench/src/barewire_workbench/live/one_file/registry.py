"""The registry: the request class of a function code, and from it the response class and the length of a PDU.

The line that receives RTU frames asks it for lengths, and a server for the class of a request.
"""

from __future__ import annotations

from typing import Any, TypeAlias, TypeVar

from barewire.errors import DecodeError
from barewire.modbus.messages.base import EXCEPTION_BIT, Message, Request, Response
from barewire.modbus.messages.coils import ReadCoils, ReadDiscreteInputs, WriteMultipleCoils, WriteSingleCoil
from barewire.modbus.messages.combined import MaskWriteRegister, ReadWriteMultipleRegisters
from barewire.modbus.messages.comm_events import GetCommEventCounter, GetCommEventLog
from barewire.modbus.messages.diagnostics import Diagnostics, ReadExceptionStatus
from barewire.modbus.messages.exception_response import ExceptionResponse
from barewire.modbus.messages.fifo import ReadFifoQueue
from barewire.modbus.messages.files import ReadFileRecord, WriteFileRecord
from barewire.modbus.messages.identification import ReadDeviceIdentification, ReportServerId
from barewire.modbus.messages.registers import (
    ReadHoldingRegisters,
    ReadInputRegisters,
    WriteMultipleRegisters,
    WriteSingleRegister,
)

AnyRequest: TypeAlias = Request[Any]
M = TypeVar("M", bound=Message)

REQUESTS: tuple[type[AnyRequest], ...] = (
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
    ReadDeviceIdentification,
)
"""The requests of this file, by function code. To add one of your own, write its two classes and name it here."""

_BY_CODE = {
    bytes([cls.function_code] if cls.mei_type is None else [cls.function_code, cls.mei_type]): cls for cls in REQUESTS
}


def request_class(pdu: bytes) -> type[AnyRequest] | None:
    """Return the class of a request PDU, from its first one or two bytes; None for an unknown function."""
    return _BY_CODE.get(pdu[:1]) or _BY_CODE.get(pdu[:2])


def response_class(pdu: bytes) -> type[Response] | None:
    """Return the class of a response PDU, also of an exception response; None for an unknown function."""
    if pdu and pdu[0] & EXCEPTION_BIT:
        return ExceptionResponse
    request = request_class(pdu)
    return request.response if request else None


def measure_request(pdu: bytes) -> int | None:
    """Return the length of a request PDU, as far as its first bytes determine it; None if they do not.

    >>> measure_request(b"\\x03"), measure_request(b"\\x10\\x00\\x00\\x00\\x02\\x04"), measure_request(b"\\x41")
    (5, 10, None)
    """
    request = request_class(pdu)
    return None if request is None else request.measure(pdu)


def measure_response(pdu: bytes) -> int | None:
    """Return the length of a response PDU, as far as its first bytes determine it; None if they do not.

    >>> measure_response(b"\\x03"), measure_response(b"\\x03\\x04"), measure_response(b"\\x83")
    (2, 6, 2)
    """
    response = response_class(pdu)
    return None if response is None else response.measure(pdu)


def decode_request(pdu: bytes) -> AnyRequest:
    """Decode a request PDU. Raises DecodeError("function") for an unknown function code."""
    return _decode(request_class(pdu), pdu)


def decode_response(pdu: bytes) -> Response:
    """Decode a response PDU without its request. With the request, use `request.read_response` instead.

    >>> decode_response(bytes.fromhex("8302"))
    ExceptionResponse(function_code=131, exception_code=2)
    """
    return _decode(response_class(pdu), pdu)


def _decode(message: type[M] | None, pdu: bytes) -> M:
    if message is None:
        at_fault = f"function {pdu[0]:02X} is not known" if pdu else "an empty PDU has no function code"
        raise DecodeError("function" if pdu else "short", pdu, 0, at_fault)
    return message.decode(pdu)
