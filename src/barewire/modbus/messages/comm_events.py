"""The recent events of a serial server: function codes 0B (event counter) and 0C (event log).

An event is one byte. Its top two bits determine the meaning of the others [MB-APP 6.10]:

    1.......    a request arrived    bit 1 damaged, 4 overrun, 5 while in listen only mode, 6 a broadcast
    01......    it was handled       bit 0 exception 1..3, 1 exception 4, 2 exception 5 or 6, 3 exception 7,
                                     4 write time-out, 5 while in listen only mode
    00000100    entered listen only mode
    00000000    communications were restarted
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

from barewire.codecs import Field, Layout
from barewire.errors import DecodeError
from barewire.modbus.messages.base import Request, Response, check_bytes, check_range

EVENT_LIMIT = 64
"""The most events in a log."""

READY, BUSY = 0x0000, 0xFFFF
"""The status word: BUSY while an earlier program command is still being executed."""

RESTARTED, LISTENS_ONLY, SENT, RECEIVED = 0x00, 0x04, 0x40, 0x80

_RECEIVED_BITS = {1: "communication error", 4: "character overrun", 5: "in listen only mode", 6: "broadcast"}
_SENT_BITS = {
    0: "exception 1..3",
    1: "exception 4",
    2: "exception 5 or 6",
    3: "exception 7",
    4: "write time-out",
    5: "in listen only mode",
}


def event_text(event: int) -> str:
    """Describe one byte of the log in words.

    >>> event_text(0xC0), event_text(0x41), event_text(0x04)
    ('received: broadcast', 'sent: exception 1..3', 'entered listen only mode')
    """
    if event & RECEIVED:
        event_name, bits = "received", _RECEIVED_BITS
    elif event & SENT:
        event_name, bits = "sent", _SENT_BITS
    else:
        known = {RESTARTED: "communications restarted", LISTENS_ONLY: "entered listen only mode"}
        return known.get(event, "undefined event")
    details = ", ".join(words for bit, words in bits.items() if event >> bit & 1)
    return f"{event_name}: {details}" if details else event_name


def _status_words(fields: list[Field], name: str = "status") -> list[Field]:
    words = {READY: "ready", BUSY: "busy with a program command"}
    return [
        field._replace(meaning=words.get(int(str(field.value)), "neither 0000h nor FFFFh"))
        if field.name == name
        else field
        for field in fields
    ]


@dataclass(frozen=True, slots=True)
class GetCommEventCounterResponse(Response):
    """The number of requests that were carried out without an exception.                  [MB-APP 6.9]

        0B | status 2 | event count 2

    >>> GetCommEventCounterResponse(status=0xFFFF, event_count=264).encode().hex(" ")
    '0b ff ff 01 08'
    """

    status: int
    event_count: int

    name: ClassVar[str] = "Get Comm Event Counter"
    function_code: ClassVar[int] = 0x0B
    layout: ClassVar[Layout] = Layout(">BHH", "function_code", "status", "event_count")

    def __post_init__(self) -> None:
        check_range("status", self.status, 0, 0xFFFF)
        check_range("event_count", self.event_count, 0, 0xFFFF)

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with the status in words."""
        return _status_words(cls.layout.fields(pdu))


@dataclass(frozen=True, slots=True)
class GetCommEventCounter(Request[GetCommEventCounterResponse]):
    """Read the number of requests that were carried out without an exception.             [MB-APP 6.9]

    After a lost response it shows whether the request was carried out, because then the number has grown.

        0B

    >>> GetCommEventCounter().encode().hex(" ")
    '0b'
    """

    name: ClassVar[str] = "Get Comm Event Counter"
    function_code: ClassVar[int] = 0x0B
    layout: ClassVar[Layout] = Layout(">B", "function_code")
    response: ClassVar[type[Response]] = GetCommEventCounterResponse


@dataclass(frozen=True, slots=True)
class GetCommEventLogResponse(Response):
    """Both counters and the latest events, at most 64, the newest first.                  [MB-APP 6.10]

        0C | byte count (6 + events) | status 2 | event count 2 | message count 2 | events ...

    >>> log = GetCommEventLogResponse.decode(bytes.fromhex("0C 08 0000 0108 0121 C040"))
    >>> log.message_count, log.texts()
    (289, ['received: broadcast', 'sent'])
    """

    status: int
    event_count: int
    message_count: int
    events: bytes

    name: ClassVar[str] = "Get Comm Event Log"
    function_code: ClassVar[int] = 0x0C
    layout: ClassVar[Layout] = Layout(
        ">BBHHH", "function_code", "byte_count", "status", "event_count", "message_count", tail="events"
    )

    def __post_init__(self) -> None:
        for name in ("status", "event_count", "message_count"):
            check_range(name, getattr(self, name), 0, 0xFFFF)
        object.__setattr__(self, "events", check_bytes("events", self.events))
        check_range("events", len(self.events), 0, EVENT_LIMIT)

    def texts(self) -> list[str]:
        """Return the events in words, the newest first."""
        return [event_text(event) for event in self.events]

    def encode(self) -> bytes:
        counts = (self.status, self.event_count, self.message_count)
        return self.layout.pack(self.function_code, 6 + len(self.events), *counts, tail=self.events)

    @classmethod
    def decode(cls, pdu: bytes) -> Self:
        cls.check_function(pdu)
        _, byte_count, status, event_count, message_count, events = cls.layout.unpack(pdu)
        if byte_count != 6 + len(events):
            text = f"byte count {byte_count}, but {6 + len(events)} bytes follow"
            raise DecodeError("length", pdu, 1, text)
        if len(events) > EVENT_LIMIT:
            raise DecodeError("value", pdu, 1, f"{len(events)} events: expected 0..{EVENT_LIMIT}")
        return cls(status, event_count, message_count, bytes(events))

    @classmethod
    def measure(cls, pdu: bytes) -> int | None:
        """Return the length from the byte count, once that has arrived; it is never less than the fixed part."""
        return max(cls.layout.size, 2 + pdu[1]) if len(pdu) > 1 else cls.layout.size

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with each event in words."""
        fields = _status_words([field for field in cls.layout.fields(pdu) if field.name != "events"])
        start = cls.layout.size
        return fields + [
            Field(start + row, 1, "event", event, event_text(event)) for row, event in enumerate(pdu[start:])
        ]


@dataclass(frozen=True, slots=True)
class GetCommEventLog(Request[GetCommEventLogResponse]):
    """Read both counters and the event log.                                               [MB-APP 6.10]

        0C

    >>> GetCommEventLog().encode().hex(" ")
    '0c'
    """

    name: ClassVar[str] = "Get Comm Event Log"
    function_code: ClassVar[int] = 0x0C
    layout: ClassVar[Layout] = Layout(">B", "function_code")
    response: ClassVar[type[Response]] = GetCommEventLogResponse
