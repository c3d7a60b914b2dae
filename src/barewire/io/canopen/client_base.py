"""The base class of the two CANopen clients: their constructor, and the methods that are the same in both.

bus.node(5, ...)                          one node: `node`
bus.nmt, bus.lss, bus.sync, bus.time      groups of methods: `methods`
bus.scan(), bus.emergencies(), bus.frames(), bus.pdos(...), bus.send(frame), bus.host(device)

`client` and `async_client` add what waits: they carry out operations, and receive single frames. Both have a fast path
for expedited SDO transfers, without running a conversation where nothing irregular happens:

        plain.begin()             -> the request     None                                     -> the whole conversation
        send it, and wait         -> a frame         not sent: another one waits to be read   -> the whole conversation
        plain.answer_in(frame)    -> the result      no frame, or any other; an error, Ctrl-C -> the rest of it

Nearly every access of a master takes this path, in a third of the time. What frames mean is decided in
`canopen.sdo.plain`; here are the channels that a client remembers for it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast, overload
from weakref import WeakSet

from barewire import canopen
from barewire.canopen.channel_locks import ChannelLock
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.conversation import DEFAULT_TIMEOUT, Conversation
from barewire.errors import EncodeError, NoAnswer, PortError, shown
from barewire.io.canopen.bus.node_runner import Speaker, checked_machine, stop_all
from barewire.io.canopen.bus.port import check_port
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import FrameListener, Key, Listener, check_key
from barewire.io.canopen.nmt import NetworkNmtMethods
from barewire.io.canopen.node import DcfNode, EdsNode, Node, check_node_id, dcf_node, dictionary_of
from barewire.io.canopen.operations import (
    ERROR_CONTROL,
    BackgroundTask,
    BusOperation,
    Methods,
    R,
    Subscription,
    background,
    checked_conversation,
    checked_listener,
    operation,
    sdo_keys,
    send_frame,
    subscription,
)
from barewire.io.endpoint import check_timeout
from barewire.io.log import PortLog
from barewire.io.ports.base import Port
from barewire.io.ports.can.interfaces import can_endpoint

if TYPE_CHECKING:
    from pathlib import Path

    from barewire.canopen import CanFrame, PdoReceived, RemotePdo
    from barewire.canopen.eds.eds_file import Eds
    from barewire.canopen.object_dictionary import ObjectDictionary
    from barewire.canopen.sdo.channel import Channel
    from barewire.canopen.sdo.plain import PlainExchange
    from barewire.devices.device import Device
    from barewire.io.canopen.bus.direct_port import DirectPort
    from barewire.io.canopen.bus.shared_bus import WatchFrames
    from barewire.io.canopen.bus_methods import LssMethods, SentBy, SyncMethods, TimeMethods
    from barewire.io.endpoint import Endpoint

_NODES = range(1, 128)
_CHANNELS_MAX = 256
"""Channels that are remembered. A bus has 127 nodes, but a program can make any number of further channels."""

D = TypeVar("D", bound=Node[Any])
T = TypeVar("T")
E = TypeVar("E")


class KnownChannel:
    """What a client remembers of a channel for its fast path."""

    __slots__ = ("direct", "keys", "lock", "subscriber")

    def __init__(self, channel: Channel) -> None:
        locks, self.keys = sdo_keys(channel)
        self.lock = ChannelLock(locks, None, lambda: None)  # it is never waited for, only taken if it is free
        self.subscriber: Any = None
        """It stays on the bus between exchanges; of the kind that the client has."""
        self.direct: DirectPort | None = None

    def close(self) -> None:
        """Take the subscriber off the bus."""
        if self.subscriber is not None:
            self.subscriber.close()


class ClientBase(Methods[R], ABC, Generic[R, D]):
    """A client of the nodes on a bus.

    R is the runner of its methods, which is the client itself; D is the type of its nodes that are described devices.
    """

    _stream_type: Any
    """`Stream`, or `AsyncStream`; `_running_type` is `Running`, or `AsyncRunning`."""
    _running_type: Any

    def __init__(
        self,
        bus: str | CanBus | Port[CanFrame],
        *,
        node: int | None = None,
        timeout: float | None = None,
        dialect: str | SdoDialect | None = None,
        watch: WatchFrames | None = None,
        **options: Any,
    ) -> None:
        runner = cast("R", self)
        super().__init__(runner)
        self._endpoint: Endpoint | None = None
        self._bus: CanBus | None = None
        self._watch = watch
        self._log: PortLog | None = None
        self.retries = 0
        if isinstance(bus, str):
            endpoint = self._endpoint = can_endpoint(bus, node=node, timeout=timeout, **options)
            node = endpoint.integer("node", 0) or None
            timeout = endpoint.timeout
            self.retries = endpoint.integer("retries", 0)
            dialect = dialect or endpoint.options.get("dialect")
        else:
            check_timeout(timeout)
            if options or watch is not None:
                names = ", ".join([*options, *(["watch"] if watch is not None else [])])
                raise EncodeError(f"{names}: an option of a bus that is opened by its URL; this bus is open")
            if isinstance(bus, CanBus):
                self._bus = bus
            else:
                check_port(bus, "a URL such as 'can://socketcan/can0', a CanBus, or a port")
        self._port = bus if not isinstance(bus, (str, CanBus)) else None
        self.owns_bus = self._bus is None
        self.node_id = node
        self.timeout = DEFAULT_TIMEOUT if timeout is None else timeout
        self.dialect = _dialect(dialect)
        self._running: WeakSet[Any] = WeakSet()  # the subscribers, streams and background tasks of this client
        self._known: dict[Channel, KnownChannel] = {}
        self._closed = False
        self.nmt: NetworkNmtMethods[R] = NetworkNmtMethods(runner)
        """NMT of all nodes."""
        self._prepare()

    @abstractmethod
    def _prepare(self) -> None:
        """Finish the constructor: make the locks; open the bus, if the constructor of this client does that."""

    @abstractmethod
    def _device_node(self, number: int, device: Device, **settings: Any) -> D:
        """Return the node with this number, which is this device."""

    def __repr__(self) -> str:
        name = self._bus.name if self._bus is not None else str(self._endpoint)
        return f"<{type(self).__name__} on {name}{'' if self.node_id is None else f', node {self.node_id}'}>"

    @property
    def bus(self) -> CanBus:
        """The bus, which several clients may share. Raises PortError if it is not open yet."""
        if self._bus is None:
            self._check_open()
            raise PortError(f"{self._endpoint}: not connected: enter `async with`, or await open()")
        return self._bus

    @property
    def is_open(self) -> bool:
        """Whether the bus was opened. The constructor of a blocking client does that."""
        return self._bus is not None

    def _check_open(self) -> None:
        """Raise PortError if this client was closed; the bus itself may be open, for other clients."""
        if self._closed:
            raise PortError(f"{self._endpoint or self.bus.name}: the client was closed")

    def _new_bus(self, *, lazy: bool = False) -> CanBus:
        """Return the bus that the constructor was given, or a new one for its URL or port."""
        if self._endpoint is not None:
            return CanBus.open(self._endpoint, watch=self._watch, lazy=lazy)
        return self.bus if self._port is None else CanBus(self._port, lazy=lazy)

    @contextmanager
    def _logged(self, channel: Channel | None) -> Iterator[None]:
        """Log an operation without an answer, and the late responses that were discarded on its SDO channel."""
        before = 0 if channel is None else channel.late_responses
        try:
            yield
        except NoAnswer as error:
            self._log_of_bus().info(("no answer", None if channel is None else channel.node), str(error))
            raise
        finally:
            if channel is not None and channel.late_responses > before:
                count = channel.late_responses - before
                text = f"node {channel.node}: SDO responses to another request discarded: {count}"
                self._log_of_bus().info("late", text)

    def _log_of_bus(self) -> PortLog:
        if self._log is None:
            self._log = PortLog("barewire.canopen.client", self.bus.place)
        return self._log

    def _stop_running(self) -> None:
        """Close the subscribers, streams and background tasks of this client."""
        self._closed = True
        if self._log is not None:
            self._log.flush()
        stop_all(self._running)
        for known in list(self._known.values()):
            known.close()

    def _remember(self, channel: Channel) -> KnownChannel:
        if len(self._known) >= _CHANNELS_MAX:
            for other, known in list(self._known.items()):
                if not known.lock.granted:  # not in use
                    self._known.pop(other, None)
                    known.close()
        return self._known.setdefault(channel, KnownChannel(channel))

    def subscribe(self, subscription: Subscription[E], /) -> Any:
        """Return a stream of the events of a subscription."""
        self._check_open()
        stream = self._stream_type(self.bus, subscription.machine, subscription.receives)
        self._running.add(stream)
        return stream

    def start_task(self, task: BackgroundTask, /) -> Any:
        """Run the machine of a background task in a thread, or in an asyncio task, of its own."""
        self._check_open()
        running = self._running_type(self.bus, task.machine, task.receives)
        self._running.add(running)
        return running

    @overload
    def node(
        self,
        number: int | None = None,
        *,
        device: str | Path | Device,
        timeout: float | None = None,
        dialect: str | SdoDialect | None = None,
    ) -> D: ...
    @overload
    def node(
        self,
        number: int | None = None,
        *,
        eds: str | Path | Eds | ObjectDictionary,
        timeout: float | None = None,
        dialect: str | SdoDialect | None = None,
    ) -> EdsNode[R]: ...
    @overload
    def node(
        self,
        number: int | None = None,
        *,
        dcf: str | Path | Eds,
        timeout: float | None = None,
        dialect: str | SdoDialect | None = None,
    ) -> DcfNode[R]: ...
    @overload
    def node(
        self, number: int | None = None, *, timeout: float | None = None, dialect: str | SdoDialect | None = None
    ) -> Node[R]: ...
    def node(
        self,
        number: int | None = None,
        *,
        device: str | Path | Device | None = None,
        eds: str | Path | Eds | ObjectDictionary | None = None,
        dcf: str | Path | Eds | None = None,
        timeout: float | None = None,
        dialect: str | SdoDialect | None = None,
    ) -> Node[R] | D:
        """Return one node of the bus. Nothing is sent.

        number      1..127; by default that of the URL, the device's own, or 1
        device      a description, or the name or path of one: values can be read and written by name
        eds         a parsed EDS, the path of one, or an ObjectDictionary: objects have names and types
        dcf         a parsed DCF, or the path of one: the device can also be compared with it and configured; the number
                    is by default that of the DCF
        timeout     seconds that the node has to respond; by default the client's
        dialect     how SDO requests are written; by default the client's

        Raises EncodeError for wrong arguments, UnknownName for the name of a device that is not in the catalogue,
        PortError if the client was closed.
        """
        self._check_open()
        check_timeout(timeout)
        settings: dict[str, Any] = {
            "timeout": self.timeout if timeout is None else timeout,
            "dialect": self.dialect if dialect is None else _dialect(dialect),
        }
        sources = {"device=": device, "eds=": eds, "dcf=": dcf}
        given = [name for name, source in sources.items() if source is not None]
        if len(given) > 1:
            raise EncodeError(f"node: expected {' or '.join(given)}, not both")
        if device is not None:
            description = _canopen_device(device)
            return self._device_node(self._number(number, description), description, **settings)
        if dcf is not None:
            return dcf_node(self.runner, self.node_id if number is None else number, dcf, **settings)
        node_id = self._number(number)
        if eds is not None:
            return EdsNode(self.runner, node_id, dictionary_of(eds, node_id), **settings)
        return Node(self.runner, node_id, **settings)

    def channel(self, node: int | None = None) -> Channel:
        """Return the channel to the default SDO server of a node."""
        return self.bus.channel(self._number(node), self.dialect, self.timeout)

    def _number(self, node: int | None, device: Device | None = None) -> int:
        """Return the given node-ID, or that of the URL, or the device's own, or 1."""
        if node is not None:
            return node
        if self.node_id is not None:
            return self.node_id
        return device.canopen.node if device and device.canopen else 1

    @cached_property
    def lss(self) -> LssMethods[R]:
        """The LSS master of the bus."""
        from barewire.io.canopen.bus_methods import LssMethods

        return LssMethods(self.runner)

    @cached_property
    def sync(self) -> SyncMethods[R]:
        """SYNC messages."""
        from barewire.io.canopen.bus_methods import SyncMethods

        return SyncMethods(self.runner)

    @cached_property
    def time(self) -> TimeMethods[R]:
        """TIME messages."""
        from barewire.io.canopen.bus_methods import TimeMethods

        return TimeMethods(self.runner)

    @operation
    def run(self, conversation: Conversation[CanFrame, T]) -> BusOperation[T]:
        """Carry out any conversation. It locks all channels of the bus, because those that it uses are unknown."""
        return BusOperation(checked_conversation(conversation), None, None)

    @subscription
    def watch(self, machine: Listener[E], receives: frozenset[Key] | None = None) -> Subscription[E]:
        """Return a stream of the events of any machine that listens. `receives` are the (identifier, extended) of its
        frames, None for all."""
        return Subscription(checked_listener(machine), receives)

    @operation
    def send(self, frame: canopen.CanFrame) -> BusOperation[None]:
        """Send one frame."""
        return send_frame(frame)

    @operation
    def scan(
        self,
        nodes: Collection[int] = _NODES,
        *,
        listen: float = 0.0,
        timeout: float = 0.1,
        progress: Callable[[int, canopen.ScanResult], None] | None = None,
    ) -> BusOperation[canopen.ScanResult]:
        """Find the nodes on the bus, with the evidence for each. It waits until SDO transfers with these nodes end.

        nodes       the node-IDs that are asked; by default all
        listen      seconds to listen for frames of nodes before anything is sent
        timeout     seconds that a node has to respond
        progress    called with each node-ID, before it is asked, and the result so far
        """
        if not isinstance(nodes, Collection) or isinstance(nodes, (str, bytes)):
            hint = f"; one node is scan([{nodes}])" if isinstance(nodes, int) else ""
            raise EncodeError(f"scan({shown(nodes)}): expected several node-IDs{hint}")
        locks = frozenset(("SDO", 0x580 + check_node_id(node), False) for node in nodes)
        survey = canopen.scan(nodes, listen=listen, timeout=timeout, progress=progress, channels=self.channel)
        return BusOperation(survey, locks, None)

    @subscription
    def emergencies(self, cob_ids: Mapping[Key, int] | None = None) -> Subscription[canopen.EmcyEvent]:
        """Return a stream of the errors that nodes report. `cob_ids` has the node of each (identifier, extended) other
        than 80h + node."""
        if cob_ids is not None and not isinstance(cob_ids, Mapping):
            raise EncodeError(f"{shown(cob_ids)}: expected a mapping of (identifier, extended) to node-ID")
        keys = {(0x80 + node, False) for node in _NODES} | ERROR_CONTROL | set(map(check_key, cob_ids or ()))
        return Subscription(canopen.EmcyConsumer(cob_ids), frozenset(keys))

    @subscription
    def frames(self, *keys: Key) -> Subscription[canopen.CanFrame]:
        """Return a stream of all frames, or of those with these (identifier, extended)."""
        return Subscription(FrameListener(), frozenset(map(check_key, keys)) or None)

    @subscription
    def pdos(self, *pdos: RemotePdo) -> Subscription[PdoReceived]:
        """Return a stream of the values of these PDOs, of any nodes."""
        from barewire.io.canopen.objects import pdo_subscription

        return pdo_subscription(*pdos)

    @background
    def host(self, device: Speaker) -> BackgroundTask:
        """Run a `LocalNode`, or any machine that receives all frames, on this bus until it is stopped.

        Raises EncodeError for any other object, and for a node-ID that another device on this bus has: nodes of other
        programs, and of other clients with a bus of their own, are not known."""
        return BackgroundTask(checked_machine(device), None)

    @background
    def start(
        self, machine: Speaker, receives: frozenset[Key] | None = None, *, by: SentBy = "python"
    ) -> BackgroundTask:
        """Run a machine that sends frames until it is stopped. `receives` are the (identifier, extended) of the frames
        that it gets; by default it gets all.

        by="kernel", for a `CyclicProducer` or `SyncProducer`: the kernel sends the frames if the bus is can://socketcan;
        `by_kernel` of the result is whether it does.
        """
        checked_machine(machine)
        if by == "python":
            return BackgroundTask(machine, receives)
        from barewire.io.canopen.bus_methods import cyclic_frames, cyclic_task

        return cyclic_task(self.runner.bus, cyclic_frames(machine), by)


def rest_of(plain: PlainExchange[T], sent_at: float) -> Conversation[CanFrame, T]:
    """Return the conversation of an exchange whose request was sent, advanced to the point where it listens."""
    rest = plain.rest(sent_at)
    next(rest)
    return rest


def _canopen_device(device: str | Path | Device) -> Device:
    from barewire.io.named_values import described

    description = described(device)
    if description.canopen is None:
        raise EncodeError(f"{description.name} has no CANopen", "device")
    return description


def _dialect(dialect: str | SdoDialect | None) -> SdoDialect:
    if dialect is None or dialect == STANDARD.name:
        return STANDARD
    if isinstance(dialect, SdoDialect):
        return dialect
    if not isinstance(dialect, str):
        raise EncodeError(f"dialect {shown(dialect)}: expected its name, or an SdoDialect", "dialect")
    from barewire.devices.sdo_dialects import sdo_dialect  # loaded only for a dialect that is not the standard's

    return sdo_dialect(dialect)
