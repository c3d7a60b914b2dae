"""The transports of the simulated machines, in memory: reads and writes by name, through real frames."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

from barewire.ascii import AsciiLine
from barewire.canopen import CanFrame, Channel
from barewire.codecs import Value
from barewire.conversation import play
from barewire.devices.canopen_access import read_canopen, write_canopen
from barewire.devices.modbus_access import read_modbus, write_modbus
from barewire.devices.parameter import Parameter
from barewire.devices.sdo_dialects import DIALECTS
from barewire.devices.sim import MachineUnits, Simulator, simulator
from barewire.modbus import Bus, Server
from barewire.modbus.framing import Line
from barewire.rtu import RtuLine, Timing
from barewire.tcp import TcpLine
from tests.helpers import Peer, serving

TIMING = Timing.of(19200)


class Wire(ABC):
    """A client and a machine with frames between them, and their time."""

    def __init__(self, device: str) -> None:
        self.machine: Simulator = simulator(device)
        self.now = 0.0

    @abstractmethod
    def has(self, parameter: Parameter) -> bool:
        """Return whether the parameter can be accessed on this transport."""

    @abstractmethod
    def read(self, parameter: Parameter) -> Value: ...

    @abstractmethod
    def write(self, values: Mapping[Parameter, Value], *, force: bool = False) -> None: ...


class ModbusWire(Wire):
    """Modbus in one of its framings."""

    def __init__(self, device: str, client: Line, server: Line, *, serial: bool) -> None:
        super().__init__(device)
        self.bus = Bus(client)
        self.server = Server(server, MachineUnits(self.machine), serial=serial)
        self.peer: Peer = serving(self.server, TIMING if serial else None)

    def has(self, parameter: Parameter) -> bool:
        return parameter.modbus is not None

    def read(self, parameter: Parameter) -> Value:
        conversation = read_modbus(self.bus, self.machine.address, self.machine.device, [parameter])
        (reading,), self.now = play(conversation, self.peer, start=self.now)
        return reading.value

    def write(self, values: Mapping[Parameter, Value], *, force: bool = False) -> None:
        conversation = write_modbus(self.bus, self.machine.address, self.machine.device, values, force=force)
        _, self.now = play(conversation, self.peer, start=self.now)


class CanopenWire(Wire):
    """CANopen by SDO, in one of the dialects."""

    def __init__(self, device: str, dialect: str) -> None:
        super().__init__(device)
        settings = self.machine.device.canopen
        assert settings is not None
        self.channel = Channel(settings.node, DIALECTS[dialect])

    def _peer(self, frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        assert self.machine.canopen is not None
        return [(now, sent) for sent in self.machine.canopen.feed(frame, now)]

    def has(self, parameter: Parameter) -> bool:
        return parameter.object is not None

    def read(self, parameter: Parameter) -> Value:
        (reading,), self.now = play(
            read_canopen(self.channel, self.machine.device, [parameter]), self._peer, start=self.now
        )
        return reading.value

    def write(self, values: Mapping[Parameter, Value], *, force: bool = False) -> None:
        conversation = write_canopen(self.channel, self.machine.device, values, force=force)
        _, self.now = play(conversation, self._peer, start=self.now)


def rtu(device: str) -> Wire:
    server = RtuLine(TIMING, role="server", units={1})
    return ModbusWire(device, RtuLine(TIMING), server, serial=True)


def ascii(device: str) -> Wire:
    return ModbusWire(device, AsciiLine(), AsciiLine(), serial=True)


def tcp(device: str) -> Wire:
    return ModbusWire(device, TcpLine(), TcpLine(), serial=False)


def canopen(device: str) -> Wire:
    return CanopenWire(device, "standard")


def canopen_az3(device: str) -> Wire:
    return CanopenWire(device, "az3")


WIRES: list[tuple[str, Callable[[str], Wire]]] = [
    ("az3", rtu),
    ("az3", canopen),
    ("az3", canopen_az3),
    ("adxl", rtu),
    ("adxl", ascii),
    ("adxl", tcp),
    ("csd-mt", tcp),
]
"""Each machine with the transports of its manual; the AZ3 answers in both SDO dialects."""
