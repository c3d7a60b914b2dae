"""The length of a frame from its first bytes, for a client, which receives responses: 01 | 03 06 ....

A frame can lose its last byte and still have a good CRC: if the last byte of the CRC is 00, the bytes before it have
the remainder 0 as well. Then only the byte count shows that a byte is missing.
"""

from __future__ import annotations

from barewire.errors import DecodeError
from barewire.modbus.messages.registry import decode_response, measure_response
from barewire.rtu.crc import crc16
from barewire.rtu.frame import LONGEST, SHORTEST


class Shape:
    """The kinds of message that a client expects from a unit."""

    def measured(self, unit: int, pdu: bytes) -> list[int | None]:
        """Return the length of the PDU that begins with these bytes."""
        return [measure_response(pdu)]

    def reads(self, unit: int, pdu: bytes) -> bool:
        """Whether the PDU can be decoded as a response."""
        try:
            decode_response(pdu)
        except DecodeError:
            return False
        return True

    def is_whole(self, held: bytes) -> bool:
        """Whether all of these bytes, followed by silence, are one frame.

        If the byte count announces one or two bytes more, and the PDU can be decoded with bytes of the CRC in their
        place, the frame lost its end.
        """
        if not SHORTEST <= len(held) <= LONGEST or crc16(held) != 0:
            return False
        unit, pdu = held[0], held[1:-2]
        cut = [size for size in self.measured(unit, pdu) if size is not None and len(pdu) < size <= len(pdu) + 2]
        if not cut or self.reads(unit, pdu):
            return True
        return not any(self.reads(unit, held[1 : 1 + size]) for size in cut)
