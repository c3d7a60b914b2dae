"""Puts faults into answers: around the port of a serial line or CAN bus, or inside a server of connections.

serial, CAN                            server -- FaultyPort -- port             the server's own port
tcp, tls, udp, rtu+tcp, ascii+tcp      server -- FaultInjector -- connection    each answer, before TLS encrypts it
"""

from __future__ import annotations

import asyncio
import heapq
import threading
import time
from collections.abc import Callable, Iterator
from itertools import count
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from barewire.io.engine.blocking import Clock
    from barewire.io.fault_injection.faults import Faults
    from barewire.io.ports.base import Port
    from barewire.modbus.server.server import Reply

Item = TypeVar("Item")


class DelayQueue(Generic[Item]):
    """Items to be sent at certain times, in the order of these times."""

    def __init__(self) -> None:
        self._heap: list[tuple[float, int, Item]] = []
        self._order = count()

    @property
    def due(self) -> float | None:
        """When the next item is to be sent."""
        return self._heap[0][0] if self._heap else None

    def put(self, at: float, item: Item) -> None:
        """Add an item that is to be sent at this time."""
        heapq.heappush(self._heap, (at, next(self._order), item))

    def take(self, clock: Clock) -> Iterator[Item]:
        """Yield the items that are due."""
        while self._heap and self._heap[0][0] <= clock():
            yield heapq.heappop(self._heap)[2]


class FaultyPort(Generic[Item]):
    """A port around another port, with faults in the items sent. Late items are sent while it receives."""

    def __init__(self, port: Port[Item], faults: Faults[Item], clock: Clock = time.monotonic) -> None:
        self._port, self._faults, self._clock = port, faults, clock
        self._late: DelayQueue[Item] = DelayQueue()
        self._sending = threading.RLock()  # a node on a bus is received in one thread and may send in another
        self.name: str = getattr(port, "name", "the port")

    def send(self, item: Item) -> None:
        """Send the item now, later, changed or not at all."""
        self.answer(item, b"")

    def answer(self, item: Item, request: bytes) -> None:
        """Send the answer to a request, whose PDU is given, now, later, changed or not at all."""
        with self._sending:
            for at, changed in self._faults.pass_on(item, self._clock(), request):
                self._late.put(at, changed)
        self._deliver()

    def _deliver(self) -> None:
        with self._sending:
            for item in self._late.take(self._clock):
                self._port.send(item)

    def receive(self, timeout: float) -> Item | None:
        """Receive from the inner port; send the items that become due meanwhile."""
        until = self._clock() + timeout
        while True:
            self._deliver()
            due = self._late.due
            wake = until if due is None else min(until, due)
            item = self._port.receive(max(0.0, wake - self._clock()))
            if item is not None or self._clock() >= until:
                return item

    def close(self) -> None:
        """Close the port inside."""
        self._port.close()


SendBytes = Callable[[bytes], None]
"""Sends bytes on one connection."""


class FaultInjector:
    """Puts faults into the answers of a server: inside TLS, outside the framing, for each answer of each connection.

    Its owner calls `deliver` when it is `due`.
    """

    def __init__(self, faults: Faults[bytes], clock: Clock = time.monotonic) -> None:
        self._faults, self._clock = faults, clock
        self._late: DelayQueue[tuple[SendBytes, list[tuple[float, bytes]]]] = DelayQueue()
        self._unfinished: dict[SendBytes, list[tuple[float, bytes]]] = {}
        """By connection, the rest of an answer in parts: no other answer is sent between them."""

    @property
    def due(self) -> float | None:
        """When the next bytes are to be sent."""
        return self._late.due

    def __call__(self, reply: Reply, send: SendBytes) -> None:
        """Send the answer now, later, changed or not at all."""
        if parts := self._faults.pass_on(reply.data, max(reply.at, self._clock()), reply.request):
            self._wait(parts[0][0], send, parts)
        self.deliver()

    def _wait(self, at: float, send: SendBytes, parts: list[tuple[float, bytes]]) -> None:
        self._late.put(at, (send, parts))
        self._wake(at)

    def _wake(self, at: float) -> None:
        """Called with the time at which something will be due."""

    def deliver(self) -> None:
        """Send the items that are due, in order."""
        for send, parts in self._late.take(self._clock):
            unfinished = self._unfinished.get(send, parts)
            if unfinished is not parts:
                self._wait(unfinished[0][0], send, parts)
                continue
            _, part = parts.pop(0)
            if parts:
                self._unfinished[send] = parts
                self._wait(parts[0][0], send, parts)
            else:
                self._unfinished.pop(send, None)
            send(part)


class LoopFaultInjector(FaultInjector):
    """A `FaultInjector` in an asyncio server: the loop, which has the same clock, calls `deliver`."""

    def _wake(self, at: float) -> None:
        # Timers with the same time may run in any order, so each delivers everything that is due, not one item.
        asyncio.get_running_loop().call_at(at, self.deliver)
