"""Listening in on a live CAN bus: the port is read and never written to.

    for at, frame in listen_can(Endpoint.parse("can://socketcand/127.0.0.1:29536/can0"), stop): ...

A CAN controller acknowledges what it hears unless it is told to be silent: on a bus with a single talker that makes a
difference. Interfaces that can only listen have an option for it in python-can.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

from barewire.canopen.frame import AnyFrame
from barewire.io.endpoint import Endpoint

LOOK = 0.1
"""Seconds between two looks at whether to stop, and at whether something is missing."""


def listen_can(
    endpoint: Endpoint, stop: threading.Event, *, seconds: float | None = None
) -> Iterator[tuple[float, AnyFrame | None]]:
    """What comes, and None now and then when nothing does; times are seconds since 1970.

    Raises PortError when the bus is not there, or fails.
    """
    from barewire.io.ports.python_can import CanPort

    port = CanPort(endpoint)
    start = time.time() - time.monotonic()
    until = float("inf") if seconds is None else time.monotonic() + seconds
    try:
        while not stop.is_set() and (now := time.monotonic()) < until:
            frame = port.receive_any(min(LOOK, until - now))
            yield start + time.monotonic(), frame
    finally:
        port.close()
