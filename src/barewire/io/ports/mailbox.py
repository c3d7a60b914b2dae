"""The mailbox of an asyncio connection: received items stay there until a conversation takes them.

    connection --put--> | chunk | chunk | --receive--> conversation

Nothing is lost when the task that waited was cancelled: the next task receives it.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable

from barewire.errors import PortError

_LIMIT = 0x10000
"""Bytes that a mailbox holds at most: 250 of the longest frames."""


class Mailbox:
    """An `AsyncPort` over a connection, which calls `put` with received items, and `fail` when it ends.

    `write` sends bytes; `sent` is what to await until they are on the wire, if that takes time.
    """

    def __init__(
        self,
        name: str,
        write: Callable[[bytes], None],
        sent: Callable[[], Awaitable[float | None] | None] = lambda: None,
    ) -> None:
        self.name = name
        self.lost: str | None = None
        """Why nothing will come any more."""
        self.sent = sent
        self._write = write
        self.chunks: deque[bytes] = deque()
        """The items received and not taken yet."""
        self._waiting = 0
        self._waiter: asyncio.Future[bytes | None] | None = None
        self._until = 0.0  # when the waiter gives up
        self._timer: asyncio.TimerHandle | None = None
        self.loop = asyncio.get_running_loop()

    def put(self, data: bytes) -> None:
        """Bytes came. A peer that sends more than is ever taken loses the connection, so that memory does not fill."""
        waiter = self._waiter
        if waiter is not None and not self.chunks and not waiter.done():
            waiter.set_result(data)
            return
        if self.lost is not None:
            return
        self._waiting += len(data)
        if self._waiting > _LIMIT:
            self.chunks.clear()
            self.fail(f"more than {_LIMIT} bytes came that were not asked for")
            return
        self.chunks.append(data)
        self._wake()

    def fail(self, why: str) -> None:
        """The connection ended: `receive` raises this after the items received before."""
        self.lost = self.lost or why
        self._wake()
        self._disarm()

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def _arm(self, until: float) -> None:
        """A task waits until then at most. A timer that ends earlier is set again when it ends, so that it need not be
        cancelled and set again for each of a thousand requests that are answered in time."""
        self._until = until
        if self._timer is None or self._timer.when() > until:
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
        """Hand the bytes over; PortError if the connection has ended."""
        if self.lost is not None:
            raise PortError(f"{self.name}: {self.lost}")
        self._write(item)

    def take(self) -> bytes | None:
        """An item received already, or None. PortError if none is left and the connection has ended."""
        if self.chunks:
            taken = self.chunks.popleft()
            self._waiting -= len(taken)
            return taken
        if self.lost is not None:
            raise PortError(f"{self.name}: {self.lost}")
        return None

    async def receive(self, timeout: float) -> bytes | None:
        """The item received within `timeout` seconds, or None. PortError if the connection has ended."""
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
                self.chunks.appendleft(given)  # for the next task: this one was cancelled when it came
                self._waiting += len(given)
            raise
        finally:
            self._waiter = None
        return self.take() if data is None else data
