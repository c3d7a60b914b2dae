"""Exchanges on a Modbus line as text: a line for each exchange, a dict for each event, registers by their names.

1.000000  unit 1  Read Holding Registers, 2 from 0000h -> 23 7, after 12.3 ms
2.000000  unit 9  Read Holding Registers, 1 from 0000h -> no answer
3.000000  unit 1  Read Holding Registers, 1 from 0000h -> no valid answer: 01 03 02 00 (4 bytes, then silence)
4.000000  unit 1  Read Holding Registers, 1 from 0000h -> the recording ends here

The line of an exchange has the time of its request and is complete when the answer is there. What happens meanwhile
waits for it, so the times of the lines never decrease.

With the description of a device its registers are values. A parameter is named if all its registers are in the
exchange; registers without a parameter stay numbers:

    request   04 0FB1 0002            input registers 4017 and 4018
    response  04 04 00 00 01 10       00000110h, u32, 1/10 °C      Thyristors temperature = 27.2 °C
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from barewire.devices.device import Device
from barewire.devices.parameter import Parameter, Reading, TableName
from barewire.errors import BarewireError
from barewire.modbus.messages import (
    ReadCoils,
    ReadHoldingRegisters,
    ReadWriteMultipleRegisters,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
)
from barewire.modbus.messages.base import EXCEPTION_BIT, Request, Response
from barewire_workbench.frames.modbus import explain_pdu
from barewire_workbench.sniffer import (
    AmbiguousFrame,
    NoiseSeen,
    RecordingEnds,
    RequestSeen,
    ResponseMissing,
    ResponseSeen,
    SnifferEvent,
)


class UnitNames:
    """The devices at the units of a line: `names` by unit, that of None for all other units.

    >>> from barewire.devices import load
    >>> UnitNames({None: RegisterNames(load("adxl"))})
    <UnitNames: adxl>
    """

    def __init__(self, names: Mapping[int | None, RegisterNames]) -> None:
        self._names = dict(names)

    def __repr__(self) -> str:
        devices = (
            f"{f'{unit}: ' if unit is not None else ''}{names.device.name}" for unit, names in self._names.items()
        )
        return f"<{type(self).__name__}: {', '.join(devices)}>"

    def text(self, request: RequestSeen, response: ResponseSeen | None) -> str:
        """Return the values of an exchange as text; '' if none has a name, and for a refused request."""
        names = self._of(request)
        if names is None or _is_refused(response):
            return ""
        return names.text(request.message, None if response is None else response.message)

    def values(self, request: RequestSeen, response: ResponseSeen | None) -> list[dict[str, object]]:
        """Return the values of an exchange for `json.dumps`."""
        names = self._of(request)
        if names is None or _is_refused(response):
            return []
        return [
            {
                "name": reading.name,
                "value": reading.value,
                "unit": reading.unit,
                "text": reading.parameter.text(reading.value),
            }
            for reading in names.readings(request.message, None if response is None else response.message)
        ]

    def _of(self, request: RequestSeen) -> RegisterNames | None:
        return self._names.get(request.unit) or self._names.get(None)


def _is_refused(response: ResponseSeen | None) -> bool:
    return response is not None and bool(response.pdu[0] & EXCEPTION_BIT)


class RegisterRow(NamedTuple):
    """Registers or coils of one table that an exchange read or wrote, from `address` on."""

    tables: tuple[TableName, ...]
    address: int
    content: tuple[int, ...]
    written: bool


class RegisterNames:
    """The parameters of a device by their registers.

    >>> from barewire.devices import load
    >>> from barewire.modbus import ReadInputRegisters, ReadInputRegistersResponse
    >>> names = RegisterNames(load("adxl"))
    >>> names.text(ReadInputRegisters(0x0FB1, 2), ReadInputRegistersResponse((0, 272)))
    'Thyristors temperature = 27.2 °C'
    """

    def __init__(self, device: Device) -> None:
        self.device = device
        self._by_place: dict[tuple[TableName, int], list[Parameter]] = {}
        for parameter in device.parameters:
            if parameter.modbus is not None:
                self._by_place.setdefault((parameter.modbus.table, parameter.modbus.address), []).append(parameter)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.device.name}>"

    def readings(self, request: Request[Any] | None, response: Response | None) -> list[Reading]:
        """Return the values that the exchange read, then those that it wrote."""
        return [reading for row in self.rows(request, response) for reading in self._row_readings(row)[0]]

    def text(self, request: Request[Any] | None, response: Response | None) -> str:
        """Return the values as text, with the registers that have no name; '' if none has one."""
        parts: list[str] = []
        named = 0
        for row in self.rows(request, response):
            readings, unnamed = self._row_readings(row)
            named += len(readings)
            parts += [f"{'set ' if row.written else ''}{reading}" for reading in readings]
            parts += [f"{address:04X}h: {value}" for address, value in unnamed]
        if not named:
            return ""
        return ", ".join(parts if len(parts) <= _SHOWN else [*parts[:_SHOWN], "..."])

    def _row_readings(self, row: RegisterRow) -> tuple[list[Reading], list[tuple[int, int]]]:
        """Return the readings of a row, and the addresses and values that are in none of them."""
        readings: list[Reading] = []
        covered: set[int] = set()
        for offset in range(len(row.content)):
            for table in row.tables:
                for parameter in self._by_place.get((table, row.address + offset), ()):
                    place = parameter.modbus
                    assert place is not None
                    registers = row.content[offset : offset + place.words]
                    if len(registers) < place.words:
                        continue  # a part of a value is none
                    try:
                        is_bit = table in ("coil", "discrete")
                        value = bool(registers[0]) if is_bit else parameter.from_registers(registers)
                    except BarewireError:
                        continue
                    readings.append(Reading(parameter, value))
                    covered.update(range(offset, offset + place.words))
        unnamed = [(row.address + at, value) for at, value in enumerate(row.content) if at not in covered]
        return readings, unnamed

    def rows(self, request: Request[Any] | None, response: Response | None) -> Iterator[RegisterRow]:
        """Yield what the exchange read, then what it wrote."""
        modbus = self.device.modbus
        if modbus is None or request is None:
            return
        reads: Mapping[TableName, int] = modbus.read_functions
        by_function = tuple(table for table, function in reads.items() if function == request.function_code)
        content: Sequence[int] = getattr(response, "registers", None) or getattr(response, "bits", None) or ()
        match request:
            case ReadCoils() | ReadHoldingRegisters():
                yield RegisterRow(by_function, request.address, tuple(content[: request.quantity]), False)
            case WriteSingleCoil() | WriteSingleRegister():
                table: TableName = "coil" if isinstance(request, WriteSingleCoil) else "holding"
                yield RegisterRow((table,), request.address, (int(request.value),), True)
            case WriteMultipleCoils():
                yield RegisterRow(("coil",), request.address, tuple(map(int, request.bits)), True)
            case WriteMultipleRegisters():
                yield RegisterRow(("holding",), request.address, tuple(request.registers), True)
            case ReadWriteMultipleRegisters():
                yield RegisterRow(("holding",), request.read_address, tuple(content), False)
                yield RegisterRow(("holding",), request.write_address, tuple(request.registers), True)


_SHOWN = 12
"""The most values or bytes of an answer in a line; `exchange_as_dict` has all of them."""


# Exchanges ----------------------------------------------------------------------------------------------------------


class PairedExchange(NamedTuple):
    """A request and what became of it, or bytes without a frame; `str` is its line.

    `station` is "unit 1", "all" or "noise". `wrong`: refused, late, not answered, or not a frame. `events` are its
    frames and the noise in place of them. `seconds` is the time until its answer, if that is known.
    """

    at: float
    station: str
    text: str
    wrong: bool
    events: tuple[SnifferEvent, ...]
    seconds: float | None = None
    remark: str = ""
    timed: bool = True

    def __str__(self) -> str:
        at = f"{self.at:.6f}  " if self.timed else ""
        after = "" if self.seconds is None else f", after {1e3 * self.seconds:.1f} ms"
        return f"{at}{self.station:<6}  {self.text}{after}{self.remark}"


class _Row:
    """An exchange, or None while its answer may come, and the noise behind its request."""

    def __init__(self, request: RequestSeen | None, exchange: PairedExchange | None) -> None:
        self.request = request
        self.exchange = exchange
        self.noise: list[NoiseSeen] = []


class Exchanges:
    """Turns events into exchanges. `timed` is False for a recording without times: then lines have no times either.

    >>> exchanges = Exchanges()
    >>> request = RequestSeen(1, bytes.fromhex("0300000002"), 1.0)
    >>> exchanges.feed(request)
    []
    >>> for exchange in exchanges.feed(ResponseSeen(1, bytes.fromhex("030400170007"), 1.0123, request=request)):
    ...     print(exchange)
    1.000000  unit 1  Read Holding Registers, 2 from 0000h -> 23 7, after 12.3 ms
    """

    def __init__(self, *, timed: bool = True, names: UnitNames | None = None) -> None:
        self._timed = timed
        self._names = names
        self._rows: deque[_Row] = deque()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self._rows)} waiting>"

    def feed(self, event: SnifferEvent) -> list[PairedExchange]:
        """Return the exchanges that are complete now, in the order of their times."""
        match event:
            case RequestSeen() if event.unit or event.transaction is not None:
                self._rows.append(_Row(event, None))
            # Noise behind a request may be its damaged answer, so it is shown with what becomes of that.
            case NoiseSeen() if self._rows and self._rows[-1].exchange is None:
                self._rows[-1].noise.append(event)
            case ResponseMissing() | RecordingEnds():
                self._close(event.request, self._unanswered(event))
            case ResponseSeen(request=RequestSeen() as request) if not event.late:
                self._close(request, self._answered(event, request))
            case _:
                self._rows.append(_Row(None, self._alone(event)))
        return self._complete()

    def end(self) -> list[PairedExchange]:
        """Return the exchanges that are left: requests whose end was not reported."""
        for row in self._rows:
            if row.exchange is None and row.request is not None:
                row.exchange = self._of(row.request, "the recording ends here", False)
        return self._complete()

    def _close(self, request: RequestSeen, exchange: PairedExchange) -> None:
        row = next((row for row in self._rows if row.request is request), None)
        if row is None:
            self._rows.append(_Row(None, exchange))
        else:
            row.exchange = exchange

    def _complete(self) -> list[PairedExchange]:
        complete: list[PairedExchange] = []
        while self._rows and (exchange := self._rows[0].exchange) is not None:
            row = self._rows.popleft()
            complete += [exchange, *(self._alone(noise) for noise in row.noise)]
        return complete

    def _of(self, request: RequestSeen, result: str, wrong: bool, *events: SnifferEvent) -> PairedExchange:
        text = f"{explain_pdu(request.pdu, 'request').summary} -> {result}"
        return PairedExchange(request.at, f"unit {request.unit}", text, wrong, (request, *events), timed=self._timed)

    def _unanswered(self, event: ResponseMissing | RecordingEnds) -> PairedExchange:
        """Return a request without an answer. Noise behind it is part of it: perhaps the damaged answer."""
        row = next((row for row in self._rows if row.request is event.request), None)
        noise = [] if row is None else row.noise
        ending = "no answer" if isinstance(event, ResponseMissing) else "the recording ends here"
        if noise and row is not None:
            row.noise = []
            data = b"".join(piece.noise.data for piece in noise)
            text = noise[0].noise.text if len(noise) == 1 else f"{len(noise)} pieces"
            then = "" if isinstance(event, ResponseMissing) else "; the recording ends here"
            ending = f"no valid answer: {_clipped(data.hex(' ').upper().split())} ({text}){then}"
        return self._of(event.request, ending, bool(noise) or isinstance(event, ResponseMissing), *noise)

    def _answered(self, event: ResponseSeen, request: RequestSeen) -> PairedExchange:
        wrong = _is_refused(event) or event.message is None
        exchange = self._of(request, self._values(request, event), wrong, event)
        if event.older is not None:
            older = f"{self._time(event.older.at).strip()} {explain_pdu(event.older.pdu, 'request').summary}"
            exchange = exchange._replace(remark=f"; it may also be the late answer to {older}")
        seconds = event.at - request.at
        return exchange._replace(seconds=seconds) if self._timed and seconds > 0 else exchange

    def _values(self, request: RequestSeen, event: ResponseSeen) -> str:
        named = self._names.text(request, event) if self._names is not None else ""
        result = _result(event, request)
        if not named:
            return result
        return f"{result}: {named}" if result == "done" else named

    def _alone(self, event: SnifferEvent) -> PairedExchange:
        """Return an event that is not one half of an exchange."""
        wrong = False
        events: tuple[SnifferEvent, ...] = (event,)
        match event:
            case RequestSeen():
                station, text = "all", f"{explain_pdu(event.pdu, 'request').summary} (broadcast)"
            case AmbiguousFrame():
                summary = explain_pdu(event.pdu, "request").summary
                station, text = f"unit {event.unit}", f"{summary} -> seen once: the request or its echo"
            case NoiseSeen():
                digits = _clipped(event.noise.data.hex(" ").upper().split())
                station, text, wrong = "noise", f"{digits} ({event.noise.text})", True
            case ResponseSeen(request=None):
                summary = explain_pdu(event.pdu, "response").summary
                station, text = f"unit {event.unit}", f"(request not seen) -> {summary}"
            case ResponseSeen(request=RequestSeen() as request):
                requested = explain_pdu(request.pdu, "request").summary
                late = f"{1e3 * (event.at - request.at):.1f} ms after its request, and " if self._timed else ""
                values = self._values(request, event)
                text = f"{requested} -> {values}, late: {late}after the next one"
                station, wrong, events = f"unit {event.unit}", True, (request, event)
            case ResponseMissing() | RecordingEnds():
                return self._unanswered(event)
        return PairedExchange(event.at, station, text, wrong, events, timed=self._timed)

    def _time(self, at: float) -> str:
        return f"{at:.6f}  " if self._timed else ""


def _result(answer: ResponseSeen, request: RequestSeen) -> str:
    """Return the part of an answer that its request does not contain."""
    pdu = answer.pdu
    parsed = explain_pdu(pdu, "response")
    if pdu[0] & EXCEPTION_BIT:
        return parsed.summary.partition(" to ")[0]
    if parsed.error is not None:
        return f"cannot be decoded: {parsed.error.text}"
    if pdu == request.pdu or request.pdu.startswith(pdu):
        return "done"
    registers = [str(field.value) for field in parsed.fields if field.name.startswith("register ")]
    return _clipped(registers or pdu[1:].hex(" ").upper().split())


def _clipped(parts: list[str]) -> str:
    return " ".join(parts if len(parts) <= _SHOWN else [*parts[:_SHOWN], "..."])


def exchange_as_dict(event: SnifferEvent, *, timed: bool = True, names: UnitNames | None = None) -> dict[str, object]:
    """Return the event for `json.dumps`; `request_at` is the time of the request of a response or a time-out.

    If the recording is not `timed`, all times are None. With `names`, a response has the named values of its exchange.

    >>> exchange_as_dict(ResponseMissing(RequestSeen(1, bytes.fromhex("0300000002"), 1.0), 2.0))
    {'event': 'unanswered', 'at': 2.0, 'unit': 1, 'request_at': 1.0}
    """
    result = _as_dict(event)
    if names is not None and isinstance(event, ResponseSeen) and event.request is not None:
        result["values"] = names.values(event.request, event)
    return result if timed else {key: None if key in _TIMES else value for key, value in result.items()}


_TIMES = frozenset({"at", "request_at", "older_request_at", "seconds"})


def _as_dict(event: SnifferEvent) -> dict[str, object]:
    match event:
        case RequestSeen():
            name = "request" if event.unit or event.transaction is not None else "broadcast"
            return _frame(name, event.unit, event.pdu, event.at, event.transaction)
        case ResponseSeen():
            result = _frame("response", event.unit, event.pdu, event.at, event.transaction)
            if event.pdu[0] & EXCEPTION_BIT and len(event.pdu) > 1:
                result["exception"] = event.pdu[1]
            request = event.request
            result |= {
                "request_at": None if request is None else request.at,
                "seconds": None if request is None else round(event.at - request.at, 6),
                "late": event.late,
            }
            return result if event.older is None else result | {"older_request_at": event.older.at}
        case ResponseMissing():
            return {"event": "unanswered", "at": event.at, "unit": event.request.unit, "request_at": event.request.at}
        case RecordingEnds():
            return {"event": "ends", "at": event.at, "unit": event.request.unit, "request_at": event.request.at}
        case AmbiguousFrame():
            return _frame("half", event.unit, event.pdu, event.at, None)
        case NoiseSeen():
            data, reason, text = event.noise
            return {"event": "noise", "at": event.at, "data": data.hex(), "reason": reason, "text": text}


def _frame(name: str, unit: int, pdu: bytes, at: float, transaction: int | None) -> dict[str, object]:
    parsed = explain_pdu(pdu, "response" if name == "response" else "request")
    fields = {field.name: field.value if isinstance(field.value, int) else str(field.value) for field in parsed.fields}
    result: dict[str, object] = {"event": name, "at": at, "unit": unit, "function": pdu[0] & ~EXCEPTION_BIT}
    if transaction is not None:
        result["transaction"] = transaction
    return result | {"pdu": pdu.hex(), "summary": parsed.summary, "fields": fields}
