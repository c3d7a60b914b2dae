"""What a message is: a frozen value that knows its own bytes, and a request that can read its own answer.

    PDU  | function code | data ... |                       [MB-APP 4.1]

Each message class is the page that teaches it: a drawing, an example that runs, a `layout`. The layout packs,
unpacks, explains and measures, so nothing here is written twice. A client needs no method per function: it asks,
and `request.read_response(pdu)` is the only way to a value. A response is a value only if it fits its request.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Self, TypeVar

from barewire.codecs import Field, Layout
from barewire.errors import DecodeError, EncodeError
from barewire.modbus.adu import check_pdu
from barewire.modbus.exceptions import ILLEGAL_DATA_VALUE, ModbusException, exception_name

R = TypeVar("R", bound="Response")

EXCEPTION_BIT = 0x80


class Message:
    """Common to requests and responses. `function_code` and the names of `layout` are the standard's."""

    __slots__ = ()

    name: ClassVar[str]
    """The standard's name of the function."""

    function_code: ClassVar[int]
    layout: ClassVar[Layout]

    def encode(self) -> bytes:
        """The PDU. Everything that could be wrong with it was checked when the message was made."""
        return self.layout.pack_of(self)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """The PDU as a message. DecodeError says where and why it is none: a function code of its own included."""
        cls.check_function(pdu)
        return cls.make(pdu, *cls.layout.unpack(pdu)[1:])

    @classmethod
    def make(cls, pdu: bytes, *values: Any) -> Self:
        """The message with these values; what it would refuse to say (EncodeError) it also refuses to read."""
        try:
            return cls(*values)
        except EncodeError as error:
            # How many registers or bits there are is told by the byte count, so that is the field to point at.
            names = (error.field, cls.layout.count)
            places = [field.offset for field in cls.layout.fields(pdu) if field.name in names]
            missing = cls.layout.size if error.field == cls.layout.tail else 0  # a tail of no bytes is no field
            raise DecodeError("value", pdu, places[0] if places else missing, str(error)) from None

    @classmethod
    def check_function(cls, pdu: bytes) -> None:
        """DecodeError unless the PDU begins with this message's function code."""
        if not pdu:
            raise DecodeError("short", pdu, 0, "an empty PDU has no function code")
        if pdu[0] != cls.function_code:
            text = f"function {pdu[0]:02X} where {cls.function_code:02X} ({cls.name}) was expected"
            raise DecodeError("mismatch", pdu, 0, text)

    @classmethod
    def measure(cls, pdu: bytes) -> int | None:
        """How many bytes of PDU to wait for, told from the first ones; None if nobody can know."""
        return cls.layout.measure(pdu)

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Every field with its place, for `explain`. Works on damaged messages as far as the bytes go."""
        return cls.layout.fields(pdu)


class Request(Message, Generic[R]):
    """What a client says. `response` is the class of its answer."""

    __slots__ = ()

    response: ClassVar[type[Response]]
    mei_type: ClassVar[int | None] = None
    """The second byte that tells the functions of code 2B apart [MB-APP 6.19]."""
    writes: ClassVar[bool] = False
    """Whether carrying it out changes something: then a lost answer leaves the outcome unknown."""

    def read_response(self, pdu: bytes) -> R:
        """The answer as a value, if it is one: right function, right byte count, right echo.

        Raises ModbusException when the server declined, DecodeError("mismatch") when it is a well-formed answer
        to some other question, DecodeError otherwise when it is none at all.
        """
        if pdu and pdu[0] == self.function_code | EXCEPTION_BIT:
            raise ModbusException(ExceptionResponse.decode(pdu).exception_code, self.function_code)
        # `response` is a class attribute, and those cannot be generic: so it is said here what it is.
        answer: R = self.fit(self.response.decode(pdu), pdu)
        return answer

    def without_answer(self, *, listens_only: bool = False) -> R | None:
        """What stands for the response where the standard has the unit be silent; None where it has to answer.

        `listens_only`: the unit was told to.
        """
        return None

    def fit(self, response: Any, pdu: bytes) -> Any:
        """The response, if it answers this request: DecodeError("mismatch") otherwise. Here: an echo must be one."""
        for field in self.layout.fields(self.encode()):
            if hasattr(response, field.name) and getattr(response, field.name) != getattr(self, field.name, None):
                self.refuse(pdu, field.name, getattr(self, field.name, None), getattr(response, field.name))
        return response

    @classmethod
    def declines(cls, error: DecodeError) -> int:
        """The exception code for a request of this function that cannot be read: 03, where no figure says otherwise."""
        return ILLEGAL_DATA_VALUE

    def refuse(self, pdu: bytes, field: str, asked: object, answered: object) -> None:
        """Raise DecodeError("mismatch") for a field of the answer that does not fit what was asked."""
        places = [found.offset for found in self.response.fields(pdu) if found.name == field]
        text = f"{field} {answered} where {asked} was asked ({self.name})"
        raise DecodeError("mismatch", pdu, places[0] if places else 0, text)


class Response(Message):
    """What a server answers."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class ExceptionResponse(Response):
    """The server declines.                                                                  [MB-APP 7]

        83 | exception code

    >>> ExceptionResponse(0x83, 2).encode().hex(" ")
    '83 02'
    """

    function_code: int  # type: ignore[misc]  # here it is a value: the request's function code + 80h
    exception_code: int

    name: ClassVar[str] = "Exception"
    layout: ClassVar[Layout] = Layout(">BB", "function_code", "exception_code")

    def __post_init__(self) -> None:
        check_range("function_code", self.function_code, EXCEPTION_BIT, 0xFF)
        check_range("exception_code", self.exception_code, 0, 0xFF)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Any function code with bit 7 set."""
        function_code, exception_code = cls.layout.unpack(pdu)
        if not function_code & EXCEPTION_BIT:
            raise DecodeError("mismatch", pdu, 0, f"function {function_code:02X} is no exception: bit 7 is not set")
        return cls(function_code, exception_code)

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """The code with its name."""
        found = cls.layout.fields(pdu)
        if len(found) > 1:
            found[1] = found[1]._replace(meaning=exception_name(pdu[1]))
        return found


def check_range(name: str, value: int, low: int, high: int) -> None:
    """EncodeError unless `value` is a whole number in low..high: the limits of a field."""
    if not (isinstance(value, int) and low <= value <= high):
        raise EncodeError(f"{name} = {value!r}: expected {low}..{high}", name)


def checked(pdu: bytes) -> bytes:
    """The PDU, if it is one: bytes, and not too many."""
    if not isinstance(pdu, bytes):
        raise EncodeError(f"a PDU is bytes, and this is {type(pdu).__name__}", "pdu")
    check_pdu(pdu)
    return pdu
