"""The blocking CANopen client, and any client by URL. Two classes, because the two protocols ask for different things
(`modbus_client`); one way to read and write named values on both.

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
from typing import TYPE_CHECKING, Self, TypeVar

from barewire.canopen import CanFrame, Channel, NmtCommand, NmtMessage, download, upload
from barewire.canopen.sdo.dialect import DIALECTS
from barewire.codecs import Value
from barewire.conversation import Conversation
from barewire.devices.access import read_canopen, write_canopen
from barewire.devices.device import Device
from barewire.devices.parameter import Reading
from barewire.errors import EncodeError
from barewire.shells.blocking import Port, run
from barewire.shells.endpoint import Endpoint
from barewire.shells.modbus_client import ModbusClient, Watch, open_modbus
from barewire.shells.taps import Trace

if TYPE_CHECKING:
    from barewire.devices.drive_report import Progress
    from barewire.shells.drive import DriveClient

T = TypeVar("T")


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

    def drive(self, device: Device, *, progress: Callable[[Progress], None] | None = None) -> DriveClient:
        """The device as a drive of CiA 402: enable it, move it. `progress` is called after every look at it."""
        from barewire.shells.drive import DriveClient

        return DriveClient(self, device, progress=progress)

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
