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

    recovery = "probe"    as drawn. If the probe has no answer within the time-out of B, B is not sent (NoAnswer)
    recovery = "wait"     no probe: listen until `late_window` after A was sent, then send B

Exception 88 carries no number. While an earlier 08 is pending it could be the answer to that one, so it proves only
what the answer to the earlier one would prove; then the echo with its number decides, or the window. Probes without an
answer are pending too; when a unit has sixteen, the next request waits for the window instead.

A line whose responses are numbered (TCP) needs none of this, and an exchange without trouble costs nothing extra. The
bus assumes that a unit answers requests in the order in which they were sent, each at most once and within
`late_window`, and that it is the line's only client; docs/explanation/late-answers.md states what follows from that.

A write without a response may have been carried out: its error is `WriteOutcomeUnknown`, and it is repeated only if
the caller allows it.

Most requests are one send and one receive. These can be carried out without running a conversation. `begin` decides
whether the frame is written at once or waits for something, such as a silence:

    ask(unit, request)   =   begin(unit, ...) -> the frame; write it; sent(now)
                                                     the response arrived:      answered(unit, now)
                                                     anything else happened:    rest(unit, ...)
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from copy import copy
from operator import eq
from typing import TYPE_CHECKING, Any, Literal, Self

from barewire.conversation import DEFAULT_TIMEOUT, Abandoned, Conversation, Heard, Listen, Send, check_request_timeout
from barewire.errors import DecodeError, EncodeError, NoAnswer
from barewire.modbus.adu import BROADCAST, Adu, describe_event
from barewire.modbus.client.line_state import (
    NEVER,
    LineState,
    NotSent,
    PendingAnswer,
    UnitOptions,
    Units,
    UnitState,
    no_answer,
    note_stray,
)
from barewire.modbus.exceptions import ModbusException

if TYPE_CHECKING:
    from barewire.modbus.framing import Line, LineEvent
    from barewire.modbus.messages.base import R, Request

Recovery = Literal["probe", "wait"]
_PROBE = 0x08  # the function code of a probe

_MOST_PROBES = 16
"""How many unanswered probes of a unit are pending at most. Of every other function it is one request."""


_NO_OPTIONS = UnitOptions(timeout=0.0)


class Bus:
    """A client's line. It runs one conversation at a time; a caller with several puts them in a `FairQueue`.

    line           the framing; after a reconnect `continue_on` replaces it between two requests
    recovery       how a pending answer is excluded: "probe" (default) or "wait", see above
    late_window    seconds after a request was sent in which its answer may come (default: three times the longest
                   time-out of a request on this bus so far, or of the options, if that is longer)
    retries        how often a read without a response is repeated, where a call gives no other number (default 0)
    options        how units are asked: their pauses, and the time-out that requests usually have, which is only for the
                   default of `late_window`
    units          the options of single units: unit -> `UnitOptions`
    """

    def __init__(
        self,
        line: Line,
        *,
        recovery: Recovery = "probe",
        late_window: float | None = None,
        retries: int = 0,
        options: UnitOptions = _NO_OPTIONS,
        units: Mapping[int, UnitOptions] | None = None,
    ) -> None:
        any_unit = getattr(line, "any_unit", False) and not line.numbered
        self.line = line
        self.state = LineState(Units(options, units or {}), any_unit=any_unit)
        self.counters = self.state.counters
        self.retries = retries
        self.recovery: Recovery = recovery
        self.late_window = late_window
        # A slow unit is slow for every request, and behind a serial server it delays the others: the window must not
        # depend on the time-out of a single request, nor on that of a single unit.
        self._longest_timeout = max(of_unit.timeout for of_unit in (options, *(units or {}).values()))
        self._nonce = 0
        self._open: tuple[int, Request[Any]] | None = None
        self._sent_at: float | None = None  # when it was sent, if that is known
        self._must_listen = True  # bytes came since the line was idle, so more of them may have arrived by now

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.line!r}>"

    def sibling_bus(self, line: Line) -> Self:
        """Return a bus for another line to the same units, with the same state of the units and counters."""
        sibling = copy(self)
        sibling.line, sibling._open = line, None
        return sibling

    def continue_on(self, line: Line) -> None:
        """Use the line of a new connection from here on. Answers stay pending, and echoes expected."""
        take_over = getattr(line, "continue_from", None)  # of an `EchoLine`, which most clients do not load
        if take_over is not None:
            take_over(self.line)
        self._must_listen = True  # a serial server may send what it received before the connection
        self.line = line

    def take_over(self, before: Bus) -> None:
        """Begin where the bus of another client has ended, on the same line: its answers stay pending, its echoes
        expected, and the units have their pauses."""
        before.continue_on(self.line)  # which expects the echoes of that line from here on
        if not self.line.numbered:
            self.state.pending += before.state.pending
        for unit, of_unit in before.state.units.items():
            if self.state.units[unit].gap:
                self.state.units[unit].free_at = of_unit.free_at

    def ask(
        self,
        unit: int,
        request: Request[R],
        *,
        timeout: float = DEFAULT_TIMEOUT,
        retries: int | None = None,
        repeat_writes: bool = False,
    ) -> Conversation[bytes, R]:
        """Send `request` to `unit` and return its response.

            timeout          seconds, counted from the end of sending (default 1)
            retries          how often a read without a response is repeated (default: that of the bus)
            repeat_writes    repeat a write without a response as well (default False)

        Raises ModbusException for an exception response, NoAnswer for silence, WriteOutcomeUnknown for an unanswered
        write, EncodeError for a time-out that is not finite. A request that has no response by the standard (08/04,
        Force Listen Only Mode) returns `Unanswered`.
        """
        if unit == BROADCAST and not self.line.numbered:
            raise EncodeError("unit 0 on a serial line is a broadcast, which no unit answers: use broadcast", "unit")
        check_request_timeout(timeout)
        repeats = self.retries if retries is None else retries
        if repeats and (repeat_writes or not request.writes):
            return self._ask_again(unit, request, timeout, repeats)
        return self._exchange(unit, request, timeout)

    def _ask_again(self, unit: int, request: Request[R], timeout: float, retries: int) -> Conversation[bytes, R]:
        may_probe, attempts = True, 1
        while True:
            try:
                return (yield from self._exchange(unit, request, timeout, may_probe=may_probe))
            except NotSent:
                may_probe = False  # a request that was not sent costs no retry: now wait for the window
            except NoAnswer as error:
                if attempts > retries:
                    error.add_context(f"{attempts} attempts")
                    raise
                if self.line.broken is not None or isinstance(error.__cause__, Abandoned):
                    raise
                may_probe, attempts = True, attempts + 1

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
        self._must_listen = True
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
            quiet, deadline = line.quiet_at, line.deadline
            if deadline is not None and deadline > quiet:
                quiet = deadline
            if heard.item is None and now >= quiet:
                self._must_listen = False
                return now
            if now >= give_up:
                raise NoAnswer(f"the line is never silent: another station has been sending for {timeout:g} s")
            heard = yield Listen(max(quiet, now))

    def settle(self) -> Conversation[bytes, None]:
        """Listen until no pending answer can come any more, before the line is handed over to another user."""
        state = self.state
        if self._open is not None:
            self._pass_over((yield Listen(NEVER)))
        while state.pending:
            until = max(pending.until for pending in state.pending)
            heard = yield Listen(until)
            if self._pass_over(heard) >= until:
                state.pending.clear()

    # One request without a conversation. The record of a request is made before it is sent, and removed when the answer
    # arrives, so that an exception at any point of an exchange (Ctrl-C, a signal handler, no memory) does not lose a
    # pending answer. Each change is one statement with its counter, so that no exception comes between.

    def begin(self, unit: int, request: Request[Any], timeout: float, now: float) -> bytes | None:
        """Return the frame of a request that may be sent at once; None if it may have to wait, so that `ask` is needed.

        The caller has passed to `overhear` what the port had received. It calls `sent` when the frame is transmitted (a
        numbered line needs no `sent`), then `answered`, or runs `rest`.
        """
        line, state = self.line, self.state
        unit_state = state.units.get(unit)
        if unit_state is None or unit_state.dead_until > NEVER or unit_state.free_at > NEVER:
            return None
        if not line.numbered:
            # Nothing may be under way that would pass for the response.
            is_silent = line.deadline is None and now >= line.quiet_at
            if self._must_listen or not is_silent or state.pending or self._open is not None:
                return None
        elif self._open is not None:  # its exchange was interrupted
            self._leave_pending(NEVER)
        frame = line.request(unit, request.encode())
        self._record((unit, request), timeout)
        return frame

    def _record(self, opened: tuple[int, Request[Any]], timeout: float) -> None:
        """Record a request before it is sent: from then on a response may come, however its exchange ends."""
        if timeout > self._longest_timeout:
            self._longest_timeout = timeout
        self._sent_at = None
        self._open, self.counters.asked = opened, self.counters.asked + 1

    def sent(self, now: float) -> None:
        """Record that the open request was transmitted, its last byte at `now`."""
        self._sent_at = now
        self.line.sent(now)

    def answered(self, unit: int, now: float) -> None:
        """Record that the response to the open request arrived."""
        self.state.answered(unit, now)
        self._open, self.counters.answered = None, self.counters.answered + 1

    def rest(self, unit: int, request: Request[R], timeout: float, sent_at: float) -> Conversation[bytes, R]:
        """Return the rest of the conversation `ask`, after the frame of `begin` was sent. It begins by listening."""
        return self._exchange(unit, request, timeout, sent_at=sent_at)

    def _leave_pending(self, now: float) -> None:
        """Leave the answer of the open request pending, if there is one: its exchange is over."""
        if self._open is None:
            return
        pending, unit_state = self.state.pending, self.state.units[self._open[0]]
        if not self.line.numbered:
            window = 3 * self._longest_timeout if self.late_window is None else self.late_window
            # Interrupted while it was being sent, the request may leave a little later than `now`.
            sent_at = now + self._longest_timeout if self._sent_at is None else self._sent_at
            # A line may know only at a silence that bytes are a frame, so an answer is recognised that much later.
            pending = [*pending, PendingAnswer(*self._open, sent_at + window + self.line.delay)]
            unit_state.begin_gap(sent_at)
        # One statement: an exception in between would count the request twice, or not at all.
        self.state.pending, self._open, self.counters.lost = pending, None, self.counters.lost + 1

    # One exchange

    def _exchange(
        self,
        unit: int,
        request: Request[R],
        timeout: float,
        *,
        idle_at: float | None = None,
        sent_at: float | None = None,
        may_probe: bool = True,
    ) -> Conversation[bytes, R]:
        """Wait until the unit may be asked, send the request, and wait for its response.

        With `idle_at` the line is idle since then, so the request is sent at once (a probe). With `sent_at` it was sent
        already, at that time. Without `may_probe` a pending answer is waited for.
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
            now = yield from self._clear(unit, request, timeout, may_probe)
        passed_over: list[str] = []
        opened = self._open
        try:
            if sent_at is None:
                self._leave_pending(now)  # of an exchange that was interrupted
                frame = line.request(unit, request.encode())
                opened = unit, request  # before it is recorded: an exception may come between both
                self._record(opened, timeout)
                heard = yield Send(frame)
                now = heard.now
                self.sent(now)
            until = now + timeout
            while now < until:
                wake = line.deadline
                heard = yield Listen(until if wake is None or wake > until else wake)
                now = heard.now
                response = self._response_in(self._received(heard), unit, request, now, passed_over)
                if response is not None:
                    return response
                if line.broken is not None:
                    break
        except Abandoned as end:
            if request.writes:
                raise no_answer(request, f"unit {unit}, {request.name}: {end}") from end
            raise
        finally:
            if self._open is opened:  # not the request of a later exchange, if this one is closed by the collector
                self._leave_pending(now)
        return self._unanswered(unit, request, timeout, now, passed_over)

    def _response_in(
        self, events: list[LineEvent], unit: int, request: Request[R], now: float, passed_over: list[str]
    ) -> R | None:
        """Return the response to `request` if it is among the events. Other events are noted in `passed_over`.

        Raises ModbusException if it is an exception response, NoAnswer if the unit sent its response and it is wrong.
        """
        response: R | None = None
        failure: Exception | None = None
        for event in events:
            why = ""
            if response is None and failure is None and isinstance(event, Adu) and self.line.answers(event):
                try:
                    response = request.read_response(event.pdu)
                except ModbusException as exception:
                    # The exception to a probe carries no number: it may answer the probe before, which is pending.
                    if not self.state.confusable(unit, request):
                        failure = exception
                except DecodeError as error:
                    why = str(error)
                    if self._is_last_word(event, unit, request):
                        failure = no_answer(
                            request, f"unit {unit} answered {request.name} with a wrong response: {why}"
                        )
                        failure.__cause__ = error
                if response is not None or failure is not None:
                    self.answered(unit, now)
                    continue
            self.state.stray(event, now)
            note_stray(passed_over, why or describe_event(event))
        if failure is not None:
            raise failure
        return response

    def _is_last_word(self, frame: Adu, unit: int, request: Request[Any]) -> bool:
        """Whether a frame that is not a valid response must be what the unit sent in response to `request`.

        Then nothing else can come. It may be something else if an older answer is pending, if this unit has not
        answered on this bus before, or if the line echoes requests; a request without response needs none.
        """
        if frame.pdu[0] & 0x7F != request.function_code or frame.pdu == request.encode() or request.without_answer():
            return False
        return self.line.numbered or (self.state.units[unit].settled and not self.state.of_unit(unit))

    def _unanswered(self, unit: int, request: Request[R], timeout: float, now: float, passed_over: list[str]) -> R:
        """End an exchange without a response: raise the error, or return the result if the standard demands silence."""
        line, unit_state = self.line, self.state.units[unit]
        if line.broken is not None:
            text = f"unit {unit} did not answer {request.name}: {line.broken}; nothing after it can be trusted"
        else:
            silence = request.without_answer(listens_only=unit_state.listens_only)
            if silence is not None:
                self.counters.lost -= 1  # only an exception response could still come, late
                unit_state.listens_only = request.without_answer() is not None
                return silence
            unit_state.was_silent(now)
            if line.held:
                note_stray(passed_over, f"{len(line.held)} bytes without an end")
            instead = f"; received instead: {'; '.join(passed_over)}" if passed_over else ""
            text = f"unit {unit} did not answer {request.name} within {timeout:g} s{instead}"
        raise no_answer(request, text)

    def _pass_over(self, heard: Heard[bytes]) -> float:
        self._leave_pending(heard.now)  # no exchange is under way, so a request that is open was interrupted
        for event in self._received(heard):
            self.state.stray(event, heard.now)
        return heard.now

    def _received(self, heard: Heard[bytes]) -> list[LineEvent]:
        """Return the events of received bytes, without copies of a frame in the same piece: taken for the answer to a
        later request, a copy would prove too much."""
        events = self.line.feed(heard.item, heard.now)
        if len(events) < 2:
            return events
        self.counters.strays += sum(map(eq, events, events[1:]))
        return [event for event, before in zip(events, [None, *events]) if event != before]

    # Before the next request

    def _clear(self, unit: int, request: Request[Any], timeout: float, may_probe: bool) -> Conversation[bytes, float]:
        """Wait until the line is idle, the unit's pause over, and no confusable answer pending. Returns the time."""
        unit_state = self.state.units[unit]
        now = yield from self.wait_until_idle(timeout)
        if now < unit_state.dead_until:
            remaining = unit_state.dead_until - now
            raise NoAnswer(
                f"unit {unit} left {unit_state.silent} requests unanswered: asked again in {remaining:.1f} s"
            )
        now = yield from self._pause(unit_state, timeout, now)
        if self.state.pending:
            now = yield from self._prove_gone(unit, request, timeout, now, may_probe and self.recovery == "probe")
            now = yield from self._pause(unit_state, timeout, now)  # after a probe too
        return now

    def _pause(self, unit_state: UnitState, timeout: float, now: float) -> Conversation[bytes, float]:
        """Wait on the idle line until the pause of a unit is over, and return the time. The line is idle then too."""
        while now < unit_state.free_at:
            self._pass_over((yield Listen(unit_state.free_at)))
            now = yield from self.wait_until_idle(timeout)
        return now

    def _prove_gone(
        self, unit: int, request: Request[Any], timeout: float, now: float, may_probe: bool
    ) -> Conversation[bytes, float]:
        """Make sure that no pending answer that could pass for the response to `request` can still come; return the
        time."""
        state = self.state
        state.expire(now)
        confusable = state.confusable(unit, request)
        if not confusable:
            return now
        # No probe before another 08, since their answers would be alike; nor for other units (if none are compared).
        # Sixteen at most, so that a unit that never answers them does not fill the memory.
        may_probe = (
            may_probe and request.function_code != _PROBE and len(state.of_function(unit, _PROBE)) < _MOST_PROBES
        )
        if may_probe and all(pending.unit == unit for pending in confusable):
            rest = max(pending.until for pending in confusable) - now
            now = yield from self._probe(unit, min(timeout, rest), now)
            state.expire(now)
            if state.confusable(unit, request):
                why = "the answer to an earlier request may still come"
                text = f"unit {unit} did not answer a probe within {timeout:g} s, and {why}"
                raise NotSent(f"{text}: {request.name} was not sent")
        while confusable := state.confusable(unit, request):
            heard = yield Listen(max(pending.until for pending in confusable))
            state.expire(self._pass_over(heard))
        return (yield from self.wait_until_idle(timeout))

    def _probe(self, unit: int, timeout: float, now: float) -> Conversation[bytes, float]:
        """Send a probe to the unit on the idle line, and return the time after it.

        Its answer settles everything that was sent to the unit before.
        """
        # Loaded here because TCP never needs it, and other lines rarely do.
        from barewire.modbus.messages.diagnostics import RETURN_QUERY_DATA, Diagnostics

        while True:
            # Another number each time, so that its echo cannot be an older one.
            self._nonce = self._nonce + 0x9E37 & 0xFFFF
            probe = Diagnostics(RETURN_QUERY_DATA, self._nonce.to_bytes(2, "big"))
            if all(pending.request != probe for pending in self.state.of_unit(unit)):
                break
        self.counters.probes += 1
        with suppress(ModbusException, NoAnswer):
            yield from self._exchange(unit, probe, timeout, idle_at=now)
        return self._pass_over((yield Listen(NEVER)))
