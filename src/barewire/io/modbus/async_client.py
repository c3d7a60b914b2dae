"""The asyncio Modbus client: the methods of the blocking one, over the same carriers.

    async with AsyncModbusClient("tcp://127.0.0.1:1502", in_flight=16) as client:
        await client.read_holding_registers(0, 2)
        (await client.ask(ReadHoldingRegisters(0, 2))).registers

Over TCP, TLS and UDP up to 16 requests may be under way at once. Their answers arrive in any order and are matched by
transaction number. On a serial line there is one request at a time, and the units take turns.

A task that is cancelled abandons its conversation, and the line stays usable: the bus recognizes the late answer, on
TCP by its transaction number.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Self, TypeVar

from barewire._callbacks import check_callbacks
from barewire.errors import BarewireError, EncodeError, NoAnswer, PortError, shown
from barewire.io.engine.asyncio import exchange, run
from barewire.io.engine.connections import OPENED_BEFORE_FORK, end_after_fork, random_fraction
from barewire.io.engine.methods import AsyncioClient
from barewire.io.log import watch_both
from barewire.io.modbus.carriers import bus_options, modbus_line, of_units
from barewire.io.modbus.connection import ConnectionBase
from barewire.io.modbus.methods import ModbusMethods
from barewire.io.ports.async_links import Mailbox, connect
from barewire.io.ports.base import traced
from barewire.modbus.adu import BROADCAST
from barewire.modbus.client.bus import Bus
from barewire.modbus.client.fair_queue import FairQueue, Ticket
from barewire.tcp import FanOut

if TYPE_CHECKING:
    from ssl import SSLContext
    from typing import Unpack

    from barewire.conversation import Conversation
    from barewire.io.endpoint import Endpoint, SetDirection
    from barewire.io.modbus.carriers import ModbusOptions, UnitKeywords
    from barewire.io.ports.base import AsyncLink, Watch
    from barewire.modbus.messages.base import Request, Response

R = TypeVar("R", bound="Response")
T = TypeVar("T")


class Lane:
    """The place of one request under way: its bus, and the mailbox of its answers."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.box: Mailbox | None = None


class AsyncConnection(ConnectionBase):
    """The connection of a client: opened when it is needed, dropped when it fails, its lanes used in turn.

        requests ->  fair queue  ->  lane 1: bus, mailbox  ->  |
                                     lane 2: bus, mailbox  ->  |  one connection
                                     ...

    A lane carries one request at a time. There is one lane on a serial line and up to 16 over TCP, TLS and UDP, where
    `FanOut` passes each answer to the lane with its transaction number. A task that is cancelled releases its lane, and
    the connection stays open for the others. The methods wait at most `patience` seconds for the back-off.
    """

    harmless = (BarewireError, asyncio.CancelledError)  # a task is cancelled only where it waits

    def __init__(
        self,
        endpoint: Endpoint,
        in_flight: int,
        jitter: Callable[[], float],
        bus_options: dict[str, Any],
        watch: Watch | None,
    ) -> None:
        super().__init__(endpoint, jitter, watch)
        if not isinstance(in_flight, int) or not 1 <= in_flight <= 16:
            raise EncodeError(
                f"in_flight {shown(in_flight)}: expected 1..16 requests under way [MB-TCP 4.2.1]", "in_flight"
            )
        bus = Bus(modbus_line(endpoint, "client"), **bus_options)
        if in_flight > 1 and not bus.line.numbered:
            raise EncodeError(
                "in_flight: answers without transaction numbers cannot be matched, so one at a time", "in_flight"
            )
        self.lanes = [Lane(bus), *(Lane(bus.sibling_bus(bus.line)) for _ in range(in_flight - 1))]
        bus.state.on_stray = self._log.stray
        self._link: AsyncLink | None = None
        self._has_told_lost = False
        self._new_queue()

    def _new_queue(self) -> None:
        self._queue = FairQueue(len(self.lanes))
        self._waiters: dict[Ticket, asyncio.Future[None]] = {}
        self._opening = asyncio.Lock()

    def run(
        self,
        make: Callable[[Bus], Conversation[bytes, T]],
        unit: int | None,
        patience: float,
        request: Request[Any] | None = None,
    ) -> Coroutine[Any, Any, T]:
        """Carry out a conversation when it is this unit's turn, on a free lane."""
        return self._on_lane(unit, patience, lambda bus, box: run(make(bus), box), request)

    def ask(self, unit: int, request: Request[R], timeout: float, patience: float) -> Coroutine[Any, Any, R]:
        """Do the same as `run` with `bus.ask`, on the fast path (`engine.blocking`)."""
        if unit == BROADCAST and not self.lanes[0].bus.line.numbered:
            # Raises EncodeError: a broadcast has no answer.
            return self.run(lambda bus: bus.ask(unit, request), unit, patience)
        return self._on_lane(unit, patience, lambda bus, box: exchange(bus, unit, request, timeout, box), request)

    async def _on_lane(
        self,
        unit: int | None,
        patience: float,
        act: Callable[[Bus, Mailbox], Coroutine[Any, Any, T]],
        request: Request[Any] | None = None,
    ) -> T:
        """Wait until it is this unit's turn, and call `act` with a free lane, which no other task uses meanwhile.

        An exception may come at any line, also in `finally`: hence the second one.
        """
        ticket = Ticket(unit)
        lane = box = None
        has_left = False
        try:
            try:
                place = self._queue.join(ticket)
                lane = self.lanes[await self._turn(ticket) if place is None else place]
                box = self.open_box(lane) or await self.open(lane, patience)
                return await act(lane.bus, box)
            except BaseException as error:
                if lane is not None:
                    self.failed(lane, box, error, unit, request)
                raise
            finally:
                has_left = self._leave(ticket)
        finally:
            if not has_left:
                self._leave(ticket)

    async def _turn(self, ticket: Ticket) -> int:
        """Wait until the ticket is admitted, and return its place."""
        while (place := self._queue.place(ticket)) is None:
            self._waiters[ticket] = asyncio.get_running_loop().create_future()
            await self._waiters[ticket]
        return place

    def _leave(self, ticket: Ticket) -> bool:
        """End a ticket, and wake the tasks whose turn it is. Returns True."""
        self._queue.leave(ticket)
        if self._waiters:
            self._waiters.pop(ticket, None)
            for holder in self._queue.holders & self._waiters.keys():
                if not self._waiters[holder].done():
                    self._waiters[holder].set_result(None)
        return True

    def failed(
        self, lane: Lane, box: Mailbox | None, error: BaseException, unit: int | None, request: Request[Any] | None
    ) -> None:
        """Log the error of an exchange, and drop the connection if it is of no use after it."""
        is_lost = self._is_lost_by(error, lane.bus, unit, request)
        # Another task may have opened the connection again meanwhile.
        if is_lost and box is not None and lane.box is box:
            self.drop(str(lane.bus.line.broken or box.lost or error))

    def open_box(self, lane: Lane) -> Mailbox | None:
        """Return the lane's mailbox if it is connected in this event loop."""
        box = lane.box
        if box is not None and box.lost is None and box.loop is not asyncio.get_running_loop():
            if box.loop.is_closed():
                return None
            raise PortError("the client is connected in another event loop: close it there, or use a client for each")
        return self.usable_box(lane)

    @staticmethod
    def usable_box(lane: Lane) -> Mailbox | None:
        """Return the lane's mailbox if it is connected. Bytes received since the last request go to the bus first."""
        box = lane.box
        if box is None or box.lost is not None:
            return None
        while box.chunks and (data := box.take()) is not None:
            lane.bus.overhear(data, box.loop.time())
        return box if lane.bus.line.broken is None else None

    async def open(self, lane: Lane, patience: float) -> Mailbox:
        """Return the lane's mailbox. It is connected again if necessary."""
        opening = False
        try:
            try:
                opening = await self._opening.acquire()
                now = asyncio.get_running_loop().time()
                box = self.open_box(lane)
                if box is not None:
                    return box
                self.drop("the connection was given up")
                await asyncio.sleep(self.pause_before_opening(now, patience))
                self._check_not_closed()
                return await self._connect(lane)
            finally:
                if opening:
                    opening = self._end_opening()
        finally:  # as in `_on_lane`
            if opening:
                self._end_opening()

    def _end_opening(self) -> bool:
        """Let the next task open the connection. Returns False. A second call has no effect."""
        if self._opening.locked():
            self._opening.release()
        return False

    def can_open(self, patience: float) -> bool:
        """Return whether the connection is closed and a request could open it again within `patience` seconds."""
        wait = self.back_off.wait(asyncio.get_running_loop().time())
        return self.lanes[0].box is None and not self._closed and wait <= patience

    def new_box(self, lane: Lane) -> Mailbox:
        """Return the mailbox of a lane for a new connection."""
        return Mailbox(self.endpoint.place)

    def writer(self, link: AsyncLink) -> Callable[[bytes], None]:
        """Return the function that sends a request of a connection with several lanes."""
        return link.write_together

    async def _connect(self, lane: Lane) -> Mailbox:
        clock = asyncio.get_running_loop().time
        watch = watch_both(self._watch, self._log.watch())
        datagrams, any_unit = self.endpoint.is_datagram, self.endpoint.flag("any_unit")
        fan = FanOut(len(self.lanes), datagrams=datagrams, any_unit=any_unit) if len(self.lanes) > 1 else None
        lines = [modbus_line(self.endpoint, "client")] if fan is None else fan.lines
        if fan is not None:
            fan.on_stray = self._log.foreign
        # Before the connection: a side that sends at once, with the last bytes of a TLS handshake, is heard.
        boxes = [self.new_box(other) for other in self.lanes]

        def deliver(data: bytes) -> None:
            assert fan is not None
            for place, frame in fan.feed(data):
                boxes[place].put(frame)

        def lose(why: str) -> None:
            if self._link is not None and not self._has_told_lost and boxes[0] is self.lanes[0].box:
                self._has_told_lost = True  # now, and not when the next request finds it lost
                self._lost("" if self._closed else why)
            for box in boxes:
                box.fail(why)

        receive = traced("received", deliver if fan is not None else lambda data: boxes[0].put(data), watch)
        try:
            link = await connect(self.endpoint, receive, lose)
        except PortError as error:
            self._not_opened(error, clock())
            raise
        if self._closed:  # while it was opened
            link.close()
            self._check_not_closed()
        self._link = link
        end_after_fork(self)
        self._opened()
        write = traced("sent", link.write if fan is None else self.writer(link), watch)
        for other, box, line in zip(self.lanes, boxes, lines):
            box.connected(write, link.sent)
            line.sent(clock())  # a client waits for a silence of the line before its first request
            other.bus.continue_on(line)
            other.box = box
        return boxes[self.lanes.index(lane)]

    def drop(self, why: str) -> None:
        """Close a connection that failed: tasks that wait for an answer get a PortError with `why`."""
        link, self._link = self._link, None  # first: `on_lost` may close the client
        if link is not None:
            ended = next((lane.box.lost for lane in self.lanes if lane.box is not None and lane.box.lost), None)
            has_told, self._has_told_lost = self._has_told_lost, False
            try:
                if not has_told:
                    self._lost("" if self._closed else ended or why)
            finally:
                with suppress(RuntimeError):  # the event loop of the connection is closed
                    link.close()
        for lane in self.lanes:
            if lane.box is not None:
                lane.box.fail(why)
                lane.box = None

    def close(self) -> None:
        """Close the connection for good."""
        self._closed = self._closed or "the client was closed"
        self.drop("the client was closed")
        self._log.flush()

    def end_in_child(self) -> None:
        """Refuse further requests in a forked process, and leave the connection to the process that opened it."""
        if self._link is not None:
            self._closed = f"the client was {OPENED_BEFORE_FORK}"
            self._link = None  # not closed: the selector of its event loop is shared with the parent
            for lane in self.lanes:
                lane.box = None
        self._new_queue()


class AsyncModbusClient(ModbusMethods, AsyncioClient):
    """A client on one line or connection, opened by URL. The arguments are those of `ModbusClient`, and:

    in_flight       how many requests may be under way at once, 1 to 16; by default 1

    The constructor opens nothing; `async with` connects. If the client is `lazy`, or is used without `async with`, its
    first request connects.

    Raises EncodeError for a wrong URL or option when it is constructed, PortError when it cannot connect.
    """

    def __init__(
        self,
        url: str,
        *,
        unit: int | None = None,
        timeout: float | None = None,
        in_flight: int = 1,
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
        self.connection = AsyncConnection(endpoint, in_flight, jitter, bus_options(endpoint), watch)
        self.connection.on_lost = on_lost
        self._lazy = lazy

    async def __aenter__(self) -> Self:
        if not self._lazy:
            await self.open()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def connected(self) -> bool:
        """Whether the connection is open, as far as is known."""
        box = self.connection.lanes[0].box
        return box is not None and box.lost is None

    @property
    def bus(self) -> Bus:
        """The state of the line: its counters and its late answers."""
        return self.connection.lanes[0].bus

    async def open(self) -> None:
        """Connect now, if the client is not connected: without the pause that follows failed attempts, and the next
        pause is the first again. PortError if that fails."""
        self.connection.back_off.reset()
        await self.connection.open(self.connection.lanes[0], self.timeout)

    async def close(self) -> None:
        """Close the connection. Requests under way raise PortError."""
        self.connection.close()

    async def run(self, conversation: Conversation[bytes, T], *, unit: int | None = None) -> T:
        """Carry out a conversation of this client's `bus`, with the line to itself, in the queue of `unit`.

        EncodeError with `in_flight` above 1: there are several buses then, see `run_with_bus`.
        """
        if len(self.connection.lanes) > 1:
            raise EncodeError("run: in_flight above 1 means several buses: use run_with_bus(lambda bus: ...)")
        return await self.run_with_bus(lambda bus: conversation, unit=unit)

    async def run_with_bus(self, make: Callable[[Bus], Conversation[bytes, T]], *, unit: int | None = None) -> T:
        """Carry out the conversation that `make` returns for the bus it is given."""
        return await self.connection.run(make, unit, self.timeout)

    async def fetch(self, request: Request[R], take: Callable[[R], T]) -> T:
        """Send a request to the client's unit and return what `take` takes of its response, with its time-out."""
        unit = 1 if self.unit is None else self.unit
        if self.retries:
            return take(await self.ask(request, unit=unit))
        timeout = self.timeout_for(unit) if self._timeouts else self.timeout
        return take(await self.connection.ask(unit, request, timeout, self.timeout))

    async def fetch_all(
        self, unit: int, requests: Sequence[Request[Any]], notes: Sequence[str], take: Callable[[list[Any]], T]
    ) -> T:
        """Send requests in a row and return what `take` takes of all responses. An error gets its request's note."""
        responses = []
        for request, note in zip(requests, notes):
            try:
                if self.retries:
                    responses.append(await self.ask(request, unit=unit))
                else:
                    responses.append(await self.connection.ask(unit, request, self.timeout_for(unit), self.timeout))
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
    ) -> Coroutine[Any, Any, R]:
        """Send a request message and return its response message: as `ModbusClient.ask`."""
        address, limit, repeats = self._ask_arguments(request, unit, timeout, retries)
        if repeats <= 0 or (request.writes and not repeat_writes):
            return self.connection.ask(address, request, limit, self.timeout)

        return self._ask_again(address, request, limit, repeats, repeat_writes)

    async def _ask_again(self, unit: int, request: Request[R], timeout: float, repeats: int, repeat_writes: bool) -> R:
        def asking(bus: Bus) -> Conversation[bytes, R]:
            return bus.ask(unit, request, timeout=timeout, retries=repeats, repeat_writes=repeat_writes)

        while True:
            try:
                return await self.connection.run(asking, unit, self.timeout, request)
            except (PortError, NoAnswer):
                if not repeats or not self.connection.can_open(self.timeout):
                    raise
                repeats -= 1
