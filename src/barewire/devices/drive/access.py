"""How the drive code reaches a drive: read by name, write by name, wait. One class for each protocol.

        drive.py  --read, write, wait-->  ModbusAccess   Conversation[bytes, ...]      RTU, ASCII, TCP
                                          CanopenAccess  Conversation[CanFrame, ...]   SDO

`wait` returns the time. It passes received bytes or frames to the bus or the channel, which counts them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from barewire.canopen import CanFrame, Channel
from barewire.codecs import Value
from barewire.conversation import DEFAULT_TIMEOUT, Conversation, Item, Listen
from barewire.devices.canopen_access import read_canopen, write_canopen
from barewire.devices.device import Device
from barewire.devices.modbus_access import read_modbus, write_modbus
from barewire.devices.parameter import Reading
from barewire.modbus import Bus


class DriveAccess(Protocol[Item]):
    """The operations on a drive that `drive.py` uses."""

    def read(self, names: Sequence[str]) -> Conversation[Item, list[Reading]]:
        """Read values by name, in the order of `names`."""

    def write(self, values: Mapping[str, Value]) -> Conversation[Item, None]:
        """Write values by name, in their order."""

    def wait(self, until: float) -> Conversation[Item, float]:
        """Wait until this time, not at all if it is past; returns the present time."""


class ModbusAccess:
    """Access to the drive with address `unit` on a Modbus line."""

    def __init__(self, bus: Bus, unit: int, device: Device, *, timeout: float = DEFAULT_TIMEOUT) -> None:
        self.bus, self.unit, self.device, self.timeout = bus, unit, device, timeout

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.device.name}, unit {self.unit}>"

    def read(self, names: Sequence[str]) -> Conversation[bytes, list[Reading]]:
        """Read with as few requests as the device allows."""
        return read_modbus(self.bus, self.unit, self.device, names, timeout=self.timeout)

    def write(self, values: Mapping[str, Value]) -> Conversation[bytes, None]:
        """Check all values, then write them."""
        return write_modbus(self.bus, self.unit, self.device, values, timeout=self.timeout)

    def wait(self, until: float) -> Conversation[bytes, float]:
        """Wait, and pass received bytes to `Bus.overhear`."""
        while True:
            received = yield Listen(until)
            self.bus.overhear(received.item, received.now)
            if received.now >= until:
                return received.now


class CanopenAccess:
    """Access to the drive at the other end of an SDO channel."""

    def __init__(self, channel: Channel, device: Device, *, timeout: float = DEFAULT_TIMEOUT) -> None:
        self.channel, self.device, self.timeout = channel, device, timeout

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.device.name}, {self.channel!r}>"

    def read(self, names: Sequence[str]) -> Conversation[CanFrame, list[Reading]]:
        """Read with one upload for each object."""
        return read_canopen(self.channel, self.device, names, timeout=self.timeout)

    def write(self, values: Mapping[str, Value]) -> Conversation[CanFrame, None]:
        """Check all values, then write them."""
        return write_canopen(self.channel, self.device, values, timeout=self.timeout)

    def wait(self, until: float) -> Conversation[CanFrame, float]:
        """Wait, and pass received frames to the channel."""
        while True:
            received = yield Listen(until)
            if received.item is not None:
                self.channel.receive(received.item)
            if received.now >= until:
                return received.now
