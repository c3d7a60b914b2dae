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

from collections.abc import Callable, Coroutine, Mapping
from functools import partial
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar

from barewire.conversation import Conversation
from barewire.errors import EncodeError, NoAnswer, PortError
from barewire.io.endpoint import Turn
from barewire.io.engine.backoff import BackOff, dice
from barewire.io.modbus.carriers import bus_options, modbus_endpoint, unit_of
from barewire.io.modbus.connection import AsyncConnection
from barewire.io.modbus.methods import Verbs
from barewire.modbus.client.bus import Bus

if TYPE_CHECKING:
    from barewire.codecs import Value
    from barewire.devices.device import Device
    from barewire.devices.parameter import Reading
    from barewire.modbus.messages.base import Request, Response

R = TypeVar("R", bound="Response")
T = TypeVar("T")


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
        from copy import copy  # nobody else needs it

        other = copy(self)
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
        return self.connection.ask(at, request, limit, self.timeout)

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
        limit = self.timeout
        return take(await self.connection.ask(1 if self.unit is None else self.unit, request, limit, limit))

    async def broadcast(self, request: Request[R], *, turnaround: float = 0.1) -> None:
        """Broadcast to every unit of a serial line; nobody answers."""
        await self.talk(lambda bus: bus.broadcast(request, turnaround=turnaround))

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
    chance: Callable[[], float] = dice,
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
