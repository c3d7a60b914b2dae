"""Learns what the units of a line answer, from the events of a sniffer.

The events that it learns from:

    RequestSeen    ResponseSeen            one exchange, after the time between the two
    RequestSeen    ResponseMissing         one exchange without an answer
                   ResponseSeen (late)     ... which came after all, when the client had given up
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from statistics import median
from typing import NamedTuple

from barewire.devices.sim.recorded.model import (
    READS,
    WRITES,
    RecordedAnswer,
    RecordedLine,
    RecordedRequest,
    RecordedUnit,
)
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
