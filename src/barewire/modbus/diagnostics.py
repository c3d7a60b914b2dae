"""The state of the server itself: function code 07. Serial lines only, says the standard; many answer it on TCP too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from barewire.codecs import Field, Layout
from barewire.modbus.message import Request, Response, check_range


@dataclass(frozen=True, slots=True)
class ReadExceptionStatusResponse(Response):
    """Eight bits whose meaning is the device's own.                                       [MB-APP 6.7]

        07 | status

    >>> ReadExceptionStatusResponse(0x6D).encode().hex(" ")
    '07 6d'
    """

    status: int

    name: ClassVar[str] = "Read Exception Status"
    function_code: ClassVar[int] = 0x07
    layout: ClassVar[Layout] = Layout(">BB", "function_code", "status")

    def __post_init__(self) -> None:
        check_range("status", self.status, 0, 0xFF)

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """The bits, 7 to 0."""
        found = cls.layout.fields(pdu)
        if len(found) > 1:
            found[1] = found[1]._replace(meaning=f"bits 7..0: {pdu[1]:08b}")
        return found


@dataclass(frozen=True, slots=True)
class ReadExceptionStatus(Request[ReadExceptionStatusResponse]):
    """Read the eight exception status bits.                                               [MB-APP 6.7]

        07

    >>> ReadExceptionStatus().encode().hex(" ")
    '07'
    """

    name: ClassVar[str] = "Read Exception Status"
    function_code: ClassVar[int] = 0x07
    layout: ClassVar[Layout] = Layout(">B", "function_code")
    response: ClassVar[type[Response]] = ReadExceptionStatusResponse
