"""A drive of CiA 402 that is read and written by name, blocking and asyncio.

    with barewire.connect("csd-mt", "tcp://192.168.1.10") as machine:
        machine.drive.enable()
        machine.drive.move(12_800, relative=True, velocity=20_000)

Each method carries out a conversation of `devices.drive.Drive`:

    Drive.move  --(names to read, values to write)-->  engine  -->  machine.read_all, machine.write
                <------(readings, or an error)-------                one exchange at a time

Between two exchanges another thread or task may read values or stop the drive.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Concatenate, NamedTuple, ParamSpec, Protocol, Self, TypeVar, cast

from barewire.codecs import Value
from barewire.conversation import Conversation, Listen, Send
from barewire.devices.device import Device
from barewire.devices.drive import Drive, DriveProgress, DriveStatus
from barewire.devices.parameter import Reading
from barewire.io.engine import blocking
from barewire.io.engine.methods import CLIENTS, AsyncioClient, BlockingClient, Method, called_on_class, documented

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
    """Reads and writes for the conversations of the drive: sends each request as one item and receives its outcome."""

    def read(self, names: Sequence[str]) -> Conversation[Any, list[Reading]]:
        """Send the names, and return the readings."""
        return self._exchange(tuple(names))

    def write(self, values: Mapping[str, Value]) -> Conversation[Any, None]:
        """Send the values, and wait until they are written."""
        yield from self._exchange(values)

    def wait(self, until: float) -> Conversation[Any, float]:
        """Wait until then, without an exchange; return the time."""
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
    """The port of these conversations. `send` carries a request out, `receive` returns its outcome, or waits."""

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
        """Return the outcome at once; without an exchange, None after `timeout` seconds."""
        outcome, self._outcome = self._outcome, None
        if outcome is None:
            time.sleep(timeout)
        return outcome

    def close(self) -> None:
        """Do nothing: the machine keeps its connection."""


class _AsyncPort:
    """The same with await."""

    def __init__(self, values: AsyncValues) -> None:
        self._values = values
        self._request: Any = None
        self._outcome: _Outcome | None = None

    def write(self, item: Any) -> None:
        """Keep the request; `sent` carries it out."""
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
        """Return the outcome at once; without an exchange, None after `timeout` seconds."""
        from asyncio import sleep

        outcome, self._outcome = self._outcome, None
        if outcome is None:
            await sleep(timeout)
        return outcome


def _action(make: Callable[Concatenate[Drive[Any], P], Conversation[Any, DriveStatus]]) -> Method[P, DriveStatus]:
    """Return the method that carries out a conversation of the client's `Drive`."""

    @functools.wraps(make)
    def method(client: Any, *args: P.args, **kwargs: P.kwargs) -> Any:
        if not isinstance(client, CLIENTS):
            raise called_on_class(make)
        return client.run(make(client.drive, *args, **kwargs))

    return cast("Method[P, DriveStatus]", documented(method, make))


class _DriveMethods:
    """The actions of `Drive`, with its parameters. They raise DriveStuck, and the errors of reading and writing."""

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

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._values!r}>"

    def following(
        self, progress: Callable[[DriveProgress], None] | None, *, timeout: float = 3.0, period: float = 0.02
    ) -> Self:
        """Return the same drive with other settings.

        progress    called with a DriveProgress each time the state of the drive was read
        timeout     seconds that each step may take
        period      seconds between two reads of the state
        """
        return type(self)(self._values, timeout=timeout, period=period, progress=progress)

    status = _action(Drive.status)
    enable = _action(Drive.enable)
    disable = _action(Drive.disable)
    quick_stop = _action(Drive.quick_stop)
    reset = _action(Drive.reset)
    move = _action(Drive.move)
    velocity = _action(Drive.velocity)
    home = _action(Drive.home)


class DriveClient(_DriveMethods, BlockingClient):
    """A CiA 402 drive."""

    def run(self, conversation: Conversation[Any, T]) -> T:
        """Carry out a conversation of `drive`, and return its result."""
        return blocking.run(conversation, _Port(self._values))


class AsyncDriveClient(_DriveMethods, AsyncioClient):
    """A CiA 402 drive, for asyncio."""

    async def run(self, conversation: Conversation[Any, T]) -> T:
        """Carry out a conversation of `drive`, and return its result."""
        from barewire.io.engine import asyncio as engine

        return await engine.run(conversation, _AsyncPort(self._values))
