"""The ADXL soft starter, simulated: a motor that starts and stops in time, menus, events, reboot.   [ADXL addendum]

        1002h = 1 start   1003h = 1 stop  --> motor (adxl_motor) -> F84h status, currents, power, energy, hours
        2FF0h = 0 .. 15   C01 .. C16      --> the action of each command
        5000h .. 5004h    menus           --> `Menus`: P01.04 is the time of the next start
        5030h, 5032h      events
        2F03h = 5         save and reboot: no answer, then busy (exception 06) for `REBOOT_TAKES` seconds

Simulated: 03 and 04 read measures, only 04 reads settings and events (tables 2 and 4, parameter setting); 06 writes, 07
returns eight bits of state, 17 the identity. A start is executed when the starter is ready; while it stops, the answer
is exception 04. C01 restarts the `service_hours` interval, C06 sets the limits to 0. C15, the test with a motor of low
power, lasts until the starter is switched on again: currents are a twentieth, so no limit is reached, protections are
inhibited (`trip` adds an event, not an alarm), and a running motor shows status 11. A new node address (P08.01) takes
effect at the next power-on or reboot.

`environment_properties` lists its environment: supply, alarms, inputs, and what is a parameter of the menus there.

Simplified: the curves of a start are plausible and not calculated, see `adxl_motor`. C11, the AUTOSET wizard, is an
event and nothing else. Only stored: baud rate, format and protocol (P08.02 to P08.05).

The text of an event, 28 registers from 5032h, is read "with a single function 04", and the index moves on after it.
The example of function 04 reads 10h to 17h, of which table 2 has only 14h to 17h, and 16 bytes come. So here a register
between two measures of one page (0xxh, Fxxh, 1Bxxh, 21xxh) is read as 0. For a request with no measure in it, or with
a register before the first or behind the last measure of a page, the answer is exception 02, "if the measure address is
not included in the table". The pages, and the 0 in each of these registers, are decided here.

The menus have the six parameters that the Modbus manual names; every other number is exception 02. Their ranges, and
the numbers for the choices of P08.02, P08.03 and P08.05, are not printed; here they count from 0 in the order of the
list. Only the acceleration time and the node address have an effect, the others are only stored.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, NamedTuple

from barewire.codecs import Value
from barewire.devices.device import Device, ModbusSettings
from barewire.devices.sim.adxl_motor import FREQUENCY, LINE_RATIOS, RATED_CURRENT, Motor, MotorPhase, MotorSample
from barewire.devices.sim.machine import SWITCH, EnvironmentProperty, Form, Simulator, number
from barewire.devices.sim.modbus import ModbusAdapter
from barewire.devices.sim.store import Declined
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


_BITS, _SECONDS = number(0, 15, int), number(0, 3600)


class AdxlModbusAdapter(ModbusAdapter):
    """03, 04, 06, 07 and 17 (hexadecimal 11); exception 06 while the starter reboots."""

    def __init__(self, starter: Adxl, settings: ModbusSettings) -> None:
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


REBOOT_TAKES = 3.0
"""Seconds; the manual does not give the time."""

_ABSENT, _PREHEATING, _READY, _DELAY, _KICK, _RAMP, _CURRENT_LIMIT, _TORQUE_LIMIT, _RUN, _BYPASS = range(10)
_DECELERATION, _INHIBITED, _FREEWHEEL, _ALARM, _SELECTION = range(10, 15)
"""Values of the status register F84h."""

_PHASE_STATUS = {
    MotorPhase.READY: _READY,
    MotorPhase.DELAYED: _DELAY,
    MotorPhase.KICKING: _KICK,
    MotorPhase.STARTING: _RAMP,
    MotorPhase.CLOSING: _RUN,
    MotorPhase.BYPASSED: _BYPASS,
    MotorPhase.STOPPING: _DECELERATION,
    MotorPhase.COASTING: _FREEWHEEL,
}


class Adxl(Simulator):
    """An ADXL0030600 on a 400 V line with its motor, at rest.

    >>> from barewire.devices.description.load import load
    >>> from barewire.modbus.messages.registers import WriteSingleRegister
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

    modbus_adapter = AdxlModbusAdapter
    modbus: AdxlModbusAdapter

    def __init__(self, device: Device, now: float = 0.0) -> None:
        super().__init__(device, now)
        self.motor = Motor(now)
        self.menus = Menus()
        self.events = EventList()
        self.has_line = True
        self.alarm = ""
        self.inhibited = False
        """Protections inhibited: an alarm is only an event."""
        self.preheats = False
        self.selects_motor = False
        self.inputs = 0
        """Inputs 1 to 3 as bits 0 to 2; 1 is start, 2 is stop. Moved by `close`."""
        self.limits = 0
        """The limit variables LIM1 to LIM4 as bits 0 to 3."""
        self.remotes = 0
        """The remote variables REM1 to REM4 as bits 0 to 3."""
        self._serviced_at = 0.0
        self.reboots_until = now
        self._bind_measurements()
        self._bind_commands()
        self.events.add(self.uptime, "POWER ON")

    def tick(self, now: float) -> None:
        """Let time pass for the motor."""
        super().tick(now)
        self.motor.advance(self.now)

    def reset(self) -> None:
        """Restart with the saved parameters and without current in the motor. The counters keep their values."""
        super().reset()
        self.motor.cut()
        self.motor.low_power = False
        self.menus.values = dict(self.menus.saved)
        self.alarm, self.inhibited = "", False
        self.address = self.menus.saved[NODE_ADDRESS]
        self.events.add(self.uptime, "POWER ON")

    def readdress(self, address: int) -> None:
        """Set the node address with which the starter is delivered."""
        super().readdress(address)
        self.menus.values[NODE_ADDRESS] = self.menus.saved[NODE_ADDRESS] = address

    # Environment

    def supply(self, on: bool, now: float) -> None:
        """Switch the line on or off."""
        self.tick(now)
        self.has_line = on
        if not on:
            self.motor.cut()

    def trip(self, text: str, now: float) -> None:
        """Let a protection act: no current, and status alarm until `clear`. If inhibited, it is only an event."""
        self.tick(now)
        if self.inhibited:
            self.events.add(self.uptime, f"INHIBITED {text}")
            return
        self.alarm = text
        self.motor.cut()
        self.events.add(self.uptime, f"ALARM {text}")

    def clear(self, now: float) -> None:
        """End the alarm."""
        self.tick(now)
        self.alarm = ""

    def close(self, number: int, on: bool, now: float) -> None:
        """Close or open input 1, 2 or 3. Closing input 1 starts the motor, closing input 2 stops it."""
        self.tick(now)
        bit = 1 << number - 1
        closes = on and not self.inputs & bit
        self.inputs = self.inputs | bit if on else self.inputs & ~bit
        if closes and number == 1 and self.is_ready:
            self._start()
        elif closes and number == 2:
            self._stop()

    def environment_properties(self) -> tuple[EnvironmentProperty, ...]:
        """Return supply, alarm, inputs, and what statuses of a start and of rest depend on."""

        of, inputs = EnvironmentProperty.of, ("input 1: closing it starts the motor", "input 2: it stops it", "input 3")
        return (
            EnvironmentProperty("line", "the supply", SWITCH, self.has_line, lambda on: self.supply(on, self.now)),
            EnvironmentProperty(
                "alarm",
                "the text of an alarm that lasts; empty: none",
                Form("a text", str),
                self.alarm,
                lambda text: self.trip(text, self.now) if text else self.clear(self.now),
            ),
            *(
                EnvironmentProperty(
                    f"i{place}",
                    meaning,
                    SWITCH,
                    bool(self.inputs >> place - 1 & 1),
                    partial(self.close, place, now=self.now),
                )
                for place, meaning in enumerate(inputs, 1)
            ),
            of(self, "limits", "LIM1 to LIM4, as bits", _BITS),
            of(self, "remotes", "REM1 to REM4, as bits", _BITS),
            of(self, "preheats", "the motor is heated at rest: status 1", SWITCH),
            of(self, "selects_motor", "a motor is being selected: status 14", SWITCH),
            of(self, "inhibited", "protections are inhibited: status 11", SWITCH),
            of(self.motor, "start_delay", "seconds before a start: status 3", _SECONDS),
            of(self.motor, "kick_time", "seconds of a kick before the ramp: status 4", _SECONDS),
            of(self.motor, "torque_limit", "of the rated torque, in a start: status 7", number(0)),
        )

    # State

    @property
    def is_ready(self) -> bool:
        """Whether a start would be executed."""
        # A start while the motor turns is accepted and changes nothing; one while it stops is refused.
        at_rest = self.motor.phase not in (MotorPhase.STOPPING, MotorPhase.COASTING)
        return at_rest and self.has_line and not self.alarm and not self.selects_motor

    @property
    def service_hours(self) -> float:
        """Hours of running since the maintenance interval began (C01)."""
        return (self.motor.seconds - self._serviced_at) / 3600

    def status(self) -> int:
        """Return the status register, F84h."""
        if not self.has_line:
            return _ABSENT
        if self.alarm:
            return _ALARM
        phase = self.motor.phase
        if phase is MotorPhase.READY and self.selects_motor:
            return _SELECTION
        if phase is MotorPhase.READY and self.preheats:
            return _PREHEATING
        if phase in (MotorPhase.CLOSING, MotorPhase.BYPASSED) and self.inhibited:
            return _INHIBITED
        if self.motor.is_limited:
            return _CURRENT_LIMIT
        return _TORQUE_LIMIT if self.motor.is_torque_limited else _PHASE_STATUS[phase]

    def exception_status(self) -> int:
        """Return the byte of function 07. The ninth bit of the manual, bypass active, does not fit."""
        ready = self.motor.phase is MotorPhase.READY and self.is_ready
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
        return sum(1 << number for number, bit in enumerate(bits) if bit)

    def selected(self) -> tuple[int, int, int]:
        """Return menu, sub-menu and parameter, from 5000h, 5001h and 5002h."""
        names = ("Menu number selection", "Sub-menu number selection", "Parameter number selection")
        menu, sub, number = (self.store.integer(name) for name in names)
        return menu, sub, number

    # Measurements and commands

    def _bind_measurements(self) -> None:
        """Let every measured value (table 2), the menu parameter and the event text be computed when they are read."""
        motor = self.motor

        def amperes(phase: int) -> float:
            return self._sample().current * RATED_CURRENT * LINE_RATIOS[phase]

        def power(phase: int) -> float:
            return motor.power(self._sample()) / 3 * LINE_RATIOS[phase]

        def largest() -> float:
            return max(amperes(phase) for phase in range(3))

        def bit(name: str, index: int) -> bool:
            return bool(getattr(self, name) >> index & 1)

        measures: dict[str, Callable[[], Value]] = {
            "L3-L1 Voltage": lambda: motor.line_voltage() if self.has_line else 0,
            "Frequency": lambda: FREQUENCY if self.has_line else 0,
            "Total active power": lambda: motor.power(self._sample()),
            "Total power factor": lambda: self._sample().power_factor,
            "Max current": largest,
            "Torque": lambda: 100 * self._sample().torque,
            "Maximum instantaneous current %": lambda: 100 * largest() / RATED_CURRENT,
            "Motor hour meter": lambda: motor.seconds / 3600,
            "Start counter": lambda: motor.starts,
            "Status": self.status,
            "Motor thermal status": lambda: motor.thermal,
            "Thyristors temperature": lambda: motor.thyristors,
            "Total active energy": lambda: motor.energy,
            "Output 1": lambda: motor.is_running,
            "Output 2": lambda: motor.phase is MotorPhase.BYPASSED,
            "Output 3": lambda: bool(self.alarm),
            "Events counter": lambda: len(self.events.texts),
            "Events pointer": lambda: self.events.pointer,
            "Event description": self.events.text,
            "Parameter value": lambda: self.menus.read(self.selected()),
        }
        for index in range(3):
            line = f"L{index + 1}"
            measures[f"{line} current"] = partial(amperes, index)
            measures[f"{line} active power"] = partial(power, index)
            measures[f"{line} power factor"] = lambda: self._sample().power_factor
            measures[f"Input {index + 1}"] = partial(bit, "inputs", index)
        for index in range(4):
            measures[f"Remote {index + 1}"] = partial(bit, "remotes", index)
            measures[f"Limit {index + 1}"] = partial(bit, "limits", index)
        for name, read in measures.items():
            self.store.measure(name, read)

    def _sample(self) -> MotorSample:
        return self.motor.sample(self.now)

    def _bind_commands(self) -> None:
        commands: dict[str, Callable[[], None]] = {
            "C01 Reset maintenance service interval": lambda: setattr(self, "_serviced_at", self.motor.seconds),
            "C02 Thermal status reset": lambda: setattr(self.motor, "thermal", 0.0),
            "C03 Reset the number of startings counter": lambda: setattr(self.motor, "starts", 0),
            "C04 Reset the motor's hour meter": self._reset_hours,
            "C05 Reset the energy counters": lambda: setattr(self.motor, "energy", 0.0),
            "C06 Reset LIM variables with memory": lambda: setattr(self, "limits", 0),
            "C11 Repeat the AUTOSET wizard": lambda: None,
            "C12 Restore the factory default settings": lambda: self.menus.values.update(FACTORY),
            "C13 Save a copy of the setup parameters": self._copy,
            "C14 Restore a copy of the setup parameters": lambda: self.menus.values.update(self.menus.copy or {}),
            "C15 Test with low power motor": self._test_low_power,
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
        self.store.after("Parameter value", self._set_parameter)
        self.store.veto("Event index", lambda value: self.events.check(int(value)))
        self.store.after("Event index", lambda value: self.events.select(int(value)))

    def _logged(self, name: str, act: Callable[[], None]) -> Callable[[Value], None]:
        def command(value: Value) -> None:
            self.events.add(self.uptime, name.upper())
            act()

        return command

    def _may_start(self, value: Value) -> None:
        if not self.is_ready:
            raise Declined("state", "the starter is not ready")

    def _may_restore(self, value: Value) -> None:
        if self.menus.copy is None:
            raise Declined("state", "no copy has been saved")

    def _start(self) -> None:
        if self.motor.phase is MotorPhase.READY:
            self.motor.start(self.menus.values[ACCELERATION_TIME])

    def _stop(self) -> None:
        if self.motor.phase is MotorPhase.DELAYED:
            self.motor.cut()
        elif self.motor.is_running and self.motor.phase is not MotorPhase.STOPPING:
            self.motor.stop()

    def _reset_hours(self) -> None:
        self._serviced_at -= self.motor.seconds  # the service interval goes on (C01 resets it)
        self.motor.seconds = 0.0

    def _test_low_power(self) -> None:
        self.motor.low_power = self.inhibited = True

    def _set_parameter(self, value: Value) -> None:
        self.menus.values[self.selected()] = int(value)

    def _copy(self) -> None:
        self.menus.copy = dict(self.menus.values)

    def _reboot(self) -> None:
        self.menus.saved = dict(self.menus.values)
        self.reset()
        self.reboots_until = self.now + REBOOT_TAKES
