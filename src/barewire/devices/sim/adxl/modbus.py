"""The Modbus side of the ADXL: its function codes, and the two reads that do more than read.   [ADXL addendum]

        03, 04   measures (table 2)         04 alone   settings and events         06   writes
        07       eight bits of state        17 (11h)   who the starter is          all else: exception 01

The text of an event, 28 registers from 5032h, is read "with a single function 04", and the index moves on after it.
While the starter reboots everything is exception 06; what made it reboot is not answered.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from barewire.devices.sim.core.modbus import ModbusAdapter
from barewire.modbus.exceptions import ILLEGAL_DATA_VALUE, ILLEGAL_FUNCTION, SERVER_DEVICE_BUSY, ModbusException
from barewire.modbus.messages.base import Response
from barewire.modbus.messages.diagnostics import ReadExceptionStatus, ReadExceptionStatusResponse
from barewire.modbus.messages.identification import ReportServerId, ReportServerIdResponse
from barewire.modbus.messages.registers import ReadInputRegisters

if TYPE_CHECKING:
    from barewire.devices.sim.adxl.machine import Adxl

IDENTITY = bytes((1, 2, 0, 0, 5, 0, 0, 0))
"""Function 17: an ADXL0030600 (1), software revision 2, of the ADXL series (5), as in the example."""

FIRST_SETTING = 0x4FFF
"""From this wire address on (printed 5000h) only function 04 reads."""

EVENT_TEXT = 0x5031


class AdxlModbusAdapter(ModbusAdapter):
    """03, 04, 06, 07 and 17 (hexadecimal 11), and silence while it reboots."""

    machine: Adxl

    def images(self) -> None:
        """03 reaches the measures of table 2, 04 everything that can be read."""
        super().images()
        self.reads[0x03] = self.image(
            cell
            for cell in self.cells("input")
            if cell.parameter.modbus and cell.parameter.modbus.address < FIRST_SETTING
        )

    def handle(self, request: Any, now: float) -> Response | None:
        """Busy while it reboots; and the request that makes it reboot is not answered (parameter setting, step 4)."""
        self.machine.tick(now)
        if self.machine.now < self.machine.reboots_until:
            raise ModbusException(SERVER_DEVICE_BUSY)
        response = super().handle(request, now)
        return None if self.machine.now < self.machine.reboots_until else response

    def answer(self, request: Any) -> Response | None:
        """The text of an event is read whole, "with a single function 04", and the index moves on after it."""
        match request:
            case ReadInputRegisters(address, quantity) if self._touches_text(address, quantity):
                if (address, quantity) != (EVENT_TEXT, 28):
                    raise ModbusException(ILLEGAL_DATA_VALUE)
                response = super().answer(request)
                self.machine.events.index += 1
                return response
        return super().answer(request)

    @staticmethod
    def _touches_text(address: int, quantity: int) -> bool:
        return EVENT_TEXT <= address < EVENT_TEXT + 28 or address < EVENT_TEXT < address + quantity

    def other(self, request: Any) -> Response | None:
        """Functions 07 and 17."""
        match request:
            case ReadExceptionStatus():
                return ReadExceptionStatusResponse(self.machine.exception_status())
            case ReportServerId():
                return ReportServerIdResponse(IDENTITY)
        raise ModbusException(ILLEGAL_FUNCTION)
