"""Makes a blocking and an asyncio method of one definition, for Modbus clients and drives.

    @exchange
    def read_coils(self, address: int, quantity: int) -> Exchange[tuple[bool, ...]]: ...

    client.read_coils(0, 8)            -> (True, ...)       on a `BlockingClient`
    await client.read_coils(0, 8)      -> (True, ...)       on an `AsyncioClient`

A definition does no input or output: it returns a description of the operation, which the client carries out. At run
time `exchange`, `exchanges` and `bus_conversation` are ordinary decorators. For a type checker the result is a
`Method`: its parameters are those of the definition, and its result is a value or a coroutine, depending on the client.

Depends on: the types of messages.  Used by: Modbus clients, drives. `io.canopen.methods` has the decorators of CANopen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, Protocol, TypeVar, cast, overload

if TYPE_CHECKING:
    from collections.abc import Coroutine
    from typing import TypeAlias

    from barewire.conversation import Conversation
    from barewire.modbus.client.bus import Bus
    from barewire.modbus.messages.base import Request

P = ParamSpec("P")
V = TypeVar("V")
V_co = TypeVar("V_co", covariant=True)

if TYPE_CHECKING:
    Exchange: TypeAlias = tuple[Request[Any], Callable[[Any], V]]
    """A request to the client's unit, and the function that makes the result from its response."""
    Exchanges: TypeAlias = tuple[int, Sequence[Request[Any]], Sequence[str], Callable[[list[Any]], V]]
    """A unit, requests to it in a row, a note for the error of each, and the function that makes the result."""
    BusConversation: TypeAlias = tuple[Callable[[Bus], Conversation[bytes, V]], int | None]
    """A function that makes a conversation for a bus, and the unit in whose queue it waits."""


class BlockingClient:
    """The base class of clients whose methods return results."""


class AsyncioClient:
    """The base class of clients whose methods return coroutines."""


class Method(Protocol[P, V_co]):
    """The type of a decorated definition for type checkers."""

    @overload
    def __get__(self, client: BlockingClient, kind: type) -> Callable[P, V_co]: ...

    @overload
    def __get__(self, client: AsyncioClient, kind: type) -> Callable[P, Coroutine[Any, Any, V_co]]: ...

    @overload
    def __get__(self, client: None, kind: type) -> Callable[..., Any]: ...


def exchange(make: Callable[Concatenate[Any, P], Exchange[V]]) -> Method[P, V]:
    """Return the method that passes the request, and the function for its response, to the client's `fetch`."""

    @wraps(make)
    def call(client: Any, *args: P.args, **kwargs: P.kwargs) -> Any:
        return client.fetch(*make(client, *args, **kwargs))

    return cast("Method[P, V]", call)


def exchanges(make: Callable[Concatenate[Any, P], Exchanges[V]]) -> Method[P, V]:
    """Return the method that passes the requests to the client's `fetch_all`."""

    @wraps(make)
    def call(client: Any, *args: P.args, **kwargs: P.kwargs) -> Any:
        return client.fetch_all(*make(client, *args, **kwargs))

    return cast("Method[P, V]", call)


def bus_conversation(make: Callable[Concatenate[Any, P], BusConversation[V]]) -> Method[P, V]:
    """Return the method that passes the conversation to the client's `run_with_bus`."""

    @wraps(make)
    def call(client: Any, *args: P.args, **kwargs: P.kwargs) -> Any:
        conversation, unit = make(client, *args, **kwargs)
        return client.run_with_bus(conversation, unit=unit)

    return cast("Method[P, V]", call)
