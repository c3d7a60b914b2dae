"""The CSD MT stepper drive, behaving: CiA 402 on holding registers over Modbus TCP.      [CSD MT manual, ch. 9 to 14]

        1040 control word --> axis (axis.py) --> 1001 status word     1004 position     1020 velocity
        1041 mode: 1 profile position, 3 profile velocity, 6 homing --> 1002

Function 04 returns the same registers as 03, since nothing is mapped elsewhere (ch. 10). Register 1162 turns every
32-bit value round at once. The protections, the memory and the small registers are in `csd_mt_service`.

Simplified: steps are never lost, so nothing of encoder windows and Auto Sync acts; limit switches, start and halt from
inputs and the touch probe are stored, not carried out; the brake delays are stored, the brake acts at once; at current
off the shaft is drawn braking, where a real one coasts. Homing methods with a switch find it `home_at`.
"""

from __future__ import annotations

from math import inf

from barewire.codecs import Value
from barewire.devices.cia402 import State
from barewire.devices.device import Device
from barewire.devices.sim import axis
from barewire.devices.sim.axis import CURRENT_ON, Axis
from barewire.devices.sim.csd_mt_service import Service
from barewire.devices.sim.modbus_face import ModbusFace
from barewire.devices.sim.simulator import Simulator
from barewire.devices.sim.store import Declined
from barewire.devices.sim.trajectory import Trajectory, wrapped
from barewire.modbus.message import Response

START_STOP = 16_000
"""At most this many steps per second are reached without a ramp (ch. 12, motion profiles)."""

POWER_DELAY = 0.5
"""How long the power section must be supplied before SWITCHED ON (ch. 11, transition 3)."""

MODES = (0, axis.POSITION, axis.VELOCITY, axis.HOMING)
ON_THE_SPOT = (35, 37)
WARNING, FOLLOWING_ERROR, RAMPING = 1 << 7, 1 << 13, 1 << 15
FOLLOWING = 0x8611


class CsdMtFace(ModbusFace):
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

    >>> from barewire.devices.load import load
    >>> from barewire.modbus.registers import ReadHoldingRegisters, WriteSingleRegister
    >>> drive = CsdMt(load("csd-mt"))
    >>> for word in (0x06, 0x07, 0x0F):
    ...     _ = drive.modbus.handle(WriteSingleRegister(1040, word), now=1.0)
    ...     print(f"{drive.modbus.handle(ReadHoldingRegisters(1001, 1), now=1.0).registers[0]:04X}h")
    0231h
    0233h
    0637h
    """

    def __init__(self, device: Device, now: float = 0.0) -> None:
        super().__init__(device, now)
        self.home_at = 25_600.0
        """Where the home switch is, in steps from where the shaft stood at power-on."""
        self.powered_since: float | None = -inf
        self.ever_enabled = False
        self.heard_at = now
        self.axis = self._new_axis()
        self.service = Service(self)
        store = self.store
        store.measure("Status Word", self.status)
        store.measure("Mode of Operation Display", lambda: self.axis.mode)
        store.measure("Position Actual Value", lambda: wrapped(self.axis.way.position(self.now)))
        store.measure("Velocity Actual Value", lambda: self.axis.way.velocity(self.now))
        store.after("Control Word", self._control)
        store.after("Mode of Operation", lambda value: self.axis.change_mode(self.now))
        store.after("Profile Velocity", lambda value: self.axis.replan(self.now))
        for name in ("Target Velocity", "Max Motor Speed"):  # new ramps wait for the next movement (1046)
            store.after(name, lambda value: self.axis.follow(self.now))
        store.veto("Mode of Operation", self._check_mode)
        store.veto("Profile Velocity", self._check_velocity)

    def _modbus_face(self) -> ModbusFace | None:
        assert self.device.modbus is not None
        return CsdMtFace(self, self.device.modbus)

    def _new_axis(self) -> Axis:
        new = Axis(self, stays_in_quick_stop=True)  # option code 5 (ch. 11, transitions 12 and 16)
        new.powered_since, new.power_delay = self.powered_since, POWER_DELAY
        return new

    # Time, power, faults

    def tick(self, now: float) -> None:
        """The watchdog first: it acted when its time was over, not when somebody looks."""
        limit = self.store.whole("Counter Watchdog") / 1000
        if limit and now - self.heard_at > limit and self.axis.state in CURRENT_ON:
            self.now = max(self.now, self.heard_at + limit)
            self.axis.fault(0, self.now)  # no code is printed for it
            self.service.log(0)
        super().tick(now)
        self.axis.tick(self.now)
        self.service.tick()

    def supply(self, on: bool, now: float) -> None:
        """Switch the power section (24 to 48 V) on or off; the logic has a supply of its own."""
        self.tick(now)
        self.powered_since = self.now if on else None
        self.axis.powered_since = self.powered_since
        if not on and self.axis.state in CURRENT_ON | {State.SWITCHED_ON}:
            self.fault(0x5100, now)
        elif on and self.axis.cause == 0x5100:
            self.solve(now)

    def fault(self, code: int, now: float) -> None:
        """Let a protection act: 2130h, 4310h, 5100h, 8400h or 8611h (register 1007). It lasts until `solve`."""
        self.tick(now)
        # Only a following error in profile velocity brakes the motor before the current goes (register 1085, A to C).
        reaction = code == FOLLOWING and self.axis.mode == axis.VELOCITY
        self.axis.fault(code, self.now, reaction=reaction)
        self.service.log(code)

    def solve(self, now: float) -> None:
        """The cause of the fault is gone; the state stays FAULT until the master resets it."""
        self.tick(now)
        self.axis.cause = 0

    def reset(self) -> None:
        """Logic supply off and on: the drive wakes in SWITCH ON DISABLED with what it has stored."""
        super().reset()
        self.heard_at = self.now
        self.ever_enabled = False
        self.axis = self._new_axis()
        self.service.power_on()

    # The registers that move things

    def _control(self, value: Value) -> None:
        before = self.axis.state
        self.axis.control(int(value), self.now)
        if before not in CURRENT_ON and self.axis.state is State.OPERATION_ENABLED and not self.ever_enabled:
            self.ever_enabled = True
            if self.store.whole("Reset Encoder On First Power Up"):
                self.axis.rest_at(0.0, self.now)

    def _check_mode(self, value: Value) -> None:
        if value not in MODES:
            raise Declined("value", f"mode {int(value)}: expected 1, 3 or 6")

    def _check_velocity(self, value: Value) -> None:
        # "While the motor runs, 0 is not accepted and the value before stays" (ch. 12, multi-set-point).
        if not value and self.axis.way.moves(self.now):
            raise Declined("value", "Profile Velocity 0 while the motor runs")

    def status(self) -> int:
        """Register 1001: the axis, and what 1105 and 1107 add to it."""
        word = self.axis.status(self.now)
        if self.axis.state is State.FAULT_REACTION_ACTIVE:
            word |= FOLLOWING_ERROR
        if self.store.whole("Enable SW bit 7") and self.service.is_warm:
            word |= WARNING
        ramps = self.axis.mode in (axis.POSITION, axis.HOMING) and self.axis.way.acceleration(self.now) != 0
        if self.store.whole("Enable SW bit 15") and ramps:
            word |= RAMPING
        return word

    # Settings of the axis: steps and seconds are the units of the drive too

    def mode(self) -> int:
        """Register 1041."""
        return self.store.whole("Mode of Operation")

    def target_position(self) -> float:
        """Register 1042."""
        return self.store.number("Target Position")

    def target_velocity(self) -> float:
        """Register 1048, limited by 1074; a limit of 0 is taken for none."""
        wanted, limit = self.store.number("Target Velocity"), self.store.number("Max Motor Speed")
        return max(-limit, min(wanted, limit)) if limit else wanted

    def profile_velocity(self) -> float:
        """Register 1044."""
        return self.store.number("Profile Velocity")

    def acceleration(self) -> float:
        """Register 1046."""
        return self.store.number("Profile Acceleration")

    def deceleration(self) -> float:
        """Register 1072 in profile velocity; a position move brakes with 1046: it is a trapezoid if PV² < PA·ΔS."""
        ramps = {axis.POSITION: "Profile Acceleration", axis.HOMING: "Homing Acceleration"}
        return self.store.number(ramps.get(self.axis.mode, "Profile Deceleration"))

    def without_ramp(self, velocity: float) -> bool:
        """Up to 16000 steps per second a move is start-stop (ch. 12, motion profiles)."""
        return velocity <= START_STOP

    def velocity_window(self) -> tuple[float, float]:
        """Registers 1062 and 1063, read as CiA 402 means them."""
        return self.store.number("Velocity Window"), self.store.number("Velocity Window Time") / 1000

    def zero_window(self) -> tuple[float, float]:
        """Registers 1064 and 1065."""
        return self.store.number("Velocity Threshold"), self.store.number("Velocity Threshold Time") / 1000

    def home(self, way: Trajectory, now: float) -> float | None:
        """Fast to the switch; the slow search for its edge is left out. What is found is called +offset (ch. 12)."""
        store = self.store
        method = store.whole("Homing Method")
        if method in ON_THE_SPOT:
            return store.number("Homing Offset")
        if method == 0:
            return None
        rate = store.number("Homing Acceleration")
        way.move(now, self.home_at, store.number("Homing Speed During Search for Switch"), rate, rate)
        return store.number("Homing Offset")
