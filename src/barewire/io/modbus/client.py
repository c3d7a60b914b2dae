"""The blocking Modbus client.

    with ModbusClient("tcp://127.0.0.1:1502", unit=1) as client:
        client.read_holding_registers(0, 2)                  the names of the standard, see `methods`
        client.ask(ReadHoldingRegisters(0, 2)).registers     any request message

A client may be used from several threads. There is one exchange at a time on the line, and the units take turns. After
a connection has failed, the next request opens it again.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self, TypeVar

from barewire._callbacks import check_callbacks
from barewire.errors import BarewireError, EncodeError, NoAnswer, PortError
from barewire.io.engine.blocking import exchange, run
from barewire.io.engine.connections import OPENED_BEFORE_FORK, end_after_fork, random_fraction
from barewire.io.engine.methods import BlockingClient
from barewire.io.log import watch_both
from barewire.io.modbus.carriers import bus_options, dialer, modbus_line, of_units
from barewire.io.modbus.connection import ConnectionBase
from barewire.io.modbus.methods import ModbusMethods
from barewire.io.ports.base import Trace
from barewire.modbus.adu import BROADCAST
from barewire.modbus.client.bus import Bus
from barewire.modbus.client.fair_queue import FairQueue, Ticket

if TYPE_CHECKING:
    from ssl import SSLContext
    from typing import Unpack

    from barewire.conversation import Conversation
    from barewire.io.endpoint import Endpoint, SetDirection
    from barewire.io.modbus.carriers import ModbusOptions, UnitKeywords
    from barewire.io.ports.base import Port, Watch
    from barewire.modbus.messages.base import Request, Response

R = TypeVar("R", bound="Response")
T = TypeVar("T")


class Connection(ConnectionBase):
    """The port of a client and its bus: opened when it is needed, dropped when it fails, used by one thread at a time.

        thread 1, unit 1  --.
        thread 2, unit 7  ---+-- fair queue --> lock --> port, bus --> the line
        thread 3, unit 1  --'

    While no thread waits, the lock is taken without the queue. After a connection has failed, the next request opens it
    again, at once the first time, then after pauses that grow. The methods wait at most `patience` seconds for them.
    """

    def __init__(
        self, endpoint: Endpoint, jitter: Callable[[], float], bus_options: dict[str, Any], watch: Watch | None
    ) -> None:
        super().__init__(endpoint, jitter, watch)
        self.port: Port[bytes] | None = None
        self.bus = Bus(modbus_line(endpoint, "client"), **bus_options)
        self.bus.state.on_stray = self._log.stray
        self._dial = dialer(self.endpoint)
        self._new_queue()

    def _new_queue(self) -> None:
        # Held during an exchange. An RLock has an owner as soon as it is acquired, whatever exception comes then.
        self._line: Any = threading.RLock()  # Any: its `_is_owned`, which Condition uses too, has no type
        # Of the threads in the queue: while there are any, the line is taken in turn.
        self._tickets: set[Ticket] = set()
        self._queue = FairQueue()
        self._queue_lock: Any = threading.RLock()
        self._changed = threading.Condition(self._queue_lock)

    def run(
        self,
        conversation: Conversation[bytes, T],
        unit: int | None,
        patience: float,
        request: Request[Any] | None = None,
    ) -> T:
        """Carry out a conversation when it is this unit's turn, with the line to itself."""
        return self._on_line(unit, lambda: run(conversation, self.open(patience)), request)

    def ask(self, unit: int, request: Request[R], timeout: float, patience: float) -> R:
        """Do the same as `run` with `bus.ask`, on the fast path (`engine.blocking`)."""
        if unit == BROADCAST and not self.bus.line.numbered:
            return self.run(self.bus.ask(unit, request, retries=0), unit, patience)  # raises: a broadcast has no answer
        return self._on_line(unit, lambda: exchange(self.bus, unit, request, timeout, self.open(patience)), request)

    def _on_line(self, unit: int | None, act: Callable[[], T], request: Request[Any] | None = None) -> T:
        """Call `act` when it is this unit's turn, with the line to itself. Raises EncodeError if that would never be,
        because this thread has the line.

        An exception may come at any line, also in `finally`: hence the second one.
        """
        line = self._line
        if line._is_owned():
            text = "the client is used inside one of its own callbacks (watch=, a handler of its log, ...)"
            raise EncodeError(f"{text}, during a request: use it afterwards, or another client")
        ticket, has_left = None, False
        try:
            try:
                if self._tickets or not line.acquire(False):
                    ticket = Ticket(unit)
                    self._wait(ticket)
                return act()
            except BaseException as error:
                if line._is_owned() and self._is_lost_by(error, self.bus, unit, request):
                    self.drop(str(self.bus.line.broken or error.__cause__ or error))
                raise
            finally:
                if ticket is not None:
                    has_left = self._give_back(ticket)
                elif line._is_owned():
                    line.release()
        finally:
            if not has_left and (ticket is not None or line._is_owned()):
                self._give_back(ticket)

    def _wait(self, ticket: Ticket) -> None:
        """Wait in the queue until it is this ticket's turn and the line is free."""
        with self._changed:
            self._tickets.add(ticket)
            self._queue.join(ticket)
            self._changed.wait_for(lambda: self._queue.place(ticket) is not None)
        self._line.acquire()

    def _give_back(self, ticket: Ticket | None) -> bool:
        """Give back what this thread has of the line and of the queue. Returns True. A second call has no effect."""
        if self._line._is_owned():
            self._line.release()
        if ticket is not None:
            with self._changed:
                self._tickets.discard(ticket)
                self._queue.leave(ticket)
                self._changed.notify_all()
            while self._queue_lock._is_owned():  # an exception came as a `with` ended
                self._queue_lock.release()
        return True

    def open(self, patience: float) -> Port[bytes]:
        """Return the port. It is opened if there is none, or if it has failed."""
        port = self.port  # another thread may close it at any time
        if port is not None:
            try:
                data = port.receive(0.0)
                if data is not None:
                    self.bus.overhear(data, time.monotonic())
                if self.bus.line.broken is None:
                    return port
                why = str(self.bus.line.broken)
            except PortError as error:
                why = str(error)
            self.drop(why)
        time.sleep(self.pause_before_opening(time.monotonic(), patience))
        self._check_not_closed()
        try:
            opened = self._dial()
        except PortError as error:
            self._not_opened(error, time.monotonic())
            raise
        watch = watch_both(self._watch, self._log.watch())
        line = modbus_line(self.endpoint, "client")
        line.sent(time.monotonic())  # a client waits for a silence of the line before its first request
        # Before the port is there: bytes of the old connection must not stand before those of the new one.
        self.bus.continue_on(line)
        port = self.port = opened if watch is None else Trace(opened, watch)
        end_after_fork(self)
        if self._closed:  # while it was opened
            self.drop("")
            self._check_not_closed()
        self._opened()
        return port

    def can_open(self, patience: float) -> bool:
        """Return whether the port is closed and a request could open it again within `patience` seconds."""
        return self.port is None and not self._closed and self.back_off.wait(time.monotonic()) <= patience

    def open_now(self, patience: float) -> None:
        """Open the port if there is none, without a pause after earlier failures."""

        def open_at_once() -> None:
            self.back_off.reset()
            self.open(patience)

        self._on_line(None, open_at_once)

    def drop(self, why: str) -> None:
        """Close a port that failed; the next request opens another one."""
        port, self.port = self.port, None  # first: `on_lost` may close the client, and so may another thread
        if port is not None:
            try:
                self._lost("" if self._closed else why)
            finally:
                port.close()

    def close(self) -> None:
        """Close the port for good."""
        self._closed = self._closed or "the client was closed"
        self.drop("")
        self._log.flush()

    def end_in_child(self) -> None:
        """Refuse further requests in a forked process, and leave the port to the process that opened it."""
        if self.port is not None:
            self._closed = f"the client was {OPENED_BEFORE_FORK}"
            self.port = None  # not closed: its `close` may set the direction of the line, which the parent still uses
        self._new_queue()  # locks of threads that do not exist here


class ModbusClient(ModbusMethods, BlockingClient):
    """A client on one line or connection, opened by URL (`barewire.io.endpoint` lists the forms).

    unit            0..255, the unit that methods address; by default the device's own, or 1
    timeout         seconds that a request waits for its response; by default 1
    units           options of single units, such as {7: {"gap": 0.1}}: timeout, gap, dead_after, longest_pause
    watch           called as watch("sent" or "received", data) with all bytes
    on_lost         called as on_lost(why) when the connection is lost; the next request opens another one
    set_direction   called as set_direction(sending) to set the direction of a two-wire line, for example by a GPIO pin
    ssl_context     an `ssl.SSLContext` for tls://, in place of the files of the URL
    lazy            connect with the first request, not in the constructor
    jitter          returns numbers in 0..1 that vary the pauses between attempts to connect; by default random
    options         all other options of a URL, which they override: see `barewire.io.endpoint`

    `at` returns the same client with another unit or time-out.

    Raises EncodeError for a wrong URL or option, PortError for a port that cannot be opened.
    """

    def __init__(
        self,
        url: str,
        *,
        unit: int | None = None,
        timeout: float | None = None,
        units: Mapping[int, UnitKeywords] | None = None,
        watch: Watch | None = None,
        on_lost: Callable[[str], object] | None = None,
        set_direction: SetDirection | None = None,
        ssl_context: SSLContext | None = None,
        lazy: bool = False,
        jitter: Callable[[], float] = random_fraction,
        **options: Unpack[ModbusOptions],
    ) -> None:
        check_callbacks("on_lost", on_lost=on_lost)
        given = {"unit": unit, "timeout": timeout, **of_units(units), **options}
        endpoint = self._configure(url, set_direction, ssl_context, given)
        self.connection = Connection(endpoint, jitter, bus_options(endpoint), watch)
        self.connection.on_lost = on_lost
        if not lazy:
            self.connection.open(self.timeout)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def connected(self) -> bool:
        """Whether the port is open, as far as is known: a lost connection shows in the next request."""
        return self.connection.port is not None

    @property
    def bus(self) -> Bus:
        """The state of the line: its counters and its late answers."""
        return self.connection.bus

    def open(self) -> None:
        """Connect now, if the client is not connected: without the pause that follows failed attempts, and the next
        pause is the first again. PortError if that fails."""
        self.connection.open_now(self.timeout)

    def close(self) -> None:
        """Close the connection. Requests under way in other threads raise PortError."""
        self.connection.close()

    def run(self, conversation: Conversation[bytes, T], *, unit: int | None = None) -> T:
        """Carry out a conversation of this client's `bus`, with the line to itself, in the queue of `unit`."""
        return self.connection.run(conversation, unit, self.timeout)

    def run_with_bus(self, make: Callable[[Bus], Conversation[bytes, T]], *, unit: int | None = None) -> T:
        """Carry out the conversation that `make` returns for the bus it is given."""
        return self.run(make(self.bus), unit=unit)

    def fetch(self, request: Request[R], take: Callable[[R], T]) -> T:
        """Send a request to the client's unit and return what `take` takes of its response, with its time-out."""
        unit = 1 if self.unit is None else self.unit
        if self.retries:
            return take(self.ask(request, unit=unit))
        timeout = self.timeout_for(unit) if self._timeouts else self.timeout
        return take(self.connection.ask(unit, request, timeout, self.timeout))

    def fetch_all(
        self, unit: int, requests: Sequence[Request[Any]], notes: Sequence[str], take: Callable[[list[Any]], T]
    ) -> T:
        """Send requests in a row and return what `take` takes of all responses. An error gets its request's note."""
        responses = []
        for request, note in zip(requests, notes):
            try:
                if self.retries:
                    responses.append(self.ask(request, unit=unit))
                else:
                    responses.append(self.connection.ask(unit, request, self.timeout_for(unit), self.timeout))
            except BarewireError as error:
                error.add_context(note)
                raise
        return take(responses)

    def ask(
        self,
        request: Request[R],
        *,
        unit: int | None = None,
        timeout: float | None = None,
        retries: int | None = None,
        repeat_writes: bool = False,
    ) -> R:
        """Send a request message and return its response message.

        `retries`, by default that of the client, repeats a read that got no answer, on a new connection if the old one
        failed, unless the pause before that is longer than the client's time-out; a write is repeated only with
        `repeat_writes`. Raises ModbusException for an exception response, NoAnswer after the time-out
        (WriteOutcomeUnknown for a write), PortError if the port fails, TypeError if `request` is not a request message.
        """
        address, limit, repeats = self._ask_arguments(request, unit, timeout, retries)
        connection = self.connection
        if repeats <= 0 or (request.writes and not repeat_writes):
            return connection.ask(address, request, limit, self.timeout)
        # A conversation repeats a request on the same connection; this loop does it on a new one.
        while True:
            asking = connection.bus.ask(address, request, timeout=limit, retries=repeats, repeat_writes=repeat_writes)
            try:
                return connection.run(asking, address, self.timeout, request)
            except (PortError, NoAnswer):
                if not repeats or not connection.can_open(self.timeout):
                    raise
                repeats -= 1
