"""The protocols of ports: one for each engine, one for connections of asyncio clients; what all ports can use.

`Trace` and `traced` show all items to a function of the caller.
"""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable
from typing import Any, Generic, Literal, NoReturn, Protocol, TypeVar

from barewire.errors import PortError

Item = TypeVar("Item")

Direction = Literal["sent", "received"]
Watch = Callable[[Direction, Any], None]
"""Called with the direction and the item, before it is sent or delivered."""


class Port(Protocol[Item]):
    """A port of the blocking engine: it sends and receives bytes or CAN frames. All methods raise PortError."""

    def send(self, item: Item) -> None:
        """Send an item. Returns when it is on the wire, as far as the system reports."""

    def receive(self, timeout: float) -> Item | None:
        """Return the next item, or None after `timeout` seconds."""

    def close(self) -> None:
        """Close the port."""


class AsyncPort(Protocol[Item]):
    """A port of the asyncio engine. `write` does not wait, so it can be called while a task is cancelled."""

    def write(self, item: Item) -> None:
        """Send an item, without waiting until it is on the wire."""

    def sent(self) -> Awaitable[float | None] | None:
        """Return an awaitable that ends when everything written is on the wire; None if it is already."""

    async def receive(self, timeout: float) -> Item | None:
        """Return the next item, or None after `timeout` seconds."""


class AsyncLink(Protocol):
    """An open connection of an asyncio client. It passes received bytes, and its end, to functions given before."""

    def write(self, item: bytes) -> None:
        """Send bytes, without waiting until they are on the wire."""

    def write_together(self, item: bytes) -> None:
        """Send bytes together with everything else that is written in this round of the loop, where that saves time."""

    def sent(self) -> Awaitable[float | None] | None:
        """Return an awaitable that ends when everything written is on the wire; None if it is already."""

    def close(self) -> None:
        """Close the connection."""


SEND_TIMEOUT = 1.0
"""Seconds that a frame waits for room in the buffer of a CAN controller: a full bus empties the longest one sooner."""
_SEND_RETRY = 0.0005


def send_when_room(try_send: Callable[[], bool], name: str) -> None:
    """Call `try_send` until it returns True: the controller had no room before. PortError after `SEND_TIMEOUT`."""
    until = time.monotonic() + SEND_TIMEOUT
    while time.monotonic() < until:
        time.sleep(_SEND_RETRY)
        if try_send():
            return
    raise no_room(name)


def no_room(name: str) -> PortError:
    """Return the error of a frame that was not sent in time."""
    return PortError(f"{name}: the controller has had no room for a frame for {SEND_TIMEOUT:g} s")


def raise_port_error(port: object, error: OSError) -> NoReturn:
    """Raise the error of a port of the application as PortError, with that error as its cause. The ports of barewire
    raise PortErrors; any other OSError that leaves them is that of a callback, and is raised as it is."""
    if isinstance(error, PortError) or type(port).__module__.startswith("barewire.io."):
        raise error
    name = getattr(port, "name", None) or type(port).__name__
    raise PortError(f"{name}: {error.strerror or error or type(error).__name__}") from error


class Trace(Generic[Item]):
    """A port around a port. It calls `watch(direction, item)` for every item that is sent or received."""

    def __init__(self, port: Port[Item], watch: Watch) -> None:
        self._port = port
        self._watch = watch

    def send(self, item: Item) -> None:
        """Show the item, then send it."""
        self._watch("sent", item)
        self._port.send(item)

    def receive(self, timeout: float) -> Item | None:
        """Receive from the port, and show the item."""
        item = self._port.receive(timeout)
        if item is not None:
            self._watch("received", item)
        return item

    def close(self) -> None:
        """Close the port."""
        self._port.close()


def traced(direction: Direction, pass_on: Callable[[bytes], None], watch: Watch | None) -> Callable[[bytes], None]:
    """Return a function that calls `watch(direction, data)`, if there is a `watch`, and then `pass_on(data)`."""
    if watch is None:
        return pass_on

    def show_and_pass_on(data: bytes) -> None:
        watch(direction, data)
        pass_on(data)

    return show_and_pass_on
