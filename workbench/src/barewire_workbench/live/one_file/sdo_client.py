"""A blocking SDO client: objects of a CANopen node as bytes, and as numbers.

    client.upload(0x6041)                     ->  b"7\\x06"
    client.read_number(0x6064, "i32")         ->  -1500
    client.write_number(0x60FF, "i32", 1500)

Errors are exceptions: SdoAbort if the node declines, NoAnswer after the time-out, PortError if the port fails; all of
them are BarewireErrors.
"""

from __future__ import annotations

import struct
import threading
from typing import Self, TypeVar

from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.channel import Channel
from barewire.conversation import DEFAULT_TIMEOUT, Conversation
from barewire.errors import DecodeError, EncodeError
from barewire.io.ports.base import Port
from barewire_workbench.live.one_file.can_port import CanPort
from barewire_workbench.live.one_file.carry_out import carry_out
from barewire_workbench.live.one_file.sdo_transfers import download, upload

Result = TypeVar("Result")

NUMBERS = {
    **{"u8": "<B", "u16": "<H", "u32": "<I", "u64": "<Q", "f32": "<f"},
    **{"i8": "<b", "i16": "<h", "i32": "<i", "i64": "<q", "f64": "<d"},
}
"""The types of numbers, and how `struct` writes them; all are little-endian."""


class SdoClient:
    """A client of the default SDO server of one node. Several threads may use it; there is one transfer at a time.

    port       the name of an interface, such as "can0"; or an object with `send(frame)`, `receive(timeout)`, `close()`
    node       the node-ID, 1 to 127
    timeout    seconds that a request waits for its response (default 1)

    `channel` has the counters of received frames, and remembers which late answers may still come; `late_responses` is
    how many came, and were not taken for that of another request.
    """

    def __init__(self, port: str | Port[CanFrame], node: int, *, timeout: float = DEFAULT_TIMEOUT) -> None:
        self.channel = Channel(node)
        self.timeout = timeout
        self._port = CanPort(port) if isinstance(port, str) else port
        self._lock = threading.RLock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def _run(self, conversation: Conversation[CanFrame, Result]) -> Result:
        with self._lock:
            return carry_out(conversation, self._port)

    @property
    def late_responses(self) -> int:
        """How many responses to an earlier request were discarded."""
        return self.channel.late_responses

    def upload(self, index: int, sub: int = 0) -> bytes:
        """Read the bytes of an object."""
        return self._run(upload(self.channel, index, sub, timeout=self.timeout))

    def download(self, index: int, sub: int, data: bytes) -> None:
        """Write the bytes of an object."""
        self._run(download(self.channel, index, sub, data, timeout=self.timeout))

    def read_number(self, index: int, kind: str, sub: int = 0) -> int | float:
        """Read an object of a type of `NUMBERS`. Raises DecodeError for another number of bytes."""
        number, data = self._number(kind), self.upload(index, sub)
        if len(data) != number.size:
            text = f"{index:04X}h:{sub:02X} has {len(data)} bytes, {kind} takes {number.size}"
            raise DecodeError("short" if len(data) < number.size else "long", data, len(data), text)
        value: int | float = number.unpack(data)[0]
        return value

    def write_number(self, index: int, kind: str, value: float, sub: int = 0) -> None:
        """Write an object of a type of `NUMBERS`. Raises EncodeError for a value that the type does not have."""
        try:
            data = self._number(kind).pack(value)
        except (struct.error, OverflowError) as error:
            raise EncodeError(f"{value!r} as {kind}: {error}") from None
        self.download(index, sub, data)

    @staticmethod
    def _number(kind: str) -> struct.Struct:
        if kind not in NUMBERS:
            raise EncodeError(f"type {kind!r}: expected one of {', '.join(NUMBERS)}")
        return struct.Struct(NUMBERS[kind])
