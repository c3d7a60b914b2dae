"""The blocking Modbus client, opened by URL.

    with open_modbus("tcp://127.0.0.1:1502?unit=1") as client:
        client.read_holding_registers(0, 2)                  the field's names, see `verbs`
        client.ask(ReadHoldingRegisters(0, 2)).registers     any message at all

A connection that failed is made anew by the next question: at once the first time, then after pauses that grow
(`back_off`). A client may be used from several threads: one exchange at a time has the line, and the units take turns.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Self, TypeVar

from barewire.errors import NoAnswer, PortError
from barewire.io.engine.backoff import BackOff, dice
from barewire.io.engine.blocking import Port, run
from barewire.io.engine.fast_path import exchange
from barewire.io.modbus.carriers import bus_options, dialer, modbus_endpoint, modbus_line, unit_of
from barewire.io.modbus.methods import Verbs
from barewire.io.ports.trace import Trace, Watch
from barewire.modbus.adu import BROADCAST
from barewire.modbus.client.bus import Bus
from barewire.modbus.client.fair_queue import FairQueue, Ticket

if TYPE_CHECKING:
    from types import TracebackType

    from barewire.codecs import Value
    from barewire.conversation import Conversation
    from barewire.devices.device import Device
    from barewire.devices.drive.report import DriveProgress
    from barewire.devices.parameter import Reading
    from barewire.io.drive import DriveClient
    from barewire.io.endpoint import Turn
    from barewire.modbus.framing import Line
    from barewire.modbus.messages.base import Request, Response
R = TypeVar("R", bound="Response")
T = TypeVar("T")


class Connection:
    """The port of a client and its bus: opened when it is needed, dropped when it failed, used by one thread at a time.

    `dial` opens a port, `new_line` makes the framing state of a new connection.
    """

    def __init__(
        self, dial: Callable[[], Port[bytes]], new_line: Callable[[], Line], back_off: BackOff, options: dict[str, Any]
    ) -> None:
        self.port: Port[bytes] | None = None
        self.bus = Bus(new_line(), **options)
        self.back_off = back_off
        self._dial = dial
        self._new_line = new_line
        self._line = threading.Lock()  # held by whoever talks
        self._crowd = 0  # how many are in the queue: then nobody takes the line without standing in it
        self._turns = FairQueue()
        self._alone = threading.Lock()  # who looks at the queue
        self._changed = threading.Condition(self._alone)
        self._closed = False

    def run(self, conversation: Conversation[bytes, T], unit: int | None, patience: float) -> T:
        """Carry a conversation out when it is this unit's turn, alone on the line."""
        ticket = None if not self._crowd and self._line.acquire(False) else self._wait(unit)
        try:
            return run(conversation, self.open(patience))
        except BaseException as error:
            self._failed(error)
            raise
        finally:
            self._line.release()
            if ticket is not None:
                self._leave(ticket)

    def ask(self, unit: int, request: Request[R], timeout: float, patience: float) -> R:
        """`run` of `bus.ask`, without a conversation where none is needed."""
        if unit == BROADCAST and not self.bus.line.numbered:
            return self.run(self.bus.ask(unit, request), unit, patience)  # raises: nobody answers
        ticket = None if not self._crowd and self._line.acquire(False) else self._wait(unit)
        try:
            return exchange(self.bus, unit, request, timeout, self.open(patience))
        except BaseException as error:
            self._failed(error)
            raise
        finally:
            self._line.release()
            if ticket is not None:
                self._leave(ticket)

    def _wait(self, unit: int | None) -> Ticket:
        """Stand in the queue, until it is this unit's turn and the line is free."""
        with self._alone:
            self._crowd += 1
            ticket = self._turns.join(unit)
        try:
            with self._changed:
                self._changed.wait_for(lambda: self._turns.has(ticket))
            self._line.acquire()
        except BaseException:
            self._leave(ticket)
            raise
        return ticket

    def _leave(self, ticket: Ticket) -> None:
        with self._alone:
            self._crowd -= 1
            if self._turns.leave(ticket):
                self._changed.notify_all()

    def _failed(self, error: BaseException) -> None:
        if isinstance(error, PortError) or isinstance(error.__cause__, PortError) or self.bus.line.broken:
            self.drop()

    def open(self, patience: float) -> Port[bytes]:
        """The port, made anew if there is none or it has failed. Waits for the back-off, `patience` seconds at most."""
        if self.port is not None:
            try:
                data = self.port.receive(0.0)
                if data is not None:
                    self.bus.overhear(data, time.monotonic())
                if self.bus.line.broken is None and not self._closed:
                    return self.port
            except PortError:
                pass
            self.drop()
        if self._closed:
            raise PortError("the client was closed")
        wait = self.back_off.wait(time.monotonic())
        if wait > patience:
            raise PortError(f"{self.back_off.why}; tried again in {wait:.1f} s")
        time.sleep(wait)
        try:
            self.port = self._dial()
        except PortError as error:
            self.back_off.failed(time.monotonic(), str(error))
            raise
        self.back_off.worked()
        self.bus.line = self._new_line()
        self.bus.line.sent(time.monotonic())  # who opens a line waits for its silence before speaking
        return self.port

    def drop(self) -> None:
        """Give up a port that failed."""
        if self.port is not None:
            self.port.close()
            self.port = None

    def close(self) -> None:
        """Give the port back, for good."""
        self._closed = True
        self.drop()


class ModbusClient(Verbs):
    """A client on one line or connection. `unit` and `timeout` (seconds) hold where a call does not say otherwise."""

    def __init__(self, connection: Connection, *, unit: int | None = None, timeout: float = 1.0) -> None:
        self.connection = connection
        self.unit = unit
        self.timeout = timeout

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    @property
    def bus(self) -> Bus:
        """What is remembered of the line: counters, late replies."""
        return self.connection.bus

    def settle(self) -> None:
        """Stay on a serial line until no lost answer can come any more: before leaving it to another program."""
        self.run(self.bus.settle())

    def close(self) -> None:
        """Give the port back."""
        self.connection.close()

    def at(self, unit: int | None = None, timeout: float | None = None) -> Self:
        """The same client, on the same connection, speaking to another unit or with another patience."""
        from copy import copy  # nobody else needs it

        other = copy(self)
        other.unit = self.unit if unit is None else unit
        other.timeout = self.timeout if timeout is None else timeout
        return other

    def run(self, conversation: Conversation[bytes, T], *, unit: int | None = None) -> T:
        """Carry any conversation out on this line, alone. `unit` is in whose queue it waits for its turn."""
        return self.connection.run(conversation, unit, self.timeout)

    def talk(self, make: Callable[[Bus], Conversation[bytes, T]], *, unit: int | None = None) -> T:
        """Carry out the conversation that `make` returns for this line's bus: the same word as the asyncio client's."""
        return self.run(make(self.bus), unit=unit)

    def ask(
        self,
        request: Request[R],
        *,
        unit: int | None = None,
        timeout: float | None = None,
        retries: int = 0,
        repeat_writes: bool = False,
    ) -> R:
        """Ask and return the response. Raises ModbusException, NoAnswer, PortError; for a write WriteOutcomeUnknown.

        `retries` repeats a read that got no answer, on a new connection if the old one failed.
        """
        at = self._unit(unit) if unit is None else unit
        link = self.connection
        limit = self.timeout if timeout is None else timeout
        left = retries if repeat_writes or not request.writes else 0
        if not left:
            return link.ask(at, request, limit, self.timeout)
        while True:
            asking = link.bus.ask(at, request, timeout=limit, retries=left, repeat_writes=repeat_writes)
            try:
                return link.run(asking, at, self.timeout)
            except (PortError, NoAnswer):
                if link.port is not None or not left:
                    raise
                left -= 1

    def fetch(self, request: Request[R], take: Callable[[R], T]) -> T:
        """Ask and take something of the answer: what the verbs do."""
        limit = self.timeout
        return take(self.connection.ask(1 if self.unit is None else self.unit, request, limit, limit))

    def broadcast(self, request: Request[R], *, turnaround: float = 0.1) -> None:
        """Broadcast to every unit of a serial line; nobody answers."""
        self.run(self.bus.broadcast(request, turnaround=turnaround))

    def read(self, device: Device, *names: str, unit: int | None = None) -> list[Reading]:
        """Named values, with as few requests as the device allows, in the order asked."""
        from barewire.devices.access import read_modbus  # who reads registers only need not load the devices

        at = self._unit(unit, device)
        return self.run(read_modbus(self.bus, at, device, names, timeout=self.timeout), unit=at)

    def write(
        self, device: Device, values: Mapping[str, Value], *, unit: int | None = None, force: bool = False
    ) -> None:
        """Write named values, in the order given. Ranges and access are checked before anything is sent."""
        from barewire.devices.access import write_modbus

        at = self._unit(unit, device)
        self.run(write_modbus(self.bus, at, device, values, timeout=self.timeout, force=force), unit=at)

    def drive(self, device: Device, *, progress: Callable[[DriveProgress], None] | None = None) -> DriveClient:
        """The device as a drive of CiA 402: enable it, move it. `progress` is called after every look at it."""
        from barewire.io.drive import DriveClient

        return DriveClient(self, device, progress=progress)

    def _unit(self, unit: int | None, device: Device | None = None) -> int:
        if unit is not None:
            return unit
        if self.unit is not None:
            return self.unit
        return device.modbus.unit if device and device.modbus else 1


def open_modbus(
    url: str,
    *,
    watch: Watch | None = None,
    lazy: bool = False,
    chance: Callable[[], float] = dice,
    turn: Turn | None = None,
    **options: Any,
) -> ModbusClient:
    """The client for a URL. `watch(direction, bytes)` is told of everything that passes.

    `turn(sending)` turns the direction of a two-wire line, where a pin of its own does that.
    `lazy` connects with the first question. `chance` is the dice of the pauses between attempts. `options` are those of
    `Bus`, over what the URL says: `gaps` for single units, `dead_longest` and the others.
    Raises EncodeError for a URL that says nothing sensible, PortError for a port that cannot be opened.
    """
    endpoint = modbus_endpoint(url).turned_by(turn)
    unit, timeout = unit_of(endpoint), endpoint.seconds("timeout", 1.0)
    dial = dialer(endpoint)

    def traced() -> Port[bytes]:
        return Trace(dial(), watch) if watch else dial()

    connection = Connection(
        traced, lambda: modbus_line(endpoint, "client"), BackOff(chance), bus_options(endpoint) | options
    )
    if not lazy:
        connection.open(timeout)
    return ModbusClient(connection, unit=unit, timeout=timeout)
