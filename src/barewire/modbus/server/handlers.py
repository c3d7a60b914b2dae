"""A unit made of plain functions: for a program that has the values somewhere else than in a table.

Functions(read_holding_registers=lambda address, quantity: sensor[address : address + quantity])
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

from barewire.errors import EncodeError
from barewire.modbus.exceptions import ILLEGAL_FUNCTION, ModbusException
from barewire.modbus.messages import coils as bits, combined, files, registers
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

# Which functions a request needs.
_NEEDS: dict[type[Request[Any]], tuple[str, ...]] = {
    bits.ReadCoils: ("read_coils",),
    bits.ReadDiscreteInputs: ("read_discrete_inputs",),
    bits.WriteSingleCoil: ("write_coils",),
    bits.WriteMultipleCoils: ("write_coils",),
    registers.ReadHoldingRegisters: ("read_holding_registers",),
    registers.ReadInputRegisters: ("read_input_registers",),
    registers.WriteSingleRegister: ("write_registers",),
    registers.WriteMultipleRegisters: ("write_registers",),
    combined.MaskWriteRegister: ("read_holding_registers", "write_registers"),
    combined.ReadWriteMultipleRegisters: ("read_holding_registers", "write_registers"),
    files.ReadFileRecord: ("read_file",),
    files.WriteFileRecord: ("write_file",),
    ReadFifoQueue: ("read_queue",),
    ReadExceptionStatus: ("read_exception_status",),
    ReportServerId: ("report_server_id",),
    ReadDeviceIdentification: ("identity",),
}


@dataclass(slots=True)
class Functions:
    """Plain functions as a unit: what is not given is exception 01.

    >>> unit = Functions(read_holding_registers=lambda address, quantity: [address + at for at in range(quantity)])
    >>> unit.handle(registers.ReadHoldingRegisters(40, 3), now=0.0)
    ReadHoldingRegistersResponse(registers=(40, 41, 42))

    A function raises `ModbusException(2)` for an address that it does not have. Anything else it raises, a result of
    the wrong length, and a value that does not fit are its own failure: the client gets exception 04, and the reason
    stands in `statistics.failures` of the server. Single and multiple writes arrive at the same function; 16 and 17 are
    made of a read and a write. `own` answers function codes of your own, by request class.
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

    def supports(self, request: type[Request[Any]]) -> bool:
        """Whether the functions that this request needs were given."""
        needs = _NEEDS.get(request, ("",))
        return request in self.own or all(getattr(self, name, None) is not None for name in needs)

    def handle(self, request: Any, now: float) -> Response | None:
        """Call what was given for this request."""
        if type(request) in self.own:
            return self.own[type(request)](request)
        if not self.supports(type(request)):
            raise ModbusException(ILLEGAL_FUNCTION)
        match request:
            case bits.ReadCoils(address, quantity):
                read = self.read_discrete_inputs if request.function_code == 0x02 else self.read_coils
                return request.response(_row(read, address, quantity))  # type: ignore[call-arg]  # whichever response class it is
            case registers.ReadHoldingRegisters(address, quantity):
                read = self.read_input_registers if request.function_code == 0x04 else self.read_holding_registers
                return request.response(_row(read, address, quantity))  # type: ignore[call-arg]  # whichever response class it is
            case combined.ReadWriteMultipleRegisters(read_address, read_quantity, write_address, values):
                _call(self.write_registers, write_address, values)
                row = _row(self.read_holding_registers, read_address, read_quantity)
                return combined.ReadWriteMultipleRegistersResponse(row)
            case ReadFifoQueue(address):
                return ReadFifoQueueResponse(tuple(_call(self.read_queue, address)))
            case files.ReadFileRecord(places):
                groups = [_exactly(place[2], _call(self.read_file, *place)) for place in places]
                return files.ReadFileRecordResponse(tuple(groups))
            case ReadExceptionStatus():
                return ReadExceptionStatusResponse(_call(self.read_exception_status))
            case ReportServerId():
                return ReportServerIdResponse(_call(self.report_server_id))
            case ReadDeviceIdentification() if self.identity is not None:
                return self.identity.answer(request)
        return self._write(request)

    def _write(self, request: Any) -> Response | None:
        match request:
            case bits.WriteSingleCoil(address, on):
                _call(self.write_coils, address, (on,))
                return bits.WriteSingleCoilResponse(address, on)
            case bits.WriteMultipleCoils(address, row_of_bits):
                _call(self.write_coils, address, row_of_bits)
                return bits.WriteMultipleCoilsResponse(address, len(row_of_bits))
            case registers.WriteSingleRegister(address, value):
                _call(self.write_registers, address, (value,))
                return registers.WriteSingleRegisterResponse(address, value)
            case registers.WriteMultipleRegisters(address, values):
                _call(self.write_registers, address, values)
                return registers.WriteMultipleRegistersResponse(address, len(values))
            case combined.MaskWriteRegister(address, and_mask, or_mask):
                (old,) = _row(self.read_holding_registers, address, 1)
                _call(self.write_registers, address, (combined.masked(old, and_mask, or_mask),))
                return combined.MaskWriteRegisterResponse(address, and_mask, or_mask)
            case files.WriteFileRecord(records):
                for record in records:
                    _call(self.write_file, *record)
                return files.WriteFileRecordResponse(records)
        raise ModbusException(ILLEGAL_FUNCTION)


def _call(function: Callable[..., Any] | None, *values: Any) -> Any:
    assert function is not None, "supports() was asked before"
    return function(*values)


def _row(function: Callable[[int, int], Sequence[Any]] | None, address: int, quantity: int) -> tuple[Any, ...]:
    return _exactly(quantity, _call(function, address, quantity))


def _exactly(quantity: int, row: Sequence[Any]) -> tuple[Any, ...]:
    """The row, if it is as long as it was asked for."""
    if len(row) != quantity:
        raise EncodeError(f"a function returned {len(row)} values where {quantity} were asked", "quantity")
    return tuple(row)
