"""The exception response, with which a server declines a request of any function code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from barewire.codecs import Field, Layout
from barewire.errors import DecodeError
from barewire.modbus.exceptions import exception_name
from barewire.modbus.messages.base import EXCEPTION_BIT, EXCEPTION_LAYOUT, Response, check_range


@dataclass(frozen=True, slots=True)
class ExceptionResponse(Response):
    """The server declines a request.                                                        [MB-APP 7]

        83 | exception code

    >>> ExceptionResponse(0x83, 2).encode().hex(" ")
    '83 02'
    """

    function_code: int  # type: ignore[misc]  # here it is a value: the request's function code + 80h
    exception_code: int

    name: ClassVar[str] = "Exception"
    layout: ClassVar[Layout] = EXCEPTION_LAYOUT

    def __post_init__(self) -> None:
        check_range("function_code", self.function_code, EXCEPTION_BIT, 0xFF)
        check_range("exception_code", self.exception_code, 0, 0xFF)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Decode a PDU with any function code that has bit 7 set."""
        function_code, exception_code = cls.layout.unpack(pdu)
        if not function_code & EXCEPTION_BIT:
            raise DecodeError("mismatch", pdu, 0, f"function {function_code:02X} is not an exception: bit 7 is not set")
        return cls(function_code, exception_code)

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with the name of the exception code."""
        fields = cls.layout.fields(pdu)
        if len(fields) > 1:
            fields[1] = fields[1]._replace(meaning=exception_name(pdu[1]))
        return fields
