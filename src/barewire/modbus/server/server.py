"""The server as a machine: `feed` takes received bytes and returns the bytes to send. It never raises.

    feed(bytes, now) ->  line  ->  Adu  ->  for one of the units?  ->  decode  ->  unit.handle  ->  Reply(bytes, at)
                          '-> Noise: counted     '-> no: silence        '-> 01, 03      '-> 02, 03, 04 ...

The order of checks is that of the standard's figures: function (01), then quantity and lengths (03), then address
(02), then the execution (04) [MB-APP 7, figures 11 to 27].

**On a serial line** silence is part of the protocol:

- A broadcast is carried out and not answered. Frames for other units are ignored, and so are frames with bit 7 of the
  function set: these are exception responses of other units.
- A request is not answered late. If other traffic followed it, its client has given up, and a response would collide
  with the next request. Such a *stale* request is dropped if it reads, and carried out without response if it writes.
- Up to three bytes after a request are a glitch of a line that changes direction. The request is answered as soon as
  it is certain that no more bytes follow.
- Functions 08, 0B and 0C are answered from `counters` if the unit does not answer them itself.

**A line that echoes** returns what the server sends: the receiver of its adapter stays on. The response to function 05,
06, 08 or 16 has the bytes of its request, so a server that took its echo for a request would answer it, and the next
echo again, for ever. But a master may well send the same write twice:

    master    06 0001 0007                                       06 0001 0007    not before t3.5, and it takes its time
    server                   06 0001 0007 |<- t3.5 ->|<- takes ->|
    adapter                  06 0001 0007                                        its echo, or
                                       06 0001 0007                              late, as USB delivers it

- A copy of the latest response that cannot be a request, such as values of registers or an exception, is an echo: the
  line echoes. From then on the first copy of a response within a second is its echo.
- Three responses in a row that were each followed by another frame than a copy: the line does not echo. From then on
  every copy is a request.
- Before either is known, a copy that is complete before another station can have sent it is an echo, another one is a
  request. But the hundredth of these in a row, each within 0.05 s of its response, gets exception 06 (busy), whose copy
  cannot be a request. So no write is carried out for ever.

With `echoes=True` (`echo=auto` in a URL) a server begins as on a line that is known to echo. With an `EchoLine`
(`echo=1`), which removes echoes byte by byte, it sees no copies.

**On TCP** every request is answered, with its transaction number. Requests beyond `transactions` in one read get
exception 06 (busy). A frame with bit 7 of the function set is not a request there either: it is ignored, because any
response to it could be mistaken for the response to another request.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple, Protocol, TypeAlias

from barewire.errors import DecodeError
from barewire.modbus.adu import BROADCAST, Adu, Noise
from barewire.modbus.exceptions import (
    ILLEGAL_FUNCTION,
    SERVER_DEVICE_BUSY,
    SERVER_DEVICE_FAILURE,
    ModbusException,
)
from barewire.modbus.framing import Line, LineEvent
from barewire.modbus.messages.base import EXCEPTION_BIT, Response, checked, encoded
from barewire.modbus.messages.canopen_reference import ExtendedExceptionResponse, SdoAborted
from barewire.modbus.messages.exception_response import ExceptionResponse
from barewire.modbus.messages.raw import RawRequest
from barewire.modbus.messages.registry import AnyRequest, request_class
from barewire.modbus.server.serial_counters import ANSWERED, SerialCounters

TRANSACTIONS = 16
"""NumberMaxOfServerTransaction: the most requests of one client that are handled at a time [MB-TCP 4.4.2]."""

_GLITCH = 3
"""The most bytes after a request that cannot be a frame: the shortest frame has four."""

_SOON = 0.1
"""Seconds: the longest wait for a line to decide that a glitch is not a frame. ASCII lines take longer."""

_ECHO_WITHIN = 1.0
"""Seconds after a response in which its echo is expected. Adapters need up to 0.02."""

_WITHOUT_ECHO = 3
"""Responses in a row without a copy that show that a line does not echo. One may lack it: another frame was received
before the response was sent, because the server was slow."""

_LOOP, _LOOP_WITHIN = 100, 0.05
"""So many copies in a row, each within so many seconds of its response, may be a server that answers itself."""


class Unit(Protocol):
    """One unit address of a server: a table, a simulator, or a class of the application.

    `handle` returns the response, or None to stay silent (a device that reboots instead of answering), or raises
    ModbusException to decline. Two more members are optional:

        supports(request_class) -> bool    False makes a malformed request of that function exception 01, not 03
        diagnostics                        False for a device that declines functions 08, 0B and 0C on purpose
        delays                             True if `handle` may return a `Delayed` response
    """

    def handle(self, request: Any, now: float) -> Response | Delayed | None: ...


class PduUnit(Protocol):
    """A unit that gets each request as its bytes, of any function code, before the server judges the function.

    `handle_pdu` returns the PDU of the response, None to stay silent, or a `LaterResponse`; or raises ModbusException.
    With an asyncio server it may be `async def`. On a serial line it gets functions 08, 0B and 0C too.
    """

    def handle_pdu(self, pdu: bytes, caller: Caller) -> bytes | LaterResponse | Awaitable[bytes | None] | None: ...


class Caller:
    """The client of a connection, as a `PduUnit` sees it: one object for each connection, or each host on UDP.

    peer             its address, such as "10.0.0.7:51324"; empty on a serial line
    role             the role in its certificate; None without one
    is_gone          whether the connection has ended, so that a response reaches no client
    open_requests    how many of its requests wait for a `LaterResponse`
    """

    __slots__ = ("is_gone", "open_requests", "peer", "role")

    def __init__(self, peer: str = "", role: str | None = None) -> None:
        self.peer = peer
        self.role = role
        self.is_gone = False
        self.open_requests = 0

    def __repr__(self) -> str:
        return f"<Caller {self.peer or 'of a serial line'}{', gone' if self.is_gone else ''}>"


class LaterResponse:
    """A response that a `PduUnit` does not have yet: it returns this, and calls `give` when it has the response.

    `give` is called once, in the thread of the server. Responses to the requests of one connection may be given in any
    order: on TCP each has its transaction number. On a serial line a response is dropped if another request followed
    meanwhile, because its client has given up.
    """

    __slots__ = ("_deliver", "_is_given", "_response")

    def __init__(self) -> None:
        self._deliver: Callable[[bytes | BaseException | None], None] | None = None
        self._response: bytes | BaseException | None = None
        self._is_given = False

    def __repr__(self) -> str:
        return f"<LaterResponse {'given' if self._is_given else 'open'}>"

    def give(self, response: bytes | BaseException | None) -> None:
        """Send the response, or let the server be silent. A second call has no effect.

        An exception is treated as one that `handle_pdu` raises: ModbusException declines, another one is 04.
        """
        if self._is_given:
            return
        self._is_given = True
        if self._deliver is None:
            self._response = response  # `handle_pdu` has not returned yet
        else:
            self._deliver(response)

    def deliver_to(self, deliver: Callable[[bytes | BaseException | None], None]) -> None:
        """Called by the server: where the response goes. If it was given already, it goes there at once."""
        self._deliver = deliver
        if self._is_given:
            deliver(self._response)


AnyUnit: TypeAlias = Unit | PduUnit
"""What a server has at an address."""


class Delayed(NamedTuple):
    """A response, or an exception to decline with, that is sent `seconds` after the request was received."""

    response: Response | ModbusException
    seconds: float


class Reply(NamedTuple):
    """Bytes to send, not before the time `at` (t3.5 of silence on RTU)."""

    data: bytes
    at: float
    request: bytes = b""
    """The PDU of the request."""


@dataclass
class ServerStatistics:
    """Counters, and the latest errors of units. (The counters of the standard are in `serial_counters`.)

    Each frame is in one of `requests`, `broadcasts`, `for_others`, `busy`, `not_requests`, `stale` and `echoes`. Each
    connection is open, or in one of `left`, `refused`, `idle`, `broken` and `stopped`; their sum is `opened`. The owner
    of the connections counts them.
    """

    requests: int = 0
    """Requests carried out, or answered with an exception, for one of the units."""
    replies: int = 0
    """Responses sent, exceptions among them."""
    exceptions: int = 0
    """Exceptions, also those that broadcasts and stale requests would have had."""
    denied: int = 0
    """Requests that the role of the client does not permit; also among `requests` and `exceptions`."""
    broadcasts: int = 0
    for_others: int = 0
    """Requests for units that are not served: exception 0B on TCP, silence on a serial line."""
    busy: int = 0
    """Requests beyond the limit in one read, answered with exception 06; on UDP those of a host beyond its limit; on a
    serial line those with which the server finds out whether the line echoes."""
    noise_bytes: int = 0
    not_requests: int = 0
    """Frames with bit 7 of the function code set."""
    stale: int = 0
    """Requests followed by other traffic before they could be answered."""
    echoes: int = 0
    """The server's own responses, received again; on UDP also what comes from its own address."""
    opened: int = 0
    """Connections of clients."""
    left: int = 0
    """Connections that the client or the network ended."""
    refused: int = 0
    """Connections closed because there were too many, or without a TLS session."""
    idle: int = 0
    """Connections closed because they were silent too long."""
    broken: int = 0
    """Connections closed because their bytes could not be read any more, or the code of the application failed."""
    stopped: int = 0
    """Connections closed with the server."""
    failures: list[str] = field(default_factory=list)
    """The latest ten errors raised by the code of units; each was answered with exception 04."""

    def failed(self, error: BaseException) -> None:
        """Record an error of a unit's code. Its `__str__` belongs to the unit as well, and may raise."""
        try:
            text = str(error)
        except Exception:
            text = "(no text)"
        self.failures = [*self.failures[-9:], f"{type(error).__name__}: {text}"]


class Server:
    """Several units behind one line.

    line            the framing
    units           address -> unit. On TCP, requests for other addresses go to `units[255]` or `units[0]` if there is
                    one, and get exception 0B otherwise; on a serial line they are for other servers, and broadcasts
                    are for all units, or for `units[0]` alone if there is one
    serial          whether the line has broadcasts and other servers, as serial lines do; TCP has neither
    transactions    the most requests in one read that are handled (TCP only, default 16)
    permits         permits(unit, request) decides whether a request is carried out; exception 01 if not
    counters        those of another connection to the same units, to share them (default: new ones)
    statistics      those of another connection to the same units, to share them (default: new ones)
    on_failure      called as on_failure(unit, request or None, error) for each error in the code of a unit. It may
                    raise the error again; without it, SystemExit and the like are raised
    on_refusal      called as on_refusal(unit, request or None) for a request that is not permitted, and for one to a
                    unit that is not served (None), except on a serial line
    caller          the client, for units that are a `PduUnit`
    send_later      called as send_later(reply, caller) with the reply of a `LaterResponse`; without it a unit that
                    returns one has failed
    wait_for        makes a `LaterResponse` of what an `async def handle_pdu` returns; without it that is a failure too
    echoes          whether a serial line echoes; None (default) if that is not known. The server finds out
    """

    def __init__(
        self,
        line: Line,
        units: Mapping[int, AnyUnit],
        *,
        serial: bool,
        transactions: int = TRANSACTIONS,
        permits: Callable[[int, AnyRequest], bool] | None = None,
        counters: defaultdict[int, SerialCounters] | None = None,
        statistics: ServerStatistics | None = None,
        on_failure: Callable[[int, AnyRequest | None, BaseException], None] | None = None,
        on_refusal: Callable[[int, AnyRequest | None], None] | None = None,
        caller: Caller | None = None,
        send_later: Callable[[Reply, Caller], None] | None = None,
        wait_for: Callable[[Awaitable[bytes | None]], LaterResponse] | None = None,
        echoes: bool | None = None,
    ) -> None:
        self.line = line
        self.units = units
        self.serial = serial
        self.statistics = ServerStatistics() if statistics is None else statistics
        self.counters: defaultdict[int, SerialCounters] = counters_for(line) if counters is None else counters
        """By unit, on serial lines."""
        self.caller = Caller() if caller is None else caller
        self._send_later = send_later
        self._wait_for = wait_for
        self._latest: Adu | None = None  # the latest request on a serial line: only that may be answered later
        self._transactions = transactions
        self._permits = permits
        self._on_failure = on_failure
        self._on_refusal = on_refusal
        self._waiting: Adu | None = None  # answered if at most a glitch follows
        self.echoes = echoes
        self._sent: Adu | None = None  # the latest response on a serial line, until a copy of it is received
        self._sent_at = 0.0
        self._early = 0.0  # no other station can have sent a copy of it that is complete before this time
        self._awaits_copy = False  # the next frame shows whether the line echoes
        self._without_echo = 0  # responses in a row that were followed by another frame than a copy
        self._repeats = 0  # copies in a row that were taken for requests
        self._delay = 0.0  # seconds that the response to the present request is delayed

    def __repr__(self) -> str:
        units = ", ".join(map(str, self.units)) or "none"
        return f"<{type(self).__name__}: units {units}, {self.line!r}>"

    @property
    def deadline(self) -> float | None:
        """The time at which to feed None if nothing arrived."""
        return self.line.deadline

    def feed(self, data: bytes | None, now: float) -> list[Reply]:
        """Return the replies to these bytes, or to the time that passed. Raises only what `on_failure` does."""
        line = self.line
        if self.serial:
            return self._feed_serial(line.feed(data, now), now)
        replies = []
        room = self._transactions - self.caller.open_requests
        for event in line.feed(data, now):
            if isinstance(event, Noise):
                self.statistics.noise_bytes += len(event.data)
                continue
            pdu = self.answer(event, now) if room > 0 else self._overload(event.pdu)
            room -= 1
            if pdu is not None:
                self.statistics.replies += 1
                at = now + self._delay if self._delay else 0.0
                replies.append(Reply(line.response(event, pdu), at, event.pdu))
        return replies

    def sent(self, now: float, takes: float = 0.0) -> None:
        """Record that the latest reply on a serial line was transmitted, its last byte at `now` at the earliest.

        `takes`: seconds that its bytes take on the line, and so do those of another station; 0 if that is unknown.
        """
        self.line.sent(now)
        self._sent_at = now
        self._early = max(now, self.line.quiet_at) + takes

    def overrun(self) -> None:
        """Count a character that the port lost. Called by the owner of the port."""
        for counters in self._counters():
            counters.overrun()

    def _counters(self) -> Iterable[SerialCounters]:
        return [self.counters[number] for number in self.units]

    def _feed_serial(self, events: list[LineEvent], now: float) -> list[Reply]:
        """Return the replies on a serial line."""
        for event in events:
            if isinstance(event, Noise):
                self.statistics.noise_bytes += len(event.data)
                for counters in self._counters():
                    counters.damaged()
                if len(event.data) > _GLITCH:
                    self._drop_stale(now)
                continue
            if event == self._sent:
                if self._is_echo(event, now):
                    continue
            else:
                self._repeats = 0
                if self._awaits_copy:
                    self._awaits_copy = False
                    self._without_echo += 1
                    if self._without_echo >= _WITHOUT_ECHO:
                        self.echoes = False
            for counters in self._counters():
                counters.frame()
            self._drop_stale(now)
            self._latest = event
            if event.unit in self.units and event.unit != BROADCAST:
                self._waiting = event
            else:
                self.answer(event, now)
        if self._waiting is None:
            return []
        held = len(self.line.held)
        if held > _GLITCH:
            self._drop_stale(now)
            return []
        if held and self.line.deadline is not None and self.line.deadline <= now + _SOON:
            return []
        waiting, self._waiting = self._waiting, None
        return self._reply(waiting, now)

    def _is_echo(self, copy: Adu, now: float) -> bool:
        """Whether this copy of the latest response is its echo."""
        self._sent, self._awaits_copy = None, False
        if not _can_be_request(copy.pdu):
            self.echoes = True
        elif self.echoes is False or now >= (self._sent_at + _ECHO_WITHIN if self.echoes else self._early):
            if self.echoes is None and now < self._sent_at + _LOOP_WITHIN:
                self._repeats += 1
            return False
        self._without_echo = self._repeats = 0
        self.statistics.echoes += 1
        return True

    def _drop_stale(self, now: float) -> None:
        """Drop the waiting request: other traffic followed it, so its client does not expect a response any more."""
        if self._waiting is None:
            return
        adu, self._waiting = self._waiting, None
        self.statistics.stale += 1
        request = request_class(adu.pdu)
        if request is not None and request.writes is True:  # of Diagnostics only a message knows it
            self._carry_out(adu, self.units[adu.unit], now, answered=False)
        else:
            self.counters[adu.unit].received()
            self.counters[adu.unit].ignored()

    def _reply(self, adu: Adu, now: float) -> list[Reply]:
        """Return the reply to a request on a serial line; none if the unit stays silent."""
        if self._repeats < _LOOP:
            pdu = self.answer(adu, now)
        else:
            pdu, self._delay = self._overload(adu.pdu), 0.0
            self._repeats, self._without_echo = 0, _WITHOUT_ECHO - 1  # whatever follows shows whether the line echoes
        return [] if pdu is None else [self._reply_with(adu, pdu, now + self._delay)]

    def _reply_with(self, adu: Adu, pdu: bytes, at: float) -> Reply:
        """Return the reply with this response, sent at this time at the earliest, and count it."""
        self.statistics.replies += 1
        if self.serial:
            self._sent = Adu(adu.unit, pdu)
            self._awaits_copy = self.echoes is not False
            at = self._sent_at = self._early = max(self.line.quiet_at, at)
        return Reply(self.line.response(adu, pdu), at, adu.pdu)

    def _overload(self, pdu: bytes) -> bytes | None:
        """Return the response to a request beyond the limit of transactions."""
        if pdu[0] & EXCEPTION_BIT:
            self.statistics.not_requests += 1
            return None
        self.statistics.busy += 1
        return self._exception(pdu, ModbusException(SERVER_DEVICE_BUSY))

    def answer(self, adu: Adu, now: float) -> bytes | None:
        """Carry out a request, and return the PDU of the response, or None for silence."""
        number, pdu, _ = adu
        self._delay = 0.0
        if pdu[0] & EXCEPTION_BIT:
            self.statistics.not_requests += 1
            return None
        if self.serial and number == BROADCAST:
            self.statistics.broadcasts += 1
            # A gateway has a unit 0, which passes a broadcast on, in place of all its units.
            for_all = self.units.get(BROADCAST)
            for address, unit in self.units.items() if for_all is None else ((BROADCAST, for_all),):
                self._carry_out(Adu(address, pdu), unit, now, answered=False, broadcast=True)
            return None
        addressed = self.units.get(number)
        if addressed is None and not self.serial:
            addressed = self.units.get(255, self.units.get(0))
        if addressed is None:
            self.statistics.for_others += 1
            if self.serial:
                return None
            if self._on_refusal is not None:
                self._on_refusal(number, None)
            return self._exception(pdu, ModbusException(0x0B))
        self.statistics.requests += 1
        return self._carry_out(adu, addressed, now)

    def _carry_out(
        self, adu: Adu, unit: Any, now: float, *, answered: bool = True, broadcast: bool = False
    ) -> bytes | None:
        """Carry out one request on one unit. Returns the response; None for silence, or if `answered` is False."""
        number, pdu, _ = adu
        counters = self.counters[number] if self.serial else None
        if counters is not None:
            counters.received(broadcast=broadcast)
            if not counters.accepts(pdu):
                counters.ignored()
                return None
        if not hasattr(unit, "handle"):
            return self._pass_on(adu, unit, answered)
        request: AnyRequest | None = None
        code: int | None = None
        try:
            try:
                request = _read_request(pdu, unit, counters is not None)
                self._check_permission(number, request)
                if counters is None:
                    response = unit.handle(request, now)
                else:
                    response = self._handle(unit, counters, request, now)
                if isinstance(response, Delayed):
                    response = self._delayed(response)
                # Checked here, so that an invalid response is a failure of the unit and not of the line.
                answer = None if response is None else encoded(response)
            except ModbusException as declined:
                answer, code = self._exception(pdu, declined), declined.code
        except BaseException as error:
            self._fail(number, request, error)
            code = SERVER_DEVICE_FAILURE
            answer = self._exception(pdu, ModbusException(code))
        if counters is not None:
            counters.finished(request, code, answered=answered and answer is not None)
        return answer if answered else None

    def _check_permission(self, number: int, request: AnyRequest) -> None:
        """Raise ModbusException 01 for a request that the client may not send.                        [MB-TLS R-31]"""
        if self._permits is not None and not self._permits(number, request):
            self.statistics.denied += 1
            if self._on_refusal is not None:
                self._on_refusal(number, request)
            raise ModbusException(ILLEGAL_FUNCTION)

    def _pass_on(self, adu: Adu, unit: PduUnit, answered: bool) -> bytes | None:
        """Let a `PduUnit` handle a request. Returns its response; None for silence, and for a response that comes
        later."""
        response: Any = None
        try:
            if self._permits is not None:
                raw = RawRequest(adu.pdu)
                self._check_permission(adu.unit, raw.known or raw)
            response = unit.handle_pdu(adu.pdu, self.caller)
            is_later = isinstance(response, LaterResponse)
            if not is_later and self._wait_for is not None and hasattr(response, "__await__"):
                response, is_later = self._wait_for(response), True
            if is_later and self._send_later is not None:
                self.caller.open_requests += 1
                response.deliver_to(partial(self._give, adu, self.caller, answered))
                return None
        except BaseException as error:
            response = error
        return self._given(adu, response) if answered else None

    def _give(self, adu: Adu, caller: Caller, answered: bool, response: object) -> None:
        """Send a response that comes later, unless its client waits no longer."""
        caller.open_requests -= 1
        pdu = self._given(adu, response)
        if pdu is None or not answered or caller.is_gone or (self.serial and adu is not self._latest):
            return
        assert self._send_later is not None, "without it no response comes later"
        self._send_later(self._reply_with(adu, pdu, 0.0), caller)

    def _given(self, adu: Adu, response: Any) -> bytes | None:
        """Return the PDU of what a `PduUnit` returned or raised: its bytes, None, or an exception response."""
        try:
            if isinstance(response, BaseException):
                raise response
            # Checked here, so that an invalid response is a failure of the unit and not of the line.
            pdu = None if response is None else checked(response)
        except ModbusException as declined:
            pdu = declined.pdu
            if pdu is None:
                return self._exception(adu.pdu, declined)
        except BaseException as error:
            self._fail(adu.unit, None, error)
            return self._exception(adu.pdu, ModbusException(SERVER_DEVICE_FAILURE))
        if pdu is not None and pdu[0] & EXCEPTION_BIT:
            self.statistics.exceptions += 1
        return pdu

    def _fail(self, number: int, request: AnyRequest | None, error: BaseException) -> None:
        """Record and report an error in the code of a unit. Without `on_failure`, raise one that ends the program."""
        if self._on_failure is not None:
            self._on_failure(number, request, error)
        elif not isinstance(error, Exception):
            raise error
        self.statistics.failed(error)

    def _delayed(self, delayed: Delayed) -> Response:
        """Keep the delay for the reply and return the response. Raises the exception that is in its place."""
        response, self._delay = delayed
        if isinstance(response, ModbusException):
            raise response
        return response

    @staticmethod
    def _handle(unit: Unit, counters: SerialCounters, request: AnyRequest, now: float) -> Response | Delayed | None:
        """Handle a request on a serial line: 08, 0B and 0C are answered from `counters` if the unit cannot."""
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
    """Return counters for the units behind a line, by unit. Several connections to the same units share them."""
    return defaultdict(partial(SerialCounters, has_delimiter=getattr(line, "has_delimiter", False)))


def _can_be_request(pdu: bytes) -> bool:
    """Whether the bytes of a response are also those of a request. Of an unknown function they may be."""
    request = request_class(pdu)
    if request is None:
        return not pdu[0] & EXCEPTION_BIT
    try:
        request.decode(pdu)
    except DecodeError:
        return False
    return True


def _read_request(pdu: bytes, unit: Unit, diagnostics: bool) -> AnyRequest:
    """Decode a request. Raises ModbusException with the code of the standard: 01, 03, or 02 for file records.

    A function that `unit.supports` excludes is 01, except, with `diagnostics`, 08, 0B and 0C.
    """
    request = request_class(pdu)
    supports = getattr(unit, "supports", None)
    if request is None or not (supports is None or supports(request) or (diagnostics and request in ANSWERED)):
        raise ModbusException(ILLEGAL_FUNCTION, pdu[0] if pdu else None)
    try:
        return request.decode(pdu)
    except DecodeError as error:
        raise ModbusException(request.declines(error), pdu[0]) from error
