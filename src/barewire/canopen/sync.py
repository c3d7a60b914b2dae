"""SYNC: the beat that synchronous PDOs follow.   [CiA 301, SYNC]

        080h |              0 bytes, or
        080h | counter 1    1 byte, 1 up to the value of 1019h (2..240), then 1 again

A type 1 PDO is sent or takes effect at every SYNC, a type n PDO at every n-th. The AZ3 leaves the factory with type 0
and type 1 only: without somebody who sends SYNC, nothing moves.
"""

from __future__ import annotations

from dataclasses import dataclass

from barewire.canopen.cob import cob_id
from barewire.canopen.frame import CanFrame
from barewire.errors import DecodeError, EncodeError

COUNTER_MAX = 240


@dataclass(frozen=True, slots=True)
class Sync:
    """One beat, with its number if the producer counts.

    >>> str(Sync().encode()), str(Sync(1).encode())
    ('080#', '080#01')
    """

    counter: int | None = None

    def encode(self) -> CanFrame:
        """The frame with COB-ID 080h."""
        if self.counter is None:
            return CanFrame(cob_id("SYNC"))
        if not 1 <= self.counter <= COUNTER_MAX:
            raise EncodeError(f"SYNC counter {self.counter}: expected 1..{COUNTER_MAX}")
        return CanFrame(cob_id("SYNC"), bytes([self.counter]))

    @classmethod
    def decode(cls, frame: CanFrame) -> Sync:
        """Raises DecodeError for another identifier, for more than one byte, for a counter of 0 or above 240."""
        if frame.key != (cob_id("SYNC"), False) or frame.remote:
            raise DecodeError("mismatch", frame.data, 0, f"{frame} is no SYNC: that has COB-ID 080h")
        if len(frame.data) > 1:
            raise DecodeError("long", frame.data, 1, "SYNC has a counter or nothing")
        if not frame.data:
            return cls()
        if not 1 <= frame.data[0] <= COUNTER_MAX:
            raise DecodeError("value", frame.data, 0, f"SYNC counter {frame.data[0]}: expected 1..{COUNTER_MAX}")
        return cls(frame.data[0])
