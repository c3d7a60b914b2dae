"""What an envelope must offer to carry Modbus: the members that rtu, ascii and tcp have in common.

A *line* is the framing state of one connection. Nobody inherits from this; a class that has these members is a line.

    to speak                                         to hear
    --------                                         -------
    request(unit, pdu) -> bytes on the wire          feed(data | None, now) -> [Adu | Noise, ...]
    response(to, pdu)  -> bytes on the wire          deadline: feed None at this time if nothing came
    quiet_at: not before this time                   answers(adu): does it answer the last request?
    sent(now): what was given is out now             held: bytes that are not decided yet
                                                     broken: why nothing that comes can be trusted any more
"""

from __future__ import annotations

from typing import Protocol, TypeAlias

from barewire.errors import DecodeError
from barewire.modbus.adu import Adu, Noise

LineEvent: TypeAlias = Adu | Noise


class Line(Protocol):
    """The framing state of one connection, whatever the envelope."""

    @property
    def numbered(self) -> bool:
        """Whether answers carry the number of their question, as on TCP; if not, a late one can pass for another's."""

    @property
    def quiet_at(self) -> float:
        """The earliest time at which this line may speak: t3.5 after the last byte on RTU, always elsewhere."""

    @property
    def deadline(self) -> float | None:
        """When to feed None if nothing came; None if there is nothing to wait for."""

    @property
    def held(self) -> bytes:
        """The bytes that are neither frame nor noise yet."""

    @property
    def broken(self) -> DecodeError | None:
        """Why nothing that comes can be trusted any more: the connection is to be closed. Only TCP lines can break."""

    def request(self, unit: int, pdu: bytes) -> bytes:
        """The bytes that carry a request. From here on `answers` means this one."""

    def response(self, to: Adu, pdu: bytes) -> bytes:
        """The bytes that carry the answer to a request that was received."""

    def sent(self, now: float) -> None:
        """The bytes of `request` or `response` have left; `now` is when the last one did."""

    def feed(self, data: bytes | None, now: float) -> list[LineEvent]:
        """Bytes that arrived, the last of them at `now`; None says that time has passed. Never raises."""

    def answers(self, adu: Adu) -> bool:
        """Whether this frame comes from where the last request went (unit; on TCP the transaction too)."""
