"""Learns what the units of a line answer, from the events of a sniffer.

The events that it learns from:

    RequestSeen    ResponseSeen            one exchange, after the time between the two
    RequestSeen    ResponseMissing         one exchange without an answer
                   ResponseSeen (late)     ... which came after all, when the client had given up

What was recorded of a line: its units, the requests to each, and the answers to each request, in order.

    RecordedLine
      '- RecordedUnit(address=7)
           |- RecordedRequest(read="holding:0", quantity=2)    12 times, every 1.0 s
           |     values 23 7      9 times from 0.0 s on, after 12 ms
           |     values 24 7      2 times from 9.0 s on, after 12 ms
           |     exception 06     at 11.0 s, after 300 ms
           '- RecordedRequest(write="holding:1", function=6)   once
                 wrote 3, done    at 2.0 s, after 15 ms

Equal answers in a row are one `RecordedAnswer` with a number of times.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from typing import NamedTuple

from barewire.errors import BarewireError, EncodeError
from barewire.modbus.adu import BROADCAST
from barewire.modbus.exceptions import ModbusException
from barewire.modbus.sniffer import (
    NoiseSeen,
    RecordingEnds,
    RequestSeen,
    ResponseMissing,
    ResponseSeen,
    SnifferEvent,
)

READS = {1: "coil", 2: "discrete", 3: "holding", 4: "input"}
"""Function code -> the table that it reads."""
WRITES = {5: "coil", 6: "holding", 15: "coil", 16: "holding"}
"""Function code -> the table that it writes."""


@dataclass(slots=True)
class RecordedAnswer:
    """An answer, and how often it came in a row. At most one of values, exception, silent and pdu is given.

    at, until    when the first and the last request of the row were sent, in seconds from the start of the recording
    times        how many answers
    latency      seconds from the request to the answer
    values       what was read; bits are 0 and 1
    wrote        what the request wrote
    exception    the exception code
    silent       there was no answer
    pdu          any other answer

    Without the last four it is the usual answer to a write: done.
    """

    at: float = 0.0
    until: float = 0.0
    times: int = 1
    latency: float = 0.0
    values: tuple[int, ...] | None = None
    wrote: tuple[int, ...] | None = None
    exception: int | None = None
    silent: bool = False
    pdu: bytes | None = None

    @property
    def content(self) -> tuple[object, ...]:
        """What is equal in the answers of a row."""
        return self.values, self.wrote, self.exception, self.silent, self.pdu

    def time_of(self, place: int) -> float:
        """Return when the request with this place in the row, from 0 on, was sent, as if all were equally spaced."""
        return self.at if self.times < 2 else self.at + place * (self.until - self.at) / (self.times - 1)


@dataclass(slots=True)
class RecordedRequest:
    """A request, and its answers. Reads and writes have a place; any other function has its `pdu`.

    function     the function code
    table        "coil", "discrete", "holding" or "input"; empty for other functions
    period       the median time between two of these requests in seconds, 0 if there was one
    left_out     answers that are not in `answers`, because there were too many
    """

    function: int
    table: str = ""
    address: int = 0
    quantity: int = 0
    pdu: bytes = b""
    period: float = 0.0
    answers: list[RecordedAnswer] = field(default_factory=list)
    left_out: int = 0

    @property
    def count(self) -> int:
        """How often it was sent."""
        return sum(answer.times for answer in self.answers) + self.left_out


@dataclass(slots=True)
class RecordedUnit:
    """A unit address, and the requests to it."""

    address: int
    requests: list[RecordedRequest] = field(default_factory=list)

    def answers(self) -> Iterator[RecordedAnswer]:
        """Yield all answers."""
        for request in self.requests:
            yield from request.answers

    @property
    def latency(self) -> float:
        """The median of the latencies of its answers, in seconds."""
        return median([answer.latency for answer in self.answers() if not answer.silent] or [0.0])


@dataclass(slots=True)
class RecordedLine:
    """The units of a line by address, and what was not understood."""

    units: dict[int, RecordedUnit] = field(default_factory=dict)
    seconds: float = 0.0
    """From the first frame to the last one."""
    broadcasts: int = 0
    strays: int = 0
    """Responses without their request, and frames that can be a request or a response."""
    noise: int = 0
    """Pieces of noise: damaged frames."""


ANSWERS_LIMIT = 1000
"""The most rows of equal answers that are kept for one request."""

_SAME_LATENCY = 0.02
"""Seconds: answers of one row differ less than this in their latency, or less than by half."""


class _Exchange(NamedTuple):
    request: RequestSeen
    response: ResponseSeen | None


def learn_line(events: Iterable[SnifferEvent], *, limit: int = ANSWERS_LIMIT) -> RecordedLine:
    """Return what the events of a sniffer show of each unit. `limit`: the most rows of answers to one request.

    >>> from barewire.modbus import ReadHoldingRegisters
    >>> asked = RequestSeen(7, bytes.fromhex("0300000001"), 1.0, ReadHoldingRegisters(0, 1))
    >>> line = learn_line([asked, ResponseSeen(7, bytes.fromhex("03020017"), 1.25, None, asked)])
    >>> line.units[7].requests[0].answers[0].values
    (23,)

    Raises EncodeError for a limit below 1.
    """
    if limit < 1:
        raise EncodeError(f"limit {limit}: expected a number of answers, from 1 on", "limit")
    line = RecordedLine()
    exchanges: dict[int, _Exchange] = {}  # by the identity of the request, which it keeps alive
    times: list[float] = []
    for event in events:
        times.append(event.at)
        match event:
            case ResponseSeen(request=RequestSeen() as request):
                exchanges[id(request)] = _Exchange(request, event)
            case ResponseMissing(request=request):
                exchanges[id(request)] = _Exchange(request, None)
            case RecordingEnds():
                pass  # nobody knows what its answer would have been
            case RequestSeen(unit=address, transaction=transaction):
                line.broadcasts += address == BROADCAST and transaction is None
            case NoiseSeen():
                line.noise += 1
            case _:
                line.strays += 1
    if not times:
        return line
    start = min(times)
    line.seconds = max(times) - start
    by_request: dict[int, dict[tuple[object, ...], list[_Exchange]]] = {}
    for exchange in sorted(exchanges.values(), key=lambda found: found.request.at):
        request = exchange.request
        by_request.setdefault(request.unit, {}).setdefault(_place(request), []).append(exchange)
    for address, requests in sorted(by_request.items()):
        unit = RecordedUnit(address)
        for place, found in requests.items():
            unit.requests.append(_learned(place, found, start, limit))
        line.units[address] = unit
    return line


def _place(request: RequestSeen) -> tuple[object, ...]:
    """Return what requests have in common whose answers are one sequence: function, address and quantity, or all."""
    message, function = request.message, request.pdu[0]
    if message is None or function not in READS | WRITES:
        return (request.pdu,)
    return function, message.address, getattr(message, "quantity", 1)  # type: ignore[attr-defined]  # these have one


def _learned(place: tuple[object, ...], exchanges: list[_Exchange], start: float, limit: int) -> RecordedRequest:
    pdu = exchanges[0].request.pdu
    found = RecordedRequest(pdu[0], pdu=pdu)
    if len(place) > 1:
        _, address, quantity = place
        table = READS.get(pdu[0]) or WRITES[pdu[0]]
        found = RecordedRequest(pdu[0], table, int(str(address)), int(str(quantity)))
    rows: list[list[RecordedAnswer]] = []
    for exchange in exchanges:
        answer = _answer(exchange, start)
        if rows and answer.content == rows[-1][0].content and _alike(answer.latency, rows[-1][0].latency):
            rows[-1].append(answer)
        else:
            rows.append([answer])
    found.left_out = sum(map(len, rows[limit:]))
    found.answers = [_joined(row) for row in rows[:limit]]
    sent = [exchange.request.at for exchange in exchanges]
    found.period = round(median([after - before for before, after in pairwise(sent)] or [0.0]), 3)
    return found


def _alike(one: float, other: float) -> bool:
    return abs(one - other) <= max(_SAME_LATENCY, 0.5 * min(one, other))


def _joined(row: list[RecordedAnswer]) -> RecordedAnswer:
    """Return equal answers as one."""
    first = row[0]
    first.until, first.times = row[-1].at, len(row)
    first.latency = round(median([answer.latency for answer in row]), 6)
    return first


def _answer(exchange: _Exchange, start: float) -> RecordedAnswer:
    """Return what was answered to one request."""
    request, response = exchange
    message, at = request.message, round(request.at - start, 6)
    answer = RecordedAnswer(at, at)
    if message is not None and request.pdu[0] in WRITES:
        answer.wrote = _row(message)
    if response is None:
        answer.silent = True
        return answer
    answer.latency = max(0.0, response.at - request.at)
    try:
        if message is None:
            answer.pdu = response.pdu
        elif request.pdu[0] in READS:
            answer.values = _row(message.read_response(response.pdu))
        else:
            message.read_response(response.pdu)
            if answer.wrote is None:
                answer.pdu = response.pdu
    except ModbusException as declined:
        answer.exception = declined.code
    except BarewireError:
        answer.pdu = response.pdu
    return answer


def _row(message: object) -> tuple[int, ...]:
    """Return the values in a message that reads or writes registers or bits."""
    for name in ("registers", "bits"):
        if (row := getattr(message, name, None)) is not None:
            return tuple(map(int, row))
    return (int(message.value),)  # type: ignore[attr-defined]  # a single one
