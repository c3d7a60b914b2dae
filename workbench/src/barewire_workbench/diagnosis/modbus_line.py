"""Diagnosis of one Modbus line or connection: findings, and verdicts.

        bytes --> TrackedLine --> frames and noise, each with its line --+--> noise beside a frame, damaged frames
              '-> Sniffer ------> requests and their responses ----------+--> no answer, two answers, echo
                                                                         +--> LineCounts --> verdicts

Up to three bytes beside a frame are noise of the line. More bytes are a damaged frame: if a request is open, the
response to it. A request counts as unanswered when the time for its response is over, or the next request follows; a
recording that ends before proves nothing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from barewire.modbus.adu import BROADCAST
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import decode_request, decode_response, request_class
from barewire.tcp.frame import PREFIX
from barewire_workbench.diagnosis.can_log import PROVES
from barewire_workbench.diagnosis.exchange import (
    diagnose_exchange,
    exchange_findings,
    frame_of,
    lost_end,
    other_count,
    response_size,
    shown_digits,
)
from barewire_workbench.diagnosis.modbus_counts import LineCounts
from barewire_workbench.diagnosis.modbus_pieces import WEAK, Examiner, Piece
from barewire_workbench.diagnosis.modbus_responses import (
    KEPT,
    READS,
    STRAY,
    OpenRequests,
    Overlap,
    Refusals,
    compared,
    content,
    eight_times,
    long_exception,
    read_otherwise,
    turned,
    unused_bits,
    wrong_crc,
)
from barewire_workbench.diagnosis.verdict import (
    FindingCounts,
    LineVerdict,
    LogFinding,
    Unsettled,
    verdicts_without_cause,
)
from barewire_workbench.frames.findings import DiagnosisCode, Finding
from barewire_workbench.frames.modbus import explain_pdu
from barewire_workbench.frames.result import FrameRole, ProtocolName, counted
from barewire_workbench.sniffer import (
    AmbiguousFrame,
    NoiseSeen,
    RecordingEnds,
    RequestSeen,
    ResponseMissing,
    ResponseSeen,
    SnifferEvent,
    readable,
    shapes,
)

_BURST = 8
"""The most bytes of noise directly before the good response to the open request."""
_BESIDE = 0.02
"""Seconds from noise to the frame that it belongs to; USB adapters deliver bytes of one moment up to 16 ms apart."""
_WITHIN = 0.005
"""Seconds between two chunks of one damaged frame; a response takes longer to come."""
_AT_ONCE = 0.02
"""Seconds from a request to its echo; a client that repeats a request waits for a response before."""
_SECOND_ANSWER = 0.05
"""Seconds from a response to that of another device with the same address."""
_NO_TIME_OUT = 0.05
"""Seconds: no client gives up a response sooner, and sends its next request. MinimalModbus waits so long. Equal times
prove nothing: in some logs they are whole seconds."""
_NO_TARGET = (b"\x0a", b"\x0b")
"""Exceptions of a gateway: no path to the unit, no response from it."""
_ILLEGAL_ADDRESS = b"\x02"
_FIVE_DIGITS = 10_000
"""Numbers of manuals with the digit of their table are above."""
_DIFFERENCES = 2
"""Differences between what is refused and what is served that a verdict names."""
_NO_VALUES = tuple(map(bytes.fromhex, ("7FFF", "8000", "FFFF", "7FFFFFFF", "80000000", "FFFFFFFF", "7FC00000")))
"""Registers that SunSpec and many makers send for what a device does not measure."""
_EXCEPTION = 5
"""Bytes of an exception on a serial line."""
_SIDE_SHOWN = 3
"""Frames of a log of one side that a verdict names."""
_FEW = 16
"""Different refusals that are told apart by what was asked."""
_WRITES_COIL = 0x05
_WITHOUT, _OUTSIDE = " without a frame", " outside of a frame"
_DIAGNOSTICS, _LISTEN_ONLY = 0x08, b"\x00\x04"


class Located(NamedTuple):
    """A finding, and the piece of the log at which it is. `said` is what the verdict says beside its code."""

    unit: int
    finding: Finding
    at: float
    line: int
    said: str = ""


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
        self._examiner = Examiner(protocol)
        self._noise: Piece | None = None  # the next frame decides what it is
        self._asked: Piece | None = None  # the last frame, if it is a request
        self._before: Piece | None = None  # the last frame
        # time, unit and PDU of frames, and their places
        self._lines: deque[tuple[tuple[float, int, bytes], Piece]] = deque(maxlen=KEPT)
        self._spoiled: deque[tuple[int, float]] = deque(maxlen=KEPT)  # requests whose response is damaged
        self._answered: ResponseSeen | None = None  # the last response, if it has a request
        self._answered_broadcast: ResponseSeen | None = None
        self._other_count: ResponseSeen | None = None  # the last response with another count than its request asked
        self._overlap: Overlap | None = None
        self._half: AmbiguousFrame | None = None  # the next frame decides whether it is a wrong response to this one
        self._last_request: RequestSeen | None = None
        self._requests = OpenRequests()  # whose response may still come
        self.repeated: frozenset[bytes] = frozenset()
        """Bytes that are in the log more than once."""
        self._strays: set[bytes] = set()  # noise beside frames
        self._seen: deque[Piece] = deque(maxlen=KEPT)  # frames and damaged pieces, to compare later ones with
        self._zero_answers = False  # a device answers as unit 0
        self._to_all: RequestSeen | None = None  # a request to read of unit 0, if nothing came since
        self._numbered: list[tuple[int, Located]] = []  # refusals of addresses that look like numbers of a manual
        self._served: set[tuple[int, int]] = set()  # units, and the first digit of an address that they serve
        self._refusals = Refusals()
        self._stuck: Piece | None = None  # the last response behind another one, in the same read
        self._coil: RequestSeen | None = None  # the last request that has its response, if it writes one coil
        self._sends = False  # requests that the client sent are in the log: others that it received are not its own
        self._echoed: SnifferEvent | None = None  # a request that is an echo
        self._instead = -1.0  # when something else than a response came, which has its finding
        self.one_side = ""
        """"requests" or "responses", if the log shows nothing else: then none of them stands alone."""
        self._of_side: RequestSeen | ResponseSeen | None = None  # the last frame of such a log
        self._of_one_side: list[str] = []  # the first frames of such a log
        self.is_cut = False
        """Whether the log ends with bytes, so that there may be more."""
        self.unread_at = -1.0
        """The time of the last line of the log whose bytes cannot be read: they may be the response."""
        self._listening: set[int] = set()  # units that were commanded to listen only

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.counts.frames} frames, {self.found.total} findings>"

    def take(self, pieces: Iterable[Piece], events: Iterable[SnifferEvent] = ()) -> list[LogFinding]:
        """Take pieces of the line, then the events of the sniffer that follow from them."""
        located = [finding for piece in pieces for finding in self._piece(piece)]
        waiting = list(events)
        for place, event in enumerate(waiting):
            following = waiting[place + 1] if place + 1 < len(waiting) else None
            located += self._event(event, following)
        return [self._log_finding(*finding) for finding in located]

    def flush(self) -> list[LogFinding]:
        """Decide about noise that no frame followed, and about requests of which no more will come."""
        self._end_cut()
        located = [*self._decide(None), *self._end_overlap(), *self._end_half(), *self._end_broadcast(None)]
        # A unit that serves one address with five digits has such addresses: they are no numbers of a manual.
        located += [finding for table, finding in self._numbered if (finding.unit, table) not in self._served]
        self._numbered.clear()
        return [self._log_finding(*finding) for finding in located]

    def _end_cut(self) -> bool:
        """Return whether the log ends within a response; that is no fault of the line."""
        noise = self._noise
        size = None if noise is None else self._due(noise)
        if noise is None or size is None or len(noise.data) >= size or not self.is_cut:
            return False
        self._noise = None
        seen = f"{len(noise.data)} of its {size} bytes are in the log"
        self.unsettled.unseen.append(f"the end of the last response, of unit {noise.data[0]}: {seen}")
        return True

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
        return causes or verdicts_without_cause(self.found, self.unsettled, "; ".join([counts.seen(), *differences]))

    def _log_finding(self, unit: int, finding: Finding, at: float, line: int, said: str = "") -> LogFinding:
        place = ", ".join(filter(None, (self.name, f"unit {unit}" if unit else "")))
        self.found.add(finding.code, (place or "the line") + (f" ({said})" if said else ""))
        return LogFinding(at, line, place, finding, self._timed)

    # Pieces: frames and noise

    def _piece(self, piece: Piece) -> Iterator[Located]:
        if piece.adu is None:
            noise = self._noise
            if noise is not None and (piece.joined or self._goes_on(noise, piece)):
                self._noise = noise._replace(data=noise.data + piece.data, end=piece.end)
                return
            yield from self._decide(None)
            self._noise = piece
            return
        role, behind_noise = self._role(piece), self._noise is not None
        yield from self._decide(piece, role)
        self.counts.frames += 1
        self._lines.append(((piece.end, piece.adu.unit, piece.adu.pdu), piece))
        self._seen.append(piece)
        if role == "response" and self._asked is None and piece.joined and not behind_noise:
            self._stuck = piece
        if role == "request":
            self.counts.requests += 1
        else:
            self.counts.responses += 1
        self._asked = piece if role == "request" else None
        self._before = piece._replace(joined=False) if behind_noise else piece  # noise parts it from the frame before

    def _goes_on(self, noise: Piece, piece: Piece) -> bool:
        """Return whether noise goes on in the next chunk."""
        if noise.from_client != piece.from_client:
            return False
        if self._timed and piece.start - noise.end <= _WITHIN:
            return True
        size = self._due(noise)
        return noise.from_client is False and size is not None and len(noise.data) + len(piece.data) <= size

    def _due(self, noise: Piece) -> int | None:
        """Return the bytes of the response of RTU that noise begins; None if it begins none, or the request does not
        tell."""
        asked = self._asked.adu if self._asked is not None else None
        if self.protocol != "rtu" or asked is None or len(noise.data) < 2 or not self._begins_answer(noise):
            return None
        size = _EXCEPTION if noise.data[1] & EXCEPTION_BIT else response_size(asked.pdu)
        is_other = asked.pdu[0] in READS and noise.data[2:3] not in (b"", bytes(((size or 0) - _EXCEPTION & 0xFF,)))
        return None if is_other and size != _EXCEPTION else size

    def _role(self, piece: Piece) -> FrameRole:
        """Return the role of a frame: its shape tells, or the frame before; the two of a single write are equal."""
        assert piece.adu is not None
        if piece.from_client is not None and self.protocol == "tcp":
            return "request" if piece.from_client else "response"
        request, response = shapes(piece.adu.pdu)
        if request != response:
            return "request" if request else "response"
        if piece.from_client is not None:
            return "request" if piece.from_client else "response"
        asked = self._asked
        return "response" if asked is not None and asked.adu == piece.adu else "request"

    def _decide(self, after: Piece | None, role: FrameRole | None = None) -> Iterator[Located]:
        """Decide what the last noise was, now that the frame after it is known."""
        noise, self._noise = self._noise, None
        if noise is None:
            return
        self.counts.noise_bytes += len(noise.data)
        answered = role == "response" and self._asked is not None and after is not None and self._beside(noise, after)
        is_burst = answered or len(set(noise.data)) == 1  # one level that stays, read as the same byte again and again
        is_long = len(noise.data) > (_BURST if is_burst else STRAY)
        if is_long or self.protocol == "tcp" or self._begins_answer(noise):
            is_first = not self.counts.frames and after is not None and after.joined
            around = after if after is not None and after.joined and is_long else None
            yield from self._damaged(noise, is_first=is_first, around=around)
        elif after is not None and after.adu is not None and self._beside(noise, after):
            self.counts.longest_noise = max(self.counts.longest_noise, len(noise.data))
            if role == "response":
                self.counts.before_responses += 1
            else:
                self.counts.before_requests += 1
            yield self._stray("noise-before", noise, after, f"before a {role} of unit {after.adu.unit}")
        elif noise.joined and self._before is not None and self._before.adu is not None:
            self.counts.after += 1
            yield self._stray("noise-after", noise, self._before, f"behind a frame of unit {self._before.adu.unit}")
        else:
            self.counts.stray += 1
            text = f"{counted(len(noise.data))}{_WITHOUT}"
            yield Located(0, Finding("no-frame", text, content(noise.data)), noise.end, noise.line)

    def _begins_answer(self, noise: Piece) -> bool:
        """Return whether noise begins with the unit and the function that were asked."""
        asked = self._asked.adu if self._asked is not None and noise.from_client is not True else None
        head = noise.data[PREFIX if self.protocol == "tcp" else 0 :][:2]
        if asked is None or len(head) < (1 if self.protocol == "tcp" else 2):
            return False
        functions = asked.pdu[0], asked.pdu[0] | EXCEPTION_BIT
        return any(bytes((asked.unit, function)).startswith(head) for function in functions)

    def _beside(self, noise: Piece, frame: Piece) -> bool:
        return frame.joined or (self._timed and frame.start - noise.end <= _BESIDE)

    def _stray(self, code: DiagnosisCode, noise: Piece, frame: Piece, where: str) -> Located:
        assert frame.adu is not None
        text = f"{counted(len(noise.data))} of noise {where}"
        if noise.data in self._strays and len(set(noise.data)) > 1:
            text = f"{counted(len(noise.data))} {where}, the same as before: a header of the device's own, or noise"
        if len(self._strays) < KEPT:
            self._strays.add(noise.data)
        proof = f"{shown_digits(noise.data)} beside the good frame {shown_digits(frame.data)}"
        return Located(frame.adu.unit, Finding(code, text, proof), noise.end, noise.line)

    def _damaged(self, noise: Piece, *, is_first: bool, around: Piece | None) -> Iterator[Located]:
        """Diagnose bytes that should be a frame: the response to the open request, or anything. `is_first`: they begin
        the log, and a frame follows at once. `around` is the frame behind them in the same piece of the log."""
        counts, asked, begins = self.counts, self._asked, False
        if asked is None and self._is_part_again(noise):
            self.unsettled.open["frame printed again without its beginning"] += 1
            return
        counts.bursts += 1
        unit = 0
        role: FrameRole | None = None
        if noise.from_client is not None:
            role = "request" if noise.from_client else "response"
        if asked is not None and asked.adu is not None and noise.from_client is not True:
            unit, role = asked.adu.unit, "response"
            counts.unit(unit).damaged += 1
            self._spoiled.append((unit, asked.end))
            size = response_size(asked.adu.pdu)
            # In ASCII a byte has two characters, the LRC takes the place of the CRC, and ':' CR LF are around it.
            longest = 0 if size is None else size + 4 if self.protocol != "ascii" else 2 * size + 9
            begins = self._begins_answer(noise) or self.protocol == "ascii"
            counts.unit(unit).too_long += size is not None and len(noise.data) > longest and begins
            if self.protocol == "rtu":
                if (lost := lost_end(noise.data, unit, asked.adu.pdu, size)) is not None:
                    counts.first_lost += lost.text.startswith("the first")
                    counts.last_lost += lost.text.startswith("the last")
                    yield Located(unit, lost, noise.end, noise.line)
                    return
                for finding in diagnose_exchange("rtu", frame_of("rtu", None, unit, asked.adu.pdu), noise.data)[:1]:
                    counts.codes[finding.code] += 1
                    counts.kinds[finding.code] += 1
                    yield Located(unit, finding, noise.end, noise.line)
                    return
        findings = turned(noise.data) or self._examiner.findings(noise.data, role, good=counts.frames >= PROVES)
        if unit and findings and findings[0].code in WEAK and not begins:
            findings = []  # what is no answer to this request may look like the beginning of any
        numbers = tuple(int.from_bytes(piece.data[:2], "big") for piece in (noise, asked) if piece is not None)
        if self.protocol == "tcp" and unit and findings and findings[0].code == "cut-frame" and len({*numbers}) > 1:
            text = f"{findings[0].text}, of transaction {numbers[0]}, and {numbers[1]} was asked"
            findings = [findings[0]._replace(text=text)]
        refused = asked.adu.pdu[0] if unit and asked is not None and asked.adu is not None else 0
        is_cut = bool(findings) and findings[0].code == "cut-frame"
        if refused and is_cut and noise.data[:2] == bytes((unit, refused | EXCEPTION_BIT)):
            text = f"the beginning of an exception, so that function {refused:02X} is refused"
            findings = [findings[0]._replace(text=f"{text}: {counted(_EXCEPTION - len(noise.data))} to come")]
        if findings and findings[0].code == "bit-flip" and noise.data in self.repeated:
            findings = []  # no disturbance changes the same bit twice
        if not unit and (part := self._part_of_frame(findings, noise.data)):
            counts.bursts -= 1
            self.unsettled.open[part] += 1
            return
        other = wrong_crc(noise.data, role, is_cut) if self.protocol == "rtu" and (begins or not unit) else []
        if is_cut and other:  # a whole frame, or if no direction is known the beginning of one in the other direction
            text = f"{findings[0].text}, or {other[0].text}"
            findings = other if role is not None else [other[0]._replace(code="no-frame", text=text)]
        findings = findings or compared(noise.data, reversed(self._seen)) or other
        self._seen.append(noise)
        if is_first and findings and findings[0].code == "byte-lost" and findings[0].text.startswith("the first"):
            counts.bursts -= 1
            self.unsettled.unseen.append("the beginning of the first frame, before which the log begins")
            return
        if findings:
            counts.kinds[findings[0].code] += 1
            counts.codes.update({finding.code for finding in findings})
            yield Located(unit, findings[0], noise.end, noise.line)
            return
        if around is not None and around.adu is not None:
            counts.bursts -= 1
            text = (
                f"{counted(len(noise.data))} before a good frame in one piece: a frame of another protocol around it?"
            )
            proof = f"{shown_digits(noise.data)} before {shown_digits(around.data)}"
            yield Located(around.adu.unit, Finding("no-frame", text, proof), noise.end, noise.line)
            return
        counts.kinds["no-frame"] += 1
        counts.strange += not begins
        text = f"{counted(len(noise.data))}{_OUTSIDE}" + (", where a response was due" if unit else "")
        if self.protocol == "tcp" and noise.joined and self._before is not None:
            text = f"{counted(len(noise.data))} behind a frame, which the length in its header does not count"
        yield Located(unit, Finding("no-frame", text, content(noise.data)), noise.end, noise.line)

    def _is_part_again(self, noise: Piece) -> bool:
        """Return whether a program printed the last frame again, without its header or unit."""
        before = self._before.data if self._before is not None else b""
        return before.endswith(noise.data) and 0 < len(before) - len(noise.data) <= PREFIX and len(noise.data) > STRAY

    def _part_of_frame(self, findings: list[Finding], data: bytes) -> str:
        """Return what bytes are that a program printed before it completed them; empty if they were received so."""
        code = findings[0].code if findings else "cut-frame"
        if code in ("crc-missing", "mbap-missing") and self.counts.frames:
            return "frame without its checksum or header, as a program prints it before it is whole"
        is_pdu = any(readable(decode, data) is not None for decode in (decode_request, decode_response))
        return "PDU without its unit and checksum" if code == "cut-frame" and is_pdu else ""

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
                self._note_one_side(event)
                yield from self._refusal(event)
            case ResponseSeen() if self._overlap is not None and event.request is not None:
                yield from self._overlapping(self._overlap, event)
            case ResponseSeen():
                yield from self._response(event)
            case ResponseMissing() | RecordingEnds() if self.one_side:
                self._note_one_side(event.request)
            case ResponseMissing():
                yield from self._decide(None)  # no frame will follow the noise that came in place of the response
                yield from self._no_response(event, following)
            case RecordingEnds(request=request) if (request.unit, request.at) not in self._spoiled:
                if not self._listens(request) and not self._end_cut():
                    self.unsettled.open[f"request to unit {request.unit} at the end"] += 1
            case AmbiguousFrame() if not self._listens(event):
                yield from self._either(event)

    def _note_one_side(self, frame: RequestSeen | ResponseSeen) -> None:
        """Remember a frame of a log that shows one side only."""
        role: FrameRole = "request" if isinstance(frame, RequestSeen) else "response"
        asked, self._of_side = self._of_side, frame
        if role == "request" and asked is not None and (more := eight_times(asked, frame)):
            self._of_one_side = [f"{explain_pdu(frame.pdu, role).summary}: {more}"]
            self.unsettled.one_side = self._of_one_side[0]
        elif len(self._of_one_side) < _SIDE_SHOWN:
            what = "request to" if role == "request" else "response of"
            self._of_one_side.append(f"{what} unit {frame.unit}, {explain_pdu(frame.pdu, role).summary}")
            self.unsettled.one_side = ", ".join(self._of_one_side)

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
        piece, before = self._piece_of(event), self._last_request
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
        findings = self._examiner.findings(frame, "request", good=True)
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
            self._spoiled.append((request.unit, request.at))
            yield self._located(event, finding)
        else:
            stuck = self._stuck is not None and self._piece_of(event) is self._stuck
            where = ", in one read with the response before it: that was left in the buffer" if stuck else ""
            self.unsettled.open[f"response of unit {event.unit} without its request{where}"] += 1
            yield from self._refusal(event)

    def _to_request(self, event: ResponseSeen, request: RequestSeen) -> Iterator[Located]:
        """Take the response to a request."""
        unit = self.counts.unit(event.unit)
        self._requests.answered(request)
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
        piece, request_piece = self._piece_of(event), self._piece_of(request)
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
        self._last_request = request
        self._requests.note(request)

    def _wrong_answer(self, event: ResponseSeen) -> Located | None:
        """Return the finding on a TCP response with the transaction of an open request that it does not answer."""
        request = self._requests.of_transaction(event)
        if request is None:
            return None
        self._spoiled.append((request.unit, request.at))
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

    def _line_of(self, frame: RequestSeen | ResponseSeen | AmbiguousFrame) -> int:
        piece = self._piece_of(frame)
        return 0 if piece is None else piece.line

    def _piece_of(self, frame: RequestSeen | ResponseSeen | AmbiguousFrame) -> Piece | None:
        """Return the piece of a frame; the last one if that is not remembered."""
        place = frame.at, frame.unit, frame.pdu
        return next((piece for known, piece in reversed(self._lines) if known == place), self._before)

    def _no_response(self, event: ResponseMissing, following: SnifferEvent | None) -> Iterator[Located]:
        request = event.request
        unit = self.counts.unit(request.unit)
        line = self._line_of(request)
        if self._is_echo(request, following):
            self.counts.echoes += 1
            self._echoed = following
            unit.requests -= 1
            text = "the request is received again at once, as its sender's own echo"
            yield Located(request.unit, Finding("echo", text, f"{_sent(request)}, twice"), request.at, line)
            return
        if (request.unit, request.at) in self._spoiled or self._listens(request):
            return
        if request.at <= self._instead <= event.at:
            unit.wrong += 1
            return
        if request.at <= self.unread_at <= event.at:
            self.unsettled.open[f"request to unit {request.unit} before bytes that cannot be read"] += 1
            return
        next_piece = self._piece_of(following) if isinstance(following, RequestSeen) else None
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
        if self._timed:
            is_followed = isinstance(following, RequestSeen) and following.at == event.at
            proof = f"nothing for {event.at - request.at:.3f} s{', then the next request' * is_followed}"
        yield Located(request.unit, Finding("no-answer", text, proof), event.at, line)

    def _is_echo(self, request: RequestSeen, following: SnifferEvent | None) -> bool:
        """Return whether the next frame is the same request, sooner than any client repeats it."""
        if not isinstance(following, RequestSeen) or (following.unit, following.pdu) != (request.unit, request.pdu):
            return False
        piece = self._piece_of(following)
        if piece is not None and piece.from_client is not None:
            return not piece.from_client  # the client that wrote the log received its own request, or repeats it
        joined = piece is not None and piece.joined
        return joined or (self._timed and following.at - request.at <= _AT_ONCE)

    def _listens(self, request: RequestSeen | AmbiguousFrame) -> bool:
        """Return whether the unit was commanded to answer nothing [MB-APP 6.8, Force Listen Only Mode]."""
        if request.pdu[0] == _DIAGNOSTICS and request.pdu[1:3] == _LISTEN_ONLY:
            self._listening.add(request.unit)
        return request.unit in self._listening


def has_no_reading(finding: Finding) -> bool:
    """Return whether a finding says of bytes no more than that they are no frame."""
    return finding.code == "no-frame" and finding.text.endswith((_WITHOUT, _OUTSIDE))


def _sent(request: RequestSeen) -> str:
    return f"unit {request.unit}, {shown_digits(request.pdu)}"


def _written(half: AmbiguousFrame) -> str:
    return "write" if half.pdu[0] != _DIAGNOSTICS else "diagnostic request"


def _table_of(request: bytes) -> int:
    """Return the first of five digits of the address in a request: in the numbers of manuals it is the table."""
    return int.from_bytes(request[1:3], "big") // _FIVE_DIGITS
