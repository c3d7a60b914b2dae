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

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from typing import Any, NamedTuple

from barewire.errors import BarewireError, EncodeError, shown, suggest
from barewire.modbus.adu import BROADCAST
from barewire.modbus.exceptions import ModbusException
from barewire_workbench.sniffer import (
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
    def place(self) -> tuple[object, ...]:
        """What requests have in common whose answers are one sequence."""
        return self.function, self.table, self.address, self.quantity, self.pdu

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


# Learning


class _Exchange(NamedTuple):
    request: RequestSeen
    response: ResponseSeen | None


def learn_line(events: Iterable[SnifferEvent], *, limit: int = ANSWERS_LIMIT) -> RecordedLine:
    """Return what the events of a sniffer show of each unit. `limit`: the most rows of answers to one request.

    >>> from barewire.modbus import ReadHoldingRegisters
    >>> request = RequestSeen(7, bytes.fromhex("0300000001"), 1.0, ReadHoldingRegisters(0, 1))
    >>> line = learn_line([request, ResponseSeen(7, bytes.fromhex("03020017"), 1.25, None, request)])
    >>> line.units[7].requests[0].answers[0].values
    (23,)

    Raises EncodeError for a limit below 1.
    """
    if limit < 1:
        raise EncodeError(f"limit {limit}: expected a number of answers, from 1 on", "limit")
    line = RecordedLine()
    # By the identity of the request, which the exchange keeps alive: a late response replaces "no answer".
    exchanges: dict[int, _Exchange] = {}
    times: list[float] = []
    for event in events:
        times.append(event.at)
        match event:
            case ResponseSeen(request=RequestSeen() as request):
                exchanges[id(request)] = _Exchange(request, event)
            case ResponseMissing(request=request):
                exchanges[id(request)] = _Exchange(request, None)
            case RecordingEnds():
                pass  # its answer is not known
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
    by_unit: dict[int, dict[tuple[object, ...], list[_Exchange]]] = {}
    for exchange in sorted(exchanges.values(), key=lambda exchange: exchange.request.at):
        requests = by_unit.setdefault(exchange.request.unit, {})
        requests.setdefault(_without_answers(exchange.request).place, []).append(exchange)
    for address, requests in sorted(by_unit.items()):
        learned = [_learn_request(repeated, start, limit) for repeated in requests.values()]
        line.units[address] = RecordedUnit(address, learned)
    return line


def _without_answers(seen: RequestSeen) -> RecordedRequest:
    """Return the request as it is recorded; requests with one `place` have one sequence of answers."""
    message: Any = seen.message  # the messages of these eight functions have an address
    function = seen.pdu[0]
    table = READS.get(function) or WRITES.get(function)
    if message is None or table is None:
        return RecordedRequest(function, pdu=seen.pdu)
    return RecordedRequest(function, table, message.address, getattr(message, "quantity", 1))


def _learn_request(exchanges: list[_Exchange], start: float, limit: int) -> RecordedRequest:
    request = _without_answers(exchanges[0].request)
    rows: list[list[RecordedAnswer]] = []
    for exchange in exchanges:
        answer = _learn_answer(exchange, start)
        if rows and answer.content == rows[-1][0].content and _alike(answer.latency, rows[-1][0].latency):
            rows[-1].append(answer)
        else:
            rows.append([answer])
    request.left_out = sum(map(len, rows[limit:]))
    request.answers = [_joined(row) for row in rows[:limit]]
    sent_at = [exchange.request.at for exchange in exchanges]
    request.period = round(median([after - before for before, after in pairwise(sent_at)] or [0.0]), 3)
    return request


def _alike(latency: float, other: float) -> bool:
    return abs(latency - other) <= max(_SAME_LATENCY, 0.5 * min(latency, other))


def _joined(row: list[RecordedAnswer]) -> RecordedAnswer:
    first = row[0]
    first.until, first.times = row[-1].at, len(row)
    first.latency = round(median([answer.latency for answer in row]), 6)
    return first


def _learn_answer(exchange: _Exchange, start: float) -> RecordedAnswer:
    request, response = exchange
    message, at = request.message, round(request.at - start, 6)
    answer = RecordedAnswer(at, at)
    if message is not None and request.pdu[0] in WRITES:
        answer.wrote = values_in(message)
    if response is None:
        answer.silent = True
        return answer
    answer.latency = max(0.0, response.at - request.at)
    try:
        if message is None:
            answer.pdu = response.pdu
        elif request.pdu[0] in READS:
            answer.values = values_in(message.read_response(response.pdu))
        else:
            message.read_response(response.pdu)
            if answer.wrote is None:
                answer.pdu = response.pdu
    except ModbusException as declined:
        answer.exception = declined.code
    except BarewireError:  # a response that does not fit its request is replayed as it was
        answer.pdu = response.pdu
    return answer


def values_in(message: Any) -> tuple[int, ...]:
    """Return the values in a message that reads or writes registers or bits."""
    for name in ("registers", "bits"):
        if (values := getattr(message, name, None)) is not None:
            return tuple(map(int, values))
    return (int(message.value),)


# The file

_FUNCTION_OF = {table: function for function, table in READS.items()}
_SECONDS_MAX = 1e12
_MANY = 1 << 62
_CONTENT_KEYS = ("values", "exception", "silent", "pdu")
_ANSWER_KEYS = ("at", "until", "times", "latency", "wrote", *_CONTENT_KEYS)
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
    yield f"at = {_seconds_text(answer.at)}"
    if answer.times > 1:
        yield f"until = {_seconds_text(answer.until)}"
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
        yield f'pdu = "{answer.pdu.hex(" ").upper()}"'


def _seconds_text(seconds: float) -> str:
    # Six digits are microseconds in a short recording; in one of days they would round to ten seconds.
    return f"{seconds:.6g}" if seconds < 1e5 else f"{seconds:.1f}"


def is_recorded(text: str) -> bool:
    """Whether a TOML file is a recorded line, and not a device description."""
    return any(row.partition("#")[0].strip() == "[[unit]]" for row in text.splitlines())


def from_toml(text: str, name: str) -> RecordedLine:
    """Return the recorded line of a text. `name` is that of the file, for errors.

    Raises EncodeError with the place of what is wrong: file, unit, request, answer, key.
    """
    try:
        file = _Table(name, tomllib.loads(text))
    except RecursionError:
        raise EncodeError(f"{name}: nested too deeply to be read") from None
    except ValueError as error:  # tomllib's own error, or Python's for a number of 5000 digits
        raise EncodeError(f"{name}: not TOML: {error}") from None
    file.check_keys("unit")
    line = RecordedLine()
    for number, items in enumerate(file.tables("unit"), start=1):
        table = _Table(f"{name}: [[unit]] number {number}", items)
        table.check_keys("address", "request")
        address = table.integer("address", 0, 255)
        if address in line.units:
            raise table.error(f"address {address} is given twice")
        table = _Table(f"{name}: unit {address}", items)
        requests = [
            _request(_Table(f"{table.where}: request {place}", row))
            for place, row in enumerate(table.tables("request"), start=1)
        ]
        line.units[address] = RecordedUnit(address, requests)
    if not line.units:
        raise EncodeError(f"{name}: no [[unit]] in it; expected a file that `barewire record` wrote")
    line.seconds = max((answer.until for unit in line.units.values() for answer in unit.answers()), default=0.0)
    return line


def _request(table: _Table) -> RecordedRequest:
    table.check_keys(*_REQUEST_KEYS)
    kinds = [kind for kind in ("read", "write", "pdu") if kind in table.items]
    if len(kinds) != 1:
        raise table.error(f"expected one of the keys read, write and pdu, got {' and '.join(kinds) or 'none'}")
    (kind,) = kinds
    if kind == "pdu":
        pdu = table.hexadecimal("pdu")
        request = RecordedRequest(pdu[0], pdu=pdu)
    else:
        request = _request_at(table, kind)
    request.period = table.seconds("period")
    request.left_out = table.integer("left_out", 0, _MANY, 0)
    rows = table.array("answers")
    if not rows:
        raise table.error("key 'answers': expected at least one answer, such as { values = [1] }")
    for number, row in enumerate(rows, start=1):
        answer = _Table(f"{table.where}: answer {number}", row)
        if not isinstance(row, dict):
            raise answer.error(f"{shown(row)}: expected a table, such as {{ values = [1] }}")
        request.answers.append(_answer(answer, request, kind))
    if kind == "write":
        request.quantity = len(request.answers[0].wrote or ())
        if any(len(answer.wrote or ()) != request.quantity for answer in request.answers):
            raise table.error("key 'wrote': expected as many values in each answer")
    return request


def _request_at(table: _Table, kind: str) -> RecordedRequest:
    """Return the request of `read = "holding:0"` or `write = "coil:5"`, without its answers."""
    text = table.items[kind]
    name, _, digits = text.partition(":") if isinstance(text, str) else ("", "", "")
    names = tuple(READS.values()) if kind == "read" else ("coil", "holding")
    if name not in names:
        expected = f"expected one of {', '.join(names)}, a colon and an address, such as 'holding:0'"
        raise table.error(f"key {kind!r}: {shown(text)}: {expected}{suggest(name, names)}")
    # The digits are counted first: Python refuses to convert some thousands of them.
    if not digits.isdecimal() or len(digits) > 5 or int(digits) > 0xFFFF:
        raise table.error(f"key {kind!r}: {shown(text)}: expected an address in 0..65535 after the colon")
    if kind == "read":
        quantity = table.integer("quantity", 1, 2000 if name in ("coil", "discrete") else 125)
        return RecordedRequest(_FUNCTION_OF[name], name, int(digits), quantity)
    functions = sorted(function for function, written in WRITES.items() if written == name)
    function = table.items.get("function")
    if isinstance(function, bool) or function not in functions:
        got = "not given" if function is None else shown(function)
        raise table.error(f"key 'function': {got}: expected {' or '.join(map(str, functions))}")
    return RecordedRequest(function, name, int(digits))


def _answer(table: _Table, request: RecordedRequest, kind: str) -> RecordedAnswer:
    table.check_keys(*_ANSWER_KEYS)
    at = table.seconds("at")
    answer = RecordedAnswer(
        at=at,
        until=max(at, table.seconds("until")),
        times=table.integer("times", 1, _MANY, 1),
        latency=table.seconds("latency"),
    )
    _check_contents(table, kind)
    most = 1 if request.table in ("coil", "discrete") else 0xFFFF
    if "values" in table.items:
        answer.values = table.numbers("values", most)
        if kind != "read" or len(answer.values) != request.quantity:
            expected = f"{request.quantity} values" if kind == "read" else "no values: that is for reads"
            raise table.error(f"key 'values': {len(answer.values)} values: expected {expected}")
    if kind == "write":
        answer.wrote = table.numbers("wrote", most)
    elif "wrote" in table.items:
        raise table.error("key 'wrote': expected in the answers to a write only")
    if "exception" in table.items:
        answer.exception = table.integer("exception", 1, 255)
    if "silent" in table.items:
        if table.items["silent"] is not True:
            raise table.error(f"key 'silent': {shown(table.items['silent'])}: expected true, or no such key")
        answer.silent = True
    if "pdu" in table.items:
        answer.pdu = table.hexadecimal("pdu")
    return answer


def _check_contents(table: _Table, kind: str) -> None:
    """Check that an answer has one content; that of a write has none if it is the usual one."""
    contents = [key for key in _CONTENT_KEYS if key in table.items]
    if len(contents) > 1 or (kind != "write" and not contents):
        needed = "at most one" if kind == "write" else "exactly one"
        got = " and ".join(contents) or "none"
        raise table.error(f"expected {needed} of the keys values, exception, silent and pdu, got {got}")


class _Table(NamedTuple):
    """A table of the file, and its place for errors. A method returns the value of a key, or raises EncodeError."""

    where: str
    items: Mapping[str, Any]

    def error(self, text: str) -> EncodeError:
        return EncodeError(f"{self.where}: {text}")

    def check_keys(self, *known: str) -> None:
        for key in self.items:
            if key not in known:
                expected = f"expected some of {', '.join(known)}{suggest(key, known)}"
                raise self.error(f"unknown key {shown(key)}: {expected}")

    def tables(self, key: str) -> list[dict[str, Any]]:
        rows = self.items.get(key, [])
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise self.error(f"key {key!r}: expected tables")
        return rows

    def array(self, key: str) -> list[Any]:
        items = self.items.get(key)
        if not isinstance(items, list):
            raise self.error(f"key {key!r}: {shown(items)}: expected a list")
        return items

    def integer(self, key: str, low: int, high: int, default: int | None = None) -> int:
        value = self.items.get(key, default)
        if type(value) is not int or not low <= value <= high:  # True is an int, too
            got = "not given" if value is None else shown(value)
            raise self.error(f"key {key!r}: {got}: expected a whole number in {low}..{high}")
        return value

    def seconds(self, key: str) -> float:
        value = self.items.get(key, 0.0)
        if type(value) not in (int, float) or not 0 <= value < _SECONDS_MAX:
            expected = f"expected seconds, 0 or more and below {_SECONDS_MAX:g}"
            raise self.error(f"key {key!r}: {shown(value)}: {expected}")
        return float(value)

    def numbers(self, key: str, most: int) -> tuple[int, ...]:
        row = self.array(key)
        for value in row:
            if type(value) is not int or not 0 <= value <= most:
                raise self.error(f"key {key!r}: {shown(value)}: expected whole numbers in 0..{most}")
        if not row:
            raise self.error(f"key {key!r}: expected at least one value")
        return tuple(row)

    def hexadecimal(self, key: str) -> bytes:
        text = self.items[key]
        try:
            pdu = bytes.fromhex(text)
        except (TypeError, ValueError):
            pdu = b""
        if not 1 <= len(pdu) <= 253:
            expected = "expected 1 to 253 bytes in hexadecimal, '2B 0E 01 00'"
            raise self.error(f"key {key!r}: {shown(text)}: {expected}")
        return pdu
