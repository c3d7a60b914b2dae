"""The CSD MT stepper drive, simulated: CiA 402 on holding registers over Modbus TCP.    [CSD MT manual, ch. 9 to 14]

        1040 control word --> axis --> command --> shaft --> encoder --> 1004 position, 1020 velocity
                               |  ^                  |
        1001 status word <-----'  '- inputs <- edges '<----- environment: switches, walls, load, supply, temperature

Simulated: the states with their delays and the brake; position, velocity and homing mode with ramps; inputs, limit
switches, touch probe and index pulse; lost steps, Auto Sync and following errors; current and temperature; watchdog,
alarm log, outputs and saved parameters. A user sets the `environment`; its `model` is CSD MT 94 or CSD MT S4. Nothing
is computed in steps of time: `tick` collects the times of the next actions of all parts, and carries these out in their
order (a switch is passed, a watchdog runs out, a brake has opened). So the behaviour between two requests does not
depend on how often the drive is read. Function 04 returns the same registers as 03: nothing is mapped elsewhere
(ch. 10).

Decided here, because the manual leaves it open:

* 1114 and 1121: writing 1121 always resets the position, writing 1081 and 1092 if 1114 is 1.
* 1007 keeps a code until its cause is gone; the code of a fault that is over at once (8611h, 8400h) until the reset.
* After 4310h the drive stays in FAULT until it is cool AND has been reset (transition 15; register 1125 can be read
  otherwise). A shaft that is too fast at current on (1116) is 8400h. The watchdog has no code.
* Reactions 0 and 1 of 1085 only set bit 13; reaction 2 is an error with a code and an entry in the log.
* Bit 23 of 1008 always shows Auto Sync, bit 14 of the status word if 1106 is 1.
* A halt, a limit and a quick stop brake with 1046 (position), 1056 (homing), 1072 (velocity).
* After Safe Torque Off an S4 is in SWITCH ON DISABLED, without an error.

Only stored, because the manual does not describe the effect: 1068 and 1070 (position range limits, ch. 15 only), the
delay of a busy output (1104; no value of 1089 connects that output), 1109 and 1117 to 1120 except for the speed of
recovery and the current, and new network registers. A real drive follows a control word after up to 12 ms.
"""

from __future__ import annotations

from collections.abc import Iterator

from barewire.codecs import Value
from barewire.devices.cia402 import FAULT_STATES, IMMEDIATELY, REACHED, State
from barewire.devices.device import Device, ModbusSettings
from barewire.devices.sim.cia402_axis import CURRENT_ON, HOMING, POSITION, VELOCITY
from barewire.devices.sim.csd_mt.axis import StepperAxis
from barewire.devices.sim.csd_mt.environment import FOLLOWING, NO_POWER, Context, Environment, TimedAction
from barewire.devices.sim.csd_mt.inputs import Edges, Inputs
from barewire.devices.sim.csd_mt.registers import ServiceRegisters, ThermalModel
from barewire.devices.sim.csd_mt.shaft import Shaft
from barewire.devices.sim.machine import EnvironmentProperty, Simulator
from barewire.devices.sim.modbus import ModbusAdapter
from barewire.devices.sim.store import Declined
from barewire.modbus.messages.base import Response

_MODES = (0, POSITION, VELOCITY, HOMING)
_WARNING, _LIMITED, _FOLLOWING_ERROR, _CLOSED_LOOP, _RAMPING = 1 << 7, 1 << 11, 1 << 13, 1 << 14, 1 << 15
"""Bits of the status word that are not those of CiA 402."""

_MOST_EVENTS = 1000
"""The most events in one tick: an impossible environment (walls.low above walls.high) causes events without end."""


class CsdMtModbusAdapter(ModbusAdapter):
    """03, 04, 06 and 10h, and a watchdog that every request resets."""

    def __init__(self, drive: CsdMt, settings: ModbusSettings) -> None:
        super().__init__(drive, settings)
        self.drive = drive

    def images(self) -> None:
        """Let function 04 read the same registers as 03."""
        super().images()
        self.reads[0x04] = self.reads[0x03]

    def handle(self, request: object, now: float) -> Response | None:
        """Handle a request like `ModbusAdapter`; every message resets the watchdog of register 1097."""
        self.drive.tick(now)
        self.drive.request_at = now
        return super().handle(request, now)


class CsdMt(Simulator):
    """A CSD MT 94 with a motor of 12800 steps per revolution, supplied with 24 V for logic and 48 V for power.

    >>> from barewire.devices.description.load import load
    >>> from barewire.modbus.messages.registers import ReadHoldingRegisters, WriteSingleRegister
    >>> drive = CsdMt(load("csd-mt"))
    >>> for word, now in ((0x06, 1.0), (0x07, 2.0), (0x0F, 3.0)):
    ...     _ = drive.modbus.handle(WriteSingleRegister(1040, word), now)
    ...     print(f"{drive.modbus.handle(ReadHoldingRegisters(1001, 1), now + 0.3).registers[0]:04X}h")
    0231h
    0233h
    0637h
    """

    modbus_adapter = CsdMtModbusAdapter
    modbus: CsdMtModbusAdapter

    def __init__(self, device: Device, now: float = 0.0) -> None:
        super().__init__(device, now)
        self.environment = Environment()
        """The surroundings of the drive. They may be changed at any time."""
        self.context = context = Context(self.clock, self.store, self.environment)
        self.shaft = Shaft(context)
        self.inputs = Inputs(context, self.shaft)
        self.axis = StepperAxis(context, self.shaft, self.inputs)
        self.edges = Edges(context, self.shaft, self.inputs, self.axis)
        self.thermal = ThermalModel(context, self.shaft, self.axis)
        self.registers = ServiceRegisters(context, self.shaft, self.axis)
        self._parts = (self.axis, self.shaft, self.edges, self.thermal, self.registers)
        self.request_at = now
        """When the last request came, for the watchdog."""
        store = self.store
        store.measure("Status Word", self.status)
        store.measure("Mode of Operation Display", lambda: self.axis.mode)
        store.measure("Position Actual Value", self.shaft.shown_position)
        store.measure("Velocity Actual Value", self.shaft.shown_velocity)
        store.after("Control Word", self._control)
        store.after("Mode of Operation", lambda value: self.axis.change_mode(self.now))
        store.after("Profile Velocity", self._new_velocity)
        for name in ("Target Velocity", "Max Motor Speed"):  # new ramps wait for the next movement (1046)
            store.after(name, lambda value: self.axis.follow(self.now))
        store.veto("Mode of Operation", self._check_mode)
        store.veto("Profile Velocity", self._check_velocity)

    # Time

    def _events(self) -> Iterator[TimedAction]:
        limit = self.store.integer("Counter Watchdog") / 1000
        if limit and self.axis.state not in FAULT_STATES:
            yield self.request_at + limit, lambda: self.axis.protect(0)
        if self.environment.has_power != (self.axis.powered_since is not None):
            yield self.now, self._power_changed
        if self.environment.safe_torque_off and self.shaft.has_current:
            yield self.now, self.axis.torque_off
        for part in self._parts:
            yield from part.events()

    def tick(self, now: float) -> None:
        """Carry out what happens until `now`, each event at its time and in its order."""
        before = self.now
        super().tick(now)
        # The clock goes back, and then from event to event: each part sees the time of what is carried out.
        until, self.clock.now = self.now, before
        self.shaft.rescale()
        for _ in range(_MOST_EVENTS):
            # All times are computed again after each event, which may have changed every other one.
            due, act = min(self._events(), key=lambda event: event[0])
            if due > until:
                break
            self._pass(max(due, self.now))
            act()
        self._pass(until)

    def _pass(self, now: float) -> None:
        self.thermal.advance(now)
        self.clock.now = now
        self.axis.tick(now)

    # Environment

    def environment_properties(self) -> tuple[EnvironmentProperty, ...]:
        """Return the attributes of the environment."""
        return self.environment.properties()

    def supply(self, on: bool, now: float) -> None:
        """Switch the supply of the power section (48 V) on or off; the logic has a supply of its own."""
        self.voltage(48.0 if on else 0.0, now)

    def voltage(self, volts: float, now: float) -> None:
        """Set the voltage of the power section: 24 to 48 V, ±10 %, are in range."""
        self.tick(now)
        self.environment.volts = volts
        self.tick(now)

    def _power_changed(self) -> None:
        if self.environment.has_power:
            self.axis.powered_since = self.now
            if self.axis.cause == NO_POWER:
                self.axis.cause = 0
        else:
            self.axis.powered_since = None
            if self.axis.state in CURRENT_ON | {State.SWITCHED_ON}:
                self.axis.protect(NO_POWER, transient=False)

    def slip(self, steps: float, now: float) -> None:
        """Turn the shaft by a number of steps against the motor: the load was too much, and steps are lost."""
        self.tick(now)
        self.shaft.slip(steps)
        self.tick(now)

    def turn(self, velocity: float, now: float) -> None:
        """Turn a shaft without current, by hand or by a sinking load, with a velocity in step/s. Friction stops it."""
        self.tick(now)
        if not self.shaft.has_current:
            self.shaft.turn(velocity)

    def fault(self, code: int, now: float) -> None:
        """Let a protection act: 2130h, 4310h, 5100h, 8400h or 8611h (register 1007). It lasts until `solve`."""
        self.tick(now)
        if code == FOLLOWING:
            self.axis.following_error(transient=False)
        else:
            self.axis.protect(code, transient=False)

    def solve(self, now: float) -> None:
        """End the cause of the fault; the state stays FAULT until a client resets it."""
        self.tick(now)
        self.axis.cause = 0

    def reset(self) -> None:
        """Switch the logic supply off and on: SWITCH ON DISABLED, position 0, the saved parameters.

        The shaft and the environment stay as they are.
        """
        self.shaft.current_off()
        super().reset()
        self.axis.restart()
        self.shaft.rescale()
        self.shaft.renumber(0.0, self.shaft.position(self.now))
        self.edges.restart()
        self.request_at = self.now
        self.registers.restart()

    # Registers

    def _control(self, value: Value) -> None:
        self.axis.control(int(value), self.now)
        self.tick(self.now)

    def _new_velocity(self, value: Value) -> None:
        # With bit 5 "changed immediately", without it "only after the target was reached" (multi-set-point mode).
        if self.axis.word & IMMEDIATELY:
            self.axis.replan(self.now)

    def _check_mode(self, value: Value) -> None:
        if value not in _MODES:
            raise Declined("value", f"mode {int(value)}: expected 1, 3 or 6")

    def _check_velocity(self, value: Value) -> None:
        # "While the motor runs, 0 is not accepted and the value before stays" (ch. 12, multi-set-point).
        if not value and self.axis.trajectory.moves(self.now):
            raise Declined("value", "Profile Velocity 0 while the motor runs")

    def status(self) -> int:
        """Return register 1001: the status of the axis, and the bits of the other parts (1105 to 1107)."""
        axis, store = self.axis, self.store
        word = axis.status(self.now)
        if self.shaft.error or (axis.state is State.FAULT_REACTION_ACTIVE and axis.cause == FOLLOWING):
            word |= _FOLLOWING_ERROR
        if self.shaft.recovering:
            word &= ~(1 << REACHED)
        if self.inputs.limited:
            word |= _LIMITED
        if store.integer("Enable SW bit 7") and self.thermal.is_warm:
            word |= _WARNING
        if store.integer("Enable SW bit 14") and self.shaft.closed_loop:
            word |= _CLOSED_LOOP
        ramps = axis.mode in (POSITION, HOMING) and axis.trajectory.acceleration(self.now) != 0
        if store.integer("Enable SW bit 15") and ramps:
            word |= _RAMPING
        return word
