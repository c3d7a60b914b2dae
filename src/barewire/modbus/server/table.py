"""A unit kept in memory: the four tables of Modbus, FIFO queues, files, exception status and identification.

    coils              read and write    01 05 0F             discrete inputs    read only    02
    holding registers  read and write    03 06 10 16 17       input registers    read only    04
    queues             read only         18                   files              read and write    14 15
    exception status   read only         07                   identification     read only    11 2B/0E

Depends on: messages, identity. Used by: programs, and the servers of io as the default unit.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from barewire.codecs import from_registers
from barewire.errors import EncodeError
from barewire.modbus.exceptions import (
    ILLEGAL_DATA_ADDRESS,
    ILLEGAL_DATA_VALUE,
    ILLEGAL_FUNCTION,
    ModbusException,
)
from barewire.modbus.messages import coils, combined, files, registers
from barewire.modbus.messages.base import Request, Response, check_range
from barewire.modbus.messages.diagnostics import ReadExceptionStatus, ReadExceptionStatusResponse
from barewire.modbus.messages.fifo import FIFO_LIMIT, ReadFifoQueue, ReadFifoQueueResponse
from barewire.modbus.messages.identification import ReadDeviceIdentification, ReportServerId, ReportServerIdResponse
from barewire.modbus.server.blocks import BitBlock, RegisterBlock
from barewire.modbus.server.identity import Identity

_SIZE = 0x10000
_BLOCKS: dict[str, tuple[type[BitBlock | RegisterBlock], str]] = {
    "coils": (BitBlock, "coil"),
    "discrete_inputs": (BitBlock, "discrete input"),
    "holding_registers": (RegisterBlock, "holding register"),
    "input_registers": (RegisterBlock, "input register"),
}
"""By attribute: the class of the block, and what one of its values is called in errors."""


class Table:
    """A unit with coils, discrete inputs, holding and input registers, all zero, addressed from 0.

    >>> table = Table(objects={0x80: "serial 42"})
    >>> table.handle(registers.WriteSingleRegister(5, 42), now=0.0)
    WriteSingleRegisterResponse(address=5, value=42)
    >>> table.handle(combined.ReadWriteMultipleRegisters(4, 2, write_address=4, registers=(7,)), now=0.0)
    ReadWriteMultipleRegistersResponse(registers=(7, 42))

        size                         the number of values in each of the four tables (default 65536);
                                     an access beyond the end is exception 02
        vendor, product, revision    the three mandatory identification objects
        objects                      further identification objects: number -> text or bytes
        files                        file records: file number -> registers

    Raises EncodeError for values that no message can carry, also for `table.coils[0] = 2` and for slices. A list that
    is assigned to a whole table fills it from address 0, and the rest becomes 0. The application may set `queues`
    (registers by address) and `exception_status` (eight bits).
    """

    def __init__(
        self,
        size: int = _SIZE,
        *,
        vendor: str = "barewire",
        product: str = "table",
        revision: str = "1",
        objects: Mapping[int, str | bytes] | None = None,
        files: Mapping[int, Sequence[int]] | None = None,
    ) -> None:
        check_range("size", size, 0, _SIZE)
        self.size = size
        self.coils = BitBlock.filled("coil", size)
        self.discrete_inputs = BitBlock.filled("discrete input", size)
        self.holding_registers = RegisterBlock.filled("holding register", size)
        self.input_registers = RegisterBlock.filled("input register", size)
        self.exception_status = 0
        self.queues: dict[int, list[int]] = {}
        self.files = {number: _file(number, content) for number, content in (files or {}).items()}
        self.identity = Identity({0: vendor, 1: product, 2: revision, **(objects or {})})

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _BLOCKS and not isinstance(value, RegisterBlock | BitBlock):
            block, one = _BLOCKS[name]
            value = block.filled(one, self.size, value)
        object.__setattr__(self, name, value)

    @staticmethod
    def supports(request: type[Any]) -> bool:
        """Whether a table answers this request class."""
        return request in _ANSWERS

    def handle(self, request: Any, now: float) -> Response | None:
        """Return the response to a request. Raises ModbusException 01 (not supported) or 02 (beyond the end)."""
        answer = _ANSWERS.get(type(request))
        if answer is None:  # a subclass of a request is answered as that request
            answer = next((_ANSWERS[base] for base in type(request).__mro__ if base in _ANSWERS), None)
        if answer is None:
            raise ModbusException(ILLEGAL_FUNCTION)
        return answer(self, request)

    # One method for each request class, in the order of `_ANSWERS`

    def _read_coils(self, request: coils.ReadCoils) -> Response:
        bits = self.coils[self._span(request.address, request.quantity)]
        return coils.ReadCoilsResponse(tuple(map(bool, bits)))

    def _read_discrete_inputs(self, request: coils.ReadDiscreteInputs) -> Response:
        bits = self.discrete_inputs[self._span(request.address, request.quantity)]
        return coils.ReadDiscreteInputsResponse(tuple(map(bool, bits)))

    def _write_single_coil(self, request: coils.WriteSingleCoil) -> Response:
        self.coils[self._span(request.address, 1)] = bytes([request.value])
        return coils.WriteSingleCoilResponse(request.address, request.value)

    def _write_multiple_coils(self, request: coils.WriteMultipleCoils) -> Response:
        self.coils[self._span(request.address, request.quantity)] = bytes(request.bits)
        return coils.WriteMultipleCoilsResponse(request.address, request.quantity)

    def _read_holding_registers(self, request: registers.ReadHoldingRegisters) -> Response:
        return request.answer(tuple(self.holding_registers[self._span(request.address, request.quantity)]))

    def _read_input_registers(self, request: registers.ReadInputRegisters) -> Response:
        return request.answer(tuple(self.input_registers[self._span(request.address, request.quantity)]))

    def _write_single_register(self, request: registers.WriteSingleRegister) -> Response:
        self.holding_registers[self._span(request.address, 1)] = array("H", [request.value])
        return registers.WriteSingleRegisterResponse(request.address, request.value)

    def _write_multiple_registers(self, request: registers.WriteMultipleRegisters) -> Response:
        self.holding_registers[self._span(request.address, request.quantity)] = array("H", request.registers)
        return registers.WriteMultipleRegistersResponse(request.address, request.quantity)

    def _mask_write_register(self, request: combined.MaskWriteRegister) -> Response:
        span = self._span(request.address, 1)
        old = self.holding_registers[request.address]
        self.holding_registers[span] = array("H", [combined.masked(old, request.and_mask, request.or_mask)])
        return combined.MaskWriteRegisterResponse(request.address, request.and_mask, request.or_mask)

    def _read_write_multiple_registers(self, request: combined.ReadWriteMultipleRegisters) -> Response:
        read = self._span(request.read_address, request.read_quantity)
        write = self._span(request.write_address, request.write_quantity)
        self.holding_registers[write] = array("H", request.registers)
        return combined.ReadWriteMultipleRegistersResponse(tuple(self.holding_registers[read]))

    def _read_fifo_queue(self, request: ReadFifoQueue) -> Response:
        queue = self.queues.get(request.address)
        if queue is None:
            raise ModbusException(ILLEGAL_DATA_ADDRESS)
        if len(queue) > FIFO_LIMIT:
            raise ModbusException(ILLEGAL_DATA_VALUE)
        return ReadFifoQueueResponse(tuple(queue))

    def _read_file_record(self, request: files.ReadFileRecord) -> Response:
        spans = [(file, self._record_span(file, first, length)) for file, first, length in request.places]
        return files.ReadFileRecordResponse(tuple(tuple(self.files[file][span]) for file, span in spans))

    def _write_file_record(self, request: files.WriteFileRecord) -> Response:
        # All records are checked before the first one is written.
        targets = [
            (file, self._record_span(file, first, len(values)), values) for file, first, values in request.records
        ]
        for file, span, values in targets:
            self.files[file][span] = array("H", values)
        return files.WriteFileRecordResponse(request.records)

    def _read_exception_status(self, request: ReadExceptionStatus) -> Response:
        return ReadExceptionStatusResponse(self.exception_status)

    def _report_server_id(self, request: ReportServerId) -> Response:
        return ReportServerIdResponse(b"\x01\xff" + self.identity.objects[1])

    def _read_device_identification(self, request: ReadDeviceIdentification) -> Response:
        return self.identity.answer(request)

    def _span(self, address: int, quantity: int) -> slice:
        if address + quantity > self.size:
            raise ModbusException(ILLEGAL_DATA_ADDRESS)
        return slice(address, address + quantity)

    def _record_span(self, file: int, first: int, length: int) -> slice:
        if first + length > len(self.files.get(file, ())):
            raise ModbusException(ILLEGAL_DATA_ADDRESS)
        return slice(first, first + length)


_ANSWERS: dict[type[Request[Any]], Callable[[Table, Any], Response]] = {
    coils.ReadCoils: Table._read_coils,
    coils.ReadDiscreteInputs: Table._read_discrete_inputs,
    coils.WriteSingleCoil: Table._write_single_coil,
    coils.WriteMultipleCoils: Table._write_multiple_coils,
    registers.ReadHoldingRegisters: Table._read_holding_registers,
    registers.ReadInputRegisters: Table._read_input_registers,
    registers.WriteSingleRegister: Table._write_single_register,
    registers.WriteMultipleRegisters: Table._write_multiple_registers,
    combined.MaskWriteRegister: Table._mask_write_register,
    combined.ReadWriteMultipleRegisters: Table._read_write_multiple_registers,
    ReadFifoQueue: Table._read_fifo_queue,
    files.ReadFileRecord: Table._read_file_record,
    files.WriteFileRecord: Table._write_file_record,
    ReadExceptionStatus: Table._read_exception_status,
    ReportServerId: Table._report_server_id,
    ReadDeviceIdentification: Table._read_device_identification,
}
"""Request class -> the method that answers it."""


def _file(number: int, content: Sequence[int]) -> array[int]:
    """Return the registers of a file. Raises EncodeError for a wrong file number, size or value."""
    check_range("file", number, 1, 0xFFFF)
    limit = files.RECORD_LIMIT + 1
    if len(content) > limit:
        raise EncodeError(f"file {number}: {len(content)} records, a file has at most {limit}", "files")
    try:
        from_registers(content)
    except EncodeError as error:
        raise EncodeError(f"file {number}: {error}", "files") from None
    return array("H", content)
