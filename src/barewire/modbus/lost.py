"""What a bus remembers: lost questions, late replies, what is known of each unit, and how the line is.

Values only; what is done with them stands in `bus`.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from barewire.errors import DecodeError, NoAnswer
from barewire.modbus.adu import Adu
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.line import Event
from barewire.modbus.message import Request

KEPT = 16
"""Late replies kept to be looked at, and lost questions remembered: a line in trouble must not fill the memory."""


NEVER = float("-inf")
"""A time that was always over."""


class WriteOutcomeUnknown(NoAnswer):
    """A write was sent and nobody answered: it may have been carried out, or not. Read back before writing again."""


class LateReply(NamedTuple):
    """An answer that came when nobody waited for it any more. It was not delivered to anybody."""

    unit: int
    request: Request[Any]
    pdu: bytes
    at: float


class Lost(NamedTuple):
    """A question that went out and got no answer, and until when its answer may still come."""

    unit: int
    request: Request[Any]
    until: float

    def could_be(self, adu: Adu) -> bool:
        """Whether this frame is its answer, or an exception that says no to it."""
        if self.unit != adu.unit:
            return False
        try:
            self.request.read_response(adu.pdu)
        except ModbusException:
            return True
        except DecodeError:
            return False
        return True


@dataclass(slots=True)
class Known:
    """What is known of one unit."""

    free_at: float = NEVER  # not to be spoken to before: its gap
    silent: int = 0  # questions in a row without an answer
    dead_until: float = NEVER
    unproven: int = 0  # probes in a row without an answer
    listens_only: bool = False  # it was told to, and was silent


@dataclass(slots=True)
class BusCounters:
    """How the line is."""

    asked: int = 0
    answered: int = 0
    lost: int = 0
    late: int = 0
    probes: int = 0
    strays: int = 0
    replies: deque[LateReply] = field(default_factory=lambda: deque(maxlen=KEPT))


def describe(event: Event) -> str:
    """One event in words, for the text of an error."""
    if isinstance(event, Adu):
        number = "" if event.transaction is None else f", transaction {event.transaction}"
        return f"a frame from unit {event.unit}, function {event.pdu[0]:02X}{number}"
    if not event.data:
        return event.text or event.reason
    shown = event.data[:16].hex(" ").upper() + (" ..." if len(event.data) > 16 else "")
    return f"{len(event.data)} bytes {shown}: {event.text or event.reason}"


def note(passed_over: list[str], text: str) -> None:
    """Keep the first few: an error is one line, and a babbling line must not fill the memory."""
    if len(passed_over) < 3:
        passed_over.append(text)
    elif len(passed_over) == 3:
        passed_over.append("...")
