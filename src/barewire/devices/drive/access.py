"""How the drive code reaches a drive: read by name, write by name, let time pass. One for each bus.

        drive.py  --read, write, rest-->  ModbusAccess   Conversation[bytes, ...]      RTU, ASCII, TCP
                                          CanopenAccess  Conversation[CanFrame, ...]   SDO

`rest` is also how time becomes known. What comes meanwhile goes to whoever remembers the line, so no byte vanishes.

I know: both ways to read and write by name.  I never know: states, motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, TypeVar

from barewire.canopen import CanFrame, Channel
from barewire.codecs import Value
from barewire.conversation import Conversation, Listen
from barewire.devices.access import read_canopen, read_modbus, write_canopen, write_modbus
from barewire.devices.device import Device
from barewire.devices.parameter import Reading
from barewire.modbus import Bus

Item = TypeVar("Item")


class DriveAccess(Protocol[Item]):
    """What the drive code needs of a wire."""

    def read(self, names: Sequence[str]) -> Conversation[Item, list[Reading]]:
        """Named values, in the order asked."""

    def write(self, values: Mapping[str, Value]) -> Conversation[Item, None]:
        """Named values, in the order given."""

    def rest(self, until: float) -> Conversation[Item, float]:
        """Let time pass until then, or not at all if it is past; returns the time."""


class ModbusAccess:
    """A drive that is `unit` on a bus."""

    def __init__(self, bus: Bus, unit: int, device: Device, *, timeout: float = 1.0) -> None:
        self.bus, self.unit, self.device, self.timeout = bus, unit, device, timeout

    def read(self, names: Sequence[str]) -> Conversation[bytes, list[Reading]]:
        """With as few requests as the device allows."""
        return read_modbus(self.bus, self.unit, self.device, names, timeout=self.timeout)

    def write(self, values: Mapping[str, Value]) -> Conversation[bytes, None]:
        """Checked before anything is sent."""
        return write_modbus(self.bus, self.unit, self.device, values, timeout=self.timeout)

    def rest(self, until: float) -> Conversation[bytes, float]:
        """The bus overhears what comes."""
        while True:
            heard = yield Listen(until)
            self.bus.overhear(heard.item, heard.now)
            if heard.now >= until:
                return heard.now


class CanopenAccess:
    """A drive that is the node of an SDO channel."""

    def __init__(self, channel: Channel, device: Device, *, timeout: float = 1.0) -> None:
        self.channel, self.device, self.timeout = channel, device, timeout

    def read(self, names: Sequence[str]) -> Conversation[CanFrame, list[Reading]]:
        """One upload for each object."""
        return read_canopen(self.channel, self.device, names, timeout=self.timeout)

    def write(self, values: Mapping[str, Value]) -> Conversation[CanFrame, None]:
        """Checked before anything is sent."""
        return write_canopen(self.channel, self.device, values, timeout=self.timeout)

    def rest(self, until: float) -> Conversation[CanFrame, float]:
        """The channel counts what comes."""
        while True:
            heard = yield Listen(until)
            if heard.item is not None:
                self.channel.receive(heard.item)
            if heard.now >= until:
                return heard.now
