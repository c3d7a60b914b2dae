"""How one definition becomes a method of the blocking and of the asyncio client of a protocol.

    class ModbusMethods:
        @method
        def read_coils(self, address: int, quantity: int) -> Exchange[tuple[bool, ...]]: ...

    client.read_coils(0, 8)            -> (True, ...)       on a client that is a `BlockingRunner`
    await client.read_coils(0, 8)      -> (True, ...)       on a client that is an `AsyncRunner`

A definition does no input or output: it returns an `Operation`, which the client carries out. At run time `method` is
an ordinary decorator that returns an ordinary function. For a type checker its result is a `Method`, whose parameters
are those of the definition (a ParamSpec) and whose result is a value or a coroutine, depending on the client.

Depends on: nothing. Used by: the methods of Modbus clients; usable for those of CANopen clients.
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


class Operation(Generic[V]):
    """Something that a client carries out, with a result of type V. Subclasses say what it is."""

    __slots__ = ()


class BlockingRunner:
    """Base of the clients whose `carry_out(operation)` returns the result."""


class AsyncRunner:
    """Base of the clients whose `carry_out(operation)` returns a coroutine."""


class Method(Protocol[P, V_co]):
    """What a type checker takes a decorated definition for."""

    @overload
    def __get__(self, client: BlockingRunner, kind: type) -> Callable[P, V_co]: ...

    @overload
    def __get__(self, client: AsyncRunner, kind: type) -> Callable[P, Coroutine[Any, Any, V_co]]: ...

    @overload
    def __get__(self, client: None, kind: type) -> Callable[..., Any]: ...


def method(make: Callable[Concatenate[Any, P], Operation[V]]) -> Method[P, V]:
    """The method that passes the operation which `make` returns to the client's `carry_out`."""

    @wraps(make)
    def call(client: Any, *args: P.args, **kwargs: P.kwargs) -> Any:
        return client.carry_out(make(client, *args, **kwargs))

    return cast("Method[P, V]", call)
