"""A machine under the unit address that it has now, as a server wants its units.

units = Addressed(machine)                 a serial line: {1: face}, and after a new address took effect {7: face}
units = Addressed(machine, 255, 0)         TCP: a device that is connected directly is also unit 255 and 0
                                           [MB-TCP 4.4.2]
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from barewire.devices.sim.core.modbus import ModbusAdapter
from barewire.devices.sim.core.simulator import Simulator
from barewire.errors import EncodeError


class Addressed(Mapping[int, ModbusAdapter]):
    """One unit, wherever it is.

    >>> from barewire.devices.description.load import load
    >>> machine = Simulator(load("adxl"))
    >>> units = Addressed(machine)
    >>> machine.address = 7
    >>> list(units), 1 in units
    ([7], False)
    """

    def __init__(self, machine: Simulator, *also: int) -> None:
        if machine.modbus is None:
            raise EncodeError(f"{machine.device.name} has no Modbus: no table [modbus] in its description")
        self._machine, self._face, self._also = machine, machine.modbus, also

    def _has(self, address: object) -> bool:
        return address == self._machine.address or address in self._also

    def __getitem__(self, address: int) -> ModbusAdapter:
        if not self._has(address):
            raise KeyError(address)
        return self._face

    def __contains__(self, address: object) -> bool:
        return self._has(address)

    def __iter__(self) -> Iterator[int]:
        return iter(dict.fromkeys((self._machine.address, *self._also)))

    def __len__(self) -> int:
        return len(dict.fromkeys((self._machine.address, *self._also)))
