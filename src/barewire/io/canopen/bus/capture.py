"""Listens in on a live CAN bus: its port is read and never written to.

    for received_at, frame in listen_can(Endpoint.parse("can://socketcand/127.0.0.1:29536/can0"), stop): ...

A CAN controller acknowledges the frames that it receives, unless it is in listen-only mode. That makes a difference on
a bus with a single other node. Interfaces that have this mode have an option for it in python-can.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

from barewire.canopen.frame import AnyFrame
from barewire.io.endpoint import Endpoint

_CHECK_INTERVAL = 0.1
"""Seconds between two checks whether to stop."""


def listen_can(
    endpoint: Endpoint, stop: threading.Event, *, seconds: float | None = None
) -> Iterator[tuple[float, AnyFrame | None]]:
    """Yield the frames with their times, in seconds since 1970; every 0.1 s without a frame a time and None.

    Raises PortError for a bus that cannot be opened, or fails.
    """
    from barewire.io.ports.can.interfaces import can_port

    port = can_port(endpoint, stamps=True)
    start = time.time() - time.monotonic()
    until = float("inf") if seconds is None else time.monotonic() + seconds
    try:
        while not stop.is_set() and (now := time.monotonic()) < until:
            frame = port.receive_any(min(_CHECK_INTERVAL, until - now))
            at = None if frame is None else getattr(port, "received_at", None)
            yield start + time.monotonic() if at is None else at, frame
    finally:
        port.close()
