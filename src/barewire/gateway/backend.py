"""Backends: each is one bus behind the gateway, with its connection, which the gateway alone uses.

    query  ->  Dispatcher  ->  lane (a CallbackBox and its Bus)  ->  serial line, TCP, TLS, UDP
                   |                                                      |
    response  <----'<-----------------------------------------------------'

    it cannot be opened                                   0A for every query, until the pause between attempts is over
    the unit does not respond, or not with a response     0B
    the connection ends while a query is under way        0B: whether a write was carried out is unknown
    too many queries wait, or one waits too long          06
    the gateway's own code fails                          04, and a traceback in the log

The bus excludes late responses as in every client. One that was proved to be late is counted, and no client gets it.
"""

from __future__ import annotations

import asyncio
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from barewire.errors import BarewireError, EncodeError, NoAnswer, PortError
from barewire.gateway.dispatch import NO_PATH, NO_RESPONSE, Dispatcher, Exchange, Query, UnitConfig, UnitRecord
from barewire.io.engine.callbacks import CallbackBox
from barewire.io.engine.connections import random_fraction
from barewire.io.log import PortLog
from barewire.io.modbus.async_client import AsyncConnection, Lane
from barewire.io.modbus.carriers import bus_options
from barewire.modbus.adu import BROADCAST
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.messages.raw import RawResponse

if TYPE_CHECKING:
    from barewire.io.endpoint import Endpoint
    from barewire.io.ports.async_links import Mailbox
    from barewire.io.ports.base import AsyncLink
    from barewire.modbus.client.bus import Bus

FAILED = 0x04
"""Exception code of an error in the gateway's own code."""

_WATCHED = 10.0
"""Seconds for which exchanges are kept after they were asked for."""

_ERRORS = 50
"""The errors of a backend that are kept."""
_SEEN = 200
"""The exchanges that are kept for the status page."""

_CHECK_INTERVAL = 1.0
"""Seconds between two looks at the age of a connection."""


@dataclass(frozen=True, slots=True)
class BackendOptions:
    """How a backend uses its connection. Times are in seconds.

    in_flight    requests under way at once, 1 to 16; only TCP, TLS and UDP can have more than 1
    settle       the pause after connecting, before the first request
    idle         the connection is closed after this time without a request; 0 for never
    lifetime     the connection is closed, between two requests, when it is this old; 0 for never
    turnaround   the pause after a broadcast                                                     [MB-SERIAL 2.4.1]
    """

    in_flight: int = 1
    settle: float = 0.0
    idle: float = 0.0
    lifetime: float = 0.0
    turnaround: float = 0.1


class Seen(NamedTuple):
    """One exchange, as the status page shows it. PDUs are in hex; without a response `response` is in words."""

    at: float
    unit: int
    request: str
    name: str
    response: str
    took: float


class BackendError(NamedTuple):
    """What went wrong, when (seconds since 1970), and with which unit, if it was one."""

    at: float
    unit: int | None
    text: str


class Backend(ABC):
    """One bus. `submit` takes queries; every query is answered once, sooner or later, unless its client has left."""

    has_broadcasts = False
    """Whether a request to unit 0 is a broadcast, which no unit answers."""

    def __init__(
        self,
        name: str,
        endpoint: Endpoint,
        options: BackendOptions | None = None,
        units: Mapping[int, UnitConfig] | None = None,
        default: UnitConfig | None = None,
        *,
        capacity: int = 1024,
        patience: float = 10.0,
    ) -> None:
        self.name = name
        self.endpoint = endpoint
        self.options = BackendOptions() if options is None else options
        self.dispatcher = Dispatcher(units, default=default, capacity=capacity, patience=patience)
        self.dispatcher.on_death_or_return = self._log_unit
        self.errors: deque[BackendError] = deque(maxlen=_ERRORS)
        """The latest errors, in words."""
        self._seen: deque[Seen] = deque(maxlen=_SEEN)
        self._watched_until = 0.0
        self.is_draining = False
        self.is_closed = asyncio.Event()
        """Set when the port is free again."""
        self.successors: list[Backend] = []
        """The backends that follow this one on its line, after a reload."""
        self._predecessors: list[Backend] = []  # they may have the port still
        self.cannot_open = False
        """Whether the latest attempt to open the connection failed, or to use a bus that opens itself again."""
        self._log = PortLog("barewire.gateway", name)
        self._opening: asyncio.Task[None] | None = None
        self.under_way: dict[Any, Exchange] = {}
        """The exchange on each lane that has one."""
        self._free: list[Any] = []  # the lanes without an exchange; a kind of backend fills it
        self._is_going_on = self._must_go_on = False
        self._loop = asyncio.get_running_loop()
        self._alarm: asyncio.TimerHandle | None = None
        self._idle = asyncio.Event()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}: {self.endpoint.scheme}://{self.endpoint.place}>"

    @property
    @abstractmethod
    def is_connected(self) -> bool:
        """Whether the connection is open."""

    @abstractmethod
    def _is_ready(self, lane: Any) -> bool:
        """Whether an exchange can be sent on a lane; otherwise the connection must be opened."""

    @abstractmethod
    def _may_open(self, now: float) -> bool:
        """Whether the connection may be opened now. After a failed attempt there is a pause."""

    @abstractmethod
    async def _open(self) -> None:
        """Open the connection. Raises BarewireError."""

    @abstractmethod
    def _send(self, lane: Any, exchange: Exchange) -> None:
        """Begin an exchange, and call `_ended` when it has ended, which may be before this returns."""

    @abstractmethod
    async def _close(self) -> None:
        """Close the connection. What is under way ends with an error."""

    def submit(self, query: Query) -> None:
        """Take a query. It may be answered before this returns."""
        now = self._loop.time()
        lane = self._free_lane()
        has_path = lane is not None or self.is_connected or self._opening or self._may_open(now)
        if self.is_draining or not has_path:
            self.dispatcher.unit(query.unit).decline(query, NO_PATH)
            return
        exchange = self.dispatcher.submit(query, now, is_lane_free=lane is not None)
        if exchange is not None:
            self._begin(lane, exchange)
        elif self.dispatcher.has_work:
            self._go_on()

    def _go_on(self) -> None:
        """Send what is due, on every lane that is free.

        An exchange may end while it is sent, because the port failed. Then this is called from within: the loop of the
        outer call goes on.
        """
        self._must_go_on = True
        if self._is_going_on:
            return
        self._is_going_on = True
        try:
            while self._must_go_on and self.dispatcher.has_work:
                self._must_go_on = False
                self._fill_lanes()
        finally:
            self._is_going_on = False
        if self._alarm is not None or self.dispatcher.wake is not None:
            self._set_alarm()
        if self.is_draining and not self.under_way and not self.dispatcher.has_work:
            self._idle.set()

    def _fill_lanes(self) -> None:
        now = self._loop.time()
        while self._free and not self._holds():
            lane = self._free_lane()
            if lane is None:
                if self._opening is None:
                    self._opening = self._loop.create_task(self._connect())
                return
            exchange = self.dispatcher.take(now)
            if exchange is None:
                return
            self._begin(lane, exchange)

    def _free_lane(self) -> Any:
        """Return a lane on which an exchange can be sent; None if all are busy, or the connection must be opened."""
        return self._free[-1] if self._free and not self._holds() and self._is_ready(self._free[-1]) else None

    def _holds(self) -> bool:
        """Whether nothing new is sent now."""
        return False

    def _begin(self, lane: Any, exchange: Exchange) -> None:
        self._free.remove(lane)
        self.under_way[lane] = exchange
        try:
            self._send(lane, exchange)
        except Exception as error:  # whatever it is, the lane must not be lost
            self._fail(error)
            if self.under_way.get(lane) is exchange:
                self._ended(lane, FAILED, is_silence=False)

    def _set_alarm(self) -> None:
        """Go on when the pause of a unit is over, if nothing else happens before."""
        if self._alarm is not None:
            self._alarm.cancel()
            self._alarm = None
        if self.dispatcher.wake is not None and self.dispatcher.has_work:
            self._alarm = self._loop.call_at(self.dispatcher.wake, self._ring)

    def _ring(self) -> None:
        """Go on, because the pause of a unit is over. If nothing can be sent now, what ends next goes on."""
        self._alarm = self.dispatcher.wake = None
        self._go_on()

    async def _connect(self) -> None:
        code = FAILED
        try:
            while self._predecessors:
                await self._predecessors[0].is_closed.wait()
                del self._predecessors[0]
            await self._open()
        except BarewireError as error:  # the port, or what its URL names: a certificate that is not there any more
            code = NO_PATH
            self.cannot_open = True
            self._log.warning("path", str(error))
            self._note(None, str(error))
        except Exception as error:
            self._fail(error)
        else:
            if self.cannot_open:
                self._log.info("open", "open again")
            self.cannot_open = False
            self._opening = None
            self._go_on()
            return
        self._opening = None
        self.dispatcher.decline_all(code)
        self._go_on()

    def _ended(self, lane: Any, response: bytes | int | None, *, is_silence: bool = True) -> None:
        """An exchange has ended: pass its response on, and take the next one. See `Dispatcher.finish`."""
        exchange = self.under_way.pop(lane)
        self._free.append(lane)
        now = self._loop.time()
        if now < self._watched_until:
            self._see(exchange, response)
        self.dispatcher.finish(exchange, response, now, is_silence=is_silence)
        self._go_on()

    def _log_unit(self, unit: UnitRecord) -> None:
        kind, name = ("unit", unit.number), f"unit {unit.number}"
        if unit.is_dead:
            self._log.warning(kind, f"{name} is dead: {unit.silent} requests in a row without a response")
        else:
            self._log.info(kind, f"{name} answers again")

    def watch_frames(self) -> list[Seen]:
        """Return the latest exchanges. They are kept only for some seconds after each call."""
        now = self._loop.time()
        if now >= self._watched_until:
            self._seen.clear()
        self._watched_until = now + _WATCHED
        return list(self._seen)

    def _see(self, exchange: Exchange, response: bytes | int | None) -> None:
        answer = response.hex(" ").upper() if isinstance(response, bytes) else "no response"
        took = self._loop.time() - exchange.started
        request = exchange.request
        self._seen.append(Seen(time.time(), exchange.unit, request.pdu.hex(" ").upper(), request.name, answer, took))

    def _note(self, unit: int | None, text: str) -> None:
        self.errors.append(BackendError(time.time(), unit, text))

    def _fail(self, error: BaseException) -> None:
        """Log an error in the gateway's own code."""
        text = f"{type(error).__name__}: {error}"
        self._note(None, text)
        self._log.error("code", text, error)

    async def drain(self, timeout: float) -> None:
        """Decline new queries, and wait until those that wait or are under way are answered, and no answer can come
        any more which the next user of the line could take for its own: `timeout` s at most."""
        self.is_draining = True
        try:
            async with asyncio.timeout(timeout):
                if self.under_way or self.dispatcher.has_work:
                    await self._idle.wait()
                if not self.successors:
                    await self._settle()
        except TimeoutError:
            what = "queries were not answered" if self.under_way else "answers may still come: the line was not left"
            self._log.warning("drain", f"{what} within {timeout:g} s")

    def follow(self, predecessors: list[Backend]) -> None:
        """Use the line of backends that end, after them, and know which of their answers may still come."""
        self._predecessors = predecessors
        for before in predecessors:
            before.successors.append(self)
            if before.is_closed.is_set():
                self._take_over(before)

    @property
    @abstractmethod
    def awaits_answers(self) -> bool:
        """Whether an answer to an earlier request may still come."""

    @abstractmethod
    async def _settle(self) -> None:
        """Wait until no answer to an earlier request can come."""

    @abstractmethod
    def _take_over(self, before: Backend) -> None:
        """Take over which answers may still come, from a backend that is closed."""

    async def close(self) -> None:
        """Close the connection. Queries that are not answered yet get 0A, those under way 0B."""
        self.is_draining = True
        if self._opening is not None:
            self._opening.cancel()
            await asyncio.wait([self._opening])
        if self._alarm is not None:
            self._alarm.cancel()
        self.dispatcher.decline_all(NO_PATH)
        await self._close()
        for successor in self.successors:
            successor._take_over(self)
        self._predecessors.clear()
        self.is_closed.set()


class _Connection(AsyncConnection):
    """The connection of a backend: its lanes carry out exchanges by callbacks."""

    backend: ModbusBackend

    def new_box(self, lane: Lane) -> Mailbox:
        return CallbackBox(self.endpoint.place, lane.bus)

    def writer(self, link: AsyncLink) -> Callable[[bytes], None]:
        """Return a function that sends a request at once if no other is under way: a round of the loop, in which more
        could come, costs as much as a send."""
        under_way = self.backend.under_way
        return lambda frame: link.write(frame) if len(under_way) == 1 else link.write_together(frame)


class ModbusBackend(Backend):
    """A Modbus line or connection. Its exchanges have no tasks; `jitter` returns the random part of pauses, 0..1."""

    def __init__(self, *arguments: Any, jitter: Callable[[], float] = random_fraction, **options: Any) -> None:
        super().__init__(*arguments, **options)
        # The bus keeps the pauses too, between a probe and a request; dead units are asked by the dispatcher alone.
        default, units = self.dispatcher.default.asking, self.dispatcher.configs
        asking = bus_options(self.endpoint) | {
            "options": default._replace(dead_after=0),
            "units": {unit: config.asking._replace(dead_after=0) for unit, config in units.items()},
        }
        self.connection = _Connection(self.endpoint, self.options.in_flight, jitter, asking, watch=None)
        self.connection.backend = self
        self._free = list(self.connection.lanes)
        self.has_broadcasts = not self.connection.lanes[0].bus.line.numbered
        self._opened_at = self._used_at = 0.0
        self._housekeeping: asyncio.TimerHandle | None = None

    @property
    def is_connected(self) -> bool:
        """Whether the connection is open."""
        box = self.connection.lanes[0].box
        return box is not None and box.lost is None

    @property
    def bus(self) -> Bus:
        """The state of the line: its counters and its late answers."""
        return self.connection.lanes[0].bus

    def _is_ready(self, lane: Lane) -> bool:
        if self.options.lifetime and not self.under_way and self.is_connected and self._is_too_old(self._loop.time()):
            self.connection.drop(f"it is {self.options.lifetime:g} s old")
        return self.connection.usable_box(lane) is not None

    def _may_open(self, now: float) -> bool:
        return self.connection.back_off.wait(now) <= 0.0

    async def _open(self) -> None:
        try:
            await self.connection.open(self.connection.lanes[0], 0.0)
        except EncodeError as error:
            self.connection.back_off.failed(self._loop.time(), str(error))
            raise
        if self.options.settle:
            await asyncio.sleep(self.options.settle)
            if not self.is_connected:  # the other side has closed it at once: next time after a pause
                why = f"{self.endpoint.place}: the connection ended within {self.options.settle:g} s"
                self.connection.drop(why)
                self.connection.back_off.failed(self._loop.time(), why)
                raise PortError(why)
        self._opened_at = self._used_at = self._loop.time()
        self._keep_house()

    def _send(self, lane: Lane, exchange: Exchange) -> None:
        self._used_at = exchange.started
        box: CallbackBox = lane.box  # type: ignore[assignment]  # `new_box` makes no other

        def done(result: Any, error: BaseException | None) -> None:
            if error is None:
                # Without bytes the standard demands silence: after a broadcast, and after Force Listen Only Mode.
                self._ended(lane, result.pdu if isinstance(result, RawResponse) else None)
            elif isinstance(error, ModbusException) and error.pdu is not None:
                self._ended(lane, error.pdu)
            else:
                self._went_wrong(lane, box, exchange, error)

        if exchange.unit == BROADCAST and self.has_broadcasts:
            request = exchange.request.known or exchange.request
            box.start(lane.bus.broadcast(request, turnaround=self.options.turnaround), done)
        else:
            box.ask(exchange.unit, exchange.request, exchange.timeout, done)

    def _went_wrong(self, lane: Lane, box: CallbackBox, exchange: Exchange, error: BaseException) -> None:
        self.connection.failed(lane, box, error, exchange.unit, exchange.request)
        if not isinstance(error, NoAnswer | PortError):
            self._fail(error)
            self._ended(lane, FAILED, is_silence=False)
            return
        self._note(exchange.unit, str(error))
        has_path = not (isinstance(error, PortError) or isinstance(error.__cause__, PortError))
        self._ended(lane, NO_RESPONSE, is_silence=has_path)

    def _keep_house(self) -> None:
        """Close a connection that is too old, or was not used for too long."""
        if not (self.options.idle or self.options.lifetime) or not self.is_connected:
            return
        now = self._loop.time()
        if not self.under_way:
            if self._is_too_old(now):
                self.connection.drop(f"it is {self.options.lifetime:g} s old")
            elif self.options.idle and now >= self._used_at + self.options.idle:
                self.connection.drop(f"it was not used for {self.options.idle:g} s")
        if self._housekeeping is not None:
            self._housekeeping.cancel()
        self._housekeeping = self._loop.call_later(_CHECK_INTERVAL, self._keep_house)

    def _is_too_old(self, now: float) -> bool:
        return 0.0 < self.options.lifetime <= now - self._opened_at

    def _holds(self) -> bool:
        """An old connection is closed when nothing is under way: until then nothing new is sent, or a line that is
        always busy would never be."""
        return self.options.lifetime > 0.0 and bool(self.under_way) and self._is_too_old(self._loop.time())

    async def _close(self) -> None:
        if self._housekeeping is not None:
            self._housekeeping.cancel()
        self.connection.close()

    @property
    def awaits_answers(self) -> bool:
        """Whether an answer to an earlier request may still come."""
        self.bus.state.expire(self._loop.time())
        return bool(self.bus.state.pending)

    async def _settle(self) -> None:
        box = self.connection.usable_box(self.connection.lanes[0])
        if isinstance(box, CallbackBox) and not box.is_busy and self.awaits_answers:
            ended = asyncio.Event()
            box.start(self.bus.settle(), lambda result, error: ended.set())
            await ended.wait()

    def _take_over(self, before: Backend) -> None:
        if isinstance(before, ModbusBackend):
            self.bus.take_over(before.bus)
