"""What an SDO server stands on: a dictionary that it reads and writes, and counters of what it has seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


class ObjectStore(Protocol):
    """What a server needs of an object dictionary. Every method refuses by raising SdoAbort."""

    def size(self, index: int, sub: int) -> int | None:
        """How many bytes the object has, None if that varies."""

    def read(self, index: int, sub: int) -> bytes:
        """Its value, little-endian."""

    def may_write(self, index: int, sub: int, size: int | None) -> None:
        """A value of so many bytes (None: nobody knows) is about to come in segments or blocks: refuse it now if it
        would be refused whatever the bytes are, and not after a megabyte of them."""

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Take a value, or refuse it."""


@dataclass(slots=True)
class ServerCounters:
    """What a server has seen."""

    requests: int = 0  # frames of 8 bytes from the client
    wrong_length: int = 0  # frames with a DLC other than 8, not answered
    unknown_command: int = 0
    reserved_bits: int = 0  # served, although something stood in reserved bits
    aborts_received: int = 0
    aborts_sent: int = 0
    timed_out: int = 0  # of these: because the client fell silent
    strays: int = 0  # segments that still came after a block download was ended, passed over
