"""The registers and coils of an exchange as values of a device, with names and units.

    request   04 0FB1 0002            input registers 4017 and 4018
    response  04 04 00 00 01 10       00000110h, u32, 1/10 °C      Thyristors temperature = 27.2 °C

A parameter is named if all its registers are in the exchange. Registers without a parameter stay numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from barewire.devices.device import Device
from barewire.devices.parameter import Parameter, Reading, TableName
from barewire.errors import BarewireError
from barewire.modbus.messages import (
    ReadCoils,
    ReadHoldingRegisters,
    ReadWriteMultipleRegisters,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
)
from barewire.modbus.messages.base import EXCEPTION_BIT, Request, Response
from barewire.modbus.sniffer import RequestSeen, ResponseSeen

_SHOWN = 12
"""The most values in a line."""


class UnitNames:
    """The devices at the units of a line: `names` by unit, that of None for all other units.

    >>> from barewire.devices import load
    >>> UnitNames({None: RegisterNames(load("adxl"))})
    <UnitNames: adxl>
    """

    def __init__(self, names: Mapping[int | None, RegisterNames]) -> None:
        self._names = dict(names)

    def __repr__(self) -> str:
        found = (f"{f'{unit}: ' if unit is not None else ''}{names.device.name}" for unit, names in self._names.items())
        return f"<{type(self).__name__}: {', '.join(found)}>"

    def text(self, request: RequestSeen, response: ResponseSeen | None) -> str:
        """Return the values of an exchange as text; '' if none has a name, and for a refused request."""
        names = self._of(request)
        if names is None or _is_refused(response):
            return ""
        return names.text(request.message, None if response is None else response.message)

    def values(self, request: RequestSeen, response: ResponseSeen | None) -> list[dict[str, object]]:
        """Return the values of an exchange for `json.dumps`."""
        names = self._of(request)
        if names is None or _is_refused(response):
            return []
        return [
            {"name": found.name, "value": found.value, "unit": found.unit, "text": found.parameter.text(found.value)}
            for found in names.readings(request.message, None if response is None else response.message)
        ]

    def _of(self, request: RequestSeen) -> RegisterNames | None:
        return self._names.get(request.unit) or self._names.get(None)


def _is_refused(response: ResponseSeen | None) -> bool:
    return response is not None and bool(response.pdu[0] & EXCEPTION_BIT)


class RegisterRow(NamedTuple):
    """Registers or coils of one table that an exchange read or wrote, from `address` on."""

    tables: tuple[TableName, ...]
    address: int
    content: tuple[int, ...]
    written: bool


class RegisterNames:
    """The parameters of a device by their registers.

    >>> from barewire.devices import load
    >>> from barewire.modbus import ReadInputRegisters, ReadInputRegistersResponse
    >>> names = RegisterNames(load("adxl"))
    >>> names.text(ReadInputRegisters(0x0FB1, 2), ReadInputRegistersResponse((0, 272)))
    'Thyristors temperature = 27.2 °C'
    """

    def __init__(self, device: Device) -> None:
        self.device = device
        self._by_place: dict[tuple[TableName, int], list[Parameter]] = {}
        for parameter in device.parameters:
            if parameter.modbus is not None:
                self._by_place.setdefault((parameter.modbus.table, parameter.modbus.address), []).append(parameter)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.device.name}>"

    def readings(self, request: Request[Any] | None, response: Response | None) -> list[Reading]:
        """Return the values that the exchange read, then those that it wrote."""
        return [reading for row in self._rows(request, response) for reading in self._row_readings(row)[0]]

    def text(self, request: Request[Any] | None, response: Response | None) -> str:
        """Return the values as text, with the registers that have no name; '' if none has one."""
        parts: list[str] = []
        named = 0
        for row in self._rows(request, response):
            readings, left = self._row_readings(row)
            named += len(readings)
            parts += [f"{'set ' if row.written else ''}{reading}" for reading in readings]
            parts += [f"{address:04X}h: {value}" for address, value in left]
        if not named:
            return ""
        return ", ".join(parts if len(parts) <= _SHOWN else [*parts[:_SHOWN], "..."])

    def _row_readings(self, row: RegisterRow) -> tuple[list[Reading], list[tuple[int, int]]]:
        """Return the readings of a row, and the addresses and values that are in none of them."""
        readings: list[Reading] = []
        covered: set[int] = set()
        for offset in range(len(row.content)):
            for table in row.tables:
                for parameter in self._by_place.get((table, row.address + offset), ()):
                    place = parameter.modbus
                    assert place is not None
                    registers = row.content[offset : offset + place.words]
                    if len(registers) < place.words:
                        continue
                    try:
                        is_bit = table in ("coil", "discrete")
                        value = bool(registers[0]) if is_bit else parameter.from_registers(registers)
                    except BarewireError:
                        continue
                    readings.append(Reading(parameter, value))
                    covered.update(range(offset, offset + place.words))
        left = [(row.address + at, value) for at, value in enumerate(row.content) if at not in covered]
        return readings, left

    def _rows(self, request: Request[Any] | None, response: Response | None) -> Iterator[RegisterRow]:
        modbus = self.device.modbus
        if modbus is None or request is None:
            return
        reads: Mapping[TableName, int] = modbus.read_functions
        by_function = tuple(table for table, function in reads.items() if function == request.function_code)
        content: Sequence[int] = getattr(response, "registers", None) or getattr(response, "bits", None) or ()
        match request:
            case ReadCoils() | ReadHoldingRegisters():
                yield RegisterRow(by_function, request.address, tuple(content[: request.quantity]), False)
            case WriteSingleCoil() | WriteSingleRegister():
                table: TableName = "coil" if isinstance(request, WriteSingleCoil) else "holding"
                yield RegisterRow((table,), request.address, (int(request.value),), True)
            case WriteMultipleCoils():
                yield RegisterRow(("coil",), request.address, tuple(map(int, request.bits)), True)
            case WriteMultipleRegisters():
                yield RegisterRow(("holding",), request.address, tuple(request.registers), True)
            case ReadWriteMultipleRegisters():
                yield RegisterRow(("holding",), request.read_address, tuple(content), False)
                yield RegisterRow(("holding",), request.write_address, tuple(request.registers), True)
