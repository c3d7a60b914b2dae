"""A drive of CiA 402 that is read and written by name, blocking and asyncio.

    with barewire.connect("csd-mt", "tcp://192.168.1.10") as machine:
        machine.drive.enable()
        machine.drive.move(12_800, relative=True, velocity=20_000)

The methods are the conversations of `devices.drive.Drive`, carried out to their end:

    Drive.move  --(names to read, values to write)-->  engine  -->  machine.read_all, machine.write
                <------(readings, or an error)-------                one exchange at a time

so another thread or task may read values or stop the drive while a movement is under way.

Depends on: anything that reads and writes by name.  Used by: machines of `connect`, nodes of a CANopen client.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Concatenate, Generic, NamedTuple, ParamSpec, Protocol, Self, TypeVar, overload

from barewire.codecs import Value
from barewire.conversation import Conversation, Listen, Send
from barewire.devices.device import Device
from barewire.devices.drive.drive import Drive
from barewire.devices.drive.report import DriveProgress, DriveStatus
from barewire.devices.parameter import Reading
from barewire.io.engine import blocking

if TYPE_CHECKING:
    from collections.abc import Coroutine

P = ParamSpec("P")
T = TypeVar("T")


class BlockingValues(Protocol):
    """Named values of a machine."""

    device: Device

    def read_all(self, names: Iterable[str], /) -> list[Reading]: ...

    def write(self, values: Mapping[str, Value], /) -> None: ...


class AsyncValues(Protocol):
    """Named values of a machine, for asyncio."""

    device: Device

    async def read_all(self, names: Iterable[str], /) -> list[Reading]: ...

    async def write(self, values: Mapping[str, Value], /) -> None: ...


class _Outcome(NamedTuple):
    """The end of one exchange."""

    readings: Sequence[Reading] = ()
    error: Exception | None = None


class _Access:
    """The conversations of the drive: each request goes out as one item, its outcome comes back as one."""

    def read(self, names: Sequence[str]) -> Conversation[Any, list[Reading]]:
        """Send the names."""
        return self._exchange(tuple(names))

    def write(self, values: Mapping[str, Value]) -> Conversation[Any, None]:
        """Send the values."""
        yield from self._exchange(values)

    def wait(self, until: float) -> Conversation[Any, float]:
        """Wait, without an exchange."""
        heard = yield Listen(until)
        return heard.now

    @staticmethod
    def _exchange(request: tuple[str, ...] | Mapping[str, Value]) -> Conversation[Any, list[Reading]]:
        yield Send(request)
        heard = yield Listen(float("inf"))
        outcome: Any = heard.item
        if outcome.error is not None:
            raise outcome.error
        return list(outcome.readings)


class _Port:
    """The port of these conversations: sending a request carries it out, receiving gives its outcome, or waits."""

    def __init__(self, values: BlockingValues) -> None:
        self._values = values
        self._outcome: _Outcome | None = None

    def send(self, item: Any) -> None:
        """Carry the exchange out."""
        try:
            if isinstance(item, tuple):
                self._outcome = _Outcome(self._values.read_all(item))
            else:
                self._values.write(item)
                self._outcome = _Outcome()
        except Exception as error:
            self._outcome = _Outcome(error=error)

    def receive(self, timeout: float) -> _Outcome | None:
        """The outcome at once; without an exchange, None after `timeout` seconds."""
        outcome, self._outcome = self._outcome, None
        if outcome is None:
            time.sleep(timeout)
        return outcome

    def close(self) -> None:
        """Nothing is open."""


class _AsyncPort:
    """The same with await."""

    def __init__(self, values: AsyncValues) -> None:
        self._values = values
        self._request: Any = None
        self._outcome: _Outcome | None = None

    def write(self, item: Any) -> None:
        """Take the request; `sent` carries it out."""
        self._request = item

    async def sent(self) -> None:
        """Carry the exchange out."""
        try:
            if isinstance(self._request, tuple):
                self._outcome = _Outcome(await self._values.read_all(self._request))
            else:
                await self._values.write(self._request)
                self._outcome = _Outcome()
        except Exception as error:
            self._outcome = _Outcome(error=error)

    async def receive(self, timeout: float) -> _Outcome | None:
        """The outcome at once; without an exchange, None after `timeout` seconds."""
        from asyncio import sleep

        outcome, self._outcome = self._outcome, None
        if outcome is None:
            await sleep(timeout)
        return outcome


if TYPE_CHECKING:

    class _action(Generic[P]):
        """A conversation of `Drive` as a method: it returns the last DriveStatus, or a coroutine of it."""

        def __init__(self, make: Callable[Concatenate[Drive[Any], P], Conversation[Any, DriveStatus]]) -> None: ...

        @overload
        def __get__(self, client: DriveClient, kind: type) -> Callable[P, DriveStatus]: ...
        @overload
        def __get__(self, client: AsyncDriveClient, kind: type) -> Callable[P, Coroutine[Any, Any, DriveStatus]]: ...
        @overload
        def __get__(self, client: None, kind: type) -> _action[P]: ...
        def __get__(self, client: Any, kind: type) -> Any: ...

else:

    def _action(make):
        """The method that runs a conversation of the client's `Drive`."""

        @functools.wraps(make)
        def method(self, *args, **kwargs):
            return self.run(make(self.drive, *args, **kwargs))

        return method


class _DriveMethods:
    """What both clients of a drive share: the actions of `Drive`, with its parameters. They raise DriveStuck, and what
    reading and writing raise."""

    def __init__(
        self,
        values: Any,
        *,
        timeout: float = 3.0,
        period: float = 0.02,
        progress: Callable[[DriveProgress], None] | None = None,
    ) -> None:
        self._values = values
        self.drive: Drive[Any] = Drive(_Access(), values.device, timeout=timeout, period=period, progress=progress)

    def following(
        self, progress: Callable[[DriveProgress], None] | None, *, timeout: float = 3.0, period: float = 0.02
    ) -> Self:
        """The same drive, which calls `progress` after every look at it. Each step may take `timeout` seconds, with a
        look every `period` seconds."""
        return type(self)(self._values, timeout=timeout, period=period, progress=progress)

    status = _action(Drive.status)
    enable = _action(Drive.enable)
    disable = _action(Drive.disable)
    quick_stop = _action(Drive.quick_stop)
    reset = _action(Drive.reset)
    move = _action(Drive.move)
    velocity = _action(Drive.velocity)
    home = _action(Drive.home)


class DriveClient(_DriveMethods):
    """A drive: enable it, move it."""

    def run(self, conversation: Conversation[Any, T]) -> T:
        """Carry one of the drive's conversations out."""
        return blocking.run(conversation, _Port(self._values))


class AsyncDriveClient(_DriveMethods):
    """A drive: enable it, move it, with await."""

    async def run(self, conversation: Conversation[Any, T]) -> T:
        """Carry one of the drive's conversations out."""
        from barewire.io.engine import asyncio as engine

        return await engine.run(conversation, _AsyncPort(self._values))
