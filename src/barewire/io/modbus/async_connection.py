"""The connection of an asyncio client: opened when it is needed, dropped when it failed, its lanes taken in turns.

    questions ->  turns  ->  lane 1: bus, mailbox  ->  |
                             lane 2: bus, mailbox  ->  |  one connection
                             ...

A lane is one question under way. There is one on a serial line and up to 16 over TCP, TLS and UDP, where `FanOut` gives
what comes to the lane whose number it bears.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from barewire.conversation import Conversation
from barewire.errors import EncodeError, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.engine.asyncio import AsyncLink, Mailbox, exchange, run
from barewire.io.engine.backoff import BackOff
from barewire.io.modbus.carriers import modbus_line
from barewire.io.ports.async_link import dial
from barewire.modbus.adu import BROADCAST
from barewire.modbus.client.bus import Bus
from barewire.modbus.client.fair_queue import FairQueue, Ticket
from barewire.tcp import FanOut

if TYPE_CHECKING:
    from barewire.io.ports.trace import Watch
    from barewire.modbus.messages.base import Request, Response

R = TypeVar("R", bound="Response")
T = TypeVar("T")


class Lane:
    """One question under way: its bus, and where its answers arrive."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.box: Mailbox | None = None
        self.ticket: Ticket | None = None
        """Of whoever had to stand in the queue for it."""


class AsyncConnection:
    """The connection of a client: opened when it is needed, dropped when it failed; its lanes, taken in turns."""

    def __init__(
        self,
        endpoint: Endpoint,
        in_flight: int,
        back_off: BackOff,
        bus_options: dict[str, Any],
        watch: Watch | None = None,
    ) -> None:
        if not 1 <= in_flight <= 16:
            raise EncodeError(f"in_flight {in_flight}: expected 1..16 questions under way [MB-TCP 4.2.1]", "in_flight")
        bus = Bus(modbus_line(endpoint, "client"), **bus_options)
        if in_flight > 1 and not bus.line.numbered:
            raise EncodeError("in_flight: answers without numbers cannot be told apart, so one at a time", "in_flight")
        self.lanes = [Lane(bus), *(Lane(bus.sibling_bus(bus.line)) for _ in range(in_flight - 1))]
        self.back_off = back_off
        self._endpoint = endpoint
        self._watch = watch
        self._link: AsyncLink | None = None
        self._turns = FairQueue(in_flight)
        self._free = list(self.lanes)
        self._waiters: dict[Ticket, asyncio.Future[None]] = {}
        self._opening = asyncio.Lock()
        self._closed = False

    async def run(self, make: Callable[[Bus], Conversation[bytes, T]], unit: int | None, patience: float) -> T:
        """Carry a conversation out when it is this unit's turn, on a lane that is free."""
        lane = self._enter(unit) or await self._wait(unit)
        box = None
        try:
            box = self._standing(lane) or await self.open(lane, patience)
            return await run(make(lane.bus), box)
        except BaseException as error:
            self._failed(lane, box, error)
            raise
        finally:
            self._leave(lane)

    async def ask(self, unit: int, request: Request[R], timeout: float, patience: float) -> R:
        """`run` of `bus.ask`, without a conversation where none is needed."""
        if unit == BROADCAST and not self.lanes[0].bus.line.numbered:
            return await self.run(lambda bus: bus.ask(unit, request), unit, patience)  # raises: nobody answers
        lane = self._enter(unit) or await self._wait(unit)
        box = None
        try:
            box = self._standing(lane) or await self.open(lane, patience)
            return await exchange(lane.bus, unit, request, timeout, box)
        except BaseException as error:
            self._failed(lane, box, error)
            raise
        finally:
            self._leave(lane)

    def _enter(self, unit: int | None) -> Lane | None:
        """A lane, if one is free and nobody waits."""
        return self._free.pop() if self._turns.enter(unit) else None

    async def _wait(self, unit: int | None) -> Lane:
        """A lane when it is this unit's turn."""
        ticket = self._turns.join(unit)
        waiter = self._waiters[ticket] = asyncio.get_running_loop().create_future()
        try:
            await waiter
        except BaseException:
            self._pass_on(self._turns.leave(ticket))
            raise
        finally:
            del self._waiters[ticket]
        lane = self._free.pop()
        lane.ticket = ticket
        return lane

    def _leave(self, lane: Lane) -> None:
        self._free.append(lane)
        ticket, lane.ticket = lane.ticket, None
        self._pass_on(self._turns.exit() if ticket is None else self._turns.leave(ticket))

    def _pass_on(self, is_somebodys_turn: bool) -> None:
        if is_somebodys_turn:
            for holder in self._turns.holders & self._waiters.keys():
                if not self._waiters[holder].done():
                    self._waiters[holder].set_result(None)

    def _failed(self, lane: Lane, box: Mailbox | None, error: BaseException) -> None:
        failed = isinstance(error, PortError) or isinstance(error.__cause__, PortError)
        if box is not None and lane.box is box and (failed or lane.bus.line.broken):
            self.drop(str(lane.bus.line.broken or box.lost or error))

    def _standing(self, lane: Lane) -> Mailbox | None:
        """The lane's mailbox, if its connection stands. What came when nobody asked is heard first."""
        box = lane.box
        if box is None or box.lost is not None:
            return None
        while box.chunks and (data := box.take()) is not None:
            lane.bus.overhear(data, asyncio.get_running_loop().time())
        return box if lane.bus.line.broken is None else None

    async def open(self, lane: Lane, patience: float) -> Mailbox:
        """The lane's mailbox on a connection that stands, made anew if it has to be."""
        async with self._opening:
            now = asyncio.get_running_loop().time()
            box = self._standing(lane)
            if box is not None:
                return box
            self.drop("the connection was given up")
            if self._closed:
                raise PortError("the client was closed")
            if (wait := self.back_off.wait(now)) > patience:
                raise PortError(f"{self.back_off.why}; tried again in {wait:.1f} s")
            await asyncio.sleep(wait)
            return await self._connect(lane)

    async def _connect(self, lane: Lane) -> Mailbox:
        clock = asyncio.get_running_loop().time
        udp, any_unit = self._endpoint.scheme == "udp", self._endpoint.flag("any_unit")
        fan = FanOut(len(self.lanes), datagrams=udp, any_unit=any_unit) if len(self.lanes) > 1 else None
        lines = [modbus_line(self._endpoint, "client")] if fan is None else fan.lines
        try:
            self._link, boxes = await dial(self._endpoint, fan, self._watch)
        except PortError as error:
            self.back_off.failed(clock(), str(error))
            raise
        self.back_off.worked()
        for each, box, line in zip(self.lanes, boxes, lines):
            each.bus.line, each.box = line, box
            line.sent(clock())  # who opens a line waits for its silence before speaking
        return boxes[self.lanes.index(lane)]

    def drop(self, why: str) -> None:
        """Give up a connection that failed: whoever waits on it is told."""
        if self._link is not None:
            self._link.close()
            self._link = None
        for lane in self.lanes:
            if lane.box is not None:
                lane.box.fail(why)
                lane.box = None

    def close(self) -> None:
        """Give the port back, for good."""
        self._closed = True
        self.drop("the client was closed")
