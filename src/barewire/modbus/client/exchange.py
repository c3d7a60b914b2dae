"""One exchange of a client: ask one unit, or broadcast to all of them.

    client                                       unit
    ------                                       ----
    wait until the line is idle
    request    ------------------------------->
               <-------------------------------  response, or exception response      -> value, or ModbusException
               <-------------------------------  anything else                        -> noted for the error, ignored
               .............. time-out .........                                      -> NoAnswer, with what was heard

A frame that does not answer the request, comes from another unit or is damaged does not end the waiting: the standard
keeps the timer running [MB-SERIAL 2.4.1], because the right response may still come.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from barewire.conversation import DEFAULT_TIMEOUT
from barewire.modbus.client.bus import Bus

if TYPE_CHECKING:
    from barewire.conversation import Conversation
    from barewire.modbus.framing import Line
    from barewire.modbus.messages.base import R, Request


def ask(line: Line, unit: int, request: Request[R], *, timeout: float = DEFAULT_TIMEOUT) -> Conversation[bytes, R]:
    """Send `request` to `unit` once and return its response; nothing is remembered afterwards.

    For several requests on the same line use a `Bus`, which recognises late responses. `timeout` is in seconds.
    Raises ModbusException for an exception response, NoAnswer when the time is over.
    """
    return Bus(line).ask(unit, request, timeout=timeout)


def broadcast(line: Line, request: Request[R], *, turnaround: float = 0.1) -> Conversation[bytes, None]:
    """Send `request` to every unit on a serial line, then leave them `turnaround` seconds to carry it out."""
    return Bus(line).broadcast(request, turnaround=turnaround)
