"""Blocking clients, opened by URL. Two classes, because the two protocols ask for different things; one way to read and
write named values on both.

    with open_modbus("tcp://127.0.0.1:1502?unit=1") as client:
        client.ask(ReadHoldingRegisters(0, 2)).registers
    with open_canopen("can://socketcan/can0?node=5") as client:
        client.upload(0x6041)
    with connect("rtu:///dev/ttyUSB0") as client:
        client.read(load("az3"), "STATUS WORD")

A client may be used from several threads: one exchange at a time has the line.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Self, TypeVar

from barewire.ascii import AsciiLine
from barewire.canopen import CanFrame, Channel, NmtCommand, NmtMessage, download, upload
from barewire.canopen.sdo.dialect import DIALECTS
from barewire.codecs import Value
from barewire.conversation import Conversation
from barewire.devices.access import read_canopen, read_modbus, write_canopen, write_modbus
from barewire.devices.device import Device
from barewire.devices.parameter import Reading
from barewire.errors import EncodeError
from barewire.modbus import Bus, Line, Request, Response, tell
from barewire.rtu.line import PATIENCE, RtuLine
from barewire.shells.blocking import Port, run
from barewire.shells.endpoint import Endpoint
from barewire.shells.taps import Direction, Trace
from barewire.tcp import TcpLine

R = TypeVar("R", bound=Response)
T = TypeVar("T")


class ModbusClient:
    """A client on one line or connection. `unit` and `timeout` (seconds) hold where a call does not say otherwise."""

    def __init__(self, port: Port[bytes], line: Line, *, unit: int | None = None, timeout: float = 1.0) -> None:
        self.port = port
        self.bus = Bus(line)
        self.unit = unit
        self.timeout = timeout
        self._turn = threading.Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Give the port back."""
        self.port.close()

    def run(self, conversation: Conversation[bytes, T]) -> T:
        """Carry any conversation out on this line, alone."""
        with self._turn:
            return run(conversation, self.port)

    def ask(self, request: Request[R], *, unit: int | None = None, timeout: float | None = None, retries: int = 0) -> R:
        """Ask and return the response; a read may be repeated. Raises ModbusException, NoAnswer, PortError."""
        return self.run(self.bus.ask(self._unit(unit), request, timeout=self._time(timeout), retries=retries))

    def tell(self, request: Request[R], *, turnaround: float = 0.1) -> None:
        """Broadcast to every unit of a serial line; nobody answers."""
        self.run(tell(self.bus.line, request, turnaround=turnaround))

    def read(self, device: Device, *names: str, unit: int | None = None) -> list[Reading]:
        """Named values, with as few requests as the device allows, in the order asked."""
        at = self._unit(unit, device)
        return self.run(read_modbus(self.bus, at, device, names, timeout=self.timeout))

    def write(
        self, device: Device, values: Mapping[str, Value], *, unit: int | None = None, force: bool = False
    ) -> None:
        """Write named values, in the order given. Ranges and access are checked before anything is sent."""
        at = self._unit(unit, device)
        self.run(write_modbus(self.bus, at, device, values, timeout=self.timeout, force=force))

    def _unit(self, unit: int | None, device: Device | None = None) -> int:
        if unit is not None:
            return unit
        if self.unit is not None:
            return self.unit
        return device.modbus.unit if device and device.modbus else 1

    def _time(self, timeout: float | None) -> float:
        return self.timeout if timeout is None else timeout


class CanopenClient:
    """A client of one node on a bus."""

    def __init__(
        self, port: Port[CanFrame], *, node: int | None = None, timeout: float = 1.0, dialect: str = "standard"
    ) -> None:
        if dialect not in DIALECTS:
            raise EncodeError(f"SDO dialect {dialect!r}: expected one of {', '.join(DIALECTS)}")
        self.port = port
        self.node = node
        self.timeout = timeout
        self.dialect = DIALECTS[dialect]
        self._channels: dict[int, Channel] = {}
        self._turn = threading.Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Leave the bus."""
        self.port.close()

    def run(self, conversation: Conversation[CanFrame, T]) -> T:
        """Carry any conversation out on this bus, alone."""
        with self._turn:
            return run(conversation, self.port)

    def upload(self, index: int, sub: int = 0, *, size: int | None = None, node: int | None = None) -> bytes:
        """Read an object. Raises SdoAbort, NoAnswer, PortError."""
        return self.run(upload(self._channel(node), index, sub, timeout=self.timeout, size=size))

    def download(self, index: int, sub: int, data: bytes, *, node: int | None = None) -> None:
        """Write an object: its bytes, little-endian, as many as its type has."""
        self.run(download(self._channel(node), index, sub, data, timeout=self.timeout))

    def command(self, command: NmtCommand, *, node: int | None = None) -> None:
        """Send an NMT command to the node, or with `node=0` to all. It is not confirmed."""
        self.send(NmtMessage(command, self._node(node)).encode())

    def send(self, frame: CanFrame) -> None:
        """Put one frame on the bus."""
        with self._turn:
            self.port.send(frame)

    def receive(self, timeout: float | None = None) -> CanFrame | None:
        """The next frame on the bus, whosever it is."""
        with self._turn:
            return self.port.receive(self.timeout if timeout is None else timeout)

    def read(self, device: Device, *names: str, node: int | None = None) -> list[Reading]:
        """Named values, in the order asked."""
        at = self._channel(node, device)
        return self.run(read_canopen(at, device, names, timeout=self.timeout))

    def write(
        self, device: Device, values: Mapping[str, Value], *, node: int | None = None, force: bool = False
    ) -> None:
        """Write named values, in the order given. Ranges and access are checked before anything is sent."""
        at = self._channel(node, device)
        self.run(write_canopen(at, device, values, timeout=self.timeout, force=force))

    def _node(self, node: int | None, device: Device | None = None) -> int:
        if node is not None:
            return node
        if self.node is not None:
            return self.node
        return device.canopen.node if device and device.canopen else 1

    def _channel(self, node: int | None, device: Device | None = None) -> Channel:
        # Kept, because a channel remembers what it must not be taken in by: the late answer of a lost transfer.
        at = self._node(node, device)
        if at not in self._channels:
            self._channels[at] = Channel(at, self.dialect)
        return self._channels[at]


Client = ModbusClient | CanopenClient
Watch = Callable[[Direction, bytes | CanFrame], None]


def open_modbus(url: str, *, watch: Watch | None = None) -> ModbusClient:
    """The client for a tcp://, rtu:// or ascii:// URL. `watch(direction, bytes)` is told of everything that passes.

    Raises EncodeError for a URL that says nothing sensible, PortError for a port that cannot be opened.
    """
    endpoint = Endpoint.parse(url)
    timeout = endpoint.seconds("timeout", 1.0)
    unit = endpoint.integer("unit", 0) if "unit" in endpoint.options else None
    port: Port[bytes]
    line: Line
    if endpoint.scheme == "tcp":
        from barewire.shells.tcp_socket import TcpPort

        port, line = TcpPort(*endpoint.host_and_port), TcpLine()
    elif endpoint.scheme in ("rtu", "ascii"):
        port, line = open_serial(endpoint), serial_line(endpoint, "client")
    else:
        raise EncodeError(f"endpoint {url!r}: Modbus goes over tcp://, rtu:// and ascii://")
    return ModbusClient(Trace(port, watch) if watch else port, line, unit=unit, timeout=timeout)


def open_canopen(url: str, *, dialect: str = "standard", watch: Watch | None = None) -> CanopenClient:
    """The client for a can:// URL. `dialect="az3"` asks as the guide of the AZ3 prints it."""
    from barewire.shells.can_bus import CanPort

    endpoint = Endpoint.parse(url)
    if endpoint.scheme != "can":
        raise EncodeError(f"endpoint {url!r}: CANopen goes over can://")
    timeout = endpoint.seconds("timeout", 1.0)
    node = endpoint.integer("node", 0) if "node" in endpoint.options else None
    port: Port[CanFrame] = CanPort(endpoint)
    return CanopenClient(Trace(port, watch) if watch else port, node=node, timeout=timeout, dialect=dialect)


def connect(url: str, *, watch: Watch | None = None) -> Client:
    """The client for any URL: for programs that only read and write named values."""
    if url.startswith("can://"):
        return open_canopen(url, watch=watch)
    return open_modbus(url, watch=watch)


def open_serial(endpoint: Endpoint) -> Port[bytes]:
    """The serial port of an rtu:// or ascii:// URL."""
    from barewire.shells.serial_port import SerialPort, SerialSettings

    return SerialPort(endpoint.place, SerialSettings.of(endpoint), pace=endpoint.integer("pace", 0) == 1)


def serial_line(endpoint: Endpoint, role: str, units: tuple[int, ...] = ()) -> Line:
    """The line of an rtu:// or ascii:// URL."""
    from barewire.shells.serial_port import SerialSettings

    settings = SerialSettings.of(endpoint)
    if endpoint.scheme == "ascii":
        return AsciiLine(character_timeout=endpoint.seconds("patience", 1.0), data_bits=settings.bytesize)
    strict = endpoint.options.get("patience") == "strict"
    patience = None if strict else endpoint.seconds("patience", PATIENCE)
    return RtuLine(settings.timing, role="server" if role == "server" else "client", units=units, patience=patience)
