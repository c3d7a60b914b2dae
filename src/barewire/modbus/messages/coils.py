"""Coils and discrete inputs: function codes 01, 02, 05 and 0F.

On the wire bits are packed eight to a byte, the first in the lowest bit of the first byte; the last byte is padded with
zeros [MB-APP 6.1]. Coils can be written, discrete inputs cannot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from barewire.codecs import Field, Layout, pack_bits, unpack_bits
from barewire.errors import DecodeError, EncodeError
from barewire.modbus.messages.base import Message, Request, Response, check_list, check_range

READ_COILS_LIMIT = 2000
WRITE_COILS_LIMIT = 1968
ON, OFF = 0xFF00, 0x0000
_BITS = frozenset((False, True))


def _packed(bits: Sequence[bool | int]) -> bytes:
    """Pack bits into bytes. Raises EncodeError for a value that is not a bit: 2 would otherwise pass for `on`."""
    try:
        are_bits = _BITS.issuperset(bits)
    except TypeError:  # an item that has no hash, such as a list
        are_bits = False
    if not are_bits:
        place = next(place for place, bit in enumerate(bits) if not _is_bit(bit))
        raise EncodeError(f"bit {place} of {len(bits)}: {bits[place]!r} is not True or False", "bits")
    return pack_bits(bits)


def _is_bit(value: object) -> bool:
    try:
        return value in _BITS
    except TypeError:
        return False


def _bit_fields(fields: list[Field], name: str) -> list[Field]:
    """Replace the packed tail by one field for each byte, with its bits in the order of addresses."""
    tail = fields[-1] if fields and isinstance(fields[-1].value, str) else None
    if tail is None:
        return fields
    rows = []
    for place, byte in enumerate(bytes.fromhex(str(tail.value))):
        bits = " ".join(str(byte >> bit & 1) for bit in range(8))
        meaning = f"{name} {8 * place}..{8 * place + 7} of this answer or request, first to last: {bits}"
        rows.append(Field(tail.offset + place, 1, f"{name}s", byte, meaning))
    return [*fields[:-1], *rows]


@dataclass(frozen=True, slots=True)
class ReadCoilsResponse(Response):
    """The coils that were read.                                                           [MB-APP 6.1]

        01 | byte count | packed coils ...

    Decoded without its request, it has whole bytes of coils; `ReadCoils.read_response` returns as many as it asked for.

    >>> ReadCoilsResponse((True, False, True)).encode().hex(" ")
    '01 01 05'
    """

    bits: tuple[bool, ...]

    name: ClassVar[str] = "Read Coils"
    function_code: ClassVar[int] = 0x01
    layout: ClassVar[Layout] = Layout(">BB", "function_code", "byte_count", tail="coils", count="byte_count")

    def __post_init__(self) -> None:
        check_list("bits", self.bits, "True and False")
        check_range("quantity", len(self.bits), 1, READ_COILS_LIMIT)

    def encode(self) -> bytes:
        data = _packed(self.bits)
        return self.layout.pack(self.function_code, len(data), tail=data)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Decode a PDU: eight bits for each byte."""
        cls.check_function(pdu)
        return cls.make(pdu, unpack_bits(cls.layout.unpack(pdu)[-1]))

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with each bit."""
        return _bit_fields(cls.layout.fields(pdu), str(cls.layout.tail)[:-1])


@dataclass(frozen=True, slots=True)
class ReadDiscreteInputsResponse(ReadCoilsResponse):
    """The discrete inputs that were read.                                                 [MB-APP 6.2]

    02 | byte count | packed inputs ...
    """

    name: ClassVar[str] = "Read Discrete Inputs"
    function_code: ClassVar[int] = 0x02
    layout: ClassVar[Layout] = Layout(">BB", "function_code", "byte_count", tail="inputs", count="byte_count")


@dataclass(frozen=True, slots=True)
class ReadCoils(Request[ReadCoilsResponse]):
    """Read 1 to 2000 coils in a row.                                                      [MB-APP 6.1]

        01 | address 2 | quantity 2

    >>> ReadCoils(address=19, quantity=19).encode().hex(" ")
    '01 00 13 00 13'
    """

    address: int
    quantity: int

    name: ClassVar[str] = "Read Coils"
    function_code: ClassVar[int] = 0x01
    layout: ClassVar[Layout] = Layout(">BHH", "function_code", "address", "quantity")
    response: ClassVar[type[Response]] = ReadCoilsResponse

    def __post_init__(self) -> None:
        check_range("address", self.address, 0, 0xFFFF, self)
        check_range("quantity", self.quantity, 1, READ_COILS_LIMIT, self)

    def fit(self, response: Any, pdu: bytes) -> Any:
        """Check that the quantity fills the bytes of the response, and cut its bits to the quantity."""
        asked = (self.quantity + 7) // 8
        if len(response.bits) != 8 * asked:
            self.refuse(pdu, "byte_count", asked, len(response.bits) // 8)
        return type(response)(response.bits[: self.quantity])


@dataclass(frozen=True, slots=True)
class ReadDiscreteInputs(ReadCoils):
    """Read 1 to 2000 discrete inputs in a row.                                            [MB-APP 6.2]

        02 | address 2 | quantity 2

    >>> ReadDiscreteInputs(address=196, quantity=22).encode().hex(" ")
    '02 00 c4 00 16'
    """

    name: ClassVar[str] = "Read Discrete Inputs"
    function_code: ClassVar[int] = 0x02
    response: ClassVar[type[Response]] = ReadDiscreteInputsResponse


@dataclass(frozen=True, slots=True)
class _CoilValue(Message):
    """What request and response of Write Single Coil have in common: all of it."""

    address: int
    value: bool

    name: ClassVar[str] = "Write Single Coil"
    function_code: ClassVar[int] = 0x05
    layout: ClassVar[Layout] = Layout(">BHH", "function_code", "address", "value")

    def __post_init__(self) -> None:
        check_range("address", self.address, 0, 0xFFFF, self)
        if not _is_bit(self.value):
            raise EncodeError(f"value = {self.value!r}: expected True or False", "value")

    def encode(self) -> bytes:
        return self.layout.pack(self.function_code, self.address, ON if self.value else OFF)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Decode a PDU: FF00h is on, 0000h is off. Raises DecodeError("value") for any other value."""
        cls.check_function(pdu)
        _, address, value = cls.layout.unpack(pdu)
        if value not in (ON, OFF):
            raise DecodeError("value", pdu, 3, f"coil value {value:04X}h: expected FF00h (on) or 0000h (off)")
        return cls(address, value == ON)

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with the value in words."""
        fields = cls.layout.fields(pdu)
        if len(fields) > 2:
            word = {ON: "on", OFF: "off"}.get(int(str(fields[2].value)), "neither on (FF00h) nor off (0000h)")
            fields[2] = fields[2]._replace(meaning=word)
        return fields


@dataclass(frozen=True, slots=True)
class WriteSingleCoilResponse(_CoilValue, Response):
    """The request, repeated.                                                              [MB-APP 6.5]

    05 | address 2 | FF00 or 0000
    """


@dataclass(frozen=True, slots=True)
class WriteSingleCoil(_CoilValue, Request[WriteSingleCoilResponse]):
    """Switch one coil on (FF00h) or off (0000h); no other value exists.                   [MB-APP 6.5]

        05 | address 2 | value 2

    >>> WriteSingleCoil(address=172, value=True).encode().hex(" ")
    '05 00 ac ff 00'
    """

    response: ClassVar[type[Response]] = WriteSingleCoilResponse
    writes: ClassVar[bool] = True


@dataclass(frozen=True, slots=True)
class WriteMultipleCoilsResponse(Response):
    """The address and the number of coils that were written.                              [MB-APP 6.11]

    0F | address 2 | quantity 2
    """

    address: int
    quantity: int

    name: ClassVar[str] = "Write Multiple Coils"
    function_code: ClassVar[int] = 0x0F
    layout: ClassVar[Layout] = Layout(">BHH", "function_code", "address", "quantity")

    def __post_init__(self) -> None:
        check_range("address", self.address, 0, 0xFFFF, self)
        check_range("quantity", self.quantity, 1, WRITE_COILS_LIMIT, self)


@dataclass(frozen=True, slots=True)
class WriteMultipleCoils(Request[WriteMultipleCoilsResponse]):
    """Write 1 to 1968 coils in a row.                                                     [MB-APP 6.11]

        0F | address 2 | quantity 2 | byte count | packed coils ...

    >>> WriteMultipleCoils(19, (1, 0, 1, 1, 0, 0, 1, 1, 1, 0)).encode().hex(" ")
    '0f 00 13 00 0a 02 cd 01'
    """

    address: int
    bits: Sequence[bool | int]

    name: ClassVar[str] = "Write Multiple Coils"
    function_code: ClassVar[int] = 0x0F
    layout: ClassVar[Layout] = Layout(
        ">BHHB", "function_code", "address", "quantity", "byte_count", tail="coils", count="byte_count"
    )
    response: ClassVar[type[Response]] = WriteMultipleCoilsResponse
    writes: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_range("address", self.address, 0, 0xFFFF, self)
        check_list("bits", self.bits, "True and False")
        check_range("quantity", len(self.bits), 1, WRITE_COILS_LIMIT)
        _packed(self.bits)  # raises EncodeError for a value that is not a bit
        object.__setattr__(self, "bits", tuple(map(bool, self.bits)))

    @property
    def quantity(self) -> int:
        """The number of coils."""
        return len(self.bits)

    def encode(self) -> bytes:
        data = pack_bits(self.bits)
        return self.layout.pack(self.function_code, self.address, len(self.bits), len(data), tail=data)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Decode a PDU, whose byte count must fit the quantity."""
        cls.check_function(pdu)
        _, address, quantity, byte_count, data = cls.layout.unpack(pdu)
        try:
            check_range("quantity", quantity, 1, WRITE_COILS_LIMIT)
        except EncodeError as error:
            raise DecodeError("value", pdu, 3, str(error)) from None
        if byte_count != (quantity + 7) // 8:
            raise DecodeError("length", pdu, 5, f"byte count {byte_count} for {quantity} coils")
        return cls(address, unpack_bits(data, quantity))

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with each bit."""
        return _bit_fields(cls.layout.fields(pdu), "coil")
