"""Diagnosis of one Modbus line or connection: findings, and verdicts.

        bytes --> TrackedLine --> frames and noise, each with its line --+--> noise beside a frame, damaged frames
              '-> Sniffer ------> requests and their responses ----------+--> no answer, two answers, echo
                                                                         +--> LineCounts --> verdicts

A request counts as unanswered when the time for its response is over, or the next request follows; a recording that
ends before proves nothing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator

from barewire.modbus.adu import BROADCAST
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import request_class
from barewire_workbench.diagnosis.exchange import exchange_findings, frame_of, other_count, shown_digits
from barewire_workbench.diagnosis.modbus_counts import LineCounts
from barewire_workbench.diagnosis.modbus_noise import LinePieces, Located
from barewire_workbench.diagnosis.modbus_pieces import Piece
from barewire_workbench.diagnosis.modbus_responses import (
    KEPT,
    READS,
    OneSide,
    OpenRequests,
    Overlap,
    Refusals,
    long_exception,
    read_otherwise,
    unused_bits,
)
from barewire_workbench.diagnosis.verdict import (
    FindingCounts,
    LineVerdict,
    LogFinding,
    Unsettled,
    verdicts_without_cause,
)
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.modbus import explain_pdu
from barewire_workbench.frames.result import ProtocolName
from barewire_workbench.sniffer import (
    AmbiguousFrame,
    NoiseSeen,
    RecordingEnds,
    RequestSeen,
    ResponseMissing,
    ResponseSeen,
    SnifferEvent,
    shapes,
)

_AT_ONCE = 0.02
"""Seconds from a request to its echo; a client that repeats a request waits for a response before."""
_SECOND_ANSWER = 0.05
"""Seconds from a response to that of another device with the same address."""
_NO_TIME_OUT = 0.05
"""Seconds: no client gives up a response sooner, and sends its next request. MinimalModbus waits so long. Equal times
prove nothing: in some logs they are whole seconds."""
_KNOWN = 2.0
"""Seconds between two times in whole seconds that are more than their error."""
_NO_TARGET = (b"\x0a", b"\x0b")
"""Exceptions of a gateway: no path to the unit, no response from it."""
_ILLEGAL_ADDRESS = b"\x02"
_FIVE_DIGITS = 10_000
"""Numbers of manuals with the digit of their table are above."""
_DIFFERENCES = 2
"""Differences between what is refused and what is served that a verdict names."""
_NO_VALUES = tuple(map(bytes.fromhex, ("7FFF", "8000", "FFFF", "7FFFFFFF", "80000000", "FFFFFFFF", "7FC00000")))
"""Registers that SunSpec and many makers send for what a device does not measure."""
_FEW = 16
"""Different refusals that are told apart by what was asked."""
_WRITES_COIL = 0x05
_DIAGNOSTICS, _LISTEN_ONLY = 0x08, b"\x00\x04"


class LineDiagnosis:
    """One line or connection. `take` pieces and events as they come, `flush` at the end; `verdicts` at any time.

    `timed` is False for a log without times, in which only neighbours in one line belong together.
    """

    def __init__(self, protocol: ProtocolName, name: str = "", *, timed: bool = True) -> None:
        self.name = name
        self.counts = LineCounts(serial=protocol != "tcp")
        self.unsettled = Unsettled()
        self.found = FindingCounts()
        self.protocol: ProtocolName = protocol
        self._timed = timed
        self.pieces = LinePieces(protocol, self.counts, self.unsettled, timed=timed)
        self._answered: ResponseSeen | None = None  # the last response, if it has a request
        self._answered_broadcast: ResponseSeen | None = None
        self._other_count: ResponseSeen | None = None  # the last response with another count than its request asked
        self._overlap: Overlap | None = None
        self._half: AmbiguousFrame | None = None  # the next frame decides whether it is a wrong response to this one
        self._last_request: RequestSeen | None = None
        self._requests = OpenRequests()  # whose response may still come
        self._zero_answers = False  # a device answers as unit 0
        self._to_all: RequestSeen | None = None  # a request to read of unit 0, if nothing came since
        self._numbered: list[tuple[int, Located]] = []  # refusals of addresses that look like numbers of a manual
        self._served: set[tuple[int, int]] = set()  # units, and the first digit of an address that they serve
        self._refusals = Refusals()
        self._coil: RequestSeen | None = None  # the last request that has its response, if it writes one coil
        self._sends = False  # requests that the client sent are in the log: others that it received are not its own
        self._echoed: SnifferEvent | None = None  # a request that is an echo
        self._instead = -1.0  # when something else than a response came, which has its finding
        self.one_side = ""
        """"requests" or "responses", if the log shows nothing else: then none of them stands alone."""
        self.in_seconds = False
        """Whether the times are in whole seconds, so that a short silence is not known."""
        self._open_lines: deque[tuple[RequestSeen, int]] = deque(maxlen=KEPT)  # of requests without a response so far
        self._side = OneSide()
        self.unread_at = -1.0
        """The time of the last line of the log whose bytes cannot be read: they may be the response."""
        self._listening: set[int] = set()  # units that were commanded to listen only

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.counts.frames} frames, {self.found.total} findings>"

    def take(self, pieces: Iterable[Piece], events: Iterable[SnifferEvent] = ()) -> list[LogFinding]:
        """Take pieces of the line, then the events of the sniffer that follow from them."""
        located = [finding for piece in pieces for finding in self.pieces.take(piece)]
        waiting = list(events)
        for place, event in enumerate(waiting):
            following = waiting[place + 1] if place + 1 < len(waiting) else None
            located += self._event(event, following)
        return [self._log_finding(*finding) for finding in located]

    def flush(self) -> list[LogFinding]:
        """Decide about noise that no frame followed, and about requests of which no more will come."""
        self.pieces.end_cut()
        located = [*self.pieces.decide(None), *self._end_overlap(), *self._end_half(), *self._end_broadcast(None)]
        # A unit that serves one address with five digits has such addresses: they are no numbers of a manual.
        located += [finding for table, finding in self._numbered if (finding.unit, table) not in self._served]
        self._numbered.clear()
        return [self._log_finding(*finding) for finding in located]

    def note(self, located: Located) -> LogFinding:
        """Take a finding on what came in place of a response."""
        self._instead = located.at
        return self._log_finding(*located)

    def verdicts(self) -> list[LineVerdict]:
        """Return what the numbers show about the line; if no fault, what devices refused, and what is open."""
        counts = self.counts
        causes = counts.verdicts()
        if not counts.frames and not counts.noise_bytes:
            causes.append(LineVerdict("nothing-heard", "nothing was received", "no byte"))
        differences = list(self._refusals.differences())[:_DIFFERENCES]
        seen = "; ".join([counts.seen(), *differences])
        if {cause.code for cause in causes} == {"late-answers"}:  # which says nothing of the others
            return [*causes, *self.unsettled.verdicts(seen)]
        return causes or verdicts_without_cause(self.found, self.unsettled, seen)

    def _log_finding(self, unit: int, finding: Finding, at: float, line: int, said: str = "") -> LogFinding:
        place = ", ".join(filter(None, (self.name, f"unit {unit}" if unit else "")))
        self.found.add(finding.code, (place or "the line") + (f" ({said})" if said else ""))
        return LogFinding(at, line, place, finding, self._timed)

    # Events: requests and responses

    def _event(self, event: SnifferEvent, following: SnifferEvent | None) -> Iterator[Located]:
        if self._overlap is not None and not self._overlap.takes(event):
            yield from self._end_overlap()
        if not isinstance(event, NoiseSeen | AmbiguousFrame):
            yield from self._end_half()
        if not isinstance(event, NoiseSeen):
            yield from self._end_broadcast(event)
        match event:
            case RequestSeen():
                self._note_foreign(event)
                if event.unit == BROADCAST and event.transaction is None:
                    self._to_all = event if event.pdu[0] in READS and event.message is not None else None
                    yield from self._refusal(event)  # of a device that answers as unit 0
                if event.unit != BROADCAST:
                    self.counts.unit(event.unit).requests += 1
                    self._note_request(event)
                yield from self._wrong_value(event)
            case ResponseSeen(request=None) if self.one_side:
                self.unsettled.one_side = self._side.note(event)
                yield from self._refusal(event)
            case ResponseSeen() if self._overlap is not None and event.request is not None:
                yield from self._overlapping(self._overlap, event)
            case ResponseSeen():
                yield from self._response(event)
            case ResponseMissing() | RecordingEnds() if self.one_side:
                self.unsettled.one_side = self._side.note(event.request)
            case ResponseMissing():
                yield from self.pieces.decide(None)  # no frame will follow the noise that came in place of the response
                yield from self._no_response(event, following)
            case RecordingEnds(request=request):
                self.pieces.end_cut()
                if (request.unit, request.at) not in self.pieces.spoiled and not self._listens(request):
                    self.unsettled.open[f"request to unit {request.unit} at the end"] += 1
            case AmbiguousFrame() if not self._listens(event):
                yield from self._either(event)

    def _end_broadcast(self, event: SnifferEvent | None) -> Iterator[Located]:
        """Decide about a request to read of unit 0, now that the next event is known."""
        asked, self._to_all = self._to_all, None
        if asked is None or self._zero_answers or (isinstance(event, RequestSeen) and not event.unit):
            return  # a device that answers as unit 0
        proof = explain_pdu(asked.pdu, "request").summary
        if isinstance(event, ResponseSeen) and event.pdu[0] & ~EXCEPTION_BIT == asked.pdu[0]:
            text = f"unit {event.unit} answers, and unit 0 was asked: ask unit {event.unit}"
            self._answered_broadcast = event
            yield self._located(event, Finding("wrong-answer", text, f"asked: {proof}"))
        else:
            text = (
                "unit 0 is the broadcast, to which no unit answers: a request that reads needs the unit of the device"
            )
            yield self._located(asked, Finding("wrong-value", text, proof))

    def _note_foreign(self, event: RequestSeen) -> None:
        """Count a request that the client received: its own echo, or one of another master."""
        piece, before = self.pieces.of(event), self._last_request
        self._sends |= piece is not None and piece.from_client is True
        is_received = piece is not None and piece.from_client is False and event.transaction is None
        if is_received and before is not None and before.unit != event.unit:
            self.counts.foreign += 1
            self.counts.own.add(before.unit)
            summary = f"unit {event.unit}, {explain_pdu(event.pdu, 'request').summary}"
            self.counts.first_foreign = self.counts.first_foreign or summary

    def _either(self, event: AmbiguousFrame) -> Iterator[Located]:
        """Take a write, or the equal response to it. Two different ones at once are a write and a wrong response."""
        first, self._half = self._half, None
        if first is None or (first.unit, first.pdu[0]) != (event.unit, event.pdu[0]) or first.pdu == event.pdu:
            if first is not None:
                self._half = first
                yield from self._end_half()
            self._half = event
            return
        request = RequestSeen(first.unit, first.pdu, first.at, first.message)
        response = ResponseSeen(event.unit, event.pdu, event.at, request=request)
        findings = exchange_findings(self.protocol, request, response, "wrong-answer")
        counts = self.counts.unit(event.unit)
        if findings and self._timed and 0 < event.at - first.at < _NO_TIME_OUT:
            counts.requests += 1
            counts.wrong += 1
            yield self._located(event, findings[0])
            return
        counts.requests += 2
        counts.halves += 2
        fields = "another value" if first.pdu[1:3] == event.pdu[1:3] else "another address"
        what = _written(event)
        what += f" to unit {event.unit} and a response with {fields}, or two {what}s without their responses"
        self.unsettled.open[what] += 1

    def _end_half(self) -> Iterator[Located]:
        """Count a write that stands alone: no other frame came to it."""
        half, self._half = self._half, None
        if half is not None:
            self.counts.unit(half.unit).requests += 1
            self.counts.unit(half.unit).halves += 1
            self.unsettled.open[f"{_written(half)} to unit {half.unit}, or its equal response"] += 1
            yield from self._wrong_value(half)

    def _wrong_value(self, request: RequestSeen | AmbiguousFrame) -> Iterator[Located]:
        """Findings on a request of a known function that cannot be decoded: a coil that is neither FF00h nor 0000h."""
        error = explain_pdu(request.pdu, "request").error if request.message is None else None
        if error is None or request_class(request.pdu) is None:
            return
        if request.unit == BROADCAST and shapes(request.pdu) == (False, True):
            self.unsettled.open["response of unit 0"] += 1
            self._zero_answers = True
            return
        frame = frame_of(self.protocol, None, request.unit, request.pdu)
        findings = self.pieces.examiner.findings(frame, "request", good=True)
        finding = findings[0] if findings else Finding("wrong-value", error.text, shown_digits(request.pdu))
        yield self._located(request, finding)

    # Two requests at once

    def _overlapping(self, overlap: Overlap, event: ResponseSeen) -> Iterator[Located]:
        """Take the response to one of two requests that were open at once."""
        if event.request == overlap.second:
            overlap.answer_to_second = event
            yield from self._response(event)
        else:
            overlap.answer_to_first = event
        if overlap.answer_to_first is None or overlap.answer_to_second is None:
            return
        second, self._overlap = overlap.answer_to_second.request, None
        assert second is not None
        # It is late if one client sends all requests, and not for its own client.
        yield from self._response(overlap.answer_to_first._replace(late=False))
        self.counts.overlaps += 1
        proof = overlap.proof(second)
        self.counts.first_overlap = self.counts.first_overlap or proof
        text = "a request was sent before the one of another master had its response"
        yield self._located(second, Finding("two-masters", text, proof))

    def _end_overlap(self) -> Iterator[Located]:
        """Two requests were open at once, and not both are answered: the first one was given up."""
        overlap, self._overlap = self._overlap, None
        if overlap is not None:
            yield from self._unanswered(overlap.missing, overlap.second, overlap.line)
            if overlap.answer_to_first is not None:
                yield from self._response(overlap.answer_to_first)

    # Responses

    def _response(self, event: ResponseSeen) -> Iterator[Located]:
        before = self._answered
        self._answered = event if event.request is not None else None
        if event.request is None:
            yield from self._without_request(event, before)
        else:
            yield from self._to_request(event, event.request)

    def _without_request(self, event: ResponseSeen, before: ResponseSeen | None) -> Iterator[Located]:
        """Take a response that does not answer the open request; `before` is the last one, if that answered its own."""
        unit = self.counts.unit(event.unit)
        if (late := self._requests.late_for(event)) is not None:
            self._requests.given_up.remove(late)
            unit.streak = 0
            if late is self._last_request:  # its client still waits: no later request says that it gave up
                unit.missing -= 1
                unit.answered += 1
                return
            unit.late += 1
            yield self._late(event, f"{event.at - late.at:.3f} s after its request, which was given up")
        elif before is not None and before.request is not None and before.request.pdu == event.pdu:
            self.unsettled.open[
                f"second response of unit {event.unit} to a write, equal to it: an echo, or two units"
            ] += 1
        elif before is not None and self._is_second(before, event):
            unit.twice += 1
            text = f"a second response to the same request, {1e3 * (event.at - before.at):.1f} ms after the first"
            proof = f"{shown_digits(before.pdu)}, then {shown_digits(event.pdu)}"
            yield self._located(event, Finding("two-answers", text, proof))
        elif event in (self._other_count, self._answered_broadcast):
            return  # it has its finding, and its request is known
        elif (wrong := self._wrong_answer(event)) is not None:
            unit.wrong += 1
            yield wrong
        elif (asked := self._requests.exchanged(event)) is not None:
            unit.wrong += 1
            text = "the two bytes of the transaction identifier are exchanged"
            proof = f"the request has {asked.transaction:04X}h, the response {event.transaction:04X}h"
            yield self._located(event, Finding("header-byte-order", text, proof))
        elif (numbered := self._requests.with_other_number(event)) is not None:
            unit.wrong += 1
            request, finding = numbered
            self.pieces.spoiled.append((request.unit, request.at))
            yield self._located(event, finding)
        else:
            stuck = self.pieces.is_stuck(event)
            where = ", in one read with the response before it: that was left in the buffer" if stuck else ""
            self.unsettled.open[f"response of unit {event.unit} without its request{where}"] += 1
            yield from self._refusal(event)

    def _to_request(self, event: ResponseSeen, request: RequestSeen) -> Iterator[Located]:
        """Take the response to a request."""
        unit = self.counts.unit(event.unit)
        self._requests.answered(request)
        self._line_of_open(request)
        self._listening.discard(event.unit)
        exception = event.pdu[1:2] if event.pdu[0] & EXCEPTION_BIT else b""
        if exception in _NO_TARGET:
            unit.missing += 1
            unit.streak += 1
            proof = explain_pdu(event.pdu, "response").summary
            yield self._located(event, Finding("no-answer", "the gateway has no response from the unit", proof))
            return
        unit.answered += 1
        unit.streak = 0
        yield from self._refusal(event)
        if exception == _ILLEGAL_ADDRESS and int.from_bytes(request.pdu[1:3], "big") > _FIVE_DIGITS:
            found = exchange_findings(self.protocol, request, event, "address-base")
            if len(self._numbered) < KEPT:
                self._numbered += [(_table_of(request.pdu), self._located(event, finding)) for finding in found]
        elif not exception:
            self._served.add((event.unit, _table_of(request.pdu)))
        if event.pdu[0] in READS and event.pdu[2:] in _NO_VALUES:
            self.counts.no_value[event.pdu[2:].hex().upper() + "h"] += 1
        piece, request_piece = self.pieces.of(event), self.pieces.of(request)
        is_received = request_piece is not None and request_piece.from_client is False
        if piece is not None and piece.joined and is_received and not self._sends and request != self._echoed:
            text = "the client has read its own request before the response"
            yield self._located(event, Finding("echo", text, _sent(request)))
        coil, self._coil = self._coil, request if request.pdu[0] == _WRITES_COIL else None
        if (
            coil is not None
            and coil.unit == request.unit
            and (other := read_otherwise(coil.pdu, request.pdu, event.pdu))
        ):
            yield self._located(event, other)
        self._refusals.take(request.unit, request.pdu, refused=bool(exception))
        if (unused := unused_bits(request.pdu, event.pdu)) is not None:
            yield self._located(event, unused)
        if event.older is not None:
            self.unsettled.open[f"response of unit {event.unit} that fits two requests"] += 1
        if event.late:
            unit.late += 1
            if request in self._requests.given_up:
                self._requests.given_up.remove(request)
            yield self._late(event, f"{event.seconds:.3f} s after its request, behind the next one")

    def _refusal(self, event: RequestSeen | ResponseSeen) -> Iterator[Located]:
        """Count an exception, and yield the finding on one that is too long."""
        if event.pdu[0] & EXCEPTION_BIT:
            refused = self.unsettled.refused
            kind = f"exception {event.pdu[1:2].hex() or 'without a code'} of unit {event.unit}"
            if isinstance(event, ResponseSeen) and event.request is not None and len(refused) < _FEW:
                kind += f" to {explain_pdu(event.request.pdu, 'request').summary}"
            refused[kind] += 1
            if (longer := long_exception(event.pdu)) is not None:
                yield self._located(event, longer)

    def _note_request(self, request: RequestSeen) -> None:
        self._open_lines.append((request, self._line_of(request)))
        self._last_request = request
        self._requests.note(request)

    def _wrong_answer(self, event: ResponseSeen) -> Located | None:
        """Return the finding on a TCP response with the transaction of an open request that it does not answer."""
        request = self._requests.of_transaction(event)
        if request is None:
            return None
        self.pieces.spoiled.append((request.unit, request.at))
        return self._located_wrong(request, event)

    def _located_wrong(self, request: RequestSeen, event: ResponseSeen) -> Located | None:
        """Return the finding on a response that does not answer this request; None if there is none."""
        findings = exchange_findings(self.protocol, request, event, "wrong-answer")
        if not findings:
            return None
        located, said = self._located(event, findings[0]), ""
        if request.unit == event.unit and (said := other_count(request.pdu, event.pdu)):
            other = self._requests.fitting(event)
            if other is not None:
                asked = f"that of transaction {other.transaction}, {explain_pdu(other.pdu, 'request').summary}"
                text = f"the response is to another request: to {asked}"
                return located._replace(finding=findings[0]._replace(text=text))
            self._other_count = event
        return located._replace(said=said)

    def _is_second(self, before: ResponseSeen, event: ResponseSeen) -> bool:
        same = before.unit == event.unit and before.pdu[0] & ~EXCEPTION_BIT == event.pdu[0] & ~EXCEPTION_BIT
        return same and self._timed and event.at - before.at <= _SECOND_ANSWER

    def _late(self, event: ResponseSeen, proof: str) -> Located:
        summary = explain_pdu(event.pdu, "response").summary
        return self._located(event, Finding("late-answer", f"a late response: {summary}", proof))

    def _located(self, frame: RequestSeen | ResponseSeen | AmbiguousFrame, finding: Finding) -> Located:
        """Return a finding with the place of its frame."""
        return Located(frame.unit, finding, frame.at, self._line_of(frame))

    def _line_of_open(self, request: RequestSeen) -> int:
        """Return the line of a request that is open no more: of equal ones in the same second, of the first."""
        found = next((pair for pair in self._open_lines if pair[0] == request), None)
        if found is None:
            return self._line_of(request)
        self._open_lines.remove(found)
        return found[1]

    def _line_of(self, frame: RequestSeen | ResponseSeen | AmbiguousFrame) -> int:
        piece = self.pieces.of(frame)
        return 0 if piece is None else piece.line

    def _no_response(self, event: ResponseMissing, following: SnifferEvent | None) -> Iterator[Located]:
        request = event.request
        unit = self.counts.unit(request.unit)
        line = self._line_of_open(request)
        if self._is_echo(request, following):
            self.counts.echoes += 1
            self._echoed = following
            unit.requests -= 1
            text = "the request is received again at once, as its sender's own echo"
            yield Located(request.unit, Finding("echo", text, f"{_sent(request)}, twice"), request.at, line)
            return
        if (request.unit, request.at) in self.pieces.spoiled or self._listens(request):
            return
        if request.at <= self._instead <= event.at:
            unit.wrong += 1
            return
        if request.at <= self.unread_at <= event.at:
            self.unsettled.open[f"request to unit {request.unit} before bytes that cannot be read"] += 1
            return
        next_piece = self.pieces.of(following) if isinstance(following, RequestSeen) else None
        if isinstance(following, RequestSeen) and next_piece is not None and request.transaction is None:
            is_same = (following.unit, following.pdu) == (request.unit, request.pdu)
            if is_same and next_piece.joined:
                self.unsettled.open[f"request to unit {request.unit} twice in one read: repeated by its sender"] += 1
                unit.requests -= 1
                return
            if is_same and not self._timed and next_piece.from_client is None:
                self.unsettled.open[f"request to unit {request.unit} twice: repeated, or its own echo"] += 1
                unit.requests -= 1
                return
            if next_piece.from_client is False and not is_same:
                unit.missing += 1
                text = f"the client received a request of unit {following.unit} where a response was due"
                proof = f"{explain_pdu(following.pdu, 'request').summary}: another master, or its late echo"
                yield self._located(following, Finding("role", text, proof))
                return
        is_next_request = request.transaction is None and not isinstance(following, ResponseSeen)
        if is_next_request and self._timed and 0 < event.at - request.at < _NO_TIME_OUT:
            self._overlap = Overlap(event, line)
            return
        yield from self._unanswered(event, following, line)

    def _unanswered(self, event: ResponseMissing, following: SnifferEvent | None, line: int) -> Iterator[Located]:
        request, unit = event.request, self.counts.unit(event.request.unit)
        stray = following if isinstance(following, ResponseSeen) and following.request is None else None
        is_of_other = stray is not None and stray.transaction != request.transaction  # which says what it answers
        if stray is not None and not is_of_other and self._requests.late_for(stray) is None:
            wrong = self._located_wrong(request, stray)
            if wrong is not None:
                unit.wrong += 1
                unit.streak = 0
                yield wrong._replace(unit=request.unit)
                return
        if stray is not None and (stray.unit, stray.pdu[0]) == (request.unit, request.pdu[0] | EXCEPTION_BIT):
            unit.wrong += 1  # an exception that is too long
            return
        unit.missing += 1
        unit.streak += 1
        self._requests.given_up.append(request)
        if stray is not None and not is_of_other:
            return  # a late response came first; the one to this request may follow
        text = f"no response to {explain_pdu(request.pdu, 'request').summary}"
        proof = "nothing before the next request" if following is not None else "nothing in the time for it"
        waited = event.at - request.at
        if self._timed and (not self.in_seconds or waited >= _KNOWN):
            is_followed = isinstance(following, RequestSeen) and following.at == event.at
            seconds = f"about {waited:.0f} s" if self.in_seconds else f"{waited:.3f} s"
            proof = f"nothing for {seconds}{', then the next request' * is_followed}"
        yield Located(request.unit, Finding("no-answer", text, proof), event.at, line)

    def _is_echo(self, request: RequestSeen, following: SnifferEvent | None) -> bool:
        """Return whether the next frame is the same request, sooner than any client repeats it."""
        if not isinstance(following, RequestSeen) or (following.unit, following.pdu) != (request.unit, request.pdu):
            return False
        piece = self.pieces.of(following)
        if piece is not None and piece.from_client is not None:
            return not piece.from_client  # the client that wrote the log received its own request, or repeats it
        joined = piece is not None and piece.joined
        return joined or (self._timed and following.at - request.at <= _AT_ONCE)

    def _listens(self, request: RequestSeen | AmbiguousFrame) -> bool:
        """Return whether the unit was commanded to answer nothing [MB-APP 6.8, Force Listen Only Mode]."""
        if request.pdu[0] == _DIAGNOSTICS and request.pdu[1:3] == _LISTEN_ONLY:
            self._listening.add(request.unit)
        return request.unit in self._listening


def _sent(request: RequestSeen) -> str:
    return f"unit {request.unit}, {shown_digits(request.pdu)}"


def _written(half: AmbiguousFrame) -> str:
    return "write" if half.pdu[0] != _DIAGNOSTICS else "diagnostic request"


def _table_of(request: bytes) -> int:
    """Return the first of five digits of the address in a request: in the numbers of manuals it is the table."""
    return int.from_bytes(request[1:3], "big") // _FIVE_DIGITS
