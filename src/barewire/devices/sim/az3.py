"""The AZ3 servo drive, behaving: one machine with two faces, Modbus RTU and CANopen.    [ST.TEC.022, ST.TEC.071]

        holding 155, 6040h  CONTROL WORD --> axis --> STATUS WORD  input 25, 6041h
                                               '----> one bit for each state: coils 81 to 88, which are bits of 201Bh
        MODES OF OPERATION  1 position   3 velocity   4 torque

The state machine is that of CiA 402. The drive has no quick stop option code, so its default, 2, is taken: it brakes
and goes to SWITCH ON DISABLED by itself. A user unit of velocity is taken for a revolution per minute (VELOCITY FACTOR
60 over 1), a unit of position for an increment of the encoder.

Simplified: the motor is a flywheel with friction, so torque follows acceleration and speed; in torque mode the shaft is
held and only the torque moves; position mode is that of the set-point bit; homing, phasing, brakes, digital inputs and
selectors are stored, not carried out. Which variable a CHANNEL_SEL number means is not described; `MONITORED` is this
simulator's own list.
"""

from __future__ import annotations

from math import pi
from typing import Any

from barewire.codecs import Value
from barewire.devices.cia402 import Command, State
from barewire.devices.device import Device
from barewire.devices.sim import axis
from barewire.devices.sim.axis import CURRENT_ON, FAULTED, Axis
from barewire.devices.sim.az3_values import hang_values
from barewire.devices.sim.modbus_face import ModbusFace
from barewire.devices.sim.simulator import Simulator
from barewire.devices.sim.trajectory import Trajectory
from barewire.modbus.exceptions import ILLEGAL_DATA_VALUE, ILLEGAL_FUNCTION, ModbusException
from barewire.modbus.identification import (
    BASIC,
    INDIVIDUAL,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
)
from barewire.modbus.message import Response

IDENTITY = ((0, b"TEM"), (1, b"AZ3"), (2, b"1.84"))
"""VendorName, ProductCode, MajorMinorRevision: the newest firmware that the guides name."""

SAVE = 0x65766173
"""The letters "save", what CiA 301 wants in 1010h:01; the guides do not say another value."""

INERTIA, FRICTION = 2e-4, 2e-4
"""kg m², Nm s: a small motor with some load."""

SUPPLY = 48.0
GENERIC_ERROR = 0x01
SLOWEST_RAMP = 1.0


class Az3Face(ModbusFace):
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
    >>> from barewire.devices.load import load
    >>> from barewire.modbus.registers import WriteSingleRegister
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
        self.axis = self._new_axis()
        self.torque = Trajectory()
        """Torque mode: the torque in ‰ of the rated one, moved like a position."""
        self.errors: list[int] = []
        if device.canopen is not None:
            self.store.cell("BOOT CAN NODE").default = device.canopen.node
            self.store["BOOT CAN NODE"] = device.canopen.node
        hang_values(self)
        store = self.store
        for name in ("TARGET VELOCITY", "MAX MOTOR SPEED"):
            store.after(name, lambda value: self.axis.follow(self.now))
        store.after("CONTROL WORD", self._control)
        store.after("MODES OF OPERATION", lambda value: self.axis.change_mode(self.now))
        store.after("PROFILE VELOCITY", lambda value: self.axis.replan(self.now))
        store.after("TARGET TORQUE", lambda value: self._follow_torque())
        store.after("STORE ALL PARAMETERS", self._save)
        for name, act in (
            ("RESET ERROR", self._reset_error),
            ("RESET POSITION", lambda: self.axis.rest_at(0.0, self.now)),
            ("SOFTWARE RESET", lambda: self.power_cycle(self.now)),
            ("POWER OFF RESET", lambda: self.power_cycle(self.now)),
        ):
            store.after(name, self._button(name, act))

    def _modbus_face(self) -> ModbusFace | None:
        assert self.device.modbus is not None
        return Az3Face(self, self.device.modbus)

    def _button(self, name: str, act: Any) -> Any:
        """A coil that is a push-button: it acts when it is switched on, and falls back."""

        def pressed(on: Value) -> None:
            if on:
                self.store[name] = False
                act()

        return pressed

    def _new_axis(self) -> Axis:
        new = Axis(self, stays_in_quick_stop=False)
        new.mode = self.mode()
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

    def reset(self) -> None:
        """As at power-on: stored parameters, a new axis at position 0."""
        super().reset()
        self.axis = self._new_axis()
        self.torque = Trajectory()
        if self.canopen is not None:
            self.canopen.node.errors.reset(communication_only=False)

    def fault(self, code: int, now: float) -> None:
        """Let a protection act: the shaft is braked (FAULT REACTION ACTIVE), then FAULT, and an emergency on CAN."""
        self.tick(now)
        self.axis.fault(code, self.now, reaction=True)
        self.errors = [code, *self.errors][:8]
        if self.canopen is not None:
            self.canopen.error(code, GENERIC_ERROR)

    def solve(self, now: float) -> None:
        """The cause is gone; the state stays FAULT until a master resets it."""
        self.tick(now)
        self.axis.cause = 0

    def _reset_error(self) -> None:
        """The coil does what the edge of control bit 7 does."""
        self.axis.word &= ~Command.FAULT_RESET
        self._control(self.axis.word | Command.FAULT_RESET)
        self.axis.word &= ~Command.FAULT_RESET

    def _control(self, value: Value) -> None:
        was_fault = self.axis.state in FAULTED
        self.axis.control(int(value), self.now)
        if was_fault and self.axis.state not in FAULTED and self.canopen is not None:
            self.canopen.no_error()
        self._follow_torque()

    def _follow_torque(self) -> None:
        """Torque mode: towards TARGET TORQUE with TORQUE SLOPE, or back to nothing."""
        on = self.axis.mode == axis.TORQUE and self.axis.state is State.OPERATION_ENABLED
        limit = self.store.number("MAX TORQUE")
        wanted = max(-limit, min(limit, self.store.number("TARGET TORQUE"))) if on else 0.0
        slope = max(self.store.number("TORQUE SLOPE"), SLOWEST_RAMP)
        self.torque.move(self.now, wanted, slope, slope, slope, jerky=True)

    def _save(self, value: Value) -> None:
        """Everything that can be written is stored; where the guides do not say what is, more is the safer reading."""
        if value == SAVE:
            self.saved = self.store.snapshot(lambda cell: cell.parameter.writable and cell.measured is None)
            self.saved |= {
                name: 0 for name in ("CONTROL WORD", "TARGET VELOCITY", "TARGET TORQUE") if name in self.saved
            }
        self.store["STORE ALL PARAMETERS"] = 0

    # What the shaft does, in the units of the drive

    @property
    def increments(self) -> float:
        """Increments of position in a revolution of the motor."""
        revolutions = self.store.number("POSITION ENCODER RESOLUTION MOTOR REVOLUTIONS")
        return (self.store.number("POSITION ENCODER RESOLUTIONS INCREMENTS") or 1.0) / (revolutions or 1.0)

    def _steps(self, rpm: float) -> float:
        return rpm * self.increments / 60

    @property
    def speed(self) -> float:
        """Revolutions per minute."""
        return self.axis.way.velocity(self.now) * 60 / self.increments

    @property
    def torque_nm(self) -> float:
        """What the flywheel and its friction need, or in torque mode what was asked for."""
        if self.axis.state not in CURRENT_ON:
            return 0.0
        asked = self.torque.position(self.now) / 1000 * self.rated_torque
        turn = 2 * pi / self.increments
        way = self.axis.way
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
        """Amperes: the rated current gives the rated torque."""
        return abs(self.torque_permille) / 1000 * self.store.number("MOTOR RATED CURRENT") / 1000

    @property
    def bus_voltage(self) -> float:
        """The supply gives way a little under current."""
        return SUPPLY - 0.05 * self.current

    # Settings of the axis

    def mode(self) -> int:
        """6060h."""
        return self.store.whole("MODES OF OPERATION")

    def target_position(self) -> float:
        """607Ah."""
        return self.store.number("TARGET POSITION")

    def target_velocity(self) -> float:
        """60FFh, not above MAX MOTOR SPEED."""
        limit = self.store.number("MAX MOTOR SPEED")
        return self._steps(max(-limit, min(limit, self.store.number("TARGET VELOCITY"))))

    def profile_velocity(self) -> float:
        """6081h, not above MAX PROFILE VELOCITY."""
        return self._steps(min(self.store.number("PROFILE VELOCITY"), self.store.number("MAX PROFILE VELOCITY")))

    def acceleration(self) -> float:
        """6083h; a ramp of 0 would never arrive, so the slowest is one unit."""
        return self._steps(max(self.store.number("PROFILE ACCELERATION"), SLOWEST_RAMP))

    def deceleration(self) -> float:
        """6084h."""
        return self._steps(max(self.store.number("PROFILE DECELERATION"), SLOWEST_RAMP))

    def without_ramp(self, velocity: float) -> bool:
        """This drive always has ramps."""
        return False

    def velocity_window(self) -> tuple[float, float]:
        """The guides list no velocity window: one unit, at once."""
        return self._steps(1.0), 0.0

    def zero_window(self) -> tuple[float, float]:
        """As the velocity window."""
        return self._steps(1.0), 0.0

    def home(self, way: Trajectory, now: float) -> float | None:
        """The guides list no homing."""
        return None
