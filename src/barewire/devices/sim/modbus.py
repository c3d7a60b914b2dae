"""The Modbus adapter of a simulated machine: a `barewire.modbus.server.server.Unit` over the images of its store.

        request -> function code known here?  -> quantity within the device's limits? -> image -> response
                     no: 01                        no: 03                                 02, 03, 04

The description states in `read_functions` and `write_functions` which function code reaches which parameters. A machine
with other rules overrides `images`, a machine with function codes of its own overrides `other`.

An image is the rows of registers or coils that one function code reaches, composed of cells when they are read:

        address        16         17         18
        register    [  u32 .....  .... ] [ u8 H | u8 L ]
        cells          A (word 0) A (word 1)   B | C

An image stores nothing, so two function codes that reach one cell return one value. Rules where a manual has none:

* A register or coil that no parameter occupies does not exist: exception 02, also for a gap inside a row. Registers in
  `gaps` belong to no parameter either, but are read as 0 in a request that also reads a parameter.
* Parameters that cannot be read are in no image for reading, those that cannot be written in none for writing:
  exception 02.
* A request is carried out completely or not at all: everything is checked before anything is stored.
* A value of several registers takes effect when its last register is written (CSD MT manual, ch. 10: "when the writing
  of the second part of it is concluded"). Until then reads return the old value.
* Where several parameters share one register (the commands of the ADXL), the first that accepts the value takes it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any, NamedTuple

from barewire.codecs import Value
from barewire.devices.device import ModbusSettings
from barewire.devices.sim.store import Cell, Declined, DeclineReason, MachineStore, SimulatedMachine
from barewire.errors import DecodeError
from barewire.modbus.exceptions import (
    ILLEGAL_DATA_ADDRESS,
    ILLEGAL_DATA_VALUE,
    ILLEGAL_FUNCTION,
    SERVER_DEVICE_FAILURE,
    ModbusException,
)
from barewire.modbus.messages import coils as bits, registers
from barewire.modbus.messages.base import Response


class CellWord(NamedTuple):
    """The part of a cell that lies at one address: register number `word` of its `words`, or a part of a register."""

    cell: Cell
    word: int
    words: int
    partial: bool


class RegisterImage:
    """The cells that one function code reaches, by address. Coils count as registers that hold 0 or 1."""

    def __init__(self, store: MachineStore, cells: Iterable[Cell], gaps: Collection[int] = ()) -> None:
        self.store, self.gaps = store, gaps
        self.words: dict[int, list[CellWord]] = {}
        self._waiting: dict[str, dict[int, int]] = {}
        """The registers that were written of values whose last register was not: by cell and register number."""
        for cell in cells:
            place = cell.parameter.modbus
            if place is not None:
                for word in range(place.words):
                    entry = CellWord(cell, word, place.words, place.partial)
                    self.words.setdefault(place.address + word, []).append(entry)

    def _at(self, address: int) -> list[CellWord]:
        if address not in self.words:
            raise Declined("place", f"nothing is described at address {address}")
        return self.words[address]

    def read(self, address: int, quantity: int) -> tuple[int, ...]:
        """Read `quantity` registers; raises Declined. Each value is read once, so its words belong together."""
        addresses = range(address, address + quantity)
        rows = [[] if number in self.gaps else self._at(number) for number in addresses]
        if not any(rows):
            raise Declined("place", f"nothing is described at address {address}")
        values: dict[str, tuple[int, ...]] = {}
        words = []
        for row in rows:
            if not row:
                words.append(0)
                continue
            first = row[0]
            if first.partial:
                word = 0
                for entry in row:
                    if entry.partial:
                        (word,) = self.store.registers(entry.cell, (word,))
                words.append(word)
            else:
                name = first.cell.name
                if name not in values:
                    values[name] = self.store.registers(first.cell)
                words.append(values[name][first.word])
        return tuple(words)

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write registers, all or none: raises Declined if an address does not exist or a value is not accepted."""
        rows = [self._at(address + offset) for offset in range(len(words))]
        waiting: dict[str, dict[int, int]] = {}
        commits: list[tuple[Cell, Value]] = []
        for row, word in zip(rows, words):
            first, cell = row[0], row[0].cell
            if first.partial:
                commits += [(entry.cell, self._checked(entry.cell, [word])) for entry in row if entry.partial]
            elif first.words == 1:
                sharing = [entry.cell for entry in row if entry.words == 1 and not entry.partial]
                commits.append(self._first_to_accept(sharing, word))
            else:
                parts = waiting.setdefault(cell.name, dict(self._waiting.get(cell.name, {})))
                parts[first.word] = word
                if first.word == first.words - 1:
                    # A register that was not written keeps its present word.
                    present = self.store.registers(cell)
                    merged = [parts.get(number, present[number]) for number in range(first.words)]
                    commits.append((cell, self._checked(cell, merged)))
                    parts.clear()
        # Nothing was declined: from here on the request takes effect.
        self._waiting |= waiting
        for cell, value in commits:
            cell.put(value)

    def _checked(self, cell: Cell, words: Sequence[int]) -> Value:
        try:
            value = self.store.value(cell, words)
        except DecodeError as error:
            raise Declined("value", str(error)) from None
        cell.check(value)
        return value

    def _first_to_accept(self, cells: Sequence[Cell], word: int) -> tuple[Cell, Value]:
        declined: Declined | None = None
        for cell in cells:
            try:
                return cell, self._checked(cell, [word])
            except Declined as error:
                # A veto is about this command; a value out of range may be the command of another parameter.
                if error.reason != "value":
                    raise
                declined = declined or error
        assert declined is not None
        raise declined


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
