"""A drive of CiA 402 that is read and written by name, blocking and asyncio.

    with barewire.connect("csd-mt", "tcp://192.168.1.10") as machine:
        machine.drive.enable()
        machine.drive.move(12_800, relative=True, velocity=20_000)

Each method carries out a conversation of `devices.drive.Drive`. Between two exchanges another thread or task may read
values or stop the drive:

    Drive.move  --(names to read, values to write, Listen)-->  machine.read_all, machine.write, a pause
                <----------(readings, or the error)----------
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Concatenate, ParamSpec, Self, TypeVar, cast

from barewire.codecs import Value
from barewire.conversation import Conversation, Heard, Listen, Send
from barewire.devices.drive import Drive, DriveProgress, DriveStatus
from barewire.devices.parameter import Reading
from barewire.io.engine.methods import CLIENTS, AsyncioClient, BlockingClient, Method, called_on_class, documented

P = ParamSpec("P")
T = TypeVar("T")


class _Access:
    """Reads and writes as items of the drive's conversations: names to read, or values to write."""

    def read(self, names: Sequence[str]) -> Conversation[Any, list[Reading]]:
        """Send the names, and return the readings."""
        readings: Any = (yield Send(tuple(names))).item
        return list(readings)

    def write(self, values: Mapping[str, Value]) -> Conversation[Any, None]:
        """Send the values."""
        yield Send(values)

    def wait(self, until: float) -> Conversation[Any, float]:
        """Wait until then; return the time."""
        heard = yield Listen(until)
        return heard.now


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
        try:
            step = next(conversation)
            while True:
                try:
                    readings = self._carry_out(step)
                except Exception as error:  # what it means for the drive is up to the conversation
                    step = conversation.throw(error)
                else:
                    step = conversation.send(Heard(readings, time.monotonic()))
        except StopIteration as end:
            result: T = end.value
            return result

    def _carry_out(self, step: Any) -> Sequence[Reading]:
        if isinstance(step, Listen):
            time.sleep(max(0.0, step.until - time.monotonic()))
        elif isinstance(step.item, tuple):
            return cast("Sequence[Reading]", self._values.read_all(step.item))
        else:
            self._values.write(step.item)
        return ()


class AsyncDriveClient(_DriveMethods, AsyncioClient):
    """A CiA 402 drive, for asyncio."""

    async def run(self, conversation: Conversation[Any, T]) -> T:
        """Carry out a conversation of `drive`, and return its result."""
        try:
            step = next(conversation)
            while True:
                try:
                    readings = await self._carry_out(step)
                except Exception as error:
                    step = conversation.throw(error)
                else:
                    step = conversation.send(Heard(readings, time.monotonic()))
        except StopIteration as end:
            result: T = end.value
            return result

    async def _carry_out(self, step: Any) -> Sequence[Reading]:
        if isinstance(step, Listen):
            from asyncio import sleep  # blocking clients do not load asyncio

            await sleep(max(0.0, step.until - time.monotonic()))
        elif isinstance(step.item, tuple):
            return cast("Sequence[Reading]", await self._values.read_all(step.item))
        else:
            await self._values.write(step.item)
        return ()
