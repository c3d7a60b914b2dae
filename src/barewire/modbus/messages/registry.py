"""The registry: the request class of a function code, and from it the response class and the length of a PDU.

It begins with the tables `FUNCTIONS` and `MEI_TYPES` of `messages/__init__.py`, and loads the file of a class when its
function code comes for the first time: a line on which only registers are read loads no other messages. Servers,
clients, sniffers, explanations and RTU lines look classes up here. Three lists are written by hand, because they are
behaviour or need static types: what a unit does (`_ANSWERS` in `server/table.py` and `server/handlers.py`), the methods
of a client (`io/modbus/methods.py`), and the imports for type checkers in `messages/__init__.py`.

To add a function code of your own, write a request and a response class, then call `register(YourRequest)`.
"""

from __future__ import annotations

from typing import Any, TypeAlias, TypeVar

from barewire.errors import DecodeError, EncodeError
from barewire.modbus import messages
from barewire.modbus.messages.base import EXCEPTION_BIT, Message, Request, Response

AnyRequest: TypeAlias = Request[Any]
M = TypeVar("M", bound=Message)

ENCAPSULATED = 0x2B
"""The function code that is followed by an MEI type, which selects the function [MB-APP 6.19]."""


class _Functions:
    """Request classes by number: those that were loaded or registered, and the names of the others."""

    def __init__(self, names: dict[int, str]) -> None:
        self.classes: dict[int, type[AnyRequest]] = {}
        self.names = dict(names)

    def get(self, number: int) -> type[AnyRequest] | None:
        """Return the class of a number, None for an unknown one. The first call for a number loads its file."""
        request = self.classes.get(number)
        if request is None and (name := self.names.get(number)) is not None:
            # In this order, since another thread that finds neither class nor name would call the function unknown.
            request = self.classes.setdefault(number, getattr(messages, name))
            self.names.pop(number, None)
        return request

    def set(self, number: int, request: type[AnyRequest]) -> None:
        """Register a class in place of the present one."""
        self.classes[number] = request
        self.names.pop(number, None)

    def remove(self, request: type[AnyRequest]) -> None:
        """Make the numbers of this class unknown."""
        for number in [number for number in (*self.classes, *self.names) if self.get(number) is request]:
            del self.classes[number]


_functions = _Functions(messages.FUNCTIONS)
_encapsulated = _Functions(messages.MEI_TYPES)


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
        _functions.set(request.function_code, request)
    else:
        _encapsulated.set(mei_type, request)
    return request


def unregister(request: type[AnyRequest]) -> None:
    """Undo `register`: the function code is unknown again. A class that was replaced does not come back."""
    for table in (_functions, _encapsulated):
        table.remove(request)


def known_requests() -> list[type[AnyRequest]]:
    """Return every registered request class, by function code."""
    known = [table.get(number) for table in (_functions, _encapsulated) for number in (*table.classes, *table.names)]
    return sorted(filter(None, known), key=lambda request: (request.function_code, request.mei_type or 0))


def request_class(pdu: bytes) -> type[AnyRequest] | None:
    """Return the class of a request PDU, from its first one or two bytes; None for an unknown function."""
    if not pdu:
        return None
    if pdu[0] == ENCAPSULATED:
        return _encapsulated.get(pdu[1]) if len(pdu) > 1 else None
    return _functions.get(pdu[0])


def response_class(pdu: bytes) -> type[Response] | None:
    """Return the class of a response PDU, also of an exception response; None for an unknown function."""
    if pdu and pdu[0] & EXCEPTION_BIT:
        is_encapsulated = pdu[0] == ENCAPSULATED | EXCEPTION_BIT
        if is_encapsulated and pdu[:2] == messages.ExtendedExceptionResponse.BEGINNING:
            return messages.ExtendedExceptionResponse
        return messages.ExceptionResponse
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
