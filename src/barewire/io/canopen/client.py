"""The blocking CANopen client, and any client by URL. Two classes, because the two protocols ask for different things
(`modbus_client`); one way to read and write named values on both.

    with open_canopen("can://socketcan/can0?node=5") as client:
        client.upload(0x6041)
    with connect("rtu:///dev/ttyUSB0") as client:
        client.read(load("az3"), "STATUS WORD")

A client may be used from several threads: on one SDO channel one transfer at a time, in the order in which they were
asked for; different nodes at the same time. Several clients may share one bus:

    with open_bus("can://socketcan/can0") as bus:
        five, six = CanopenClient(bus, node=5), CanopenClient(bus, node=6)
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeAlias, TypeVar
from weakref import WeakSet

from barewire.canopen import CanFrame
from barewire.canopen.bus.channel_locks import LockKeys
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.conversation import Conversation
from barewire.errors import BarewireError, EncodeError, PortError
from barewire.io.canopen.event_stream import Listener, Stream
from barewire.io.canopen.methods import MasterVerbs
from barewire.io.canopen.node_runner import Running, Speaker
from barewire.io.canopen.operations import Talk
from barewire.io.canopen.pdo_lss_methods import LssVerbs, PdoVerbs
from barewire.io.canopen.shared_bus import CanBus
from barewire.io.canopen.subscriber import Key, Subscriber, seconds
from barewire.io.endpoint import Endpoint
from barewire.io.engine.blocking import run
from barewire.io.ports.base import Port
from barewire.io.ports.trace import Watch

if TYPE_CHECKING:
    from barewire.devices.device import Device
    from barewire.devices.drive.report import DriveProgress
    from barewire.io.drive import DriveClient
    from barewire.io.modbus.client import ModbusClient

T = TypeVar("T")
E = TypeVar("E")


class CanopenClient(MasterVerbs, PdoVerbs, LssVerbs):
    """A client of the nodes on a bus. `node` and `timeout` (seconds) hold where a call does not say otherwise.

    `bus` is a bus that is shared, or a port that becomes this client's own.
    """

    _mine: WeakSet[Running | Stream[Any]]

    def __init__(
        self,
        bus: CanBus | Port[CanFrame],
        *,
        node: int | None = None,
        timeout: float = 1.0,
        dialect: str | SdoDialect = "standard",
    ) -> None:
        super().__init__(bus, node=node, timeout=timeout, dialect=dialect)
        self._taking = threading.Lock()
        self._everything: list[Subscriber] = []
        self._ended = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """End what this client began: its streams, what it has running, and the bus, unless that is shared."""
        self._ended = True
        for tap in self._everything:
            tap.close()
        for one in list(self._mine):
            one.close()
        if self.owns_bus:
            self.bus.close()

    def run(self, conversation: Conversation[CanFrame, T]) -> T:
        """Carry any conversation out. Nobody knows whom it would disturb, so it has the bus alone."""
        return self.carry_out(Talk(conversation, None, None))

    def carry_out(self, talk: Talk[T]) -> T:
        """What every verb does: wait for its turn, then talk. A bus that is being opened anew is given our time-out."""
        self.bus.wait_open(self.timeout)
        with turn(self.bus, talk.claims), Subscriber(self.bus, talk.hears) as tap:
            try:
                return run(talk.conversation, tap)
            except BarewireError as error:
                tap.tell(error)
                raise

    def watch(self, machine: Listener[E], hears: frozenset[Key] | None = None) -> Stream[E]:
        """The events of any machine that listens; `hears` are the identifiers that it needs, None for all."""
        stream = Stream(self.bus, machine, hears)
        self._mine.add(stream)
        return stream

    def keep_going(self, machine: Speaker, hears: frozenset[Key] | None = None) -> Running:
        """Let any machine speak on the bus until it is stopped."""
        running = Running(self.bus, machine, hears)
        self._mine.add(running)
        return running

    def receive(self, timeout: float | None = None) -> CanFrame | None:
        """The next frame on the bus, whosever it is, from the first call on. `frames` gives a stream."""
        patience = self.timeout if timeout is None else timeout
        seconds(patience)
        with self._taking:
            if not self._everything:
                self.bus.wait_open(patience)
                self._everything.append(Subscriber(self.bus, None))
            try:
                return self._everything[0].receive(patience)
            except PortError:
                if not self._ended:
                    self._everything.clear()  # a bus that is opened anew has a new tap for us
                raise

    def drive(self, device: Device, *, progress: Callable[[DriveProgress], None] | None = None) -> DriveClient:
        """The device as a drive of CiA 402: enable it, move it. `progress` is called after every look at it."""
        from barewire.io.drive import DriveClient

        return DriveClient(self, device, progress=progress)


@contextlib.contextmanager
def turn(bus: CanBus, keys: LockKeys | None) -> Iterator[None]:
    """Wait until nobody talks who would be disturbed, and then be the one who talks."""
    bell = threading.Lock()
    bell.acquire()
    lock = bus.join(keys, threading.get_ident(), bell.release)
    try:
        if not lock.granted:
            bell.acquire()
        yield
    finally:
        bus.leave(lock)


Client: TypeAlias = "ModbusClient | CanopenClient"


def open_bus(url: str, *, watch: Watch | None = None) -> CanBus:
    """The bus of a can:// URL, to be shared. `watch(direction, frame)` is told of everything that passes. A port that
    fails later is opened anew (`can_reopen`)."""
    from barewire.io.ports.python_can import CanPort

    endpoint = Endpoint.parse(url)
    if endpoint.scheme != "can":
        raise EncodeError(f"endpoint {url!r}: CANopen goes over can://")
    return CanBus(CanPort(endpoint), watch=watch, dial=lambda: CanPort(endpoint))


def manners(url: str) -> dict[str, Any]:
    """What a can:// URL says for a client: its node and its time-out."""
    endpoint = Endpoint.parse(url)
    node = endpoint.integer("node", 0) if "node" in endpoint.options else None
    return {"node": node, "timeout": endpoint.seconds("timeout", 1.0)}


def open_canopen(url: str, *, dialect: str = "standard", watch: Watch | None = None) -> CanopenClient:
    """The client for a can:// URL. `dialect="az3"` asks as the guide of the AZ3 prints it."""
    options = manners(url)
    bus = open_bus(url, watch=watch)
    try:
        client = CanopenClient(bus, dialect=dialect, **options)
    except EncodeError:
        bus.close()
        raise
    client.owns_bus = True
    return client


def connect(url: str, *, watch: Watch | None = None) -> Client:
    """The client for any URL: for programs that only read and write named values."""
    if url.startswith("can://"):
        return open_canopen(url, watch=watch)
    from barewire.io.modbus.client import ModbusClient

    return ModbusClient(url, watch=watch)
