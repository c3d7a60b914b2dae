"""Middlemen: ports around ports, for watching. What passes is unchanged."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

if TYPE_CHECKING:
    from barewire.io.engine.blocking import Port
Direction = Literal["sent", "received"]
Watch = Callable[[Direction, Any], None]

Item = TypeVar("Item")


class Trace(Generic[Item]):
    """Tells `watch(direction, item)` of everything that passes."""

    def __init__(self, port: Port[Item], watch: Callable[[Direction, Item], None]) -> None:
        self._port = port
        self._watch = watch

    def send(self, item: Item) -> None:
        """Told, then sent."""
        self._watch("sent", item)
        self._port.send(item)

    def receive(self, timeout: float) -> Item | None:
        """Received, then told."""
        item = self._port.receive(timeout)
        if item is not None:
            self._watch("received", item)
        return item

    def close(self) -> None:
        """Close what is behind."""
        self._port.close()
