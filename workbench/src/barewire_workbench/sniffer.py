"""Sniffers: machines that pair the requests and responses of other stations, and never send.

**On a serial line**, `Sniffer`:

    on the line   01 request    01 response    02 request    1 s of silence    02 response     noise      03 response
    event         RequestSeen   ResponseSeen   RequestSeen   ResponseMissing   ResponseSeen*   NoiseSeen  ResponseSeen*

    * with `request` None: its request is over, or was not received

Frames on a serial line do not show their direction. Three criteria decide about it, in this order:

    shape    most PDUs can only be a request or only a response: their lengths differ, and exceptions are responses
    fit      a response fits the request before it: unit, function, byte count, echoed fields
    time     the response to a single write has the same bytes as the request. Of three equal frames, the two that are
             nearer to each other are a pair, unless the unit is known to be slower; a single one is an `AmbiguousFrame`

So a lost frame never shifts the pairs after it. The sniffer assumes one client with one open request at a time. A
response that arrives when the client has already sent its next request is marked `late`. One that fits both requests
waits for the next frame: if that is a second response, the first one is the late one, since a unit answers in order.
Otherwise it answers the newer request, and names the `older` one.

**On a TCP connection**, `NumberedSniffer`: responses carry the transaction number of their request, and have to fit it
all the same. To one that does not no request belongs, and the request stays open.

    client ->   1 03 00 00 00 02        RequestSeen(transaction=1)
    client ->   2 06 00 01 00 03        RequestSeen(transaction=2)
           <-   2 06 00 01 00 03        ResponseSeen(transaction=2)
           <-   1 03 04 ...             ResponseSeen(transaction=1)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, TypeAlias

from barewire.errors import DecodeError, EncodeError
from barewire.modbus.adu import BROADCAST, Adu, Noise
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.messages.base import EXCEPTION_BIT, Request, Response
from barewire.modbus.messages.registry import decode_request, decode_response, measure_request, measure_response

WINDOW = 1.0
"""Seconds after a request in which its response may come."""

OPEN_LIMIT = 256
"""The most open requests; beyond that the oldest one is reported as unanswered."""

LATE_AFTER = 10.0
"""Seconds after a request in which a late response to it may come."""

_SHORTEST_RESPONSE = 4
"""Bytes; fewer ones are noise of the line and not a damaged response."""
_SLOWER = 1.5
_JITTER = 0.005
"""A response may take this much longer than the slowest one, t, of its unit so far: t * 1.5 + 5 ms."""


class HeardLine(Protocol):
    """What a sniffer needs of a `Line`: it never sends."""

    @property
    def deadline(self) -> float | None:
        """When to feed None if nothing arrived."""

    @property
    def held(self) -> bytes:
        """The bytes that are neither a frame nor noise yet."""

    def feed(self, data: bytes | None, now: float) -> Sequence[Adu | Noise]:
        """Take bytes, and return the frames and the noise in them."""


class RequestSeen(NamedTuple):
    """A request, received at `at`. `message` is None if it cannot be decoded. Unit 0 is a broadcast."""

    unit: int
    pdu: bytes
    at: float
    message: Request[Any] | None = None
    transaction: int | None = None


class ResponseSeen(NamedTuple):
    """A response. `request` is None if it was not received; `late`: the client had sent its next request by then.

    `older` is an earlier request, for something else and without a response, that this response fits as well.
    """

    unit: int
    pdu: bytes
    at: float
    message: Response | None = None
    request: RequestSeen | None = None
    late: bool = False
    transaction: int | None = None
    older: RequestSeen | None = None

    @property
    def seconds(self) -> float | None:
        """The time from the end of the request to the end of the response."""
        return None if self.request is None else self.at - self.request.at


class ResponseMissing(NamedTuple):
    """A request without a response. `at` is the time when this became certain."""

    request: RequestSeen
    at: float


class RecordingEnds(NamedTuple):
    """A request without a response when the recording ends at `at`: the time for its response was not over."""

    request: RequestSeen
    at: float


class AmbiguousFrame(NamedTuple):
    """A frame that can be a request or the equal response to it. It was received once: the other one was lost."""

    unit: int
    pdu: bytes
    at: float
    message: Request[Any] | None = None


class NoiseSeen(NamedTuple):
    """Bytes that are not a frame."""

    noise: Noise
    at: float


SnifferEvent: TypeAlias = RequestSeen | ResponseSeen | ResponseMissing | RecordingEnds | AmbiguousFrame | NoiseSeen


class Sniffer:
    """A machine for a serial line with the role of a listener. `window` is the longest response time, in seconds.

    >>> from barewire.rtu import RtuLine, Timing, encode
    >>> sniffer = Sniffer(RtuLine(Timing.of(19200), role="listener"))
    >>> asked, answer = encode(1, bytes.fromhex("0300000001")), encode(1, bytes.fromhex("03020017"))
    >>> [type(event).__name__ for event in sniffer.feed(asked, 1.0) + sniffer.feed(answer, 1.25)]
    ['RequestSeen', 'ResponseSeen']
    >>> sniffer.feed(answer, 1.5)[0].request is None
    True

    Its memory is bounded: two requests, three undecided frames, the noise after these, and one time for each unit.
    """

    def __init__(self, line: HeardLine, *, window: float = WINDOW) -> None:
        if not window > 0:
            raise EncodeError(f"window {window}: expected seconds, above 0", "window")
        self.line = line
        self._window = window
        self._open: RequestSeen | None = None  # reported, and not answered yet
        self._late: RequestSeen | None = None  # an earlier request, without a response
        self._damaged: RequestSeen | None = None  # the last request behind which a damaged response came
        self._doubtful: ResponseSeen | None = None  # not reported yet: it fits both of them
        self._single: AmbiguousFrame | None = None  # not reported yet: a request or an echo
        # Two equal frames, not reported yet: a third one may be nearer to the second.
        self._pair: tuple[AmbiguousFrame, AmbiguousFrame] | None = None
        self._slowest: dict[int, float] = {}
        self._noise: list[NoiseSeen] = []  # later than an undecided frame
        self._from_client: bool | None = None  # the direction of the last bytes, also of those that are still held

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.line!r}>"

    @property
    def deadline(self) -> float | None:
        """When to feed None if nothing arrived."""
        if self.line.held:
            return self.line.deadline  # the held bytes may be the response, so nothing expires before they are decided
        times: list[float] = []
        if self._open is not None:
            times.append(self._open.at + self._window)
        if self._single is not None:
            times.append(self._single.at + self._window)
        if self._pair is not None:
            times.append(2 * self._pair[1].at - self._pair[0].at)
        return min(times, default=None)

    def feed(self, data: bytes | None, now: float, from_client: bool | None = None) -> list[SnifferEvent]:
        """Return the events of bytes that arrived, the last at `now`, or of time that passed (None). Never raises.

        `from_client` is the direction of the bytes, if the recording states it; a frame that can only be of the other
        direction is taken as what it is."""
        if data:
            self._from_client = from_client
        return self._take(self.line.feed(data, now), now)

    def turn(self, now: float) -> list[SnifferEvent]:
        """End the held bytes: the other station begins at `now`, however short the silence was."""
        return self._take(self.line.feed(None, self.line.deadline or now), now)

    def _take(self, heard: Sequence[Adu | Noise], now: float) -> list[SnifferEvent]:
        events: list[SnifferEvent] = []
        for event in heard:
            events += self._frame(event, now) if isinstance(event, Adu) else self._heard_noise(NoiseSeen(event, now))
        # Held bytes were sent before the window was over.
        if not self.line.held:
            events += self._expire(now)
        return self._in_order(events)

    def end(self, now: float) -> list[SnifferEvent]:
        """End the recording, and return the events of everything that is still undecided."""
        events = self.feed(None, max(now, self.line.deadline or now)) + self._settle_answer()
        if self._open is not None and now < self._open.at + self._window:
            ends, self._open = RecordingEnds(self._open, now), None
            return self._in_order([*events, *self._give_up(now), ends])
        return self._in_order(events + self._give_up(now))

    def give_up(self, now: float) -> list[SnifferEvent]:
        """Return the open request as unanswered: the recording itself says that no response came."""
        return self._in_order(self._give_up(now))

    @property
    def _is_undecided(self) -> bool:
        """Whether a frame was received that is not reported yet."""
        return self._single is not None or self._pair is not None or self._doubtful is not None

    def _heard_noise(self, noise: NoiseSeen) -> list[SnifferEvent]:
        """Return the noise, and what it has to wait for if that is too much."""
        if len(noise.noise.data) >= _SHORTEST_RESPONSE:
            self._damaged = self._open
        if not self._is_undecided:
            return [noise]
        self._noise.append(noise)
        return self._give_up(noise.at) if len(self._noise) > OPEN_LIMIT else []

    def _in_order(self, events: list[SnifferEvent]) -> list[SnifferEvent]:
        """Return the events and the noise that waited for them, by their times."""
        if self._noise and not self._is_undecided:
            events, self._noise = sorted([*events, *self._noise], key=lambda event: event.at), []
        return events

    # Time

    def _expire(self, now: float) -> list[SnifferEvent]:
        if self._open is not None and now >= self._open.at + self._window:
            if self._doubtful is not None:
                return self._settle_answer()
            missing = ResponseMissing(self._open, now)
            self._late, self._open = self._open, None
            return [missing]
        if self._pair is not None and now >= 2 * self._pair[1].at - self._pair[0].at:
            return self._settle()
        if self._single is not None and now >= self._single.at + self._window:
            return self._give_up(now)
        return []

    def _give_up(self, now: float) -> list[SnifferEvent]:
        """Close everything that waits for a response, because a new request was sent or the recording ends."""
        events = [*self._settle_answer(), *self._settle()]
        if self._single is not None:
            events.append(self._single)
        if self._open is not None:
            events.append(ResponseMissing(self._open, now))
            self._late = self._open
        self._open = self._single = None
        return events

    def _settle(self) -> list[SnifferEvent]:
        """Report the two equal frames as a request and its response."""
        if self._pair is None:
            return []
        (first, second), self._pair = self._pair, None
        asked = RequestSeen(first.unit, first.pdu, first.at, first.message)
        return [asked, ResponseSeen(second.unit, second.pdu, second.at, readable(decode_response, second.pdu), asked)]

    def _settle_answer(self) -> list[SnifferEvent]:
        """Report the response that fits two requests as that to the newer one."""
        answer, self._doubtful = self._doubtful, None
        if answer is None:
            return []
        self._open = self._late = None
        return [answer]

    # Frames

    def _frame(self, adu: Adu, now: float) -> list[SnifferEvent]:
        unit, pdu = adu.unit, adu.pdu
        request, response = shapes(pdu)
        if request and response and self._from_client is not None:
            request, response = self._from_client, not self._from_client
        if unit == BROADCAST:
            return [*self._give_up(now), RequestSeen(unit, pdu, now, readable(decode_request, pdu))]
        asked = self._open
        if self._from_client is False and not response and asked is not None and readable(decode_request, pdu) is None:
            request, response = False, True  # of a server: what has the length of a request, and is none
        if response and asked is not None and now <= asked.at + self._window and answers(asked, unit, pdu):
            return self._answer(ResponseSeen(unit, pdu, now, readable(decode_response, pdu), asked), asked)
        events = self._settle_answer()
        if request and response:
            return [*events, *self._either(AmbiguousFrame(unit, pdu, now, readable(decode_request, pdu)))]
        if request:
            events += self._give_up(now)
            self._open = RequestSeen(unit, pdu, now, readable(decode_request, pdu))
            return [*events, self._open]
        return [*events, *self._stray(unit, pdu, now)]

    def _answer(self, answer: ResponseSeen, asked: RequestSeen) -> list[SnifferEvent]:
        """Report the response to the open request, unless it fits an earlier one as well: the next frame decides."""
        first, late = self._doubtful, self._late
        if first is not None and late is not None:
            self._open = self._late = self._doubtful = None
            return [first._replace(request=late, late=True, older=None), answer]
        is_awaited = late is not None and late is not self._damaged and answer.at <= late.at + LATE_AFTER
        if late is not None and is_awaited and answers(late, answer.unit, answer.pdu):
            # The values are those of either request, if both ask the same.
            self._doubtful = answer._replace(older=late if late.pdu != asked.pdu else None)
            return []
        self._open = None
        if late is not None and answer.at > late.at + self._window:
            self._late = None  # before that its response may still come, if there are two masters
        self._note_time(answer.unit, answer.at - asked.at)
        return [answer]

    def _stray(self, unit: int, pdu: bytes, now: float) -> list[SnifferEvent]:
        """Report a response that does not answer the open request."""
        message = readable(decode_response, pdu)
        late, single = self._late, self._single
        # Before the end of its window a request is given up only for the next one.
        if late is not None and now < late.at + self._window and answers(late, unit, pdu):
            self._late = None
            return [ResponseSeen(unit, pdu, now, message, late, late=True)]
        # An exception response to a write that is still an ambiguous frame.
        if single is not None and self._pair is None and now <= single.at + self._window:
            asked = RequestSeen(single.unit, single.pdu, single.at, single.message)
            if answers(asked, unit, pdu):
                self._single = None
                self._note_time(unit, now - single.at)
                return [asked, ResponseSeen(unit, pdu, now, message, asked)]
        return [*self._give_up(now), ResponseSeen(unit, pdu, now, message)]

    def _either(self, frame: AmbiguousFrame) -> list[SnifferEvent]:
        """Take a frame that can be a request or the equal response to it."""
        if self._pair is not None:
            first, second = self._pair
            if _twins(second, frame) and frame.at - second.at < second.at - first.at:
                # The frame is nearer to the second than the first is, so the response to the first was lost.
                self._pair = second, frame
                return [first]
            return [*self._settle(), *self._either(frame)]
        single = self._single
        if single is None or frame.at > single.at + self._window or not _twins(single, frame):
            events = self._give_up(frame.at)
            self._single = frame
            return events
        self._single, self._pair = None, (single, frame)
        slowest = self._slowest.get(frame.unit)
        if slowest is not None and frame.at - single.at <= _SLOWER * slowest + _JITTER:
            return self._settle()
        return []

    def _note_time(self, unit: int, seconds: float) -> None:
        """Keep the slowest response time of a unit; it decays by a tenth with each response."""
        self._slowest[unit] = max(seconds, 0.9 * self._slowest.get(unit, 0.0))


class NumberedSniffer:
    """A machine for the two directions of one connection, each with its own line. `window` as in `Sniffer`.

    >>> from barewire.tcp import TcpLine, encode
    >>> sniffer = NumberedSniffer(TcpLine(), TcpLine())
    >>> sniffer.feed(True, encode(1, bytes.fromhex("0600010003"), 7), 1.0)[0].transaction
    7
    >>> sniffer.feed(False, encode(1, bytes.fromhex("8602"), 7), 1.5)[0].seconds
    0.5
    """

    def __init__(self, client: HeardLine, server: HeardLine, *, window: float = WINDOW) -> None:
        self._lines = {True: client, False: server}
        self._window = window
        self._open: dict[int | None, RequestSeen] = {}

    def feed(self, from_client: bool, data: bytes, now: float) -> list[SnifferEvent]:
        """Return the events of bytes of one direction, received at `now`. Never raises."""
        events: list[SnifferEvent] = [*self.wait(now)]
        for event in self._lines[from_client].feed(data, now):
            if isinstance(event, Noise):
                events.append(NoiseSeen(event, now))
                continue
            unit, pdu, number = event
            if from_client:
                asked = RequestSeen(unit, pdu, now, readable(decode_request, pdu), number)
                earlier = self._open.pop(number, None)
                events += [asked] if earlier is None else [ResponseMissing(earlier, now), asked]
                self._open[number] = asked
            else:
                request = self._open.get(number)
                if request is not None and answers(request, unit, pdu):
                    del self._open[number]
                else:
                    request = None
                events.append(ResponseSeen(unit, pdu, now, readable(decode_response, pdu), request, transaction=number))
        while len(self._open) > OPEN_LIMIT:
            events.append(ResponseMissing(self._open.pop(next(iter(self._open))), now))
        return events

    @property
    def deadline(self) -> float | None:
        """When the time of an open request is over; None if none is open."""
        return min(asked.at for asked in self._open.values()) + self._window if self._open else None

    def end(self, now: float) -> list[SnifferEvent]:
        """End the recording: an open request is unanswered, or its time was not over."""
        missing = self.wait(now)
        ends = [RecordingEnds(request, now) for request in self._open.values()]
        self._open.clear()
        return [*missing, *ends]

    def give_up(self, now: float) -> list[ResponseMissing]:
        """Return the open requests as unanswered: the recording itself says that no response came."""
        return self._expire(float("inf"), now)

    def wait(self, now: float) -> list[ResponseMissing]:
        """Return the requests whose time is over at `now`."""
        return self._expire(now - self._window, now)

    def _expire(self, before: float, now: float) -> list[ResponseMissing]:
        expired = [number for number, asked in self._open.items() if asked.at < before]
        return [ResponseMissing(self._open.pop(number), now) for number in expired]


def shapes(pdu: bytes) -> tuple[bool, bool]:
    """Whether a PDU can be a request, and whether it can be a response; at least one of them.

    >>> shapes(bytes.fromhex("0300000001")), shapes(bytes.fromhex("8302")), shapes(bytes.fromhex("0600010003"))
    ((True, False), (False, True), (True, True))
    """
    if pdu[0] & EXCEPTION_BIT:
        return False, True
    decodable = readable(decode_request, pdu) is not None, readable(decode_response, pdu) is not None
    if any(decodable):
        return decodable
    # A wrong value is more likely than a wrong length. An unknown function can be both.
    measures = measure_request(pdu) == len(pdu), measure_response(pdu) == len(pdu)
    return measures if any(measures) else (True, True)


def _fits(request: Request[Any] | None, asked: bytes, pdu: bytes) -> bool:
    """Whether `pdu` answers the request `asked`. If `asked` could not be decoded, the function code alone decides."""
    if request is None:
        return pdu[0] & ~EXCEPTION_BIT == asked[0]
    try:
        request.read_response(pdu)
    except ModbusException:
        return True
    except DecodeError:
        return False
    return True


def answers(asked: RequestSeen, unit: int, pdu: bytes) -> bool:
    """Whether a PDU from this unit is the response to a request: by unit, function, length and echoed fields."""
    return unit == asked.unit and _fits(asked.message, asked.pdu, pdu)


def _twins(first: AmbiguousFrame, second: AmbiguousFrame) -> bool:
    """Whether the second can be the response to the first: an equal frame, or any frame of an unknown function."""
    return first.unit == second.unit and _fits(first.message, first.pdu, second.pdu)


def readable(decode: Callable[[bytes], Any], pdu: bytes) -> Any:
    """Return the message, or None if the PDU cannot be decoded."""
    try:
        return decode(pdu)
    except DecodeError:
        return None
