"""The length of a frame from its first bytes, by the role of the receiver.

    a client                      receives responses         01 | 03 06 ....
    a server, its own units       receives requests          01 | 10 0001 0002 04 ....
    a server, other units         receives both
    a listener                    receives both

A frame can lose its last byte and still have a good CRC: if the last byte of the CRC is 00, the bytes before it have
the remainder 0 as well. Then only the byte count shows that a byte is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Container
from contextlib import suppress
from typing import Literal

from barewire.errors import DecodeError
from barewire.modbus.messages.registry import decode_request, decode_response, measure_request, measure_response
from barewire.rtu.crc import crc16
from barewire.rtu.frame import LONGEST, SHORTEST

Role = Literal["client", "server", "listener"]


class Shape:
    """The kinds of message that a receiver expects from a unit. `units` are the server's own addresses."""

    def __init__(self, role: Role, units: Container[int]) -> None:
        self.role: Role = role
        self._units = units

    def measured(self, unit: int, pdu: bytes) -> list[int | None]:
        """Return the length of the PDU that begins with these bytes, for each kind of message that it can be."""
        if self.role == "client":
            return [measure_response(pdu)]
        if unit in self._units:
            return [measure_request(pdu)]
        return [measure_request(pdu), measure_response(pdu)]

    def reads(self, unit: int, pdu: bytes) -> bool:
        """Whether the PDU can be decoded as a kind of message that is expected from this unit."""
        decoders: list[Callable[[bytes], object]] = [] if self.role == "client" else [decode_request]
        if self.role == "client" or unit not in self._units:
            decoders.append(decode_response)
        for decode in decoders:
            with suppress(DecodeError):
                decode(pdu)
                return True
        return False

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
