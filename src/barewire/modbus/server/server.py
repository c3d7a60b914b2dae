"""The server, as a machine: bytes in, bytes out, and no way to make it stumble.

    feed(bytes, now) ->  line  ->  Adu  ->  for one of my units?  ->  decode  ->  unit.handle  ->  Reply(bytes, at)
                          '-> Noise: counted     '-> no: silence       '-> 01, 03      '-> 02, 03, 04 ...

The order of checks is that of the standard's figures: function (01), then quantity and lengths (03), then address
(02), then doing it (04) [MB-APP 7, figures 11 to 27].

**On a serial line** silence is part of the protocol. Nobody answers a broadcast (it is carried out), a frame for
somebody else, or one that is no request because bit 7 of its function is set: that is another unit's exception. And
nobody answers late: when other traffic came behind a request, its client has given up, and an answer would meet the
next question on the wire. Such a *stale* request is dropped if it reads and carried out unanswered if it writes. Up
to three bytes behind a request are a glitch of a line that changes direction: it is answered once they are known to
be no more than that. Our own answer heard before anybody else may speak is an echo and no request; a line that echoes
later than that is to be wrapped in an `EchoLine`. Functions 08, 0B and 0C are answered out of `counters` where the
unit does not do it itself.

**On TCP** every request is answered, by its transaction number; what exceeds `transactions` in one read is answered
with exception 06 (busy). What has bit 7 of its function set is no request there either, and there is no answer to it
that could not be mistaken for the answer to another one: silence.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple, Protocol

from barewire.errors import DecodeError
from barewire.modbus.adu import BROADCAST, Adu, Noise
from barewire.modbus.exceptions import (
    ILLEGAL_FUNCTION,
    SERVER_DEVICE_BUSY,
    SERVER_DEVICE_FAILURE,
    ModbusException,
)
from barewire.modbus.framing import Line, LineEvent
from barewire.modbus.messages.base import EXCEPTION_BIT, ExceptionResponse, Response, checked
from barewire.modbus.messages.canopen_reference import ExtendedExceptionResponse, SdoAborted
from barewire.modbus.messages.registry import AnyRequest, request_class
from barewire.modbus.server.serial_counters import ANSWERED, SerialCounters

TRANSACTIONS = 16
"""NumberMaxOfServerTransaction: so many requests of one client are worked on at a time [MB-TCP 4.4.2]."""

GLITCH = 3
"""So many bytes behind a request cannot be a frame, the shortest has four."""

_new = tuple.__new__  # what Reply(...) does, without the function around it

_SOON = 0.1
"""Seconds: a line that needs longer to see that a glitch is one (ASCII) is not waited for."""


class Unit(Protocol):
    """What answers for one unit address: a table, a simulator, a program of the user's.

    Returns the response; None to stay silent (a device that reboots instead of answering); raises ModbusException to
    decline. Two more members are used if a unit has them: `supports(request_class) -> bool`, so that a request of a
    function that the unit does not have is exception 01 even if it is malformed; and `diagnostics`, False for a device
    whose 01 to functions 08, 0B and 0C is meant.
    """

    def handle(self, request: Any, now: float) -> Response | None: ...


class Reply(NamedTuple):
    """Bytes to send, not before the time `at` (t3.5 of silence on RTU)."""

    data: bytes
    at: float


@dataclass
class ServerStatistics:
    """Counts from 0, and the latest errors of units."""

    requests: int = 0
    replies: int = 0
    exceptions: int = 0
    broadcasts: int = 0
    for_others: int = 0
    noise_bytes: int = 0
    not_requests: int = 0
    """Frames with bit 7 of the function set."""
    stale: int = 0
    """Requests that other traffic had followed before they could be answered."""
    echoes: int = 0
    """Our own answers, heard."""
    failures: list[str] = field(default_factory=list)
    """The latest errors of a unit's own code, at most ten: they were answered with exception 04."""

    def failed(self, error: Exception) -> None:
        """One more of them. Its text is the user's code as well."""
        try:
            text = str(error)
        except Exception:
            text = "(no text)"
        self.failures = [*self.failures[-9:], f"{type(error).__name__}: {text}"]


class Server:
    """Several units behind one line. `serial` lines have broadcasts and other units; TCP connections have neither.

    On TCP a unit that is not in `units` is answered by `units[255]` or `units[0]` if there is such a one, and by
    exception 0B otherwise; on a serial line it is somebody else, so there is silence. `permits(unit, request)` says
    whether a request may be carried out: exception 01 if not. `counters` are shared by connections to the same units.
    """

    def __init__(
        self,
        line: Line,
        units: Mapping[int, Unit],
        *,
        serial: bool,
        transactions: int = TRANSACTIONS,
        permits: Callable[[int, AnyRequest], bool] | None = None,
        counters: defaultdict[int, SerialCounters] | None = None,
    ) -> None:
        self.line = line
        self.units = units
        self.serial = serial
        self.statistics = ServerStatistics()
        self.counters: defaultdict[int, SerialCounters] = counters_for(line) if counters is None else counters
        """By unit, on serial lines."""
        self._transactions = transactions
        self._permits = permits
        self._waiting: Adu | None = None  # a request that will be answered if nothing but a glitch is behind it
        self._said: Adu | None = None  # our latest answer

    @property
    def deadline(self) -> float | None:
        """When to be fed None if nothing came."""
        return self.line.deadline

    def feed(self, data: bytes | None, now: float) -> list[Reply]:
        """Bytes that arrived; what is to be sent. Never raises."""
        line = self.line
        if self.serial:
            is_early = now < line.quiet_at
            return self._feed_serial(line.feed(data, now), now, is_early)
        replies = []
        room = self._transactions
        for event in line.feed(data, now):
            if isinstance(event, Noise):
                self.statistics.noise_bytes += len(event.data)
                continue
            pdu = self.answer(event, now) if room > 0 else self._overload(event.pdu)
            room -= 1
            if pdu is not None:
                self.statistics.replies += 1
                replies.append(_new(Reply, (line.response(event, pdu), 0.0)))
        return replies

    def overrun(self) -> None:
        """The port lost a character: told by whoever owns it."""
        for counters in self._counters():
            counters.overrun()

    def _counters(self) -> Iterable[SerialCounters]:
        return [self.counters[number] for number in self.units]

    def _feed_serial(self, events: list[LineEvent], now: float, is_early: bool) -> list[Reply]:
        """`is_early`: the line was not quiet long enough after our answer for anybody else to speak."""
        for event in events:
            if isinstance(event, Noise):
                self.statistics.noise_bytes += len(event.data)
                for counters in self._counters():
                    counters.damaged()
                if len(event.data) > GLITCH:
                    self._give_up(now)
                continue
            if is_early and event == self._said:
                self._said = None
                self.statistics.echoes += 1
                continue
            for counters in self._counters():
                counters.frame()
            self._give_up(now)
            if event.unit in self.units and event.unit != BROADCAST:
                self._waiting = event
            else:
                self.answer(event, now)
        if self._waiting is None:
            return []
        held = len(self.line.held)
        if held > GLITCH:
            self._give_up(now)
            return []
        if held and self.line.deadline is not None and self.line.deadline <= now + _SOON:
            return []
        waiting, self._waiting = self._waiting, None
        return self._reply(waiting, now)

    def _give_up(self, now: float) -> None:
        """Something else came behind the request that waited: nobody waits for its answer any more."""
        if self._waiting is None:
            return
        adu, self._waiting = self._waiting, None
        self.statistics.stale += 1
        asked = request_class(adu.pdu)
        if asked is not None and asked.writes:
            self._carry_out(adu.unit, self.units[adu.unit], adu.pdu, now, answered=False)
        else:
            self.counters[adu.unit].received()
            self.counters[adu.unit].ignored()

    def _reply(self, adu: Adu, now: float) -> list[Reply]:
        """On a serial line."""
        pdu = self.answer(adu, now)
        if pdu is None:
            return []
        self.statistics.replies += 1
        self._said = Adu(adu.unit, pdu)
        return [Reply(self.line.response(adu, pdu), self.line.quiet_at)]

    def _overload(self, pdu: bytes) -> bytes | None:
        return None if pdu[0] & EXCEPTION_BIT else self._exception(pdu, ModbusException(SERVER_DEVICE_BUSY))

    def answer(self, adu: Adu, now: float) -> bytes | None:
        """The PDU that answers this one, or None for silence."""
        number, pdu, _ = adu
        if pdu[0] & EXCEPTION_BIT:
            self.statistics.not_requests += 1
            return None
        if self.serial and number == BROADCAST:
            self.statistics.broadcasts += 1
            for each, unit in self.units.items():
                self._carry_out(each, unit, pdu, now, answered=False, broadcast=True)
            return None
        found = self.units.get(number)
        if found is None and not self.serial:
            found = self.units.get(255, self.units.get(0))
        if found is None:
            self.statistics.for_others += 1
            return None if self.serial else self._exception(pdu, ModbusException(0x0B))
        self.statistics.requests += 1
        return self._carry_out(number, found, pdu, now)

    def _carry_out(
        self, number: int, unit: Unit, pdu: bytes, now: float, *, answered: bool = True, broadcast: bool = False
    ) -> bytes | None:
        """One request for one unit; the answer, or None for silence. `answered` is False where nobody would hear it."""
        counters = self.counters[number] if self.serial else None
        if counters is not None:
            counters.received(broadcast=broadcast)
            if not counters.hears(pdu):
                counters.ignored()
                return None
        request: AnyRequest | None = None
        code: int | None = None
        try:
            try:
                request = read_request(pdu, unit, counters is not None)
                if self._permits is not None and not self._permits(number, request):
                    raise ModbusException(ILLEGAL_FUNCTION)
                if counters is None:
                    response = unit.handle(request, now)
                else:
                    response = self._handle(unit, counters, request, now)
                # Checked here, where a response that is none is still the unit's failure and not the line's.
                answer = None if response is None else checked(response.encode())
            except ModbusException as declined:
                answer, code = self._exception(pdu, declined), declined.code
        except Exception as error:
            # A unit's own code failed. The client gets an answer, the line goes on, and the error is kept to be seen.
            self.statistics.failed(error)
            code = SERVER_DEVICE_FAILURE
            answer = self._exception(pdu, ModbusException(code))
        if counters is not None:
            counters.finished(request, code, answered=answered and answer is not None)
        return answer if answered else None

    @staticmethod
    def _handle(unit: Unit, counters: SerialCounters, request: AnyRequest, now: float) -> Response | None:
        """On a serial line, where what the unit declines may be a question about the line."""
        try:
            return unit.handle(request, now)
        except ModbusException as declined:
            is_about_line = isinstance(request, ANSWERED) and getattr(unit, "diagnostics", True)
            if declined.code != ILLEGAL_FUNCTION or not is_about_line:
                raise
        return counters.answer(request)

    def _exception(self, pdu: bytes, declined: ModbusException) -> bytes:
        answer: Response = ExceptionResponse(pdu[0] | EXCEPTION_BIT, declined.code)
        if isinstance(declined, SdoAborted):
            answer = ExtendedExceptionResponse(declined.abort_code)
        data = answer.encode()
        self.statistics.exceptions += 1
        return data


def counters_for(line: Line) -> defaultdict[int, SerialCounters]:
    """What the units behind such a line remember of it, by unit. Several connections to one line share it."""
    return defaultdict(partial(SerialCounters, has_delimiter=getattr(line, "has_delimiter", False)))


def read_request(pdu: bytes, unit: Unit | None = None, diagnostics: bool = False) -> AnyRequest:
    """The request, or the exception that the standard has for what is wrong with it: 01, 03, for file records 02.

    `unit` is asked what it supports, if it can tell; with `diagnostics` functions 08, 0B and 0C are there anyway.
    """
    asked = request_class(pdu)
    supports = getattr(unit, "supports", None)
    is_there = asked is not None and (supports is None or supports(asked) or (diagnostics and asked in ANSWERED))
    if asked is None or not is_there:
        raise ModbusException(ILLEGAL_FUNCTION, pdu[0] if pdu else None)
    try:
        return asked.decode(pdu)
    except DecodeError as error:
        raise ModbusException(asked.declines(error), pdu[0]) from error
