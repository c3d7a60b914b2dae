"""What the AZ3 keeps and what it does at the press of a button: saving, cleaning, phasing, starting anew.

        STORE ALL PARAMETERS = 65766173h ("save")   all that can be written, and the PDO records
        EEPROM PARAMETERS CLEANING                  as delivered, from the next reset on
        EEPROM DIAGNOSTIC LOG CLEANING              no errors in ERROR CODE 1 to 8
        EEPROM AUTOPHASING DATA CLEANING            AUTO-PHASED MOTOR off, no captures
        EEPROM TOTAL CLEANING                       all three
        START PHASING, ABSOLUTE ENCODER PHASING START, ALIGNMENT REQUEST
                                                    alignment current for T ALIGN, then the captures are there; the
                                                    first two end with AUTO-PHASED MOTOR on
        RESET POSITION, RESET ERROR, SOFTWARE RESET, POWER OFF RESET

Each is a coil that is a push-button: it acts when it is switched on, and falls back. T ALIGN is taken in tenths of a
millisecond, as the other times of that page are.

Node-ID (BOOT CAN NODE), bit rate (CAN BIT RATE) and MODBUS ADDRESS count when the drive starts anew: power, a software
reset, NMT reset node, and for the first two NMT reset communication. The guides do not say when. What was not saved is
lost at all of these but the last. A node-ID outside 1..127 is none, and a drive without one is silent on CAN; a number
that is no bit rate of the guide is the default.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from barewire.codecs import Value
from barewire.devices.drive.cia402 import State
from barewire.devices.sim.motion.trajectory import wrapped

if TYPE_CHECKING:
    from barewire.devices.sim.az3.machine import Az3

SAVE = 0x65766173
"""The letters "save", what CiA 301 wants in 1010h:01; the guides do not say another value."""

BIT_RATES = {3: 20_000, 4: 50_000, 5: 125_000, 6: 250_000, 7: 500_000, 9: 1_000_000}
"""CANopen guide, chapter 4."""

DEFAULT_RATE = 5
AT_REST = {"CONTROL WORD": 0, "TARGET VELOCITY": 0, "TARGET TORQUE": 0}
"""Commands are not saved: a drive that is switched on waits for new ones."""

CAPTURES = 7
TENTHS = 1e-4


class Az3Service:
    """The part of the drive that is no motion."""

    def __init__(self, drive: Az3) -> None:
        self.drive = drive
        self.captures = [0] * CAPTURES
        self.node = 0
        """The node-ID that the drive started with."""
        self.rate = DEFAULT_RATE
        """The number of the bit rate that it started with."""
        self._phased_at: float | None = None
        self._phases = False
        side = drive.device.canopen
        if side is not None:
            rates = {rate: number for number, rate in BIT_RATES.items()}
            self._deliver("BOOT CAN NODE", side.node)
            self._deliver("CAN BIT RATE", rates.get(side.bitrate, DEFAULT_RATE))
            self.node, self.rate = side.node, drive.store.whole("CAN BIT RATE")
        store = drive.store
        store.after("STORE ALL PARAMETERS", self._save)
        buttons: dict[str, Callable[[], None]] = {
            "RESET ERROR": drive.reset_error,
            "RESET POSITION": lambda: drive.axis.rest_at(0.0, drive.now),
            "SOFTWARE RESET": lambda: drive.power_cycle(drive.now),
            "POWER OFF RESET": lambda: drive.power_cycle(drive.now),
            "START PHASING": lambda: self._align(phases=True),
            "ABSOLUTE ENCODER PHASING START": lambda: self._align(phases=True),
            "ALIGNMENT REQUEST": lambda: self._align(phases=False),
            "EEPROM DIAGNOSTIC LOG CLEANING": lambda: drive.errors.clear(),
            "EEPROM AUTOPHASING DATA CLEANING": self._forget_phasing,
            "EEPROM PARAMETERS CLEANING": self._forget_parameters,
            "EEPROM TOTAL CLEANING": self._forget_all,
        }
        for name, act in buttons.items():
            store.after(name, self._button(name, act))

    def _deliver(self, name: str, value: Value) -> None:
        self.drive.store.cell(name).default = value
        self.drive.store[name] = value

    def _button(self, name: str, act: Callable[[], None]) -> Callable[[Value], None]:
        def pressed(on: Value) -> None:
            if on:
                self.drive.store[name] = False
                act()

        return pressed

    # Starting anew

    def boot(self) -> None:
        """Take addresses and bit rate as they are set now."""
        drive, store = self.drive, self.drive.store
        self._phased_at = None
        drive.address = store.whole("MODBUS ADDRESS")
        if drive.canopen is None:
            return
        number = store.whole("CAN BIT RATE")
        self.rate = number if number in BIT_RATES else DEFAULT_RATE
        self.node = store.whole("BOOT CAN NODE")
        drive.canopen.boot(self.node if 1 <= self.node <= 127 else None, BIT_RATES[self.rate])

    # What is kept

    def _save(self, value: Value) -> None:
        """Everything that can be written is stored; where the guides do not say what is, more is the safer reading."""
        drive = self.drive
        if value == SAVE:
            kept = drive.store.snapshot(
                lambda cell: cell.parameter.writable and (cell.measured is None or bool(cell.parts))
            )
            drive.saved = kept | {name: at_rest for name, at_rest in AT_REST.items() if name in kept}
            if drive.canopen is not None:
                drive.canopen.save_records()
        drive.store["STORE ALL PARAMETERS"] = 0

    def _forget_parameters(self) -> None:
        self.drive.saved = {}
        if self.drive.canopen is not None:
            self.drive.canopen.forget_records()

    def _forget_phasing(self) -> None:
        self.captures[:] = [0] * CAPTURES
        self.drive.store["AUTO-PHASED MOTOR"] = False

    def _forget_all(self) -> None:
        self._forget_parameters()
        self._forget_phasing()
        self.drive.errors.clear()

    # Phasing

    @property
    def is_phasing(self) -> bool:
        """PHASING IN PROGRESS."""
        return self._phased_at is not None

    def _align(self, *, phases: bool) -> None:
        """Only with high voltage, and not while a master has the shaft."""
        drive = self.drive
        if drive.axis.state is State.OPERATION_ENABLED or drive.axis.powered_since is None:
            return
        self._phased_at = drive.now + drive.store.whole("T ALIGN") * TENTHS
        self._phases = phases

    def tick(self, now: float) -> None:
        """The end of phasing; a drive that is enabled meanwhile breaks it off."""
        drive = self.drive
        if self._phased_at is not None and drive.axis.state is State.OPERATION_ENABLED:
            self._phased_at = None
        if self._phased_at is None or now < self._phased_at:
            return
        self._phased_at = None
        # The increments at the six sectors of one electrical revolution, and at its end.
        pairs = drive.store.whole("MOTOR POLES PAIR") or 1
        start = drive.axis.trajectory.position(now)
        self.captures[:] = [
            wrapped(start + place * drive.motion.increments / pairs / 6, 16) for place in range(CAPTURES)
        ]
        if self._phases:
            drive.store["AUTO-PHASED MOTOR"] = True
