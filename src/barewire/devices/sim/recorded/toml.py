"""A recorded line as text: TOML to read, to edit, and to keep beside a test.

An example:

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
from collections.abc import Iterable, Mapping
from typing import Any

from barewire.devices.device import suggest
from barewire.devices.sim.recorded.learn import (
    READS,
    WRITES,
    RecordedAnswer,
    RecordedLine,
    RecordedRequest,
    RecordedUnit,
)
from barewire.errors import EncodeError, shown

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
