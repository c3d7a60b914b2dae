"""The registers of the CSD MT that do not move the motor: memory, alarm log, outputs, identity, temperature.

1260 = 6173h  the storable parameters -.
1260 = 1111h  IP, mask, gateway --------+-->  saved if the 24 V stay on for 5 s  (ch. 12)
1261 = 6F6Ch  the defaults ------------'

Any other value gets exception 03. The manual says that it stores nothing, and not how it is answered: this is a guess.

This file also has the write checks of single registers, and the registers that act on the encoder and on Auto Sync.
Network registers are saved and have no other effect.

Current and temperature (registers 1080, 1083, 1123 to 1126):

        current   = 1117 · 1080 %              in motion, and 80 ms after it
                  = 1117 · 1080 % · 1112 %     at standstill
        above 1125: status bit 7, if 1105 is 1       above 1126: fault 4310h, until it is below 1125 again

Simplified: the manual does not print how fast a drive warms up. Here it is a body with one time constant, heated by the
current in a resistance; its constants are plausible values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from math import exp, inf, log
from typing import NamedTuple

from barewire.codecs import Value
from barewire.devices.cia402 import FAULT_STATES
from barewire.devices.sim.cia402_axis import CURRENT_ON
from barewire.devices.sim.csd_mt.axis import StepperAxis, is_brake_config
from barewire.devices.sim.csd_mt.environment import OVERHEATED, AlarmLog, Context, TimedAction
from barewire.devices.sim.csd_mt.shaft import NO_ENCODER, Shaft
from barewire.devices.sim.store import Cell, Declined

_STORE, _STORE_NETWORK = 0x6173, 0x1111
_SAVING_TIME = 5.0
"""Seconds that saving takes."""
_NETWORK = range(1130, 1142)

_IDENTITY = {
    "Software Version": 31,
    "Product Code": 0x94,
    "Hardware Version": 1,
    "Serial Number": 1,
    "Read MAC Address 1": 0x0200,
    "Read MAC Address 2": 0x0000,
    "Read MAC Address 3": 0x0094,
}
"""Values chosen for this simulator: the manual does not print them."""

_DEFAULT_MOTOR = 0x1544
_SHORTEST_WATCHDOG = 100
_FAULT_ON_O2 = (0x1B, 0x23)
"""Values of Output Config (1089) that make O2 the fault output."""


class _Saving(NamedTuple):
    """Values on their way into the memory, and the time at which they are in it."""

    ends_at: float
    values: dict[str, Value]


class ServiceRegisters:
    """Memory, alarm log, outputs and small registers of one drive."""

    def __init__(self, context: Context, shaft: Shaft, axis: StepperAxis) -> None:
        self.context, self.store, self.shaft, self.axis = context, context.store, shaft, axis
        self._saving: _Saving | None = None
        store = self.store
        for name, value in _IDENTITY.items():
            store.cell(name).default = value  # for every later restart
            store[name] = value
        self._bind_writes()
        store.measure("Error Code", lambda: axis.cause)
        store.measure("Error Register", lambda: int(axis.state in FAULT_STATES))
        store.measure("Digital Output", self._outputs)
        for index in range(AlarmLog.SIZE):
            store.measure(f"Drive Alarm Time {index}", partial(self._alarm, index, 0))
            store.measure(f"Drive Alarm Code {index}", partial(self._alarm, index, 1))
        self._show_motor(store["Motor Code"])
        order = store.cell("Little Endian / Big Endian")
        # The description is little-endian: register 1162 = 1.
        store.words_reversed = lambda: order.held == 0

    def _bind_writes(self) -> None:
        checks: dict[str, Callable[[Value], None]] = {
            "Enable SW bit 7": self._excludes("Enable SW bit 15"),
            "Enable SW bit 15": self._excludes("Enable SW bit 7"),
            "Following Error Reaction Code": self._check_reaction,
            "Position Error Reset": self._check_position_reset,
            "Auto Sync Enable": self._check_auto_sync,
            "Output Config": self._check_outputs,
            "Counter Watchdog": self._check_watchdog,
            "Revolution Direction": self._check_direction,
            "Save All Parameters": self._check_signature,
        }
        actions: dict[str, Callable[[Value], None]] = {
            "Save All Parameters": self._save,
            "Restore All Default Parameters": self._restore,
            "Reset Error Logs": self._clear_log,
            "Read Temperature": lambda value: self.store.cell("Read Temperature").set(0),
            "Position Error Reset": self._reset_position_error,
            "Auto Sync Enable": lambda value: self.shaft.auto_sync_changed(),
            "Step Revolution": self._reset_encoder_if_enabled,
            "Revolution Direction": self._reset_encoder_if_enabled,
            "Encoder Count Per Revolution": self._new_encoder,
            "Motor Code": self._show_motor,
        }
        for name, check in checks.items():
            self.store.veto(name, check)
        for name, action in actions.items():
            self.store.after(name, action)

    # Memory

    def events(self) -> Iterator[TimedAction]:
        """Yield the time at which saving ends, and the action then."""
        yield self._saving.ends_at if self._saving else inf, self._saved

    def _saved(self) -> None:
        if self._saving is not None:
            self.store.saved = self._saving.values
            self._saving = None

    def restart(self) -> None:
        """Restore the state at power-on: unfinished saving is lost (ch. 12, registers 1260, 1261)."""
        self._saving = None
        self._show_motor(self.store["Motor Code"])

    def _save(self, value: Value) -> None:
        """Begin to save the parameters that belong to this signature."""
        values = self.store.snapshot(lambda cell: _saved_by(cell) == value)
        self._saving = _Saving(self.context.now + _SAVING_TIME, self.store.saved | values)
        self.store["Save All Parameters"] = 0

    def _restore(self, value: Value) -> None:
        """Set the storable parameters to their defaults, and begin to save that; network registers are kept."""
        store = self.store
        others = {name: held for name, held in store.saved.items() if _saved_by(store.cell(name)) != _STORE}
        self._saving = _Saving(self.context.now + _SAVING_TIME, others)
        for cell in store:
            if _saved_by(cell) == _STORE:
                cell.set(cell.default)
        store["Restore All Default Parameters"] = 0
        self._show_motor(store["Motor Code"])

    # Alarm log, motor, outputs

    def _alarm(self, index: int, column: int) -> int:
        entries = self.context.alarms.entries
        return entries[index][column] if index < len(entries) else 0

    def _clear_log(self, value: Value) -> None:
        if value == 1:
            self.context.alarms.clear()
        self.store["Reset Error Logs"] = 0

    def _show_motor(self, code: Value) -> None:
        """Show the digits of Motor Code in registers 1117 to 1120; the default code equals 1544h (ch. 12, table 24)."""
        digits = int(code) if int(code) < 0x10000 else _DEFAULT_MOTOR
        store = self.store
        store["Motor Current Recycling Enable"] = digits >> 12 & 0x1
        store["Motor Dynamic Balancing"] = 100 * (digits >> 8 & 0x7)
        store["Motor Proportional Gain"] = 100 * (digits >> 4 & 0xF)
        store["Motor Current Limit"] = digits & 0xF

    def _outputs(self) -> int:
        """Return register 1010: Set Output (1087), except for outputs that Output Config (1089) uses otherwise."""
        outputs, axis = self.store.integer("Set Output"), self.axis
        if self.context.environment.model != "94":
            outputs &= 0b111
        brake = int(axis.has_brake and self.context.now >= axis.brake_at)
        if axis.has_brake:
            outputs = outputs & ~0b00010 | brake << 1
        if self.store.integer("Output Config") in _FAULT_ON_O2:
            outputs = outputs & ~0b00100 | int(axis.state in FAULT_STATES) << 2
        return outputs << 16 | brake

    # Encoder and following error

    @property
    def _has_current(self) -> bool:
        return self.axis.state in CURRENT_ON

    def _reset_position_error(self, value: Value) -> None:
        """Reset the position error. No effect below Operation Enabled or without encoder (register 1086, note 2)."""
        if not (self.shaft.has_encoder and self.axis.ready):
            return
        if value == 1:
            self.axis.reset_error()
        elif value == 2:
            self.shaft.encoder_follows_command()

    def _reset_encoder_if_enabled(self, value: Value) -> None:
        if self.store.integer("Reset Encoder On First Power Up"):
            self.axis.reset_encoder()

    def _new_encoder(self, value: Value) -> None:
        """Reset the encoder position; with the current on, only after it is off again (register 1121)."""
        if self._has_current:
            self.axis.encoder_reset_pending = True
        else:
            self.axis.reset_encoder()

    # Checks before a write

    def _excludes(self, other: str) -> Callable[[Value], None]:
        """Return a check that declines a value other than 0 while the parameter `other` is not 0."""

        def check(value: Value) -> None:
            if value and self.store.integer(other):
                raise Declined("value", f"not together with {other}")

        return check

    def _check_signature(self, value: Value) -> None:
        if value not in (_STORE, _STORE_NETWORK):
            raise Declined("signature", f"{int(value):04X}h: expected {_STORE:04X}h or {_STORE_NETWORK:04X}h")

    def _check_outputs(self, value: Value) -> None:
        if self._has_current and is_brake_config(int(value)) != self.axis.has_brake:
            raise Declined("state", "the brake output must be chosen before Operation Enabled")

    def _check_position_reset(self, value: Value) -> None:
        if value == 2 and self.store.integer("Encoder Count Per Revolution") != 400:
            raise Declined("value", "2 is available only if Encoder Count Per Revolution is 400")

    def _check_auto_sync(self, value: Value) -> None:
        if value and not self.shaft.has_encoder:
            raise Declined("value", f"no Auto Sync without encoder (Following Error Reaction Code {NO_ENCODER})")

    def _check_watchdog(self, value: Value) -> None:
        if 0 < int(value) < _SHORTEST_WATCHDOG:
            raise Declined("value", f"{int(value)} ms: expected 0, or {_SHORTEST_WATCHDOG} to 32000")

    def _check_direction(self, value: Value) -> None:
        if self._has_current:
            raise Declined("state", "the direction is set at start-up, not with the current on")

    def _check_reaction(self, value: Value) -> None:
        if value not in (0, 1, 2, NO_ENCODER):
            raise Declined("value", f"reaction code {int(value)}: expected 0, 1, 2 or {NO_ENCODER}")
        if value == NO_ENCODER and self._has_current:
            raise Declined("state", f"{NO_ENCODER} must be written below Operation Enabled")


def _saved_by(cell: Cell) -> int:
    """Return the signature that saves the parameter, 0 if it cannot be saved."""
    place = cell.parameter.modbus
    if not cell.parameter.storable or place is None:
        return 0
    return _STORE_NETWORK if place.address in _NETWORK else _STORE


_STANDS_AFTER = 0.08
"""Seconds after a run until the current is reduced (register 1083)."""

_RISE, _TIME_CONSTANT = 35.0, 300.0
"""Degrees above the ambient temperature at 100 % of the current, and seconds."""

_LOWEST, _HIGHEST = 22, 125
"""The range of Drive Temperature (1124)."""


class ThermalModel:
    """The temperature of one drive. It keeps its state when the drive is switched off."""

    def __init__(self, context: Context, shaft: Shaft, axis: StepperAxis) -> None:
        self.context, self.store, self.shaft, self.axis = context, context.store, shaft, axis
        self.temperature = context.environment.ambient
        self._since = context.now
        self._tripped = False
        self.store.measure("Drive Temperature", lambda: max(_LOWEST, min(_HIGHEST, self.temperature)))

    @property
    def current(self) -> float:
        """The current of the motor phases in A."""
        return self.store.number("Motor Current Limit") * self._ratio()

    def _ratio(self) -> float:
        if not self.shaft.has_current:
            return 0.0
        ratio = self.store.number("Current Ratio") / 100
        return ratio * self.store.number("Current Reduction Ratio") / 100 if self._is_reduced() else ratio

    def _is_reduced(self) -> bool:
        """Return whether the motor is at standstill. With Auto Sync, register 1108 determines whether and when."""
        now, trajectory = self.context.now, self.axis.trajectory
        if trajectory.velocity(now) or now < trajectory.ends_at + _STANDS_AFTER:
            return False
        if not self.shaft.auto_sync:
            return True
        mode = self.store.integer("Auto Sync Enable")
        return mode == 3 or (mode == 2 and not self.shaft.closed_loop)

    def _final(self) -> float:
        """Return the temperature that is reached in the end, if nothing changes."""
        return self.context.environment.ambient + _RISE * self._ratio() ** 2

    def advance(self, now: float) -> None:
        """Let time pass in which nothing else changes."""
        final = self._final()
        self.temperature = final + (self.temperature - final) * exp(-(now - self._since) / _TIME_CONSTANT)
        self._since = now

    @property
    def is_warm(self) -> bool:
        """Whether the temperature is above Warning Temperature (1125)."""
        return self.temperature > self.store.number("Warning Temperature")

    def _crosses(self, level: float) -> float:
        """Return when the temperature crosses a level, if nothing changes; inf if it never does."""
        final, now = self._final(), self.context.now
        if (self.temperature - level) * (final - level) >= 0:
            return inf
        # A microsecond later, so that the temperature is beyond the level then, in spite of rounding.
        return now + _TIME_CONSTANT * log((final - self.temperature) / (final - level)) + 1e-6

    def events(self) -> Iterator[TimedAction]:
        """Yield the events of overheating, of cooling down, and of the current reduction."""
        now, limit = self.context.now, self.store.number("Drive Fault Temperature")
        if self._tripped:
            cool = self._cool()
            yield (now if self.temperature <= cool else self._crosses(cool)), self._cools
        else:
            yield (now if self.temperature > limit else self._crosses(limit)), self._overheats
        reduced_at = self.axis.trajectory.ends_at + _STANDS_AFTER
        if reduced_at > now:
            yield reduced_at, lambda: None  # `advance` counts on a current that is the same between two events

    def _cool(self) -> float:
        """Return the threshold of the warning, or that of the fault if it is lower."""
        return min(self.store.number("Warning Temperature"), self.store.number("Drive Fault Temperature"))

    def _overheats(self) -> None:
        if self.temperature > self.store.number("Drive Fault Temperature"):
            self._tripped = True
            self.axis.protect(OVERHEATED, transient=False)

    def _cools(self) -> None:
        if self.temperature <= self._cool():
            self._tripped = False
            if self.axis.cause == OVERHEATED:
                self.axis.cause = 0  # "if the temperature become lower than the threshold value" (1125)
