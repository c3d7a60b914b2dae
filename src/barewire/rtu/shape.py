"""What the bytes of a frame tell of its length, by who is listening to whom.

    a client                 hears responses                 01 | 03 06 ....
    a server, its own units  hears requests                  01 | 10 0001 0002 04 ....
    a server, other units    hears both, and so does whoever listens in

A frame can lose its end and keep a good CRC: where the last byte of the CRC is 00, the rest of the frame leaves no
remainder either. Then only the count tells that a byte is missing.
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
    """What may be heard from which unit. `units` are the server's own addresses."""

    def __init__(self, role: Role, units: Container[int]) -> None:
        self.role: Role = role
        self._units = units

    def measured(self, unit: int, pdu: bytes) -> list[int | None]:
        """How long the PDU that begins like this will be, for each kind of message that it may be."""
        if self.role == "client":
            return [measure_response(pdu)]
        if unit in self._units:
            return [measure_request(pdu)]
        return [measure_request(pdu), measure_response(pdu)]

    def reads(self, unit: int, pdu: bytes) -> bool:
        """Whether this is a message, of a kind that may be heard from this unit."""
        kinds: list[Callable[[bytes], object]] = [] if self.role == "client" else [decode_request]
        if self.role == "client" or unit not in self._units:
            kinds.append(decode_response)
        for read in kinds:
            with suppress(DecodeError):
                read(pdu)
                return True
        return False

    def is_whole(self, held: bytes) -> bool:
        """Whether all of these bytes, with silence behind them, are one frame.

        What its count calls longer, by no more than a CRC, and what can be read with so many bytes, lost its end. What
        can be read as it is (query data of one byte) is what it is, and a count that lies is for the server to decline.
        """
        if not SHORTEST <= len(held) <= LONGEST or crc16(held) != 0:
            return False
        unit, pdu = held[0], held[1:-2]
        cut = [size for size in self.measured(unit, pdu) if size is not None and len(pdu) < size <= len(pdu) + 2]
        if not cut or self.reads(unit, pdu):
            return True
        return not any(self.reads(unit, held[1 : 1 + size]) for size in cut)
