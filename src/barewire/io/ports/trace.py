"""Shows everything that is sent and received to a function of the caller."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

if TYPE_CHECKING:
    from barewire.io.ports.base import Port

Direction = Literal["sent", "received"]
Watch = Callable[[Direction, Any], None]
"""Called with the direction and the item, before it is sent or delivered."""

Item = TypeVar("Item")


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
