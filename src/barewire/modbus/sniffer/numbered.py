"""Listening in on a connection whose answers bear the number of their question: nothing to guess.

client ->   1 03 00 00 00 02        Asked(transaction=1)
client ->   2 06 00 01 00 03        Asked(transaction=2)
       <-   2 06 00 01 00 03        Answered(transaction=2)
       <-   1 03 04 ...             Answered(transaction=1)
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

KEPT = 256
"""So many questions may be open; the oldest one is told as unanswered when there are more."""


class NumberedSniffer:
    """A machine around the two directions of one connection, each with a line of its own.

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
        """Bytes of one direction, heard at `now`. Never raises."""
        told: list[SnifferEvent] = [*self._expire(now - self._window, now)]
        for event in self._lines[from_client].feed(data, now):
            if isinstance(event, Noise):
                told.append(NoiseSeen(event, now))
                continue
            unit, pdu, number = event
            if from_client:
                asked = RequestSeen(unit, pdu, now, readable(decode_request, pdu), number)
                before = self._open.pop(number, None)
                told += [asked] if before is None else [ResponseMissing(before, now), asked]
                self._open[number] = asked
            else:
                to = self._open.pop(number, None)
                told.append(ResponseSeen(unit, pdu, now, readable(decode_response, pdu), to, transaction=number))
        while len(self._open) > KEPT:
            told.append(ResponseMissing(self._open.pop(next(iter(self._open))), now))
        return told

    def end(self, now: float) -> list[SnifferEvent]:
        """Nothing more will come."""
        return [*self._expire(float("inf"), now)]

    def _expire(self, before: float, now: float) -> list[ResponseMissing]:
        gone = [number for number, asked in self._open.items() if asked.at < before]
        return [ResponseMissing(self._open.pop(number), now) for number in gone]
