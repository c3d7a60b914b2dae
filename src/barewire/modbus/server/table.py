"""A ready unit: four tables in memory, and nothing behind them. What most gateways and all first experiments need.

coils              read and write    01 05 0F             discrete inputs    read only    02
holding registers  read and write    03 06 10 16 17       input registers    read only    04
queues             read only         18                   files              read and write    14 15
exception status   read only         07                   who it is          read only    11 2B/0E
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from typing import Any

from barewire.codecs import from_registers
from barewire.errors import EncodeError
from barewire.modbus.exceptions import (
    ILLEGAL_DATA_ADDRESS,
    ILLEGAL_DATA_VALUE,
    ILLEGAL_FUNCTION,
    ModbusException,
)
from barewire.modbus.messages import coils as bits, combined, files, registers
from barewire.modbus.messages.base import Response, check_range
from barewire.modbus.messages.diagnostics import ReadExceptionStatus, ReadExceptionStatusResponse
from barewire.modbus.messages.fifo import FIFO_LIMIT, ReadFifoQueue, ReadFifoQueueResponse
from barewire.modbus.messages.identification import ReadDeviceIdentification, ReportServerId, ReportServerIdResponse
from barewire.modbus.server.identity import Identity

SIZE = 0x10000

_SUPPORTED = frozenset(
    {
        *(bits.ReadCoils, bits.ReadDiscreteInputs, bits.WriteSingleCoil, bits.WriteMultipleCoils),
        *(registers.ReadHoldingRegisters, registers.ReadInputRegisters),
        *(registers.WriteSingleRegister, registers.WriteMultipleRegisters),
        *(combined.MaskWriteRegister, combined.ReadWriteMultipleRegisters),
        *(files.ReadFileRecord, files.WriteFileRecord, ReadFifoQueue),
        *(ReadExceptionStatus, ReportServerId, ReadDeviceIdentification),
    }
)


class Table:
    """`size` entries of each kind, all zero, addressed from 0. Anything beyond is exception 02.

    >>> table = Table(objects={0x80: "serial 42"})
    >>> table.handle(registers.WriteSingleRegister(5, 42), now=0.0)
    WriteSingleRegisterResponse(address=5, value=42)
    >>> table.handle(combined.ReadWriteMultipleRegisters(4, 2, write_address=4, registers=(7,)), now=0.0)
    ReadWriteMultipleRegistersResponse(registers=(7, 42))

    `objects` are identification objects besides the three of every device; `files` are registers by file number.
    What nobody could ever read is an EncodeError here, and not a surprise later.
    `queues` (register by register, by address) and `exception_status` (eight bits) are for whoever owns the table.
    """

    def __init__(
        self,
        size: int = SIZE,
        *,
        vendor: str = "barewire",
        product: str = "table",
        revision: str = "1",
        objects: Mapping[int, str | bytes] | None = None,
        files: Mapping[int, Sequence[int]] | None = None,
    ) -> None:
        check_range("size", size, 0, SIZE)
        self.size = size
        self.coils = bytearray(size)
        self.discrete_inputs = bytearray(size)
        self.holding_registers = array("H", bytes(2 * size))
        self.input_registers = array("H", bytes(2 * size))
        self.exception_status = 0
        self.queues: dict[int, list[int]] = {}
        self.files = {number: _file(number, content) for number, content in (files or {}).items()}
        self.identity = Identity({0: vendor, 1: product, 2: revision, **(objects or {})})

    @staticmethod
    def supports(request: type[Any]) -> bool:
        """Whether it is one of the functions of a table."""
        return request in _SUPPORTED

    def _span(self, address: int, quantity: int) -> slice:
        if address + quantity > self.size:
            raise ModbusException(ILLEGAL_DATA_ADDRESS)
        return slice(address, address + quantity)

    def handle(self, request: Any, now: float) -> Response | None:
        """Answer one request; ModbusException 01 for what a table cannot do, 02 beyond its end."""
        if isinstance(request, registers.ReadHoldingRegisters):
            # What is asked most. A `match` would take as long as all of this.
            is_input = isinstance(request, registers.ReadInputRegisters)  # which is a ReadHoldingRegisters too
            row_of = self.input_registers if is_input else self.holding_registers
            first, beyond = request.address, request.address + request.quantity
            if beyond > self.size:
                raise ModbusException(ILLEGAL_DATA_ADDRESS)
            return request.answer(tuple(row_of[first:beyond]))
        match request:
            # ReadDiscreteInputs is a ReadCoils too.
            case bits.ReadDiscreteInputs(address, quantity):
                row = self.discrete_inputs[self._span(address, quantity)]
                return bits.ReadDiscreteInputsResponse(tuple(map(bool, row)))
            case bits.ReadCoils(address, quantity):
                return bits.ReadCoilsResponse(tuple(map(bool, self.coils[self._span(address, quantity)])))
            case bits.WriteSingleCoil(address, on):
                self.coils[self._span(address, 1)] = bytes([on])
                return bits.WriteSingleCoilResponse(address, on)
            case bits.WriteMultipleCoils(address, row_of_bits):
                self.coils[self._span(address, len(row_of_bits))] = bytes(row_of_bits)
                return bits.WriteMultipleCoilsResponse(address, len(row_of_bits))
            case registers.WriteSingleRegister(address, value):
                self.holding_registers[self._span(address, 1)] = array("H", [value])
                return registers.WriteSingleRegisterResponse(address, value)
            case registers.WriteMultipleRegisters(address, values):
                self.holding_registers[self._span(address, len(values))] = array("H", values)
                return registers.WriteMultipleRegistersResponse(address, len(values))
        return self._rarer(request)

    def _rarer(self, request: Any) -> Response:
        match request:
            case combined.MaskWriteRegister(address, and_mask, or_mask):
                at = self._span(address, 1).start
                self.holding_registers[at] = combined.masked(self.holding_registers[at], and_mask, or_mask)
                return combined.MaskWriteRegisterResponse(address, and_mask, or_mask)
            case combined.ReadWriteMultipleRegisters(read_address, read_quantity, write_address, values):
                read, write = self._span(read_address, read_quantity), self._span(write_address, len(values))
                self.holding_registers[write] = array("H", values)
                return combined.ReadWriteMultipleRegistersResponse(tuple(self.holding_registers[read]))
            case ReadFifoQueue(address):
                if address not in self.queues:
                    raise ModbusException(ILLEGAL_DATA_ADDRESS)
                if len(self.queues[address]) > FIFO_LIMIT:
                    raise ModbusException(ILLEGAL_DATA_VALUE)
                return ReadFifoQueueResponse(tuple(self.queues[address]))
            case files.ReadFileRecord(places):
                spans = [(file, self._records(file, record, length)) for file, record, length in places]
                return files.ReadFileRecordResponse(tuple(tuple(self.files[file][span]) for file, span in spans))
            case files.WriteFileRecord(records):
                # Nothing is written before it is known that all of them exist.
                targets = [(file, self._records(file, record, len(row)), row) for file, record, row in records]
                for file, span, row in targets:
                    self.files[file][span] = array("H", row)
                return files.WriteFileRecordResponse(records)
            case ReadExceptionStatus():
                return ReadExceptionStatusResponse(self.exception_status)
            case ReportServerId():
                return ReportServerIdResponse(b"\x01\xff" + self.identity.objects[1])
            case ReadDeviceIdentification():
                return self.identity.answer(request)
        raise ModbusException(ILLEGAL_FUNCTION)

    def _records(self, file: int, record: int, length: int) -> slice:
        if record + length > len(self.files.get(file, ())):
            raise ModbusException(ILLEGAL_DATA_ADDRESS)
        return slice(record, record + length)


def _file(number: int, content: Sequence[int]) -> array[int]:
    """The registers of a file, each one checked."""
    check_range("file", number, 1, 0xFFFF)
    if len(content) > files.RECORD_LIMIT + 1:
        most = files.RECORD_LIMIT + 1
        raise EncodeError(f"file {number}: {len(content)} records, a file has at most {most}", "files")
    try:
        from_registers(content)
    except EncodeError as error:
        raise EncodeError(f"file {number}: {error}", "files") from None
    return array("H", content)
