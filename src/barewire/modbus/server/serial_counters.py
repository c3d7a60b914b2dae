"""The counters and the event log of a unit on a serial line, and its listen only mode.

    on the line               counted in                                                        [MB-SERIAL, appendix A]
    -----------               ----------
    not a frame (CRC, LRC)    bus errors                                                         08/0C
    a good frame              bus messages                                                       08/0B
    for this unit, or all     server messages                                                    08/0E
    no response sent          no responses                                                       08/0F
    exception sent            exceptions; NAK for 07, busy for 06                                08/0D, 10, 11
    request carried out       the event counter                                                  0B, 0C

The server calls a method for each of these. Functions 08, 0B and 0C are answered from the counters. All counters have
16 bits and **wrap**: 65535 is followed by 0, which the standard leaves open. The event counter does not count
exceptions, function 0B itself, and the two requests that set it to zero.

**Listen only mode** (08/04): the unit counts, stays silent and carries nothing out. Only Restart Communications (08/01)
ends the mode, and is not answered then.
"""

from __future__ import annotations

from collections import deque
from typing import Any

from barewire.modbus.exceptions import ILLEGAL_DATA_VALUE, ILLEGAL_FUNCTION, ModbusException
from barewire.modbus.messages.base import Response
from barewire.modbus.messages.comm_events import (
    BUSY,
    EVENT_LIMIT,
    LISTENS_ONLY,
    READY,
    RECEIVED,
    RESTARTED,
    SENT,
    GetCommEventCounter,
    GetCommEventCounterResponse,
    GetCommEventLog,
    GetCommEventLogResponse,
)
from barewire.modbus.messages.diagnostics import (
    CHANGE_ASCII_DELIMITER,
    CLEAR_COUNTERS,
    CLEAR_OVERRUN,
    DIAGNOSTIC_REGISTER,
    FORCE_LISTEN_ONLY,
    RESTART_AND_CLEAR_LOG,
    RESTART_COMMUNICATIONS,
    RETURN_QUERY_DATA,
    Diagnostics,
    DiagnosticsResponse,
)

ANSWERED = (Diagnostics, GetCommEventCounter, GetCommEventLog)
"""The requests about the line, not about the device, which `SerialCounters.answer` answers."""

_COUNTS = {
    0x0B: "bus_messages",
    0x0C: "bus_errors",
    0x0D: "exceptions",
    0x0E: "server_messages",
    0x0F: "no_responses",
    0x10: "naks",
    0x11: "busy_answers",
    0x12: "overruns",
}
_DAMAGED, _OVERRUN, _LISTENING, _BROADCAST = 0x02, 0x10, 0x20, 0x40
_RESTARTS = tuple(Diagnostics(RESTART_COMMUNICATIONS, data).encode() for data in (b"\0\0", RESTART_AND_CLEAR_LOG))
_EXCEPTION_BITS = {1: 0x01, 2: 0x01, 3: 0x01, 4: 0x02, 5: 0x04, 6: 0x04, 7: 0x08}


class SerialCounters:
    """The counters of one unit. The application may set `diagnostic_register` and `is_busy` (the status word of 0B).

    >>> counters = SerialCounters()
    >>> counters.frame(), counters.received()
    (None, None)
    >>> counters.answer(Diagnostics(0x0B)).count
    1
    """

    def __init__(self, *, has_delimiter: bool = False) -> None:
        self.listens_only = False
        self.has_delimiter = has_delimiter
        """Whether the line is ASCII: only there 08/03 can change the delimiter."""
        self.diagnostic_register = 0
        self.is_busy = False
        self.events: deque[int] = deque(maxlen=EVENT_LIMIT)
        """The log, the newest event first."""
        self._clear()

    def _clear(self) -> None:
        self.bus_messages = self.bus_errors = self.exceptions = self.server_messages = 0
        self.no_responses = self.naks = self.busy_answers = self.overruns = self.event_count = 0

    def _count(self, name: str) -> None:
        setattr(self, name, getattr(self, name) + 1 & 0xFFFF)

    def _log(self, event: int) -> None:
        self.events.appendleft(event | (_LISTENING if self.listens_only else 0))

    # What the server reports

    def frame(self) -> None:
        """Count a good frame, for any unit."""
        self._count("bus_messages")

    def damaged(self) -> None:
        """Count bytes that are not a frame."""
        self._count("bus_errors")
        self._log(RECEIVED | _DAMAGED)

    def overrun(self) -> None:
        """Count a character that the port lost."""
        self._count("overruns")
        self._log(RECEIVED | _OVERRUN)

    def received(self, *, broadcast: bool = False) -> None:
        """Count a request for this unit, or a broadcast, before it is carried out."""
        self._count("server_messages")
        self._log(RECEIVED | (_BROADCAST if broadcast else 0))

    def ignored(self) -> None:
        """Count a request that is neither carried out nor answered: the unit listens only, or the request is stale."""
        self._count("no_responses")

    def finished(self, request: Any, exception: int | None, *, answered: bool) -> None:
        """Count a request that was carried out, or declined with `exception`, and was answered or not.

        `request` is None if it could not be decoded.
        """
        if not answered:
            self._count("no_responses")
        if exception is not None:
            self._count("exceptions")
            if exception == 7:
                self._count("naks")
            elif exception == 6:
                self._count("busy_answers")
        sub_function = request.sub_function if exception is None and isinstance(request, Diagnostics) else None
        counted = exception is None and not isinstance(request, GetCommEventCounter)
        if counted and sub_function not in (RESTART_COMMUNICATIONS, CLEAR_COUNTERS, FORCE_LISTEN_ONLY):
            self._count("event_count")
        if sub_function not in (RESTART_COMMUNICATIONS, FORCE_LISTEN_ONLY):  # these have an event of their own
            self._log(SENT | _EXCEPTION_BITS.get(exception or 0, 0))

    # Responses

    def accepts(self, pdu: bytes) -> bool:
        """Whether this request is carried out: in listen only mode only Restart Communications is."""
        return not self.listens_only or pdu in _RESTARTS

    def answer(self, request: Any) -> Response | None:
        """Return the response to 08, 0B or 0C; None where the standard demands silence.

        Raises ModbusException 01 for other requests, for reserved sub-functions, and for Change ASCII Input Delimiter
        (08/03) on a line other than ASCII; 03 for a delimiter that would begin a message, or has more than seven bits.
        The line itself recognises 08/03 and changes its delimiter (`ascii.line`).
        """
        match request:
            case GetCommEventCounter():
                return GetCommEventCounterResponse(self._status, self.event_count)
            case GetCommEventLog():
                return GetCommEventLogResponse(self._status, self.event_count, self.bus_messages, bytes(self.events))
            case Diagnostics(sub_function, data):
                return self._diagnose(sub_function, data)
        raise ModbusException(ILLEGAL_FUNCTION)

    @property
    def _status(self) -> int:
        return BUSY if self.is_busy else READY

    def _diagnose(self, sub_function: int, data: bytes) -> Response | None:
        if sub_function == FORCE_LISTEN_ONLY:
            self.events.appendleft(LISTENS_ONLY)
            self.listens_only = True
            return None
        if sub_function == RESTART_COMMUNICATIONS:
            return self._restart(data)
        if sub_function == CHANGE_ASCII_DELIMITER:
            self._check_delimiter(data[0])
        elif sub_function in _COUNTS:
            data = int(getattr(self, _COUNTS[sub_function])).to_bytes(2, "big")
        elif sub_function == DIAGNOSTIC_REGISTER:
            data = self.diagnostic_register.to_bytes(2, "big")
        elif sub_function == CLEAR_COUNTERS:
            self._clear()
            self.diagnostic_register = 0
        elif sub_function == CLEAR_OVERRUN:
            self.overruns = 0
        elif sub_function != RETURN_QUERY_DATA:
            raise ModbusException(ILLEGAL_FUNCTION)
        return DiagnosticsResponse(sub_function, data)

    def _check_delimiter(self, character: int) -> None:
        if not self.has_delimiter:
            raise ModbusException(ILLEGAL_FUNCTION)
        if character == ord(":") or character > 0x7F:
            raise ModbusException(ILLEGAL_DATA_VALUE)

    def _restart(self, data: bytes) -> Response | None:
        """Clear the counters, and with FF00 the log. A unit that was in listen only mode does not respond."""
        was_silent = self.listens_only
        self.listens_only = False
        self._clear()
        if data == RESTART_AND_CLEAR_LOG:
            self.events.clear()
        self.events.appendleft(RESTARTED)
        return None if was_silent else DiagnosticsResponse(RESTART_COMMUNICATIONS, data)
