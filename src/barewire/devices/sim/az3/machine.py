"""The AZ3 servo drive, behaving: one machine with two faces, Modbus RTU and CANopen.    [ST.TEC.022, ST.TEC.071]

        holding 155, 6040h  CONTROL WORD --> axis --> STATUS WORD  input 25, 6041h
                                               '----> one bit for each state: coils 81 to 88, which are bits of 201Bh
        MODES OF OPERATION  1 position   3 velocity   4 torque

The state machine is that of CiA 402. The drive has no quick stop option code, so its default, 2, is taken: it brakes
and goes to SWITCH ON DISABLED by itself. Units, limits and the brake are in `az3_motion`; buttons, phasing, what is
saved and what a reset brings are in `az3_service`.

The world around it is set by hand: `supply` (volts; above V BUS MAX it is fault 3210h, gone while the motor has current
3220h), `fault` and `solve` for any other one.

Simplified: the motor is a flywheel with friction, so torque follows acceleration and speed; in torque mode the shaft is
held and only the torque moves; position mode is that of the set-point bit. V REF SETPOINT is followed on its two ramps
while the operation is enabled; which mode turns the shaft with it is in no guide, so it can be monitored and no more.

Only stored, because the guides give a name and no meaning, or numbers without the list of what they stand for: all
SELECTORs with SPEED, POSITION and TORQUE VALUE 1 to 4, digital inputs and outputs, BRAKE POW VALUE and MODE, encoder,
sensorless, thermistor and braking resistor settings, current and speed controllers, STO, START, EMCY-CODE, DIRECTION
CHANGE LOCK, following error and position window (this shaft is where it is wanted), position range limits, option codes
605Bh and 605Ch, BOOT OPTIONS, baud rate and parity. Which variable a CHANNEL_SEL number means is not described either;
`MONITORED` is this simulator's own list.
"""

from __future__ import annotations

from math import pi
from typing import Any

from barewire.codecs import Value
from barewire.devices.device import Device
from barewire.devices.drive.cia402 import DriveCommand, State
from barewire.devices.sim.az3.measurements import hang_values
from barewire.devices.sim.az3.motion import Az3Axis, Az3Motion
from barewire.devices.sim.az3.service import Az3Service
from barewire.devices.sim.core.modbus import ModbusAdapter
from barewire.devices.sim.core.simulator import Simulator, parse_setting
from barewire.devices.sim.motion import cia402_axis as axis
from barewire.devices.sim.motion.cia402_axis import CURRENT_ON, FAULTED
from barewire.devices.sim.motion.trajectory import Trajectory
from barewire.modbus.exceptions import ILLEGAL_DATA_VALUE, ILLEGAL_FUNCTION, ModbusException
from barewire.modbus.messages.base import Response
from barewire.modbus.messages.identification import (
    BASIC,
    INDIVIDUAL,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
)

IDENTITY = ((0, b"TEM"), (1, b"AZ3"), (2, b"1.84"))
"""VendorName, ProductCode, MajorMinorRevision: the newest firmware that the guides name."""

INERTIA, FRICTION = 2e-4, 2e-4
"""kg m², Nm s: a small motor with some load."""

SUPPLY = 48.0
GENERIC_ERROR = 0x01
ERROR_CLASSES = {2: 0x02, 3: 0x04, 4: 0x08, 8: 0x10}
"""Bits of the error register by the first digit of a code: current, voltage, temperature, communication [CiA 301]."""

OVERVOLTAGE, UNDERVOLTAGE = 0x3210, 0x3220  # codes of CiA 402; the guides list none


class Az3Face(ModbusAdapter):
    """The tables, and "Read device identification, MEI type 0Eh with base identification" (ST.TEC.022, 5.3.2)."""

    def other(self, request: Any) -> Response | None:
        """The basic objects, from the one asked for; a stream that begins nowhere begins at 0 [MB-APP 6.21]."""
        if not isinstance(request, ReadDeviceIdentification):
            raise ModbusException(ILLEGAL_FUNCTION)
        if request.read_code == INDIVIDUAL:
            raise ModbusException(ILLEGAL_DATA_VALUE)  # conformity level 01 has stream access only
        first = request.object_id if request.object_id < len(IDENTITY) else 0
        return ReadDeviceIdentificationResponse(request.read_code, BASIC, IDENTITY[first:])


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

    def __init__(self, device: Device, now: float = 0.0) -> None:
        super().__init__(device, now)
        self.motion = Az3Motion(self)
        self.voltage = SUPPLY
        self.axis = self._new_axis()
        self.torque = Trajectory()
        """Torque mode: the torque in ‰ of the rated one, moved like a position."""
        self.reference = Trajectory()
        """V REF SETPOINT on its ramps, in volts."""
        self.errors: list[int] = []
        self.service = Az3Service(self)
        hang_values(self)
        store = self.store
        for name in ("TARGET VELOCITY", "MAX MOTOR SPEED"):
            store.after(name, lambda value: self.axis.follow(self.now))
        store.after("CONTROL WORD", self._control)
        store.after("MODES OF OPERATION", lambda value: self.axis.change_mode(self.now))
        store.after("PROFILE VELOCITY", lambda value: self.axis.replan(self.now))
        for name in ("TARGET TORQUE", "TORQUE LIMIT ON", "TORQUE LIMIT", "MAX TORQUE", "MAX CURRENT"):
            store.after(name, lambda value: self._follow_torque())
        store.after("V REF SETPOINT", lambda value: self._follow_reference())
        store.after("V BUS MAX", lambda value: self._look_at_supply())

    def _modbus_face(self) -> ModbusAdapter | None:
        assert self.device.modbus is not None
        return Az3Face(self, self.device.modbus)

    def _new_axis(self) -> Az3Axis:
        new = Az3Axis(self.motion)
        new.mode = self.motion.mode()
        if self.voltage <= 0:
            new.powered_since = None
            return new
        # Two coils of 2019h say how far the drive goes by itself at power-on (ST.TEC.022, 7.3).
        if self.store["OPERATION ENABLE AT STARTUP"]:
            new.state = State.OPERATION_ENABLED
        elif self.store["READY TO SWITCH ON AT STARTUP"]:
            new.state = State.READY_TO_SWITCH_ON
        return new

    # Time and faults

    def tick(self, now: float) -> None:
        """The axis follows its own clock; everything else is computed when it is read."""
        super().tick(now)
        self.axis.tick(self.now)
        self.service.tick(self.now)

    def reset(self) -> None:
        """As at power-on: stored parameters, a new axis at position 0."""
        super().reset()
        self.axis = self._new_axis()
        self.torque = Trajectory()
        self.reference = Trajectory()
        self.service.boot()
        if self.canopen is not None:
            self.canopen.node.errors.reset(communication_only=False)

    def reset_communication(self) -> None:
        """The half of a reset that CANopen can ask for by itself: node-ID and bit rate are taken anew."""
        self.service.boot()

    def readdress(self, address: int) -> None:
        """Deliver it with another MODBUS ADDRESS."""
        super().readdress(address)
        self.store.cell("MODBUS ADDRESS").default = address
        self.store["MODBUS ADDRESS"] = address

    def supply(self, volts: float, now: float) -> None:
        """The voltage of the supply. Without any there is no high voltage: the drive cannot be switched on."""
        self.tick(now)
        had, self.voltage = self.voltage > 0, max(0.0, volts)
        if self.voltage <= 0:
            if self.axis.state in CURRENT_ON:
                self.fault(UNDERVOLTAGE, self.now)
            self.axis.powered_since = None
        elif not had:
            self.axis.powered_since = self.now
            if self.axis.cause == UNDERVOLTAGE:
                self.solve(self.now)
        self._look_at_supply()

    def set_environment(self, text: str) -> None:
        """volts=48."""
        self.supply(parse_setting(text, ("volts",))[1], self.now)

    def _look_at_supply(self) -> None:
        limit = self.store.number("V BUS MAX")
        if self.voltage > limit > 0 and self.axis.cause != OVERVOLTAGE:
            self.fault(OVERVOLTAGE, self.now)
        elif self.voltage <= limit and self.axis.cause == OVERVOLTAGE:
            self.solve(self.now)

    def fault(self, code: int, now: float) -> None:
        """Let a protection act: the shaft is braked (FAULT REACTION ACTIVE), then FAULT, and an emergency on CAN."""
        self.tick(now)
        self.axis.fault(code, self.now, reaction=True)
        self.errors = [code, *self.errors][:8]
        if self.canopen is not None:
            self.canopen.error(code, error_register(code))

    @property
    def error_register(self) -> int:
        """ERROR REGISTER: of the fault that the drive is in."""
        return error_register(self.errors[0]) if self.axis.state in FAULTED and self.errors else 0

    def solve(self, now: float) -> None:
        """The cause is gone; the state stays FAULT until a master resets it."""
        self.tick(now)
        self.axis.cause = 0

    def reset_error(self) -> None:
        """The coil does what the edge of control bit 7 does."""
        self.axis.word &= ~DriveCommand.FAULT_RESET
        self._control(self.axis.word | DriveCommand.FAULT_RESET)
        self.axis.word &= ~DriveCommand.FAULT_RESET

    def _control(self, value: Value) -> None:
        was_fault = self.axis.state in FAULTED
        self.axis.control(int(value), self.now)
        if was_fault and self.axis.state not in FAULTED and self.canopen is not None:
            self.canopen.no_error()
        self._follow_torque()
        self._follow_reference()

    def _follow_torque(self) -> None:
        """Torque mode: towards TARGET TORQUE with TORQUE SLOPE, or back to nothing."""
        on = self.axis.mode == axis.TORQUE and self.axis.state is State.OPERATION_ENABLED
        slope = self.motion.torque_slope()
        self.torque.move(self.now, self.motion.target_torque() if on else 0.0, slope, slope, slope, jerky=True)

    def _follow_reference(self) -> None:
        on = self.axis.state is State.OPERATION_ENABLED
        wanted = self.store.number("V REF SETPOINT") if on else 0.0
        slope = self.motion.voltage_ramp(wanted - self.reference.position(self.now))
        self.reference.move(self.now, wanted, slope, slope, slope, jerky=True)

    # What the shaft does, in the units of the drive

    @property
    def speed(self) -> float:
        """VELOCITY ACTUAL VALUE."""
        return self.motion.shown_velocity(self.axis.trajectory.velocity(self.now))

    @property
    def torque_nm(self) -> float:
        """What the flywheel and its friction need, or in torque mode what was asked for."""
        if self.axis.state not in CURRENT_ON:
            return 0.0
        asked = self.torque.position(self.now) / 1000 * self.rated_torque
        turn = 2 * pi / self.motion.increments
        way = self.axis.trajectory
        return asked + turn * (INERTIA * way.acceleration(self.now) + FRICTION * way.velocity(self.now))

    @property
    def rated_torque(self) -> float:
        """MOTOR RATED TORQUE in Nm."""
        return (self.store.number("MOTOR RATED TORQUE") or 1.0) / 1000

    @property
    def torque_permille(self) -> float:
        """TORQUE ACTUAL VALUE."""
        return 1000 * self.torque_nm / self.rated_torque

    @property
    def current(self) -> float:
        """Amperes: the rated current gives the rated torque; while it is phased it is the alignment current."""
        if self.service.is_phasing:
            return self.store.number("ALIGNMENT CURRENT")
        return abs(self.torque_permille) / 1000 * self.store.number("MOTOR RATED CURRENT") / 1000

    @property
    def bus_voltage(self) -> float:
        """The supply gives way a little under current."""
        return max(0.0, self.voltage - 0.05 * self.current)


def error_register(code: int) -> int:
    """The error register while this error is there.

    >>> hex(error_register(0x3210)), hex(error_register(0x7305))
    ('0x5', '0x1')
    """
    return GENERIC_ERROR | ERROR_CLASSES.get(code >> 12, 0)
