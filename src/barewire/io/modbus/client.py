"""The blocking Modbus client.

    with ModbusClient("tcp://127.0.0.1:1502", unit=1) as client:
        client.read_holding_registers(0, 2)                  the names of the standard, see `methods`
        client.ask(ReadHoldingRegisters(0, 2)).registers     any request message

A client may be used from several threads. There is one exchange at a time on the line, and the units take turns. After
a connection has failed, the next request opens it again (`connection`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self, TypeVar

from barewire.errors import BarewireError, NoAnswer, PortError
from barewire.io.endpoint import check_timeout
from barewire.io.engine.backoff import random_fraction
from barewire.io.engine.methods import BlockingClient
from barewire.io.modbus.carriers import back_off, bus_options, dialer, modbus_line
from barewire.io.modbus.client_log import ClientLog
from barewire.io.modbus.connection import Connection
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


class ModbusClient(ModbusMethods, BlockingClient):
    """A client on one line or connection, opened by URL (`barewire.io.endpoint` lists the forms).

    unit            0..255, the unit that methods address; by default the device's own, or 1
    timeout         seconds that a request waits for its response; by default 1
    gaps            by unit, the pause in seconds that a slow unit needs between two exchanges; by default `gap`
    watch           called as watch("sent" or "received", data) with all bytes
    set_direction   called as set_direction(sending) to set the direction of a two-wire line, for example by a GPIO pin
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
        gaps: Mapping[int, float] | None = None,
        watch: Watch | None = None,
        set_direction: SetDirection | None = None,
        lazy: bool = False,
        jitter: Callable[[], float] = random_fraction,
        **options: Unpack[ModbusOptions],
    ) -> None:
        endpoint = self._configure(url, set_direction, {"unit": unit, "timeout": timeout, **options})
        self.connection = Connection(
            dialer(endpoint),
            lambda: modbus_line(endpoint, "client"),
            back_off(endpoint, jitter),
            bus_options(endpoint, gaps),
            ClientLog(endpoint),
            watch,
        )
        if not lazy:
            self.connection.open(self.timeout)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def bus(self) -> Bus:
        """The state of the line: its counters and its late answers."""
        return self.connection.bus

    def open(self) -> None:
        """Connect now, if the client is not connected: without the pause that follows failed attempts, and the next
        pause is the first again. PortError if that fails."""
        self.connection.open_now(self.timeout)

    def close(self) -> None:
        """Close the connection."""
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
        return take(self.connection.ask(unit, request, self.timeout, self.timeout))

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
                    responses.append(self.connection.ask(unit, request, self.timeout, self.timeout))
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
        checked_request(request)
        limit = self.timeout
        if timeout is not None:
            check_timeout(timeout)
            limit = timeout
        address = self.unit_for(unit)
        repeats = self.retries if retries is None else retries
        connection = self.connection
        if not repeats or (request.writes and not repeat_writes):
            return connection.ask(address, request, limit, self.timeout)
        left = repeats
        while True:
            asking = connection.bus.ask(address, request, timeout=limit, retries=left, repeat_writes=repeat_writes)
            try:
                return connection.run(asking, address, self.timeout)
            except ModbusException as error:
                error.add_place(address, getattr(request, "address", None))
                raise
            except (PortError, NoAnswer):
                if not left or not connection.can_open(self.timeout):
                    raise
                left -= 1
