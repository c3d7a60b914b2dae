"""The exception that an object dictionary behind Modbus answers with: an SDO abort. **Experimental**, as all of 2B/0D.

    AB | FF | length 2 | MEI type 0D | EC | SDO abort code 4

It is the one exception response with more than two bytes, and it says its length itself. See `canopen_reference`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from barewire.codecs import Field, Layout
from barewire.errors import DecodeError
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.messages.base import EXCEPTION_BIT, Response, check_range

MEI_CANOPEN = 0x0D
EXTENDED = 0xFF
SDO_ABORT = 0xEC


class SdoAborted(ModbusException):
    """The object dictionary behind the server refused: `abort_code` is CANopen's.

    >>> str(SdoAborted(0x06020000))
    'SDO abort 06020000h to function 2B'
    """

    def __init__(self, abort_code: int) -> None:
        super().__init__(EXTENDED, 0x2B)
        self.abort_code = abort_code

    def __str__(self) -> str:
        return f"SDO abort {self.abort_code:08X}h to function 2B"


@dataclass(frozen=True, slots=True)
class ExtendedExceptionResponse(Response):
    """The object dictionary refuses. Experimental.

        AB | FF | length 2 | MEI type 0D | EC | SDO abort code 4

    >>> ExtendedExceptionResponse(0x06020000).encode().hex(" ")
    'ab ff 00 06 0d ec 06 02 00 00'
    """

    abort_code: int

    BEGINNING: ClassVar[bytes] = bytes([0x2B | EXCEPTION_BIT, EXTENDED])
    name: ClassVar[str] = "CANopen General Reference"
    function_code: ClassVar[int] = 0x2B | EXCEPTION_BIT
    layout: ClassVar[Layout] = Layout(
        ">BBHBBI", "function_code", "exception_code", "length", "mei_type", "error", "abort_code"
    )

    def __post_init__(self) -> None:
        check_range("abort_code", self.abort_code, 0, 0xFFFFFFFF)

    def encode(self) -> bytes:
        """The PDU."""
        return self.layout.pack(self.function_code, EXTENDED, 6, MEI_CANOPEN, SDO_ABORT, self.abort_code)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """The PDU as a message; each of its fixed fields is as drawn."""
        cls.check_function(pdu)
        _, *fixed, abort_code = cls.layout.unpack(pdu)
        expected = (("exception_code", 1, EXTENDED), ("length", 2, 6), ("mei_type", 4, MEI_CANOPEN), ("error", 5, 0xEC))
        for (name, at, right), value in zip(expected, fixed):
            if value != right:
                raise DecodeError("value", pdu, at, f"{name} = {value:02X}h: expected {right:02X}h")
        return cls(abort_code)

    @classmethod
    def measure(cls, pdu: bytes) -> int | None:
        """The length tells it, once it is in."""
        return 4 + int.from_bytes(pdu[2:4], "big") if len(pdu) >= 4 else 4

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """The constants in words."""
        words = {
            "exception_code": "extended: the error follows",
            "length": "so many bytes follow",
            "error": "SDO abort",
        }
        found = [field._replace(meaning=words.get(field.name, field.meaning)) for field in cls.layout.fields(pdu)]
        return [
            field._replace(meaning=f"{field.value:08X}h of CANopen") if field.name == "abort_code" else field
            for field in found
        ]
