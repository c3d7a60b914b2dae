"""The AZ3 servo drive, simulated: one machine on Modbus RTU and on CANopen.              [ST.TEC.022, ST.TEC.071]

        holding 155, 6040h  CONTROL WORD --> axis --> STATUS WORD  input 25, 6041h
                                               '----> one bit for each state: coils 81 to 88, which are bits of 201Bh
        MODES OF OPERATION  1 position   3 velocity   4 torque

Simulated: the CiA 402 states; position, velocity and torque mode with their ramps, units, limits and the brake,
phasing, torque, current and voltage (`az3_motion`); saving, defaults, addresses and bit rate (`Memory`); errors with
their emergencies; the device identification of Modbus. The drive has no quick stop option code, so its default, 2, is
used: it brakes and changes to SWITCH ON DISABLED by itself.

The environment is `supply` (above V BUS MAX it is fault 3210h, without voltage while the motor has current 3220h), and
`fault` and `solve` for every other fault.

Simplified: position mode is that of the set-point bit. V REF SETPOINT is followed on its two ramps while the operation
is enabled; no guide states in which mode it turns the shaft, so here it can only be monitored.

Only stored, because the guides give a name and no meaning, or numbers without the list of their meanings: all
SELECTORs with SPEED, POSITION and TORQUE VALUE 1 to 4, digital inputs and outputs, BRAKE POW VALUE and MODE, encoder,
sensorless, thermistor and braking resistor settings, current and speed controllers, STO, START, EMCY-CODE, DIRECTION
CHANGE LOCK, following error and position window (this shaft follows exactly), position range limits, option codes
605Bh and 605Ch, BOOT OPTIONS, baud rate and parity. The guides do not state which variable a CHANNEL_SEL number
selects; the list in `az3_motion` is this simulator's own.

The non-volatile memory:

        STORE ALL PARAMETERS = 65766173h ("save")   saves all writable parameters and the PDO records
                             any other value        refused: abort 0800 0020h [CiA 301, 1010h], on Modbus exception 03
        EEPROM PARAMETERS CLEANING                  defaults from the next reset on
        EEPROM DIAGNOSTIC LOG CLEANING              no errors in ERROR CODE 1 to 8
        EEPROM TOTAL CLEANING                       both, and the results of the phasing

Node-ID (BOOT CAN NODE), bit rate (CAN BIT RATE) and MODBUS ADDRESS take effect when the drive restarts: at power-on, a
software reset, NMT reset node, and for the first two NMT reset communication. The guides do not state when. Unsaved
values are lost in all of these cases but the last. With a node-ID outside 1..127 the drive is silent on CAN; a number
without a bit rate in the guide selects the default.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any

from barewire.canopen.nmt.messages import NmtState
from barewire.codecs import Value, get_bit, set_bit
from barewire.devices.cia402 import FAULT_STATES, DriveCommand, State
from barewire.devices.device import CanopenSettings, Device
from barewire.devices.parameter import show
from barewire.devices.sim.az3_motion import Az3Axis, Az3Settings, Measurements, Phasing
from barewire.devices.sim.cia402_axis import CURRENT_ON
from barewire.devices.sim.machine import EnvironmentProperty, Form, Simulator, number
from barewire.devices.sim.modbus import ModbusAdapter
from barewire.devices.sim.store import Declined, MachineStore
from barewire.modbus.exceptions import ILLEGAL_DATA_VALUE, ILLEGAL_FUNCTION, ModbusException
from barewire.modbus.messages.base import Response
from barewire.modbus.messages.identification import (
    BASIC,
    INDIVIDUAL,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
)

if TYPE_CHECKING:
    from barewire.devices.sim.canopen import CanopenAdapter


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
            self.node, self.bit_rate = settings.node, store.integer("CAN BIT RATE")
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
        number = self.store.integer("CAN BIT RATE")
        self.bit_rate = number if number in _BIT_RATES else _DEFAULT_BIT_RATE
        self.node = self.store.integer("BOOT CAN NODE")
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


_IDENTIFICATION = ((0, b"TEM"), (1, b"AZ3"), (2, b"1.84"))
"""VendorName, ProductCode, MajorMinorRevision: the newest firmware that the guides name."""

_OVERVOLTAGE, _UNDERVOLTAGE = 0x3210, 0x3220  # codes of CiA 402; the guides list none
_GENERIC_ERROR = 0x01
_REGISTER_BITS = {2: 0x02, 3: 0x04, 4: 0x08, 8: 0x10}
"""Bits of the error register by the first digit of a code: current, voltage, temperature, communication [CiA 301]."""

# The bits 1 to 8 of 201Bh, coils 81 to 88 (ST.TEC.071, 5.3).
_STATE_BITS = {
    State.NOT_READY_TO_SWITCH_ON: 1,
    State.SWITCH_ON_DISABLED: 2,
    State.READY_TO_SWITCH_ON: 3,
    State.SWITCHED_ON: 4,
    State.OPERATION_ENABLED: 5,
    State.QUICK_STOP_ACTIVE: 6,
    State.FAULT: 7,
    State.FAULT_REACTION_ACTIVE: 8,
}
_INTERNAL_LIMIT = 0x0800
_PHASING, _BRAKE_USED, _BRAKE_OPEN = 0, 7, 8
"""Bits of 2018h and 2019h."""


class Az3ModbusAdapter(ModbusAdapter):
    """The tables, and "Read device identification, MEI type 0Eh with base identification" (ST.TEC.022, 5.3.2)."""

    def other(self, request: Any) -> Response | None:
        """Answer with the basic objects from `object_id` on, or from 0 if there is no such object [MB-APP 6.21]."""
        if not isinstance(request, ReadDeviceIdentification):
            raise ModbusException(ILLEGAL_FUNCTION)
        if request.read_code == INDIVIDUAL:
            raise ModbusException(ILLEGAL_DATA_VALUE)  # conformity level 01 has stream access only
        first = request.object_id if request.object_id < len(_IDENTIFICATION) else 0
        return ReadDeviceIdentificationResponse(request.read_code, BASIC, _IDENTIFICATION[first:])


class Az3(Simulator):
    """An AZ3 on a 48 V supply with a motor of four pole pairs and an encoder of 8192 increments.

    >>> from barewire.canopen.frame import CanFrame
    >>> from barewire.devices.description.load import load
    >>> from barewire.modbus.messages.registers import WriteSingleRegister
    >>> drive = Az3(load("az3"))
    >>> [str(frame) for frame in drive.canopen.feed(None, 0.0)]
    ['701#00']
    >>> for word in (0x06, 0x07, 0x0F):
    ...     _ = drive.modbus.handle(WriteSingleRegister(154, word), now=1.0)
    >>> [str(frame) for frame in drive.canopen.feed(CanFrame.parse("601#4041600000000000"), 1.0)][0]
    '581#4B41600037160000'
    """

    modbus_adapter = Az3ModbusAdapter
    modbus: Az3ModbusAdapter
    canopen: CanopenAdapter

    def __init__(self, device: Device, now: float = 0.0) -> None:
        super().__init__(device, now)
        self.settings = Az3Settings(self.store)
        self.axis = Az3Axis(self.settings)
        self.errors: list[int] = []
        """The last eight error codes, the newest first."""
        self.phasing = Phasing(self.clock, self.store, self.settings, self.axis)
        self.memory = Memory(self.store, self.canopen, device.canopen)
        self.measurements = Measurements(self.clock, self.store, self.settings, self.axis, self.phasing)
        self._restart_axis()
        self._bind_values()
        self._bind_commands()

    def _bind_values(self) -> None:
        store, axis = self.store, self.axis
        phasing, brake, states = (store.cell(f"COIL WORD {word}") for word in (0, 1, 5))

        def status() -> int:
            return axis.status(self.now) | (_INTERNAL_LIMIT if self.settings.is_limited() else 0)

        def brake_word() -> int:
            word = int(brake.held)
            return set_bit(word, _BRAKE_OPEN, axis.brake_is_open(self.now)) if get_bit(word, _BRAKE_USED) else word

        measures: dict[str, Callable[[], float]] = {
            "STATUS WORD": status,
            "COIL WORD 0": lambda: set_bit(int(phasing.held), _PHASING, self.phasing.in_progress),
            "COIL WORD 1": brake_word,
            "COIL WORD 5": lambda: int(states.held) | 1 << _STATE_BITS[axis.state],
            # Also a drive with nothing on its CAN connector has booted.
            "NODE STATE": lambda: int(self.canopen.state if self.canopen else 0) or NmtState.PRE_OPERATIONAL,
            "CAN BITRATE INDEX": lambda: self.memory.bit_rate,
            "BOOT CAN NODE READ ONLY": lambda: self.memory.node,
            "BOOT MODBUS NODE": lambda: self.address & 0xFF,
            "ERROR REGISTER": self._error_register,
        }
        for index in range(8):
            measures[f"ERROR CODE {index + 1}"] = partial(self._error_code, index)
        for name, read in measures.items():
            store.measure(name, read)

    def _bind_commands(self) -> None:
        store, axis = self.store, self.axis
        store.after("CONTROL WORD", self._control)
        store.after("MODES OF OPERATION", lambda value: axis.change_mode(self.now))
        store.after("PROFILE VELOCITY", lambda value: axis.replan(self.now))
        for name in ("TARGET VELOCITY", "MAX MOTOR SPEED"):
            store.after(name, lambda value: axis.follow(self.now))
        for name in ("TARGET TORQUE", "TORQUE LIMIT ON", "TORQUE LIMIT", "MAX TORQUE", "MAX CURRENT"):
            store.after(name, lambda value: self.measurements.follow_torque())
        store.after("V REF SETPOINT", lambda value: self.measurements.follow_reference())
        store.after("V BUS MAX", lambda value: self._check_supply())
        buttons: dict[str, Callable[[], None]] = {
            "RESET ERROR": self.reset_error,
            "RESET POSITION": lambda: axis.rest_at(0.0, self.now),
            "SOFTWARE RESET": lambda: self.power_cycle(self.now),
            "POWER OFF RESET": lambda: self.power_cycle(self.now),
            "START PHASING": partial(self.phasing.start, sets_phased=True),
            "ABSOLUTE ENCODER PHASING START": partial(self.phasing.start, sets_phased=True),
            "ALIGNMENT REQUEST": partial(self.phasing.start, sets_phased=False),
            "EEPROM DIAGNOSTIC LOG CLEANING": self.errors.clear,
            "EEPROM AUTOPHASING DATA CLEANING": self.phasing.clear,
            "EEPROM PARAMETERS CLEANING": self.memory.clear,
            "EEPROM TOTAL CLEANING": self._clear_all,
        }
        for name, act in buttons.items():
            store.after(name, self._button(name, act))

    def _button(self, name: str, act: Callable[[], None]) -> Callable[[Value], None]:
        """Return the hook of a coil that is a push-button: it acts when it is switched on, and returns to off."""

        def pressed(on: Value) -> None:
            if on:
                self.store[name] = False
                act()

        return pressed

    def _clear_all(self) -> None:
        self.memory.clear()
        self.phasing.clear()
        self.errors.clear()

    def _restart_axis(self) -> None:
        self.axis.restart()
        self.axis.mode = self.settings.mode()
        self.axis.powered_since = -inf if self.measurements.supply > 0 else None
        if self.axis.powered_since is None:
            return
        # Two coils of 2019h determine how far the drive goes by itself at power-on (ST.TEC.022, 7.3).
        if self.store["OPERATION ENABLE AT STARTUP"]:
            self.axis.state = State.OPERATION_ENABLED
        elif self.store["READY TO SWITCH ON AT STARTUP"]:
            self.axis.state = State.READY_TO_SWITCH_ON

    # Time and faults

    def tick(self, now: float) -> None:
        """Let time pass for the axis and the phasing; everything else is computed when it is read."""
        super().tick(now)
        self.axis.tick(self.now)
        self.phasing.tick(self.now)

    def reset(self) -> None:
        """Restart as at power-on, with the saved parameters and the axis at position 0."""
        super().reset()
        self._restart_axis()
        self.measurements.restart()
        self.reset_communication()
        if self.canopen is not None:
            self.canopen.node.errors.reset(communication_only=False)

    def reset_communication(self) -> None:
        """Break off phasing, and take the addresses and the bit rate from their parameters."""
        self.phasing.cancel()
        self.address = self.store.integer("MODBUS ADDRESS")
        self.memory.take_addresses()

    def readdress(self, address: int) -> None:
        """Set the MODBUS ADDRESS with which the drive is delivered."""
        super().readdress(address)
        self.memory.deliver("MODBUS ADDRESS", address)

    def supply(self, volts: float, now: float) -> None:
        """Set the voltage of the supply. At 0 V there is no high voltage, and the drive cannot be switched on."""
        self.tick(now)
        had_supply, self.measurements.supply = self.measurements.supply > 0, max(0.0, volts)
        if self.measurements.supply <= 0:
            if self.axis.state in CURRENT_ON:
                self.fault(_UNDERVOLTAGE, self.now)
            self.axis.powered_since = None
        elif not had_supply:
            self.axis.powered_since = self.now
            if self.axis.cause == _UNDERVOLTAGE:
                self.solve(self.now)
        self._check_supply()

    def environment_properties(self) -> tuple[EnvironmentProperty, ...]:
        """Return the voltage of the supply, and the cause of a fault."""
        volts, cause = self.measurements.supply, self.axis.cause
        code = Form("a hexadecimal code", lambda text: int(text, 16))
        return (
            EnvironmentProperty(
                "volts",
                "volts of the supply; 0: none",
                number(0, 1000),
                volts,
                lambda volts: self.supply(volts, self.now),
            ),
            EnvironmentProperty(
                "fault",
                "the code of a fault that lasts, hexadecimal; 0: none",
                code,
                f"{cause:04X}",
                lambda code: self.fault(code & 0xFFFF, self.now) if code else self.solve(self.now),
            ),
        )

    def _check_supply(self) -> None:
        volts, limit = self.measurements.supply, self.store.number("V BUS MAX")
        if volts > limit > 0 and self.axis.cause != _OVERVOLTAGE:
            self.fault(_OVERVOLTAGE, self.now)
        elif volts <= limit and self.axis.cause == _OVERVOLTAGE:
            self.solve(self.now)

    def fault(self, code: int, now: float) -> None:
        """Let a protection act: the shaft is braked (FAULT REACTION ACTIVE), then FAULT; an emergency on CAN."""
        self.tick(now)
        self.axis.fault(code, self.now, reaction=True)
        self.errors[:] = [code, *self.errors][:8]
        if self.canopen is not None:
            self.canopen.error(code, error_register(code))

    def solve(self, now: float) -> None:
        """End the cause of the fault; the state stays FAULT until a client resets it."""
        self.tick(now)
        self.axis.cause = 0

    def reset_error(self) -> None:
        """Reset the error, as an edge of control bit 7 does."""
        self.axis.word &= ~DriveCommand.FAULT_RESET  # the bit may be on already, and only its edge acts
        self._control(self.axis.word | DriveCommand.FAULT_RESET)
        self.axis.word &= ~DriveCommand.FAULT_RESET

    def _control(self, value: Value) -> None:
        was_fault = self.axis.state in FAULT_STATES
        self.axis.control(int(value), self.now)
        if was_fault and self.axis.state not in FAULT_STATES and self.canopen is not None:
            self.canopen.no_error()
        self.measurements.follow_torque()
        self.measurements.follow_reference()

    def _error_register(self) -> int:
        return error_register(self.errors[0]) if self.axis.state in FAULT_STATES and self.errors else 0

    def _error_code(self, index: int) -> int:
        return self.errors[index] & 0xFFFF if index < len(self.errors) else 0


def error_register(code: int) -> int:
    """Return the error register for an error code.

    >>> hex(error_register(0x3210)), hex(error_register(0x7305))
    ('0x5', '0x1')
    """
    return _GENERIC_ERROR | _REGISTER_BITS.get(code >> 12, 0)
