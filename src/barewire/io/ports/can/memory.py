"""A CAN bus inside one process: can://memory/NAME, without hardware, python-can, or threads of its own.

        port A  --send-->  the queue of each other port with this name  --receive-->  port B, port C

For tests and demos. Every port with the same name is on the same bus, which exists while one is open. A frame reaches
all other ports, in the same order everywhere, before `send` returns. No port is read by another process.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from barewire.canopen.frame import CanFrame
from barewire.errors import EncodeError, PortError
from barewire.io.endpoint import CAN_OPTIONS, Endpoint, unknown_option

_ROOM = 4096
"""Frames that a port holds until they are received; further ones are lost, and counted."""

# Reentrant, since `send` holds it while it calls the callback of a receiver, which may send an answer.
_lock = threading.RLock()
_buses: dict[str, list[MemoryPort]] = {}


class MemoryPort:
    """An open port on a bus in memory. `lost` counts frames for which it had no room."""

    keeps_frames = True
    """A limited number of frames is held while nothing reads."""
    own_frames = False
    """`receive` does not return the frames that were sent here."""

    def __init__(self, endpoint: Endpoint) -> None:
        check_memory_options(endpoint)
        self.name = endpoint.place
        self.lost = 0
        self._frames: deque[CanFrame] = deque()
        self._arrived = threading.Condition(threading.Lock())
        self._call: Callable[[], object] | None = None
        self._is_closed = False
        with _lock:
            _buses.setdefault(self.name, []).append(self)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} can://{self.name}>"

    def send(self, item: CanFrame) -> None:
        """Hand the frame to all other ports of the bus. Raises PortError if this port is closed."""
        self._check_open()
        with _lock:  # until the last port has the frame: otherwise two senders could be heard in different orders
            for port in tuple(_buses.get(self.name, ())):  # a copy: a callback may open or close a port
                if port is not self:
                    port._put(item)

    def _put(self, item: CanFrame) -> None:
        with self._arrived:
            if len(self._frames) >= _ROOM:
                self.lost += 1
                return
            self._frames.append(item)
            self._arrived.notify()
            call = self._call
        if call is not None:  # without `_arrived`, because the callback may receive
            call()

    def receive(self, timeout: float) -> CanFrame | None:
        """Return the next frame, or None after `timeout` seconds. Raises PortError if this port is closed."""
        with self._arrived:
            if not self._frames and timeout > 0.0 and not self._is_closed:
                self._arrived.wait(min(timeout, threading.TIMEOUT_MAX))  # which raises for a longer one
            if self._frames:
                return self._frames.popleft()
        self._check_open()
        return None

    receive_any = receive
    """There are no error frames and no CAN FD frames."""

    def notify(self, call: Callable[[], object] | None) -> None:
        """Call a function when frames arrive, in the thread of the sender: an event loop that reads in callbacks."""
        with self._arrived:
            self._call = call
            has_frames = bool(self._frames)
        if call is not None and has_frames:  # they arrived before there was a callback: no further one may ever come
            call()

    def _check_open(self) -> None:
        if self._is_closed:
            raise PortError(f"can://{self.name}: the port was closed")

    def close(self) -> None:
        """Leave the bus."""
        with _lock, suppress(KeyError, ValueError):
            _buses[self.name].remove(self)
            if not _buses[self.name]:
                del _buses[self.name]
        with self._arrived:
            self._is_closed = True
            self._arrived.notify_all()


def check_memory_options(endpoint: Endpoint) -> None:
    """Raise EncodeError for a bus without a name, or for an option that a bus in memory does not have."""
    for option in sorted(endpoint.options.keys() - CAN_OPTIONS):
        raise unknown_option(str(endpoint), option, CAN_OPTIONS)
    if not endpoint.place.partition("/")[2]:
        raise EncodeError(f"endpoint {str(endpoint)!r}: expected can://memory/NAME")
