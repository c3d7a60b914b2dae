"""The protocol of a line: the members that the framings rtu, ascii and tcp have in common.

A *line* is the framing state of one connection. Any class with these members is a line, without inheritance.

    to send                                          to receive
    -------                                          ----------
    request(unit, pdu) -> bytes on the wire          feed(data | None, now) -> [Adu | Noise, ...]
    response(to, pdu)  -> bytes on the wire          deadline: feed None at this time if nothing arrived
    quiet_at: do not send before this time           answers(adu): is it from the unit of the request?
    sent(now): the bytes were transmitted            held: bytes that are not decided yet
                                                     broken: why no later byte can be trusted
"""

from __future__ import annotations

from typing import Protocol, TypeAlias

from barewire.errors import DecodeError
from barewire.modbus.adu import Adu, Noise

LineEvent: TypeAlias = Adu | Noise


class Line(Protocol):
    """The framing state of one connection."""

    @property
    def numbered(self) -> bool:
        """Whether responses carry the number of their request, as on TCP. If not, a late one can pass for another."""

    @property
    def quiet_at(self) -> float:
        """The earliest time to send: on RTU t3.5 after the last byte, elsewhere a time that is always past."""

    @property
    def delay(self) -> float:
        """How much later than its last byte a frame may be returned: on RTU after the silence that ends it."""

    @property
    def deadline(self) -> float | None:
        """When to feed None if nothing arrived; None if there is nothing to wait for."""

    @property
    def held(self) -> bytes:
        """The bytes that are neither a frame nor noise yet."""

    @property
    def broken(self) -> DecodeError | None:
        """Why no later byte can be trusted, so that the connection must be closed. Only TCP lines break."""

    def request(self, unit: int, pdu: bytes) -> bytes:
        """Return the bytes that carry a request. From here on `answers` refers to this request."""

    def response(self, to: Adu, pdu: bytes) -> bytes:
        """Return the bytes that carry the response to the received request `to`."""

    def sent(self, now: float) -> None:
        """Record that the bytes of `request` or `response` were transmitted, the last one at `now`."""

    def feed(self, data: bytes | None, now: float) -> list[LineEvent]:
        """Return the events of bytes that arrived, the last one at `now`; None if only time passed. Never raises."""

    def answers(self, adu: Adu) -> bool:
        """Whether this frame has the unit, and on TCP the transaction number, of the last request."""
