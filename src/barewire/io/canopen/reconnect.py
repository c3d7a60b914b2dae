"""A bus whose port failed: closed, and opened anew after pauses that grow.

        port fails                     all who talk are told by PortError, every stream by Gone(why)
        closed, pause, opened ...      0.125 s, 0.25 s ... 30 s, each a little different (`back_off`)
        one look at it without error   every stream is told by Back(seconds); whoever asks now, talks

What matters on a bus comes unasked, so unlike a Modbus connection it is opened anew without a question. The adapter
that is plugged in again, the interface that is set up again, the server that was restarted: nobody has to do anything
here. A port counts as good when it has lasted for some seconds; one that opens and fails at once does not end the
growth of the pauses.

I know: how to open a port, how long to wait.  I never know: who hears the bus, python-can.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from barewire.canopen.frame import CanFrame
from barewire.io.canopen.subscriber import Item
from barewire.io.engine.backoff import BackOff
from barewire.io.ports.base import Port

Dial = Callable[[], Port[CanFrame]]

LASTED = 5.0
"""Seconds after which a port that was opened has proved itself."""
LOOK = 0.05
"""Seconds of the first look at a port: an interface that is down can be opened, and fails there."""


def taker(port: Port[CanFrame]) -> Callable[[float], Item | None]:
    """How to take what comes from a port, with the reports of the controller if it has them."""
    take: Callable[[float], Item | None] = getattr(port, "receive_any", port.receive)
    return take


class Reopening:
    """The attempts for one bus, made by its reader. `stop` ends them at any time."""

    def __init__(self, dial: Dial, stop: threading.Event, *, chance: Callable[[], float] = random.random) -> None:
        self.back_off = BackOff(chance)
        self.stop = stop
        self._dial = dial
        self._good_from = time.monotonic()

    def reopen(self, port: Port[CanFrame], why: str) -> tuple[Port[CanFrame], Item | None] | None:
        """The new port in place of this one, and what came at the first look; None if it was stopped before."""
        clock, back_off = time.monotonic, self.back_off
        if clock() - self._good_from >= LASTED:
            back_off.worked()
        else:
            back_off.failed(clock(), why)
        while True:
            with suppress(Exception):  # it is broken: whatever it says to that is no news
                port.close()
            if self.stop.wait(back_off.wait(clock())):
                return None
            try:
                port = self._dial()
                first = taker(port)(LOOK)
            except Exception as error:
                back_off.failed(clock(), str(error) or type(error).__name__)
                continue
            self._good_from = clock()
            return port, first
