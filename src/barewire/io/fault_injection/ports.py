"""Faults on real ports: around the port of a serial line or a bus, and inside the server of a network.

serial, CAN                            host -- FaultyPort -- port        the host's own port, spoiled
tcp, tls, udp, rtu+tcp, ascii+tcp      server -- spoiler -- connection   each answer, before TLS encrypts it
"""

from __future__ import annotations

import asyncio
import heapq
import time
from collections.abc import Callable
from itertools import count
from typing import Generic, TypeVar

from barewire.io.engine.blocking import Clock, Port
from barewire.io.fault_injection.faults import Faults

Item = TypeVar("Item")


class FaultyPort(Generic[Item]):
    """What is sent meets the faults. What is to be sent later goes out while somebody listens."""

    def __init__(self, port: Port[Item], faults: Faults[Item], clock: Clock = time.monotonic) -> None:
        self._port, self._faults, self._clock = port, faults, clock
        self._waiting: list[tuple[float, int, Item]] = []
        self._order = count()

    @property
    def due(self) -> float | None:
        """When the next thing is to be sent."""
        return self._waiting[0][0] if self._waiting else None

    def send(self, item: Item) -> None:
        """Now, later, changed or never."""
        for at, what in self._faults.pass_on(item, self._clock()):
            heapq.heappush(self._waiting, (at, next(self._order), what))
        self.deliver()

    def deliver(self) -> None:
        """Send what is due."""
        while self._waiting and self._waiting[0][0] <= self._clock():
            self._port.send(heapq.heappop(self._waiting)[2])

    def receive(self, timeout: float) -> Item | None:
        """As the port behind; what falls due meanwhile is sent."""
        until = self._clock() + timeout
        while True:
            self.deliver()
            wake = until if self.due is None else min(until, self.due)
            item = self._port.receive(max(0.0, wake - self._clock()))
            if item is not None or self._clock() >= until:
                return item

    def close(self) -> None:
        """Close what is behind."""
        self._port.close()


class FaultInjector:
    """The same for the server of a network: inside TLS, behind the framing, once for each answer of each connection.

    What is to be said later is said by `deliver`, which whoever owns this calls when it is `due`.
    """

    def __init__(self, faults: Faults[bytes], clock: Clock = time.monotonic) -> None:
        self._faults, self._clock = faults, clock
        self._waiting: list[tuple[float, int, Callable[[bytes], None], list[tuple[float, bytes]]]] = []
        self._half: dict[Callable[[bytes], None], list[tuple[float, bytes]]] = {}
        """What is left of an answer that was begun, by connection: nothing gets between the bytes of one."""
        self._order = count()

    @property
    def due(self) -> float | None:
        """When the next answer is to be said."""
        return self._waiting[0][0] if self._waiting else None

    def __call__(self, answer: bytes, say: Callable[[bytes], None]) -> None:
        """Now, later, changed or never."""
        if parts := self._faults.pass_on(answer, self._clock()):
            self._wait(parts[0][0], say, parts)
        self.deliver()

    def _wait(self, at: float, say: Callable[[bytes], None], parts: list[tuple[float, bytes]]) -> None:
        heapq.heappush(self._waiting, (at, next(self._order), say, parts))
        self._wake(at)

    def _wake(self, at: float) -> None:
        """Something will be due at this time."""

    def deliver(self) -> None:
        """Say what is due, in the order in which it was said."""
        while self._waiting and self._waiting[0][0] <= self._clock():
            _, _, say, parts = heapq.heappop(self._waiting)
            half = self._half.get(say, parts)
            if half is not parts:
                self._wait(half[0][0], say, parts)
                continue
            _, part = parts.pop(0)
            if parts:
                self._half[say] = parts
                self._wait(parts[0][0], say, parts)
            else:
                self._half.pop(say, None)
            say(part)


class LoopFaultInjector(FaultInjector):
    """In a server of asyncio: its loop, which has the same clock, wakes it."""

    def _wake(self, at: float) -> None:
        # The timers of a loop have no order among equals: what each one says is what is due, and not its own.
        asyncio.get_running_loop().call_at(at, self.deliver)
