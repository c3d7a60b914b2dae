"""Requests and responses as their bytes, of any function code: what a gateway passes on, known to barewire or not.

    RawRequest    | function code | anything ... |
    RawResponse   | function code | anything ... |                                             [MB-APP 4.1]

A request whose function is known and whose bytes are valid still decides which response fits it, so that a client
excludes late and wrong responses as for every other request. Of any other request only the function code is compared.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from barewire.codecs import Layout
from barewire.errors import DecodeError, EncodeError
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.messages.base import EXCEPTION_BIT, Request, Response, checked
from barewire.modbus.messages.registry import AnyRequest, request_class


@dataclass(frozen=True, slots=True)
class RawResponse(Response):
    """The bytes of a response.

    >>> RawResponse(bytes.fromhex("41 01 02")).function_code
    65
    """

    pdu: bytes

    name: ClassVar[str] = "Response"
    layout: ClassVar[Layout] = Layout(">B", "function_code", tail="data")

    def __post_init__(self) -> None:
        checked(self.pdu)

    @property
    def function_code(self) -> int:  # type: ignore[override]  # here it is a value
        """The first byte."""
        return self.pdu[0]

    def encode(self) -> bytes:
        return self.pdu

    @classmethod
    def decode(cls, pdu: bytes) -> RawResponse:
        """Take a PDU as it is. Raises EncodeError unless it has 1 to 253 bytes."""
        return cls(pdu)


@dataclass(frozen=True, slots=True)
class RawRequest(Request[RawResponse]):
    """A request of any function code, as its bytes.

    >>> request = RawRequest(bytes.fromhex("03 00 6B 00 01"))
    >>> request.read_response(bytes.fromhex("03 02 02 2B")).pdu.hex(" ")
    '03 02 02 2b'
    >>> request.writes, RawRequest(b"\\x41\\x07").writes
    (False, True)

    Unless the function is known, `writes` is True: the request may change something, so it is never repeated by
    itself. Raises EncodeError for a PDU that does not have 1 to 253 bytes, or whose function code has bit 7 set. 00 is
    not valid [MB-APP 4.1], but a gateway passes it on, and the unit declines it.
    """

    pdu: bytes
    known: AnyRequest | None = field(init=False, compare=False, repr=False)
    """The same request as a message; None for an unknown function, and for bytes that are not valid."""

    layout: ClassVar[Layout] = RawResponse.layout
    response: ClassVar[type[Response]] = RawResponse

    def __post_init__(self) -> None:
        checked(self.pdu)
        if self.pdu[0] & EXCEPTION_BIT:
            raise EncodeError(f"function code {self.pdu[0]:02X}h: a request has 00h..7Fh", "pdu")
        message = request_class(self.pdu)
        known: AnyRequest | None = None
        if message is not None:
            try:
                known = message.decode(self.pdu)
            except DecodeError:
                known = None  # some devices have longer reads, or a layout of their own
        object.__setattr__(self, "known", known)

    @property
    def function_code(self) -> int:  # type: ignore[override]  # here it is a value
        """The first byte."""
        return self.pdu[0]

    @property
    def is_malformed(self) -> bool:
        """Whether the function is known and the bytes are not valid: which addresses they touch is not known."""
        return self.known is None and request_class(self.pdu) is not None

    @property
    def name(self) -> str:  # type: ignore[override]
        """The name of a known function, or its number."""
        return f"function {self.pdu[0]:02X}" if self.known is None else self.known.name

    @property
    def writes(self) -> bool:  # type: ignore[override]
        """Whether the request changes something, or may do so."""
        return True if self.known is None else self.known.writes

    def encode(self) -> bytes:
        return self.pdu

    @classmethod
    def decode(cls, pdu: bytes) -> RawRequest:
        """Take a PDU as it is. Raises EncodeError unless it has 1 to 253 bytes."""
        return cls(pdu)

    def read_response(self, pdu: bytes) -> RawResponse:
        """Return the response as its bytes, if it answers this request.

        Raises ModbusException, whose `pdu` is the whole response, for an exception response, and DecodeError for a
        response to another request.
        """
        code = self.pdu[0]
        if pdu and pdu[0] == code | EXCEPTION_BIT:
            try:
                if self.known is not None:
                    self.known.read_response(pdu)
                if len(pdu) < 2:
                    raise DecodeError("short", pdu, 1, "an exception response without an exception code")
                raise ModbusException(pdu[1], code)
            except ModbusException as declined:
                declined.pdu = pdu
                raise
        if self.known is not None:
            self.known.read_response(pdu)
        elif not pdu or pdu[0] != code:
            raise DecodeError("mismatch", pdu, 0, f"function {pdu[:1].hex().upper()} where {code:02X} was expected")
        return RawResponse(pdu)

    def without_answer(self, *, listens_only: bool = False) -> Any:
        """Return a value in place of the response if the standard demands silence of the unit."""
        return None if self.known is None else self.known.without_answer(listens_only=listens_only)
