"""The asyncio Modbus client: the same words as the blocking one, over the same carriers.

    async with await open_async("tcp://127.0.0.1:1502", in_flight=16) as client:
        await client.read_holding_registers(0, 2)
        (await client.ask(ReadHoldingRegisters(0, 2))).registers

Over TCP, TLS and UDP up to 16 questions may be under way at once; their answers come in any order and are told apart by
their numbers. On a serial line it is one at a time, and the units take turns.

A task that is cancelled abandons its conversation. The line stays good: what comes late bears a number that nobody
waits for any more, or is taken care of by the bus.
"""

from __future__ import annotations

import asyncio
import copy
import random
from collections.abc import Callable, Coroutine, Mapping
from functools import partial
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar

from barewire.conversation import Conversation
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.modbus.bus import Bus
from barewire.modbus.message import Request, Response
from barewire.modbus.turns import Ticket, Turns
from barewire.shells.aio import AsyncLink, Mailbox, run
from barewire.shells.aio_dial import dial
from barewire.shells.back_off import BackOff
from barewire.shells.carriers import bus_options, modbus_endpoint, modbus_line, unit_of
from barewire.shells.endpoint import Endpoint, Turn
from barewire.shells.verbs import Verbs
from barewire.tcp import FanOut

if TYPE_CHECKING:
    from barewire.codecs import Value
    from barewire.devices.device import Device
    from barewire.devices.parameter import Reading

R = TypeVar("R", bound=Response)
T = TypeVar("T")


class Lane:
    """One question under way: its bus, and where its answers arrive."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.box: Mailbox | None = None


class AsyncConnection:
    """The connection of a client: opened when it is needed, dropped when it failed; its lanes, taken in turns."""

    def __init__(self, endpoint: Endpoint, in_flight: int, back_off: BackOff, options: dict[str, Any]) -> None:
        if not 1 <= in_flight <= 16:
            raise EncodeError(f"in_flight {in_flight}: expected 1..16 questions under way [MB-TCP 4.2.1]", "in_flight")
        bus = Bus(modbus_line(endpoint, "client"), **options)
        if in_flight > 1 and not bus.line.numbered:
            raise EncodeError("in_flight: answers without numbers cannot be told apart, so one at a time", "in_flight")
        self.lanes = [Lane(bus), *(Lane(bus.beside(bus.line)) for _ in range(in_flight - 1))]
        self.back_off = back_off
        self._endpoint = endpoint
        self._link: AsyncLink | None = None
        self._turns = Turns(in_flight)
        self._free = list(self.lanes)
        self._waiters: dict[Ticket, asyncio.Future[None]] = {}
        self._opening = asyncio.Lock()
        self._closed = False

    async def run(self, make: Callable[[Bus], Conversation[bytes, T]], unit: int | None, patience: float) -> T:
        """Carry a conversation out when it is this unit's turn, on a lane that is free."""
        ticket = self._turns.join(unit)
        try:
            if not self._turns.has(ticket):
                waiter = self._waiters[ticket] = asyncio.get_running_loop().create_future()
                await waiter
            lane = self._free.pop()
            try:
                box = self._standing(lane) or await self.open(lane, patience)
                try:
                    return await run(make(lane.bus), box)
                except BaseException as error:
                    failed = isinstance(error, PortError) or isinstance(error.__cause__, PortError)
                    if lane.box is box and (failed or lane.bus.line.broken):
                        self.drop(str(lane.bus.line.broken or box.lost or error))
                    raise
            finally:
                self._free.append(lane)
        finally:
            if self._waiters:
                self._waiters.pop(ticket, None)
            if self._turns.leave(ticket):
                for holder in self._turns.holders & self._waiters.keys():
                    if not self._waiters[holder].done():
                        self._waiters[holder].set_result(None)

    def _standing(self, lane: Lane) -> Mailbox | None:
        """The lane's mailbox, if its connection stands. What came when nobody asked is heard first."""
        box = lane.box
        if box is None or box.lost is not None:
            return None
        while (data := box.take()) is not None:
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
        fan = _Fan(self._endpoint, len(self.lanes))
        try:
            self._link, boxes = await dial(self._endpoint, len(self.lanes), fan.receive)
        except PortError as error:
            self.back_off.failed(clock(), str(error))
            raise
        self.back_off.worked()
        fan.boxes = boxes
        for each, box, line in zip(self.lanes, boxes, fan.lines):
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


class _Fan:
    """What comes, given to the lanes: all to the only one, or to each its own by number."""

    def __init__(self, endpoint: Endpoint, lanes: int) -> None:
        self.boxes: list[Mailbox] = []
        self._fan: FanOut | None = None
        if lanes > 1:
            self._fan = FanOut(lanes, datagrams=endpoint.scheme == "udp", any_unit=endpoint.flag("any_unit"))
        self.lines = self._fan.lines if self._fan else [modbus_line(endpoint, "client")]

    def receive(self, data: bytes) -> None:
        if self._fan is None:
            self.boxes[0].put(data)
            return
        for place, frame in self._fan.feed(data):
            self.boxes[place].put(frame)


class AsyncModbusClient(Verbs):
    """A client on one line or connection. `unit` and `timeout` (seconds) hold where a call does not say otherwise."""

    def __init__(self, connection: AsyncConnection, *, unit: int | None = None, timeout: float = 1.0) -> None:
        self.connection = connection
        self.unit = unit
        self.timeout = timeout

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        self.close()

    @property
    def bus(self) -> Bus:
        """What is remembered of the line: counters, late replies."""
        return self.connection.lanes[0].bus

    def close(self) -> None:
        """Give the port back."""
        self.connection.close()

    def at(self, unit: int | None = None, timeout: float | None = None) -> Self:
        """The same client, on the same connection, speaking to another unit or with another patience."""
        other = copy.copy(self)
        other.unit = self.unit if unit is None else unit
        other.timeout = self.timeout if timeout is None else timeout
        return other

    async def run(self, conversation: Conversation[bytes, T], *, unit: int | None = None) -> T:
        """Carry any conversation of this client's `bus` out, alone. With several questions under way there are several
        buses: `talk` says which."""
        if len(self.connection.lanes) > 1:
            raise EncodeError("run: with in_flight above 1 there are several buses, so say talk(lambda bus: ...)")
        return await self.talk(lambda bus: conversation, unit=unit)

    async def talk(self, make: Callable[[Bus], Conversation[bytes, T]], *, unit: int | None = None) -> T:
        """Carry out the conversation that `make` returns for the bus it is given. `unit` is in whose queue it waits."""
        return await self.connection.run(make, unit, self.timeout)

    def ask(
        self,
        request: Request[R],
        *,
        unit: int | None = None,
        timeout: float | None = None,
        retries: int = 0,
        repeat_writes: bool = False,
    ) -> Coroutine[Any, Any, R]:
        """Ask and return the response. Raises ModbusException, NoAnswer, PortError; for a write WriteOutcomeUnknown.

        `retries` repeats a read that got no answer, on a new connection if the old one failed.
        """
        at = self._unit(unit)
        limit = self.timeout if timeout is None else timeout

        def asking(bus: Bus, left: int = 0) -> Conversation[bytes, R]:
            return bus.ask(at, request, timeout=limit, retries=left, repeat_writes=repeat_writes)

        if retries and (repeat_writes or not request.writes):
            return self._ask_again(asking, at, retries)
        return self.connection.run(asking, at, self.timeout)

    async def _ask_again(self, asking: Callable[..., Conversation[bytes, R]], unit: int, left: int) -> R:
        while True:
            try:
                return await self.connection.run(partial(asking, left=left), unit, self.timeout)
            except (PortError, NoAnswer):
                if self.connection.lanes[0].box is not None or not left:
                    raise
                left -= 1

    async def fetch(self, request: Request[R], take: Callable[[R], T]) -> T:
        """Ask and take something of the answer: what the verbs do."""
        return take(await self.ask(request))

    async def tell(self, request: Request[R], *, turnaround: float = 0.1) -> None:
        """Broadcast to every unit of a serial line; nobody answers."""
        await self.talk(lambda bus: bus.tell(request, turnaround=turnaround))

    async def read(self, device: Device, *names: str, unit: int | None = None) -> list[Reading]:
        """Named values, with as few requests as the device allows, in the order asked."""
        from barewire.devices.access import read_modbus  # who reads registers only need not load the devices

        at = self._unit(unit, device)
        return await self.talk(lambda bus: read_modbus(bus, at, device, names, timeout=self.timeout), unit=at)

    async def write(
        self, device: Device, values: Mapping[str, Value], *, unit: int | None = None, force: bool = False
    ) -> None:
        """Write named values, in the order given. Ranges and access are checked before anything is sent."""
        from barewire.devices.access import write_modbus

        at = self._unit(unit, device)
        await self.talk(lambda bus: write_modbus(bus, at, device, values, timeout=self.timeout, force=force), unit=at)

    def _unit(self, unit: int | None, device: Device | None = None) -> int:
        if unit is not None:
            return unit
        if self.unit is not None:
            return self.unit
        return device.modbus.unit if device and device.modbus else 1


async def open_async(
    url: str,
    *,
    in_flight: int = 1,
    lazy: bool = False,
    chance: Callable[[], float] = random.random,
    turn: Turn | None = None,
    **options: Any,
) -> AsyncModbusClient:
    """The client for a URL, as `open_modbus`. `in_flight` is how many questions may be under way, 1 to 16."""
    endpoint = modbus_endpoint(url).turned_by(turn)
    unit, timeout = unit_of(endpoint), endpoint.seconds("timeout", 1.0)
    connection = AsyncConnection(endpoint, in_flight, BackOff(chance), bus_options(endpoint) | options)
    if not lazy:
        await connection.open(connection.lanes[0], timeout)
    return AsyncModbusClient(connection, unit=unit, timeout=timeout)


async def open_tcp(host: str, port: int = 502, *, unit: int = 1, timeout: float = 1.0) -> AsyncModbusClient:
    """Connect to a Modbus TCP server. PortError in one line if that fails."""
    shown = f"[{host}]" if ":" in host else host
    return await open_async(f"tcp://{shown}:{port}?unit={unit}&timeout={timeout}")
