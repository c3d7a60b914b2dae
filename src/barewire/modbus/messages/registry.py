"""The registry: the request class of a function code, and from it the response class and the length of a PDU.

It is filled from the list in `messages/__init__.py`: every request class there is registered under its `function_code`,
and under its `mei_type` if it has one (function 2B). Servers, clients, sniffers, `explain` and RTU lines look classes
up here, so there is no other table of function codes. Three lists are written by hand, because they are behaviour or
need static types: what a unit does (`_ANSWERS` in `server/table.py` and `server/handlers.py`), the methods of a client
(`io/modbus/methods.py`), and the imports for type checkers in `messages/__init__.py`.

To add a function code of your own, write a request and a response class, then call `register(YourRequest)`.
"""

from __future__ import annotations

from typing import Any, TypeAlias, TypeVar

from barewire.errors import DecodeError, EncodeError
from barewire.modbus import messages
from barewire.modbus.messages.base import EXCEPTION_BIT, ExceptionResponse, Message, Request, Response
from barewire.modbus.messages.canopen_reference import ExtendedExceptionResponse

AnyRequest: TypeAlias = Request[Any]
M = TypeVar("M", bound=Message)

ENCAPSULATED = 0x2B
"""The function code that is followed by an MEI type, which selects the function [MB-APP 6.19]."""

_requests: dict[int, type[AnyRequest]] = {}
_encapsulated: dict[int, type[AnyRequest]] = {}


def register(request: type[AnyRequest], mei_type: int | None = None) -> type[AnyRequest]:
    """Register a request class under its function code; also usable as a decorator.

    `mei_type`, only for function 2B, is that of the class unless given. Raises EncodeError for a class that is not a
    request, for a code outside 1..127, and for 2B without an MEI type. A class registered before under the same code
    is replaced: some devices have a 07 of their own.
    """
    is_request = isinstance(request, type) and issubclass(request, Request)
    if not is_request or not all(hasattr(request, name) for name in ("function_code", "layout", "response")):
        raise EncodeError("register needs a request class, with a function_code, a layout and a response")
    if not 1 <= request.function_code <= 0x7F:
        raise EncodeError(f"function code {request.function_code:02X}h: expected 01h..7Fh", "function_code")
    mei_type = request.mei_type if mei_type is None else mei_type
    if (mei_type is not None) != (request.function_code == ENCAPSULATED):
        raise EncodeError("an MEI type belongs to function 2Bh, and only to that one", "function_code")
    if mei_type is None:
        _requests[request.function_code] = request
    else:
        _encapsulated[mei_type] = request
    return request


def unregister(request: type[AnyRequest]) -> None:
    """Undo `register`: the function code is unknown again. A class that was replaced does not come back."""
    for table in (_requests, _encapsulated):
        for number in [number for number, registered in table.items() if registered is request]:
            del table[number]


for _name in messages.NAMES:
    _class = getattr(messages, _name)
    if isinstance(_class, type) and issubclass(_class, Request):
        register(_class)


def known_requests() -> list[type[AnyRequest]]:
    """Return every registered request class, by function code."""
    found = [*_requests.values(), *_encapsulated.values()]
    return sorted(found, key=lambda request: request.function_code)


def request_class(pdu: bytes) -> type[AnyRequest] | None:
    """Return the class of a request PDU, from its first one or two bytes; None for an unknown function."""
    if not pdu:
        return None
    if pdu[0] == ENCAPSULATED:
        return _encapsulated.get(pdu[1]) if len(pdu) > 1 else None
    return _requests.get(pdu[0])


def response_class(pdu: bytes) -> type[Response] | None:
    """Return the class of a response PDU, also of an exception response; None for an unknown function."""
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
        # The `measure` of a user's class may fail on the first bytes of a damaged frame. Then silence ends the frame.
        return None
    return size if isinstance(size, int) and size > 0 else None


def measure_request(pdu: bytes) -> int | None:
    """Return the length of a request PDU, as far as its first bytes determine it; None if they do not.

    >>> measure_request(b"\\x03"), measure_request(b"\\x10\\x00\\x00\\x00\\x02\\x04"), measure_request(b"\\x41")
    (5, 10, None)
    """
    return _measure(request_class(pdu), pdu)


def measure_response(pdu: bytes) -> int | None:
    """Return the length of a response PDU, like `measure_request`.

    >>> measure_response(b"\\x03"), measure_response(b"\\x03\\x04"), measure_response(b"\\x83")
    (2, 6, 2)
    """
    return _measure(response_class(pdu), pdu)


def decode_request(pdu: bytes) -> AnyRequest:
    """Decode a request PDU. Raises DecodeError("function") for an unregistered function code.

    >>> decode_request(bytes.fromhex("03006B0003"))
    ReadHoldingRegisters(address=107, quantity=3)
    """
    return _decode(request_class(pdu), pdu)


def decode_response(pdu: bytes) -> Response:
    """Decode a response PDU without its request. With the request, use `request.read_response` instead.

    >>> decode_response(bytes.fromhex("8302"))
    ExceptionResponse(function_code=131, exception_code=2)
    """
    return _decode(response_class(pdu), pdu)


def _decode(message: type[M] | None, pdu: bytes) -> M:
    if not pdu:
        raise DecodeError("short", pdu, 0, "an empty PDU has no function code")
    if message is None:
        raise DecodeError("function", pdu, 0, f"function {pdu[0]:02X} is not known")
    return message.decode(pdu)
