"""The state of a bus: pending answers, late replies, the state of each unit, and counters.

    request sent, no response      -->  PendingAnswer: its response may still come, until a given time
    a frame that fits one          -->  LateReply: recorded, never delivered
    a response in time             -->  the pending answers of that unit are settled

`LineState` only records. The conversations of `bus` decide when a request may be sent, and how pending answers are
settled.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from barewire.conversation import DEFAULT_TIMEOUT
from barewire.errors import DecodeError, NoAnswer
from barewire.modbus.adu import Adu
from barewire.modbus.exceptions import ModbusException

if TYPE_CHECKING:
    from barewire.modbus.framing import LineEvent
    from barewire.modbus.messages.base import Request

_KEPT = 16
"""How many late replies are kept at most, so that a bad line does not fill the memory."""

_FIRST_PAUSE = 1.0
"""The first time for which a dead unit is not asked, in seconds; each one is twice the one before."""

NEVER = float("-inf")
"""A time that is always in the past."""


class WriteOutcomeUnknown(NoAnswer):
    """A write was sent and not answered: it may or may not have been carried out. Read back before writing again."""


class NotSent(NoAnswer):
    """A request was not sent, because an answer to an earlier one may still come."""


def no_answer(request: Request[Any], text: str) -> NoAnswer:
    """Return the error of a request that was sent and has no response; for a write it is WriteOutcomeUnknown."""
    return WriteOutcomeUnknown(f"{text}; whether it was carried out is unknown") if request.writes else NoAnswer(text)


def note_stray(passed_over: list[str], text: str) -> None:
    """Keep the first three texts: an error is one line, and noise must not fill the memory."""
    if len(passed_over) < 3:
        passed_over.append(text)
    elif len(passed_over) == 3:
        passed_over.append("...")


class LateReply(NamedTuple):
    """A response that came after its request had timed out. It was not delivered."""

    unit: int
    request: Request[Any]
    pdu: bytes
    at: float


class PendingAnswer(NamedTuple):
    """A request that was sent and not answered; its response may still come until `until`."""

    unit: int
    request: Request[Any]
    until: float

    def could_be(self, adu: Adu) -> bool:
        """Whether this frame is the response to the request, or an exception response to it, by its PDU."""
        try:
            self.request.read_response(adu.pdu)
        except ModbusException:
            return True
        except DecodeError:
            return False
        return True


class UnitOptions(NamedTuple):
    """How a unit is asked, by a client and by a gateway. Times are in seconds.

    timeout        how long a request waits for its response
    gap            the pause between two exchanges with the unit
    dead_after     unanswered requests in a row after which the unit is dead: it is not asked for a while; 0: never
    longest_pause  the longest such time: the first is 1 s, and it doubles with each further unanswered request
    """

    timeout: float = DEFAULT_TIMEOUT
    gap: float = 0.0
    dead_after: int = 0
    longest_pause: float = 30.0


class UnitState:
    """The state of one unit."""

    def __init__(self, options: UnitOptions) -> None:
        self.options = options
        self.gap = options.gap
        self.free_at = NEVER  # its pause is over at this time
        self.silent = 0  # requests in a row without a response
        self.dead_until = NEVER
        self.settled = False  # it has answered in time, so no answer to an older request can come
        self.listens_only = False  # Force Listen Only Mode was sent, and not answered

    @property
    def is_dead(self) -> bool:
        """Whether it left so many requests unanswered that it is asked only now and then."""
        return 0 < self.options.dead_after <= self.silent

    def begin_gap(self, now: float) -> None:
        """Begin the pause after an exchange with the unit, if it needs one."""
        if self.gap:
            self.free_at = now + self.gap

    def was_silent(self, now: float) -> None:
        """Count a request without a response. If the unit is dead, it is so for a time that grows."""
        self.begin_gap(now)
        self.silent += 1
        if self.is_dead:
            pause = _FIRST_PAUSE * 2 ** min(self.silent - self.options.dead_after, 32)  # a float ends at 2.0 ** 1023
            self.dead_until = now + min(pause, self.options.longest_pause)


class Units(dict[int, UnitState]):
    """The states of the units by address. That of a unit is made when it is first asked for."""

    def __init__(self, default: UnitOptions, own: Mapping[int, UnitOptions]) -> None:
        super().__init__()
        self.default = default
        self.own = dict(own)
        """The options of single units, before they are first asked."""

    def __missing__(self, unit: int) -> UnitState:
        state = self[unit] = UnitState(self.own.get(unit, self.default))
        return state


class BusCounters:
    """Counters, and the latest late replies. Not a dataclass: a client is loaded without `dataclasses` (4 ms)."""

    def __init__(self) -> None:
        self.asked = 0
        self.answered = 0
        self.lost = 0
        self.late = 0
        self.probes = 0
        self.strays = 0
        self.replies: deque[LateReply] = deque(maxlen=_KEPT)

    def __repr__(self) -> str:
        return f"BusCounters({', '.join(f'{name}={value!r}' for name, value in vars(self).items())})"


class LineState:
    """The state of a bus."""

    def __init__(self, units: Units, *, any_unit: bool) -> None:
        self.counters = BusCounters()
        self.units = units
        self.pending: list[PendingAnswer] = []
        """The requests whose responses may still come, the oldest first."""
        self._any_unit = any_unit  # the unit in a response means nothing, so any pending answer can be it
        self.on_stray: Callable[[LineEvent, PendingAnswer | None], object] | None = None
        """Called with each frame or noise that does not answer the open request, and with the request that it answers
        late, if that is known."""

    def answered(self, unit: int, now: float) -> None:
        """Record that the unit sent a response in time, which settles every earlier request to it."""
        unit_state = self.units[unit]
        unit_state.settled = True
        if unit_state.silent:
            unit_state.silent = 0
            unit_state.dead_until = NEVER
        unit_state.listens_only = False
        if unit_state.gap:
            unit_state.begin_gap(now)
        if self.pending:
            self.pending = [pending for pending in self.pending if pending.unit != unit]

    def expire(self, now: float) -> None:
        """Drop the pending answers that cannot come any more because their time is over."""
        if self.pending:
            self.pending = [pending for pending in self.pending if pending.until > now]

    def confusable(self, unit: int, request: Request[Any]) -> list[PendingAnswer]:
        """Return the pending answers that could pass for the response to this request.

        The same unit and function are enough, because an exception response contains no more.
        """
        return self.of_function(unit, request.function_code)

    def of_function(self, unit: int, code: int) -> list[PendingAnswer]:
        """Return the pending answers that may come from this unit, to requests with this function code."""
        return [pending for pending in self.of_unit(unit) if pending.request.function_code == code]

    def of_unit(self, unit: int) -> list[PendingAnswer]:
        """Return the pending answers that may come from this unit."""
        return [pending for pending in self.pending if pending.unit == unit or self._any_unit]

    def stray(self, event: LineEvent, now: float) -> None:
        """Record a frame or noise that does not answer the open request: a late reply if it fits a pending answer."""
        late = self._late_for(event, now)
        self.counters.strays += 1
        if self.on_stray is not None:
            self.on_stray(event, late)

    def _late_for(self, event: LineEvent, now: float) -> PendingAnswer | None:
        """Return the request that a frame answers late, which is not pending any more; None if it is not known."""
        if not isinstance(event, Adu):
            return None
        if self._any_unit and len({late.unit for late in self.pending if late.could_be(event)}) > 1:
            self.counters.late += 1  # of which unit is unknown, so all of them stay pending
            return None
        for index, late in enumerate(self.pending):
            if (late.unit == event.unit or self._any_unit) and late.could_be(event):
                # A unit answers in the order in which it was asked, so its earlier pending answers will not come.
                earlier, later = self.pending[:index], self.pending[index + 1 :]
                self.pending = [pending for pending in earlier if pending.unit != late.unit] + later
                self.counters.late += 1
                self.counters.replies.append(LateReply(late.unit, late.request, event.pdu, now))
                return late
        return None
