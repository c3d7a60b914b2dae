"""The base of all messages: frozen values with a byte layout; a request can also read its own response.

    PDU  | function code | data ... |                       [MB-APP 4.1]

Each message class documents one message: a drawing of its bytes, an example that runs, a `layout`. The layout packs,
unpacks, explains and measures, so no byte position is written twice. A client needs no code for a function: it sends
the request, and `request.read_response(pdu)` returns the response only if it answers exactly that request.
"""

from __future__ import annotations

from operator import index
from typing import Any, ClassVar, Generic, Self, TypeVar

from barewire.codecs import Field, Layout
from barewire.codecs.order import is_whole
from barewire.errors import DecodeError, EncodeError, shown
from barewire.modbus.adu import PDU_LIMIT, check_pdu
from barewire.modbus.exceptions import ILLEGAL_DATA_VALUE, ModbusException

R = TypeVar("R", bound="Response")

EXCEPTION_BIT = 0x80
EXCEPTION_LAYOUT = Layout(">BB", "function_code", "exception_code")
"""That of an exception response: the function code of the request + 80h, and why it is declined."""
_NOT_LISTS = (str, bytes, bytearray, memoryview, set, frozenset, dict)


def _refuse_to_set(message: Message, name: str, value: object) -> None:
    from dataclasses import FrozenInstanceError  # loaded with the class of the message: a line without one needs it not

    raise FrozenInstanceError(f"cannot assign to field {name!r}")


def _refuse_to_delete(message: Message, name: str) -> None:
    from dataclasses import FrozenInstanceError

    raise FrozenInstanceError(f"cannot delete field {name!r}")


class Message:
    """A request or a response. `function_code` and the field names of `layout` are those of the standard."""

    __slots__ = ()

    name: ClassVar[str]
    """The standard's name of the function."""

    function_code: ClassVar[int]
    layout: ClassVar[Layout]

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        # `dataclass(slots=True)` makes each class anew, and the methods that it gave to the first one fail with a
        # TypeError for the name of no field.
        if "__setattr__" in vars(cls):
            type.__setattr__(cls, "__setattr__", _refuse_to_set)
            type.__setattr__(cls, "__delattr__", _refuse_to_delete)

    def encode(self) -> bytes:
        """Encode the message as a PDU. Its values were checked when it was made."""
        return self.layout.pack_of(self)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Decode a PDU. Raises DecodeError, with offset and reason, also for another function code."""
        cls.check_function(pdu)
        return cls.make(pdu, *cls.layout.unpack(pdu)[1:])

    @classmethod
    def make(cls, pdu: bytes, *values: Any) -> Self:
        """Make the message with these values. Raises DecodeError for a value that could not be encoded."""
        try:
            return cls(*values)
        except EncodeError as error:
            # The number of registers or bits follows from the byte count, so the error gives the offset of that field.
            names = (error.field, cls.layout.count)
            offsets = [field.offset for field in cls.layout.fields(pdu) if field.name in names]
            if not offsets:  # `fields` has no field for an empty tail
                offsets = [cls.layout.size if error.field == cls.layout.tail else 0]
            raise DecodeError("value", pdu, offsets[0], str(error)) from None

    @classmethod
    def check_function(cls, pdu: bytes) -> None:
        """Raise DecodeError unless the PDU begins with this message's function code."""
        if not pdu:
            raise DecodeError("short", pdu, 0, "an empty PDU has no function code")
        if pdu[0] != cls.function_code:
            text = f"function {pdu[0]:02X} where {cls.function_code:02X} ({cls.name}) was expected"
            raise DecodeError("mismatch", pdu, 0, text)

    @classmethod
    def measure(cls, pdu: bytes) -> int | None:
        """Return the length of the whole PDU, as far as its first bytes determine it; None if they do not."""
        return cls.layout.measure(pdu)

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return every field with its offset, for `explain`. A damaged message is shown as far as its bytes go."""
        return cls.layout.fields(pdu)


class Request(Message, Generic[R]):
    """A message that a client sends. `response` is the class of its response."""

    __slots__ = ()

    response: ClassVar[type[Response]]
    mei_type: ClassVar[int | None] = None
    """The second byte, which distinguishes the functions of code 2B [MB-APP 6.19]."""
    writes: ClassVar[bool] = False
    """Whether the request changes something, so that a lost response leaves the outcome unknown."""

    def read_response(self, pdu: bytes) -> R:
        """Decode the response to this request: its function, byte count and echoed fields must fit.

        Raises ModbusException for an exception response, DecodeError("mismatch") for a well-formed response to another
        request, and DecodeError with another reason for a PDU that is not a response at all.
        """
        if pdu and pdu[0] == self.function_code | EXCEPTION_BIT:
            raise ModbusException(EXCEPTION_LAYOUT.unpack(pdu)[1], self.function_code)
        # A class attribute cannot be generic, so `response` has no precise type: it is declared here.
        answer: R = self.fit(self.response.decode(pdu), pdu)
        return answer

    def without_answer(self, *, listens_only: bool = False) -> R | None:
        """Return a value in place of the response if the standard demands silence of the unit; None if it must respond.

        `listens_only`: the unit was put into listen only mode before.
        """
        return None

    def fit(self, response: Any, pdu: bytes) -> Any:
        """Return the response if it answers this request. Raises DecodeError("mismatch") if not.

        By default every field that request and response have in common must be equal; messages may override it.
        """
        for field in self.layout.fields(self.encode()):
            if hasattr(response, field.name) and getattr(response, field.name) != getattr(self, field.name, None):
                self.refuse(pdu, field.name, getattr(self, field.name, None), getattr(response, field.name))
        return response

    @classmethod
    def declines(cls, error: DecodeError) -> int:
        """Return the exception code for a malformed request: 03 unless the figure of the function has another one."""
        return ILLEGAL_DATA_VALUE

    def refuse(self, pdu: bytes, field: str, asked: object, answered: object) -> None:
        """Raise DecodeError("mismatch") for a field of the response that does not fit the request."""
        offsets = [part.offset for part in self.response.fields(pdu) if part.name == field]
        text = f"{field} {answered} where {asked} was asked ({self.name})"
        raise DecodeError("mismatch", pdu, offsets[0] if offsets else 0, text)


class Response(Message):
    """A message that a server sends."""

    __slots__ = ()


def check_range(name: str, value: int, low: int, high: int, message: Message | None = None) -> None:
    """Raise EncodeError unless `value` is a whole number in low..high, the limits of the field `name`.

    A number of another type than `int`, as numpy has them, becomes an `int` in the `message`: sums with it may wrap.
    """
    if not (isinstance(value, int) and low <= value <= high):  # one test for the usual value: each message makes it
        if isinstance(value, int) or not is_whole(value, low, high):
            kind = "" if hasattr(value, "__index__") else "a whole number in "
            raise EncodeError(f"{name} = {value!r}: expected {kind}{low}..{high}", name)
        if message is not None:
            object.__setattr__(message, name, index(value))


def check_list(name: str, values: object, expected: str) -> None:
    """Raise EncodeError unless `values` has a length and an order, and is not text or bytes, whose items are numbers
    too. An iterator has no length: it may be endless."""
    if not isinstance(values, (tuple, list)) and (isinstance(values, _NOT_LISTS) or not hasattr(values, "__len__")):
        raise EncodeError(f"{name} = {shown(values)}: expected a list of {expected}", name)


def check_registers(values: object) -> None:
    """Raise EncodeError unless `values` may be registers; the numbers are checked when they are encoded."""
    check_list("registers", values, "whole numbers in 0..65535")


def check_groups(name: str, groups: Any, size: int, expected: str) -> list[tuple[Any, ...]]:
    """Return the groups as tuples. Raises EncodeError unless each has so many values."""
    try:
        rows = list(map(tuple, groups))
    except TypeError:  # something in it is no group
        rows = [()]
    if any(len(row) != size for row in rows):
        raise EncodeError(f"{name} = {shown(groups)}: expected a list of {expected}", name)
    return rows


def check_bytes(name: str, data: Any) -> bytes:
    """Return the data as bytes, so that a message with them does not change. Raises EncodeError for anything else."""
    if not isinstance(data, (bytes, bytearray, memoryview)):
        raise EncodeError(f"{name} = {shown(data)}: expected bytes", name)
    return bytes(data)


def checked(pdu: bytes) -> bytes:
    """Return the PDU. Raises EncodeError unless it is 1 to 253 bytes."""
    if not (isinstance(pdu, bytes) and 1 <= len(pdu) <= PDU_LIMIT):
        if not isinstance(pdu, bytes):
            raise EncodeError(f"a PDU is bytes, and this is {type(pdu).__name__}", "pdu")
        check_pdu(pdu)
    return pdu


def encoded(response: object) -> bytes:
    """Return the PDU of a response. Raises EncodeError for anything else: a text and a request have `encode` too."""
    if not isinstance(response, Response):
        expected = "a response, such as ReadHoldingRegistersResponse((1,))"
        raise EncodeError(f"{shown(response)}: expected {expected}", "response")
    return checked(response.encode())
