"""How one definition becomes a method of the blocking and of the asyncio client of a protocol.

    class ModbusMethods:
        @method
        def read_coils(self, address: int, quantity: int) -> Exchange[tuple[bool, ...]]: ...

    client.read_coils(0, 8)            -> (True, ...)       on a client that is a `BlockingClient`
    await client.read_coils(0, 8)      -> (True, ...)       on a client that is an `AsyncioClient`

A definition does no input or output: it returns a `ClientOperation`, which the client carries out. At run time `method`
is an ordinary decorator that returns an ordinary function. For a type checker its result is a `Method`, whose
parameters are those of the definition (a ParamSpec) and whose result is a value or a coroutine, depending on the
client.

Depends on: nothing. Used by: the methods of Modbus clients (those of CANopen have groups, see `io.canopen.methods`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, Generic, ParamSpec, Protocol, TypeVar, cast, overload

if TYPE_CHECKING:
    from collections.abc import Coroutine

P = ParamSpec("P")
V = TypeVar("V")
V_co = TypeVar("V_co", covariant=True)


class ClientOperation(Generic[V]):
    """Something that a client carries out, with a result of type V. Subclasses say what it is."""

    __slots__ = ()


class BlockingClient:
    """Base of the clients whose `carry_out(operation)` returns the result."""


class AsyncioClient:
    """Base of the clients whose `carry_out(operation)` returns a coroutine."""


class Method(Protocol[P, V_co]):
    """What a type checker takes a decorated definition for."""

    @overload
    def __get__(self, client: BlockingClient, kind: type) -> Callable[P, V_co]: ...

    @overload
    def __get__(self, client: AsyncioClient, kind: type) -> Callable[P, Coroutine[Any, Any, V_co]]: ...

    @overload
    def __get__(self, client: None, kind: type) -> Callable[..., Any]: ...


def method(make: Callable[Concatenate[Any, P], ClientOperation[V]]) -> Method[P, V]:
    """The method that passes the operation which `make` returns to the client's `carry_out`."""

    @wraps(make)
    def call(client: Any, *args: P.args, **kwargs: P.kwargs) -> Any:
        return client.carry_out(make(client, *args, **kwargs))

    return cast("Method[P, V]", call)
