"""The length of a frame from its first bytes, by the role of the receiver.

    a client                      receives responses         01 | 03 06 ....
    a server, its own units       receives requests          01 | 10 0001 0002 04 ....
    a server, other units         receives both
    a listener                    receives both

A frame can lose its last byte and still have a good CRC: if the last byte of the CRC is 00, the bytes before it have
the remainder 0 as well. Then only the byte count shows that a byte is missing.

For the same reason the bytes from a unit can be a request and a response at once, if the role receives both:

    01 03 04 00 F0 00 00 FA 00      response, two registers: 00F0 0000
    01 03 04 00 F0 00 00 FA         request, F000h registers from 0400h

The better of the two, in this order: it belongs to the open request (it answers it, or repeats it); its values are
legal, here 1 to 125 registers; it ends with the bytes that were received; a request, because one without an open
request is more frequent than a response without one.
"""

from __future__ import annotations

from collections.abc import Callable, Container
from contextlib import suppress
from typing import Literal

from barewire.errors import DecodeError, Refused
from barewire.modbus.adu import BROADCAST
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import decode_request, decode_response, measure_request, measure_response
from barewire.rtu.crc import crc16
from barewire.rtu.frame import LONGEST, SHORTEST

Role = Literal["client", "server", "listener"]

_CRC = 2
"""Bytes of the CRC. A frame whose CRC ends with 00 has a good CRC without its last byte, or its last two."""

_Rank = tuple[int, bool, bool]
"""How likely a reading is: 2 it belongs to the open request, 1 it is legal, 0 it is not; whether it ends with the
received bytes; whether it is a request."""


class Shape:
    """The kinds of message that a receiver expects from a unit. `units` are the server's own addresses."""

    def __init__(self, role: Role, units: Container[int]) -> None:
        self.role: Role = role
        self._units = units
        self._open_request: tuple[int, bytes] | None = None  # its unit and PDU

    def measured(self, unit: int, pdu: bytes) -> list[int | None]:
        """Return the length of the PDU that begins with these bytes, for each kind of message that it can be."""
        if self.role == "client":
            return [measure_response(pdu)]
        if unit in self._units:
            return [measure_request(pdu)]
        return [measure_request(pdu), measure_response(pdu)]

    def likeliest(
        self, unit: int, received: bytes, sizes: list[int | None], whole: list[int], may_wait: bool
    ) -> int | None:
        """Return which of `whole` is the length of the PDU, or None if a longer frame is more likely.

        `received` is the PDU and all bytes behind it, `sizes` are the lengths as a request and as a response, and
        `whole` are those of them at which the CRC is good. Without `may_wait` no longer one is considered. A request
        that is returned is open until the next frame that is not a request.
        """
        request, response = sizes
        size = whole[0]
        if request != response:
            longer = self._longer(unit, received, sizes, size) if may_wait else None
            candidates = whole if longer is None else [*whole, longer]
            if len(candidates) > 1:
                size = max(candidates, key=lambda size: self._rank(unit, received, size, size == request))
            if size == longer:
                return None
        pdu = received[:size]
        is_open = size == request and (size != response or not self._answers(unit, pdu))
        self._open_request = (unit, pdu) if is_open else None
        return size

    def _longer(self, unit: int, received: bytes, sizes: list[int | None], whole: int) -> int | None:
        """Return the length of a frame that can have begun with the whole one, if it is worth waiting for."""
        for size in sizes:
            if size is None or size <= whole or (unit, received[:whole]) == self._open_request:
                continue
            # A longer frame with a good CRC is no coincidence if only zeros of its CRC are missing.
            if size <= whole + _CRC or self._rank(unit, received, size, size == sizes[0])[0] == 2:
                return size if size + _CRC > len(received) else None
        return None

    def _rank(self, unit: int, received: bytes, size: int, is_request: bool) -> _Rank:
        """Return how likely it is that the received bytes begin with a request, or response, of this length."""
        pdu = received[:size].ljust(size, b"\0")  # the values that are missing can be any; counts come first
        # A response can begin like a request that is only a function code. Like a longer one it hardly ever begins.
        belongs = size > 1 and self._open_request == (unit, pdu) if is_request else self._answers(unit, pdu)
        if belongs:
            level = 2
        elif is_request:
            level = int(_can_be(decode_request, pdu))
        else:
            level = int(unit != BROADCAST)
        return level, len(received) <= size + _CRC, is_request

    def _answers(self, unit: int, pdu: bytes) -> bool:
        """Whether the PDU answers the open request."""
        if self._open_request is None:
            return False
        open_unit, request = self._open_request
        if open_unit != unit or request[0] != pdu[0] & ~EXCEPTION_BIT:
            return False
        with suppress(DecodeError):
            with suppress(Refused):  # an exception response answers too
                decode_request(request).read_response(pdu)
            return True
        return False

    def reads(self, unit: int, pdu: bytes) -> bool:
        """Whether the PDU can be decoded as a kind of message that is expected from this unit."""
        decoders: list[Callable[[bytes], object]] = [] if self.role == "client" else [decode_request]
        if self.role == "client" or unit not in self._units:
            decoders.append(decode_response)
        return any(_can_be(decode, pdu) for decode in decoders)

    def is_whole(self, held: bytes) -> bool:
        """Whether all of these bytes, followed by silence, are one frame.

        If the byte count announces one or two bytes more, and the PDU can be decoded with bytes of the CRC in their
        place, the frame lost its end. If the PDU can be decoded as it is (query data of one byte), it is a frame. A
        request with any other wrong count is a frame too: the server declines it.
        """
        if not SHORTEST <= len(held) <= LONGEST or crc16(held) != 0:
            return False
        unit, pdu = held[0], held[1:-2]
        cut = [size for size in self.measured(unit, pdu) if size is not None and len(pdu) < size <= len(pdu) + 2]
        if not cut or self.reads(unit, pdu):
            return True
        return not any(self.reads(unit, held[1 : 1 + size]) for size in cut)


def _can_be(decode: Callable[[bytes], object], pdu: bytes) -> bool:
    """Whether the PDU can be decoded."""
    with suppress(DecodeError):
        decode(pdu)
        return True
    return False
