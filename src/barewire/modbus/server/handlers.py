"""A unit of plain functions, for programs whose values are not in a table.

An example:

    Functions(read_holding_registers=lambda address, quantity: sensor[address : address + quantity])
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, NamedTuple

from barewire._callbacks import check_function
from barewire.errors import EncodeError, shown
from barewire.modbus.exceptions import ILLEGAL_FUNCTION, ModbusException
from barewire.modbus.messages import coils, combined, files, registers
from barewire.modbus.messages.base import Request, Response
from barewire.modbus.messages.diagnostics import ReadExceptionStatus, ReadExceptionStatusResponse
from barewire.modbus.messages.fifo import ReadFifoQueue, ReadFifoQueueResponse
from barewire.modbus.messages.identification import ReadDeviceIdentification, ReportServerId, ReportServerIdResponse
from barewire.modbus.server.identity import Identity

ReadBits = Callable[[int, int], Sequence[bool | int]]
ReadRegisters = Callable[[int, int], Sequence[int]]
WriteBits = Callable[[int, Sequence[bool]], object]
WriteRegisters = Callable[[int, Sequence[int]], object]
Own = Callable[[Any], Response | None]


@dataclass(slots=True)
class Functions:
    """Plain functions as a unit. A request whose functions are not given gets exception 01.

    >>> unit = Functions(read_holding_registers=lambda address, quantity: range(address, address + quantity))
    >>> unit.handle(registers.ReadHoldingRegisters(40, 3), now=0.0)
    ReadHoldingRegistersResponse(registers=(40, 41, 42))

    A function raises `ModbusException(2)` for an address that does not exist. Any other exception, a result of the
    wrong length and a value that does not fit are failures of the function: the client gets exception 04, and the
    server logs the error with its traceback and keeps it in `statistics.failures`. Single and multiple writes call the
    same function. Function codes 16 and 17 call a read and a write function. `own` maps request classes of the
    application to functions that return the response.

    Raises EncodeError for an argument that is not a function.
    """

    _: KW_ONLY
    read_coils: ReadBits | None = None
    read_discrete_inputs: ReadBits | None = None
    write_coils: WriteBits | None = None
    read_holding_registers: ReadRegisters | None = None
    read_input_registers: ReadRegisters | None = None
    write_registers: WriteRegisters | None = None
    read_file: Callable[[int, int, int], Sequence[int]] | None = None
    write_file: Callable[[int, int, Sequence[int]], object] | None = None
    read_queue: Callable[[int], Sequence[int]] | None = None
    read_exception_status: Callable[[], int] | None = None
    report_server_id: Callable[[], bytes] | None = None
    identity: Identity | None = None
    own: Mapping[type[Request[Any]], Own] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.own, Mapping):
            text = "expected request classes and functions, such as {ReadFifoQueue: answer}"
            raise EncodeError(f"Functions: own = {shown(self.own)}: {text}", "own")
        if not isinstance(self.identity, Identity | None):
            raise EncodeError(f"Functions: identity = {shown(self.identity)}: expected an Identity", "identity")
        given = {name: getattr(self, name) for name in _FUNCTIONS if getattr(self, name) is not None}
        given |= {f"own[{getattr(key, '__name__', key)}]": function for key, function in self.own.items()}
        for name, function in given.items():
            check_function(f"Functions: {name}", function, name)

    def supports(self, request: type[Request[Any]]) -> bool:
        """Whether the functions that this class of requests needs are given."""
        if request in self.own:
            return True
        handler = _ANSWERS.get(request)
        return handler is not None and all(getattr(self, name) is not None for name in handler.needs)

    def handle(self, request: Any, now: float) -> Response | None:
        """Call the functions for this request and return its response."""
        request_class = type(request)
        if request_class in self.own:
            return self.own[request_class](request)
        if not self.supports(request_class):
            raise ModbusException(ILLEGAL_FUNCTION)
        return _ANSWERS[request_class].answer(self, request)

    # One method for each request class, in the order of `_ANSWERS`

    def _read_coils(self, request: coils.ReadCoils) -> Response:
        return coils.ReadCoilsResponse(_row(self.read_coils, request.address, request.quantity))

    def _read_discrete_inputs(self, request: coils.ReadDiscreteInputs) -> Response:
        return coils.ReadDiscreteInputsResponse(_row(self.read_discrete_inputs, request.address, request.quantity))

    def _write_single_coil(self, request: coils.WriteSingleCoil) -> Response:
        _call(self.write_coils, request.address, (request.value,))
        return coils.WriteSingleCoilResponse(request.address, request.value)

    def _write_multiple_coils(self, request: coils.WriteMultipleCoils) -> Response:
        _call(self.write_coils, request.address, request.bits)
        return coils.WriteMultipleCoilsResponse(request.address, request.quantity)

    def _read_holding_registers(self, request: registers.ReadHoldingRegisters) -> Response:
        row = _row(self.read_holding_registers, request.address, request.quantity)
        return registers.ReadHoldingRegistersResponse(row)

    def _read_input_registers(self, request: registers.ReadInputRegisters) -> Response:
        row = _row(self.read_input_registers, request.address, request.quantity)
        return registers.ReadInputRegistersResponse(row)

    def _write_single_register(self, request: registers.WriteSingleRegister) -> Response:
        _call(self.write_registers, request.address, (request.value,))
        return registers.WriteSingleRegisterResponse(request.address, request.value)

    def _write_multiple_registers(self, request: registers.WriteMultipleRegisters) -> Response:
        _call(self.write_registers, request.address, request.registers)
        return registers.WriteMultipleRegistersResponse(request.address, request.quantity)

    def _mask_write_register(self, request: combined.MaskWriteRegister) -> Response:
        address, and_mask, or_mask = request.address, request.and_mask, request.or_mask
        (old,) = _row(self.read_holding_registers, address, 1)
        _call(self.write_registers, address, (combined.masked(old, and_mask, or_mask),))
        return combined.MaskWriteRegisterResponse(address, and_mask, or_mask)

    def _read_write_multiple_registers(self, request: combined.ReadWriteMultipleRegisters) -> Response:
        _call(self.write_registers, request.write_address, request.registers)
        row = _row(self.read_holding_registers, request.read_address, request.read_quantity)
        return combined.ReadWriteMultipleRegistersResponse(row)

    def _read_file_record(self, request: files.ReadFileRecord) -> Response:
        groups = [_exactly(place[2], _call(self.read_file, *place)) for place in request.places]
        return files.ReadFileRecordResponse(tuple(groups))

    def _write_file_record(self, request: files.WriteFileRecord) -> Response:
        for record in request.records:
            _call(self.write_file, *record)
        return files.WriteFileRecordResponse(request.records)

    def _read_fifo_queue(self, request: ReadFifoQueue) -> Response:
        return ReadFifoQueueResponse(tuple(_call(self.read_queue, request.address)))

    def _read_exception_status(self, request: ReadExceptionStatus) -> Response:
        return ReadExceptionStatusResponse(_call(self.read_exception_status))

    def _report_server_id(self, request: ReportServerId) -> Response:
        return ReportServerIdResponse(_call(self.report_server_id))

    def _read_device_identification(self, request: ReadDeviceIdentification) -> Response:
        assert self.identity is not None, "`supports` was checked before"
        return self.identity.answer(request)


class _Answer(NamedTuple):
    """How one request class is answered: the fields of `Functions` that are needed, and the method."""

    needs: tuple[str, ...]
    answer: Callable[[Functions, Any], Response]


_BOTH = ("read_holding_registers", "write_registers")
_ANSWERS: dict[type[Request[Any]], _Answer] = {
    coils.ReadCoils: _Answer(("read_coils",), Functions._read_coils),
    coils.ReadDiscreteInputs: _Answer(("read_discrete_inputs",), Functions._read_discrete_inputs),
    coils.WriteSingleCoil: _Answer(("write_coils",), Functions._write_single_coil),
    coils.WriteMultipleCoils: _Answer(("write_coils",), Functions._write_multiple_coils),
    registers.ReadHoldingRegisters: _Answer(("read_holding_registers",), Functions._read_holding_registers),
    registers.ReadInputRegisters: _Answer(("read_input_registers",), Functions._read_input_registers),
    registers.WriteSingleRegister: _Answer(("write_registers",), Functions._write_single_register),
    registers.WriteMultipleRegisters: _Answer(("write_registers",), Functions._write_multiple_registers),
    combined.MaskWriteRegister: _Answer(_BOTH, Functions._mask_write_register),
    combined.ReadWriteMultipleRegisters: _Answer(_BOTH, Functions._read_write_multiple_registers),
    files.ReadFileRecord: _Answer(("read_file",), Functions._read_file_record),
    files.WriteFileRecord: _Answer(("write_file",), Functions._write_file_record),
    ReadFifoQueue: _Answer(("read_queue",), Functions._read_fifo_queue),
    ReadExceptionStatus: _Answer(("read_exception_status",), Functions._read_exception_status),
    ReportServerId: _Answer(("report_server_id",), Functions._report_server_id),
    ReadDeviceIdentification: _Answer(("identity",), Functions._read_device_identification),
}
_FUNCTIONS = sorted({name for answer in _ANSWERS.values() for name in answer.needs} - {"identity"})


def _call(function: Callable[..., Any] | None, *values: Any) -> Any:
    assert function is not None, "`supports` was checked before"
    return function(*values)


def _row(function: Callable[[int, int], Sequence[Any]] | None, address: int, quantity: int) -> tuple[Any, ...]:
    return _exactly(quantity, _call(function, address, quantity))


def _exactly(quantity: int, row: Sequence[Any]) -> tuple[Any, ...]:
    """Return the row. Raises EncodeError unless it has as many values as were asked for."""
    if len(row) != quantity:
        raise EncodeError(f"a function returned {len(row)} values where {quantity} were asked", "quantity")
    return tuple(row)
