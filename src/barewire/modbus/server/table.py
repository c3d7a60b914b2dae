"""A unit kept in memory: the four tables of Modbus, FIFO queues, files, exception status and identification.

What it holds, and the function codes that read and write it:

    coils              read and write    01 05 0F             discrete inputs    read only    02
    holding registers  read and write    03 06 10 16 17       input registers    read only    04
    queues             read only         18                   files              read and write    14 15
    exception status   read only         07                   identification     read only    11 2B/0E
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import index
from typing import Any

from barewire._callbacks import check_function
from barewire.codecs import from_registers
from barewire.codecs.order import is_whole
from barewire.errors import EncodeError, shown
from barewire.modbus.exceptions import (
    ILLEGAL_DATA_ADDRESS,
    ILLEGAL_DATA_VALUE,
    ILLEGAL_FUNCTION,
    ModbusException,
)
from barewire.modbus.messages import coils as bits, combined, files, registers
from barewire.modbus.messages.base import Request, Response, check_range
from barewire.modbus.messages.diagnostics import ReadExceptionStatus, ReadExceptionStatusResponse
from barewire.modbus.messages.fifo import FIFO_LIMIT, ReadFifoQueue, ReadFifoQueueResponse
from barewire.modbus.messages.identification import ReadDeviceIdentification, ReportServerId, ReportServerIdResponse
from barewire.modbus.server.blocks import ADDRESSES, BitBlock, RegisterBlock
from barewire.modbus.server.identity import Identity

_BLOCKS = ("coils", "discrete_inputs", "holding_registers", "input_registers")
_WRITABLE = ("coils", "holding_registers")

Rows = Sequence[int] | Mapping[int, Sequence[int]]
"""The values of one of the four tables: a list from address 0 on, or lists by their first address."""
OnWrite = Callable[[str, int, tuple[Any, ...]], object]
OnRead = Callable[[str, int, int], object]


class Table:
    """A unit with coils, discrete inputs, holding and input registers in memory.

    >>> table = Table(objects={0x80: "serial 42"})
    >>> table.handle(registers.WriteSingleRegister(5, 42), now=0.0)
    WriteSingleRegisterResponse(address=5, value=42)
    >>> table.handle(combined.ReadWriteMultipleRegisters(4, 2, write_address=4, registers=(7,)), now=0.0)
    ReadWriteMultipleRegistersResponse(registers=(7, 42))

        size                         the number of values in each table that is not given below, all 0, from address
                                     0 on (default 65536)
        coils, discrete_inputs,      the values of a table: a list from address 0 on, or a dict: first address ->
        holding_registers,           list, such as {0: [0] * 10, 100: [1, 2, 3]}. An access to any other address is
        input_registers              exception 02
        read_only                    addresses that clients cannot write, which is exception 02: a dict with the keys
                                     "coils" and "holding_registers", such as {"coils": range(0, 10)}
        on_write                     called as on_write(name, address, values) when a client wrote: the name of the
                                     table ("coils", "holding_registers"), the first address, the values
        on_read                      called as on_read(name, address, quantity) before a client reads
        vendor, product, revision    the three mandatory identification objects
        objects                      further identification objects: number -> text or bytes
        files                        file records: file number -> registers

    `on_write` and `on_read` may set values, and raise ModbusException to decline the request. In `on_write` the values
    are stored already; if it raises anything, the values before are restored.

    Raises EncodeError for values that no message can carry, also for `table.coils[0] = 2` and for slices. A list that
    is assigned to a whole table fills it from its first address on, and the rest becomes 0. The application may set
    `queues` (registers by address) and `exception_status` (eight bits).
    """

    coils: BitBlock
    discrete_inputs: BitBlock
    holding_registers: RegisterBlock
    input_registers: RegisterBlock
    on_write: OnWrite | None
    on_read: OnRead | None

    def __init__(
        self,
        size: int = ADDRESSES,
        *,
        coils: Rows | None = None,
        discrete_inputs: Rows | None = None,
        holding_registers: Rows | None = None,
        input_registers: Rows | None = None,
        read_only: Mapping[str, Iterable[int]] | None = None,
        on_write: OnWrite | None = None,
        on_read: OnRead | None = None,
        vendor: str = "barewire",
        product: str = "table",
        revision: str = "1",
        objects: Mapping[int, str | bytes] | None = None,
        files: Mapping[int, Sequence[int]] | None = None,
    ) -> None:
        check_range("size", size, 0, ADDRESSES)
        self.size = size
        vars(self).update(
            coils=BitBlock.of("coil", size, coils),
            discrete_inputs=BitBlock.of("discrete input", size, discrete_inputs),
            holding_registers=RegisterBlock.of("holding register", size, holding_registers),
            input_registers=RegisterBlock.of("input register", size, input_registers),
        )
        self._read_only = self._protected({} if read_only is None else read_only)
        self.on_write = on_write
        self.on_read = on_read
        self.exception_status = 0
        self.queues: dict[int, list[int]] = {}
        self.files = {number: _file(number, content) for number, content in _dict("files", files, "{1: [0, 0]}")}
        others = dict(_dict("objects", objects, "{128: 'serial 42'}"))
        self.identity = Identity({0: vendor, 1: product, 2: revision} | others)

    def __repr__(self) -> str:
        blocks = (repr(getattr(self, name))[1:-1] for name in _BLOCKS)
        return f"<{type(self).__name__}: {', '.join(blocks)}>"

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _BLOCKS:
            getattr(self, name).fill(value)
            return
        if name in ("on_write", "on_read") and value is not None:
            check_function(name, value, name)
        object.__setattr__(self, name, value)

    def _protected(self, read_only: Mapping[str, Iterable[int]]) -> dict[str, frozenset[int]]:
        """Return the addresses that clients cannot write, by the name of the table. Raises EncodeError."""
        if not isinstance(read_only, Mapping):
            text = "expected a dict, such as {'holding_registers': range(0, 10)}"
            raise EncodeError(f"read_only = {shown(read_only)}: {text}", "read_only")
        protected: dict[str, frozenset[int]] = {}
        for name, addresses in read_only.items():
            if name not in _WRITABLE:
                near = [known for known in _WRITABLE if isinstance(name, str) and known.startswith(name[:3])]
                hint = f"; did you mean {near[0]!r}?" if near else ""
                raise EncodeError(f"read_only = {shown(name)}: expected {' or '.join(_WRITABLE)}{hint}", "read_only")
            if isinstance(addresses, str) or not isinstance(addresses, Iterable):
                text = "expected addresses, such as range(0, 10) or [3, 7]"
                raise EncodeError(f"read_only {name} = {shown(addresses)}: {text}", "read_only")
            row, block = list(addresses), getattr(self, name)
            for address in row:
                if not is_whole(address, 0, ADDRESSES - 1):
                    text = f"expected an address in 0..{ADDRESSES - 1}"
                    raise EncodeError(f"read_only {name} = {shown(address)}: {text}", "read_only")
                if missing := block.missing(address):
                    raise EncodeError(f"read_only: {missing}", "read_only")
            protected[name] = frozenset(map(index, row))
        return protected

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

    def _read_coils(self, request: bits.ReadCoils) -> Response:
        row = self._read("coils", request.address, request.quantity)
        return bits.ReadCoilsResponse(tuple(map(bool, row)))

    def _read_discrete_inputs(self, request: bits.ReadDiscreteInputs) -> Response:
        row = self._read("discrete_inputs", request.address, request.quantity)
        return bits.ReadDiscreteInputsResponse(tuple(map(bool, row)))

    def _write_single_coil(self, request: bits.WriteSingleCoil) -> Response:
        self._write("coils", request.address, (bool(request.value),))
        return bits.WriteSingleCoilResponse(request.address, request.value)

    def _write_multiple_coils(self, request: bits.WriteMultipleCoils) -> Response:
        self._write("coils", request.address, tuple(request.bits))
        return bits.WriteMultipleCoilsResponse(request.address, request.quantity)

    def _read_holding_registers(self, request: registers.ReadHoldingRegisters) -> Response:
        return request.answer(tuple(self._read("holding_registers", request.address, request.quantity)))

    def _read_input_registers(self, request: registers.ReadInputRegisters) -> Response:
        return request.answer(tuple(self._read("input_registers", request.address, request.quantity)))

    def _write_single_register(self, request: registers.WriteSingleRegister) -> Response:
        self._write("holding_registers", request.address, (request.value,))
        return registers.WriteSingleRegisterResponse(request.address, request.value)

    def _write_multiple_registers(self, request: registers.WriteMultipleRegisters) -> Response:
        self._write("holding_registers", request.address, tuple(request.registers))
        return registers.WriteMultipleRegistersResponse(request.address, request.quantity)

    def _mask_write_register(self, request: combined.MaskWriteRegister) -> Response:
        address, and_mask, or_mask = request.address, request.and_mask, request.or_mask
        self._check(self.holding_registers, address, 1)
        self._write(
            "holding_registers", address, (combined.masked(self.holding_registers[address], and_mask, or_mask),)
        )
        return combined.MaskWriteRegisterResponse(address, and_mask, or_mask)

    def _read_write_multiple_registers(self, request: combined.ReadWriteMultipleRegisters) -> Response:
        self._check(self.holding_registers, request.read_address, request.read_quantity)
        self._write("holding_registers", request.write_address, tuple(request.registers))
        row = self._read("holding_registers", request.read_address, request.read_quantity)
        return combined.ReadWriteMultipleRegistersResponse(tuple(row))

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

    @staticmethod
    def _check(block: RegisterBlock | BitBlock, address: int, quantity: int) -> None:
        if not block.has(address, quantity):
            raise ModbusException(ILLEGAL_DATA_ADDRESS)

    def _read(self, name: str, address: int, quantity: int) -> Sequence[int]:
        """Return the values that a client reads."""
        block: RegisterBlock | BitBlock = getattr(self, name)
        end = address + quantity
        if block.has_holes or end > len(block):
            self._check(block, address, quantity)
        if self.on_read is not None:
            self.on_read(name, address, quantity)
        values: Sequence[int] = block.stored(slice(address, end))
        return values

    def _write(self, name: str, address: int, values: tuple[Any, ...]) -> None:
        """Store the values that a client writes."""
        block: Any = getattr(self, name)
        self._check(block, address, len(values))
        span = slice(address, address + len(values))
        protected = self._read_only.get(name)
        if protected and not protected.isdisjoint(range(span.start, span.stop)):
            raise ModbusException(ILLEGAL_DATA_ADDRESS)
        row = bytes(values) if isinstance(block, BitBlock) else array("H", values)
        if self.on_write is None:
            block.store(span, row)
            return
        before = block.stored(span)
        block.store(span, row)
        try:
            self.on_write(name, address, values)
        except BaseException:
            block.store(span, before)
            raise

    def _record_span(self, file: int, first: int, length: int) -> slice:
        if first + length > len(self.files.get(file, ())):
            raise ModbusException(ILLEGAL_DATA_ADDRESS)
        return slice(first, first + length)


_ANSWERS: dict[type[Request[Any]], Callable[[Table, Any], Response]] = {
    bits.ReadCoils: Table._read_coils,
    bits.ReadDiscreteInputs: Table._read_discrete_inputs,
    bits.WriteSingleCoil: Table._write_single_coil,
    bits.WriteMultipleCoils: Table._write_multiple_coils,
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


def _dict(name: str, given: Any, example: str) -> Iterable[tuple[Any, Any]]:
    """Return the items of a dict; none for None. Raises EncodeError for anything else."""
    if given is None:
        return ()
    if not isinstance(given, Mapping):
        raise EncodeError(f"{name} = {shown(given)}: expected a dict, such as {example}", name)
    return given.items()


def _file(number: int, content: Sequence[int]) -> array[int]:
    """Return the registers of a file. Raises EncodeError for a wrong file number, size or value."""
    check_range("file", number, 1, 0xFFFF)
    if not hasattr(content, "__len__") or isinstance(content, (str, bytes, bytearray, Mapping)):
        raise EncodeError(f"file {number} = {shown(content)}: expected a list of registers", "files")
    limit = files.RECORD_LIMIT + 1
    if len(content) > limit:
        raise EncodeError(f"file {number}: {len(content)} records, a file has at most {limit}", "files")
    try:
        from_registers(content)
    except EncodeError as error:
        raise EncodeError(f"file {number}: {error}", "files") from None
    return array("H", content)
