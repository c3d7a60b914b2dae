"""Listens in on a live serial line: the port is read and never written to.

    for event in listen(Endpoint.parse("rtu:///dev/ttyUSB0"), stop): ...

An adapter with A and B on the bus, whose transmitter stays unused, is enough.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Protocol

from barewire.conversation import Event
from barewire.errors import EncodeError
from barewire.io.endpoint import Endpoint
from barewire.io.modbus.carriers import dialer, modbus_line
from barewire.modbus.framing import Line
from barewire_workbench.sniffer import WINDOW, Sniffer, SnifferEvent

_POLL = 0.1
"""Seconds between two checks whether to stop."""


class LineListener(Protocol[Event]):
    """A machine that receives the bytes of a line and never sends, such as a `Sniffer`."""

    @property
    def deadline(self) -> float | None:
        """When to feed None if nothing arrived."""

    def feed(self, data: bytes | None, now: float, /) -> list[Event]:
        """Take the bytes that arrived, or None if only time has passed."""

    def end(self, now: float, /) -> list[Event]:
        """End the reception."""


def listen(
    endpoint: Endpoint, stop: threading.Event, *, seconds: float | None = None, window: float = WINDOW
) -> Iterator[SnifferEvent]:
    """Yield the requests and responses on the line, until `stop` is set or `seconds` are over.

    Their times are seconds since 1970. Raises EncodeError for an endpoint that is not a serial line, PortError when the
    port fails.
    """
    return listen_with(endpoint, lambda line: Sniffer(line, window=window), stop, seconds=seconds)


def listen_with(
    endpoint: Endpoint,
    listener_of: Callable[[Line], LineListener[Event]],
    stop: threading.Event,
    *,
    seconds: float | None = None,
) -> Iterator[Event]:
    """Yield the events of a listener on the line, as `listen` does; `listener_of` makes it."""
    if endpoint.framing not in ("rtu", "ascii"):
        text = "listening in needs a line, rtu:// or ascii://; record a network with tcpdump and give the file"
        raise EncodeError(f"endpoint {str(endpoint)!r}: {text}")
    listener = listener_of(modbus_line(endpoint, "listener"))
    port = dialer(endpoint)()
    # The monotonic clock, counted from the time of day at the start.
    start = time.time() - time.monotonic()
    until = float("inf") if seconds is None else time.monotonic() + seconds
    try:
        while not stop.is_set() and (now := time.monotonic()) < until:
            wait = min(_POLL, until - now)
            if (deadline := listener.deadline) is not None:
                wait = min(wait, max(0.0, deadline - start - now))
            data = port.receive(wait)
            yield from listener.feed(data, start + time.monotonic())
        yield from listener.end(start + time.monotonic())
    finally:
        port.close()
