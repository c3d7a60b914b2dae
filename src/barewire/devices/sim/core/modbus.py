"""The Modbus adapter of a simulated machine: a `barewire.modbus.server.server.Unit` over the images of its store.

        request -> function code known here?  -> quantity within the device's limits? -> image -> response
                     no: 01                        no: 03                                 02, 03, 04

The description states in `read_functions` and `write_functions` which function code reaches which parameters. A machine
with other rules overrides `images`, a machine with function codes of its own overrides `other`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from barewire.devices.device import ModbusSettings
from barewire.devices.sim.core.machine import SimulatedMachine
from barewire.devices.sim.core.register_image import RegisterImage
from barewire.devices.sim.core.store import Cell, Declined, DeclineReason
from barewire.modbus.exceptions import (
    ILLEGAL_DATA_ADDRESS,
    ILLEGAL_DATA_VALUE,
    ILLEGAL_FUNCTION,
    SERVER_DEVICE_FAILURE,
    ModbusException,
)
from barewire.modbus.messages import coils as bits, registers
from barewire.modbus.messages.base import Response

_EXCEPTION_CODES: dict[DeclineReason, int] = {
    "place": ILLEGAL_DATA_ADDRESS,
    "value": ILLEGAL_DATA_VALUE,
    "signature": ILLEGAL_DATA_VALUE,
    "state": SERVER_DEVICE_FAILURE,
}


class ModbusAdapter:
    """Answers requests from the store of a machine. `reads` and `writes` are the images by function code."""

    diagnostics = False  # function 08 gets exception 01 from these machines, also on a serial line

    def __init__(self, machine: SimulatedMachine, settings: ModbusSettings) -> None:
        self.machine = machine
        self.settings = settings
        self.reads: dict[int, RegisterImage] = {}
        self.writes: dict[int, RegisterImage] = {}
        self.images()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.machine!r}>"

    def images(self) -> None:
        """Fill `reads` and `writes` from the description."""
        for code in set(self.settings.read_functions.values()):
            tables = {table for table, function in self.settings.read_functions.items() if function == code}
            self.reads[code] = self.image(cell for cell in self.cells(*tables) if cell.parameter.readable)
        for table, functions in self.settings.write_functions.items():
            image = self.image(cell for cell in self.cells(table) if cell.parameter.writable)
            self.writes |= dict.fromkeys(functions, image)

    def image(self, cells: Iterable[Cell]) -> RegisterImage:
        """Return an image of these cells."""
        return RegisterImage(self.machine.store, cells)

    def cells(self, *tables: str) -> list[Cell]:
        """Return the cells that lie in these tables."""
        return [cell for cell in self.machine.store if cell.parameter.modbus and cell.parameter.modbus.table in tables]

    def handle(self, request: Any, now: float) -> Response | None:
        """Let time pass, then answer. Raises ModbusException where the machine declines; None: no answer is sent."""
        self.machine.tick(now)
        try:
            return self.answer(request)
        except Declined as declined:
            raise ModbusException(_EXCEPTION_CODES[declined.reason]) from declined

    def answer(self, request: Any) -> Response | None:
        """Answer a request for registers or coils; all other requests go to `other`."""
        code = request.function_code
        match request:
            # ReadDiscreteInputs is a ReadCoils and ReadInputRegisters a ReadHoldingRegisters: one row for each pair.
            case bits.ReadCoils(address, quantity):
                row = self._read(code, address, quantity, bits.READ_COILS_LIMIT)
                response = bits.ReadCoilsResponse if code == 0x01 else bits.ReadDiscreteInputsResponse
                return response(tuple(map(bool, row)))
            case registers.ReadHoldingRegisters(address, quantity):
                words = self._read(code, address, quantity, self.settings.read_limit)
                if code == 0x03:
                    return registers.ReadHoldingRegistersResponse(words)
                return registers.ReadInputRegistersResponse(words)
            case bits.WriteSingleCoil(address, on):
                self._write(code, address, (int(on),), 1)
                return bits.WriteSingleCoilResponse(address, on)
            case bits.WriteMultipleCoils(address, row_of_bits):
                self._write(code, address, tuple(map(int, row_of_bits)), bits.WRITE_COILS_LIMIT)
                return bits.WriteMultipleCoilsResponse(address, len(row_of_bits))
            case registers.WriteSingleRegister(address, value):
                self._write(code, address, (value,), 1)
                return registers.WriteSingleRegisterResponse(address, value)
            case registers.WriteMultipleRegisters(address, values):
                self._write(code, address, tuple(values), self.settings.write_limit)
                return registers.WriteMultipleRegistersResponse(address, len(values))
        return self.other(request)

    def other(self, request: Any) -> Response | None:
        """Answer a function code for anything but registers and coils; a plain device answers exception 01."""
        raise ModbusException(ILLEGAL_FUNCTION)

    def _read(self, code: int, address: int, quantity: int, limit: int) -> tuple[int, ...]:
        image = self.reads.get(code)
        if image is None:
            raise ModbusException(ILLEGAL_FUNCTION)
        if quantity > limit:
            raise ModbusException(ILLEGAL_DATA_VALUE)
        return image.read(address, quantity)

    def _write(self, code: int, address: int, words: tuple[int, ...], limit: int) -> None:
        image = self.writes.get(code)
        if image is None:
            raise ModbusException(ILLEGAL_FUNCTION)
        if len(words) > limit:
            raise ModbusException(ILLEGAL_DATA_VALUE)
        image.write(address, words)
