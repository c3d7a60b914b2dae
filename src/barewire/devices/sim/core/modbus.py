"""The Modbus side of a simulated machine: a `barewire.modbus.server.server.Unit` over the images of its store.

        request -> function code known here?  -> quantity within the device's limits? -> image -> response
                     no: 01                        no: 03                                 02, 03, 04

Which function code reaches which parameters is what the description says in `read_functions` and `write_functions`; a
machine with other habits overrides `images`, one with function codes of its own `other`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from barewire.devices.device import ModbusSettings
from barewire.devices.sim.core.register_image import Image
from barewire.devices.sim.core.store import Cell, Declined, Why
from barewire.modbus.exceptions import (
    ILLEGAL_DATA_ADDRESS,
    ILLEGAL_DATA_VALUE,
    ILLEGAL_FUNCTION,
    SERVER_DEVICE_FAILURE,
    ModbusException,
)
from barewire.modbus.messages import coils as bits, registers
from barewire.modbus.messages.base import Response

if TYPE_CHECKING:
    from barewire.devices.sim.core.simulator import Simulator

CODES: dict[Why, int] = {
    "place": ILLEGAL_DATA_ADDRESS,
    "value": ILLEGAL_DATA_VALUE,
    "state": SERVER_DEVICE_FAILURE,
}
"""How a refusal is said on Modbus."""


class ModbusAdapter:
    """Answers requests out of a store. `reads` and `writes` are the images by function code."""

    diagnostics = False  # a machine without function 08 says so, also on a serial line

    def __init__(self, machine: Simulator, side: ModbusSettings) -> None:
        self.machine = machine
        self.side = side
        self.reads: dict[int, Image] = {}
        self.writes: dict[int, Image] = {}
        self.images()

    def images(self) -> None:
        """Fill `reads` and `writes` from the description."""
        for code in set(self.side.read_functions.values()):
            tables = {table for table, function in self.side.read_functions.items() if function == code}
            self.reads[code] = self.image(cell for cell in self.cells(*tables) if cell.parameter.readable)
        for table, functions in self.side.write_functions.items():
            image = self.image(cell for cell in self.cells(table) if cell.parameter.writable)
            self.writes |= dict.fromkeys(functions, image)

    def image(self, cells: Iterable[Cell]) -> Image:
        """An image of these cells."""
        return Image(self.machine.store, cells)

    def cells(self, *tables: str) -> list[Cell]:
        """The cells that lie in these tables."""
        return [cell for cell in self.machine.store if cell.parameter.modbus and cell.parameter.modbus.table in tables]

    def handle(self, request: Any, now: float) -> Response | None:
        """Let time pass, then answer. ModbusException is how the machine declines; None is silence."""
        self.machine.tick(now)
        try:
            return self.answer(request)
        except Declined as declined:
            raise ModbusException(CODES[declined.why]) from declined

    def answer(self, request: Any) -> Response | None:
        """The response to a request for registers or coils; everything else goes to `other`."""
        code = request.function_code
        match request:
            # ReadDiscreteInputs is a ReadCoils and ReadInputRegisters a ReadHoldingRegisters: one row for each pair.
            case bits.ReadCoils(address, quantity):
                row = self._read(code, address, quantity, bits.READ_COILS_LIMIT)
                kind = bits.ReadCoilsResponse if code == 0x01 else bits.ReadDiscreteInputsResponse
                return kind(tuple(map(bool, row)))
            case registers.ReadHoldingRegisters(address, quantity):
                words = self._read(code, address, quantity, self.side.read_limit)
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
                self._write(code, address, tuple(values), self.side.write_limit)
                return registers.WriteMultipleRegistersResponse(address, len(values))
        return self.other(request)

    def other(self, request: Any) -> Response | None:
        """A function code that is about no register: none in a plain device."""
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
