"""Reading and writing in one request: function codes 16 (mask write) and 17 (write, then read).

Another client may change the registers between a separate read and write, but not within one of these requests.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from barewire.codecs import Field, Layout, from_registers, to_registers
from barewire.errors import DecodeError, EncodeError
from barewire.modbus.messages.base import Message, Request, Response, check_range, check_registers
from barewire.modbus.messages.registers import READ_REGISTERS_LIMIT, ReadHoldingRegistersResponse, register_fields

_WRITE_LIMIT = 121
"""Two registers fewer than with function 10, because of the read address and the read quantity."""


def masked(register: int, and_mask: int, or_mask: int) -> int:
    """Return the register after a mask write: AND keeps the bits that are 1, OR gives the others.         [MB-APP 6.16]

    >>> hex(masked(0x12, and_mask=0xF2, or_mask=0x25))
    '0x17'
    """
    return register & and_mask | or_mask & ~and_mask & 0xFFFF


@dataclass(frozen=True, slots=True)
class _Masks(Message):
    """What request and response of Mask Write Register have in common: all of it."""

    address: int
    and_mask: int
    or_mask: int

    name: ClassVar[str] = "Mask Write Register"
    function_code: ClassVar[int] = 0x16
    layout: ClassVar[Layout] = Layout(">BHHH", "function_code", "address", "and_mask", "or_mask")

    def __post_init__(self) -> None:
        for name in ("address", "and_mask", "or_mask"):
            check_range(name, getattr(self, name), 0, 0xFFFF, self)

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with the effect of each mask."""
        words = ("", "", "bits to keep", "value of the bits that are not kept")
        return [field._replace(meaning=meaning) for field, meaning in zip(cls.layout.fields(pdu), words)]


@dataclass(frozen=True, slots=True)
class MaskWriteRegisterResponse(_Masks, Response):
    """The request, repeated.                                                              [MB-APP 6.16]

    16 | address 2 | AND mask 2 | OR mask 2
    """


@dataclass(frozen=True, slots=True)
class MaskWriteRegister(_Masks, Request[MaskWriteRegisterResponse]):
    """Change some bits of one holding register and keep the others.                       [MB-APP 6.16]

        16 | address 2 | AND mask 2 | OR mask 2          new = (old AND and) OR (or AND NOT and)

    >>> MaskWriteRegister(address=4, and_mask=0xF2, or_mask=0x25).encode().hex(" ")
    '16 00 04 00 f2 00 25'

    To set the bits of `mask` to those of `value`: `MaskWriteRegister(address, ~mask & 0xFFFF, value & mask)`.
    """

    response: ClassVar[type[Response]] = MaskWriteRegisterResponse
    writes: ClassVar[bool] = True


@dataclass(frozen=True, slots=True)
class ReadWriteMultipleRegistersResponse(ReadHoldingRegistersResponse):
    """The registers that were read.                                                       [MB-APP 6.17]

    17 | byte count | registers, 2 bytes each ...
    """

    name: ClassVar[str] = "Read/Write Multiple Registers"
    function_code: ClassVar[int] = 0x17


@dataclass(frozen=True, slots=True)
class ReadWriteMultipleRegisters(Request[ReadWriteMultipleRegistersResponse]):
    """Write 1 to 121 holding registers, **then** read 1 to 125.                           [MB-APP 6.17]

        17 | read address 2 | read quantity 2 | write address 2 | write quantity 2 | byte count | registers ...

    >>> ReadWriteMultipleRegisters(read_address=3, read_quantity=6, write_address=14, registers=[255]).encode().hex(" ")
    '17 00 03 00 06 00 0e 00 01 02 00 ff'
    """

    read_address: int
    read_quantity: int
    write_address: int
    registers: Sequence[int]

    name: ClassVar[str] = "Read/Write Multiple Registers"
    function_code: ClassVar[int] = 0x17
    layout: ClassVar[Layout] = Layout(
        ">BHHHHB",
        *("function_code", "read_address", "read_quantity", "write_address", "write_quantity", "byte_count"),
        tail="registers",
        count="byte_count",
    )
    response: ClassVar[type[Response]] = ReadWriteMultipleRegistersResponse
    writes: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_range("read_address", self.read_address, 0, 0xFFFF, self)
        check_range("read_quantity", self.read_quantity, 1, READ_REGISTERS_LIMIT, self)
        check_range("write_address", self.write_address, 0, 0xFFFF, self)
        check_registers(self.registers)
        check_range("write_quantity", len(self.registers), 1, _WRITE_LIMIT)
        # `from_registers` raises EncodeError for a value outside 0..65535; the way back makes plain numbers of all.
        object.__setattr__(self, "registers", to_registers(from_registers(self.registers)))

    @property
    def write_quantity(self) -> int:
        """The number of registers to write."""
        return len(self.registers)

    def encode(self) -> bytes:
        data = from_registers(self.registers)
        places = (self.read_address, self.read_quantity, self.write_address, len(self.registers))
        return self.layout.pack(self.function_code, *places, len(data), tail=data)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Decode a PDU, whose byte count must be twice the quantity."""
        cls.check_function(pdu)
        _, read_address, read_quantity, write_address, write_quantity, byte_count, data = cls.layout.unpack(pdu)
        try:
            check_range("read_quantity", read_quantity, 1, READ_REGISTERS_LIMIT)
            check_range("write_quantity", write_quantity, 1, _WRITE_LIMIT)
        except EncodeError as error:
            raise DecodeError("value", pdu, 3 if error.field == "read_quantity" else 7, str(error)) from None
        if byte_count != 2 * write_quantity:
            raise DecodeError("length", pdu, 9, f"byte count {byte_count} for {write_quantity} registers")
        return cls(read_address, read_quantity, write_address, to_registers(data))

    def fit(self, response: Any, pdu: bytes) -> Any:
        """Check that the response has as many registers as were asked for."""
        if len(response.registers) != self.read_quantity:
            self.refuse(pdu, "byte_count", 2 * self.read_quantity, 2 * len(response.registers))
        return response

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with each register."""
        return register_fields(cls.layout.fields(pdu))
