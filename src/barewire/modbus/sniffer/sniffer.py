"""Listening in: what a client and its units say on a line that we take no part in, put together to exchanges.

    heard    | 01 request | 01 response | 02 request |      1 s of silence     | 02 response | noise | 03 response |
    told       Asked        Answered      Asked        Unanswered                Answered(to=None)     Answered(to=None)

Nothing on a serial line says which way a frame goes. In this order:

    shape    most messages are either a request or a response: their lengths differ, and so do exceptions
    fit      an answer fits the question before it: unit, function, byte count, echoed fields
    time     a write is answered with its own bytes. Of three equal frames the two that are nearer to each other belong
             together, unless the unit is known to be slower than that; a single one is an `AmbiguousFrame`

So a frame that is lost, on the line or to us, never shifts the pairs that follow. What is assumed: one client, and one
question at a time. An answer that comes when the next unit has been asked already is told as `late`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

from barewire.errors import DecodeError, EncodeError
from barewire.modbus.adu import BROADCAST, Adu, Noise
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.framing import Line
from barewire.modbus.messages.base import EXCEPTION_BIT, Request, Response
from barewire.modbus.messages.registry import decode_request, decode_response, measure_request, measure_response

WINDOW = 1.0
"""Seconds after a question in which its answer may come."""

_SLOWER = 1.5
_JITTER = 0.005
"""A unit that was never slower than t may take this much longer: t * 1.5 + 5 ms."""


class RequestSeen(NamedTuple):
    """A request, heard at `at`. `message` is None for what nobody here can read. Unit 0 is a broadcast."""

    unit: int
    pdu: bytes
    at: float
    message: Request[Any] | None = None
    transaction: int | None = None


class ResponseSeen(NamedTuple):
    """A response. `to` is its request, None if that was not heard; `late` if the client had given it up by then."""

    unit: int
    pdu: bytes
    at: float
    message: Response | None = None
    request: RequestSeen | None = None
    late: bool = False
    transaction: int | None = None

    @property
    def seconds(self) -> float | None:
        """From the end of the request to the end of the response."""
        return None if self.request is None else self.at - self.request.at


class ResponseMissing(NamedTuple):
    """The request that got no answer, told `at` the time when that was certain."""

    request: RequestSeen
    at: float


class AmbiguousFrame(NamedTuple):
    """A frame that can be a request or its echo, heard once: the other one was lost, and nothing says which."""

    unit: int
    pdu: bytes
    at: float
    message: Request[Any] | None = None


class NoiseSeen(NamedTuple):
    """Bytes that are no frame."""

    noise: Noise
    at: float


SnifferEvent: TypeAlias = RequestSeen | ResponseSeen | ResponseMissing | AmbiguousFrame | NoiseSeen


class Sniffer:
    """A machine around a line in the role of a listener. `window` is the longest time, in seconds, to an answer.

    >>> from barewire.rtu import RtuLine, Timing, encode
    >>> sniffer = Sniffer(RtuLine(Timing.of(19200), role="listener"))
    >>> asked, answer = encode(1, bytes.fromhex("0300000001")), encode(1, bytes.fromhex("03020017"))
    >>> [type(event).__name__ for event in sniffer.feed(asked, 1.0) + sniffer.feed(answer, 1.25)]
    ['RequestSeen', 'ResponseSeen']
    >>> sniffer.feed(answer, 1.5)[0].request is None
    True

    It remembers one question, one that was given up, and how slow each unit has been: never more.
    """

    def __init__(self, line: Line, *, window: float = WINDOW) -> None:
        if not window > 0:
            raise EncodeError(f"window {window}: expected seconds, above 0", "window")
        self.line = line
        self._window = window
        self._asked: RequestSeen | None = None  # told, and not answered yet
        self._late: RequestSeen | None = None  # given up by the client, which asked the next one
        self._half: AmbiguousFrame | None = None  # not told: it may be a request or an echo
        self._pair: tuple[AmbiguousFrame, AmbiguousFrame] | None = (
            None  # not told: a third one may be nearer to the second
        )
        self._slowest: dict[int, float] = {}

    @property
    def deadline(self) -> float | None:
        """When to feed None if nothing came."""
        if self.line.held:
            return self.line.deadline  # what lies there may be the answer: nothing expires before it is decided
        times: list[float] = []
        if self._asked is not None:
            times.append(self._asked.at + self._window)
        if self._half is not None:
            times.append(self._half.at + self._window)
        if self._pair is not None:
            times.append(2 * self._pair[1].at - self._pair[0].at)
        return min(times, default=None)

    def feed(self, data: bytes | None, now: float) -> list[SnifferEvent]:
        """Bytes that came, the last of them at `now`, or None: nothing came until then. Never raises."""
        told: list[SnifferEvent] = []
        for event in self.line.feed(data, now):
            if isinstance(event, Noise):
                told.append(NoiseSeen(event, now))
            else:
                told += self._frame(event, now)
        # What still lies in the line was on its way before the time was up.
        if not self.line.held:
            told += self._expire(now)
        return told

    def end(self, now: float) -> list[SnifferEvent]:
        """Nothing more will come: whatever is held is told."""
        told = self.feed(None, max(now, self.line.deadline or now))
        return told + self._give_up(now)

    # Time

    def _expire(self, now: float) -> list[SnifferEvent]:
        if self._asked is not None and now >= self._asked.at + self._window:
            told, self._asked, self._late = [ResponseMissing(self._asked, now)], None, None
            return list[SnifferEvent](told)
        if self._pair is not None and now >= 2 * self._pair[1].at - self._pair[0].at:
            return self._settle()
        if self._half is not None and now >= self._half.at + self._window:
            return self._give_up(now)
        return []

    def _give_up(self, now: float) -> list[SnifferEvent]:
        """Somebody speaks anew, or never again: what waits for its other half waits no more."""
        told = self._settle()
        if self._half is not None:
            told.append(self._half)
        if self._asked is not None:
            told.append(ResponseMissing(self._asked, now))
        self._late, self._asked, self._half = self._asked, None, None
        return told

    def _settle(self) -> list[SnifferEvent]:
        """The two equal frames are a request and its answer."""
        if self._pair is None:
            return []
        (first, second), self._pair = self._pair, None
        asked = RequestSeen(first.unit, first.pdu, first.at, first.message)
        return [asked, ResponseSeen(second.unit, second.pdu, second.at, readable(decode_response, second.pdu), asked)]

    # Frames

    def _frame(self, adu: Adu, now: float) -> list[SnifferEvent]:
        unit, pdu = adu.unit, adu.pdu
        request, response = shapes(pdu)
        if unit == BROADCAST:
            return [*self._give_up(now), RequestSeen(unit, pdu, now, readable(decode_request, pdu))]
        asked = self._asked
        if response and asked is not None and now <= asked.at + self._window and _answers(asked, unit, pdu):
            self._asked = self._late = None
            self._learn(unit, now - asked.at)
            return [ResponseSeen(unit, pdu, now, readable(decode_response, pdu), asked)]
        if request and response:
            return self._either(AmbiguousFrame(unit, pdu, now, readable(decode_request, pdu)))
        if request:
            told = self._give_up(now)
            self._asked = RequestSeen(unit, pdu, now, readable(decode_request, pdu))
            return [*told, self._asked]
        return self._stray(unit, pdu, now)

    def _stray(self, unit: int, pdu: bytes, now: float) -> list[SnifferEvent]:
        """A response, and not to the question that is open."""
        message = readable(decode_response, pdu)
        late, half = self._late, self._half
        if late is not None and now <= late.at + self._window and _answers(late, unit, pdu):
            self._late = None
            return [ResponseSeen(unit, pdu, now, message, late, late=True)]
        # An exception declines a write that was heard as a half.
        if half is not None and self._pair is None and now <= half.at + self._window:
            asked = RequestSeen(half.unit, half.pdu, half.at, half.message)
            if _answers(asked, unit, pdu):
                self._half = None
                self._learn(unit, now - half.at)
                return [asked, ResponseSeen(unit, pdu, now, message, asked)]
        return [*self._give_up(now), ResponseSeen(unit, pdu, now, message)]

    def _either(self, heard: AmbiguousFrame) -> list[SnifferEvent]:
        """A frame that can be a request or its echo."""
        if self._pair is not None:
            first, second = self._pair
            if _twins(second, heard) and heard.at - second.at < second.at - first.at:
                # Nearer to the second than the first was: so the first one lost its other half.
                self._pair = second, heard
                return [first]
            return [*self._settle(), *self._either(heard)]
        half = self._half
        if half is None or heard.at > half.at + self._window or not _twins(half, heard):
            told = self._give_up(heard.at)
            self._half = heard
            return told
        self._half, self._pair = None, (half, heard)
        slowest = self._slowest.get(heard.unit)
        if slowest is not None and heard.at - half.at <= _SLOWER * slowest + _JITTER:
            return self._settle()
        return []

    def _learn(self, unit: int, seconds: float) -> None:
        """A unit's slowest answer, slowly forgotten."""
        self._slowest[unit] = max(seconds, 0.9 * self._slowest.get(unit, 0.0))


def shapes(pdu: bytes) -> tuple[bool, bool]:
    """Whether a PDU can be a request, and whether it can be a response; at least one of them.

    >>> shapes(bytes.fromhex("0300000001")), shapes(bytes.fromhex("8302")), shapes(bytes.fromhex("0600010003"))
    ((True, False), (False, True), (True, True))
    """
    if pdu[0] & EXCEPTION_BIT:
        return False, True
    reads = readable(decode_request, pdu) is not None, readable(decode_response, pdu) is not None
    if any(reads):
        return reads
    # A wrong value in it is more usual than a wrong length; and functions that nobody knows can be both.
    measures = measure_request(pdu) == len(pdu), measure_response(pdu) == len(pdu)
    return measures if any(measures) else (True, True)


def fits(request: Request[Any] | None, asked: bytes, pdu: bytes) -> bool:
    """Whether a PDU answers a request; of one that nobody can read, the function code must do."""
    if pdu[:1] == bytes([asked[0] | EXCEPTION_BIT]):
        return True
    if request is None:
        return pdu[:1] == asked[:1]
    try:
        request.read_response(pdu)
    except ModbusException:
        return True
    except DecodeError:
        return False
    return True


def _answers(asked: RequestSeen, unit: int, pdu: bytes) -> bool:
    return unit == asked.unit and fits(asked.message, asked.pdu, pdu)


def _twins(first: AmbiguousFrame, second: AmbiguousFrame) -> bool:
    """Whether one can be the answer to the other: its echo, or of a function that nobody knows anything."""
    return first.unit == second.unit and fits(first.message, first.pdu, second.pdu)


def readable(decode: Callable[[bytes], Any], pdu: bytes) -> Any:
    """The message, or None for what is none."""
    try:
        return decode(pdu)
    except DecodeError:
        return None
