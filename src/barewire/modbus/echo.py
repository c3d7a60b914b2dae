"""A line that receives its own frames: RS-485 adapters whose receiver stays on repeat every byte that is sent.

    sent        01 03 00 6B 00 03 74 17
    received    01 03 00 6B 00 03 74 17 | 01 03 06 02 2B ...      the echo is removed, byte for byte
    or          01 03 00 6B 01 ...                                another station was sending: a collision

Received bytes are compared, not counted. Where they differ from the sent ones, a Noise without bytes reports the
`collision`, and all bytes go to the inner line like any others: a good frame among them is still found. The echo itself
may be among them, behind a frame that the adapter had received before, and it may have the bytes of the response: so
the first copy of a request is removed wherever it comes, within a second and before the echo of a later request.

**Whether a line echoes** can be detected (`echoes=None`) with the first request whose response never has the same bytes
as the request, such as a read of registers. If its own bytes are received, the line echoes; if a response to this
function is received first, it does not. Until then the first copy of any other request is taken for an echo, although
the response to a write of one register has the same bytes: on a line without echo such a write gets no response, and
not a wrong one. A caller that relies on the detection should therefore read a register first.
"""

from __future__ import annotations

from collections import deque

from barewire.errors import DecodeError
from barewire.modbus.adu import Adu, Noise
from barewire.modbus.framing import Line, LineEvent

DETECTING = frozenset({0x03, 0x04, 0x07, 0x0B, 0x0C, 0x0F, 0x10, 0x11, 0x18})
"""Functions whose response never has the length of the request, so that an echo is recognised with certainty."""

_ECHO_WITHIN = 1.0
"""Seconds after a request was sent in which its echo is expected. Adapters need up to 0.02."""


class _Unseen:
    """A request whose echo has not arrived."""

    def __init__(self, unit: int, pdu: bytes, data: bytes) -> None:
        self.unit, self.pdu, self.data = unit, pdu, data
        self.until = float("inf")  # its echo is expected until this time; not known before it was sent


class EchoLine:
    """A line without the echo of the bytes that it sends. `echoed` counts bytes, `collisions` damaged echoes.

        line      the inner line
        pause     seconds without a byte after which an echo that has begun is incomplete (default 0.1)
        echoes    True (default), or None to detect it: then it becomes True or False, once

    Every byte fed to it is in a frame, in a noise, held, or counted in `echoed`.
    """

    def __init__(self, line: Line, *, pause: float = 0.1, echoes: bool | None = True) -> None:
        self.line = line
        self.echoes = echoes
        self.echoed = 0
        self.collisions = 0
        self._pause = pause
        self._expected = b""  # sent, and its echo not complete
        self._received = b""  # the part of the echo that has arrived
        self._is_sent = True  # the latest bytes were transmitted
        self._detects = 0  # the function of the latest request, if its response cannot have the same bytes
        self._unseen: deque[_Unseen] = deque()  # the requests without echo, the oldest first: of one second
        self._is_first = False  # the next event is the first one since the latest bytes
        self._last = 0.0

    @property
    def numbered(self) -> bool:
        """That of the inner line."""
        return self.line.numbered

    @property
    def has_delimiter(self) -> bool:
        """That of the inner line."""
        return getattr(self.line, "has_delimiter", False)

    @property
    def quiet_at(self) -> float:
        """That of the inner line: an echo lasts as long as the transmission."""
        return self.line.quiet_at

    @property
    def delay(self) -> float:
        """That of the inner line, which gets the beginning of an echo only after the pause."""
        return self.line.delay + self._pause

    @property
    def broken(self) -> DecodeError | None:
        """That of the inner line."""
        return self.line.broken

    @property
    def deadline(self) -> float | None:
        """That of the inner line, or the end of the pause in an echo that has begun."""
        times = [self.line.deadline, self._last + self._pause if self._received else None]
        return min((time for time in times if time is not None), default=None)

    @property
    def held(self) -> bytes:
        """The bytes held by the inner line, and the beginning of an echo."""
        return self.line.held + self._received

    def request(self, unit: int, pdu: bytes) -> bytes:
        """Return the bytes of a request, and expect their echo."""
        data = self.expect_echo(self.line.request(unit, pdu), detects=pdu[0] if pdu[0] in DETECTING else 0)
        if self.echoes is not False:
            self._unseen.append(_Unseen(unit, pdu, data))
        return data

    def response(self, to: Adu, pdu: bytes) -> bytes:
        """Return the bytes of a response, and expect their echo."""
        return self.expect_echo(self.line.response(to, pdu))

    def expect_echo(self, data: bytes, *, detects: int = 0) -> bytes:
        """Return the bytes, and expect their echo. `detects`: their function, if no response has the same bytes."""
        if self.echoes is False:
            return data
        self._detects = detects
        self._is_first = True
        # Several frames may be sent in a row. The echo of a frame that was sent is given up if nothing of it arrived.
        self._expected = data if self._is_sent and not self._received else self._expected + data
        self._is_sent = False
        return data

    def sent(self, now: float) -> None:
        """Record that the bytes were transmitted, the last one at `now`."""
        self._is_sent = True
        self.line.sent(now)
        while self._unseen and self._unseen[0].until <= now:
            self._unseen.popleft()
        for request in self._unseen:
            request.until = min(request.until, now + _ECHO_WITHIN)

    def continue_from(self, before: Line) -> None:
        """Expect the echoes that the line of a connection before this one has not received: a port that failed may be
        opened again within the delay of an adapter."""
        if isinstance(before, EchoLine):
            self._unseen = before._unseen

    def answers(self, adu: Adu) -> bool:
        """Return the answer of the inner line."""
        return self.line.answers(adu)

    def feed(self, data: bytes | None, now: float) -> list[LineEvent]:
        """Return the events of the inner line, which receives all bytes except the echo. Never raises."""
        events = self._feed(data, now)
        if events and self._unseen:
            events = [event for event in events if not self._is_echo(event)]
        if events and self._is_first:
            self._is_first = False
            if self.echoes is None and self._shows_absence(events[0]):
                self.echoes = False
                self._unseen.clear()
        return events

    def _shows_absence(self, first: LineEvent) -> bool:
        """Whether the first event after a request is its response, and not a late one to another function."""
        if not self._detects or not isinstance(first, Adu) or not self.line.answers(first):
            return False
        return first.pdu[0] & 0x7F == self._detects

    def _is_echo(self, event: LineEvent) -> bool:
        """Whether the frame is the first copy of a request."""
        if isinstance(event, Adu):
            for request in self._unseen:
                if (event.unit, event.pdu) == (request.unit, request.pdu):
                    self.echoed += len(request.data)
                    self._is_first = False
                    self._forget(request.data)
                    return True
        return False

    def _forget(self, echo: bytes) -> None:
        """Expect neither this echo nor those of earlier requests any more."""
        while self._unseen and self._unseen.popleft().data != echo:
            pass

    def _feed(self, data: bytes | None, now: float) -> list[LineEvent]:
        if not self._expected:
            return self.line.feed(data, now)
        if not data:
            if self._received and now >= self._last + self._pause:
                text = f"the echo ended after {len(self._received)} bytes of {len(self._expected)}"
                return self._collide(b"", now, text)
            return self.line.feed(data, now)
        self._last = now
        received = self._received + data
        echo = received[: len(self._expected)]
        if not self._expected.startswith(echo):
            return self._collide(data, now, f"sent {_show(self._expected)}, received {_show(received)}")
        self._received = echo
        if len(echo) < len(self._expected):
            return []
        self.echoed += len(echo)
        self._expected = self._received = b""
        self._forget(echo)
        self._is_first = False
        if self._detects:
            self.echoes = True
        self.line.sent(now)
        return self.line.feed(received[len(echo) :], now) if len(received) > len(echo) else []

    def _collide(self, data: bytes, now: float, text: str) -> list[LineEvent]:
        received, self._expected, self._received = self._received + data, b"", b""
        if self.echoes is None:
            return self.line.feed(received, now)  # the line may not echo at all
        self.collisions += 1
        return [Noise(b"", "mismatch", f"collision: {text}"), *self.line.feed(received, now)]


def _show(data: bytes) -> str:
    return data[:16].hex(" ").upper() + (" ..." if len(data) > 16 else "")
