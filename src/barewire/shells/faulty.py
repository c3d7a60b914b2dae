"""Faults on real ports: around the port of a serial line or a bus, and inside the server of a network.

serial, CAN                            host -- FaultyPort -- port        the host's own port, spoiled
tcp, tls, udp, rtu+tcp, ascii+tcp      server -- spoiler -- connection   each answer, before TLS encrypts it
"""

from __future__ import annotations

import asyncio
import heapq
import time
from collections.abc import Callable, Mapping
from itertools import count
from random import Random
from typing import Generic, TypeVar

from barewire.shells.aio_port_servers import Spoil
from barewire.shells.blocking import Clock, Port
from barewire.shells.endpoint import Endpoint
from barewire.shells.faults import LATE, Bytes, Faults, Frames
from barewire.shells.host import CanHost, Host, NetworkHost, SerialHost

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


def spoiler(faults: Faults[bytes]) -> Spoil:
    """The same for a server of asyncio: inside TLS, behind the framing, once for each answer of each connection."""

    waiting: list[tuple[float, int, Callable[[bytes], None], bytes]] = []
    order = count()

    def spoil(answer: bytes, say: Callable[[bytes], None]) -> None:
        loop = asyncio.get_running_loop()
        for at, what in faults.pass_on(answer, loop.time()):
            heapq.heappush(waiting, (at, next(order), say, what))
            loop.call_at(at, deliver)
        deliver()

    def deliver() -> None:
        # What is due, in the order in which it was said: the timers of a loop have none among equals.
        now = asyncio.get_running_loop().time()
        while waiting and waiting[0][0] <= now:
            _, _, say, what = heapq.heappop(waiting)
            say(what)

    return spoil


def open_faulty(
    url: str,
    open_inner: Callable[[str], Host],
    faults: Mapping[str, float],
    *,
    seed: int | None = None,
    late: float = LATE,
    told: Callable[[str], None] | None = None,
) -> Host:
    """The host that `open_inner(url)` gives, spoiled. Raises EncodeError for a fault that this wire does not have."""
    endpoint, dice = Endpoint.parse(url), Random(seed)
    if endpoint.scheme == "can":
        on_bus = Faults(Frames(), faults, dice, late=late, told=told)
        host = open_inner(url)
        assert isinstance(host, CanHost)
        dial = host.dial
        host.port, host.dial = FaultyPort(host.port, on_bus), lambda: FaultyPort(dial(), on_bus)
        return host
    on_line = Faults(Bytes(endpoint.envelope, datagrams=endpoint.scheme == "udp"), faults, dice, late=late, told=told)
    host = open_inner(url)
    if isinstance(host, NetworkHost):
        host.server.spoil = spoiler(on_line)
    else:
        assert isinstance(host, SerialHost)
        host.port = FaultyPort(host.port, on_line)
    return host
