"""A simulated machine, whatever it is: a store, a clock hand, and a face for each bus that its description has.

                       tick(now)                 time passes: what moves by itself, moves
        modbus  ---->  store  <----  canopen     the same values through both faces
                       power_cycle(now)          everything as at power-on, what was saved is kept

This class alone is the simulator of a device that nobody has taught to move: it keeps what is written and answers what
it keeps. The three machines of the catalogue are subclasses that override `tick` and hang their behaviour on cells.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from barewire.codecs import Value
from barewire.devices.device import Device
from barewire.devices.sim.core.modbus import ModbusAdapter
from barewire.devices.sim.core.store import MachineStore
from barewire.errors import EncodeError

if TYPE_CHECKING:
    from barewire.devices.sim.core.canopen import CanopenAdapter


class Simulator:
    """A device that keeps what is written.

    >>> from barewire.devices.description.load import load
    >>> from barewire.modbus.messages.registers import ReadHoldingRegisters, WriteSingleRegister
    >>> machine = Simulator(load("adxl"))
    >>> machine.modbus.handle(WriteSingleRegister(0x4FFF, 7), now=0.0)
    WriteSingleRegisterResponse(address=20479, value=7)
    >>> machine.store["Menu number selection"]
    7
    """

    def __init__(self, device: Device, now: float = 0.0) -> None:
        self.device = device
        self.now = now
        self.on_since: float | None = None
        """When power came: the first time that the machine is told."""
        self.saved: dict[str, Value] = {}
        """What survives power-off, by name."""
        self.address = 1 if device.modbus is None else device.modbus.unit
        """The unit address on Modbus. Machines that can be given another one take it when they start anew."""
        self.store = MachineStore(device.parameters)
        self.modbus = self._modbus_face()
        self.canopen: CanopenAdapter | None = None
        if device.canopen is not None:
            # Only a device that is on CAN loads the room that speaks it.
            from barewire.devices.sim.core.canopen import CanopenAdapter

            self.canopen = CanopenAdapter(self, device.canopen)

    def _modbus_face(self) -> ModbusAdapter | None:
        return None if self.device.modbus is None else ModbusAdapter(self, self.device.modbus)

    def tick(self, now: float) -> None:
        """Time has passed. A clock that goes backwards is read over."""
        if self.on_since is None:
            self.on_since = now
        self.now = max(self.now, now)

    @property
    def uptime(self) -> float:
        """Seconds since power-on."""
        return 0.0 if self.on_since is None else self.now - self.on_since

    def reset(self) -> None:
        """Every value as at power-on: defaults, and over them what was saved."""
        self.store.restore(self.saved)

    def set_environment(self, text: str) -> None:
        """Set one thing of the world around the machine, NAME=VALUE as at a command line. EncodeError for others."""
        environment = getattr(self, "environment", None)
        if environment is None:
            raise EncodeError(f"{text!r}: there is nothing to set around {self.device.name}")
        environment.put(text)

    def reset_communication(self) -> None:
        """NMT reset communication: the store has the values of 1000h to 1FFFh again. A place for machines."""

    def readdress(self, address: int) -> None:
        """Deliver it with another unit address."""
        self.address = address

    def power_cycle(self, now: float) -> None:
        """Off and on again."""
        self.tick(now)
        self.on_since = self.now
        self.reset()
        if self.canopen is not None:
            self.canopen.power_on(self.now)


class MachineUnits(Mapping[int, ModbusAdapter]):
    """The units of a server for one machine: its adapter under the unit address that the machine has at that moment.

        MachineUnits(machine)             a serial line: {1: adapter}; after a new address took effect {7: adapter}
        MachineUnits(machine, 255, 0)     TCP: a device that is connected directly is also unit 255 and 0 [MB-TCP 4.4.2]

    >>> from barewire.devices.description.load import load
    >>> machine = Simulator(load("adxl"))
    >>> units = MachineUnits(machine)
    >>> machine.address = 7
    >>> list(units), 1 in units
    ([7], False)
    """

    def __init__(self, machine: Simulator, *also: int) -> None:
        if machine.modbus is None:
            raise EncodeError(f"{machine.device.name} has no Modbus: no table [modbus] in its description")
        self._machine, self._adapter, self._also = machine, machine.modbus, also

    def _addresses(self) -> tuple[int, ...]:
        return tuple(dict.fromkeys((self._machine.address, *self._also)))

    def __getitem__(self, address: int) -> ModbusAdapter:
        if address not in self:
            raise KeyError(address)
        return self._adapter

    def __contains__(self, address: object) -> bool:
        return address == self._machine.address or address in self._also

    def __iter__(self) -> Iterator[int]:
        return iter(self._addresses())

    def __len__(self) -> int:
        return len(self._addresses())


def parse_setting(text: str, names: tuple[str, ...]) -> tuple[str, float]:
    """NAME=NUMBER with one of these names, in which - may stand for _ ; EncodeError otherwise.

    >>> parse_setting("kick-time=0.5", ("kick_time", "line"))
    ('kick_time', 0.5)
    """
    name, _, value = text.partition("=")
    name = name.strip().lower().replace("-", "_")
    try:
        number = float(value)
    except ValueError:
        number = -1.0
    if name not in names or not 0 <= number < float("inf"):
        known = ", ".join(one.replace("_", "-") for one in names)
        raise EncodeError(f"{text!r}: expected NAME=NUMBER with a name of {known}")
    return name, number
