"""What a single response or damaged piece of a Modbus line is, beside the requests and pieces before it.

    OpenRequests     which open or given-up request a response belongs to: late, transaction exchanged or of another
    Refusals         what units refuse and what they serve
    OneSide          the frames of a log that shows requests alone, or responses alone
    Envelopes        frames of Solarman V5 around RTU: another logger answers, or it has no RTU frame
    Overlap          two requests that were open at once, and what came to them
    compared         damaged bytes beside earlier ones: the rest of a frame, bytes in front, a byte too many

The others look at one response: bits behind those that were asked, an exception that is too long.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator

from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import measure_request, measure_response
from barewire.rtu.crc import crc16
from barewire_workbench.diagnosis.exchange import shown_digits
from barewire_workbench.diagnosis.good import HIGHEST_UNIT, good_body
from barewire_workbench.diagnosis.modbus_pieces import Piece
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.modbus import explain_pdu
from barewire_workbench.frames.result import FrameRole, counted
from barewire_workbench.recordings.modbus_log.envelope import Envelope, opened
from barewire_workbench.recordings.modbus_log.marked import frame_pdu
from barewire_workbench.sniffer import (
    LATE_AFTER,
    NoiseSeen,
    RequestSeen,
    ResponseMissing,
    ResponseSeen,
    SnifferEvent,
    answers,
)

STRAY = 3
"""The most bytes beside a frame that are noise of the line, and not a damaged frame."""
SHORTEST = 4
"""Bytes of the shortest frame of RTU."""
KEPT = 64
"""Requests and damaged responses that are remembered."""
READS = frozenset({1, 2, 3, 4})
"""Functions that read values: bits or registers."""
_JUST_BEFORE = 3
"""A response with the transaction of a request so many before belongs to that one, or has a wrong number."""
_SIDES: tuple[tuple[FrameRole, Callable[[bytes], int | None]], ...] = (
    ("request", measure_request),
    ("response", measure_response),
)
_SHOWN = 32
"""Characters of a text in the proof of a finding."""
_SIDE_SHOWN = 3
"""Frames of a log of one side that a verdict names."""


class OpenRequests:
    """Requests without a response: those of TCP by their transaction, and those that were given up."""

    def __init__(self) -> None:
        self.by_transaction: dict[int, RequestSeen] = {}
        self.given_up: deque[RequestSeen] = deque(maxlen=KEPT)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.by_transaction)} open, {len(self.given_up)} given up>"

    def note(self, request: RequestSeen) -> None:
        """Take a request of TCP; others have no transaction."""
        if request.transaction is None:
            return
        self.by_transaction.pop(request.transaction, None)
        self.by_transaction[request.transaction] = request
        if len(self.by_transaction) > KEPT:
            del self.by_transaction[next(iter(self.by_transaction))]

    def answered(self, request: RequestSeen) -> None:
        """Forget a request of TCP that has its response."""
        if request.transaction is not None:
            self.by_transaction.pop(request.transaction, None)

    def of_transaction(self, event: ResponseSeen) -> RequestSeen | None:
        """Return the open request with the transaction of a response."""
        return None if event.transaction is None else self.by_transaction.get(event.transaction)

    def fitting(self, event: ResponseSeen) -> RequestSeen | None:
        """Return the open request that a response answers, whatever its transaction is."""
        return next((seen for seen in self.by_transaction.values() if answers(seen, event.unit, event.pdu)), None)

    def exchanged(self, event: ResponseSeen) -> RequestSeen | None:
        """Return the open request that a TCP response answers if the bytes of its transaction are exchanged."""
        if event.transaction is None:
            return None
        number = int.from_bytes(event.transaction.to_bytes(2, "little"), "big")
        request = self.by_transaction.get(number) if number != event.transaction else None
        if request is None or request.unit != event.unit:
            return None
        return request if request.pdu[0] == event.pdu[0] & ~EXCEPTION_BIT else None

    def with_other_number(self, event: ResponseSeen) -> tuple[RequestSeen, Finding] | None:
        """Return the open request to which a TCP response came, and the finding, if it has the transaction of one just
        before. The client counts its requests, and the log may not have that one."""
        if event.transaction is None:
            return None
        fitting = self.fitting(event)
        alike = event.unit, event.pdu[0] & ~EXCEPTION_BIT  # one of another function may be due to a second request
        of_unit = (seen for seen in reversed(self.by_transaction.values()) if (seen.unit, seen.pdu[0]) == alike)
        asked = fitting or next(of_unit, None)
        if asked is None or not 0 < (asked.transaction or 0) - event.transaction <= _JUST_BEFORE:
            return None
        numbers = f"transaction {event.transaction} answers, and {asked.transaction} was asked"
        fits = ": unit, function and length fit" if fitting else ", which this is not the response to"
        proof = f"asked: {explain_pdu(asked.pdu, 'request').summary}{fits}"
        if fitting:
            text = f"{numbers}: the response to an earlier request, if the device is right"
            return asked, Finding("wrong-answer", text, proof)
        text = f"{numbers}: an earlier request has its response late, if the device is right"
        return asked, Finding("late-answer", text, proof)

    def late_for(self, event: ResponseSeen) -> RequestSeen | None:
        """Return the request that was given up and that this response answers."""

        def fits(request: RequestSeen) -> bool:
            is_soon = event.transaction is not None or event.at - request.at <= LATE_AFTER
            return request.transaction == event.transaction and is_soon and answers(request, event.unit, event.pdu)

        return next(filter(fits, self.given_up), None)


class Refusals:
    """What units refuse and what they serve: two requests that differ in one thing show what is refused.

    >>> refusals = Refusals()
    >>> refusals.take(71, bytes.fromhex("10 9D19 0001 02 001E"), refused=True)
    >>> refusals.take(71, bytes.fromhex("06 9D19 001E"), refused=False)
    >>> list(refusals.differences())
    ['unit 71 refuses function 10 at 9D19h, and serves function 06 there']
    """

    def __init__(self) -> None:
        self._refused: dict[tuple[int, bytes], None] = {}
        self._served: dict[tuple[int, bytes], None] = {}

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self._refused)} refused>"

    def take(self, unit: int, request: bytes, *, refused: bool) -> None:
        """Take a request that was answered."""
        known = self._refused if refused else self._served
        if len(request) >= 5 and len(known) < KEPT:
            known[unit, request] = None

    def differences(self) -> Iterator[str]:
        """Yield how a refused request differs from one that is served."""
        for unit, asked in self._refused:
            place = f"{asked[1:3].hex().upper()}h"
            for other, served in self._served:
                same_function, same_place = served[0] == asked[0], served[1:3] == asked[1:3]
                if other != unit and served == asked:
                    yield f"unit {unit} refuses {explain_pdu(asked, 'request').summary}, and unit {other} serves it"
                elif other == unit and same_place and not same_function:
                    functions = f"function {asked[0]:02X} at {place}, and serves function {served[0]:02X} there"
                    yield f"unit {unit} refuses {functions}"
                elif other == unit and same_place and asked[0] in READS and served[3:] < asked[3:]:
                    counts = f"{_count(asked)} from {place}, and serves {_count(served)} from there"
                    yield f"unit {unit} refuses {counts}: the others may be past its end"


def _count(request: bytes) -> str:
    return str(int.from_bytes(request[3:5], "big"))


class Envelopes:
    """Frames of Solarman V5: whether the logger that answers is the one that was asked, and has an RTU frame."""

    def __init__(self) -> None:
        self._asked: Envelope | None = None

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._asked}>"

    def take(self, data: bytes) -> Finding | None:
        """Take an envelope; return the finding on it."""
        envelope, asked = opened(data), self._asked
        if envelope is None or envelope.from_client:
            self._asked = envelope
            return None
        proof = f"in the envelope of Solarman V5, {shown_digits(data)}"
        if asked is not None and asked.logger != envelope.logger:
            text = f"logger {envelope.logger} answers, and the client asks for number {asked.logger}"
            return Finding("wrong-answer", text, proof)
        if len(envelope.inner) < SHORTEST:
            text = f"the logger returns {shown_digits(envelope.inner)} in place of an RTU frame"
            return Finding("wrong-answer", f"{text}: it has no response of the device behind it", proof)
        return None


class Overlap:
    """A request, another one sent sooner than any client gives up the first, and what came to them so far."""

    def __init__(self, missing: ResponseMissing, line: int) -> None:
        self.missing, self.line = missing, line
        self.second: RequestSeen | None = None  # a write is known to be a request when its equal response came
        self.answer_to_first: ResponseSeen | None = None
        self.answer_to_second: ResponseSeen | None = None

    def takes(self, event: SnifferEvent) -> bool:
        """Whether the event leaves open if both requests are answered."""
        if isinstance(event, RequestSeen) and self.second is None and event.at == self.missing.at:
            self.second = event
            return True
        if isinstance(event, ResponseSeen):
            return event.request is not None and event.request in (self.missing.request, self.second)
        return isinstance(event, NoiseSeen)

    def proof(self, second: RequestSeen) -> str:
        """Return which response is that to which request."""
        requests = self.missing.request, second
        asked = [f"unit {seen.unit} {explain_pdu(seen.pdu, 'request').summary}" for seen in requests]
        apart = f"{1e3 * (second.at - self.missing.request.at):.1f} ms later"
        answers = [
            f"{shown_digits(seen.pdu)} of unit {seen.unit} is the response to the {which}"
            for seen, which in ((self.answer_to_first, "first"), (self.answer_to_second, "second"))
            if seen is not None
        ]
        return f"{asked[0]}, and {apart} {asked[1]}; {', '.join(answers)}"


class OneSide:
    """The first frames of a log that shows requests alone, or responses alone."""

    def __init__(self) -> None:
        self._last: RequestSeen | ResponseSeen | None = None
        self._shown: list[str] = []

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {', '.join(self._shown)}>"

    def note(self, frame: RequestSeen | ResponseSeen) -> str:
        """Take the next frame; return what a verdict says of the log."""
        role: FrameRole = "request" if isinstance(frame, RequestSeen) else "response"
        before, self._last = self._last, frame
        if role == "request" and before is not None and (more := eight_times(before, frame)):
            self._shown = [f"{explain_pdu(frame.pdu, role).summary}: {more}"]
        elif len(self._shown) < _SIDE_SHOWN:
            what = "request to" if role == "request" else "response of"
            reserved = " (248 to 255 are reserved)" if frame.unit > HIGHEST_UNIT and frame.transaction is None else ""
            self._shown.append(f"{what} unit {frame.unit}{reserved}, {explain_pdu(frame.pdu, role).summary}")
        return ", ".join(self._shown)


def compared(data: bytes, seen: Iterable[Piece]) -> list[Finding]:
    """Return in what bytes that are no frame differ from the pieces of `seen`: bytes in front, or one too many."""
    for other in seen:
        if other.adu is None and frame_pdu("rtu", other.data + data) is not None:
            text = f"the rest of the frame that begins in line {other.line}: the reader ended it too early"
            return [Finding("cut-frame", text, f"the CRC fits: {shown_digits(other.data + data)}")]
        more = len(data) - len(other.data)
        if 0 < more <= STRAY and data.endswith(other.data):
            text = f"{counted(more)} before the bytes of line {other.line}: {shown_digits(data[:more])}"
            return [Finding("noise-before", text, shown_digits(data))]
        at = next((at for at, (here, there) in enumerate(zip(data, other.data)) if here != there), 0)
        rest = data[at + 1 :]
        if more in (0, 1) and at > 1 and len(rest) > STRAY and other.data[at:].startswith(rest):
            text = f"byte {at}, {data[at]:02X}h, is too many: without it these are the bytes of line {other.line}"
            cut = ", whose last one was not read" if more == 0 else ""
            return [Finding("byte-extra", text + cut, shown_digits(data))]
    return []


def turned(data: bytes) -> list[Finding]:
    """Return the finding on bytes that are a frame whose first bytes stand at the end: each read goes one too far, and
    lacks what the one before took. It is proved by all bytes, so that it is tried before a byte that may be missing."""
    for size in range(1, min(STRAY, len(data) - SHORTEST) + 1):
        whole = data[-size:] + data[:-size]
        if measure_response(whole[1:]) == len(whole) - 3 and crc16(whole) == 0:
            last = f"the last {counted(size)} read," if size > 1 else "the last byte read,"
            text = f"{last} {shown_digits(data[-size:])}, belongs before the others: the reader is out of step"
            summary = explain_pdu(whole[1:-2], "response").summary
            return [Finding("late-answer", text, f"{shown_digits(whole)} is a good frame: unit {whole[0]}, {summary}")]
    return []


def wrong_crc(data: bytes, role: FrameRole | None, any_values: bool = False) -> list[Finding]:
    """Return the finding on bytes that have the length of a whole frame of RTU, and not its CRC; without a known
    direction only if their values are allowed.

    >>> wrong_crc(bytes.fromhex("01 83 02 00 00"), "response")[0].text
    'a whole response by its length, whose CRC is 00 00, and C0 F1 fits'
    """
    body = data[:-2]
    for which, measure in _SIDES if len(body) > 1 and 0 < data[0] <= HIGHEST_UNIT else ():
        is_whole = role in (None, which) and measure(body[1:]) == len(body) - 1
        if is_whole and (role or any_values or good_body(body, which)):
            crc = crc16(body).to_bytes(2, "little")
            text = (
                f"a whole {which} by its length, whose CRC is {shown_digits(data[-2:])}, and {shown_digits(crc)} fits"
            )
            return [Finding("crc-wrong", text, shown_digits(data))]
    return []


def content(data: bytes) -> str:
    """Return bytes as the proof of a finding shows them; characters are a text of another protocol."""
    text = data.decode("latin-1").rstrip("\r\n")
    return shown_digits(data) + (
        f": the characters {text[:_SHOWN]!r}" if len(text) > STRAY and text.isprintable() else ""
    )


def unused_bits(request: bytes, response: bytes) -> Finding | None:
    """Return the finding on bits behind those that were asked: they are 0 [MB-APP 6.1]."""
    if request[0] not in (1, 2) or response[0] != request[0] or len(request) != 5:
        return None
    quantity = int.from_bytes(request[3:5], "big")
    spare = response[-1] >> (quantity % 8 or 8)
    if not spare:
        return None
    text = f"bits are set behind the {quantity} that {'was' if quantity == 1 else 'were'} asked; unused bits are 0"
    return Finding("wrong-value", text, f"the last byte is {response[-1]:02X}h: use only the lowest {quantity % 8}")


def eight_times(before: RequestSeen | ResponseSeen, request: RequestSeen | ResponseSeen) -> str:
    """Return what is odd about a request that reads eight times as many bits as the one before; empty if it does not.

    A program that takes the quantity for a number of bytes asks so.
    """
    is_alike = before.unit == request.unit and before.pdu[:3] == request.pdu[:3] and request.pdu[0] in (1, 2)
    fewer, more = (int.from_bytes(seen.pdu[3:5], "big") for seen in (before, request))
    if not is_alike or more != 8 * fewer or len(request.pdu) != 5:
        return ""
    return f"{more} bits are asked where {fewer} {'was' if fewer == 1 else 'were'}: the quantity counts bits, not bytes"


def read_otherwise(written: bytes, request: bytes, response: bytes) -> Finding | None:
    """Return the finding on a coil that is read, directly after it was written, as the other of its two values.

    >>> read_otherwise(bytes.fromhex("05 000A FF00"), bytes.fromhex("01 0000 0010"), bytes.fromhex("01 02 04 00")).text
    'coil 10 was switched on, and is read as off: coil 2 is on'
    """
    coil, is_on = int.from_bytes(written[1:3], "big"), written[3:4] == b"\xff"
    first, values = int.from_bytes(request[1:3], "big"), int.from_bytes(response[2:], "little")
    if request[:1] != b"\x01" or response[:1] != b"\x01" or not 0 <= coil - first < int.from_bytes(request[3:5], "big"):
        return None
    if bool(values >> coil - first & 1) is is_on:
        return None
    words = ("off", "on")
    on = [str(first + bit) for bit in range(values.bit_length()) if values >> bit & 1]
    listed = f"coil {', '.join(on[:STRAY])}{' ...' if len(on) > STRAY else ''} is on" if on else "no coil is on"
    text = f"coil {coil} was switched {words[is_on]}, and is read as {words[not is_on]}: {listed}"
    return Finding("wrong-value", text, f"{shown_digits(written)}, then {shown_digits(response)}")


def long_exception(pdu: bytes) -> Finding | None:
    """Return the finding on an exception with more than its code [MB-APP 7].

    >>> long_exception(bytes.fromhex("90 02 00")).text
    '1 byte behind the code of an exception, which has no more'
    """
    if not pdu[0] & EXCEPTION_BIT or len(pdu) <= 2:
        return None
    more = counted(len(pdu) - 2)
    proof = f"the checksum fits over {shown_digits(pdu)}: {explain_pdu(pdu[:2], 'response').summary}"
    return Finding("byte-extra", f"{more} behind the code of an exception, which has no more", proof)
