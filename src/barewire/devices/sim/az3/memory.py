"""The non-volatile memory of the AZ3, and the addresses that it takes from there.              [ST.TEC.022, ST.TEC.071]

        STORE ALL PARAMETERS = 65766173h ("save")   saves all writable parameters and the PDO records
                             any other value        refused: abort 0800 0020h [CiA 301, 1010h], on Modbus exception 03
        EEPROM PARAMETERS CLEANING                  defaults from the next reset on
        EEPROM DIAGNOSTIC LOG CLEANING              no errors in ERROR CODE 1 to 8
        EEPROM TOTAL CLEANING                       both, and the results of the phasing

Node-ID (BOOT CAN NODE), bit rate (CAN BIT RATE) and MODBUS ADDRESS take effect when the drive restarts: at power-on, a
software reset, NMT reset node, and for the first two NMT reset communication. The guides do not state when. Unsaved
values are lost in all of these cases but the last. With a node-ID outside 1..127 the drive is silent on CAN; a number
without a bit rate in the guide selects the default.

The measured values of the AZ3: torque, current, voltage, and the values computed from the axis.   [ST.TEC.022]

        axis --> position, velocity --> flywheel and friction --> torque --> current --> DC link voltage, temperature

Simplified: the motor is a flywheel with friction, so torque follows acceleration and speed. In torque mode the shaft is
held, and only the torque moves towards TARGET TORQUE. The heatsink has no time constant.

The guides list some measured values as read/write (HEATSINK TEMPERATURE, CUSTOM POSITION ACTUAL VALUE, SENSORLESS
MEASURED SPEED). A write to one is accepted and has no effect, because each read computes the value.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import pi
from typing import TYPE_CHECKING

from barewire.codecs import Value
from barewire.devices.device import CanopenSettings
from barewire.devices.drive.cia402 import State
from barewire.devices.parameter import show
from barewire.devices.sim.az3.motion import CAPTURES, Az3Axis, Az3Settings, Phasing
from barewire.devices.sim.core.machine import MachineClock
from barewire.devices.sim.core.store import Declined, MachineStore
from barewire.devices.sim.motion.cia402_axis import CURRENT_ON, TORQUE
from barewire.devices.sim.motion.trajectory import Trajectory, wrapped

if TYPE_CHECKING:
    from barewire.devices.sim.core.canopen import CanopenAdapter


_SAVE = 0x65766173
"""The letters "save", the signature of CiA 301 for 1010h:01. The guides give no value: this one is assumed."""

_BIT_RATES = {3: 20_000, 4: 50_000, 5: 125_000, 6: 250_000, 7: 500_000, 9: 1_000_000}
"""By the number in CAN BIT RATE (CANopen guide, chapter 4)."""

_DEFAULT_BIT_RATE = 5
_COMMANDS_AT_REST = {"CONTROL WORD": 0, "TARGET VELOCITY": 0, "TARGET TORQUE": 0}
"""Commands are not saved: a drive that is switched on waits for new ones."""


class Memory:
    """The saved parameters of one drive, and the node-ID and bit rate that it uses."""

    def __init__(self, store: MachineStore, canopen: CanopenAdapter | None, settings: CanopenSettings | None) -> None:
        self.store, self.canopen = store, canopen
        self.node = 0
        """The node-ID in use."""
        self.bit_rate = _DEFAULT_BIT_RATE
        """The number of the bit rate in use."""
        if settings is not None:
            numbers = {rate: number for number, rate in _BIT_RATES.items()}
            self.deliver("BOOT CAN NODE", settings.node)
            self.deliver("CAN BIT RATE", numbers.get(settings.bitrate, _DEFAULT_BIT_RATE))
            self.node, self.bit_rate = settings.node, store.whole("CAN BIT RATE")
        store.veto("STORE ALL PARAMETERS", self._check_signature)
        store.after("STORE ALL PARAMETERS", self._save)

    def deliver(self, name: str, value: Value) -> None:
        """Set the value of a parameter at delivery."""
        self.store.cell(name).default = value
        self.store[name] = value

    def take_addresses(self) -> None:
        """Take node-ID and bit rate from their parameters, as the drive restarts."""
        if self.canopen is None:
            return
        number = self.store.whole("CAN BIT RATE")
        self.bit_rate = number if number in _BIT_RATES else _DEFAULT_BIT_RATE
        self.node = self.store.whole("BOOT CAN NODE")
        self.canopen.take_address(self.node if 1 <= self.node <= 127 else None, _BIT_RATES[self.bit_rate])

    def _check_signature(self, value: Value) -> None:
        if value != _SAVE:
            raise Declined("signature", f"{show(value)} stores nothing: expected {_SAVE}, the letters 'save'")

    def _save(self, value: Value) -> None:
        """Save every writable parameter: the guides do not list which are saved."""
        saved = self.store.snapshot(
            lambda cell: cell.parameter.writable and (cell.measured is None or bool(cell.parts))
        )
        at_rest = {name: value for name, value in _COMMANDS_AT_REST.items() if name in saved}
        self.store.saved = saved | at_rest
        if self.canopen is not None:
            self.canopen.save_records()
        self.store["STORE ALL PARAMETERS"] = 0

    def clear(self) -> None:
        """Delete the saved parameters and PDO records."""
        self.store.saved = {}
        if self.canopen is not None:
            self.canopen.forget_records()


_INERTIA, _FRICTION = 2e-4, 2e-4
"""kg m², Nm s: a small motor with some load."""

_SUPPLY = 48.0
_SUPPLY_RESISTANCE = 0.05
_AMBIENT = 25.0
_WARMING = 0.5  # °C per ampere

_MONITORED: dict[int, str] = {
    1: "VELOCITY ACTUAL VALUE",
    2: "POSITION ACTUAL VALUE",
    3: "TORQUE ACTUAL VALUE",
    4: "RMS CURRENT",
    5: "VBUS MEAN",
    6: "TARGET VELOCITY",
    7: "HEATSINK TEMPERATURE",
}
"""The values that CHANNEL_SEL_1 to 4 can select, besides 8, the voltage reference. Other numbers show 0."""

_REFERENCE = 8


class Measurements:
    """The measured values of one drive. They are computed when they are read."""

    def __init__(
        self, clock: MachineClock, store: MachineStore, settings: Az3Settings, axis: Az3Axis, phasing: Phasing
    ) -> None:
        self.clock, self.store, self.settings, self.axis, self.phasing = clock, store, settings, axis, phasing
        self.supply = _SUPPLY
        """Volts of the supply."""
        self._torque = Trajectory()
        self._reference = Trajectory()
        measures: dict[str, Callable[[], float]] = {
            "POSITION ACTUAL VALUE": lambda: self._position(32),
            "CUSTOM POSITION ACTUAL VALUE": lambda: self._position(16),
            "VELOCITY ACTUAL VALUE": self._velocity,
            "VL VELOCITY ACTUAL VALUE": self._velocity,
            "CUSTOM VELOCITY ACTUAL VALUE": self._velocity,
            "SENSORLESS MEASURED SPEED": self._velocity,
            "TORQUE ACTUAL VALUE": self._torque_permille,
            "TORQUE DEMAND": self._torque_permille,
            "TORQUE ACTUAL VALUE NM": self._torque_nm,
            "TORQUE SHAFT VALUE": self._torque_nm,
            "CURRENT ACTUAL VALUE": self._torque_permille,
            "RMS CURRENT": self._current,
            "IQRMSX10": lambda: 10 * self._current(),
            "DC LINK CIRCUIT VOLTAGE": lambda: 1000 * self._bus_voltage(),
            "VBUS MEAN": self._bus_voltage,
            "HEATSINK TEMPERATURE": lambda: _AMBIENT + _WARMING * self._current(),
        }
        for name, read in measures.items():
            store.measure(name, read)
        for index in range(CAPTURES):
            store.measure(f"PHASE DATA INCREMENTAL CAPTURES {index}", partial(phasing.captures.__getitem__, index))
        for channel in range(1, 5):
            store.measure(f"MONITOR VAR {channel}", partial(self._monitor, channel))

    def restart(self) -> None:
        """Restart as at power-on, without torque and voltage reference."""
        self._torque, self._reference = Trajectory(), Trajectory()

    # Set-points on ramps

    def follow_torque(self) -> None:
        """Ramp the torque with TORQUE SLOPE to TARGET TORQUE, or to 0 outside torque mode (‰ of the rated torque)."""
        on = self.axis.mode == TORQUE and self.axis.state is State.OPERATION_ENABLED
        slope = self.settings.torque_slope()
        self._torque.move(self.clock.now, self.settings.target_torque() if on else 0.0, slope, slope, slope, jerky=True)

    def follow_reference(self) -> None:
        """Move the voltage reference to V REF SETPOINT on its ramp, in volts."""
        on = self.axis.state is State.OPERATION_ENABLED
        target = self.store.number("V REF SETPOINT") if on else 0.0
        slope = self.settings.voltage_ramp(target - self._reference.position(self.clock.now))
        self._reference.move(self.clock.now, target, slope, slope, slope, jerky=True)

    # Values

    def _position(self, bits: int) -> int:
        return wrapped(self.settings.shown_position(self.axis.trajectory.position(self.clock.now)), bits)

    def _velocity(self) -> float:
        return self.settings.shown_velocity(self.axis.trajectory.velocity(self.clock.now))

    def _torque_nm(self) -> float:
        """Return the torque of torque mode, and what flywheel and friction take."""
        if self.axis.state not in CURRENT_ON:
            return 0.0
        now, trajectory = self.clock.now, self.axis.trajectory
        commanded = self._torque.position(now) / 1000 * self.settings.rated_torque
        turn = 2 * pi / self.settings.increments
        return commanded + turn * (_INERTIA * trajectory.acceleration(now) + _FRICTION * trajectory.velocity(now))

    def _torque_permille(self) -> float:
        return 1000 * self._torque_nm() / self.settings.rated_torque

    def _current(self) -> float:
        """Return the current in A: the rated current gives the rated torque; phasing takes the alignment current."""
        if self.phasing.in_progress:
            return self.store.number("ALIGNMENT CURRENT")
        return abs(self._torque_permille()) / 1000 * self.store.number("MOTOR RATED CURRENT") / 1000

    def _bus_voltage(self) -> float:
        """Return the supply voltage, which drops a little under current."""
        return max(0.0, self.supply - _SUPPLY_RESISTANCE * self._current())

    def _monitor(self, channel: int) -> float:
        selected = self.store.whole(f"CHANNEL_SEL_{channel}")
        if selected == _REFERENCE:
            return self._reference.position(self.clock.now)
        name = _MONITORED.get(selected)
        return self.store.number(name) if name else 0.0
