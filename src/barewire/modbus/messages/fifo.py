"""A queue of registers that a device fills and a client reads: function code 18."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from barewire.codecs import Field, Layout, from_registers, to_registers
from barewire.errors import DecodeError
from barewire.modbus.messages.base import Request, Response, check_range, check_registers
from barewire.modbus.messages.registers import register_fields

FIFO_LIMIT = 31
"""The most registers in one response; a longer queue is exception 03 [MB-APP 6.18]."""


@dataclass(frozen=True, slots=True)
class ReadFifoQueueResponse(Response):
    """The content of the queue, 0 to 31 registers, the oldest first.                      [MB-APP 6.18]

        18 | byte count 2 (of all that follows) | FIFO count 2 | registers, 2 bytes each ...

    The only response of the standard with a byte count of two bytes.

    >>> ReadFifoQueueResponse((440, 4740)).encode().hex(" ")
    '18 00 06 00 02 01 b8 12 84'
    """

    registers: tuple[int, ...]

    name: ClassVar[str] = "Read FIFO Queue"
    function_code: ClassVar[int] = 0x18
    layout: ClassVar[Layout] = Layout(">BHH", "function_code", "byte_count", "fifo_count", tail="registers")

    def __post_init__(self) -> None:
        check_registers(self.registers)
        check_range("fifo_count", len(self.registers), 0, FIFO_LIMIT)

    def encode(self) -> bytes:
        data = from_registers(self.registers)
        return self.layout.pack(self.function_code, 2 + len(data), len(self.registers), tail=data)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        """Decode a PDU, whose two counts must fit its bytes."""
        cls.check_function(pdu)
        _, byte_count, fifo_count, data = cls.layout.unpack(pdu)
        if byte_count != 2 + len(data):
            text = f"byte count {byte_count}, but {2 + len(data)} bytes follow"
            raise DecodeError("length", pdu, 1, text)
        if fifo_count > FIFO_LIMIT:
            raise DecodeError("value", pdu, 3, f"FIFO count {fifo_count}: expected 0..{FIFO_LIMIT}")
        if len(data) != 2 * fifo_count:
            raise DecodeError("length", pdu, 3, f"FIFO count {fifo_count} for {len(data)} bytes of registers")
        return cls(to_registers(data))

    @classmethod
    def measure(cls, pdu: bytes) -> int | None:
        """Return the length from the byte count, once that has arrived."""
        return 3 + int.from_bytes(pdu[1:3], "big") if len(pdu) >= 3 else cls.layout.size

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with each register."""
        return register_fields(cls.layout.fields(pdu))


@dataclass(frozen=True, slots=True)
class ReadFifoQueue(Request[ReadFifoQueueResponse]):
    """Read the queue whose count register is at `address`; its content stays there.       [MB-APP 6.18]

        18 | FIFO pointer address 2

    >>> ReadFifoQueue(address=1246).encode().hex(" ")
    '18 04 de'
    """

    address: int

    name: ClassVar[str] = "Read FIFO Queue"
    function_code: ClassVar[int] = 0x18
    layout: ClassVar[Layout] = Layout(">BH", "function_code", "address")
    response: ClassVar[type[Response]] = ReadFifoQueueResponse

    def __post_init__(self) -> None:
        check_range("address", self.address, 0, 0xFFFF, self)
