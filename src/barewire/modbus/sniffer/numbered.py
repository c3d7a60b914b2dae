"""A sniffer for TCP connections, where responses carry the transaction number of their request.

    client ->   1 03 00 00 00 02        RequestSeen(transaction=1)
    client ->   2 06 00 01 00 03        RequestSeen(transaction=2)
           <-   2 06 00 01 00 03        ResponseSeen(transaction=2)
           <-   1 03 04 ...             ResponseSeen(transaction=1)

Depends on: framing, sniffer. Used by: explain (captures).
"""

from __future__ import annotations

from barewire.modbus.adu import Noise
from barewire.modbus.framing import Line
from barewire.modbus.messages.registry import decode_request, decode_response
from barewire.modbus.sniffer.sniffer import (
    WINDOW,
    NoiseSeen,
    RequestSeen,
    ResponseMissing,
    ResponseSeen,
    SnifferEvent,
    readable,
)

OPEN_LIMIT = 256
"""The most open requests; beyond that the oldest one is reported as unanswered."""


class NumberedSniffer:
    """A machine for the two directions of one connection, each with its own line. `window` as in `Sniffer`.

    >>> from barewire.tcp import TcpLine, encode
    >>> sniffer = NumberedSniffer(TcpLine(), TcpLine())
    >>> sniffer.feed(True, encode(1, bytes.fromhex("0600010003"), 7), 1.0)[0].transaction
    7
    >>> sniffer.feed(False, encode(1, bytes.fromhex("8602"), 7), 1.5)[0].seconds
    0.5
    """

    def __init__(self, client: Line, server: Line, *, window: float = WINDOW) -> None:
        self._lines = {True: client, False: server}
        self._window = window
        self._open: dict[int | None, RequestSeen] = {}

    def feed(self, from_client: bool, data: bytes, now: float) -> list[SnifferEvent]:
        """Return the events of bytes of one direction, received at `now`. Never raises."""
        events: list[SnifferEvent] = [*self._expire(now - self._window, now)]
        for event in self._lines[from_client].feed(data, now):
            if isinstance(event, Noise):
                events.append(NoiseSeen(event, now))
                continue
            unit, pdu, number = event
            if from_client:
                asked = RequestSeen(unit, pdu, now, readable(decode_request, pdu), number)
                earlier = self._open.pop(number, None)
                events += [asked] if earlier is None else [ResponseMissing(earlier, now), asked]
                self._open[number] = asked
            else:
                request = self._open.pop(number, None)
                events.append(ResponseSeen(unit, pdu, now, readable(decode_response, pdu), request, transaction=number))
        while len(self._open) > OPEN_LIMIT:
            events.append(ResponseMissing(self._open.pop(next(iter(self._open))), now))
        return events

    def end(self, now: float) -> list[SnifferEvent]:
        """End the recording: every open request is unanswered."""
        return [*self._expire(float("inf"), now)]

    def _expire(self, before: float, now: float) -> list[ResponseMissing]:
        expired = [number for number, asked in self._open.items() if asked.at < before]
        return [ResponseMissing(self._open.pop(number), now) for number in expired]
