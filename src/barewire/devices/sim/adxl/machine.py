"""The ADXL soft starter, behaving: a motor that starts and stops in time, menus, events, reboot.   [ADXL addendum]

        1002h = 1 start   1003h = 1 stop  --> motor (adxl_motor.py) --> F84h status, currents, power, energy, hours
        2FF0h = 0 .. 15   C01 .. C16      --> what each of them names
        5000h .. 5004h    menus           --> adxl_memory.py: P01.04 is the time of the next start
        5030h, 5032h      events
        2F03h = 5         save and reboot: no answer, then busy (exception 06) for `REBOOT_TAKES` seconds

Measures are read with 03 and 04, settings and events with 04 only (tables 2 and 4, parameter setting); 06 writes, 07
tells eight bits of state, 17 who the starter is.

The world around it is set by hand: `supply`, `trip` and `clear` an alarm, `close` an input, `limits` and `remotes` as
bits, `preheats` and `selects_motor` for status 1 and 14, and `motor.start_delay`, `kick_time` and `torque_limit` for
status 3, 4 and 7.

C15, the test with a motor of low power, lasts until the starter is switched on anew: currents are a twentieth, so no
limit is reached, protections are inhibited (`trip` is an event and no alarm) and a running motor shows status 11.
C06 sets the limits to 0; C01 begins the `service` interval anew; C11, the AUTOSET wizard, is an event only.

Simplified: the curves of a start are drawn and not calculated, see `adxl_motor`. A new node address (P08.01) counts
from the next switching on or reboot; baud rate, format and protocol (P08.02 to P08.05) are only stored. A start is
executed when the starter is ready; while it stops, the answer is exception 04.
"""

from __future__ import annotations

from collections.abc import Callable

from barewire.codecs import Value
from barewire.devices.device import Device
from barewire.devices.sim.adxl.measurements import hang_values
from barewire.devices.sim.adxl.menus import ACCELERATION_TIME, FACTORY, NODE_ADDRESS, Events, Menus
from barewire.devices.sim.adxl.modbus import AdxlModbusAdapter
from barewire.devices.sim.adxl.motor import Motor, Phase
from barewire.devices.sim.core.modbus import ModbusAdapter
from barewire.devices.sim.core.simulator import Simulator, parse_setting
from barewire.devices.sim.core.store import Declined

REBOOT_TAKES = 3.0
"""Seconds; the manual does not say how long."""

ABSENT, PREHEATING, READY, DELAY, KICK, RAMP, CURRENT_LIMIT, TORQUE_LIMIT, RUN, BYPASS = range(10)
DECELERATION, INHIBITED, FREEWHEEL, ALARM, SELECTION = range(10, 15)
STATUS = {
    Phase.READY: READY,
    Phase.DELAYED: DELAY,
    Phase.KICKING: KICK,
    Phase.STARTING: RAMP,
    Phase.CLOSING: RUN,
    Phase.BYPASSED: BYPASS,
    Phase.STOPPING: DECELERATION,
    Phase.COASTING: FREEWHEEL,
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

    def __init__(self, device: Device, now: float = 0.0) -> None:
        super().__init__(device, now)
        self.motor = Motor(now)
        self.menus = Menus()
        self.events = Events()
        self.has_line = True
        self.alarm = ""
        self.inhibited = False
        """Protections inhibited: an alarm is told, and nothing else."""
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
        hang_values(self)
        self._hang_commands()
        self.events.add(self.uptime, "POWER ON")

    def _modbus_face(self) -> ModbusAdapter | None:
        assert self.device.modbus is not None
        return AdxlModbusAdapter(self, self.device.modbus)

    def tick(self, now: float) -> None:
        """The motor goes on."""
        super().tick(now)
        self.motor.advance(self.now)

    def reset(self) -> None:
        """Restart: the saved parameters, a motor without current; what was counted stays."""
        super().reset()
        self.motor.cut()
        self.motor.small = False
        self.menus.values = dict(self.menus.saved)
        self.alarm, self.inhibited = "", False
        self.address = self.menus.saved[NODE_ADDRESS]
        self.events.add(self.uptime, "POWER ON")

    def readdress(self, address: int) -> None:
        """Deliver it with another node address."""
        super().readdress(address)
        self.menus.values[NODE_ADDRESS] = self.menus.saved[NODE_ADDRESS] = address

    # What a test bench does to it

    def supply(self, on: bool, now: float) -> None:
        """Switch the line on or off."""
        self.tick(now)
        self.has_line = on
        if not on:
            self.motor.cut()

    def trip(self, text: str, now: float) -> None:
        """A protection acts: the motor is cut off and the status is alarm, until `clear`; inhibited, it is an event."""
        self.tick(now)
        if self.inhibited:
            self.events.add(self.uptime, f"INHIBITED {text}")
            return
        self.alarm = text
        self.motor.cut()
        self.events.add(self.uptime, f"ALARM {text}")

    def clear(self, now: float) -> None:
        """The alarm is gone."""
        self.tick(now)
        self.alarm = ""

    def close(self, place: int, on: bool, now: float) -> None:
        """Close or open input 1, 2 or 3. The first starts the motor when it closes, the second stops it."""
        self.tick(now)
        bit = 1 << place - 1
        closes = on and not self.inputs & bit
        self.inputs = self.inputs | bit if on else self.inputs & ~bit
        if closes and place == 1 and self.is_ready:
            self._start()
        elif closes and place == 2:
            self._stop()

    def set_environment(self, text: str) -> None:
        """line=0, i1=1, limits=3, remotes=1, preheats=1, selects-motor=1, inhibited=1, start-delay=2 ..."""
        bits, flags = ("limits", "remotes"), ("preheats", "selects_motor", "inhibited")
        of_motor = ("start_delay", "kick_time", "torque_limit")
        name, value = parse_setting(text, ("line", "i1", "i2", "i3", *bits, *flags, *of_motor))
        if name == "line":
            self.supply(bool(value), self.now)
        elif name[0] == "i" and name[1:].isdigit():
            self.close(int(name[1]), bool(value), self.now)
        elif name in of_motor:
            setattr(self.motor, name, value)
        else:
            setattr(self, name, bool(value) if name in flags else int(value))

    # State

    @property
    def is_ready(self) -> bool:
        """Whether a start would be executed."""
        at_rest = self.motor.phase not in (Phase.STOPPING, Phase.COASTING)
        return at_rest and self.has_line and not self.alarm and not self.selects_motor

    @property
    def service(self) -> float:
        """Hours of running since the maintenance interval began, C01."""
        return (self.motor.seconds - self._serviced_at) / 3600

    def status(self) -> int:
        """F84h."""
        if not self.has_line:
            return ABSENT
        if self.alarm:
            return ALARM
        phase = self.motor.phase
        if phase is Phase.READY and self.selects_motor:
            return SELECTION
        if phase is Phase.READY and self.preheats:
            return PREHEATING
        if phase in (Phase.CLOSING, Phase.BYPASSED) and self.inhibited:
            return INHIBITED
        if self.motor.is_limited:
            return CURRENT_LIMIT
        return TORQUE_LIMIT if self.motor.is_torque_limited else STATUS[phase]

    def exception_status(self) -> int:
        """Function 07. Its ninth bit, bypass active, has no room in a byte."""
        ready = self.motor.phase is Phase.READY and self.is_ready
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
            "C15 Test with low power motor": self._test_small,
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
        if not self.is_ready:
            raise Declined("state", "the starter is not ready")

    def _may_restore(self, value: Value) -> None:
        if self.menus.copy is None:
            raise Declined("state", "no copy has been saved")

    def _start(self) -> None:
        if self.motor.phase is Phase.READY:
            self.motor.start(self.menus.values[ACCELERATION_TIME])

    def _stop(self) -> None:
        if self.motor.phase is Phase.DELAYED:
            self.motor.cut()
        elif self.motor.is_running and self.motor.phase is not Phase.STOPPING:
            self.motor.stop()

    def _reset_hours(self) -> None:
        self._serviced_at -= self.motor.seconds
        self.motor.seconds = 0.0

    def _test_small(self) -> None:
        self.motor.small = self.inhibited = True

    def _set(self, value: Value) -> None:
        self.menus.values[self.selected()] = int(value)

    def _copy(self) -> None:
        self.menus.copy = dict(self.menus.values)

    def _reboot(self) -> None:
        self.menus.saved = dict(self.menus.values)
        self.reset()
        self.reboots_until = self.now + REBOOT_TAKES
