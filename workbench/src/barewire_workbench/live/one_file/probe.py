"""The probe of a bus: Return Query Data, whose response repeats the request.                  [MB-APP 6.8.1]"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from barewire.codecs import Layout
from barewire.modbus.messages.base import Request, Response, check_range

RETURN_QUERY_DATA = 0x00


@dataclass(frozen=True, slots=True)
class DiagnosticsResponse(Response):
    """The request repeated.                                                                [MB-APP 6.8]

    08 | sub-function 2 | data 2
    """

    sub_function: int
    data: bytes

    name: ClassVar[str] = "Diagnostics"
    function_code: ClassVar[int] = 0x08
    layout: ClassVar[Layout] = Layout(">BH", "function_code", "sub_function", tail="data")

    @classmethod
    def measure(cls, pdu: bytes) -> int | None:
        """Return the length with two bytes of data."""
        return cls.layout.size + 2


@dataclass(frozen=True, slots=True)
class Diagnostics(Request[DiagnosticsResponse]):
    """Ask a unit to repeat two bytes, which proves that it has sent everything that was due before.

        08 | sub-function 2 | data 2

    >>> Diagnostics(RETURN_QUERY_DATA, bytes.fromhex("A537")).encode().hex(" ")
    '08 00 00 a5 37'
    """

    sub_function: int
    data: bytes

    name: ClassVar[str] = "Diagnostics"
    function_code: ClassVar[int] = 0x08
    layout: ClassVar[Layout] = DiagnosticsResponse.layout
    response: ClassVar[type[Response]] = DiagnosticsResponse

    def __post_init__(self) -> None:
        check_range("sub_function", self.sub_function, 0, 0xFFFF, self)

    def encode(self) -> bytes:
        return self.layout.pack(self.function_code, self.sub_function, tail=self.data)
