"""An object dictionary behind Modbus: function code 2B/0D, CANopen General Reference. **Experimental.**

The standard leaves the contents to CAN in Automation [MB-APP 6.20], and CiA 309-2 is not public. The two layouts here
are taken from manuals of devices, which differ by one byte, and were not checked against CiA 309-2:

    dialect      layout behind 2B 0D                                                                  known from
    cia309       control 1 | 00 | node 1 | index 2 | sub-index 1 | start 2 | count 2 | data ...       Nanotec
    schneider    control 1      | node 1 | index 2 | sub-index 1 | start 2 | count 2 | data ...       Schneider

Control is 00 to read and 01 to write. Its other bits are not supported, and a message that has one set is refused: the
public manuals define three of them (counted from the most significant: 0, the value continues in further messages; 1,
control has a second byte; 2, a counter byte follows), but not those for a network number and for encoded data, on which
the position of the node depends. Numbers of the header are big-endian. **The data are bytes of the object dictionary
and stay bytes here**: a read returns them little-endian, as in CANopen; for writing no manual defines the order.

The bytes show the dialect: where `cia309` has the 00, `schneider` has the node, and no node has the number 0.

If the object dictionary refuses the access, the exception response carries the SDO abort code. It is the only exception
response of more than two bytes:

    AB | FF | length 2 | MEI type 0D | EC | SDO abort code 4
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

from barewire.codecs import Field, Layout
from barewire.errors import DecodeError, EncodeError
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.messages.base import EXCEPTION_BIT, Request, Response, check_bytes, check_range

MEI_CANOPEN = 0x0D
EXTENDED = 0xFF
SDO_ABORT = 0xEC


class SdoAborted(ModbusException):
    """The object dictionary behind the server refused the access with the SDO abort code `abort_code`.

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
    """The object dictionary refuses the access. Experimental.

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
        return self.layout.pack(self.function_code, EXTENDED, 6, MEI_CANOPEN, SDO_ABORT, self.abort_code)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Decode a PDU, whose constant fields must be as drawn."""
        cls.check_function(pdu)
        _, *fixed, abort_code = cls.layout.unpack(pdu)
        expected = (("exception_code", 1, EXTENDED), ("length", 2, 6), ("mei_type", 4, MEI_CANOPEN), ("error", 5, 0xEC))
        for (name, at, right), value in zip(expected, fixed):
            if value != right:
                raise DecodeError("value", pdu, at, f"{name} = {value:02X}h: expected {right:02X}h")
        return cls(abort_code)

    @classmethod
    def measure(cls, pdu: bytes) -> int | None:
        """Return the length from the length field, once that has arrived."""
        return 4 + int.from_bytes(pdu[2:4], "big") if len(pdu) >= 4 else 4

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with the constants in words."""
        words = {
            "exception_code": "extended: the error follows",
            "length": "bytes that follow",
            "error": "SDO abort",
        }
        fields = [field._replace(meaning=words.get(field.name, field.meaning)) for field in cls.layout.fields(pdu)]
        return [
            field._replace(meaning=f"{field.value:08X}h of CANopen") if field.name == "abort_code" else field
            for field in fields
        ]


ReferenceDialect = Literal["cia309", "schneider"]

READ, WRITE = 0x00, 0x01

_HEAD = ("node", "index", "sub_index", "start", "count")
_LAYOUTS: dict[str, Layout] = {
    "cia309": Layout(">BBBBBHBHH", "function_code", "mei_type", "control", "reserved", *_HEAD, tail="data"),
    "schneider": Layout(">BBBBHBHH", "function_code", "mei_type", "control", *_HEAD, tail="data"),
}


def _dialect(pdu: bytes) -> ReferenceDialect:
    """Return the dialect of these bytes: no node has the number 0."""
    return "cia309" if len(pdu) < 4 or pdu[3] == 0 else "schneider"


def _check(message: CanopenReference | CanopenReferenceResponse) -> None:
    if message.dialect not in list(_LAYOUTS):  # it may have no hash
        raise EncodeError(f"dialect {message.dialect!r}: expected one of {', '.join(_LAYOUTS)}", "dialect")
    check_range("node", message.node, 1, 127)
    check_range("index", message.index, 0, 0xFFFF)
    check_range("sub_index", message.sub_index, 0, 0xFF)
    check_range("start", message.start, 0, 0xFFFF)
    check_range("count", message.count, 0, 0xFFFF)
    size = _LAYOUTS[message.dialect].size
    object.__setattr__(message, "data", check_bytes("data", message.data))
    check_range("data length", len(message.data), 0, 253 - size)


def _encode(message: CanopenReference | CanopenReferenceResponse) -> bytes:
    place = (message.node, message.index, message.sub_index, message.start, message.count)
    control = (WRITE if message.write else READ, *([0] if message.dialect == "cia309" else []))
    layout = _LAYOUTS[message.dialect]
    return layout.pack(message.function_code, MEI_CANOPEN, *control, *place, tail=message.data)


def _decode(pdu: bytes, *, has_data: bool) -> tuple[Any, ...]:
    """Return the fields of either message, in their order. `has_data`: writes have data (requests), or reads
    (responses)."""
    dialect = _dialect(pdu)
    _, mei_type, control, *rest, data = _LAYOUTS[dialect].unpack(pdu)
    if mei_type != MEI_CANOPEN:
        raise DecodeError("mismatch", pdu, 1, f"MEI type {mei_type:02X}h where 0Dh was expected")
    if control not in (READ, WRITE):
        raise DecodeError("value", pdu, 2, f"control {control:02X}h: expected 00h (read) or 01h (write)")
    node, index, sub_index, start, count = rest[-5:]
    expected = count if (control == WRITE) == has_data else 0
    if len(data) != expected:
        at = _LAYOUTS[dialect].size - 2
        raise DecodeError("length", pdu, at, f"count {count}, but {len(data)} bytes of data where {expected} belong")
    return node, index, sub_index, start, count, bytes(data), control == WRITE, dialect


def _measure(pdu: bytes, *, has_data: bool) -> int:
    if len(pdu) < 4:
        return 4
    layout = _LAYOUTS[_dialect(pdu)]
    if (pdu[2] & WRITE == WRITE) != has_data or len(pdu) < layout.size:
        return layout.size
    return layout.size + int.from_bytes(pdu[layout.size - 2 : layout.size], "big")


def _fields(pdu: bytes) -> list[Field]:
    dialect = _dialect(pdu)
    controls = {READ: "read", WRITE: "write"}
    words = {"control": f"{controls.get(pdu[2], 'not supported')}; dialect {dialect}"} if len(pdu) > 2 else {}
    fields = [field._replace(meaning=words.get(field.name, "")) for field in _LAYOUTS[dialect].fields(pdu)]
    return [
        field._replace(meaning=f"object {field.value:04X}h") if field.name == "index" else field for field in fields
    ]


@dataclass(frozen=True, slots=True)
class CanopenReferenceResponse(Response):
    """The header repeated, with the bytes that were read. Experimental.                   [MB-APP 6.20]

        2B | 0D | control | (00) | node | index 2 | sub-index | start 2 | count 2 | data, when reading

    >>> answer = CanopenReferenceResponse.decode(bytes.fromhex("2B 0D 00 1F 1005 00 0000 0004 80000000"))
    >>> answer.dialect, answer.data
    ('schneider', b'\\x80\\x00\\x00\\x00')
    """

    node: int
    index: int
    sub_index: int = 0
    start: int = 0
    count: int = 0
    data: bytes = b""
    write: bool = False
    dialect: ReferenceDialect = "cia309"

    name: ClassVar[str] = "CANopen General Reference"
    function_code: ClassVar[int] = 0x2B
    layout: ClassVar[Layout] = _LAYOUTS["cia309"]

    def __post_init__(self) -> None:
        _check(self)
        if len(self.data) != (0 if self.write else self.count):
            raise EncodeError(f"{len(self.data)} bytes of data for a count of {self.count}", "count")

    def encode(self) -> bytes:
        return _encode(self)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Decode a PDU of either dialect."""
        cls.check_function(pdu)
        return cls.make(pdu, *_decode(pdu, has_data=False))

    @classmethod
    def measure(cls, pdu: bytes) -> int | None:
        """Return the length: the response to a read carries `count` bytes."""
        return _measure(pdu, has_data=False)

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with the dialect in words."""
        return _fields(pdu)


@dataclass(frozen=True, slots=True)
class CanopenReference(Request[CanopenReferenceResponse]):
    r"""Read up to `count` bytes of an object, or write `data`. Experimental.              [MB-APP 6.20]

        2B | 0D | control | (00) | node | index 2 | sub-index | start 2 | count 2 | data, when writing

    >>> CanopenReference.read(node=5, index=0x6041, count=2).encode().hex(" ")
    '2b 0d 00 00 05 60 41 00 00 00 00 02'
    >>> CanopenReference.read(node=31, index=0x1005, count=8, dialect="schneider").encode().hex(" ")
    '2b 0d 00 1f 10 05 00 00 00 00 08'
    >>> CanopenReference.write_to(5, 0x6040, 0, b"\x06\0").count
    2
    """

    node: int
    index: int
    sub_index: int = 0
    start: int = 0
    count: int = 0
    data: bytes = b""
    write: bool = False
    dialect: ReferenceDialect = "cia309"

    name: ClassVar[str] = "CANopen General Reference"
    function_code: ClassVar[int] = 0x2B
    mei_type: ClassVar[int | None] = MEI_CANOPEN
    layout: ClassVar[Layout] = _LAYOUTS["cia309"]
    response: ClassVar[type[Response]] = CanopenReferenceResponse
    writes: ClassVar[bool] = True  # a single class reads and writes, so it is never repeated automatically

    def __post_init__(self) -> None:
        _check(self)
        if len(self.data) != (self.count if self.write else 0):
            raise EncodeError(f"{len(self.data)} bytes of data for a count of {self.count}", "count")

    @classmethod
    def read(
        cls, node: int, index: int, sub_index: int = 0, *, count: int, dialect: ReferenceDialect = "cia309"
    ) -> Self:
        """Make the request for at most `count` bytes of an object."""
        return cls(node, index, sub_index, count=count, dialect=dialect)

    @classmethod
    def write_to(
        cls, node: int, index: int, sub_index: int, data: bytes, *, dialect: ReferenceDialect = "cia309"
    ) -> Self:
        """Make the request to write `data`, in the byte order of the device."""
        data = check_bytes("data", data)
        return cls(node, index, sub_index, count=len(data), data=data, write=True, dialect=dialect)

    def encode(self) -> bytes:
        return _encode(self)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Decode a PDU of either dialect."""
        cls.check_function(pdu)
        return cls.make(pdu, *_decode(pdu, has_data=True))

    @classmethod
    def measure(cls, pdu: bytes) -> int | None:
        """Return the length: a request to write carries `count` bytes."""
        return _measure(pdu, has_data=True)

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with the dialect in words."""
        return _fields(pdu)

    def read_response(self, pdu: bytes) -> CanopenReferenceResponse:
        """Decode the response. Raises SdoAborted for an SDO abort of the object dictionary."""
        if pdu[:2] == ExtendedExceptionResponse.BEGINNING:
            raise SdoAborted(ExtendedExceptionResponse.decode(pdu).abort_code)
        return Request.read_response(self, pdu)

    def fit(self, response: Any, pdu: bytes) -> Any:
        """Check that the response has the object, node and dialect of the request, and at most `count` bytes."""
        for name in ("write", "dialect", "node", "index", "sub_index", "start"):
            if getattr(response, name) != getattr(self, name):
                self.refuse(pdu, name, getattr(self, name), getattr(response, name))
        if not self.write and response.count > self.count:
            self.refuse(pdu, "count", self.count, response.count)
        return response
