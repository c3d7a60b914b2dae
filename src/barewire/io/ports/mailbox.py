"""The mailbox of an asyncio connection holds received bytes until a conversation takes them.

    connection --put--> | chunk | chunk | --receive--> conversation

If the task that waits is cancelled, no bytes are lost: the next task receives them.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable

from barewire.errors import PortError

_LIMIT = 0x10000
"""Bytes that a mailbox holds at most: 250 of the longest frames."""


class Mailbox:
    """An `AsyncPort` over a connection, which calls `put` with received bytes, and `fail` when it ends.

    It receives from the first byte on, and sends after `connected`.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.lost: str | None = None
        """Why the connection ended, or None."""
        self.chunks: deque[bytes] = deque()
        """The bytes that were received and not taken yet."""
        self._waiting = 0
        self._waiter: asyncio.Future[bytes | None] | None = None
        self._until = 0.0  # when the waiter gives up
        self._timer: asyncio.TimerHandle | None = None
        self.loop = asyncio.get_running_loop()

    def connected(
        self, write: Callable[[bytes], None], sent: Callable[[], Awaitable[float | None] | None] = lambda: None
    ) -> None:
        """Send with `write` from now on; `sent` returns an awaitable that ends when bytes are on the wire, or None."""
        self._write = write
        self.sent = sent

    def put(self, data: bytes) -> None:
        """Add received bytes. The connection ends if they are far more than are taken, so that memory is limited."""
        waiter = self._waiter
        if waiter is not None and not self.chunks and not waiter.done():
            waiter.set_result(data)
            return
        if self.lost is not None:
            return
        self._waiting += len(data)
        if self._waiting > _LIMIT:
            self.chunks.clear()
            self.fail(f"more than {_LIMIT} bytes arrived that were not requested")
            return
        self.chunks.append(data)
        self._wake()

    def fail(self, why: str) -> None:
        """Record the end of the connection: `receive` raises PortError after the bytes received before."""
        self.lost = self.lost or why
        self._wake()
        self._disarm()

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def _arm(self, until: float) -> None:
        """Set the timer of the task that waits. A timer that ends earlier stays, and is set again when it ends, so that
        it is not cancelled and set for each of a thousand requests that are answered in time."""
        self._until = until
        # One whose time is over was interrupted as it ended, and will not end again.
        if self._timer is None or not self.loop.time() < self._timer.when() <= until:
            self._disarm()
            self._timer = self.loop.call_at(until, self._time_out)

    def _disarm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _time_out(self) -> None:
        self._timer = None
        if self._waiter is None:
            return
        if self.loop.time() >= self._until:
            self._wake()
        else:
            self._arm(self._until)

    def write(self, item: bytes) -> None:
        """Send bytes. Raises PortError if the connection has ended."""
        if self.lost is not None:
            raise PortError(f"{self.name}: {self.lost}")
        self._write(item)

    def take(self) -> bytes | None:
        """Return bytes that were received already, or None. Raises PortError if there are none and the connection has
        ended."""
        if self.chunks:
            taken = self.chunks.popleft()
            self._waiting -= len(taken)
            return taken
        if self.lost is not None:
            raise PortError(f"{self.name}: {self.lost}")
        return None

    async def receive(self, timeout: float) -> bytes | None:
        """Return received bytes, or None after `timeout` seconds. Raises PortError if the connection has ended."""
        for _ in range(2 if timeout <= 0 and not self.chunks else 0):
            await asyncio.sleep(0)  # the first round lets the loop read its ports, the second delivers
        if self.chunks or self.lost is not None or timeout <= 0:
            return self.take()
        waiter = self._waiter = self.loop.create_future()
        self._arm(self.loop.time() + timeout)
        try:
            data = await waiter
        except asyncio.CancelledError:
            if waiter.done() and not waiter.cancelled() and (given := waiter.result()) is not None:
                self.chunks.appendleft(given)  # for the next task: this one was cancelled when the bytes arrived
                self._waiting += len(given)
            raise
        finally:
            self._waiter = None
        return self.take() if data is None else data
