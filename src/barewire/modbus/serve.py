"""The server, as a machine: bytes in, bytes out, and no way to make it stumble.

    feed(bytes, now) ->  line  ->  Adu  ->  for one of my units?  ->  decode  ->  unit.handle  ->  Reply(bytes, at)
                          '-> Noise: counted     '-> no: silence       '-> 01, 03      '-> 02, 03, 04 ...

The order of checks is that of the standard's figures: function (01), then quantity and lengths (03), then address
(02), then doing it (04) [MB-APP 7, figures 11 to 27]. On a serial line nobody answers a broadcast or a frame for
somebody else.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

from barewire.errors import BarewireError, DecodeError, EncodeError
from barewire.modbus.adu import BROADCAST, Adu, Noise
from barewire.modbus.exceptions import (
    ILLEGAL_DATA_VALUE,
    ILLEGAL_FUNCTION,
    SERVER_DEVICE_FAILURE,
    ModbusException,
)
from barewire.modbus.functions import AnyRequest, decode_request
from barewire.modbus.line import Line
from barewire.modbus.message import EXCEPTION_BIT, ExceptionResponse, Response, checked


class Unit(Protocol):
    """What answers for one unit address: a table, a simulator, a program of the user's.

    Returns the response; None to stay silent (a device that reboots instead of answering); raises ModbusException to
    decline.
    """

    def handle(self, request: Any, now: float) -> Response | None: ...


class Reply(NamedTuple):
    """Bytes to send, not before the time `at` (t3.5 of silence on RTU)."""

    data: bytes
    at: float


@dataclass(slots=True)
class Tally:
    """What a server has seen, for whoever wants to know how the line is."""

    requests: int = 0
    replies: int = 0
    exceptions: int = 0
    broadcasts: int = 0
    for_others: int = 0
    noise_bytes: int = 0
    failures: list[str] = field(default_factory=list)
    """The latest errors of a unit's own code, at most ten: they were answered with exception 04."""


class Server:
    """Several units behind one line. `serial` lines have broadcasts and other units; TCP connections have neither.

    On TCP a unit that is not in `units` is answered by `units[255]` or `units[0]` if there is such a one, and by
    exception 0B otherwise; on a serial line it is somebody else, so there is silence.
    """

    def __init__(self, line: Line, units: Mapping[int, Unit], *, serial: bool) -> None:
        self.line = line
        self.units = units
        self.serial = serial
        self.tally = Tally()

    @property
    def deadline(self) -> float | None:
        """When to be fed None if nothing came."""
        return self.line.deadline

    def feed(self, data: bytes | None, now: float) -> list[Reply]:
        """Bytes that arrived; what is to be sent. Never raises."""
        replies = []
        for event in self.line.feed(data, now):
            if isinstance(event, Noise):
                self.tally.noise_bytes += len(event.data)
                continue
            pdu = self.answer(event, now)
            if pdu is not None:
                self.tally.replies += 1
                replies.append(Reply(self.line.response(event, pdu), self.line.quiet_at))
        return replies

    def answer(self, adu: Adu, now: float) -> bytes | None:
        """The PDU that answers this one, or None for silence."""
        if self.serial and adu.unit == BROADCAST:
            self.tally.broadcasts += 1
            for unit in self.units.values():
                self._carry_out(unit, adu.pdu, now)
            return None
        found = self.units.get(adu.unit)
        if found is None and not self.serial:
            found = self.units.get(255, self.units.get(0))
        if found is None:
            self.tally.for_others += 1
            if self.serial:
                return None
            return self._exception(adu.pdu, 0x0B)
        self.tally.requests += 1
        return self._carry_out(found, adu.pdu, now)

    def _carry_out(self, unit: Unit, pdu: bytes, now: float) -> bytes | None:
        try:
            try:
                response = unit.handle(read(pdu), now)
            except ModbusException as declined:
                return self._exception(pdu, declined.code)
            # Checked here, where a response that is none is still the unit's failure and not the line's.
            return None if response is None else checked(response.encode())
        except Exception as error:
            # A unit's own code failed. The client gets an answer, the line goes on, and the error is kept to be seen.
            self.tally.failures = [*self.tally.failures[-9:], f"{type(error).__name__}: {error}"]
            return self._exception(pdu, SERVER_DEVICE_FAILURE)

    def _exception(self, pdu: bytes, code: int) -> bytes:
        answer = ExceptionResponse(pdu[0] | EXCEPTION_BIT, code).encode()
        self.tally.exceptions += 1
        return answer


def read(pdu: bytes) -> AnyRequest:
    """The request, or the exception that the standard has for what is wrong with it: 01 or 03."""
    try:
        return decode_request(pdu)
    except DecodeError as error:
        code = ILLEGAL_FUNCTION if error.reason == "function" else ILLEGAL_DATA_VALUE
        raise ModbusException(code, pdu[0] if pdu else None) from error


def declined(error: BarewireError) -> ModbusException:
    """A unit's EncodeError or DecodeError as the exception that a client understands: the value is wrong."""
    if isinstance(error, ModbusException):
        return error
    assert isinstance(error, (EncodeError, DecodeError))
    return ModbusException(ILLEGAL_DATA_VALUE)
