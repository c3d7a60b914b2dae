"""What a port is, for each of the two engines, and for the asyncio client an open connection."""

from __future__ import annotations

from collections.abc import Awaitable
from typing import Protocol, TypeVar

Item = TypeVar("Item")


class Port(Protocol[Item]):
    """What the blocking engine sends and receives through: bytes, or CAN frames. All methods raise PortError."""

    def send(self, item: Item) -> None:
        """Send; returns when the item is on the wire, as far as the system knows."""

    def receive(self, timeout: float) -> Item | None:
        """What came within `timeout` seconds, or None."""

    def close(self) -> None:
        """Close the port."""


class AsyncPort(Protocol[Item]):
    """The same for the asyncio engine. `write` does not wait, so it can be called while a task is cancelled."""

    def write(self, item: Item) -> None:
        """Hand the item over."""

    def sent(self) -> Awaitable[float | None] | None:
        """What to await until everything written is on the wire; None if it is."""

    async def receive(self, timeout: float) -> Item | None:
        """What came within `timeout` seconds, or None."""


class AsyncLink(Protocol):
    """An open connection of an asyncio client. It passes what it receives, and its end, to functions given before."""

    def write(self, item: bytes) -> None:
        """Hand the bytes over."""

    def write_together(self, item: bytes) -> None:
        """Hand the bytes over with everything else that is written in this round of the loop, where that saves time."""

    def sent(self) -> Awaitable[float | None] | None:
        """What to await until everything written is on the wire; None if it is."""

    def close(self) -> None:
        """Close the connection."""
