"""A unit with coils, discrete inputs, holding and input registers in memory: the `Table` of the small edition.

It answers 01 to 06, 0F, 10, 16 and 17, as far as the edition has their messages; any other function is exception 01.
The table of the whole stack has queues, files and identification as well, and checks what a program gives it.
"""

from array import array

from barewire.errors import EncodeError
from barewire.modbus.exceptions import ModbusException

_NAMES = {0x01: "coils", 0x02: "discrete_inputs", 0x03: "holding_registers", 0x04: "input_registers"}


class Block:
    """Values by their address, in one row or several. `kind` is the form of a register, H, or of a coil, B."""

    def __init__(self, kind, rows):
        if not isinstance(rows, dict):
            rows = {0: rows}
        self._rows = []
        for first, values in sorted(rows.items()):
            before = self._rows[-1] if self._rows else None
            if before is not None and before[0] + len(before[1]) == first:  # they are one row
                before[1].extend(array(kind, values))
            else:
                self._rows.append((first, array(kind, values)))

    def _place(self, address, quantity):
        for first, row in self._rows:
            if first <= address and address + quantity <= first + len(row):
                return row, address - first
        raise ModbusException(2)

    def read(self, address, quantity):
        row, at = self._place(address, quantity)
        return row[at : at + quantity]

    def write(self, address, values):
        row, at = self._place(address, len(values))
        for value in values:
            row[at] = value
            at += 1

    def __getitem__(self, place):
        if isinstance(place, slice):
            return self.read(place.start, place.stop - place.start)
        return self.read(place, 1)[0]

    def __setitem__(self, place, value):
        if isinstance(place, slice):
            if len(value) != place.stop - place.start:
                raise EncodeError("another number of values than addresses")
            self.write(place.start, value)
        else:
            self.write(place, (value,))


class Table:
    """A unit of a server. `on_write(name, address, values)` and `on_read(name, address, quantity)` may decline.

    size        the number of values, all 0, in each table that is not given (default 0)
    coils, ...  a list from address 0 on, or a dict: first address -> list
    read_only   table -> addresses that clients cannot write
    """

    def __init__(self, size=0, coils=None, discrete_inputs=None, holding_registers=None, input_registers=None,
                 read_only=None, on_write=None, on_read=None, **_):  # fmt: skip
        zeros = [0] * size
        self.coils = Block("B", zeros if coils is None else coils)
        self.discrete_inputs = Block("B", zeros if discrete_inputs is None else discrete_inputs)
        self.holding_registers = Block("H", zeros if holding_registers is None else holding_registers)
        self.input_registers = Block("H", zeros if input_registers is None else input_registers)
        self.on_write = on_write
        self.on_read = on_read
        self._read_only = read_only or {}

    @staticmethod
    def supports(request):
        return request.function_code in (1, 2, 3, 4, 5, 6, 15, 16, 22, 23)

    def handle(self, request, now):
        code = request.function_code
        response = request.response
        if code in (1, 2):
            return response(tuple(map(bool, self._read(_NAMES[code], request.address, request.quantity))))
        if code in (3, 4):
            return response(tuple(self._read(_NAMES[code], request.address, request.quantity)))
        if code == 5:
            self._write("coils", request.address, (int(request.value),))
            return response(request.address, request.value)
        if code == 6:
            self._write("holding_registers", request.address, (request.value,))
            return response(request.address, request.value)
        if code == 15:
            self._write("coils", request.address, tuple(map(int, request.bits)))
            return response(request.address, request.quantity)
        if code == 16:
            self._write("holding_registers", request.address, request.registers)
            return response(request.address, request.quantity)
        if code == 22:
            old = self.holding_registers.read(request.address, 1)[0]
            new = old & request.and_mask | request.or_mask & ~request.and_mask & 0xFFFF
            self._write("holding_registers", request.address, (new,))
            return response(request.address, request.and_mask, request.or_mask)
        if code == 23:
            self.holding_registers.read(request.read_address, request.read_quantity)
            self._write("holding_registers", request.write_address, request.registers)
            return response(tuple(self._read("holding_registers", request.read_address, request.read_quantity)))
        raise ModbusException(1)

    def _read(self, name, address, quantity):
        block = getattr(self, name)
        block.read(address, quantity)
        if self.on_read is not None:
            self.on_read(name, address, quantity)
        return block.read(address, quantity)

    def _write(self, name, address, values):
        block = getattr(self, name)
        before = block.read(address, len(values))
        if any(address <= place < address + len(values) for place in self._read_only.get(name, ())):
            raise ModbusException(2)
        block.write(address, values)
        if self.on_write is not None:
            try:
                self.on_write(name, address, values)
            except BaseException:
                block.write(address, before)
                raise
