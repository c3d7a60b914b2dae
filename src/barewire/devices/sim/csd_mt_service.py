"""The registers of the CSD MT that do not move a motor: memory, alarm log, temperature, outputs.

1260 = 6173h  the storable parameters -.
1260 = 1111h  IP, mask, gateway --------+-->  kept through power-off, if the 24 V stay on for 5 s  (ch. 12)
1261 = 6F6Ch  the defaults ------------'
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import exp
from typing import TYPE_CHECKING

from barewire.codecs import Value
from barewire.devices.sim.axis import CURRENT_ON, FAULTED
from barewire.devices.sim.store import Cell, Declined

if TYPE_CHECKING:
    from barewire.devices.sim.csd_mt import CsdMt

STORE, STORE_NETWORK, RESTORE = 0x6173, 0x1111, 0x6F6C
SAVING_TAKES = 5.0
NETWORK = range(1130, 1142)
LOG_SIZE = 10
OVERHEATED = 0x4310

# Heating of the drive with its motor current, as a body with one time constant. Chosen to look right, not measured.
AMBIENT, RISE, TIME_CONSTANT = 25.0, 35.0, 300.0

MODEL = {"Software Version": 31, "Product Code": 0x94, "Hardware Version": 1, "Serial Number": 1}
"""What the manual leaves open: this machine's own numbers."""

BRAKE_ON_O1 = (0x23, 0x27)
FAULT_ON_O2 = (0x1B, 0x23)


class Service:
    """Memory, log, temperature and outputs of one drive."""

    def __init__(self, drive: CsdMt) -> None:
        self.drive = drive
        self.ambient = AMBIENT
        self.temperature = AMBIENT
        self.inputs = 0
        """I0 to I3 as bits 0 to 3."""
        self.alarms: list[tuple[int, int]] = []
        self._ticked_at = drive.now
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
            ("Little Endian / Big Endian", self._turn_words),
        ):
            store.after(name, act)
        store.veto("Enable SW bit 7", self._not_with("Enable SW bit 15"))
        store.veto("Enable SW bit 15", self._not_with("Enable SW bit 7"))
        store.veto("Following Error Reaction Code", self._check_reaction)
        store.measure("Error Code", lambda: drive.axis.cause)
        store.measure("Error Register", lambda: int(drive.axis.state in FAULTED))
        store.measure("Drive Temperature", lambda: max(22, min(125, self.temperature)))
        store.measure("Digital Input", lambda: self.inputs << 16)
        store.measure("Digital Output", self._outputs)
        store.measure("Touch Probe Status", self._probe)
        for place in range(LOG_SIZE):
            store.measure(f"Drive Alarm Time {place}", partial(self._alarm, place, 0))
            store.measure(f"Drive Alarm Code {place}", partial(self._alarm, place, 1))
        self._motor(store["Motor Code"])
        store.after("Motor Code", self._motor)

    # Time

    def tick(self) -> None:
        """Saving comes to its end, the temperature creeps, the protection against it acts."""
        drive = self.drive
        if self._saving is not None and drive.now >= self._saving[0]:
            drive.saved = self._saving[1]
            self._saving = None
        ratio = drive.store.number("Current Ratio") / 100 if drive.axis.state in CURRENT_ON else 0.0
        ends_at = self.ambient + RISE * ratio**2
        left = exp(-(drive.now - self._ticked_at) / TIME_CONSTANT)
        self.temperature = ends_at + (self.temperature - ends_at) * left
        self._ticked_at = drive.now
        if self.temperature > drive.store.number("Drive Fault Temperature") and drive.axis.cause != OVERHEATED:
            drive.axis.fault(OVERHEATED, drive.now)
            self.log(OVERHEATED)
        elif drive.axis.cause == OVERHEATED and not self.is_warm:
            drive.axis.cause = 0  # "if the temperature become lower than the threshold value" (register 1125)

    @property
    def is_warm(self) -> bool:
        """Above Warning Temperature (1125)."""
        return self.temperature > self.drive.store.number("Warning Temperature")

    def power_on(self) -> None:
        """The log is in memory that stays; a save that was still going on is lost (ch. 12, registers 1260, 1261)."""
        self._saving = None
        self._turn_words(self.drive.store["Little Endian / Big Endian"])
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

    def _turn_words(self, value: Value) -> None:
        self.drive.store.words_reversed = value == 0  # described little-endian, register 1162 = 1

    def _motor(self, code: Value) -> None:
        """Registers 1117 to 1120 show the digits of Motor Code; the default code equals 1544h (ch. 12, table 24)."""
        digits = int(code) if int(code) < 0x10000 else 0x1544
        store = self.drive.store
        store["Motor Current Recycling Enable"] = digits >> 12 & 0x1
        store["Motor Dynamic Balancing"] = 100 * (digits >> 8 & 0x7)
        store["Motor Proportional Gain"] = 100 * (digits >> 4 & 0xF)
        store["Motor Current Limit"] = digits & 0xF

    def _outputs(self) -> int:
        """Register 1010: Set Output (1087), where Output Config (1089) gives no other meaning to an output."""
        outputs, config = self.drive.store.whole("Set Output"), self.drive.store.whole("Output Config")
        brake = int(self.drive.axis.state in CURRENT_ON)
        if config in BRAKE_ON_O1:
            outputs = outputs & ~0b00010 | brake << 1
        if config in FAULT_ON_O2:
            outputs = outputs & ~0b00100 | int(self.drive.axis.state in FAULTED) << 2
        return outputs << 16 | brake

    def _probe(self) -> int:
        function = self.drive.store.whole("Touch Probe Function")
        return (function & 1) | (function & 4) << 4

    def _not_with(self, other: str) -> Callable[[Value], None]:
        def check(value: Value) -> None:
            if value and self.drive.store.whole(other):
                raise Declined("value", f"not together with {other}")

        return check

    def _check_reaction(self, value: Value) -> None:
        if value not in (0, 1, 2, 17):
            raise Declined("value", f"reaction code {int(value)}: expected 0, 1, 2 or 17")
        if value == 17 and self.drive.axis.state in CURRENT_ON:
            raise Declined("state", "17 must be written below Operation Enabled")


def _kept_by(cell: Cell) -> int:
    """The signature that stores a parameter, 0 if none does."""
    place = cell.parameter.modbus
    if not cell.parameter.storable or place is None:
        return 0
    return STORE_NETWORK if place.address in NETWORK else STORE
