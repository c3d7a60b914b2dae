"""The Modbus adapter of the ADXL: its function codes, and reads with an effect.                  [ADXL addendum]

        03, 04   measures (table 2)         04 alone   settings and events         06   writes
        07       eight bits of state        17 (11h)   identity                    all others: exception 01

The text of an event, 28 registers from 5032h, is read "with a single function 04", and the index moves on after it.
The example of function 04 reads 10h to 17h, of which table 2 has only 14h to 17h, and 16 bytes come. So here a register
between two measures of one page (0xxh, Fxxh, 1Bxxh, 21xxh) is read as 0. For a request with no measure in it, or with
a register before the first or behind the last measure of a page, the answer is exception 02, "if the measure address is
not included in the table". The pages, and the 0 in each of these registers, are decided here.

While the starter reboots every answer is exception 06; the request that starts the reboot gets no answer.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

from barewire.devices.device import ModbusSettings
from barewire.devices.sim.adxl.menus import EventList
from barewire.devices.sim.core.machine import SimulatedMachine
from barewire.devices.sim.core.modbus import ModbusAdapter
from barewire.modbus.exceptions import ILLEGAL_DATA_VALUE, ILLEGAL_FUNCTION, SERVER_DEVICE_BUSY, ModbusException
from barewire.modbus.messages.base import Response
from barewire.modbus.messages.diagnostics import ReadExceptionStatus, ReadExceptionStatusResponse
from barewire.modbus.messages.identification import ReportServerId, ReportServerIdResponse
from barewire.modbus.messages.registers import ReadInputRegisters

_SERVER_ID = bytes((1, 2, 0, 0, 5, 0, 0, 0))
"""Function 17: an ADXL0030600 (1), software revision 2, of the ADXL series (5), as in the example of the manual."""

_FIRST_SETTING = 0x4FFF
"""From this wire address on (printed 5000h) only function 04 reads."""

_EVENT_TEXT = 0x5031
_EVENT_REGISTERS = 28


class Starter(SimulatedMachine, Protocol):
    """The part of the soft starter that this adapter uses."""

    events: EventList
    reboots_until: float

    def exception_status(self) -> int:
        """Return the byte of function 07."""


class AdxlModbusAdapter(ModbusAdapter):
    """03, 04, 06, 07 and 17 (hexadecimal 11); exception 06 while the starter reboots."""

    def __init__(self, starter: Starter, settings: ModbusSettings) -> None:
        super().__init__(starter, settings)
        self.starter = starter

    def images(self) -> None:
        """Let function 03 read the measures of table 2, and 04 everything that can be read."""
        super().images()
        measures = [
            cell
            for cell in self.cells("input")
            if cell.parameter.modbus and cell.parameter.modbus.address < _FIRST_SETTING
        ]
        self.reads[0x03] = self.image(measures)
        self.reads[0x03].gaps = self.reads[0x04].gaps = _gaps(self.reads[0x03].words)

    def handle(self, request: Any, now: float) -> Response | None:
        """Handle a request: exception 06 during a reboot, no answer to the one that starts it (settings, step 4)."""
        self.starter.tick(now)
        if self._is_rebooting:
            raise ModbusException(SERVER_DEVICE_BUSY)
        response = super().handle(request, now)
        return None if self._is_rebooting else response

    @property
    def _is_rebooting(self) -> bool:
        return self.starter.clock.now < self.starter.reboots_until

    def answer(self, request: Any) -> Response | None:
        """Answer like `ModbusAdapter`, but an event's text is only read as a whole, and the index moves on after it."""
        match request:
            case ReadInputRegisters(address, quantity) if self._touches_text(address, quantity):
                if (address, quantity) != (_EVENT_TEXT, _EVENT_REGISTERS):
                    raise ModbusException(ILLEGAL_DATA_VALUE)
                response = super().answer(request)
                self.starter.events.index += 1
                return response
        return super().answer(request)

    @staticmethod
    def _touches_text(address: int, quantity: int) -> bool:
        return address < _EVENT_TEXT + _EVENT_REGISTERS and address + quantity > _EVENT_TEXT

    def other(self, request: Any) -> Response | None:
        """Answer functions 07 and 17."""
        match request:
            case ReadExceptionStatus():
                return ReadExceptionStatusResponse(self.starter.exception_status())
            case ReportServerId():
                return ReportServerIdResponse(_SERVER_ID)
        raise ModbusException(ILLEGAL_FUNCTION)


def _gaps(measures: Iterable[int]) -> frozenset[int]:
    """Return the wire addresses between the measures of each page of table 2, as the manual prints its addresses."""
    pages: dict[int, list[int]] = {}
    for address in sorted(measures):
        pages.setdefault((address + 1) >> 8, []).append(address)
    return frozenset(number for page in pages.values() for number in range(page[0], page[-1])).difference(measures)
