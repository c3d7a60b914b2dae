"""Makes a blocking and an asyncio method of one definition, for Modbus clients and drives.

    @exchange
    def read_coils(self, address: int, quantity: int) -> Exchange[tuple[bool, ...]]: ...

    client.read_coils(0, 8)            -> (True, ...)       on a `BlockingClient`
    await client.read_coils(0, 8)      -> (True, ...)       on an `AsyncioClient`

A definition does no input or output: it returns a description of the operation, which the client carries out. At run
time `exchange`, `exchanges` and `bus_conversation` are ordinary decorators. For a type checker the result is a
`Method`: its parameters are those of the definition, and its result is a value or a coroutine, depending on the client.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import wraps
from types import FunctionType
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


# A docstring of a method is indented in the source; from 3.13 on, CPython removes that when it compiles.
_INDENT = "" if sys.version_info >= (3, 13) else " " * 8


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


CLIENTS: Any = (BlockingClient, AsyncioClient)


def called_on_class(method: Callable[..., Any]) -> TypeError:
    """Return the error of a method whose first argument is not a client."""
    return TypeError(f"{method.__name__}(): call it on a client, not on the class")


def documented(method: Callable[..., Any], make: Callable[..., Any], streams: tuple[str, str] | None = None) -> Any:
    """Return the method that was made of a definition, after adding its result to what `help` shows.

    The definition returns a description of the result, such as Exchange[int]; `help` shows int. `streams` are the types
    of a result that is not awaited: of the blocking client, and with asyncio.
    """
    kind, _, result = str(make.__annotations__["return"]).partition("[")
    result = result.removesuffix("]") or kind
    if kind == "Conversation":
        result = result.partition(", ")[2]  # after the type of its items
    returns = f"Returns {result}. With asyncio, await it."
    if streams is not None:
        blocking, awaited = (f"{stream}[{result}]" if result != kind else stream for stream in streams)
        result, returns = f"{blocking} | {awaited}", f"Returns {blocking}; with asyncio {awaited}, without await."
    # `help` takes the signature from `__wrapped__`, and a definition may have uses of its own: a copy gets the result.
    while hasattr(make, "__wrapped__"):
        make = make.__wrapped__
    definition = FunctionType(make.__code__, make.__globals__, make.__name__, make.__defaults__, make.__closure__)
    definition.__kwdefaults__ = make.__kwdefaults__
    definition.__annotations__ = method.__annotations__ = {**make.__annotations__, "return": result}
    vars(method)["__wrapped__"] = definition
    if make.__doc__ is not None:  # with -OO there is none
        method.__doc__ = f"{make.__doc__.rstrip()}\n\n{_INDENT}{returns}\n{_INDENT}"
    return method


def exchange(make: Callable[Concatenate[Any, P], Exchange[V]]) -> Method[P, V]:
    """Return the method that passes the request, and the function for its response, to the client's `fetch`."""

    @wraps(make)
    def call(client: Any, *args: P.args, **kwargs: P.kwargs) -> Any:
        try:  # quicker than `isinstance`, and an exchange is the most frequent call
            fetch = client.fetch
        except AttributeError:
            raise called_on_class(make) from None
        return fetch(*make(client, *args, **kwargs))

    return cast("Method[P, V]", documented(call, make))


def exchanges(make: Callable[Concatenate[Any, P], Exchanges[V]]) -> Method[P, V]:
    """Return the method that passes the requests to the client's `fetch_all`."""

    @wraps(make)
    def call(client: Any, *args: P.args, **kwargs: P.kwargs) -> Any:
        if not isinstance(client, CLIENTS):
            raise called_on_class(make)
        return client.fetch_all(*make(client, *args, **kwargs))

    return cast("Method[P, V]", documented(call, make))


def bus_conversation(make: Callable[Concatenate[Any, P], BusConversation[V]]) -> Method[P, V]:
    """Return the method that passes the conversation to the client's `run_with_bus`."""

    @wraps(make)
    def call(client: Any, *args: P.args, **kwargs: P.kwargs) -> Any:
        if not isinstance(client, CLIENTS):
            raise called_on_class(make)
        conversation, unit = make(client, *args, **kwargs)
        return client.run_with_bus(conversation, unit=unit)

    return cast("Method[P, V]", documented(call, make))
