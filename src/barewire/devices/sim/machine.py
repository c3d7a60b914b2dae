"""A simulated machine: a store, a clock, and an adapter for each bus that its description has.

                       tick(now)                 time passes: timers end, motors move
        modbus  ---->  store  <----  canopen     both buses read and write the same values
                       power_cycle(now)          every value as at power-on; saved values are kept

`Simulator` itself simulates no behaviour: it stores written values and returns them, with the types, access rights and
limits of the description. The machines of the catalogue are subclasses: they override `tick` and set hooks on cells of
the store.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

from barewire.devices.device import Device
from barewire.devices.sim.modbus import ModbusAdapter
from barewire.devices.sim.store import MachineClock, MachineStore
from barewire.errors import EncodeError, suggest

if TYPE_CHECKING:
    from barewire.devices.sim.canopen import CanopenAdapter


class Form(NamedTuple):
    """The form of the values of a property: how an error names it, and how a text is read. `choices`: all texts, if
    they are few. What `read` raises for a wrong text is a ValueError or KeyError."""

    expected: str
    read: Callable[[str], Any]
    choices: tuple[str, ...] = ()


_SWITCHED = {"on": True, "off": False, "1": True, "0": False}
SWITCH = Form("on or off", lambda text: _SWITCHED[text.lower()], ("off", "on"))


def number(low: float = -inf, high: float = inf, read: Callable[[str], float] = float) -> Form:
    """Return the form of a number in a range."""
    limits = f" from {low:g}" * (low > -inf) + f" to {high:g}" * (high < inf)

    def checked(text: str) -> float:
        value = read(text)
        if not low <= value <= high:  # nan is in no range
            raise ValueError(text)
        return value

    return Form(f"a {'number' if read is float else 'whole number'}{limits}", checked)


class EnvironmentProperty(NamedTuple):
    """A property of the environment of a simulated machine, with its value; `put` takes another one."""

    name: str
    meaning: str
    form: Form
    value: object
    put: Callable[[Any], object]

    @classmethod
    def of(cls, owner: object, name: str, meaning: str, form: Form) -> EnvironmentProperty:
        """Return the property that is an attribute of an object, with - for _ in its name."""
        return cls(name.replace("_", "-"), meaning, form, getattr(owner, name), partial(setattr, owner, name))

    @property
    def text(self) -> str:
        """The value, as `Simulator.set_environment` takes it."""
        if isinstance(self.value, bool):
            return "on" if self.value else "off"
        return f"{self.value:.10g}" if isinstance(self.value, float) else str(self.value)


class Simulator:
    """A simulated device that stores the values written to it.

    >>> from barewire.devices.description.load import load
    >>> from barewire.modbus.messages.registers import ReadHoldingRegisters, WriteSingleRegister
    >>> machine = Simulator(load("adxl"))
    >>> machine.modbus.handle(WriteSingleRegister(0x4FFF, 7), now=0.0)
    WriteSingleRegisterResponse(address=20479, value=7)
    >>> machine.store["Menu number selection"]
    7
    """

    modbus_adapter: type[ModbusAdapter] = ModbusAdapter
    """The Modbus adapter: another one in machines with their own function codes or rules."""

    def __init__(self, device: Device, now: float = 0.0) -> None:
        self.device = device
        self.clock = MachineClock(now)
        self.address = 1 if device.modbus is None else device.modbus.unit
        """The unit address on Modbus. A machine whose address is a parameter changes it when it restarts."""
        self.store = MachineStore(device.parameters)
        self.modbus: ModbusAdapter | None = None
        if device.modbus is not None:
            self.modbus = self.modbus_adapter(self, device.modbus)
        self.canopen: CanopenAdapter | None = None
        if device.canopen is not None:
            # Imported here, so that a machine without CAN loads no CANopen.
            from barewire.devices.sim.canopen import CanopenAdapter

            self.canopen = CanopenAdapter(self, device.canopen)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.device.title}, simulated>"

    @property
    def now(self) -> float:
        """The time of the latest `tick`."""
        return self.clock.now

    @property
    def uptime(self) -> float:
        """Seconds since power-on."""
        return self.clock.uptime

    def tick(self, now: float) -> None:
        """Advance to the time `now`, in seconds. An earlier time than the present one is ignored."""
        self.clock.advance(now)

    def reset(self) -> None:
        """Restore every value as at power-on: the defaults, then the saved values."""
        self.store.restore(self.store.saved)

    def environment_properties(self) -> tuple[EnvironmentProperty, ...]:
        """Return the properties of the environment, with their present values."""
        return ()

    def set_environment(self, text: str) -> None:
        """Set a property of the environment, NAME=VALUE as at a command line. Raises EncodeError for wrong ones.

        >>> from barewire.devices.sim import simulator
        >>> machine = simulator("az3")
        >>> machine.set_environment("volts=0")
        >>> [(known.name, known.text) for known in machine.environment_properties()][0]
        ('volts', '0')
        """
        name, _, value = text.partition("=")
        known = {row.name.lower(): row for row in self.environment_properties()}
        row = known.get(name.strip().lower().replace("_", "-"))
        if row is None:
            names = [row.name for row in known.values()]
            if not names:
                raise EncodeError(f"{text!r}: {self.device.name} has no environment to set")
            expected = f"expected NAME=VALUE with a name of {', '.join(names)}"
            raise EncodeError(f"{text!r}: {expected}{suggest(name.strip(), names)}")
        try:
            read = row.form.read(value.strip())
        except (ValueError, KeyError):
            raise EncodeError(f"{text!r}: expected {row.form.expected} behind =, found {value.strip()!r}") from None
        row.put(read)

    def reset_communication(self) -> None:
        """React to an NMT reset communication, after 1000h to 1FFFh were restored. Does nothing here."""

    def readdress(self, address: int) -> None:
        """Set the unit address that the machine has at delivery."""
        self.address = address

    def power_cycle(self, now: float) -> None:
        """Switch off and on again at `now`."""
        self.tick(now)
        self.clock.on_since = self.now
        self.reset()
        if self.canopen is not None:
            self.canopen.power_on(self.now)


class MachineUnits(Mapping[int, ModbusAdapter]):
    """The units of a Modbus server for one machine: its adapter under the present unit address of the machine.

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

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {', '.join(map(str, self))}: {self._machine.device.title}>"

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
