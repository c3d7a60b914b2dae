"""A line that hears itself: RS-485 adapters whose receiver stays on repeat every byte that we send.

    sent        01 03 00 6B 00 03 74 17
    heard       01 03 00 6B 00 03 74 17 | 01 03 06 02 2B ...      the echo is taken off, byte for byte
    or          01 03 00 6B 01 ...                                something else was on the wire: a collision

What is heard is compared, not counted. Where it differs, a Noise without bytes says `collision`, and all the bytes go
to the line inside, which does with them what it does with all bytes: a good frame among them is still found.

**Whether a line echoes** can be found out (`echoes=None`): the first question decides whose answer can never be the
same bytes as itself, which is true of reading registers and a few others. Its own bytes coming back are an echo; its
answer with nothing before it says that there is none. Until then the first copy of any other question (writing one
register is answered with the same bytes) is taken for an echo: on a line without one that is no answer, never a wrong
one. So whoever leaves it to the line begins with reading a register.
"""

from __future__ import annotations

from barewire.errors import DecodeError
from barewire.modbus.adu import Adu, Noise
from barewire.modbus.framing import Line, LineEvent

PAUSE = 0.1
"""Seconds without a byte after which an echo that has begun will not come to its end."""


TELLING = frozenset({0x03, 0x04, 0x07, 0x0B, 0x0C, 0x0F, 0x10, 0x11, 0x18})
"""Functions whose answer never has the length of the question."""


class EchoLine:
    """`line` with the echo of what we say taken off. `echoed` and `collisions` count bytes and times.

    `echoes` is True, or None as long as nobody knows; then it becomes True or False, once.

    Every byte that it is fed is in a frame, in a noise, held, or counted in `echoed`.
    """

    def __init__(self, line: Line, *, pause: float = PAUSE, echoes: bool | None = True) -> None:
        self.line = line
        self.echoes = echoes
        self.echoed = 0
        self.collisions = 0
        self._pause = pause
        self._expected = b""  # what we said and have not heard yet
        self._heard = b""  # the part of it that came so far
        self._left = True  # what we said last was sent
        self._tells = False  # what we said last cannot be its own answer
        self._first = False  # the next event is the first that came of it
        self._last = 0.0

    @property
    def numbered(self) -> bool:
        """As the line inside."""
        return self.line.numbered

    @property
    def has_delimiter(self) -> bool:
        """As the line inside."""
        return getattr(self.line, "has_delimiter", False)

    @property
    def quiet_at(self) -> float:
        """As the line inside: an echo lasts as long as the sending."""
        return self.line.quiet_at

    @property
    def broken(self) -> DecodeError | None:
        """As the line inside."""
        return self.line.broken

    @property
    def deadline(self) -> float | None:
        """That of the line inside, or the end of patience with an echo that has begun."""
        times = [self.line.deadline, self._last + self._pause if self._heard else None]
        return min((time for time in times if time is not None), default=None)

    @property
    def held(self) -> bytes:
        """The beginning of an echo, and what the line inside holds."""
        return self.line.held + self._heard

    def request(self, unit: int, pdu: bytes) -> bytes:
        """The bytes of a request, remembered."""
        return self.said(self.line.request(unit, pdu), tells=pdu[0] in TELLING)

    def response(self, to: Adu, pdu: bytes) -> bytes:
        """The bytes of an answer, remembered."""
        return self.said(self.line.response(to, pdu))

    def said(self, data: bytes, *, tells: bool = False) -> bytes:
        """The bytes that are about to be sent, remembered. `tells`: they cannot be their own answer."""
        if self.echoes is False:
            return data
        self._tells = tells
        self._first = True
        # Several frames may be said in a row; one that left and was not heard at all is not waited for any more.
        self._expected = data if self._left and not self._heard else self._expected + data
        self._left = False
        return data

    def sent(self, now: float) -> None:
        """Our last byte left."""
        self._left = True
        self.line.sent(now)

    def answers(self, adu: Adu) -> bool:
        """As the line inside."""
        return self.line.answers(adu)

    def feed(self, data: bytes | None, now: float) -> list[LineEvent]:
        """What came, without the echo."""
        events = self._feed(data, now)
        if events and self._first:
            self._first = False
            if self.echoes is None and self._tells and isinstance(events[0], Adu) and self.line.answers(events[0]):
                self.echoes = False
        return events

    def _feed(self, data: bytes | None, now: float) -> list[LineEvent]:
        if not self._expected:
            return self.line.feed(data, now)
        if not data:
            if self._heard and now >= self._last + self._pause:
                return self._collide(
                    b"", now, f"the echo ended after {len(self._heard)} bytes of {len(self._expected)}"
                )
            return self.line.feed(data, now)
        self._last = now
        heard = self._heard + data
        echo = heard[: len(self._expected)]
        if not self._expected.startswith(echo):
            return self._collide(data, now, f"sent {_show(self._expected)}, heard {_show(heard)}")
        self._heard = echo
        if len(echo) < len(self._expected):
            return []
        self.echoed += len(echo)
        self._expected = self._heard = b""
        self._first = False
        if self._tells:
            self.echoes = True
        self.line.sent(now)
        return self.line.feed(heard[len(echo) :], now) if len(heard) > len(echo) else []

    def _collide(self, data: bytes, now: float, text: str) -> list[LineEvent]:
        heard, self._expected, self._heard = self._heard + data, b"", b""
        if self.echoes is None:
            return self.line.feed(heard, now)  # there may be no echo at all
        self.collisions += 1
        return [Noise(b"", "mismatch", f"collision: {text}"), *self.line.feed(heard, now)]


def _show(data: bytes) -> str:
    return data[:16].hex(" ").upper() + (" ..." if len(data) > 16 else "")
