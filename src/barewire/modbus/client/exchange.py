"""The turns of talk of a client: ask one unit one thing, or tell all of them.

    client                                       unit
    ------                                       ----
    wait until the line may be spoken on
    request    ------------------------------->
               <-------------------------------  response, or exception response      -> value, or ModbusException
               <-------------------------------  anything else                        -> heard, told, never taken
               .............. time-out .........                                      -> NoAnswer, with what was heard

An answer that fits no part of the question, from another unit, or damaged, does not end the waiting: the standard keeps
the timer running [MB-SERIAL 2.4.1], for the right answer may still come.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

from barewire.modbus.client.bus import Bus

if TYPE_CHECKING:
    from barewire.conversation import Conversation
    from barewire.modbus.framing import Line
    from barewire.modbus.messages.base import Request, Response
R = TypeVar("R", bound="Response")


def ask(line: Line, unit: int, request: Request[R], *, timeout: float = 1.0) -> Conversation[bytes, R]:
    """Ask `unit` once and return its response; nothing is remembered.

    Whoever asks again on the same line takes a `Bus`, which knows which answers may still be late.

    Raises ModbusException when the unit declines, NoAnswer when it is silent.
    """
    return Bus(line).ask(unit, request, timeout=timeout)


def broadcast(line: Line, request: Request[R], *, turnaround: float = 0.1) -> Conversation[bytes, None]:
    """Broadcast to every unit on a serial line, and give them `turnaround` seconds to act."""
    return Bus(line).broadcast(request, turnaround=turnaround)
