"""The connection of a blocking client: opened when it is needed, dropped when it fails, used by one thread at a time.

    thread 1, unit 1  --.
    thread 2, unit 7  ---+-- fair queue --> lock --> port, bus --> the line
    thread 3, unit 1  --'

While no thread waits, the lock is taken without the queue. After a connection has failed, the next request opens it
again, at once the first time, then after pauses that grow (`BackOff`).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from barewire.errors import BarewireError, EncodeError, NoAnswer, PortError
from barewire.io.engine.blocking import run
from barewire.io.engine.fast_path import exchange
from barewire.io.engine.forking import OPENED_BEFORE_FORK, end_after_fork
from barewire.io.log import watch_both
from barewire.io.ports.trace import Trace
from barewire.modbus.adu import BROADCAST
from barewire.modbus.client.bus import Bus
from barewire.modbus.client.fair_queue import FairQueue, Ticket
from barewire.modbus.exceptions import ModbusException
from barewire.tcp import TcpLine

if TYPE_CHECKING:
    from barewire.conversation import Conversation
    from barewire.io.engine.backoff import BackOff
    from barewire.io.modbus.client_log import ClientLog
    from barewire.io.ports.base import Port
    from barewire.io.ports.trace import Watch
    from barewire.modbus.framing import Line
    from barewire.modbus.messages.base import Request, Response

R = TypeVar("R", bound="Response")
T = TypeVar("T")


class Connection:
    """The port of a client and its bus. `dial` opens a port, `new_line` makes the framing state of a new connection.

    `bus_options` are arguments of `Bus`. The methods wait at most `patience` seconds for the back-off. `watch` is
    called with all bytes.
    """

    def __init__(
        self,
        dial: Callable[[], Port[bytes]],
        new_line: Callable[[], Line],
        back_off: BackOff,
        bus_options: dict[str, Any],
        log: ClientLog,
        watch: Watch | None = None,
    ) -> None:
        self.port: Port[bytes] | None = None
        self.bus = Bus(new_line(), **bus_options)
        self.bus.state.on_stray = log.stray
        self.back_off = back_off
        self._log = log
        self._watch = watch
        self._dial = dial
        self._new_line = new_line
        self._closed = ""  # why requests are refused, if they are
        self._new_queue()

    def _new_queue(self) -> None:
        # Held during an exchange. An RLock knows its owner as soon as it is acquired, whatever exception comes then.
        self._line: Any = threading.RLock()  # Any: its `_is_owned`, which Condition uses too, has no type
        self._tickets: set[Ticket] = (
            set()
        )  # of the threads in the queue: while there are any, the line is taken in turn
        self._queue = FairQueue()
        self._queue_lock: Any = threading.RLock()
        self._changed = threading.Condition(self._queue_lock)

    def run(self, conversation: Conversation[bytes, T], unit: int | None, patience: float) -> T:
        """Carry out a conversation when it is this unit's turn, with the line to itself."""
        return self._on_line(unit, lambda: run(conversation, self.open(patience)))

    def ask(self, unit: int, request: Request[R], timeout: float, patience: float) -> R:
        """Do the same as `run` with `bus.ask`, on the fast path (`engine.fast_path`)."""
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
                if self._line._is_owned():
                    self._failed(error, unit, request)
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

    def _failed(self, error: BaseException, unit: int | None, request: Request[Any] | None = None) -> None:
        if isinstance(error, ModbusException):
            error.add_place(unit, getattr(request, "address", None))
        elif isinstance(error, NoAnswer):
            self._log.no_answer(unit, error)
        failed = isinstance(error, PortError) or isinstance(error.__cause__, PortError)
        # An exception that is not ours, such as Ctrl-C, may have lost bytes between the port and the line. The frames
        # of a stream without a check sum cannot be found again then.
        has_gap = isinstance(self.bus.line, TcpLine) and not isinstance(error, BarewireError)
        if failed or has_gap or self.bus.line.broken:
            self.drop(str(self.bus.line.broken or error.__cause__ or error))

    def open(self, patience: float) -> Port[bytes]:
        """Return the port. It is opened if there is none, or if it has failed."""
        if self.port is not None:
            try:
                data = self.port.receive(0.0)
                if data is not None:
                    self.bus.overhear(data, time.monotonic())
                if self.bus.line.broken is None and not self._closed:
                    return self.port
                why = str(self.bus.line.broken)
            except PortError as error:
                why = str(error)
            self.drop(why)
        if self._closed:
            raise PortError(self._closed)
        wait = self.back_off.wait(time.monotonic())
        if wait > patience:
            raise PortError(f"{self.back_off.why}; tried again in {wait:.1f} s")
        time.sleep(wait)
        try:
            port = self._dial()
        except PortError as error:
            self.back_off.failed(time.monotonic(), str(error))
            self._log.not_connected(error, self.back_off.wait(time.monotonic()))
            raise
        watch = watch_both(self._watch, self._log.watch())
        line = self._new_line()
        line.sent(time.monotonic())  # a client waits for a silence of the line before its first request
        # Before the port is there: bytes of the old connection must not stand before those of the new one.
        self.bus.continue_on(line)
        self.port = port if watch is None else Trace(port, watch)
        end_after_fork(self)
        self.back_off.reset()
        self._log.connected()
        return self.port

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
        if self.port is not None:
            self._log.lost(why)
            self.port.close()
            self.port = None

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
