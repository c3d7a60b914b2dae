"""A ready unit: four tables in memory, and nothing behind them. What most gateways and all first experiments need.

coils              read and write    01 05 0F          discrete inputs    read only    02
holding registers  read and write    03 06 10          input registers    read only    04
"""

from __future__ import annotations

from array import array
from typing import Any

from barewire.modbus import bits, registers
from barewire.modbus.exceptions import ILLEGAL_DATA_ADDRESS, ILLEGAL_FUNCTION, ModbusException
from barewire.modbus.identification import (
    BASIC,
    INDIVIDUAL,
    SINGLE_ACCESS,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
    ReportServerId,
    ReportServerIdResponse,
)
from barewire.modbus.message import Response

SIZE = 0x10000


class Table:
    """`size` entries of each kind, all zero, addressed from 0. Anything beyond is exception 02.

    >>> table = Table()
    >>> table.handle(registers.WriteSingleRegister(5, 42), now=0.0)
    WriteSingleRegisterResponse(address=5, value=42)
    >>> table.handle(registers.ReadHoldingRegisters(4, 2), now=0.0)
    ReadHoldingRegistersResponse(registers=(0, 42))
    """

    def __init__(self, size: int = SIZE, *, vendor: str = "barewire", product: str = "table") -> None:
        self.size = size
        self.coils = bytearray(size)
        self.discrete_inputs = bytearray(size)
        self.holding_registers = array("H", bytes(2 * size))
        self.input_registers = array("H", bytes(2 * size))
        self.identity = ((0, vendor.encode()), (1, product.encode()), (2, b"1"))
        # Said once here, so that names too long for a PDU are refused now and not when somebody asks.
        self._identify(BASIC, 0).encode()

    def _identify(self, code: int, object_id: int) -> ReadDeviceIdentificationResponse:
        """One object, or the stream of them from `object_id` on; from 0 if there is none of that id [MB-APP 6.21]."""
        known = [number for number, _ in self.identity]
        if object_id not in known:
            if code == INDIVIDUAL:
                raise ModbusException(ILLEGAL_DATA_ADDRESS)
            object_id = 0
        first = known.index(object_id)
        objects = self.identity[first : first + 1] if code == INDIVIDUAL else self.identity[first:]
        return ReadDeviceIdentificationResponse(code, BASIC | SINGLE_ACCESS, objects)

    def _span(self, address: int, quantity: int) -> slice:
        if address + quantity > self.size:
            raise ModbusException(ILLEGAL_DATA_ADDRESS)
        return slice(address, address + quantity)

    def handle(self, request: Any, now: float) -> Response | None:
        """Answer one request; ModbusException 01 for what a table cannot do, 02 beyond its end."""
        match request:
            # ReadDiscreteInputs is a ReadCoils and ReadInputRegisters a ReadHoldingRegisters, so these come first.
            case bits.ReadDiscreteInputs(address, quantity):
                row = self.discrete_inputs[self._span(address, quantity)]
                return bits.ReadDiscreteInputsResponse(tuple(map(bool, row)))
            case bits.ReadCoils(address, quantity):
                return bits.ReadCoilsResponse(tuple(map(bool, self.coils[self._span(address, quantity)])))
            case registers.ReadInputRegisters(address, quantity):
                return registers.ReadInputRegistersResponse(tuple(self.input_registers[self._span(address, quantity)]))
            case registers.ReadHoldingRegisters(address, quantity):
                row_of = self.holding_registers[self._span(address, quantity)]
                return registers.ReadHoldingRegistersResponse(tuple(row_of))
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
            case ReportServerId():
                return ReportServerIdResponse(b"\x01\xff" + self.identity[1][1])
            case ReadDeviceIdentification(code, object_id):
                return self._identify(code, object_id)
        raise ModbusException(ILLEGAL_FUNCTION)
