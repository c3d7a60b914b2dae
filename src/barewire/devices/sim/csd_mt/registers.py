"""The registers of the CSD MT that do not move a motor: memory, alarm log, outputs, identity.

1260 = 6173h  the storable parameters -.
1260 = 1111h  IP, mask, gateway --------+-->  kept through power-off, if the 24 V stay on for 5 s  (ch. 12)
1261 = 6F6Ch  the defaults ------------'
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from math import inf
from typing import TYPE_CHECKING

from barewire.codecs import Value
from barewire.devices.sim.core.store import Cell, Declined
from barewire.devices.sim.csd_mt.axis import Event
from barewire.devices.sim.motion.cia402_axis import CURRENT_ON, FAULTED

if TYPE_CHECKING:
    from barewire.devices.sim.csd_mt.machine import CsdMt

STORE, STORE_NETWORK, RESTORE = 0x6173, 0x1111, 0x6F6C
SAVING_TAKES = 5.0
NETWORK = range(1130, 1142)
LOG_SIZE = 10
NO_ENCODER = 17
OVERHEATED = 0x4310
PROTECTIONS = (0x2130, OVERHEATED, 0x5100)
"""The faults that the lamp FAU tells of; a following error is none of them (ch. 14)."""

MODEL = {
    "Software Version": 31,
    "Product Code": 0x94,
    "Hardware Version": 1,
    "Serial Number": 1,
    **{f"Read MAC Address {place}": word for place, word in ((1, 0x0200), (2, 0x0000), (3, 0x0094))},
}
"""What the manual leaves open: this machine's own numbers."""

SHORTEST_WATCHDOG = 100
BRAKE_ON_O1 = (0x23, 0x27)
FAULT_ON_O2 = (0x1B, 0x23)


class Service:
    """Memory, log, outputs and small registers of one drive."""

    def __init__(self, drive: CsdMt) -> None:
        self.drive = drive
        self.alarms: list[tuple[int, int]] = []
        self.encoder_reset_waits = False
        self._saving: tuple[float, dict[str, Value]] | None = None
        store = drive.store
        for name, value in MODEL.items():
            store.cell(name).default = value
            store[name] = value
        for name, act in (
            ("Save All Parameters", self._save),
            ("Restore All Default Parameters", self._restore),
            ("Reset Error Logs", self._clear_log),
            ("Read Temperature", lambda value: store.cell("Read Temperature").set(0)),
        ):
            store.after(name, act)
        store.veto("Enable SW bit 7", self._not_with("Enable SW bit 15"))
        store.veto("Enable SW bit 15", self._not_with("Enable SW bit 7"))
        store.veto("Following Error Reaction Code", self._check_reaction)
        store.veto("Position Error Reset", self._check_position_reset)
        store.after("Position Error Reset", self._reset_position_error)
        store.veto("Auto Sync Enable", self._check_auto_sync)
        store.after("Auto Sync Enable", lambda value: drive.shaft.sync_changed())
        store.veto("Output Config", self._check_outputs)
        store.veto("Counter Watchdog", self._check_watchdog)
        store.veto("Revolution Direction", self._check_direction)
        for name in ("Step Revolution", "Revolution Direction"):
            store.after(name, self._reset_encoder_if_wanted)
        store.after("Encoder Count Per Revolution", self._new_encoder)
        store.measure("Error Code", lambda: drive.axis.cause)
        store.measure("Error Register", lambda: int(drive.axis.state in FAULTED))
        store.measure("Digital Output", self._outputs)
        for place in range(LOG_SIZE):
            store.measure(f"Drive Alarm Time {place}", partial(self._alarm, place, 0))
            store.measure(f"Drive Alarm Code {place}", partial(self._alarm, place, 1))
        self._motor(store["Motor Code"])
        store.after("Motor Code", self._motor)
        order = store.cell("Little Endian / Big Endian")
        store.words_reversed = lambda: order.held == 0  # described little-endian, register 1162 = 1

    # Time

    def events(self) -> Iterator[Event]:
        """Saving comes to its end."""
        yield self._saving[0] if self._saving else inf, self._saved

    def _saved(self) -> None:
        if self._saving is not None:
            self.drive.saved = self._saving[1]
            self._saving = None

    def power_on(self) -> None:
        """The log is in memory that stays; a save that was still going on is lost (ch. 12, registers 1260, 1261)."""
        self._saving = None
        self.encoder_reset_waits = False
        self._motor(self.drive.store["Motor Code"])

    # Alarms

    def log(self, code: int) -> None:
        """The newest alarm first, ten of them, each with its seconds since power-on (registers 1220 to 1239)."""
        seconds = int(self.drive.uptime) % 0x10000
        self.alarms = [(seconds, code), *self.alarms][:LOG_SIZE]

    def _alarm(self, place: int, column: int) -> int:
        return self.alarms[place][column] if place < len(self.alarms) else 0

    def _clear_log(self, value: Value) -> None:
        if value == 1:
            self.alarms = []
        self.drive.store["Reset Error Logs"] = 0

    # Memory

    def _save(self, value: Value) -> None:
        """Nothing but the two signatures acts."""
        if value in (STORE, STORE_NETWORK):
            wanted = self.drive.store.snapshot(lambda cell: _kept_by(cell) == value)
            self._saving = (self.drive.now + SAVING_TAKES, self.drive.saved | wanted)
        self.drive.store["Save All Parameters"] = 0

    def _restore(self, value: Value) -> None:
        store = self.drive.store
        kept = {name: held for name, held in self.drive.saved.items() if _kept_by(store.cell(name)) != STORE}
        self._saving = (self.drive.now + SAVING_TAKES, kept)
        for cell in store:
            if _kept_by(cell) == STORE:
                cell.set(cell.default)
        store["Restore All Default Parameters"] = 0
        self._motor(store["Motor Code"])

    # Small registers

    def _motor(self, code: Value) -> None:
        """Registers 1117 to 1120 show the digits of Motor Code; the default code equals 1544h (ch. 12, table 24)."""
        digits = int(code) if int(code) < 0x10000 else 0x1544
        store = self.drive.store
        store["Motor Current Recycling Enable"] = digits >> 12 & 0x1
        store["Motor Dynamic Balancing"] = 100 * (digits >> 8 & 0x7)
        store["Motor Proportional Gain"] = 100 * (digits >> 4 & 0xF)
        store["Motor Current Limit"] = digits & 0xF

    # Outputs and lamps

    @property
    def lamps(self) -> set[str]:
        """Which of HV, FAU and TER are lit on the front (ch. 9 and 14)."""
        axis = self.drive.axis
        last = self.alarms[0][1] if self.alarms and axis.state in FAULTED else 0
        lit = {"HV": axis.powered_since is not None, "FAU": last in PROTECTIONS, "TER": last == OVERHEATED}
        return {lamp for lamp, on in lit.items() if on}

    @property
    def has_brake(self) -> bool:
        """Whether Output Config makes O1 the brake."""
        return self.drive.store.whole("Output Config") in BRAKE_ON_O1

    @property
    def busy(self) -> bool:
        """What the busy output would say, with its delay (1104). No value of 1089 connects it to O0."""
        way, store = self.drive.axis.trajectory, self.drive.store
        delay = store.number("Busy Delay") / 1000
        turns = way.velocity(self.drive.now) != 0
        return turns or way.moves(self.drive.now) or self.drive.now < way.ends_at + delay

    def _outputs(self) -> int:
        """Register 1010: Set Output (1087), where Output Config (1089) gives no other meaning to an output."""
        outputs, config = self.drive.store.whole("Set Output"), self.drive.store.whole("Output Config")
        if self.drive.environment.model != "94":
            outputs &= 0b111
        brake = int(self.has_brake and self.drive.now >= self.drive.axis.brake_at)
        if self.has_brake:
            outputs = outputs & ~0b00010 | brake << 1
        if config in FAULT_ON_O2:
            outputs = outputs & ~0b00100 | int(self.drive.axis.state in FAULTED) << 2
        return outputs << 16 | brake

    def _check_outputs(self, value: Value) -> None:
        if self._runs and (value in BRAKE_ON_O1) != self.has_brake:
            raise Declined("state", "the brake output must be chosen before Operation Enabled")

    # Encoder and following error

    @property
    def _runs(self) -> bool:
        return self.drive.axis.state in CURRENT_ON

    def _check_position_reset(self, value: Value) -> None:
        if value == 2 and self.drive.store.whole("Encoder Count Per Revolution") != 400:
            raise Declined("value", "2 is available only if Encoder Count Per Revolution is 400")

    def _reset_position_error(self, value: Value) -> None:
        """At once; not taken below Operation Enabled, nor without encoder (register 1086, note 2)."""
        shaft = self.drive.shaft
        if not (shaft.has_encoder and self.drive.axis.ready):
            return
        if value == 1:
            shaft.reset_error()
        elif value == 2:
            shaft.encoder_follows_command()

    def _reset_encoder_if_wanted(self, value: Value) -> None:
        if self.drive.store.whole("Reset Encoder On First Power Up"):
            self.reset_encoder()

    def _new_encoder(self, value: Value) -> None:
        """ "Produce the reset of the encoder position", with current on only after it is off again (register 1121)."""
        if self._runs:
            self.encoder_reset_waits = True
        else:
            self.reset_encoder()

    def reset_encoder(self) -> None:
        """The shaft is at 0 from now on."""
        self.encoder_reset_waits = False
        self.drive.shaft.rescale()
        self.drive.axis.rest_at(0.0, self.drive.now)

    def _not_with(self, other: str) -> Callable[[Value], None]:
        def check(value: Value) -> None:
            if value and self.drive.store.whole(other):
                raise Declined("value", f"not together with {other}")

        return check

    def _check_auto_sync(self, value: Value) -> None:
        if value and self.drive.store.whole("Following Error Reaction Code") == NO_ENCODER:
            raise Declined("value", "no Auto Sync without encoder (Following Error Reaction Code 17)")

    def _check_watchdog(self, value: Value) -> None:
        if 0 < int(value) < SHORTEST_WATCHDOG:
            raise Declined("value", f"{int(value)} ms: expected 0, or {SHORTEST_WATCHDOG} to 32000")

    def _check_direction(self, value: Value) -> None:
        if self._runs:
            raise Declined("state", "the direction is set at start-up, not with the current on")

    def _check_reaction(self, value: Value) -> None:
        if value not in (0, 1, 2, 17):
            raise Declined("value", f"reaction code {int(value)}: expected 0, 1, 2 or 17")
        if value == NO_ENCODER and self._runs:
            raise Declined("state", "17 must be written below Operation Enabled")


def _kept_by(cell: Cell) -> int:
    """The signature that stores a parameter, 0 if none does."""
    place = cell.parameter.modbus
    if not cell.parameter.storable or place is None:
        return 0
    return STORE_NETWORK if place.address in NETWORK else STORE
