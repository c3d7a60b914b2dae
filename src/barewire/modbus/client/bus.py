"""A client's line, with the state that must be kept between two requests on it.

On a serial line a response does not name its request. If the response to A is late, it arrives while B is open; if B
looks like A, it passes for the response to B, and a wrong value is delivered. So when a request ended without a
response (time-out, cancellation, damage), its answer stays *pending* until it is certain that it cannot come any more:

    A  ------------------->
       ......... time-out                        the answer to A is pending
    probe (08/00, a number) -------------->      only if it could pass for B's: same unit, same function
       <--- the late answer to A                 recognised, recorded, never delivered
       <--- the probe's echo, or exception 88    the unit has sent everything that was due before
    B  ------------------->
       <--- the answer to B

    recovery = "probe"    as drawn. The answer to the probe may be late as well: if none comes within `late_window`, B
                          is not sent (NoAnswer). After two unanswered probes in a row, recovery is as with "wait"
    recovery = "wait"     no probe: silence for `late_window`, then B

A line whose responses are numbered (TCP) needs none of this, and an exchange without trouble costs nothing extra. The
bus assumes that a unit answers requests in the order in which they were sent, and that it is the line's only client.

A write without a response may have been carried out: its error is `WriteOutcomeUnknown`, and it is repeated only if
the caller allows it.

Most requests on TCP are one send and one receive. These can be carried out without running a conversation:

    ask(unit, request)   =   begin(unit, request) -> the frame; send it;  the response arrived:     answered(unit, now)
                                                                          anything else happened:   rest(unit, ...)

Depends on: conversation, line_state, modbus.messages. Used by: io.modbus (clients), io.engine (fast path).
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from copy import copy
from typing import TYPE_CHECKING, Any, Literal, Self

from barewire.conversation import DEFAULT_TIMEOUT, Abandoned, Conversation, Heard, Listen, Send
from barewire.errors import DecodeError, EncodeError, NoAnswer
from barewire.modbus.adu import BROADCAST, Adu
from barewire.modbus.client.line_state import NEVER, LineState, PendingAnswer, WriteOutcomeUnknown
from barewire.modbus.exceptions import ModbusException

if TYPE_CHECKING:
    from barewire.modbus.framing import Line, LineEvent
    from barewire.modbus.messages.base import R, Request

Recovery = Literal["probe", "wait"]

_MAX_PROBES = 2
"""The number of unanswered probes in a row after which a unit is not probed again, and only silence is proof."""


class Bus:
    """A client's line. It runs one conversation at a time; a caller with several puts them in a `FairQueue`.

    line           the framing; after a reconnect it may be replaced between two requests, and answers stay pending
    recovery       how a pending answer is excluded: "probe" (default) or "wait", see above
    late_window    seconds of silence after which a pending answer is not expected any more (default: three time-outs)
    gap            seconds of pause between two exchanges with a unit (default 0)
    gaps           the same for single units: unit -> seconds
    dead_after     the number of unanswered requests in a row after which a unit is not asked for a while, longer
                   each time (default None: never)
    """

    def __init__(
        self,
        line: Line,
        *,
        recovery: Recovery = "probe",
        late_window: float | None = None,
        gap: float = 0.0,
        gaps: Mapping[int, float] | None = None,
        dead_after: int | None = None,
    ) -> None:
        self.line = line
        self.recovery: Recovery = recovery
        self.late_window = late_window
        self.state = LineState(gap=gap, gaps=gaps, dead_after=dead_after)
        self.counters = self.state.counters
        self._nonce = 0

    def sibling_bus(self, line: Line) -> Self:
        """Return a bus for another line to the same units, for several open requests on one connection.

        Both share the state of the units and the counters.
        """
        sibling = copy(self)
        sibling.line = line
        return sibling

    def ask(
        self,
        unit: int,
        request: Request[R],
        *,
        timeout: float = DEFAULT_TIMEOUT,
        retries: int = 0,
        repeat_writes: bool = False,
    ) -> Conversation[bytes, R]:
        """Send `request` to `unit` and return its response.

            timeout          seconds, counted from the end of sending (default 1)
            retries          how often a read without a response is repeated (default 0)
            repeat_writes    repeat a write without a response as well (default False)

        Raises ModbusException for an exception response, NoAnswer for silence, WriteOutcomeUnknown for an unanswered
        write. A request that has no response by the standard (08/04, Force Listen Only Mode) returns `Unanswered`.
        """
        if unit == BROADCAST and not self.line.numbered:
            raise EncodeError("unit 0 on a serial line is a broadcast, which no unit answers: use broadcast", "unit")
        if retries and (repeat_writes or not request.writes):
            return self._ask_again(unit, request, timeout, retries)
        return self._exchange(unit, request, timeout)

    def _ask_again(self, unit: int, request: Request[R], timeout: float, retries: int) -> Conversation[bytes, R]:
        while True:
            try:
                return (yield from self._exchange(unit, request, timeout))
            except NoAnswer:
                if not retries or self.line.broken is not None:
                    raise
                retries -= 1

    def begin(self, unit: int, request: Request[Any]) -> bytes | None:
        """Return the frame of a request that may be sent at once; None if it may have to wait, so that `ask` is needed.

        The caller that sends the frame must then call `answered` or run `rest`.
        """
        line, unit_state = self.line, self.state.units.get(unit)
        if unit_state is None or unit_state.dead_until > NEVER or self.state.has_gaps or not line.numbered:
            return None
        self.counters.asked += 1
        return line.request(unit, request.encode())

    def answered(self, unit: int, now: float) -> None:
        """Record that the response to the frame of `begin` arrived."""
        self.state.answered(unit, now)

    def rest(self, unit: int, request: Request[R], timeout: float, sent_at: float) -> Conversation[bytes, R]:
        """Return the rest of the conversation `ask`, after the frame of `begin` was sent. It begins by listening."""
        return self._exchange(unit, request, timeout, sent_at=sent_at)

    def broadcast(self, request: Request[R], *, turnaround: float = 0.1) -> Conversation[bytes, None]:
        """Send `request` to every unit on a serial line, then wait `turnaround` seconds.   [MB-SERIAL 2.4.1]

        Raises EncodeError for a request that only reads: no unit answers a broadcast.
        """
        if not request.writes:
            raise EncodeError(f"{request.name} as a broadcast: no unit answers it, so only writes make sense", "unit")
        return self._broadcast(request, turnaround)

    def _broadcast(self, request: Request[R], turnaround: float) -> Conversation[bytes, None]:
        yield from self.wait_until_idle(turnaround + 1.0)
        heard = yield Send(self.line.request(BROADCAST, request.encode()))
        self.line.sent(heard.now)
        until = heard.now + turnaround
        while heard.now < until:
            heard = yield Listen(until)
            self._pass_over(heard)

    def overhear(self, data: bytes | None, now: float) -> None:
        """Take bytes that arrived while no request was open."""
        self._pass_over(Heard(data, now))

    def wait_until_idle(self, timeout: float) -> Conversation[bytes, float]:
        """Listen until the line may be used, and return the time. Frames that arrive meanwhile are counted and ignored.

        Raises NoAnswer if the line does not become silent within `timeout` seconds.
        """
        line = self.line
        heard = yield Listen(NEVER)
        give_up = heard.now + timeout
        while True:
            now = self._pass_over(heard)
            quiet = max(line.quiet_at, line.deadline or line.quiet_at) if line.held else line.quiet_at
            if heard.item is None and now >= quiet:
                return now
            if now >= give_up:
                raise NoAnswer(f"the line is never silent: another station has been sending for {timeout:g} s")
            heard = yield Listen(max(quiet, now))

    def settle(self) -> Conversation[bytes, None]:
        """Listen until no pending answer can come any more, before the line is handed over to another user."""
        state = self.state
        while state.pending:
            until = max(pending.until for pending in state.pending)
            heard = yield Listen(until)
            if self._pass_over(heard) >= until:
                state.pending.clear()

    # One exchange

    def _exchange(
        self,
        unit: int,
        request: Request[R],
        timeout: float,
        *,
        idle_at: float | None = None,
        sent_at: float | None = None,
    ) -> Conversation[bytes, R]:
        """Wait until the unit may be asked, send the request, and wait for its response.

        With `idle_at` the line is known to be idle since then, so the request is sent at once (a probe). With `sent_at`
        it was sent already, at that time.
        """
        line = self.line
        unit_state = self.state.units[unit]
        if sent_at is not None:
            now = sent_at
        elif idle_at is not None:
            now = idle_at
        elif line.numbered and unit_state.free_at == unit_state.dead_until == NEVER:
            now = NEVER  # a late response cannot be mistaken, and the unit needs no pause
        else:
            now = yield from self._clear(unit, request, timeout)
        passed_over: list[str] = []
        try:
            # From here on a response may come, so however this exchange ends, the answer must be left pending.
            if sent_at is None:
                self.counters.asked += 1
                heard = yield Send(line.request(unit, request.encode()))
                now = heard.now
                line.sent(now)
            until = now + timeout
            while now < until:
                wake = line.deadline
                heard = yield Listen(until if wake is None or wake > until else wake)
                now = heard.now
                response = self._response_in(line.feed(heard.item, now), unit, request, now, passed_over)
                if response is not None:
                    return response
                if line.broken is not None:
                    break
        except (Abandoned, GeneratorExit) as end:
            self._leave_pending(unit, request, now, timeout)
            if request.writes and isinstance(end, Abandoned):
                raise _outcome_unknown(f"unit {unit}, {request.name}: {end}") from end
            raise
        return self._unanswered(unit, request, timeout, now, passed_over)

    def _response_in(
        self, events: list[LineEvent], unit: int, request: Request[R], now: float, passed_over: list[str]
    ) -> R | None:
        """Return the response to `request` if it is among the events; note the events before it in `passed_over`.

        Raises ModbusException if it is an exception response.
        """
        for event in events:
            if isinstance(event, Adu) and self.line.answers(event):
                try:
                    response = request.read_response(event.pdu)
                except ModbusException:
                    self.state.answered(unit, now)
                    raise
                except DecodeError as error:
                    why = str(error)
                else:
                    self.state.answered(unit, now)
                    return response
            else:
                why = describe_event(event)
            self.state.stray(event, now)
            _note(passed_over, why)
        return None

    def _unanswered(self, unit: int, request: Request[R], timeout: float, now: float, passed_over: list[str]) -> R:
        """End an exchange without a response: raise the error, or return the result if the standard demands silence."""
        line, unit_state = self.line, self.state.units[unit]
        self._leave_pending(unit, request, now, timeout)
        if line.broken is not None:
            text = f"unit {unit} did not answer {request.name}: {line.broken}; nothing after it can be trusted"
        else:
            silence = request.without_answer(listens_only=unit_state.listens_only)
            if silence is not None:
                self.counters.lost -= 1  # only an exception response could still come, late
                unit_state.listens_only = request.without_answer() is not None
                return silence
            self.state.timed_out(unit_state, now)
            if line.held:
                _note(passed_over, f"{len(line.held)} bytes without an end")
            instead = f"; received instead: {'; '.join(passed_over)}" if passed_over else ""
            text = f"unit {unit} did not answer {request.name} within {timeout:g} s{instead}"
        raise _outcome_unknown(text) if request.writes else NoAnswer(text)

    def _leave_pending(self, unit: int, request: Request[Any], now: float, timeout: float) -> None:
        self.counters.lost += 1
        if not self.line.numbered:
            window = 3 * timeout if self.late_window is None else self.late_window
            self.state.pending.append(PendingAnswer(unit, request, now + window))

    def _pass_over(self, heard: Heard[bytes]) -> float:
        for event in self.line.feed(heard.item, heard.now):
            self.state.stray(event, heard.now)
        return heard.now

    # Before the next request

    def _clear(self, unit: int, request: Request[Any], timeout: float) -> Conversation[bytes, float]:
        """Wait until the line is idle, the unit's pause over, and no confusable answer pending. Returns the time."""
        unit_state = self.state.units[unit]
        now = yield from self.wait_until_idle(timeout)
        if now < unit_state.dead_until:
            left = unit_state.dead_until - now
            raise NoAnswer(f"unit {unit} left {unit_state.silent} requests unanswered: asked again in {left:.1f} s")
        while now < unit_state.free_at:
            heard = yield Listen(unit_state.free_at)
            now = self._pass_over(heard)
        return (yield from self._prove_gone(unit, request, timeout, now))

    def _prove_gone(self, unit: int, request: Request[Any], timeout: float, now: float) -> Conversation[bytes, float]:
        """Make sure that no pending answer that could pass for the response to `request` can still come.

        Returns the time.
        """
        state, unit_state = self.state, self.state.units[unit]
        if not state.confusable(unit, request):
            return now
        # Loaded here because TCP never needs it, and other lines rarely do.
        from barewire.modbus.messages.diagnostics import RETURN_QUERY_DATA, Diagnostics

        # Another 08 is not preceded by a probe, because their answers would be alike.
        may_probe = self.recovery == "probe" and request.function_code != Diagnostics.function_code
        if may_probe and unit_state.unproven < _MAX_PROBES:
            # Another number each time, so that its echo cannot be an older one.
            self._nonce = self._nonce + 0x9E37 & 0xFFFF
            self.counters.probes += 1
            probe = Diagnostics(RETURN_QUERY_DATA, self._nonce.to_bytes(2, "big"))
            unit_state.unproven += 1
            # The exception "function 08 is unknown" proves as much as the echo: all earlier answers came before it. If
            # nothing comes, the answer to the probe may be late as well, and the wait below covers both.
            with suppress(ModbusException, NoAnswer):
                yield from self._exchange(unit, probe, timeout, idle_at=now)
        while state.confusable(unit, request):
            until = max(pending.until for pending in state.pending if pending.unit == unit)
            heard = yield Listen(until)
            now = self._pass_over(heard)
            if now >= until and may_probe and unit_state.unproven < _MAX_PROBES:
                text = f"unit {unit} has an answer pending that may still come, and left a probe unanswered"
                raise NoAnswer(f"{text}: {request.name} was not sent")
            if now >= until:
                state.forget(unit)
        return (yield from self.wait_until_idle(timeout))


def describe_event(event: LineEvent) -> str:
    """Describe an event in an error message."""
    if isinstance(event, Adu):
        number = "" if event.transaction is None else f", transaction {event.transaction}"
        return f"a frame from unit {event.unit}, function {event.pdu[0]:02X}{number}"
    text = event.text or event.reason
    if not event.data:
        return text
    start = event.data[:16].hex(" ").upper() + (" ..." if len(event.data) > 16 else "")
    size = f"{len(event.data)} byte{'' if len(event.data) == 1 else 's'}"
    # A text such as "3 bytes, then silence" begins with the number already.
    return f"{size} {start}{text.removeprefix(size)}" if text.startswith(f"{size},") else f"{size} {start}: {text}"


def _note(passed_over: list[str], text: str) -> None:
    """Keep the first three texts: an error is one line, and noise must not fill the memory."""
    if len(passed_over) < 3:
        passed_over.append(text)
    elif len(passed_over) == 3:
        passed_over.append("...")


def _outcome_unknown(text: str) -> WriteOutcomeUnknown:
    return WriteOutcomeUnknown(f"{text}; whether it was carried out is unknown")


# A line that is used once


def ask(line: Line, unit: int, request: Request[R], *, timeout: float = DEFAULT_TIMEOUT) -> Conversation[bytes, R]:
    """Send `request` to `unit` once and return its response. `timeout` is in seconds.

    Nothing is remembered afterwards: for several requests on the same line use a `Bus`, which recognises late
    responses. Raises ModbusException for an exception response, NoAnswer when the time is over.
    """
    return Bus(line).ask(unit, request, timeout=timeout)


def broadcast(line: Line, request: Request[R], *, turnaround: float = 0.1) -> Conversation[bytes, None]:
    """Send `request` to every unit on a serial line, then leave them `turnaround` seconds to carry it out."""
    return Bus(line).broadcast(request, turnaround=turnaround)
