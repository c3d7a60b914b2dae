"""A CAN bus in virtual time for the public clients: one SDO server, whose requests or responses are late, in order."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest

from barewire.canopen import CanFrame, SdoServer
from barewire.io.canopen import client
from barewire.io.canopen.bus import async_bus, direct_port, shared_bus, subscriber
from barewire.io.engine import blocking
from tests.canopen.sdo.sdo_bus import Store
from tests.model.virtual_loop import VirtualLoop, VirtualSelector

FRAME_TIME = 0.0001


class Coming(NamedTuple):
    at: float
    data: CanFrame


class NumberedStore(Store):
    """Objects whose value is another one at each read: the low byte of the index, and the number of the read."""

    def __init__(self, length: int) -> None:
        super().__init__()
        self.length = length
        self.reads = 0

    def read(self, index: int, sub: int) -> bytes:
        """Return the next value."""
        self.reads += 1
        return value_of(index, self.reads, self.length)

    def size(self, index: int, sub: int) -> int | None:
        """Return the size of the value."""
        return self.length

    def may_write(self, index: int, sub: int, size: int | None) -> None:
        """Accept any value."""

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Keep the value."""
        self.objects[index, sub] = data


def value_of(index: int, number: int, length: int) -> bytes:
    """A value in which every four bytes name the object and the number of the value."""
    return (bytes((index & 0xFF,)) + number.to_bytes(3, "little")) * (length // 4)


class VirtualCan:
    """The bus. It is the port of a client, and the line of a `VirtualSelector`."""

    name = "virtual time"
    keeps_frames = True  # a blocking client reads by itself
    own_frames = False

    def __init__(self, store: Store, *, holds_requests: bool = False) -> None:
        self.now = 100.0
        self.coming: list[Coming] = []
        self._holds_requests = holds_requests
        self._server = SdoServer(5, store, timeout=60.0)
        self._delayed: Iterator[float] = iter(())
        self._requests: list[Coming] = []
        self._inbox: list[CanFrame] = []
        self._call: Callable[[], object] | None = None
        self._client = threading.current_thread()
        self._gone_on = threading.Event()

    def delay(self, *delays: float) -> None:
        """Delay the next requests or responses by these times."""
        self._delayed = iter(delays)

    def send(self, item: CanFrame) -> None:
        """Take a request. The server processes it at once, or when its delay is over."""
        self._client = threading.current_thread()
        self._gone_on.set()
        self.now += FRAME_TIME
        delay = next(self._delayed, 0.0) if item.data[0] != 0x80 else 0.0
        if self._holds_requests:
            at = max([self.now + delay, *(coming.at for coming in self._requests)])
            self._requests.append(Coming(at, item))
            self.coming.append(Coming(at, CanFrame(0x000, b"")))  # the time of the server has come
        else:
            self._process(item, self.now + delay)
        self.coming.sort(key=lambda coming: coming.at)

    def try_send(self, item: CanFrame) -> bool:
        """Send a frame: there is always room."""
        self.send(item)
        return True

    def _process(self, request: CanFrame, at: float) -> None:
        for response in self._server.feed(request, self.now):
            at = max([at + FRAME_TIME, *(coming.at for coming in self.coming)])
            self.coming.append(Coming(at, response))

    def _arrive(self, frame: CanFrame) -> CanFrame | None:
        """Return a frame that arrived now, None if it was a request for the server."""
        if frame.id:
            return frame
        self._process(self._requests.pop(0).data, self.now)
        self.coming.sort(key=lambda coming: coming.at)
        return None

    def has_frames(self) -> bool:
        """Return whether a frame waits to be read."""
        self._let_arrive()
        return bool(self._inbox)

    def _let_arrive(self) -> None:
        while self.coming and self.coming[0].at <= self.now:
            frame = self._arrive(self.coming.pop(0).data)
            if frame is not None:
                self._inbox.append(frame)

    def receive(self, timeout: float) -> CanFrame | None:
        """Return the next frame, or None after `timeout` seconds of virtual time."""
        if not self.coming and threading.current_thread() is not self._client:
            # The thread of the bus reads. It must not spend the time-out of a client that has not run yet.
            self._gone_on.wait(0.1)
            self._gone_on.set()  # it waits once for each frame
        until = self.now + max(timeout, 0.0)
        self._let_arrive()
        while not self._inbox and self.coming and self.coming[0].at <= until:
            self.now = self.coming[0].at
            self._let_arrive()
        if self._inbox:
            self._gone_on.clear()
            return self._inbox.pop(0)
        self.now = until
        return None

    receive_any = receive

    def notify(self, call: Callable[[], object] | None) -> None:
        """Call a function when a frame has arrived."""
        self._call = call

    def deliver(self) -> CanFrame:
        """Return the next frame that arrives, at the time when it arrives."""
        self.now = max(self.now, self.coming[0].at)
        return self.coming.pop(0).data

    def arrived(self, frame: CanFrame) -> None:
        """Let the event loop read: a frame has arrived."""
        received = self._arrive(frame)
        if received is not None:
            self._inbox.append(received)
            if self._call is not None:
                self._call()

    def close(self) -> None:
        """Let the thread of the bus end at once."""
        self._gone_on.set()

    def set_clocks(self, patch: pytest.MonkeyPatch) -> None:
        """Let barewire use the time of this bus."""
        clock = SimpleNamespace(monotonic=lambda: self.now, time=lambda: self.now)
        for module in (client, direct_port, shared_bus, subscriber, async_bus):
            patch.setattr(module, "time", clock)
        patch.setattr(blocking.run, "__defaults__", (clock.monotonic, None))

    def loop(self) -> VirtualLoop:
        """Return an event loop in the time of this bus."""
        selector = BoundedSelector(self)  # type: ignore[arg-type]
        selector.received = self.arrived  # type: ignore[assignment]
        loop = VirtualLoop(selector)
        loop.set_exception_handler(lambda loop, context: None)  # of callbacks: the loop goes on without their frames
        return loop


class BoundedSelector(VirtualSelector):
    """The selector of a loop that must not wait for ever."""

    def select(self, timeout: float | None = None) -> list[Any]:
        assert timeout is not None or self.line.coming, "every task waits for ever"
        return super().select(timeout)
