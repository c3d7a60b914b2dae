"""What must be remembered between two questions: the one owner of a line.

On a serial line an answer does not say which question it answers. If the answer to A is late, it comes while B is
being asked; if B looks like A, it passes for the answer to B, and the wrong value is delivered. So after a question
ended without an answer (time-out, cancellation, damaged answer) the line is *suspect*, and stays so until A's answer is
proven gone:

    A  ------------------->
       ......... time-out                        A is lost
    probe (08/00, a number) -------------->      only if A's answer could pass for B's: same unit, same function
       <--- the late answer to A                 recognised, reported, never delivered
       <--- the probe's echo, or exception 88    so whatever the unit had to say before is said
    B  ------------------->
       <--- the answer to B

    recovery = "probe"    as drawn. The probe may be late too, so both are given `late_window`; if nothing comes, B is
                          not sent (NoAnswer). A unit that left two probes unanswered is asked again after the window
    recovery = "wait"     no probe: silence for `late_window`, then B

A line whose answers are numbered (TCP) is never suspect. The good case costs nothing. What is assumed: a unit answers
in the order in which it was asked. A second master on the line defeats it, as it defeats everything on RS-485.

A write that got no answer may have been carried out: its error is `WriteOutcomeUnknown`, and it is never repeated
unless the caller says so.

Nearly every question on TCP is one send and one read. Whoever carries it out may do so without a conversation:

    ask(unit, request)   =   begin(unit, request) -> the frame; send it; what comes is the answer: answered(unit, now)
                                                                         it is anything else:      rest(unit, ...)
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from barewire.conversation import Abandoned, Conversation, Listen, Send
from barewire.errors import DecodeError, EncodeError, NoAnswer
from barewire.modbus.adu import BROADCAST, Adu
from barewire.modbus.client.line_state import NEVER, LineState, UnitState, describe_event, note, unknown
from barewire.modbus.exceptions import ModbusException

if TYPE_CHECKING:
    from barewire.modbus.framing import Line
    from barewire.modbus.messages.base import Request, Response
R = TypeVar("R", bound="Response")
Recovery = Literal["probe", "wait"]

_new = tuple.__new__  # what Send(...) and Listen(...) do, without the function around it


class Bus(LineState):
    """The owner of a line. One conversation at a time; whoever runs several sees to the turns.

    `late_window` is the silence, in seconds, after which a lost answer is taken for gone; three time-outs if not given.
    `gaps` are pauses, in seconds, that units need between two exchanges; `gap` is that of all others. After
    `dead_after` questions in a row without an answer a unit is left alone for a while, longer each time, up to
    `dead_longest` seconds: None never gives up.

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
        dead_longest: float = 30.0,
    ) -> None:
        super().__init__(
            line, late_window=late_window, gap=gap, gaps=gaps, dead_after=dead_after, dead_longest=dead_longest
        )
        self.recovery: Recovery = recovery
        self._nonce = 0

    def ask(
        self, unit: int, request: Request[R], *, timeout: float = 1.0, retries: int = 0, repeat_writes: bool = False
    ) -> Conversation[bytes, R]:
        """Ask `unit` and return its response. `timeout` counts from the moment the request is out, in seconds.

        `retries` repeats a read that got no answer; a write only with `repeat_writes`. Raises ModbusException when the
        unit declines, NoAnswer when it is silent, WriteOutcomeUnknown when a write got no answer. Where it has to be
        silent (08/04, Force Listen Only Mode) the response is an `Unanswered`.
        """
        if unit == BROADCAST and not self.line.numbered:
            raise EncodeError("unit 0 on a serial line is a broadcast: nobody answers, use tell", "unit")
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
        """The frame of a question that may go out at once; None where something has to be heard, waited for or proved
        before it, which is what `ask` is for.

        Whoever sends it owes `answered` or `rest`.
        """
        line, known = self.line, self._units.get(unit)
        if known is None or known.dead_until > NEVER or self.pauses or not line.numbered:
            return None
        self.counters.asked += 1
        return line.request(unit, request.encode())

    def rest(self, unit: int, request: Request[R], timeout: float, sent_at: float) -> Conversation[bytes, R]:
        """What is left of `ask` when a frame of `begin` is out: it listens first."""
        return self._exchange(unit, request, timeout, sent_at=sent_at)

    def broadcast(self, request: Request[R], *, turnaround: float = 0.1) -> Conversation[bytes, None]:
        """Broadcast to every unit on a serial line. Nobody answers; `turnaround` is their time to act, in seconds.

        [MB-SERIAL 2.4.1]. Raises EncodeError for a request that only reads: nobody would see the answer.
        """
        if not request.writes:
            text = f"{request.name} as a broadcast: nobody answers those, so only writing makes sense"
            raise EncodeError(text, "unit")
        return self._tell(request, turnaround)

    def _tell(self, request: Request[R], turnaround: float) -> Conversation[bytes, None]:
        yield from self.wait_until_idle(turnaround + 1.0)
        heard = yield Send(self.line.request(BROADCAST, request.encode()))
        self.line.sent(heard.now)
        until = heard.now + turnaround
        while heard.now < until:
            heard = yield Listen(until)
            self._pass_over(heard)

    def _clear(self, unit: int, request: Request[Any], timeout: float, known: UnitState) -> Conversation[bytes, float]:
        """Until the unit may be asked: the line silent, its pause over, no lost answer under way. Returns the time."""
        now = yield from self.wait_until_idle(timeout)
        if now < known.dead_until:
            left = known.dead_until - now
            raise NoAnswer(f"unit {unit} left {known.silent} questions unanswered: asked again in {left:.1f} s")
        while now < known.free_at:
            heard = yield Listen(known.free_at)
            now = self._pass_over(heard)
        return (yield from self._prove_gone(unit, request, timeout, known, now))

    def _exchange(
        self, unit: int, request: Request[R], timeout: float, *, is_probe: bool = False, sent_at: float | None = None
    ) -> Conversation[bytes, R]:
        """When the unit may be asked, send it and wait for its answer. Nothing keeps a probe from being sent.

        With `sent_at` it is out already.
        """
        line = self.line
        known = self._units.get(unit)
        if known is None:
            known = self._units[unit] = UnitState()
        now = known.free_at if sent_at is None else sent_at
        # An answer with a number answers nothing else: then there is nothing to hear out before asking.
        if sent_at is None and not is_probe and (not line.numbered or now > NEVER or known.dead_until > NEVER):
            now = yield from self._clear(unit, request, timeout, known)
        passed_over: list[str] = []
        try:
            # From here on an answer may come, however this ends.
            if sent_at is None:
                self.counters.asked += 1
                heard = yield _new(Send, (line.request(unit, request.encode()),))
                now = heard.now
                line.sent(now)
            until = now + timeout
            while now < until:
                wake = line.deadline
                heard = yield _new(Listen, (until if wake is None or wake > until else wake,))
                now = heard.now
                for event in line.feed(heard.item, now):
                    if isinstance(event, Adu) and line.answers(event):
                        try:
                            response = request.read_response(event.pdu)
                        except ModbusException:
                            self.answered(unit, now)
                            raise
                        except DecodeError as error:
                            why = str(error)
                        else:
                            self.answered(unit, now)
                            return response
                    else:
                        why = describe_event(event)
                    self._stray(event, now)
                    note(passed_over, why)
                if line.broken is not None:
                    break
        except (Abandoned, GeneratorExit) as gone:
            self._lose(unit, request, now, timeout)
            if request.writes and isinstance(gone, Abandoned):
                raise unknown(f"unit {unit}, {request.name}: {gone}") from gone
            raise
        self._lose(unit, request, now, timeout)
        if line.broken is None and (silence := request.without_answer(listens_only=known.listens_only)) is not None:
            self.counters.lost -= 1  # only an exception could still come, late
            known.listens_only = request.without_answer() is not None
            return silence
        if line.broken is not None:
            text = f"unit {unit} did not answer {request.name}: {line.broken}; nothing behind it can be trusted"
        else:
            self._unanswered(known, now)
            if line.held:
                note(passed_over, f"{len(line.held)} bytes without an end")
            instead = f"; heard instead: {'; '.join(passed_over)}" if passed_over else ""
            text = f"unit {unit} did not answer {request.name} within {timeout:g} s{instead}"
        raise unknown(text) if request.writes else NoAnswer(text)

    def wait_until_idle(self, patience: float) -> Conversation[bytes, float]:
        """Hear the line out until it may be spoken on; returns the time. What comes now answers nothing of ours.

        Raises NoAnswer if somebody else never stops talking.
        """
        line = self.line
        heard = yield Listen(NEVER)
        give_up = heard.now + patience
        while True:
            now = self._pass_over(heard)
            quiet = max(line.quiet_at, line.deadline or line.quiet_at) if line.held else line.quiet_at
            if heard.item is None and now >= quiet:
                return now
            if now >= give_up:
                raise NoAnswer(f"the line is never silent: somebody else has been talking for {patience:g} s")
            heard = yield Listen(max(quiet, now))

    # A lost answer

    def _prove_gone(
        self, unit: int, request: Request[Any], timeout: float, known: UnitState, now: float
    ) -> Conversation[bytes, float]:
        """Before a question that a lost answer could pass for: make sure that the lost answer cannot come any more.

        Returns the time.
        """
        if not self._confusable(unit, request):
            return now
        from barewire.modbus.messages.diagnostics import (  # on TCP never needed, elsewhere rarely
            RETURN_QUERY_DATA,
            Diagnostics,
        )

        # A probe proves nothing to a question that is one itself; and who left two unanswered has no ear for them.
        proof = self.recovery == "probe" and request.function_code != Diagnostics.function_code
        if proof and known.unproven < 2:
            self._nonce = self._nonce + 0x9E37 & 0xFFFF  # another number each time: its echo cannot be an older one
            self.counters.probes += 1
            probe = Diagnostics(RETURN_QUERY_DATA, self._nonce.to_bytes(2, "big"))
            known.unproven += 1
            # "I do not know function 08" is an answer too, and it came after everything before. No answer may be a late
            # one, like those before: the window is for both.
            with suppress(ModbusException, NoAnswer):
                yield from self._exchange(unit, probe, timeout, is_probe=True)
        while self._confusable(unit, request):
            until = max(lost.until for lost in self._lost if lost.unit == unit)
            heard = yield Listen(until)
            now = self._pass_over(heard)
            if now >= until and proof and known.unproven < 2:
                text = f"unit {unit} owes an answer that may still come, and left a probe unanswered"
                raise NoAnswer(f"{text}: {request.name} was not sent")
            if now >= until:
                self._forget(unit)
        return (yield from self.wait_until_idle(timeout))

    def settle(self) -> Conversation[bytes, None]:
        """Stay on the line until no lost answer can come any more: for whoever leaves it to others."""
        while self._lost:
            until = max(lost.until for lost in self._lost)
            heard = yield Listen(until)
            if self._pass_over(heard) >= until:
                self._lost.clear()
