"""Base class of the two CANopen clients: their settings, and the methods that concern the whole bus.

bus.node(5, ...)                          one node: `node`
bus.nmt, bus.lss, bus.sync, bus.time      groups of methods: `methods`
bus.scan(), bus.emergencies(), bus.frames(), bus.pdos(...), bus.send(frame), bus.host(device)
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

from barewire import canopen
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.conversation import DEFAULT_TIMEOUT
from barewire.errors import EncodeError, PortError, shown
from barewire.io.canopen.event_stream import FrameListener
from barewire.io.canopen.methods.nmt import ERROR_CONTROL, NetworkNmtMethods
from barewire.io.canopen.methods.operations import (
    BackgroundTask,
    BusOperation,
    Methods,
    R,
    Subscription,
    background,
    operation,
    send_frame,
    subscription,
)
from barewire.io.canopen.node_runner import Speaker
from barewire.io.canopen.shared_bus import CanBus, can_endpoint
from barewire.io.canopen.subscriber import Key
from barewire.io.endpoint import check_timeout
from barewire.io.ports.base import Port

if TYPE_CHECKING:
    from pathlib import Path

    from barewire.canopen import CanFrame, PdoReceived, RemotePdo
    from barewire.canopen.sdo.client.channel import Channel
    from barewire.devices.device import Device
    from barewire.io.canopen.methods.lss import LssMethods
    from barewire.io.canopen.methods.sync_time import SyncMethods, TimeMethods
    from barewire.io.canopen.shared_bus import WatchFrames
    from barewire.io.endpoint import Endpoint

NODES = range(1, 128)


class ClientBase(Methods[R]):
    """A client of the nodes on a bus."""

    def __init__(
        self,
        runner: R,
        bus: str | CanBus | Port[CanFrame],
        node: int | None,
        timeout: float | None,
        dialect: str | SdoDialect | None,
        watch: WatchFrames | None,
        options: Mapping[str, Any],
    ) -> None:
        super().__init__(runner)
        self._endpoint: Endpoint | None = None
        self._bus: CanBus | None = None
        self._watch = watch
        if isinstance(bus, str):
            endpoint = self._endpoint = can_endpoint(bus, node=node, timeout=timeout, **options)
            node = endpoint.integer("node", 0) or None
            timeout = endpoint.timeout
            dialect = dialect or endpoint.options.get("dialect")
        else:
            check_timeout(timeout)
            if options or watch is not None:
                names = ", ".join([*options, *(["watch"] if watch is not None else [])])
                raise EncodeError(f"{names}: an option of a bus that is opened by its URL; this one is open")
            if isinstance(bus, CanBus):
                self._bus = bus
            elif not (hasattr(bus, "send") and hasattr(bus, "receive")):
                raise EncodeError(f"{bus!r}: expected a URL such as 'can://socketcan/can0', a CanBus, or a port")
        self._port = bus if not isinstance(bus, (str, CanBus)) else None
        self.owns_bus = self._bus is None
        self.node_id = node
        self.timeout = DEFAULT_TIMEOUT if timeout is None else timeout
        self.dialect = _dialect(dialect)
        self._running: WeakSet[Any] = WeakSet()  # streams and background tasks of this client
        self.nmt: NetworkNmtMethods[R] = NetworkNmtMethods(runner)
        """NMT of all nodes."""

    def __repr__(self) -> str:
        name = self._bus.name if self._bus is not None else str(self._endpoint)
        return f"<{type(self).__name__} on {name}{'' if self.node_id is None else f', node {self.node_id}'}>"

    @property
    def bus(self) -> CanBus:
        """The bus, which may be shared by several clients. PortError if it is not open yet."""
        if self._bus is None:
            raise PortError(f"{self._endpoint}: not connected: enter `async with`, or await connect()")
        return self._bus

    def _new_bus(self) -> CanBus:
        """The bus that the constructor was given, or a new one for its URL or port."""
        if self._endpoint is not None:
            return CanBus.open(self._endpoint, watch=self._watch)
        return self.bus if self._port is None else CanBus(self._port)

    def channel(self, node: int | None = None) -> Channel:
        """The channel to the default SDO server of a node."""
        return self.bus.channel(self._number(node, None), self.dialect)

    def _number(self, node: int | None, device: Device | None) -> int:
        """The node that is meant: the given one, that of the URL, the device's own, or 1."""
        if node is not None:
            return node
        if self.node_id is not None:
            return self.node_id
        return device.canopen.node if device and device.canopen else 1

    def _described(
        self, number: int | None, device: str | Path | Device | None, eds: object
    ) -> tuple[Device | None, int]:
        """The description for `node`, if there is one, and the number of the node."""
        if device is None:
            return None, self._number(number, None)
        if eds is not None:
            raise EncodeError("node: expected device= or eds=, not both")
        from barewire.io.named_values import described

        found = described(device)
        if found.canopen is None:
            raise EncodeError(f"{found.name} has no CANopen", "device")
        return found, self._number(number, found)

    def _settings(self, timeout: float | None, dialect: str | SdoDialect | None) -> dict[str, Any]:
        """The settings of a node: those of its call, or those of the client."""
        check_timeout(timeout)
        return {
            "timeout": self.timeout if timeout is None else timeout,
            "dialect": self.dialect if dialect is None else _dialect(dialect),
        }

    @cached_property
    def lss(self) -> LssMethods[R]:
        """The LSS master of the bus."""
        from barewire.io.canopen.methods.lss import LssMethods

        return LssMethods(self.runner)

    @cached_property
    def sync(self) -> SyncMethods[R]:
        """SYNC messages."""
        from barewire.io.canopen.methods.sync_time import SyncMethods

        return SyncMethods(self.runner)

    @cached_property
    def time(self) -> TimeMethods[R]:
        """TIME messages."""
        from barewire.io.canopen.methods.sync_time import TimeMethods

        return TimeMethods(self.runner)

    @operation
    def send(self, frame: canopen.CanFrame) -> BusOperation[None]:
        """Send one frame."""
        return send_frame(frame)

    @operation
    def scan(
        self,
        nodes: Collection[int] = NODES,
        *,
        listen: float = 0.0,
        timeout: float = 0.1,
        progress: Callable[[int, canopen.ScanResult], None] | None = None,
    ) -> BusOperation[canopen.ScanResult]:
        """Find the nodes on the bus, with the evidence for each. Waits for SDO transfers with these nodes."""
        locks = frozenset(("SDO", 0x580 + node, False) for node in nodes)
        return BusOperation(canopen.scan(nodes, listen=listen, timeout=timeout, progress=progress), locks, None)

    @subscription
    def emergencies(self, cob_ids: Mapping[Key, int] | None = None) -> Subscription[canopen.EmcyEvent]:
        """The errors that nodes report. `cob_ids` gives the node of each (identifier, extended) that is another one
        than 80h + node."""
        keys = {(0x80 + node, False) for node in NODES} | ERROR_CONTROL | set(cob_ids or ())
        return Subscription(canopen.EmcyConsumer(cob_ids), frozenset(keys))

    @subscription
    def frames(self, *keys: Key) -> Subscription[canopen.CanFrame]:
        """All frames, or those with these (identifier, extended), as they come."""
        return Subscription(FrameListener(), frozenset(keys) or None)

    @subscription
    def pdos(self, *pdos: RemotePdo) -> Subscription[PdoReceived]:
        """The values of these PDOs, of any nodes, as they arrive."""
        from barewire.io.canopen.methods.pdo import pdo_subscription

        return pdo_subscription(*pdos)

    @background
    def host(self, device: Speaker) -> BackgroundTask:
        """Run a `LocalNode`, or any machine that receives and sends frames, on this bus until it is stopped."""
        return BackgroundTask(device, None)


def _dialect(dialect: str | SdoDialect | None) -> SdoDialect:
    if dialect is None or dialect == STANDARD.name:
        return STANDARD
    if isinstance(dialect, SdoDialect):
        return dialect
    if not isinstance(dialect, str):
        raise EncodeError(f"dialect {shown(dialect)}: expected its name, or an SdoDialect", "dialect")
    from barewire.devices.sdo_dialects import sdo_dialect  # loaded only for a dialect that is not the standard's

    return sdo_dialect(dialect)
