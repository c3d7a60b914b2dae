"""The CSD MT stepper drive, behaving: CiA 402 on holding registers over Modbus TCP.      [CSD MT manual, ch. 9 to 14]

        1040 control word --> axis --> command --> shaft --> encoder --> 1004 position, 1020 velocity
                               |  ^                  |
        1001 status word <-----'  '---- inputs <-----'---- world: switches, walls, load, supply, warmth

    csd_mt_world     what a user sets: `drive.world`             csd_mt_shaft    lost steps, Auto Sync, following error
    csd_mt_inputs    switches, 1067, 1088, touch probe           csd_mt_homing   each method as a search
    csd_mt_axis      delays, limits, set-points                  csd_mt_heat     current and temperature
    csd_mt_service   memory, log, outputs, small registers       axis            what any CiA 402 drive does

Nothing is stepped. `tick` asks every part when it will do something by itself, and acts at these moments in their
order: a switch is passed, a watchdog runs out, a brake has opened. So what a drive does between two requests does not
depend on how often somebody looks. Function 04 returns the same registers as 03: nothing is mapped elsewhere (ch. 10).

Where the manual leaves it open:

* 1114 and 1121: writing 1121 always resets the position, writing 1081 and 1092 if 1114 is 1.
* 1007 keeps a code until its cause is gone; the code of a fault that is over at once (8611h, 8400h) until the reset.
* After 4310h the drive stays in FAULT until it is cool AND has been reset (transition 15; register 1125 can be read
  otherwise). A too fast shaft at current on (1116) is 8400h. The watchdog has no code.
* Bit 13 alone is set by reactions 0 and 1 of 1085; only reaction 2 is an error with a code and a line in the log.
* Bit 23 of 1008 tells of Auto Sync always, bit 14 of the status word if 1106 is 1.
* A halt, a limit and a quick stop brake with 1046 (position), 1056 (homing), 1072 (velocity).

Not carried out, because the manual does not say what it does: 1068 and 1070 (position range limits, ch. 15 only), a
busy output (no value of 1089 connects it; `service.busy` says what it would), 1109 and 1117 to 1120 but for the speed
of recovery and the current, and when new network registers act. A real drive follows a control word after up to 12 ms.

`environment.model` chooses between CSD MT 94 and CSD MT S4. The manual does not print the state of an S4 after Safe
Torque Off: here SWITCH ON DISABLED, without an error.
"""

from __future__ import annotations

from collections.abc import Iterator

from barewire.codecs import Value
from barewire.devices.device import Device
from barewire.devices.drive.cia402 import State
from barewire.devices.sim.core.modbus import ModbusAdapter
from barewire.devices.sim.core.simulator import Simulator
from barewire.devices.sim.core.store import Declined
from barewire.devices.sim.csd_mt.axis import Event, StepperAxis
from barewire.devices.sim.csd_mt.environment import Environment
from barewire.devices.sim.csd_mt.inputs import Inputs
from barewire.devices.sim.csd_mt.registers import Service
from barewire.devices.sim.csd_mt.shaft import Shaft
from barewire.devices.sim.csd_mt.thermal import Heat
from barewire.devices.sim.motion import cia402_axis as axis
from barewire.devices.sim.motion.cia402_axis import CURRENT_ON, FAULTED, IMMEDIATELY
from barewire.modbus.messages.base import Response

POWER_DELAY = 0.5
"""How long the power section must be supplied before SWITCHED ON (ch. 11, transition 3)."""

SUPPLY = 24 * 0.9, 48 * 1.1
"""Volts between which the power supply is in range (ch. 14, 5100h)."""

MODES = (0, axis.POSITION, axis.VELOCITY, axis.HOMING)
WARNING, LIMITED, FOLLOWING_ERROR, CLOSED_LOOP, RAMPING = 1 << 7, 1 << 11, 1 << 13, 1 << 14, 1 << 15
NO_POWER, FOLLOWING = 0x5100, 0x8611

MOST_EVENTS = 1000
"""In one tick. No machine of any sense comes near; a world that contradicts itself must not hang us."""


class CsdMtFace(ModbusAdapter):
    """03, 04, 06, 10, and a watchdog over all of them."""

    def images(self) -> None:
        """04 reads what 03 reads."""
        super().images()
        self.reads[0x04] = self.reads[0x03]

    def handle(self, request: object, now: float) -> Response | None:
        """Every message, whatever it says, feeds the watchdog of register 1097."""
        assert isinstance(self.machine, CsdMt)
        self.machine.tick(now)
        self.machine.heard_at = now
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

    def __init__(self, device: Device, now: float = 0.0) -> None:
        super().__init__(device, now)
        self.environment = Environment()
        """What is around the drive. Change it at any time."""
        self.ever_enabled = False
        self.heard_at = now
        self.shaft = Shaft(self)
        self.axis = StepperAxis(self)
        self.axis.power_delay = POWER_DELAY
        self.inputs = Inputs(self)
        self.heat = Heat(self)
        self.service = Service(self)
        store = self.store
        store.measure("Status Word", self.status)
        store.measure("Mode of Operation Display", lambda: self.axis.mode)
        store.measure("Position Actual Value", self.shaft.shown)
        store.measure("Velocity Actual Value", self.shaft.speed_shown)
        store.after("Control Word", self._control)
        store.after("Mode of Operation", lambda value: self.axis.change_mode(self.now))
        store.after("Profile Velocity", self._new_velocity)
        for name in ("Target Velocity", "Max Motor Speed"):  # new ramps wait for the next movement (1046)
            store.after(name, lambda value: self.axis.follow(self.now))
        store.veto("Mode of Operation", self._check_mode)
        store.veto("Profile Velocity", self._check_velocity)

    def _modbus_face(self) -> ModbusAdapter | None:
        assert self.device.modbus is not None
        return CsdMtFace(self, self.device.modbus)

    # Time

    def _events(self) -> Iterator[Event]:
        limit = self.store.whole("Counter Watchdog") / 1000
        if limit and self.axis.state not in FAULTED:
            yield self.heard_at + limit, lambda: self.protect(0)
        if self._in_range != (self.axis.powered_since is not None):
            yield self.now, self._supply_changed
        if self.safe_torque_off and self.shaft.has_current:
            yield self.now, self.axis.torque_off
        for part in (self.axis, self.shaft, self.inputs, self.heat, self.service):
            yield from part.events()

    def tick(self, now: float) -> None:
        """What happened up to now, each at its time and in its order."""
        before = self.now
        super().tick(now)
        until, self.now = self.now, before
        self.shaft.rescale()
        for _ in range(MOST_EVENTS):
            at, act = min(self._events(), key=lambda event: event[0])
            if at > until:
                break
            self._pass(max(at, self.now))
            act()
        self._pass(until)

    def _pass(self, now: float) -> None:
        self.heat.creep(now)
        self.now = now
        self.axis.tick(now)

    # The world

    def supply(self, on: bool, now: float) -> None:
        """Switch the power section on (48 V) or off; the logic has a supply of its own."""
        self.voltage(48.0 if on else 0.0, now)

    def voltage(self, volts: float, now: float) -> None:
        """Supply the power section with so many volts: 24 to 48, ±10 %, are in range."""
        self.tick(now)
        self.environment.volts = volts
        self.tick(now)

    @property
    def _in_range(self) -> bool:
        return SUPPLY[0] <= self.environment.volts <= SUPPLY[1]

    def _supply_changed(self) -> None:
        if self._in_range:
            self.axis.powered_since = self.now
            if self.axis.cause == NO_POWER:
                self.axis.cause = 0
        else:
            self.axis.powered_since = None
            if self.axis.state in CURRENT_ON | {State.SWITCHED_ON}:
                self.protect(NO_POWER, passing=False)

    @property
    def safe_torque_off(self) -> bool:
        """Whether the motor may have no current (CSD MT S4, ch. 13)."""
        return self.environment.model == "S4" and not all(self.environment.sto)

    @property
    def edm(self) -> bool:
        """The monitor output of the CSD MT S4: closed when STO1 and STO2 are both OFF (table 27)."""
        return self.environment.model == "S4" and not any(self.environment.sto)

    def slip(self, steps: float, now: float) -> None:
        """Turn the shaft by so many steps against the motor: the load was too much, and steps are lost."""
        self.tick(now)
        self.shaft.slip(steps)
        self.tick(now)

    def turn(self, velocity: float, now: float) -> None:
        """Give the shaft a velocity while there is no current: a hand, a load that sinks. Friction ends it."""
        self.tick(now)
        if not self.shaft.has_current:
            self.shaft.turn(velocity)

    def fault(self, code: int, now: float) -> None:
        """Let a protection act: 2130h, 4310h, 5100h, 8400h or 8611h (register 1007). It lasts until `solve`."""
        self.tick(now)
        if code == FOLLOWING:
            self.following_error(passing=False)
        else:
            self.protect(code, passing=False)

    def solve(self, now: float) -> None:
        """The cause of the fault is gone; the state stays FAULT until the master resets it."""
        self.tick(now)
        self.axis.cause = 0

    def protect(self, code: int, *, passing: bool = True, reaction: bool = False) -> None:
        """To FAULT, with a line in the log. What is `passing` can be reset at once."""
        self.axis.fault(code, self.now, passing=passing, reaction=reaction)
        self.service.log(code)

    def following_error(self, *, passing: bool = True) -> None:
        """Reaction 2. In profile velocity FAULT waits until the shaft stands (register 1085, A to C)."""
        self.protect(FOLLOWING, passing=passing, reaction=self.axis.mode == axis.VELOCITY)

    def reset(self) -> None:
        """Logic supply off and on: the drive wakes in SWITCH ON DISABLED, at position 0, with what it has stored.

        The shaft, and all that is around the drive, stays as it is.
        """
        self.shaft.current_off()
        super().reset()
        powered = self.axis.powered_since
        self.axis = StepperAxis(self)
        self.axis.powered_since, self.axis.power_delay = powered, POWER_DELAY
        self.shaft.rescale()
        self.shaft.call(0.0, self.shaft.position(self.now))
        self.inputs.reset()
        self.heard_at = self.now
        self.ever_enabled = False
        self.service.power_on()

    # The registers that move things

    def _control(self, value: Value) -> None:
        self.axis.control(int(value), self.now)
        self.tick(self.now)

    def enabled(self) -> None:
        """Transition 4 is done: "the first time there is a reset of Position Actual Value, if 1114 is set"."""
        if not self.ever_enabled and self.store.whole("Reset Encoder On First Power Up"):
            self.axis.rest_at(0.0, self.now)
            self.axis.follow(self.now)
        self.ever_enabled = True

    def released(self) -> None:
        """The current went off."""
        if self.service.encoder_reset_waits:
            self.service.reset_encoder()

    def _new_velocity(self, value: Value) -> None:
        # With bit 5 "changed immediately", without it "only after the target was reached" (multi-set-point mode).
        if self.axis.word & IMMEDIATELY:
            self.axis.replan(self.now)

    def _check_mode(self, value: Value) -> None:
        if value not in MODES:
            raise Declined("value", f"mode {int(value)}: expected 1, 3 or 6")

    def _check_velocity(self, value: Value) -> None:
        # "While the motor runs, 0 is not accepted and the value before stays" (ch. 12, multi-set-point).
        if not value and self.axis.trajectory.moves(self.now):
            raise Declined("value", "Profile Velocity 0 while the motor runs")

    def status(self) -> int:
        """Register 1001: the axis, and what its parts and 1105 to 1107 add to it."""
        word, store = self.axis.status(self.now), self.store
        if self.shaft.lost or (self.axis.state is State.FAULT_REACTION_ACTIVE and self.axis.cause == FOLLOWING):
            word |= FOLLOWING_ERROR
        if self.shaft.recovering:
            word &= ~axis.REACHED
        if self.inputs.limited:
            word |= LIMITED
        if store.whole("Enable SW bit 7") and self.heat.is_warm:
            word |= WARNING
        if store.whole("Enable SW bit 14") and self.shaft.closed_loop:
            word |= CLOSED_LOOP
        ramps = self.axis.mode in (axis.POSITION, axis.HOMING) and self.axis.trajectory.acceleration(self.now) != 0
        if store.whole("Enable SW bit 15") and ramps:
            word |= RAMPING
        return word
