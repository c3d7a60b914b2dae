"""What a bus remembers: lost questions, late replies, what is known of each unit, and how the line is.

What happened is kept here by being told of (`LineState`). What is done about it, and when a unit may be asked, are the
conversations of `bus`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from barewire.conversation import Heard
from barewire.errors import DecodeError, NoAnswer
from barewire.modbus.adu import Adu
from barewire.modbus.exceptions import ModbusException

if TYPE_CHECKING:
    from barewire.modbus.framing import Line, LineEvent
    from barewire.modbus.messages.base import Request

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


class PendingAnswer(NamedTuple):
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


@dataclass
class UnitState:
    """What is known of one unit."""

    free_at: float = NEVER  # not to be spoken to before: its gap
    silent: int = 0  # questions in a row without an answer
    dead_until: float = NEVER
    unproven: int = 0  # probes in a row without an answer
    listens_only: bool = False  # it was told to, and was silent


@dataclass
class BusCounters:
    """How the line is."""

    asked: int = 0
    answered: int = 0
    lost: int = 0
    late: int = 0
    probes: int = 0
    strays: int = 0
    replies: deque[LateReply] = field(default_factory=lambda: deque(maxlen=KEPT))


class LineState:
    """What a bus knows of its line and of the units on it, kept up to date by being told what happened.

    `line` may be replaced between two questions, when a connection was made anew: what was lost may still come.
    """

    def __init__(
        self,
        line: Line,
        *,
        late_window: float | None,
        gap: float,
        gaps: Mapping[int, float] | None,
        dead_after: int | None,
        dead_longest: float,
    ) -> None:
        self.line = line
        self.late_window = late_window
        self.counters = BusCounters()
        self.pauses = bool(gap or gaps)
        """Whether units are given a pause between two exchanges."""
        self._gap = gap
        self._gaps = gaps or {}
        self._dead_after = dead_after
        self._dead_longest = dead_longest
        self._lost: deque[PendingAnswer] = deque(maxlen=KEPT)
        self._units: dict[int, UnitState] = {}

    @property
    def suspect(self) -> list[tuple[int, Request[Any]]]:
        """The questions whose answers may still come."""
        return [(lost.unit, lost.request) for lost in self._lost]

    def sibling_bus(self, line: Line) -> Self:
        """A bus for another line to the same units: several questions under way on one connection.

        What is known of the units and the counters are shared.
        """
        from copy import copy  # nobody else needs it

        other = copy(self)
        other.line = line
        other._lost = deque(maxlen=KEPT)
        return other

    def overhear(self, data: bytes | None, now: float) -> None:
        """Bytes that came when nobody was asking."""
        self._pass_over(Heard(data, now))

    def answered(self, unit: int, now: float) -> None:
        """The unit answered: everything it was asked before is settled."""
        known = self._units[unit]
        self.counters.answered += 1
        if known.silent or known.unproven:
            known.silent = 0
            known.unproven = 0
            known.dead_until = NEVER
        if self.pauses and (gap := self._gaps.get(unit, self._gap)):
            known.free_at = now + gap
        if self._lost:
            self._forget(unit)

    def _unanswered(self, known: UnitState, now: float) -> None:
        known.silent += 1
        if self._dead_after is not None and known.silent >= self._dead_after:
            known.dead_until = now + min(2.0 ** (known.silent - self._dead_after), self._dead_longest)

    def _lose(self, unit: int, request: Request[Any], now: float, timeout: float) -> None:
        self.counters.lost += 1
        if not self.line.numbered:
            window = 3 * timeout if self.late_window is None else self.late_window
            self._lost.append(PendingAnswer(unit, request, now + window))

    def _forget(self, unit: int) -> None:
        self._lost = deque((lost for lost in self._lost if lost.unit != unit), maxlen=KEPT)

    def _confusable(self, unit: int, request: Request[Any]) -> list[PendingAnswer]:
        """The lost questions whose answers could pass for this one's: the same function is enough, for an exception
        response says no more than that."""
        code = request.function_code
        return [lost for lost in self._lost if lost.unit == unit and lost.request.function_code == code]

    def _pass_over(self, heard: Heard[bytes]) -> float:
        for event in self.line.feed(heard.item, heard.now):
            self._stray(event, heard.now)
        return heard.now

    def _stray(self, event: LineEvent, now: float) -> None:
        """Something that answers nothing we wait for: a late reply if it fits a lost question, weather otherwise."""
        self.counters.strays += 1
        if not isinstance(event, Adu):
            return
        for place, lost in enumerate(self._lost):
            if lost.could_be(event):
                # It answers in the order in which it was asked: what was lost before this will not come any more.
                kept = (other for at, other in enumerate(self._lost) if at > place or other.unit != lost.unit)
                self._lost = deque(kept, maxlen=KEPT)
                self._units[lost.unit].unproven = 0
                self.counters.late += 1
                self.counters.replies.append(LateReply(lost.unit, lost.request, event.pdu, now))
                return


def describe_event(event: LineEvent) -> str:
    """One event in words, for the text of an error."""
    if isinstance(event, Adu):
        number = "" if event.transaction is None else f", transaction {event.transaction}"
        return f"a frame from unit {event.unit}, function {event.pdu[0]:02X}{number}"
    if not event.data:
        return event.text or event.reason
    shown = event.data[:16].hex(" ").upper() + (" ..." if len(event.data) > 16 else "")
    size, text = f"{len(event.data)} byte{'' if len(event.data) == 1 else 's'}", event.text or event.reason
    # "3 bytes, then silence" is not told its number twice.
    return f"{size} {shown}{text.removeprefix(size)}" if text.startswith(f"{size},") else f"{size} {shown}: {text}"


def note(passed_over: list[str], text: str) -> None:
    """Keep the first few: an error is one line, and a babbling line must not fill the memory."""
    if len(passed_over) < 3:
        passed_over.append(text)
    elif len(passed_over) == 3:
        passed_over.append("...")


def unknown(text: str) -> WriteOutcomeUnknown:
    """The error of a write that got no answer."""
    return WriteOutcomeUnknown(f"{text}; whether it was carried out is unknown")
