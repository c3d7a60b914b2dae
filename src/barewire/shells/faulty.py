"""Faults on real ports: a port around a port for serial lines and CAN, a relay in front of a TCP server.

serial, CAN     host -- FaultyPort -- port                            the host's own port, spoiled
TCP             server on 127.0.0.1 <---> Relay <---> client          requests pass, answers meet `Faults`
"""

from __future__ import annotations

import contextlib
import heapq
import select
import socket
import threading
import time
from collections.abc import Callable, Mapping
from itertools import count
from random import Random
from typing import Generic, TypeVar

from barewire.errors import DecodeError, EncodeError, PortError
from barewire.shells.blocking import Clock, Port
from barewire.shells.endpoint import Endpoint
from barewire.shells.faults import LATE, Bytes, Faults, Frames
from barewire.shells.host import CanHost, Host, SerialHost
from barewire.shells.tcp_socket import CHUNK, reason
from barewire.tcp.frame import check_header

Item = TypeVar("Item")

_LOOK = 0.1
_HEADER = 6


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


class _Answers:
    """The way back to a client, as a port."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection

    def send(self, item: bytes) -> None:
        """Hand the bytes to the system."""
        self._connection.sendall(item)

    def receive(self, timeout: float) -> None:
        """Requests do not come this way."""

    def close(self) -> None:
        """Hang up."""
        self._connection.close()


class Relay(Host):
    """A TCP server whose answers come from another one, spoiled. It closes that one when it ends."""

    def __init__(self, endpoint: Endpoint, inner: Host, faults: Faults[bytes]) -> None:
        super().__init__()
        self._inner, self._faults = inner, faults
        host, port = endpoint.host_and_port
        try:
            self._listener = socket.create_server((host, port), family=_family(host))
        except OSError as error:
            raise PortError(f"{host}:{port}: {reason(error)}") from None
        shown = f"[{host}]" if ":" in host else host
        self.url = str(endpoint._replace(place=f"{shown}:{self._listener.getsockname()[1]}"))

    def run(self, stop: threading.Event) -> None:
        """Relay until `stop` is set, each connection in a thread."""
        with self._inner, self._listener:
            self._listener.settimeout(_LOOK)
            while not stop.is_set():
                with contextlib.suppress(TimeoutError):
                    connection, _ = self._listener.accept()
                    threading.Thread(target=self._relay, args=(connection, stop), daemon=True).start()

    def _relay(self, client: socket.socket, stop: threading.Event) -> None:
        answers = FaultyPort(_Answers(client), self._faults)
        held = b""
        where = Endpoint.parse(self._inner.url).host_and_port
        with client, contextlib.suppress(OSError), socket.create_connection(where) as server:
            while not stop.is_set():
                wait = _LOOK if answers.due is None else max(0.0, min(_LOOK, answers.due - time.monotonic()))
                for ready in select.select([client, server], [], [], wait)[0]:
                    data = ready.recv(CHUNK)
                    if not data:
                        return
                    if ready is client:
                        server.sendall(data)
                        continue
                    frames, held = _frames(held + data)
                    for frame in frames:
                        answers.send(frame)
                answers.deliver()


def _frames(data: bytes) -> tuple[list[bytes], bytes]:
    """The whole frames in it, and what is left over."""
    frames: list[bytes] = []
    while len(data) >= _HEADER:
        try:
            length = check_header(data)
        except DecodeError:
            return [*frames, data], b""
        if len(data) < length:
            break
        frames.append(data[:length])
        data = data[length:]
    return frames, data


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET


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
        host.port = FaultyPort(host.port, on_bus)
        return host
    if endpoint.scheme not in ("rtu", "ascii", "tcp"):
        raise EncodeError(f"endpoint {url!r}: faults are for tcp, rtu, ascii and can")
    on_line = Faults(Bytes(endpoint.scheme), faults, dice, late=late, told=told)
    if endpoint.scheme == "tcp":
        return Relay(endpoint, open_inner(str(endpoint._replace(place="127.0.0.1:0"))), on_line)
    host = open_inner(url)
    assert isinstance(host, SerialHost)
    host.port = FaultyPort(host.port, on_line)
    return host
