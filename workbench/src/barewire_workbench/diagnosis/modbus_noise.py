"""What stands between the frames of one Modbus line: noise beside a frame, and damaged frames.

        01 03 00 00 00 02 C4 0B    00  01 03 04 00 17 00 07 0B F5
        request                    ^^  response                        one byte of noise before the response

        01 03 00 00 00 02 C4 0B    01 03 04 00 17 00 07 0B             the response without its last byte

Up to three bytes beside a frame are noise of the line. More bytes are a damaged frame: if a request is open, the
response to it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from barewire.modbus.adu import Adu
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import decode_request, decode_response
from barewire.rtu.crc import crc16
from barewire.tcp.frame import PREFIX
from barewire_workbench.diagnosis.can_log import PROVES
from barewire_workbench.diagnosis.exchange import diagnose_exchange, frame_of, lost_end, response_size, shown_digits
from barewire_workbench.diagnosis.modbus_counts import LineCounts
from barewire_workbench.diagnosis.modbus_pieces import WEAK, Examiner, Piece
from barewire_workbench.diagnosis.modbus_responses import KEPT, READS, STRAY, compared, content, turned, wrong_crc
from barewire_workbench.diagnosis.verdict import Unsettled
from barewire_workbench.frames.findings import DiagnosisCode, Finding
from barewire_workbench.frames.result import FrameRole, ProtocolName, counted
from barewire_workbench.sniffer import AmbiguousFrame, RequestSeen, ResponseSeen, readable, shapes

_BURST = 8
"""The most bytes of noise directly before the good response to the open request."""
_BESIDE = 0.02
"""Seconds from noise to the frame that it belongs to; USB adapters deliver bytes of one moment up to 16 ms apart."""
_WITHIN = 0.005
"""Seconds between two chunks of one damaged frame; a response takes longer to come."""
_LONGER = 4
"""Bytes by which a response of TCP is longer: seven in front in place of the unit and a CRC."""
_EXCEPTION = 5
"""Bytes of an exception on a serial line."""
_WITHOUT, _OUTSIDE = " without a frame", " outside of a frame"


class Located(NamedTuple):
    """A finding, and the piece of the log at which it is. `said` is what the verdict says beside its code."""

    unit: int
    finding: Finding
    at: float
    line: int
    said: str = ""


class LinePieces:
    """The frames of one line or connection, and what the noise between them is. `take` each piece as it comes.

    The next frame decides what noise is; `decide` does so where none will follow.
    """

    def __init__(self, protocol: ProtocolName, counts: LineCounts, unsettled: Unsettled, *, timed: bool) -> None:
        self.protocol: ProtocolName = protocol
        self.counts, self.unsettled = counts, unsettled
        self._timed = timed
        self.examiner = Examiner(protocol)
        self.spoiled: deque[tuple[int, float]] = deque(maxlen=KEPT)
        """Units and times of the requests whose response is damaged."""
        self.repeated: frozenset[bytes] = frozenset()
        """Bytes that are in the log more than once."""
        self.is_cut = False
        """Whether the log ends with bytes, so that there may be more."""
        self.halves: dict[bytes, str] = {}
        """Parts of a frame that were printed apart, and what to say of each."""
        self._noise: Piece | None = None  # the next frame decides what it is
        self._asked: Piece | None = None  # the last frame, if it is a request
        self._before: Piece | None = None  # the last frame
        # time, unit and PDU of frames, and their places
        self._lines: deque[tuple[tuple[float, int, bytes], Piece]] = deque(maxlen=KEPT)
        self._strays: set[bytes] = set()  # noise beside frames
        self._seen: deque[Piece] = deque(maxlen=KEPT)  # frames and damaged pieces, to compare later ones with
        self._stuck: Piece | None = None  # the last response behind another one, in the same read

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.counts.frames} frames>"

    def of(self, frame: RequestSeen | ResponseSeen | AmbiguousFrame) -> Piece | None:
        """Return the piece of a frame; the last one if that is not remembered."""
        place = frame.at, frame.unit, frame.pdu
        return next((piece for known, piece in reversed(self._lines) if known == place), self._before)

    def is_stuck(self, response: ResponseSeen) -> bool:
        """Return whether a response came behind another one, in the same read."""
        return self._stuck is not None and self.of(response) is self._stuck

    def end_cut(self) -> None:
        """Take the end of a log within a response to the open request: neither this nor the beginning of any other
        frame at the end is a fault of the line."""
        noise = self._noise
        if noise is None or not self.is_cut:
            return
        size, asked = self._due(noise), self._asked.adu if self._asked is not None else None
        is_fault = self.counts.last_lost > 0 or (self.protocol == "rtu" and crc16(noise.data) == 0)  # of its sender
        if size is not None and len(noise.data) < size and asked is not None and not is_fault:
            seen = f"{len(noise.data)} of its {size} bytes are in the log"
            self.unsettled.unseen.append(f"the end of the last response, of unit {asked.unit}: {seen}")
            self.spoiled.append((asked.unit, self._asked.end if self._asked is not None else noise.end))
            self._noise = None
        elif self.counts.frames and (asked is None or self.protocol != "tcp"):
            found = self.examiner.findings(noise.data, None, good=self.counts.frames >= PROVES)
            if found and found[0].code == "cut-frame" and "CRC" not in f"{found[0].text} {found[0].proof}":
                seen = f"{counted(len(noise.data))} of it are in the log, {shown_digits(noise.data)}"
                self.unsettled.unseen.append(f"the end of the last frame: {seen}")
                self._noise = None

    def take(self, piece: Piece) -> Iterator[Located]:
        """Take the next piece; yield what is found on the noise before it."""
        if piece.adu is None:
            noise = self._noise
            if noise is not None and (piece.joined or self._goes_on(noise, piece)):
                self._noise = noise._replace(data=noise.data + piece.data, end=piece.end)
                return
            yield from self.decide(None)
            self._noise = piece
            return
        role, behind_noise = self._role(piece), self._noise is not None
        yield from self.decide(piece, role)
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
        """Return the bytes of the response that noise begins; None if it begins none, or the request does not tell."""
        if self.protocol == "tcp":
            return self._due_of_tcp(noise)
        asked = self._asked.adu if self._asked is not None else None
        if self.protocol != "rtu" or asked is None or len(noise.data) < 2 or not self._begins_answer(noise):
            return None
        size = _EXCEPTION if noise.data[1] & EXCEPTION_BIT else response_size(asked.pdu)
        is_other = asked.pdu[0] in READS and noise.data[2:3] not in (b"", bytes(((size or 0) - _EXCEPTION & 0xFF,)))
        return None if is_other and size != _EXCEPTION else size

    def _due_of_tcp(self, noise: Piece) -> int | None:
        asked = self._asked
        if asked is None or asked.adu is None:
            return None
        unit, (function, *_) = asked.adu.unit, asked.adu.pdu
        heads = (
            asked.data[:4] + noise.data[4:6] + bytes((unit, code)) for code in (function, function | EXCEPTION_BIT)
        )
        if not any(head.startswith(noise.data[: PREFIX + 2]) for head in heads):
            return None
        if len(noise.data) > PREFIX:  # its own length is there
            return PREFIX + int.from_bytes(noise.data[4:PREFIX], "big")
        size = response_size(asked.adu.pdu)
        return None if size is None else size + _LONGER

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

    def decide(self, after: Piece | None, role: FrameRole | None = None) -> Iterator[Located]:
        """Decide what the last noise was, now that the frame after it is known."""
        noise, self._noise = self._noise, None
        if noise is None:
            return
        self.counts.noise_bytes += len(noise.data)
        answered = role == "response" and self._asked is not None and after is not None and self._beside(noise, after)
        is_burst = answered or len(set(noise.data)) == 1  # one level that stays, read as the same byte again and again
        is_long = len(noise.data) > (_BURST if is_burst else STRAY)
        if is_long or self.protocol == "tcp" or self._begins_answer(noise):
            is_plain = not self._timed and noise.from_client is None
            is_first = not self.counts.frames and after is not None and (after.joined or is_plain)
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
        request = self._asked_by(noise)
        asked = request.adu if request is not None and noise.from_client is not True else None
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
        counts, asked = self.counts, self._asked_by(noise) if noise.from_client is not True else None
        if self._asked is None and self._is_part_again(noise):
            self.unsettled.open["frame printed again without its beginning"] += 1
            return
        if noise.data in self.halves:
            self.unsettled.open.update([self.halves[noise.data]] if self.halves[noise.data] else [])
            if asked is not None and asked.adu is not None:
                self.spoiled.append((asked.adu.unit, asked.end))
            return
        counts.bursts += 1
        unit, begins = 0, False
        role: FrameRole | None = None
        if noise.from_client is not None:
            role = "request" if noise.from_client else "response"
        if asked is not None and asked.adu is not None:
            unit, role, begins = asked.adu.unit, "response", self._begins_answer(noise) or self.protocol == "ascii"
            self.spoiled.append((unit, asked.end))
            if (response := self._damaged_response(noise, asked.adu, begins=begins)) is not None:
                yield Located(unit, response, noise.end, noise.line)
                return
        findings = self._examined(noise, role, asked if unit else None, begins=begins)
        if not unit and (part := self._part_of_frame(findings, noise.data)):
            counts.bursts -= 1
            self.unsettled.open[part] += 1
            return
        findings = self._compared(noise, role, findings, fits=begins or not unit)
        self._seen.append(noise)
        if is_first and findings and findings[0].code == "byte-lost" and findings[0].text.startswith("the first"):
            counts.bursts -= 1
            self.unsettled.unseen.append("the beginning of the first frame, before which the log begins")
        elif findings:
            counts.kinds[findings[0].code] += 1
            counts.codes.update({finding.code for finding in findings})
            yield Located(unit, findings[0], noise.end, noise.line)
        elif around is not None and around.adu is not None:
            counts.bursts -= 1
            size = counted(len(noise.data))
            text = f"{size} before a good frame in one piece: a frame of another protocol around it?"
            proof = f"{shown_digits(noise.data)} before {shown_digits(around.data)}"
            yield Located(around.adu.unit, Finding("no-frame", text, proof), noise.end, noise.line)
        else:
            counts.kinds["no-frame"] += 1
            counts.strange += not begins
            text = f"{counted(len(noise.data))}{_OUTSIDE}" + (", where a response was due" if unit else "")
            if self.protocol == "tcp" and noise.joined and self._before is not None:
                text = f"{counted(len(noise.data))} behind a frame, which the length in its header does not count"
            yield Located(unit, Finding("no-frame", text, content(noise.data)), noise.end, noise.line)

    def _asked_by(self, noise: Piece) -> Piece | None:
        """Return the request to which noise may be the response: of TCP that with its transaction, for a response that
        ends too early is known as such only when the next one begins."""
        if self.protocol == "tcp" and noise.data[2:4] == b"\0\0":
            asked = (piece for _, piece in reversed(self._lines) if piece.from_client)
            return next((piece for piece in asked if piece.data[:2] == noise.data[:2]), self._asked)
        return self._asked

    def _damaged_response(self, noise: Piece, request: Adu, *, begins: bool) -> Finding | None:
        """Count the damaged response to a request; return what the request alone proves of it."""
        counts, unit = self.counts, self.counts.unit(request.unit)
        unit.damaged += 1
        size = response_size(request.pdu)
        # In ASCII a byte has two characters, the LRC takes the place of the CRC, and ':' CR LF are around it.
        longest = 0 if size is None else size + 4 if self.protocol != "ascii" else 2 * size + 9
        unit.too_long += size is not None and len(noise.data) > longest and begins
        if self.protocol != "rtu":
            return None
        if (lost := lost_end(noise.data, request.unit, request.pdu, size)) is not None:
            counts.first_lost += lost.text.startswith("the first")
            counts.last_lost += lost.text.startswith("the last")
            return lost
        findings = diagnose_exchange("rtu", frame_of("rtu", None, request.unit, request.pdu), noise.data)
        if not findings:
            return None
        counts.codes[findings[0].code] += 1
        counts.kinds[findings[0].code] += 1
        return findings[0]

    def _examined(self, noise: Piece, role: FrameRole | None, asked: Piece | None, *, begins: bool) -> list[Finding]:
        """Return what trials prove of a damaged piece. `asked` is the request to which it should be the response."""
        findings = turned(noise.data) or self.examiner.findings(noise.data, role, good=self.counts.frames >= PROVES)
        if not findings:
            return []
        finding = findings[0]
        if asked is not None and finding.code in WEAK and not begins:
            return []  # what is no answer to this request may look like the beginning of any
        if finding.code == "bit-flip" and noise.data in self.repeated:
            return []  # no disturbance changes the same bit twice
        if finding.code != "cut-frame" or asked is None or asked.adu is None:
            return findings
        transaction, expected = noise.data[:2], asked.data[:2]
        if self.protocol == "tcp" and transaction != expected:
            received, sent = (int.from_bytes(number, "big") for number in (transaction, expected))
            return [finding._replace(text=f"{finding.text}, of transaction {received}, and {sent} was asked")]
        function = asked.adu.pdu[0]
        if noise.data[:2] == bytes((asked.adu.unit, function | EXCEPTION_BIT)):
            text = f"the beginning of an exception, so that function {function:02X} is refused"
            return [finding._replace(text=f"{text}: {counted(_EXCEPTION - len(noise.data))} to come")]
        return findings

    def _compared(self, noise: Piece, role: FrameRole | None, findings: list[Finding], *, fits: bool) -> list[Finding]:
        """Return what is known of a damaged piece; if trials prove nothing, what earlier pieces or its length tell.

        `fits`: it begins as the response that is due, or none is due.
        """
        is_cut = bool(findings) and findings[0].code == "cut-frame"
        if self.protocol != "rtu" or not fits or (findings and not is_cut):
            return findings or compared(noise.data, reversed(self._seen))
        other = wrong_crc(noise.data, role, is_cut)
        if is_cut and other:  # a whole frame, or if no direction is known the beginning of one in the other direction
            text = f"{findings[0].text}, or {other[0].text}"
            return other if role is not None else [other[0]._replace(code="no-frame", text=text)]
        return findings or compared(noise.data, reversed(self._seen)) or other

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


def has_no_reading(finding: Finding) -> bool:
    """Return whether a finding says of bytes no more than that they are no frame."""
    return finding.code == "no-frame" and finding.text.endswith((_WITHOUT, _OUTSIDE))
