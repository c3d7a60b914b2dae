"""What the units of a line answer: learned from the events of a sniffer, and kept as TOML.

    RecordedLine
      '- RecordedUnit(address=7)
           |- RecordedRequest(read="holding:0", quantity=2)    12 times, every 1.0 s
           |     values 23 7      9 times from 0.0 s on, after 12 ms
           |     values 24 7      2 times from 9.0 s on, after 12 ms
           |     exception 06     at 11.0 s, after 300 ms
           '- RecordedRequest(write="holding:1", function=6)   once
                 wrote 3, done    at 2.0 s, after 15 ms

Equal answers in a row are one `RecordedAnswer` with a number of times.

The events that it learns from:

    RequestSeen    ResponseSeen            one exchange, after the time between the two
    RequestSeen    ResponseMissing         one exchange without an answer
                   ResponseSeen (late)     ... which came after all, when the client had given up

The file, to read, to edit, and to keep beside a test:

    [[unit]]
    address = 7

    [[unit.request]]
    read = "holding:0"                  # the first address on the wire, from 0
    quantity = 2
    period = 1.0                        # seconds between two of them; for the reader
    answers = [
      { at = 0.0, until = 8.0, times = 9, latency = 0.012, values = [23, 7] },
      { at = 9.0, latency = 0.3, exception = 6 },
      { at = 10.0, silent = true },
    ]

    [[unit.request]]
    write = "holding:1"
    function = 6
    answers = [{ at = 2.0, latency = 0.015, wrote = [3] }]

    [[unit.request]]
    pdu = "2B 0E 01 00"                 # any other function
    answers = [{ latency = 0.02, pdu = "2B 0E 01 ..." }]
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from typing import Any, NamedTuple

from barewire.devices.device import suggest
from barewire.errors import BarewireError, EncodeError, shown
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
        by_request.setdefault(request.unit, {}).setdefault(_sequence_key(request), []).append(exchange)
    for address, requests in sorted(by_request.items()):
        unit = RecordedUnit(address)
        for place, found in requests.items():
            unit.requests.append(_learned(place, found, start, limit))
        line.units[address] = unit
    return line


def _sequence_key(request: RequestSeen) -> tuple[object, ...]:
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
        answer = _learned_answer(exchange, start)
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


def _learned_answer(exchange: _Exchange, start: float) -> RecordedAnswer:
    """Return what was answered to one request."""
    request, response = exchange
    message, at = request.message, round(request.at - start, 6)
    answer = RecordedAnswer(at, at)
    if message is not None and request.pdu[0] in WRITES:
        answer.wrote = _values_in(message)
    if response is None:
        answer.silent = True
        return answer
    answer.latency = max(0.0, response.at - request.at)
    try:
        if message is None:
            answer.pdu = response.pdu
        elif request.pdu[0] in READS:
            answer.values = _values_in(message.read_response(response.pdu))
        else:
            message.read_response(response.pdu)
            if answer.wrote is None:
                answer.pdu = response.pdu
    except ModbusException as declined:
        answer.exception = declined.code
    except BarewireError:
        answer.pdu = response.pdu
    return answer


def _values_in(message: object) -> tuple[int, ...]:
    """Return the values in a message that reads or writes registers or bits."""
    for name in ("registers", "bits"):
        if (row := getattr(message, name, None)) is not None:
            return tuple(map(int, row))
    return (int(message.value),)  # type: ignore[attr-defined]  # a single one


_FUNCTION_OF = {table: function for function, table in READS.items()}
_SECONDS_MAX = 1e12
_ANSWER_KEYS = ("at", "until", "times", "latency", "values", "wrote", "exception", "silent", "pdu")
_REQUEST_KEYS = ("read", "write", "pdu", "function", "quantity", "period", "left_out", "answers")


def to_toml(line: RecordedLine, source: str) -> str:
    """Return the text of a recorded line. `source` is the name of the recording, for the comment.

    >>> print(to_toml(RecordedLine({7: RecordedUnit(7)}), "bus.log"))
    # Recorded by barewire from bus.log: 1 unit, 0 s.
    # `barewire simulate THIS_FILE ENDPOINT` answers as the units did.
    <BLANKLINE>
    [[unit]]
    address = 7
    <BLANKLINE>
    """
    units = f"{len(line.units)} unit{'s' * (len(line.units) != 1)}"
    rows = [
        f"# Recorded by barewire from {' '.join(source.split())}: {units}, {line.seconds:g} s.",
        "# `barewire simulate THIS_FILE ENDPOINT` answers as the units did.",
        "",
    ]
    for unit in line.units.values():
        rows += ["[[unit]]", f"address = {unit.address}", ""]
        for request in unit.requests:
            rows += _request_rows(request)
    return "\n".join(rows)


def _request_rows(request: RecordedRequest) -> Iterable[str]:
    yield "[[unit.request]]"
    if not request.table:
        yield f'pdu = "{request.pdu.hex(" ").upper()}"'
    elif request.function in READS:
        yield f'read = "{request.table}:{request.address}"'
        yield f"quantity = {request.quantity}"
    else:
        yield f'write = "{request.table}:{request.address}"'
        yield f"function = {request.function}"
    if request.period:
        yield f"period = {request.period:g}"
    if request.left_out:
        yield f"left_out = {request.left_out}  # answers after these"
    yield "answers = ["
    for answer in request.answers:
        yield f"  {{ {', '.join(_answer_items(answer))} }},"
    yield "]"
    yield ""


def _answer_items(answer: RecordedAnswer) -> Iterable[str]:
    yield f"at = {answer.at:.6g}" if answer.at < 1e5 else f"at = {answer.at:.1f}"
    if answer.times > 1:
        yield f"until = {answer.until:.6g}" if answer.until < 1e5 else f"until = {answer.until:.1f}"
        yield f"times = {answer.times}"
    if not answer.silent:
        yield f"latency = {answer.latency:.4g}"
    if answer.wrote is not None:
        yield f"wrote = {list(answer.wrote)}"
    if answer.values is not None:
        yield f"values = {list(answer.values)}"
    if answer.exception is not None:
        yield f"exception = {answer.exception}"
    if answer.silent:
        yield "silent = true"
    if answer.pdu is not None:
        yield f"pdu = {json.dumps(answer.pdu.hex(' ').upper())}"


def is_recorded(text: str) -> bool:
    """Whether a TOML file is a recorded line, and not a device description."""
    return any(row.partition("#")[0].strip() == "[[unit]]" for row in text.splitlines())


def from_toml(text: str, name: str) -> RecordedLine:
    """Return the recorded line of a text. `name` is that of the file, for errors.

    Raises EncodeError with the place of what is wrong: file, unit, request, answer, key.
    """
    try:
        items = tomllib.loads(text)
    except RecursionError:
        raise EncodeError(f"{name}: nested too deeply to be read") from None
    except ValueError as error:  # tomllib's own error, or Python's for a number of 5000 digits
        raise EncodeError(f"{name}: not TOML: {error}") from None
    _check_keys(items, ("unit",), name)
    line = RecordedLine()
    for place, item in enumerate(_tables(items, "unit", name), start=1):
        where = f"{name}: [[unit]] number {place}"
        _check_keys(item, ("address", "request"), where)
        address = _whole(item, "address", where, 0, 255)
        if address in line.units:
            raise EncodeError(f"{where}: address {address} is given twice")
        where = f"{name}: unit {address}"
        rows = _tables(item, "request", where) if "request" in item else []
        requests = [_request(row, f"{where}: request {number}") for number, row in enumerate(rows, start=1)]
        line.units[address] = RecordedUnit(address, requests)
    if not line.units:
        raise EncodeError(f"{name}: no [[unit]] in it; expected a file that `barewire record` wrote")
    line.seconds = max((answer.until for unit in line.units.values() for answer in unit.answers()), default=0.0)
    return line


def _request(item: dict[str, Any], where: str) -> RecordedRequest:
    _check_keys(item, _REQUEST_KEYS, where)
    kinds = [kind for kind in ("read", "write", "pdu") if kind in item]
    if len(kinds) != 1:
        raise EncodeError(f"{where}: expected one of the keys read, write and pdu, got {' and '.join(kinds) or 'none'}")
    kind = kinds[0]
    if kind == "pdu":
        pdu = _hexadecimal(item, "pdu", where)
        found = RecordedRequest(pdu[0], pdu=pdu)
    else:
        found = _place(item, kind, where)
    found.period = _seconds(item, "period", where)
    found.left_out = _whole(item, "left_out", where, 0, 1 << 62, 0)
    if not _list(item, "answers", where):
        raise EncodeError(f"{where}: key 'answers': expected at least one answer, such as {{ values = [1] }}")
    for number, row in enumerate(item["answers"], start=1):
        there = f"{where}: answer {number}"
        if not isinstance(row, dict):
            raise EncodeError(f"{there}: {shown(row)}: expected a table, such as {{ values = [1] }}")
        found.answers.append(_answer(row, found, kind, there))
    if kind == "write":
        found.quantity = len(found.answers[0].wrote or ())
        if any(len(answer.wrote or ()) != found.quantity for answer in found.answers):
            raise EncodeError(f"{where}: key 'wrote': expected as many values in each answer")
    return found


def _place(item: dict[str, Any], kind: str, where: str) -> RecordedRequest:
    """Return the request of `read = "holding:0"` or `write = "coil:5"`, without its answers."""
    text = item[kind]
    table, _, number = text.partition(":") if isinstance(text, str) else ("", "", "")
    tables = tuple(READS.values()) if kind == "read" else ("coil", "holding")
    if table not in tables:
        expected = f"expected one of {', '.join(tables)}, a colon and an address, such as 'holding:0'"
        raise EncodeError(f"{where}: key {kind!r}: {shown(text)}: {expected}{suggest(table, dict.fromkeys(tables))}")
    if not number.isdecimal() or len(number) > 5 or int(number) > 0xFFFF:
        raise EncodeError(f"{where}: key {kind!r}: {shown(text)}: expected an address in 0..65535 after the colon")
    if kind == "read":
        quantity = _whole(item, "quantity", where, 1, 2000 if table in ("coil", "discrete") else 125)
        return RecordedRequest(_FUNCTION_OF[table], table, int(number), quantity)
    functions = sorted(function for function, written in WRITES.items() if written == table)
    function = item.get("function")
    if isinstance(function, bool) or function not in functions:
        given = "not given" if function is None else shown(function)
        raise EncodeError(f"{where}: key 'function': {given}: expected {' or '.join(map(str, functions))}")
    return RecordedRequest(function, table, int(number))


def _answer(item: dict[str, Any], request: RecordedRequest, kind: str, where: str) -> RecordedAnswer:
    _check_keys(item, _ANSWER_KEYS, where)
    at = _seconds(item, "at", where)
    answer = RecordedAnswer(
        at=at,
        until=max(at, _seconds(item, "until", where)),
        times=_whole(item, "times", where, 1, 1 << 62, 1),
        latency=_seconds(item, "latency", where),
    )
    given = [key for key in ("values", "exception", "silent", "pdu") if key in item]
    needed = "exactly one" if kind != "write" else "at most one"
    if len(given) > 1 or (kind != "write" and not given):
        text = f"expected {needed} of the keys values, exception, silent and pdu, got {' and '.join(given) or 'none'}"
        raise EncodeError(f"{where}: {text}")
    most = 1 if request.table in ("coil", "discrete") else 0xFFFF
    if "values" in item:
        answer.values = _row(item, "values", where, most)
        if kind != "read" or len(answer.values) != request.quantity:
            expected = f"{request.quantity} values" if kind == "read" else "no values: that is for reads"
            raise EncodeError(f"{where}: key 'values': {len(answer.values)} values: expected {expected}")
    if kind == "write":
        answer.wrote = _row(item, "wrote", where, most)
    elif "wrote" in item:
        raise EncodeError(f"{where}: key 'wrote': expected in the answers to a write only")
    if "exception" in item:
        answer.exception = _whole(item, "exception", where, 1, 255)
    if "silent" in item:
        if item["silent"] is not True:
            raise EncodeError(f"{where}: key 'silent': {shown(item['silent'])}: expected true, or no such key")
        answer.silent = True
    if "pdu" in item:
        answer.pdu = _hexadecimal(item, "pdu", where)
    return answer


# The values of keys


def _check_keys(item: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in item:
        if key not in known:
            hint = suggest(key, dict.fromkeys(known))
            raise EncodeError(f"{where}: unknown key {shown(key)}: expected some of {', '.join(known)}{hint}")


def _tables(item: Mapping[str, Any], key: str, where: str) -> list[dict[str, Any]]:
    found = item.get(key, [])
    if not isinstance(found, list) or not all(isinstance(row, dict) for row in found):
        raise EncodeError(f"{where}: key {key!r}: expected tables")
    return found


def _list(item: Mapping[str, Any], key: str, where: str) -> list[Any]:
    found = item.get(key)
    if not isinstance(found, list):
        raise EncodeError(f"{where}: key {key!r}: {shown(found)}: expected a list")
    return found


def _whole(item: Mapping[str, Any], key: str, where: str, low: int, high: int, default: int | None = None) -> int:
    value = item.get(key, default)
    if type(value) is not int or not low <= value <= high:
        got = "not given" if value is None else shown(value)
        raise EncodeError(f"{where}: key {key!r}: {got}: expected a whole number in {low}..{high}")
    return value


def _seconds(item: Mapping[str, Any], key: str, where: str) -> float:
    value = item.get(key, 0.0)
    if type(value) not in (int, float) or not 0 <= value < _SECONDS_MAX:
        raise EncodeError(
            f"{where}: key {key!r}: {shown(value)}: expected seconds, 0 or more and below {_SECONDS_MAX:g}"
        )
    return float(value)


def _row(item: Mapping[str, Any], key: str, where: str, most: int) -> tuple[int, ...]:
    row = _list(item, key, where)
    for value in row:
        if type(value) is not int or not 0 <= value <= most:
            raise EncodeError(f"{where}: key {key!r}: {shown(value)}: expected whole numbers in 0..{most}")
    if not row:
        raise EncodeError(f"{where}: key {key!r}: expected at least one value")
    return tuple(row)


def _hexadecimal(item: Mapping[str, Any], key: str, where: str) -> bytes:
    text = item[key]
    try:
        pdu = bytes.fromhex(text)
    except (TypeError, ValueError):
        pdu = b""
    if not 1 <= len(pdu) <= 253:
        raise EncodeError(f"{where}: key {key!r}: {shown(text)}: expected 1 to 253 bytes in hexadecimal, '2B 0E 01 00'")
    return pdu
