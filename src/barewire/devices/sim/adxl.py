"""The ADXL soft starter, behaving: a motor that starts and stops in time, menus, events, reboot.   [ADXL addendum]

        1002h = 1 start   1003h = 1 stop  --> motor (adxl_motor.py) --> F84h status, currents, power, energy, hours
        2FF0h = 0 .. 15   C01 .. C16      --> what each of them names
        5000h .. 5004h    menus           --> adxl_memory.py: P01.04 is the time of the next start
        5030h, 5032h      events
        2F03h = 5         save and reboot: no answer, then busy (exception 06) for `REBOOT_TAKES` seconds

Measures are read with 03 and 04, settings and events with 04 only (tables 2 and 4, parameter setting); 06 writes, 07
tells eight bits of state, 17 who the starter is.

Simplified: the curves of a start are drawn and not calculated, see `adxl_motor`. Limits and remote variables stay 0,
maintenance intervals and the AUTOSET wizard are events only, C15 (test with a small motor) is a flag. A start is
executed when the starter is ready; while it stops, the answer is exception 04.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from barewire.codecs import Value
from barewire.devices.device import Device
from barewire.devices.sim.adxl_memory import ACCELERATION_TIME, FACTORY, Events, Menus
from barewire.devices.sim.adxl_motor import Motor, Phase
from barewire.devices.sim.adxl_values import hang_values
from barewire.devices.sim.modbus_face import ModbusFace
from barewire.devices.sim.simulator import Simulator
from barewire.devices.sim.store import Declined
from barewire.modbus.diagnostics import ReadExceptionStatus, ReadExceptionStatusResponse
from barewire.modbus.exceptions import ILLEGAL_DATA_VALUE, ILLEGAL_FUNCTION, SERVER_DEVICE_BUSY, ModbusException
from barewire.modbus.identification import ReportServerId, ReportServerIdResponse
from barewire.modbus.message import Response
from barewire.modbus.registers import ReadInputRegisters

IDENTITY = bytes((1, 2, 0, 0, 5, 0, 0, 0))
"""Function 17: an ADXL0030600 (1), software revision 2, of the ADXL series (5), as in the example."""

REBOOT_TAKES = 3.0
"""Seconds; the manual does not say how long."""

ABSENT, READY, RAMP, LIMIT, RUN, BYPASS, DECELERATION, FREEWHEEL, ALARM = 0, 2, 5, 6, 8, 9, 10, 12, 13
STATUS = {
    Phase.READY: READY,
    Phase.STARTING: RAMP,
    Phase.CLOSING: RUN,
    Phase.BYPASSED: BYPASS,
    Phase.STOPPING: DECELERATION,
    Phase.COASTING: FREEWHEEL,
}
FIRST_SETTING = 0x4FFF
"""From this wire address on (printed 5000h) only function 04 reads."""

EVENT_TEXT = 0x5031


class AdxlFace(ModbusFace):
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


class Adxl(Simulator):
    """An ADXL0030600 on a 400 V line with its motor, at rest.

    >>> from barewire.devices.load import load
    >>> from barewire.modbus.registers import WriteSingleRegister
    >>> starter = Adxl(load("adxl"))
    >>> _ = starter.modbus.handle(WriteSingleRegister(0x1001, 1), now=1.0)
    >>> for now in (1.0, 4.0, 10.9, 11.0, 12.0):
    ...     starter.tick(now)
    ...     print(now, starter.device.find("Status").text(starter.store["Status"]))
    1.0 5 (Acceleration ramp)
    4.0 6 (Current limit)
    10.9 5 (Acceleration ramp)
    11.0 8 (Run)
    12.0 9 (Bypass closed)
    """

    def __init__(self, device: Device, now: float = 0.0) -> None:
        super().__init__(device, now)
        self.motor = Motor(now)
        self.menus = Menus()
        self.events = Events()
        self.has_line = True
        self.alarm = ""
        self.small_motor = False
        self.inputs = 0
        """Inputs 1 to 3 as bits 0 to 2; 1 is start, 2 is stop."""
        self.reboots_until = now
        hang_values(self)
        self._hang_commands()
        self.events.add(self.uptime, "POWER ON")

    def _modbus_face(self) -> ModbusFace | None:
        assert self.device.modbus is not None
        return AdxlFace(self, self.device.modbus)

    def tick(self, now: float) -> None:
        """The motor goes on."""
        super().tick(now)
        self.motor.advance(self.now)

    def reset(self) -> None:
        """Restart: the saved parameters, a motor without current; what was counted stays."""
        super().reset()
        self.motor.cut()
        self.menus.values = dict(self.menus.saved)
        self.alarm, self.small_motor = "", False
        self.events.add(self.uptime, "POWER ON")

    # What a test bench does to it

    def supply(self, on: bool, now: float) -> None:
        """Switch the line on or off."""
        self.tick(now)
        self.has_line = on
        if not on:
            self.motor.cut()

    def trip(self, text: str, now: float) -> None:
        """A protection acts: the motor is cut off and the status is alarm, until `clear`."""
        self.tick(now)
        self.alarm = text
        self.motor.cut()
        self.events.add(self.uptime, f"ALARM {text}")

    def clear(self, now: float) -> None:
        """The alarm is gone."""
        self.tick(now)
        self.alarm = ""

    # State

    def status(self) -> int:
        """F84h."""
        if not self.has_line:
            return ABSENT
        if self.alarm:
            return ALARM
        return LIMIT if self.motor.is_limited else STATUS[self.motor.phase]

    def exception_status(self) -> int:
        """Function 07. Its ninth bit, bypass active, has no room in a byte."""
        ready = self.status() == READY
        starting = bool(self.inputs & 1)
        bits = (
            starting,
            bool(self.inputs & 2),
            bool(self.alarm) or not self.has_line,
            ready,
            ready and starting,
            bool(self.alarm),
            self.motor.is_running,
            bool(self.alarm),
        )
        return sum(1 << place for place, bit in enumerate(bits) if bit)

    def selected(self) -> tuple[int, int, int]:
        """Menu, sub-menu and parameter as they stand in 5000h, 5001h, 5002h."""
        names = ("Menu number selection", "Sub-menu number selection", "Parameter number selection")
        menu, sub, number = (self.store.whole(name) for name in names)
        return menu, sub, number

    # Commands

    def _hang_commands(self) -> None:
        commands: dict[str, Callable[[], None]] = {
            "C01 Reset maintenance service interval": lambda: None,
            "C02 Thermal status reset": lambda: setattr(self.motor, "thermal", 0.0),
            "C03 Reset the number of startings counter": lambda: setattr(self.motor, "starts", 0),
            "C04 Reset the motor's hour meter": lambda: setattr(self.motor, "seconds", 0.0),
            "C05 Reset the energy counters": lambda: setattr(self.motor, "energy", 0.0),
            "C06 Reset LIM variables with memory": lambda: None,
            "C11 Repeat the AUTOSET wizard": lambda: None,
            "C12 Restore the factory default settings": lambda: self.menus.values.update(FACTORY),
            "C13 Save a copy of the setup parameters": self._copy,
            "C14 Restore a copy of the setup parameters": lambda: self.menus.values.update(self.menus.copy or {}),
            "C15 Test with low power motor": lambda: setattr(self, "small_motor", True),
            "C16 Reset the events list": self.events.clear,
            "Motor start command": self._start,
            "Motor stop command": self._stop,
            "Save and reboot": self._reboot,
        }
        for name, act in commands.items():
            self.store.after(name, self._logged(name, act))
        self.store.veto("Motor start command", self._may_start)
        self.store.veto("C14 Restore a copy of the setup parameters", self._may_restore)
        self.store.veto("Parameter value", lambda value: self.menus.check(self.selected(), int(value)))
        self.store.after("Parameter value", self._set)
        self.store.veto("Event index", lambda value: self.events.check(int(value)))
        self.store.after("Event index", lambda value: self.events.select(int(value)))

    def _logged(self, name: str, act: Callable[[], None]) -> Callable[[Value], None]:
        def command(value: Value) -> None:
            self.events.add(self.uptime, name.upper())
            act()

        return command

    def _may_start(self, value: Value) -> None:
        if self.alarm or not self.has_line or self.motor.phase in (Phase.STOPPING, Phase.COASTING):
            raise Declined("state", "the starter is not ready")

    def _may_restore(self, value: Value) -> None:
        if self.menus.copy is None:
            raise Declined("state", "no copy has been saved")

    def _start(self) -> None:
        if not self.motor.is_running:
            self.motor.start(self.menus.values[ACCELERATION_TIME])

    def _stop(self) -> None:
        if self.motor.phase in (Phase.STARTING, Phase.CLOSING, Phase.BYPASSED):
            self.motor.stop()

    def _set(self, value: Value) -> None:
        self.menus.values[self.selected()] = int(value)

    def _copy(self) -> None:
        self.menus.copy = dict(self.menus.values)

    def _reboot(self) -> None:
        self.menus.saved = dict(self.menus.values)
        self.reset()
        self.reboots_until = self.now + REBOOT_TAKES
