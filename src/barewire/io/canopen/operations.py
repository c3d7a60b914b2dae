"""The decorators that make a blocking method and a coroutine of one definition.

    class SdoMethods(Methods[R]):
        @operation
        def upload(self, index, ...) -> BusOperation[bytes]: ...

    node.sdo.upload(0x6041)            -> b"7\\x06"       SdoMethods[BlockingBusRunner]
    await node.sdo.upload(0x6041)      -> b"7\\x06"       SdoMethods[AsyncBusRunner]

A definition only returns a description of the operation; the runner (one of the two clients) carries it out:

    decorator        a definition returns   the runner calls, and returns (blocking / asyncio)
    @operation       BusOperation[T]        carry_out   T       / a coroutine of T     a conversation, to its end
                     PlainExchange[T]       carry_out   T       / a coroutine of T     one request and its response
    @subscription    Subscription[E]        subscribe   Stream  / AsyncStream          events, until it is closed
    @background      BackgroundTask         start_task  Running / AsyncRunning         a machine, until it is stopped

At run time each decorator returns a plain method that passes the description to the runner. For type checkers it is a
descriptor: the type of the result depends on the runner.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Generator
from typing import (
    TYPE_CHECKING,
    Any,
    Concatenate,
    Generic,
    NamedTuple,
    ParamSpec,
    Protocol,
    TypeAlias,
    TypeVar,
    overload,
)

from barewire.canopen.channel_locks import LockKeys
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.dialect import SdoDialect
from barewire.canopen.sdo.plain import PlainExchange
from barewire.conversation import Conversation, Send
from barewire.errors import EncodeError, shown
from barewire.io.canopen.bus.node_runner import Running, Speaker
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import Key, Listener, Stream
from barewire.io.endpoint import check_wait
from barewire.io.engine.methods import called_on_class, documented

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from barewire.io.canopen.bus.async_bus import AsyncRunning, AsyncStream

P = ParamSpec("P")
T = TypeVar("T")
E = TypeVar("E")

NO_LOCKS: LockKeys = frozenset()
"""The locks of an operation that does not disturb others."""
NO_FRAMES: frozenset[Key] = frozenset()
"""The identifiers of an operation that receives no frame."""
ERROR_CONTROL: frozenset[Key] = frozenset((0x700 + node, False) for node in range(1, 128))
"""The identifiers of heartbeats, boot-up messages and guarding responses."""


class BusOperation(NamedTuple, Generic[T]):
    """A conversation on a bus.

    locks       the channels that it locks, None for the whole bus
    receives    the (identifier, extended) of the frames that it receives, None for all
    timeout     seconds to wait for a bus that is being opened again, None for the client's
    channel     the SDO channel of a transfer
    """

    conversation: Conversation[CanFrame, T]
    locks: LockKeys | None
    receives: frozenset[Key] | None
    timeout: float | None = None
    channel: Channel | None = None


AnyOperation: TypeAlias = "BusOperation[T] | PlainExchange[T]"
"""An operation: with a conversation, or an exchange that needs one only if something irregular happens."""


class Subscription(NamedTuple, Generic[E]):
    """A machine that turns frames into events, and the identifiers that it receives, None for all."""

    machine: Listener[E]
    receives: frozenset[Key] | None


class BackgroundTask(NamedTuple):
    """A machine that sends frames, and the identifiers that it receives, None for all."""

    machine: Speaker
    receives: frozenset[Key] | None


class BusRunner(Protocol):
    """The part of a client that methods use."""

    timeout: float
    retries: int
    dialect: SdoDialect

    @property
    def bus(self) -> CanBus: ...


class BlockingBusRunner(BusRunner, Protocol):
    """The part of the blocking client that methods use."""

    def carry_out(self, operation: AnyOperation[T], /) -> T: ...
    def subscribe(self, subscription: Subscription[E], /) -> Stream[E]: ...
    def start_task(self, task: BackgroundTask, /) -> Running: ...


class AsyncBusRunner(BusRunner, Protocol):
    """The part of the asyncio client that methods use."""

    async def carry_out(self, operation: AnyOperation[T], /) -> T: ...
    async def open_and_carry_out(self, make: Callable[[], AnyOperation[T]], /) -> T: ...
    def subscribe(self, subscription: Subscription[E], /) -> AsyncStream[E]: ...
    def start_task(self, task: BackgroundTask, /) -> AsyncRunning: ...


R = TypeVar("R", bound=BlockingBusRunner | AsyncBusRunner)


class Methods(Generic[R]):
    """A group of methods on a runner."""

    def __init__(self, runner: R) -> None:
        self.runner = runner

    def __repr__(self) -> str:
        node = getattr(self, "node", 0)
        return f"<{type(self).__name__} of {f'node {node} of ' if node else ''}{self.runner!r}>"


if TYPE_CHECKING:

    class operation(Generic[P, T]):
        """Makes a method of a function that returns an AnyOperation[T]: it returns T, or a coroutine of T."""

        def __init__(self, make: Callable[Concatenate[Any, P], AnyOperation[T]]) -> None: ...

        @overload
        def __get__(self, methods: Methods[BlockingBusRunner], kind: type) -> Callable[P, T]: ...
        @overload
        def __get__(self, methods: Methods[AsyncBusRunner], kind: type) -> Callable[P, Coroutine[Any, Any, T]]: ...
        @overload
        def __get__(self, methods: None, kind: type) -> operation[P, T]: ...
        def __get__(self, methods: Any, kind: type) -> Any: ...

    class subscription(Generic[P, E]):
        """Makes a method of a function that returns a Subscription[E]: it returns a Stream or an AsyncStream."""

        def __init__(self, make: Callable[Concatenate[Any, P], Subscription[E]]) -> None: ...

        @overload
        def __get__(self, methods: Methods[BlockingBusRunner], kind: type) -> Callable[P, Stream[E]]: ...
        @overload
        def __get__(self, methods: Methods[AsyncBusRunner], kind: type) -> Callable[P, AsyncStream[E]]: ...
        @overload
        def __get__(self, methods: None, kind: type) -> subscription[P, E]: ...
        def __get__(self, methods: Any, kind: type) -> Any: ...

    class background(Generic[P]):
        """Makes a method of a function that returns a BackgroundTask: it returns a Running or an AsyncRunning."""

        def __init__(self, make: Callable[Concatenate[Any, P], BackgroundTask]) -> None: ...

        @overload
        def __get__(self, methods: Methods[BlockingBusRunner], kind: type) -> Callable[P, Running]: ...
        @overload
        def __get__(self, methods: Methods[AsyncBusRunner], kind: type) -> Callable[P, AsyncRunning]: ...
        @overload
        def __get__(self, methods: None, kind: type) -> background[P]: ...
        def __get__(self, methods: Any, kind: type) -> Any: ...

else:

    def operation(make):
        """Return the method that passes the operation to the runner."""

        @functools.wraps(make)
        def method(self, *args, **kwargs):
            try:  # quicker than `isinstance`
                runner = self.runner
            except AttributeError:
                raise called_on_class(make) from None
            if kwargs:
                check_wait(kwargs.get("timeout"))
            if runner.is_open:
                return runner.carry_out(make(self, *args, **kwargs))
            return runner.open_and_carry_out(functools.partial(make, self, *args, **kwargs))

        return documented(method, make)

    def subscription(make):
        """Return the method that passes the subscription to the runner."""
        return documented(_passed_on(make, lambda runner: runner.subscribe), make, ("Stream", "AsyncStream"))

    def background(make):
        """Return the method that passes the background task to the runner."""
        return documented(_passed_on(make, lambda runner: runner.start_task), make, ("Running", "AsyncRunning"))

    def _passed_on(make, receiver):
        @functools.wraps(make)
        def method(self, *args, **kwargs):
            if not isinstance(self, Methods):
                raise called_on_class(make)
            return receiver(self.runner)(make(self, *args, **kwargs))

        return method


def send_frame(frame: CanFrame) -> BusOperation[None]:
    """Return the operation that sends one frame. Raises EncodeError for a frame that CAN cannot carry."""
    if not isinstance(frame, CanFrame):
        raise EncodeError(f"{shown(frame)}: expected a CanFrame, such as CanFrame.parse('185#0000')")
    CanFrame.checked(frame.id, frame.data, extended=frame.extended, remote=frame.remote, requested=frame.requested)
    return BusOperation(_send(frame), NO_LOCKS, NO_FRAMES)


def checked_conversation(conversation: Conversation[CanFrame, T]) -> Conversation[CanFrame, T]:
    """Return the conversation. Raises EncodeError for any other object."""
    if not isinstance(conversation, Generator):
        raise EncodeError(f"{shown(conversation)}: expected a conversation, such as upload(5, 0x1000)")
    return conversation


def checked_listener(machine: Listener[E]) -> Listener[E]:
    """Return the machine. Raises EncodeError for an object that cannot listen on a bus."""
    if isinstance(machine, type) or not (hasattr(machine, "feed") and hasattr(machine, "deadline")):
        raise EncodeError(f"{shown(machine)}: expected a machine with feed and deadline")
    return machine


def _send(frame: CanFrame) -> Conversation[CanFrame, None]:
    yield Send(frame)


def sdo_keys(channel: Channel) -> tuple[LockKeys, frozenset[Key]]:
    """Return what a transfer on this channel locks, and the (identifier, extended) of the frames that it receives."""
    key = channel.response_id, channel.response_extended
    receives = {key}
    if not channel.own_frames:
        receives.add((channel.request_id, channel.request_extended))  # a request of another client; see `Channel`
    return frozenset({("SDO", *key)}), frozenset(receives)


def sdo_transfer(channel: Channel, conversation: Conversation[CanFrame, T], timeout: float) -> BusOperation[T]:
    """Return the operation that carries out a conversation on one SDO channel, and locks that channel."""
    return BusOperation(conversation, *sdo_keys(channel), timeout, channel)


def whole_transfer(plain: PlainExchange[T]) -> BusOperation[T]:
    """Return the same transfer as an operation with a conversation."""
    return sdo_transfer(plain.channel, plain.whole(), plain.timeout)
