"""The Modbus adapter of the ADXL: its function codes, and reads with an effect.                  [ADXL addendum]

        03, 04   measures (table 2)         04 alone   settings and events         06   writes
        07       eight bits of state        17 (11h)   identity                    all others: exception 01

The text of an event, 28 registers from 5032h, is read "with a single function 04", and the index moves on after it.
The example of function 04 reads 10h to 17h, of which table 2 has only 14h to 17h, and 16 bytes come. So here a register
between two measures of one page (0xxh, Fxxh, 1Bxxh, 21xxh) is read as 0. For a request with no measure in it, or with
a register before the first or behind the last measure of a page, the answer is exception 02, "if the measure address is
not included in the table". The pages, and the 0 in each of these registers, are decided here.

While the starter reboots every answer is exception 06; the request that starts the reboot gets no answer.

The memory of the ADXL: the parameters of its menus, and the list of events.                   [ADXL addendum]

        menu 5000h, sub-menu 5001h, parameter 5002h  --->  5004h  one value of P01.04, P08.01 ...

Simulated are the six parameters that the Modbus manual names; every other number is exception 02. Their ranges, and the
numbers for the choices of P08.02, P08.03 and P08.05, are not printed; here they count from 0 in the order of the list.
Only the acceleration time and the node address have an effect, the others are only stored.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple, Protocol

from barewire.devices.device import ModbusSettings
from barewire.devices.sim.core.machine import SimulatedMachine
from barewire.devices.sim.core.modbus import ModbusAdapter
from barewire.devices.sim.core.store import Declined
from barewire.modbus.exceptions import ILLEGAL_DATA_VALUE, ILLEGAL_FUNCTION, SERVER_DEVICE_BUSY, ModbusException
from barewire.modbus.messages.base import Response
from barewire.modbus.messages.diagnostics import ReadExceptionStatus, ReadExceptionStatusResponse
from barewire.modbus.messages.identification import ReportServerId, ReportServerIdResponse
from barewire.modbus.messages.registers import ReadInputRegisters

ACCELERATION_TIME = (1, 0, 4)
NODE_ADDRESS = (8, 0, 1)
_TEXT_LENGTH = 56


class MenuParameter(NamedTuple):
    """One parameter of a menu."""

    default: int
    minimum: int
    maximum: int


_PARAMETERS: dict[tuple[int, int, int], MenuParameter] = {
    ACCELERATION_TIME: MenuParameter(10, 1, 120),  # seconds; the example of the manual sets 10
    NODE_ADDRESS: MenuParameter(1, 1, 255),
    (8, 0, 2): MenuParameter(3, 0, 7),  # 1200 2400 4800 9600 19200 38400 57600 115200
    (8, 0, 3): MenuParameter(0, 0, 4),  # 8N 8O 8E 7O 7E
    (8, 0, 4): MenuParameter(1, 1, 2),  # stop bits
    (8, 0, 5): MenuParameter(0, 0, 2),  # Modbus RTU, ASCII, TCP
}
"""By (menu, sub-menu, parameter); sub-menu 0 where a menu has none."""

FACTORY = {key: parameter.default for key, parameter in _PARAMETERS.items()}


class Menus:
    """The parameters: the values in use, the saved ones, and the copy that C13 makes."""

    def __init__(self) -> None:
        self.values = dict(FACTORY)
        self.saved = dict(FACTORY)
        self.copy: dict[tuple[int, int, int], int] | None = None

    def read(self, key: tuple[int, int, int]) -> int:
        """Return the value; raises Declined if there is no such parameter."""
        if key not in self.values:
            menu, sub, number = key
            raise Declined("place", f"no parameter {number} in menu {menu}, sub-menu {sub}")
        return self.values[key]

    def check(self, key: tuple[int, int, int], value: int) -> None:
        """Raise Declined for a parameter that does not exist and for a value out of its range."""
        self.read(key)
        parameter = _PARAMETERS[key]
        if not parameter.minimum <= value <= parameter.maximum:
            raise Declined("value", f"{value}: expected {parameter.minimum}..{parameter.maximum}")


class EventList:
    """The last sixty events. Index 0 is the oldest one here; the manual does not state the order."""

    SIZE = 60

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.total = 0
        self.index = 0

    def add(self, uptime: float, text: str) -> None:
        """Add an event; its text begins with the seconds since power-on."""
        self.texts = [*self.texts, f"{int(uptime):08d} {text}"[:_TEXT_LENGTH]][-self.SIZE :]
        self.total += 1

    def clear(self) -> None:
        """Delete all events (C16)."""
        self.texts, self.total, self.index = [], 0, 0

    @property
    def pointer(self) -> int:
        """Increases with every event; with the sixtieth it is 0 again (table 4)."""
        return self.total % self.SIZE

    def select(self, index: int) -> None:
        """Select the event that is read next: "smaller than the number of events stored"."""
        self.check(index)
        self.index = index

    def check(self, index: int) -> None:
        """Raise Declined for an event that is not stored."""
        if index >= len(self.texts):
            raise Declined("value", f"event {index}: {len(self.texts)} are stored")

    def text(self) -> str:
        """Return the event at the index; raises Declined("state") after the last one."""
        if self.index >= len(self.texts):
            raise Declined("state", "no event is left to read")
        return self.texts[self.index]


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
