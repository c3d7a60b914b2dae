"""One CAN frame as a value, and its text in the notation of can-utils.   [ISO 11898-1]

The CAN controller does the work of a serial framing: length, check sum, acknowledgement and repetition. A frame
arrives whole or not at all, so one value is enough:

        identifier             length   data
        11 bits (base)         DLC      0 to 8 bytes                              605#4000100000000000
        29 bits (extended)                                                        00000605#4000100000000000
        remote frame (RTR)     DLC      none: a request for the frame of this     705#R1
                                        identifier, DLC bytes long

The base identifier 605h and the extended identifier 00000605h are two different identifiers on the wire, although the
numbers are equal. So `key`, the identity of a frame, is a pair. CANopen uses base identifiers; an extended frame
usually belongs to another protocol on the same cable.

A bus interface also delivers CAN FD frames (`FdFrame`) and error frames (`ErrorFrame`), in which the controller itself
reports the state of the bus. Neither is a `CanFrame`, and neither is ever fed to a machine.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

from barewire.errors import DecodeError, EncodeError

BASE_MAX = 0x7FF
EXTENDED_MAX = 0x1FFF_FFFF
DATA_MAX = 8


class CanFrame(NamedTuple):
    """A classical CAN frame: a data frame, or a remote frame that requests `requested` bytes.

    The constructor checks nothing, because a port makes thousands of frames a second from data that the controller has
    already checked. `CanFrame.checked` also validates its arguments.

    >>> str(CanFrame(0x605, bytes.fromhex("40 00 10 00 00 00 00 00")))
    '605#4000100000000000'
    """

    id: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    requested: int = 0

    @classmethod
    def checked(
        cls, id: int, data: bytes = b"", *, extended: bool = False, remote: bool = False, requested: int = 0
    ) -> CanFrame:
        """Make a frame, and raise EncodeError if CAN cannot carry it."""
        limit, form = (EXTENDED_MAX, "an extended") if extended else (BASE_MAX, "a base")
        if not 0 <= id <= limit:
            raise EncodeError(f"identifier {id:X}h: expected 0..{limit:X}h for {form} frame")
        if len(data) > DATA_MAX:
            raise EncodeError(f"{len(data)} bytes of data: a CAN frame carries at most {DATA_MAX}")
        if remote and data:
            raise EncodeError("a remote frame carries no data: it requests some")
        if not 0 <= requested <= DATA_MAX or (requested and not remote):
            raise EncodeError(f"{requested} bytes requested: expected 0..{DATA_MAX}, and only in a remote frame")
        return cls(id, bytes(data), extended, remote, requested)

    @classmethod
    def each(cls, id: int, parts: Iterable[bytes], extended: bool = False) -> list[CanFrame]:
        """Return one frame for each of `parts`, for example for the segments of an SDO block.

        >>> [str(frame) for frame in CanFrame.each(0x605, [bytes([1, 65]), bytes([0x82, 66])])]
        ['605#0141', '605#8242']
        """
        new = tuple.__new__  # half the time of the constructor, and a transfer in blocks has thousands
        return [new(cls, (id, data, extended, False, 0)) for data in parts]

    @property
    def key(self) -> tuple[int, bool]:
        """(identifier, extended), which filters, tables and machines compare."""
        return self.id, self.extended

    @property
    def dlc(self) -> int:
        """The data length code; in a remote frame, the number of bytes that it requests."""
        return self.requested if self.remote else len(self.data)

    def __str__(self) -> str:
        identifier = f"{self.id:08X}" if self.extended else f"{self.id:03X}"
        if self.remote:
            return f"{identifier}#R{self.requested or ''}"
        return f"{identifier}#{self.data.hex().upper()}"

    @classmethod
    def parse(cls, text: str) -> CanFrame:
        """Read a frame from text as `candump -L` writes it, the inverse of `str`.

        >>> CanFrame.parse("705#R1").dlc
        1
        >>> CanFrame.parse("00000581#11.22.33").key
        (1409, True)

        Three digits are a base identifier, eight an extended one; dots between bytes are skipped. Raise DecodeError.
        """
        raw = text.strip()
        seen = raw.encode("ascii", "replace")
        identifier, hash_sign, body = raw.partition("#")
        if not hash_sign:
            raise DecodeError("delimiter", seen, len(seen), f"{text!r} has no '#'")
        if body.startswith("#"):
            raise DecodeError("value", seen, len(identifier) + 1, f"{text!r} is a CAN FD frame, not a classical one")
        if len(identifier) not in (3, 8):
            text = f"identifier {identifier!r}: expected 3 hex digits, or 8 for an extended one"
            raise DecodeError("length", seen, 0, text)
        number = _hex_number(identifier, seen)
        extended = len(identifier) == 8
        if number > (EXTENDED_MAX if extended else BASE_MAX):
            raise DecodeError("value", seen, 0, f"identifier {identifier} has too many bits")
        start = len(identifier) + 1
        if body[:1] in ("R", "r"):
            size = body[1:] or "0"
            if len(size) != 1 or size not in "012345678":
                raise DecodeError("value", seen, start + 1, f"remote frame requests {size!r} bytes: expected 0..8")
            return cls(number, b"", extended, True, int(size))
        digits = body.replace(".", "")
        if len(digits) % 2:
            raise DecodeError("length", seen, len(seen), f"half a byte is left over in {body!r}")
        if len(digits) > 2 * DATA_MAX:
            raise DecodeError("long", seen, start + 2 * DATA_MAX, f"more than {DATA_MAX} bytes of data")
        if digits:
            _hex_number(digits, seen)
        return cls(number, bytes.fromhex(digits), extended)


class FdFrame(NamedTuple):
    """A CAN FD frame of up to 64 bytes. Classical CANopen does not use it.

    >>> str(FdFrame(0x605, bytes.fromhex("40 00 10")))
    '605##0400010'
    """

    id: int
    data: bytes = b""
    extended: bool = False
    flags: int = 0  # bit 0: the data at a higher bit rate; bit 1: the sender is error passive

    def __str__(self) -> str:
        identifier = f"{self.id:08X}" if self.extended else f"{self.id:03X}"
        return f"{identifier}##{self.flags:X}{self.data.hex().upper()}"


_ERROR_CLASSES = (
    "send time-out",
    "arbitration lost",
    "controller problem",
    "protocol violation",
    "transceiver problem",
    "no acknowledgement",
    "bus off",
    "bus error",
    "controller restarted",
    "error counters",
)
"""The bits in the identifier of an error frame, as SocketCAN defines them, bit 0 first.   [Linux, can/error.h]"""
_COUNTERS = 0x200


class ErrorFrame(NamedTuple):
    """A report of the CAN controller about the state of the bus.

    >>> ErrorFrame(0x60).text
    'no acknowledgement, bus off'
    >>> ErrorFrame(0x240, bytes.fromhex("000000000000F800")).text
    'bus off, error counters (248 transmit, 0 receive)'
    """

    classes: int
    data: bytes = b""

    @property
    def text(self) -> str:
        """The classes in words."""
        words = [name for bit, name in enumerate(_ERROR_CLASSES) if self.classes >> bit & 1]
        if self.counters is not None:  # their class is the last word
            words[-1] += " ({} transmit, {} receive)".format(*self.counters)
        return ", ".join(words) or f"error class {self.classes:X}h"

    @property
    def counters(self) -> tuple[int, int] | None:
        """The counters of transmit and of receive errors; None if the frame does not have them."""
        if not self.classes & _COUNTERS or len(self.data) != DATA_MAX:
            return None
        return self.data[6], self.data[7]


AnyFrame: TypeAlias = CanFrame | FdFrame | ErrorFrame
"""Everything that a bus interface or a recording of a bus delivers."""


def _hex_number(digits: str, seen: bytes) -> int:
    """Read hex digits. int(x, 16) alone would also accept '+1', '1_0' and ' 1'."""
    for character in digits:
        if character not in "0123456789ABCDEFabcdef":
            raise DecodeError("character", seen, max(0, seen.find(character.encode("ascii", "replace"))), "not hex")
    return int(digits, 16)
