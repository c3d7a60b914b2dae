"""One CAN frame as a value, and the line of text that the whole world writes for it.

CAN delivers whole frames or nothing: length, check sum, acknowledgement and repetition are the controller's work.
So where Modbus needs three rooms of envelopes, CANopen needs one value:

        identifier             length   data
        11 bits (base)         DLC      0 to 8 bytes                     605#4000100000000000
        29 bits (extended)                                               00000605#4000100000000000
        remote frame (RTR)     DLC      none: "who owns this, say it"    705#R1

The base identifier 605h and the extended identifier 00000605h are two different things on the wire, although the
numbers are equal. That is why `key`, the identity of a frame, is a pair. CANopen speaks with base identifiers;
an extended frame usually belongs to somebody else on the same cable.

What else a bus interface hands over is no `CanFrame` and never gets into a machine: a CAN FD frame (`FdFrame`), and an
error frame (`ErrorFrame`), which nobody sent: the controller reports the state of the bus with it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

from barewire.errors import DecodeError, EncodeError

BASE_MAX = 0x7FF
EXTENDED_MAX = 0x1FFF_FFFF
DATA_MAX = 8

_new = tuple.__new__  # what CanFrame(...) comes to, without the function around it


class CanFrame(NamedTuple):
    """A classical CAN frame: a data frame, or a remote frame that asks for `requested` bytes.

    The plain constructor checks nothing, because a receiving shell makes thousands a second from what a controller
    has checked already. Whoever puts a frame together from numbers of his own takes `CanFrame.checked`.

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
        """The frame, or an EncodeError that says why the wire cannot carry it."""
        limit, kind = (EXTENDED_MAX, "an extended") if extended else (BASE_MAX, "a base")
        if not 0 <= id <= limit:
            raise EncodeError(f"identifier {id:X}h: expected 0..{limit:X}h for {kind} frame")
        if len(data) > DATA_MAX:
            raise EncodeError(f"{len(data)} bytes of data: a CAN frame carries at most {DATA_MAX}")
        if remote and data:
            raise EncodeError("a remote frame carries no data: it asks for some")
        if not 0 <= requested <= DATA_MAX or (requested and not remote):
            raise EncodeError(f"{requested} bytes requested: expected 0..{DATA_MAX}, and only in a remote frame")
        return cls(id, bytes(data), extended, remote, requested)

    @classmethod
    def each(cls, id: int, every: Iterable[bytes], extended: bool = False) -> list[CanFrame]:
        """A frame for each of these data, as quickly as that can be done: a block of SDO is 127 of them.

        >>> [str(frame) for frame in CanFrame.each(0x605, [bytes([1, 65]), bytes([0x82, 66])])]
        ['605#0141', '605#8242']
        """
        return [_new(cls, (id, data, extended, False, 0)) for data in every]

    @property
    def key(self) -> tuple[int, bool]:
        """Who is speaking: (identifier, extended). Two frames with different keys have nothing in common."""
        return self.id, self.extended

    @property
    def dlc(self) -> int:
        """The data length code: of a remote frame, how many bytes it asks for."""
        return self.requested if self.remote else len(self.data)

    def __str__(self) -> str:
        identifier = f"{self.id:08X}" if self.extended else f"{self.id:03X}"
        if self.remote:
            return f"{identifier}#R{self.requested or ''}"
        return f"{identifier}#{self.data.hex().upper()}"

    @classmethod
    def parse(cls, text: str) -> CanFrame:
        """The frame behind the text that `candump -L` writes: `str` backwards.

        >>> CanFrame.parse("705#R1").dlc
        1
        >>> CanFrame.parse("00000581#11.22.33").key
        (1409, True)

        Three digits are a base identifier, eight an extended one; dots between bytes are welcome. Raises DecodeError.
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
        at = len(identifier) + 1
        if body[:1] in ("R", "r"):
            asked = body[1:] or "0"
            if len(asked) != 1 or asked not in "012345678":
                raise DecodeError("value", seen, at + 1, f"remote frame asks for {asked!r} bytes: expected 0..8")
            return cls(number, b"", extended, True, int(asked))
        digits = body.replace(".", "")
        if len(digits) % 2:
            raise DecodeError("length", seen, len(seen), f"half a byte is left over in {body!r}")
        if len(digits) > 2 * DATA_MAX:
            raise DecodeError("long", seen, at + 2 * DATA_MAX, f"more than {DATA_MAX} bytes of data")
        if digits:
            _hex_number(digits, seen)
        return cls(number, bytes.fromhex(digits), extended)


class FdFrame(NamedTuple):
    """A CAN FD frame: up to 64 bytes. Classical CANopen neither sends nor understands it.

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
)
"""What the bits of an error frame's identifier mean on SocketCAN, bit 0 first."""


class ErrorFrame(NamedTuple):
    """A report of the controller about the bus.

    >>> ErrorFrame(0x60).text
    'no acknowledgement, bus off'
    """

    classes: int
    data: bytes = b""

    @property
    def text(self) -> str:
        """The classes in words."""
        words = [name for bit, name in enumerate(_ERROR_CLASSES) if self.classes >> bit & 1]
        return ", ".join(words) or f"error class {self.classes:X}h"


AnyFrame: TypeAlias = CanFrame | FdFrame | ErrorFrame
"""Everything that a bus interface or a recording of a bus delivers."""


def _hex_number(digits: str, seen: bytes) -> int:
    """Hex digits only: int(x, 16) alone would also take '+1', '1_0' and ' 1'."""
    for character in digits:
        if character not in "0123456789ABCDEFabcdef":
            raise DecodeError("character", seen, max(0, seen.find(character.encode("ascii", "replace"))), "not hex")
    return int(digits, 16)
