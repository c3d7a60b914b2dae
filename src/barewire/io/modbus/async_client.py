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

from collections.abc import Callable, Coroutine, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Self, TypeVar

from barewire.errors import BarewireError, EncodeError, NoAnswer, PortError
from barewire.io.endpoint import check_timeout
from barewire.io.engine.backoff import random_fraction
from barewire.io.engine.methods import AsyncioClient
from barewire.io.modbus.async_connection import AsyncConnection
from barewire.io.modbus.carriers import back_off, bus_options
from barewire.io.modbus.methods import ModbusMethods, checked_request
from barewire.modbus.exceptions import ModbusException

if TYPE_CHECKING:
    from typing import Unpack

    from barewire.conversation import Conversation
    from barewire.io.endpoint import SetDirection
    from barewire.io.modbus.carriers import ModbusOptions
    from barewire.io.ports.trace import Watch
    from barewire.modbus.client.bus import Bus
    from barewire.modbus.messages.base import Request, Response

R = TypeVar("R", bound="Response")
T = TypeVar("T")


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
        gaps: Mapping[int, float] | None = None,
        watch: Watch | None = None,
        set_direction: SetDirection | None = None,
        lazy: bool = False,
        jitter: Callable[[], float] = random_fraction,
        **options: Unpack[ModbusOptions],
    ) -> None:
        endpoint = self._configure(url, set_direction, {"unit": unit, "timeout": timeout, **options})
        self.connection = AsyncConnection(
            endpoint, in_flight, back_off(endpoint, jitter), bus_options(endpoint, gaps), watch
        )
        self._lazy = lazy

    async def __aenter__(self) -> Self:
        if not self._lazy:
            await self.open()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

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
        return take(await self.connection.ask(unit, request, self.timeout, self.timeout))

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
                    responses.append(await self.connection.ask(unit, request, self.timeout, self.timeout))
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
        checked_request(request)
        limit = self.timeout
        if timeout is not None:
            check_timeout(timeout)
            limit = timeout
        address = self.unit_for(unit)
        repeats = self.retries if retries is None else retries
        if not repeats or (request.writes and not repeat_writes):
            return self.connection.ask(address, request, limit, self.timeout)

        def asking(bus: Bus, left: int = 0) -> Conversation[bytes, R]:
            return bus.ask(address, request, timeout=limit, retries=left, repeat_writes=repeat_writes)

        return self._ask_again(asking, address, repeats, getattr(request, "address", None))

    async def _ask_again(
        self, asking: Callable[..., Conversation[bytes, R]], unit: int, left: int, address: int | None
    ) -> R:
        while True:
            try:
                return await self.connection.run(partial(asking, left=left), unit, self.timeout)
            except ModbusException as error:
                error.add_place(unit, address)
                raise
            except (PortError, NoAnswer):
                if not left or not self.connection.can_open(self.timeout):
                    raise
                left -= 1
