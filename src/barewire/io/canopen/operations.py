"""How a word of CANopen becomes a method of both clients.

    class SdoVerbs(Words):
        @Verb
        def upload(self, index, ...) -> Talk[bytes]: ...

    client.upload(0x6041)                    -> b"7\\x06"          the blocking client
    await client.upload(0x6041)              -> b"7\\x06"          the asyncio client

A word is written once, as what it says (a conversation of `barewire.canopen`), whom that would disturb (`claims`) and
what it has to hear; that is a `Talk`. Carrying it out is the client's, so `Verb` gives a value on one and a coroutine
on the other. In the same way `Watching` gives a stream, and `Going` something that goes on until it is stopped.
"""

from __future__ import annotations

import copy
import inspect
from collections.abc import Callable, Coroutine, Iterable
from typing import TYPE_CHECKING, Any, Concatenate, Generic, NamedTuple, ParamSpec, Self, TypeAlias, TypeVar, overload
from weakref import WeakSet

from barewire.canopen.bus.channel_locks import LockKeys
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.client.channel import Channel
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.conversation import Conversation, Send
from barewire.errors import EncodeError
from barewire.io.canopen.event_stream import Listener
from barewire.io.canopen.node_runner import Speaker
from barewire.io.canopen.shared_bus import CanBus
from barewire.io.canopen.subscriber import Key, seconds
from barewire.io.ports.base import Port

if TYPE_CHECKING:
    from barewire.canopen.object_dictionary import ObjectDictionary
    from barewire.devices.device import Device
    from barewire.io.canopen.async_bus import AsyncStream
    from barewire.io.canopen.async_client import AsyncCanopenClient
    from barewire.io.canopen.async_node_runner import AsyncRunning
    from barewire.io.canopen.client import CanopenClient
    from barewire.io.canopen.event_stream import Stream
    from barewire.io.canopen.node_runner import Running

P = ParamSpec("P")
T = TypeVar("T")
E = TypeVar("E")

NOBODY: LockKeys = frozenset()
"""The claims of what disturbs nobody."""
SILENCE: frozenset[Key] = frozenset()
"""What a word hears that waits for nothing."""


class Talk(NamedTuple, Generic[T]):
    """A conversation, whom it would disturb, and the identifiers that it has to hear; None is everything."""

    conversation: Conversation[CanFrame, T]
    claims: LockKeys | None
    hears: frozenset[Key] | None


class Watch(NamedTuple, Generic[E]):
    """A machine that listens, and what it has to hear."""

    machine: Listener[E]
    hears: frozenset[Key] | None


class Word:
    """What all words have in common: `help` and `inspect` find the name, the parameters and the text of it."""

    def __init__(self, make: Callable[..., Any]) -> None:
        self.make = make
        self.__doc__ = make.__doc__
        self._signature: inspect.Signature | None = None

    def named(self, said: Callable[..., Any]) -> Callable[..., Any]:
        """The method of a client, as what it stands for."""
        if self._signature is None:
            whole = inspect.signature(self.make)
            kept = [parameter for name, parameter in whole.parameters.items() if name != "self"]
            self._signature = whole.replace(parameters=kept, return_annotation=whole.empty)
        said.__name__ = said.__qualname__ = self.make.__name__
        said.__doc__ = self.__doc__
        said.__signature__ = self._signature  # type: ignore[attr-defined]
        return said


class Verb(Word, Generic[P, T]):
    """A word that comes to an end."""

    def __init__(self, make: Callable[Concatenate[Any, P], Talk[T]]) -> None:
        super().__init__(make)

    @overload
    def __get__(self, client: CanopenClient, kind: type) -> Callable[P, T]: ...

    @overload
    def __get__(self, client: AsyncCanopenClient, kind: type) -> Callable[P, Coroutine[Any, Any, T]]: ...

    @overload
    def __get__(self, client: None, kind: type) -> Verb[P, T]: ...

    def __get__(self, client: Any, kind: type) -> Any:
        if client is None:
            return self

        def said(*args: P.args, **kwargs: P.kwargs) -> Any:
            timeout: Any = kwargs.get("timeout")
            seconds(timeout)
            return client.carry_out(self.make(client, *args, **kwargs))

        return self.named(said)


class Watching(Word, Generic[P, E]):
    """A word that gives a stream of events."""

    def __init__(self, make: Callable[Concatenate[Any, P], Watch[E]]) -> None:
        super().__init__(make)

    @overload
    def __get__(self, client: CanopenClient, kind: type) -> Callable[P, Stream[E]]: ...

    @overload
    def __get__(self, client: AsyncCanopenClient, kind: type) -> Callable[P, AsyncStream[E]]: ...

    @overload
    def __get__(self, client: None, kind: type) -> Watching[P, E]: ...

    def __get__(self, client: Any, kind: type) -> Any:
        if client is None:
            return self

        def said(*args: P.args, **kwargs: P.kwargs) -> Any:
            return client.watch(*self.make(client, *args, **kwargs))

        return self.named(said)


class Going(Word, Generic[P]):
    """A word that gives something that goes on until it is stopped."""

    def __init__(self, make: Callable[Concatenate[Any, P], tuple[Speaker, frozenset[Key] | None]]) -> None:
        super().__init__(make)

    @overload
    def __get__(self, client: CanopenClient, kind: type) -> Callable[P, Running]: ...

    @overload
    def __get__(self, client: AsyncCanopenClient, kind: type) -> Callable[P, AsyncRunning]: ...

    @overload
    def __get__(self, client: None, kind: type) -> Going[P]: ...

    def __get__(self, client: Any, kind: type) -> Any:
        if client is None:
            return self

        def said(*args: P.args, **kwargs: P.kwargs) -> Any:
            return client.keep_going(*self.make(client, *args, **kwargs))

        return self.named(said)


def say(frame: CanFrame) -> Talk[None]:
    """One frame, and that is all. EncodeError if no wire carries it."""
    CanFrame.checked(frame.id, frame.data, extended=frame.extended, remote=frame.remote, requested=frame.requested)
    return Talk(_said(frame), NOBODY, SILENCE)


def _said(frame: CanFrame) -> Conversation[CanFrame, None]:
    yield Send(frame)


def sdo(channel: Channel, conversation: Conversation[CanFrame, T]) -> Talk[T]:
    """A talk over one SDO channel: it alone has it meanwhile."""
    key = channel.answer_id, channel.answer_extended
    return Talk(conversation, frozenset({("SDO", *key)}), frozenset({key}))


def dictionary(objects: object) -> ObjectDictionary:
    """What objects are looked up in, or an EncodeError that tells what was meant."""
    from barewire.canopen.object_dictionary import ObjectDictionary

    if not isinstance(objects, ObjectDictionary):
        raise EncodeError(
            f"{objects!r} is no ObjectDictionary; a described device has its values by `read` and `write`"
        )
    return objects


def described(device: object, names: Iterable[object]) -> None:
    """The same for a description and names: EncodeError where that is something else."""
    from barewire.devices.device import Device

    if not isinstance(device, Device):
        raise EncodeError(f"{device!r} is no description of a device; with a dictionary it is `read_object`")
    for name in names:
        if not isinstance(name, str):
            raise EncodeError(f"{name!r} is no name; by index it is `upload`, or `read_object` with a dictionary")


At: TypeAlias = int | Channel | None
"""Which node: its number, a channel to one of its SDO servers, or None for that of the client."""


def _named_dialect(name: str) -> SdoDialect:
    # Loaded only when needed: a client of the standard's SDO needs nothing of `devices`.
    from barewire.devices.sdo_dialects import sdo_dialect

    return sdo_dialect(name)


class Words:
    """What every family of words stands on: a bus, and which node is meant."""

    def __init__(
        self,
        bus: CanBus | Port[CanFrame],
        *,
        node: int | None = None,
        timeout: float = 1.0,
        dialect: str | SdoDialect = "standard",
    ) -> None:
        if isinstance(dialect, str):
            dialect = STANDARD if dialect == STANDARD.name else _named_dialect(dialect)
        seconds(timeout)
        self.bus = bus if isinstance(bus, CanBus) else CanBus(bus)
        self.owns_bus = self.bus is not bus
        self.node = node
        self.timeout = timeout
        self.dialect = dialect
        self._mine: WeakSet[Any] = WeakSet()  # the streams and whatever else runs for this client

    def __repr__(self) -> str:
        return f"<{type(self).__name__} on {self.bus.name}{'' if self.node is None else f', node {self.node}'}>"

    def at(self, node: int | None = None, timeout: float | None = None) -> Self:
        """The same client, on the same bus, speaking to another node or with another patience."""
        seconds(timeout)
        other = copy.copy(self)
        other.node = self.node if node is None else node
        other.timeout = self.timeout if timeout is None else timeout
        return other

    def channel(self, node: At = None, device: Device | None = None) -> Channel:
        """The SDO channel to a node. Kept on the bus, because a channel remembers what it must not be taken in by: the
        late answer of a lost transfer, whoever began it."""
        if isinstance(node, Channel):
            return node
        return self.bus.channel(self.node_id(node, device), self.dialect)

    def node_id(self, node: At, device: Device | None = None) -> int:
        """The node that is meant: the one given, the client's, the device's own, or 1."""
        if isinstance(node, Channel):
            return node.node
        if node is not None:
            return node
        if self.node is not None:
            return self.node
        return device.canopen.node if device and device.canopen else 1

    def patience(self, timeout: float | None) -> float:
        """The time-out given, or the client's."""
        return self.timeout if timeout is None else timeout
