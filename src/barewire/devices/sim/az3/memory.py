"""The non-volatile memory of the AZ3, and the addresses that it takes from there.              [ST.TEC.022, ST.TEC.071]

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

from typing import TYPE_CHECKING

from barewire.codecs import Value
from barewire.devices.device import CanopenSettings
from barewire.devices.parameter import show
from barewire.devices.sim.core.store import Declined, MachineStore

if TYPE_CHECKING:  # a program that only uses Modbus machines loads no CANopen node
    from barewire.devices.sim.core.canopen import CanopenAdapter

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
            self.node, self.bit_rate = settings.node, store.whole("CAN BIT RATE")
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
        number = self.store.whole("CAN BIT RATE")
        self.bit_rate = number if number in _BIT_RATES else _DEFAULT_BIT_RATE
        self.node = self.store.whole("BOOT CAN NODE")
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
